"""`python -m motm_twin.bench [GROUP ...]`: the numbers of the paper and ours. Exit code 1 when one is missed.

"all" are the groups of trials, which are of the paper's method, and "task", which tells how long the work takes with
`fast`, the paper's method beside it. The others run only when they are named: "page" measures the served page and needs
Chromium, "bus" measures what goes over Zenoh, "soak" treats a server badly for long, "scale" loads a router,
"efficiency" tells what more processes are worth, "growth" makes the world larger, "anytime" the search shorter and
longer, "solvers" compares those of the QP, "faults" lets sensors and robot fail, "mismatch" has them otherwise than the
robot is told, "surprise" puts things where the robot is. "barn" stands first and alone: worlds of the BARN challenge
follow it, as scene files or as barn:SEED, or --worlds of the latter.

With --methods, --trials, --backend, --address or --retry-failed a name is that of an experiment instead: any methods,
any number of trials, kept on disk and gone on with, compared in a table. Some names are experiments only.
"""

import argparse
import sys
from pathlib import Path

from rich.console import Console

from motm_twin.bench import (
    anytime,
    barn,
    bus,
    faults,
    growth,
    mismatch,
    page,
    period,
    scale,
    soak,
    solvers,
    surprise,
    task,
)  # fmt: skip
from motm_twin.bench.experiments import command, efficiency
from motm_twin.bench.experiments.catalogue import EXPERIMENTS
from motm_twin.bench.groups import GROUPS
from motm_twin.bench.table import bench
from motm_twin.console import table_console
from motm_twin.model.scene_barn import PREFIX
from motm_twin.record.outputs import folder_problem

KNOWN = (
    *GROUPS, page.NAME, bus.NAME, soak.NAME, scale.NAME, efficiency.NAME, growth.NAME, anytime.NAME, solvers.NAME,
    task.NAME, faults.NAME, mismatch.NAME, surprise.NAME,
)  # fmt: skip
ALL = (*GROUPS, task.NAME)
ONLY_EXPERIMENTS = tuple(name for name in EXPERIMENTS if name not in KNOWN)
TABLE_WIDTH = 132  # characters; a narrower table is not readable


def main(arguments: list[str] | None = None, *, prog: str = "python -m motm_twin.bench") -> int:
    """Run the named groups, or all; 0 when every number was reached, 1 when not. ``prog``: how it was called."""
    parser = argparse.ArgumentParser(prog=prog, description=__doc__)
    parser.add_argument(
        "groups", nargs="*", default=["all"], metavar="GROUP", help=f"all, {', '.join((*KNOWN, *ONLY_EXPERIMENTS))}"
    )
    parser.add_argument("--workers", type=int, default=2, help="trials run at the same time (default 2)")
    parser.add_argument("--out", type=Path, default=Path("out/bench"), help="folder of the JSON files")
    page.add_options(parser)
    parser.add_argument("--worlds", type=int, default=None, help="barn: worlds of the seeds from 0")
    parser.add_argument("--profile", choices=barn.PROFILES, default=None, help="barn: limits of the Jackal")
    command.add_options(parser)
    parser.add_argument(
        "--share", type=float, default=1.0, help="soak, period, task, faults, mismatch: of the full counts (default 1)"
    )
    parser.add_argument("--kinds", nargs="+", default=[], metavar="FAULT", help="faults: only these (none: without)")
    parser.add_argument("--scenes", nargs="+", default=[], metavar="SCENE", help="faults: only these")
    parser.add_argument("--quick", action="store_true", help="growth, anytime, solvers: a few points, half a minute")
    options = parser.parse_args(arguments)
    problem = _problem(options)
    if problem:
        parser.error(problem)
    console = table_console()
    console.width = max(console.width, TABLE_WIDTH)
    if options.groups[0] == barn.NAME:
        return _bench_barn(options, console)
    experiments = [name for name in options.groups if name in ONLY_EXPERIMENTS or command.wanted(options)]
    code = command.bench_experiments(experiments, options, console) if experiments else 0
    groups = [name for name in options.groups if name not in experiments]
    return max(code, _bench_groups(groups, options, console)) if groups and code != command.INTERRUPTED else code


