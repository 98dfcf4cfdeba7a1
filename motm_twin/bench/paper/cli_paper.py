"""`motm-twin paper`: the experiments, the figures and tables, and the report, in one command."""

from pathlib import Path
from typing import Annotated, Literal

import tyro
from rich.console import Console

from motm_twin.model.names import hint

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

    By default eight methods on ten trials of Experiments 1 and 1a and five of 2, and each modification switched off on
    ten: half an hour to an hour on two cores. After Ctrl-C the same command goes on where it ended. Exit code 0: the
    report was written; 2: bad input; 130: stopped with Ctrl-C.

    Args:
        out: Folder for everything; trials that are in it are not run again.
        quick: One trial of everything, in about five minutes: to see that it works.
        full: Fifty seeds everywhere; says how long, and needs --yes.
        yes: Start also what takes hours.
        only: Only these figures and tables, with the experiments that they need.
        draw: Run nothing: draw what is in the folder, from whichever state of the source.
        no_page: No photographs of the page.
        workers: Processes.
        backend: loky: processes here; ray: a cluster (extra [cluster]).
        address: Of the Ray cluster.
        retry_failed: Run trials again that were without success.
    """
    from motm_twin.bench.paper import report
    from motm_twin.bench.paper.context import Context
    from motm_twin.bench.paper.data import Store
    from motm_twin.bench.paper.parts import NAMES
    from motm_twin.bench.paper.plan import PLANS
    from motm_twin.bench.paper.stored import stored

    console = Console(highlight=False, soft_wrap=True)
    unknown = [name for name in only if name not in NAMES]
    if unknown:
        return _refused(f"there is no figure or table {unknown[0]!r}; {hint(unknown[0], NAMES)}")
    if quick and full:
        return _refused("--quick and --full exclude each other")
    if workers < 1:
        return _refused(f"--workers {workers}: at least 1")
    plan = PLANS["quick" if quick else "full" if full else "default"]()
    if not draw:
        plan = _needed(plan, only)
        hours = plan.hours(workers)
        console.print(
            f"{plan.trials()} trials, expected to take {said(hours)} with {workers} processes on this machine"
        )
        if hours > WARN_HOURS and not yes:
            return _refused(
                f"that is long: add --yes to start, more --workers, or --backend ray; expected {said(hours)}"
            )
    try:
        trials, sources = (
            stored(out)
            if draw
            else _run(plan, out, console, workers=workers, backend=backend, address=address, retry_failed=retry_failed)
        )
    except ValueError as error:  # a scene, method or folder with which no trial can be run
        return _refused(str(error))
    except KeyboardInterrupt:
        console.print(f"\nstopped; the finished trials are in {out}: the same command goes on from there", markup=False)
        return INTERRUPTED
    console.print("figures and tables:")
    context = Context(Store(trials), out, console, not no_page)
    out.mkdir(parents=True, exist_ok=True)
    command = _command(plan.name, out, workers, draw, only)
    target = report.write(context, plan, command, tuple(only) or NAMES, sources)
    console.print(f"written: {target}")
    return 0


def said(hours: float) -> str:
    """A duration as one says it."""
    return f"{hours:.1f} h" if hours >= 1.0 else f"{60.0 * hours:.0f} min"


def _needed(plan, only: tuple[str, ...]):
    """The plan with only the experiments that the named parts need."""
    import dataclasses

    from motm_twin.bench.paper.parts import PARTS

    if not only:
        return plan
    needs = {name for source in PARTS if source.name in only for name in source.needs}
    return dataclasses.replace(plan, experiments=tuple(each for each in plan.experiments if each.name in needs))


def _run(
    plan, out: Path, console: Console, *, workers: int, backend: str, address: str | None, retry_failed: bool
) -> tuple[dict, list[str]]:
    """Results by experiment, those of `bench` in the folder as well, and the sources that they come from."""
    from motm_twin.bench.experiments.run import run
    from motm_twin.bench.paper.stored import stored
    from motm_twin.record.made_with import SOURCE, made_with

    results = run(plan.experiments, out=out, workers=workers, backend=backend, address=address, console=console,
                  retry_failed=retry_failed)  # fmt: skip
    for note in results.notes:
        console.print(f"  {note}", markup=False)
    own = {experiment.name for experiment in plan.experiments}
    others, sources = stored(out, without=own)
    return {**others, **results.trials}, list(dict.fromkeys([made_with()[SOURCE], *sources]))


def _command(plan: str, out: Path, workers: int, draw: bool, only: tuple[str, ...]) -> str:
    size = {"default": "", "full": " --full --yes", "quick": " --quick"}[plan]
    return (
        f"motm-twin paper{size} --workers {workers} --out {out}"
        + " --draw" * draw
        + (" --only " + " ".join(only) if only else "")
    )


def _refused(why: str) -> int:
    Console(stderr=True, highlight=False, soft_wrap=True).print(f"motm-twin paper: {why}", markup=False)
    return BAD_INPUT
