"""`motm-twin paper`: the experiments, the figures and tables, and the report, in one command."""

from pathlib import Path
from typing import Annotated

import tyro
from rich.console import Console

from motm_twin.cli.commands import PaperSettings, folder_problem
from motm_twin.model.names import hint
from motm_twin.program import BAD_INPUT, INTERRUPTED, plain_console

WARN_HOURS = 3.0  # beyond this, --yes is required


def paper(settings: Annotated[PaperSettings, tyro.conf.arg(name="")]) -> int:
    """Run the paper's experiments and write a report to cite: figures, tables, results, one HTML file.

    The default runs all methods on ten trials of Experiments 1 and 1a and on five of 2, each modification switched off
    on ten, other values of four parameters on five, ten seeds of every error and five of late, missed and slipped
    grasps: less than an hour on two cores. After Ctrl-C the same command resumes. Exit code 0: the report was written;
    2: bad input; 130: stopped with Ctrl-C.
    """
    from motm_twin.studies.paper.data import PLANS

    given, console = settings, plain_console()
    if problem := _problem(given):
        return _refused(problem)
    plan = PLANS[given.plan]()
    try:
        records = _records_in_folder(given, plan) if given.draw else _run(given, plan, console)
    except ValueError as error:  # a scene, method or folder with which no trial can be run; or hours
        return _refused(str(error))
    except KeyboardInterrupt:
        text = f"\nstopped; the finished trials are in {given.out}: the same command resumes there"
        console.print(text, markup=False)
        return INTERRUPTED
    console.print("figures and tables:")
    target = _write(given, plan, records, console)
    console.print(f"written: {target}")
    return 0


def _problem(given: PaperSettings) -> str:
    from motm_twin.studies.paper.parts import NAMES

    if unknown := [name for name in given.only if name not in NAMES]:
        return f"there is no figure or table {unknown[0]!r}; {hint(unknown[0], NAMES)}"
    if given.quick and given.full:
        return "--quick and --full exclude each other"
    if given.workers < 1:
        return f"--workers {given.workers}: at least 1"
    problem = folder_problem(given.out)
    return f"--out {given.out}: {problem}" if problem else ""


def _records_in_folder(given: PaperSettings, plan) -> dict:
    """The records in the folder. Raises ValueError when there are none, and what is asked for is drawn from some."""
    from motm_twin.studies.paper.data import stored
    from motm_twin.studies.paper.parts import NAMES, needed

    records = stored(given.out)
    if not any(records.values()) and needed(plan.experiments, given.only or NAMES):
        raise ValueError(f"--out {given.out}: there is no trial in it to draw: give the folder of a run")
    return records


def _run(given: PaperSettings, plan, console: Console) -> dict:
    """Run what is missing; the records of the plan, and of what else is in the folder. Raises ValueError."""
    from motm_twin.studies.paper.data import COMMAND, PLAN, keys, of_plan, stored, write_completed
    from motm_twin.studies.paper.parts import needed
    from motm_twin.studies.run import run
    from motm_twin.warm_up import compile_kernels

    compile_kernels()
    experiments = needed(plan.experiments, given.only) if given.only else plan.experiments
    wanted = keys(experiments)
    _announce(given, wanted, console)
    results = run(
        experiments,
        out=given.out,
        workers=given.workers,
        backend=given.backend,
        address=given.address,
        console=console,
        retry_failed=given.retry_failed,
        about={PLAN: plan.name, COMMAND: given.command()},
    )
    for note in results.notes:
        console.print(f"  {note}", markup=False)
    if not given.only:
        return {**stored(given.out, without=wanted), **of_plan(given.out, wanted)}
    whole = keys(each for each in plan.experiments if (given.out / each.name).is_dir())
    write_completed(given.out, whole)
    return {**stored(given.out, without=whole), **of_plan(given.out, whole)}


def _announce(given: PaperSettings, wanted, console: Console) -> None:
    """Say how long it will take. Raises ValueError for hours that nobody has confirmed."""
    from motm_twin.studies.paper.data import hours, missing

    left, count = missing(given.out, wanted, retry_failed=given.retry_failed)
    expected_h = hours(left, given.workers)
    expected = f"{expected_h:.1f} h" if expected_h >= 1.0 else f"{60.0 * expected_h:.0f} min"
    console.print(
        f"{len(left)} of {count} trials to run, expected to take {expected} with {given.workers} processes on this "
        "machine; then the figures"
    )
    if expected_h > WARN_HOURS and not given.yes and not _begun(given):
        raise ValueError(f"that is long: add --yes to start, more --workers, or --backend ray; expected {expected}")


def _begun(given: PaperSettings) -> bool:
    """The folder has trials of this plan, run with the source as it is now."""
    from motm_twin.sessions.session import SOURCE, made_with
    from motm_twin.studies.paper.data import PLAN, stored

    wanted = (given.plan, made_with()[SOURCE])
    notes = (record.made_with for these in stored(given.out).values() for record in these)
    return any((note.get(PLAN), note.get(SOURCE)) == wanted for note in notes)


def _write(given: PaperSettings, plan, records: dict, console: Console) -> Path:
    """Draw the report, and note the origin of the trials."""
    from motm_twin.studies.paper import report
    from motm_twin.studies.paper.data import PLANS, Store, origin
    from motm_twin.studies.paper.parts import NAMES, Context

    ran = origin((record for these in records.values() for record in these), given.command())
    known = [name for name in PLANS if name in ran.plans]  # the largest plan that ran the trials comes last
    shown = PLANS[known[-1]]() if given.draw and known else plan
    trials = {name: [record.result for record in these] for name, these in records.items()}
    context = Context(Store(trials), given.out, console, not given.no_page, shown.name, ran.sources)
    given.out.mkdir(parents=True, exist_ok=True)
    for warning in report.stale(ran):
        console.print(f"  {warning}", markup=False)
    return report.write(context, ran, given.command(), given.only or NAMES, shown.notes)


def _refused(why: str) -> int:
    plain_console(stderr=True).print(f"motm-twin paper: {why}", markup=False)
    return BAD_INPUT