def _bench_barn(options: argparse.Namespace, console: Console) -> int:
    """The exit code: 2 for names that are none, 1 when a world was not crossed."""
    names = [*options.groups[1:], *(f"{PREFIX}{seed}" for seed in range(options.worlds or 0))]
    if not names:
        console.print("bench barn: name scene files, or say --worlds 50 for worlds from seeds", markup=False)
        return command.BAD_INPUT
    try:
        crossed = barn.bench_barn(names, options.methods or (), options.profile, options.workers, options.out, console)
    except ValueError as error:
        console.print(f"motm-twin: {error}", style="red", markup=False)
        return command.BAD_INPUT
    return command.OK if crossed else command.FAILED


def _problem(options: argparse.Namespace) -> str:
    """What is wrong with the arguments, "" when nothing is."""
    if options.groups[0] != barn.NAME:
        problem = _unknown(options)
    elif options.worlds is not None and options.worlds < 1:
        problem = f"--worlds {options.worlds}: at least 1 is needed"
    else:
        problem = ""
    if problem:
        return problem
    if options.workers < 1:
        return "need a worker"
    for what, given, known in (
        ("fault", options.kinds, (faults.NONE, *faults.KINDS)),
        ("scene", options.scenes, tuple(faults.SCENES)),
    ):
        wrong = [name for name in given if name not in known]
        if wrong:
            return f"unknown {what} {wrong[0]!r}: use {', '.join(known)}"
    if not 0.0 < options.share <= 1.0:
        return f"--share {options.share:g}: allowed is more than 0 and at most 1"
    problem = folder_problem(options.out)
    return f"--out {options.out}: {problem}" if problem else ""


def _unknown(options: argparse.Namespace) -> str:
    """The first name that is none, in a sentence; "" when all are known."""
    possible = tuple(EXPERIMENTS) if command.wanted(options) else ("all", *KNOWN, *ONLY_EXPERIMENTS)
    unknown = [name for name in options.groups if name not in possible]
    if unknown:
        what = "experiment" if command.wanted(options) else "group"
        return f"unknown {what} {unknown[0]!r}: use {', '.join(possible)}"
    return ""


def _bench_groups(groups: list[str], options: argparse.Namespace, console: Console) -> int:
    """Measure groups against their goals; the exit code."""
    names = [name for name in KNOWN if name in groups or ("all" in groups and name in ALL)]
    missed = [name for name in names if not _reached(name, options, console)]
    console.print(f"\n[red]missed: {', '.join(missed)}[/red]" if missed else "\n[green]all numbers reached[/green]")
    return 1 if missed else 0


def _reached(name: str, options: argparse.Namespace, console: Console) -> bool:
    if name == page.NAME:
        return page.bench_page(options.out, options.seconds, options.minutes, options.visits, console)
    if name == bus.NAME:
        return bus.bench_bus(options.out, options.seconds, console)
    if name == soak.NAME:
        return soak.bench_soak(options.out, options.share, console)
    if name == scale.NAME:
        return scale.bench_scale(options.out, options.seconds, console)
    if name == efficiency.NAME:
        return efficiency.bench_efficiency(options.out, options.workers, console)
    if name == growth.NAME:
        return growth.bench_growth(options.out, console, quick=options.quick)
    if name == anytime.NAME:
        return anytime.bench_anytime(options.out, console, quick=options.quick)
    if name == solvers.NAME:
        return solvers.bench_solvers(options.out, console, quick=options.quick)
    if name == faults.NAME:
        return faults.bench_faults(
            options.out, options.share, options.workers, console, kinds=options.kinds, scenes=options.scenes
        )
    if name == surprise.NAME:
        return surprise.bench_surprise(options.out, options.workers, console)
    if name == mismatch.NAME:
        return mismatch.bench_mismatch(options.out, options.share, options.workers, console)
    if name == task.NAME:
        return task.bench_task(options.out, options.share, options.workers, console)
    reached = bench(GROUPS[name], options.out, options.workers, console)
    return period.bench_period(options.out, options.share, console) and reached if name == "period" else reached


if __name__ == "__main__":
    sys.exit(main())
