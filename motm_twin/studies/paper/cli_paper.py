"""`motm-twin paper`: the experiments, the figures and tables, and the report, in one command."""

import shlex
from collections.abc import Collection
from pathlib import Path
from typing import Annotated, Literal, NamedTuple

import tyro
from rich.console import Console

from motm_twin.model.names import hint
from motm_twin.record.outputs import folder_problem

BAD_INPUT, INTERRUPTED = 2, 130
WARN_HOURS = 3.0  # beyond this nobody starts by accident


def paper(
    out: Annotated[Path, tyro.conf.arg(metavar="DIR")] = Path("out/paper"),
    quick: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False,
    full: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False,
    yes: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False,
    only: Annotated[tuple[str, ...], tyro.conf.arg(metavar="NAME")] = (),
    draw: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False,
    no_page: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False,
    workers: int = 2,
    backend: Literal["loky", "ray"] = "loky",
    address: str | None = None,
    retry_failed: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False,
) -> int:
    """Run the paper's experiments and write a report to cite: figures, tables, results, one HTML file.

    By default all methods on ten trials of Experiments 1 and 1a and five of 2, each modification switched off on ten,
    other values of four parameters on five, ten seeds of every error and five of late, missed and slipped grasps: less
    than an hour on two cores. After Ctrl-C the same command goes on where it ended. Exit code 0: the report was
    written; 2: bad input; 130: stopped with Ctrl-C.

    Args:
        out: Folder for everything; trials that are in it are not run again.
        quick: In less than five minutes, to see that it works: one trial of every method and modification on Experiment
            1, of four methods on 1a, of motm and fast on 2; one seed of one level of every error and of late grasps;
            one value of every swept parameter.
        full: Fifty seeds everywhere; says how long, and needs --yes, but not to go on.
        yes: Start also what takes hours.
        only: Only these figures and tables, with the trials that they are made from.
        draw: Run no experiment: draw what is in the folder, from whichever plan and state of the source.
        no_page: No photographs of the page.
        workers: Processes.
        backend: loky: processes here; ray: a cluster (extra [cluster]).
        address: Of the Ray cluster.
        retry_failed: Run trials again that were without success.
    """
    from motm_twin.studies.paper.parts import NAMES
    from motm_twin.studies.paper.plan import PLANS

    console = Console(highlight=False, soft_wrap=True)
    unknown = [name for name in only if name not in NAMES]
    if unknown:
        return _refused(f"there is no figure or table {unknown[0]!r}; {hint(unknown[0], NAMES)}")
    if quick and full:
        return _refused("--quick and --full exclude each other")
    if workers < 1:
        return _refused(f"--workers {workers}: at least 1")
    if problem := folder_problem(out):
        return _refused(f"--out {out}: {problem}")
    plan = PLANS["quick" if quick else "full" if full else "default"]()
    call = Call(plan.name, out, workers, backend, address, retry_failed=retry_failed, draw=draw, only=only)
    try:
        records = _kept(call, plan) if draw else _run(call, plan, console, yes=yes)
    except ValueError as error:  # a scene, method or folder with which no trial can be run; or hours
        return _refused(str(error))
    except KeyboardInterrupt:
        console.print(f"\nstopped; the finished trials are in {out}: the same command goes on from there", markup=False)
        return INTERRUPTED
    console.print("figures and tables:")
    target = _write(call, plan, records, console, pages=not no_page)
    console.print(f"written: {target}")
    return 0


class Call(NamedTuple):
    """What was asked for."""

    plan: str
    out: Path
    workers: int
    backend: str
    address: str | None
    retry_failed: bool
    draw: bool
    only: tuple[str, ...]

    def text(self) -> str:
        """The same as a command."""
        from motm_twin.studies.paper.parts import OPTIONS

        run = f"{OPTIONS[self.plan]} --workers {self.workers}"
        run += f" --backend {self.backend}" if self.backend != "loky" else ""
        run += f" --address {self.address}" if self.address else ""
        run += " --retry-failed" if self.retry_failed else ""
        only = f" --only {' '.join(self.only)}" if self.only else ""
        return f"motm-twin paper{' --draw' if self.draw else run} --out {shlex.quote(str(self.out))}{only}"


def said(hours: float) -> str:
    """A duration as one says it."""
    return f"{hours:.1f} h" if hours >= 1.0 else f"{60.0 * hours:.0f} min"


def _kept(call: Call, plan) -> dict:
    """The records in the folder. Raises ValueError when there are none, and what is asked for is drawn from some."""
    from motm_twin.studies.paper.parts import NAMES, needed
    from motm_twin.studies.paper.stored import stored

    records = stored(call.out)
    if not any(records.values()) and needed(plan.experiments, call.only or NAMES):
        raise ValueError(f"--out {call.out}: there is no trial in it to draw: give the folder of a run")
    return records


def _run(call: Call, plan, console: Console, *, yes: bool) -> dict:
    """Run what is missing; the records of the plan, and of what else is in the folder. Raises ValueError."""
    from motm_twin.studies.paper.parts import needed
    from motm_twin.studies.paper.stored import COMMAND, PLAN, completed, keys, of_plan, stored
    from motm_twin.studies.run import run

    experiments = needed(plan.experiments, call.only) if call.only else plan.experiments
    wanted = keys(experiments)
    _announce(call, wanted, console, yes=yes)
    results = run(
        experiments,
        out=call.out,
        workers=call.workers,
        backend=call.backend,
        address=call.address,
        console=console,
        retry_failed=call.retry_failed,
        about={PLAN: plan.name, COMMAND: call.text()},
    )
    for note in results.notes:
        console.print(f"  {note}", markup=False)
    if not call.only:
        return {**stored(call.out, without=wanted), **of_plan(call.out, wanted)}
    whole = keys(each for each in plan.experiments if (call.out / each.name).is_dir())
    completed(call.out, whole)
    return {**stored(call.out, without=whole), **of_plan(call.out, whole)}


def _announce(call: Call, wanted, console: Console, *, yes: bool) -> None:
    """Say how long it will take. Raises ValueError for hours that nobody has confirmed."""
    from motm_twin.studies.paper.plan import hours
    from motm_twin.studies.paper.stored import missing

    left, count = missing(call.out, wanted, retry_failed=call.retry_failed)
    expected = said(hours(left, call.workers))
    console.print(
        f"{len(left)} of {count} trials to run, expected to take {expected} with {call.workers} processes on this "
        "machine; then the figures"
    )
    if hours(left, call.workers) > WARN_HOURS and not yes and not _begun(call):
        raise ValueError(f"that is long: add --yes to start, more --workers, or --backend ray; expected {expected}")


def _begun(call: Call) -> bool:
    """Whether trials of this plan were run into the folder before, with the source as it is now."""
    from motm_twin.record.made_with import SOURCE, made_with
    from motm_twin.studies.paper.stored import PLAN, stored

    wanted = (call.plan, made_with()[SOURCE])
    notes = (record.made_with for these in stored(call.out).values() for record in these)
    return any((note.get(PLAN), note.get(SOURCE)) == wanted for note in notes)


def _write(call: Call, plan, records: dict, console: Console, *, pages: bool) -> Path:
    """Draw, and say what is known of who ran the trials."""
    from motm_twin.studies.paper import report
    from motm_twin.studies.paper.data import Store
    from motm_twin.studies.paper.parts import NAMES, Context
    from motm_twin.studies.paper.stored import origin

    ran = origin((record for these in records.values() for record in these), call.text())
    shown = _largest(ran.plans, plan) if call.draw else plan
    trials = {name: [record.result for record in these] for name, these in records.items()}
    context = Context(Store(trials), call.out, console, pages, shown.name, ran.sources)
    call.out.mkdir(parents=True, exist_ok=True)
    for warning in report.stale(ran):
        console.print(f"  {warning}", markup=False)
    return report.write(context, ran, call.text(), call.only or NAMES, shown.notes)


def _largest(names: Collection[str], otherwise):
    """The largest of the plans that ran the trials of a folder."""
    from motm_twin.studies.paper.plan import PLANS

    known = [name for name in PLANS if name in names]
    return PLANS[known[-1]]() if known else otherwise


def _refused(why: str) -> int:
    Console(stderr=True, highlight=False, soft_wrap=True).print(f"motm-twin paper: {why}", markup=False)
    return BAD_INPUT
