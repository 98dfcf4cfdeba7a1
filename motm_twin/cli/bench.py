"""`motm-twin bench NAME ...`: groups of trials with numbers to reach, benchmarks, and experiments by name."""

from collections.abc import Callable, Iterable
from importlib import import_module
from pathlib import Path
from typing import Any

import msgspec
import tyro
from rich.console import Console
from rich.table import Table

from motm_twin.cli.outputs import folder_problem
from motm_twin.generate.barn import PREFIX
from motm_twin.model.names import hint
from motm_twin.perf import anytime, bus, growth, page, period, scale, soak
from motm_twin.perf.report import machine
from motm_twin.plants import MUJOCO, require_mujoco
from motm_twin.program import BAD_INPUT, FAILED, INTERRUPTED, OK, plain_console, table_console
from motm_twin.studies import barn, faults, grasping, people, pool, screening, surprise, task, tracker
from motm_twin.studies.catalogue import EXPERIMENTS, experiment
from motm_twin.studies.groups import GROUPS, bench_group
from motm_twin.studies.pool import BACKENDS
from motm_twin.studies.run import Results, kept_text, run
from motm_twin.studies.settings import BenchSettings
from motm_twin.studies.summary import published_beside, reasons_table, rows, summary_table, write_summary
from motm_twin.warm_up import compile_kernels

TABLE_WIDTH = 132  # characters; a narrower table is not readable

GRASP_RULE = "grasp_rule"
GRASP_RULE_TITLE = "What a floating hand holds on the move, by contact dynamics and by the kinematic plant's rules"

Run = Callable[[BenchSettings, Console], bool]  # True when every number was reached


def _group(name: str) -> Run:
    return lambda given, console: bench_group(GROUPS[name].on(given.plant), given.out, given.workers, console)


def _period(given: BenchSettings, console: Console) -> bool:
    reached = _group("period")(given, console)
    return period.bench_period(given.out, given.share, console) and reached


def _grasp_rule(given: BenchSettings, console: Console) -> bool:
    """Sweep the floating hand; True when a rule nowhere holds what physics loses. Raises SceneError without MuJoCo."""
    require_mujoco()
    sweeps = import_module("motm_twin.physics.floating_hand")
    console.print(f"\n[bold]{GRASP_RULE}[/bold]: {GRASP_RULE_TITLE}")
    outcomes = sweeps.sweep(given.workers, quick=given.quick)
    found = sweeps.counts(outcomes)
    console.print(", ".join(f"{name}: {count}" for name, count in found.items()), markup=False)
    console.print(f"{machine()}, {given.workers} processes; written to {sweeps.write(outcomes, given.out)}")
    return not any(count for name, count in found.items() if name.endswith("holds what physics loses"))


def _grasping(study: grasping.Study) -> Run:
    def run_study(given: BenchSettings, console: Console) -> bool:
        if any(setting.plant == MUJOCO for setting in study.settings):
            require_mujoco()
        return grasping.bench_study(study, given.out, given.share, given.workers, console)

    return run_study


RUNS: dict[str, Run] = {
    **{name: _group(name) for name in GROUPS},
    "period": _period,
    page.NAME: lambda given, console: page.bench_page(given.out, given.seconds, given.minutes, given.visits, console),
    bus.NAME: lambda given, console: bus.bench_bus(given.out, given.seconds, console),
    soak.NAME: lambda given, console: soak.bench_soak(given.out, given.share, console),
    scale.NAME: lambda given, console: scale.bench_scale(given.out, given.seconds, console),
    pool.NAME: lambda given, console: pool.bench_efficiency(given.out, given.workers, console),
    growth.NAME: lambda given, console: growth.bench_growth(given.out, console, quick=given.quick),
    anytime.NAME: lambda given, console: anytime.bench_anytime(given.out, console, quick=given.quick),
    period.SOLVERS_NAME: lambda given, console: period.bench_solvers(given.out, console, quick=given.quick),
    task.NAME: lambda given, console: task.bench_task(given.out, given.share, given.workers, console),
    faults.NAME: lambda given, console: faults.bench_faults(
        given.out, given.share, given.workers, console, kinds=given.kinds, scenes=given.scenes
    ),
    screening.NAME: lambda given, console: screening.bench_screening(
        given.out, given.share, given.workers, console, given.numbers
    ),
    GRASP_RULE: _grasp_rule,
    **{name: _grasping(study) for name, study in grasping.STUDIES.items()},
    surprise.NAME: lambda given, console: surprise.bench_surprise(given.out, given.workers, console),
}
OF_EXTRA = "physics"  # group that needs an extra
ALL = (*(name for name in GROUPS if name != OF_EXTRA), task.NAME)  # of the name "all"
TRIAL = 0.12  # [min] of one trial on one of two processes
ABOUT = {  # of the others: minutes on two cores, and title
    "period": (5, period.TITLE), page.NAME: (10, page.TITLE), bus.NAME: (6, bus.TITLE), soak.NAME: (45, soak.TITLE),
    scale.NAME: (12, scale.TITLE), pool.NAME: (6, pool.TITLE), growth.NAME: (5, growth.TITLE),
    anytime.NAME: (7, anytime.TITLE), period.SOLVERS_NAME: (1, period.SOLVERS_TITLE), task.NAME: (40, task.TITLE),
    faults.NAME: (120, faults.TITLE), surprise.NAME: (12, surprise.TITLE), screening.NAME: (900, screening.TITLE),
    GRASP_RULE: (6, GRASP_RULE_TITLE),
    **{name: (study.minutes, study.title) for name, study in grasping.STUDIES.items()},
}  # fmt: skip
ALONE = (barn.NAME, people.NAME, tracker.NAME)  # named first, with arguments of their own
ONLY_EXPERIMENTS = tuple(name for name in EXPERIMENTS if name not in RUNS)


def main(arguments: list[str]) -> int:
    """Run the command with these arguments; its exit code."""
    return run_bench(tyro.cli(BenchSettings, args=arguments, prog="motm-twin bench"))


def run_bench(given: BenchSettings) -> int:
    """Run the named groups and experiments; the exit code.

    0 when every number was reached and every trial succeeded, 1 when not, 2 for bad input, 130 after Ctrl-C.
    """
    if not given.groups:
        _list_groups(table_console())
        return BAD_INPUT
    if problem := _problem(given):
        plain_console(stderr=True).print(f"motm-twin bench: {problem}", markup=False)
        return BAD_INPUT
    console = table_console()
    console.width = max(console.width, TABLE_WIDTH)
    compile_kernels()
    if given.groups[0] in ALONE:
        return _bench_alone(given, console)
    experiments = [name for name in given.groups if name in ONLY_EXPERIMENTS or given.experiment]
    code = bench_experiments(experiments, given, console) if experiments else OK
    groups = [name for name in given.groups if name not in experiments]
    return max(code, _bench_groups(groups, given, console)) if groups and code != INTERRUPTED else code


def _list_groups(console: Console) -> None:
    """Print what can be measured, and how long it takes."""
    table = Table("group", "about", "what", title="motm-twin bench GROUP [GROUP ...]; all: those above the line")
    whole = {name: (round(len(GROUPS[name].trials) * TRIAL) or 1, GROUPS[name].title) for name in GROUPS}
    whole |= ABOUT
    for name in (*ALL, *(name for name in whole if name not in ALL)):
        table.add_row(name, f"{whole[name][0]} min", whole[name][1], end_section=name == ALL[-1])
    table.add_row(barn.NAME, "", f"{barn.TITLE}; then scene files, or --worlds N")
    table.add_row(people.NAME, "", f"{people.TITLE}; --situations, --methods, --trials N of each from seed --first")
    table.add_row(tracker.NAME, "", f"{tracker.TITLE}; --situations, --trials N of each")
    table.add_section()
    for name in ONLY_EXPERIMENTS:
        table.add_row(name, "", EXPERIMENTS[name].title)
    console.print(table)
    total = sum(whole[name][0] for name in ALL)
    console.print(f"[bold]motm-twin bench all[/bold] takes about {total} minutes on two cores. Name a group.")


def _problem(given: BenchSettings) -> str:
    """Refusal of the first impossible setting; "" when all are possible."""
    if problem := _wrong_name(given):
        return problem
    if given.worlds is not None and given.worlds < 1:
        return f"--worlds {given.worlds}: at least 1 is needed"
    if given.workers < 1:
        return f"--workers {given.workers}: at least 1 is needed"
    if not 0.0 < given.share <= 1.0:
        return f"--share {given.share:g}: give a share above 0, at most 1"
    problem = folder_problem(given.out)
    return f"--out {given.out}: {problem}" if problem else ""


def _wrong_name(given: BenchSettings) -> str:
    """Refusal of the first unknown name, with the known ones; "" when all are known."""
    possible = tuple(EXPERIMENTS) if given.experiment else ("all", *RUNS, *ONLY_EXPERIMENTS, *ALONE)
    named = given.groups if given.groups[0] not in ALONE else []  # scene files may follow it
    for what, names, known in (
        ("experiment" if given.experiment else "group", named, possible),
        ("fault", given.kinds, (faults.NONE, *faults.KINDS)),
        ("scene", given.scenes, tuple(faults.SCENES)),
    ):
        if wrong := [name for name in names if name not in known]:
            return f"unknown {what} {wrong[0]!r}; {hint(wrong[0], known)}"
    return ""


def _bench_alone(given: BenchSettings, console: Console) -> int:
    """The exit code, 2 for names that are none, 1 when a world was not crossed, or a trial or run was no success."""
    workers, out = given.workers, given.out
    try:
        if given.groups[0] == barn.NAME:
            worlds = [*given.groups[1:], *(f"{PREFIX}{seed}" for seed in range(given.worlds or 0))]
            if not worlds:
                text = "bench barn: name scene files, or give --worlds 50 for worlds made from seeds"
                console.print(text, markup=False)
                return BAD_INPUT
            good = barn.bench_barn(worlds, given.methods, given.profile, workers, out, console)
        elif given.groups[0] == people.NAME:
            named = (given.situations, given.methods, given.trials)
            good = people.bench_people(*named, workers, out, console, given.first)
        else:
            good = tracker.bench_tracker(given.situations, given.trials, workers, out, console)
    except ValueError as error:
        return _refused(error, console)
    return OK if good else FAILED


def _refused(error: ValueError, console: Console) -> int:
    console.print(f"motm-twin: {error}", style="red", markup=False)
    return BAD_INPUT


def _bench_groups(groups: list[str], given: BenchSettings, console: Console) -> int:
    """Measure groups against their goals; the exit code."""
    names = [name for name in RUNS if name in groups or ("all" in groups and name in ALL)]
    missed = [name for name in names if not RUNS[name](given, console)]
    console.print(f"\n[red]missed: {', '.join(missed)}[/red]" if missed else "\n[green]all numbers reached[/green]")
    return FAILED if missed else OK


def bench_experiments(names: list[str], given: BenchSettings, console: Console) -> int:
    """Run experiments, print a table each, write the summaries; the exit code."""
    try:
        changes = changes_of(given.changes)
        chosen = [experiment(name, given.methods, given.trials).on(given.plant).changed(changes) for name in names]
        for each in chosen:
            console.print(f"[bold]{each.name}[/bold]: {each.title}, {len(each.specs)} trials")
        results = run(
            chosen,
            out=given.out,
            workers=given.workers,
            backend=given.backend or BACKENDS[0],
            address=given.address,
            console=console,
            retry_failed=given.retry_failed,
        )
    except ValueError as error:  # of the arguments: what goes wrong in a trial is in its result
        return _refused(error, console)
    except KeyboardInterrupt:
        console.print(kept_text(given.out, names), markup=False)
        return INTERRUPTED
    for name in names:
        show(name, results, given.out, console)
    whole = sum(map(len, results.trials.values()))
    where = f"{results.computed} trials run now, {whole - results.computed} known; {given.workers} processes"
    console.print(f"{where}; {machine()}", markup=False)
    succeeded = all(result["success"] for these in results.trials.values() for result in these)
    return OK if succeeded else FAILED


def changes_of(given: Iterable[str]) -> dict[str, Any]:
    """Changes of a scene from texts ``field=value``, the value as JSON or plain. Raises ValueError."""
    changes = {}
    for text in given:
        name, equals, value = text.partition("=")
        if not equals:
            raise ValueError(f"change {text!r}: write FIELD=VALUE, as noise.lidar_range_sd=0.05")
        try:
            changes[name] = msgspec.json.decode(value)
        except msgspec.DecodeError:
            changes[name] = value
    return changes


def show(name: str, results: Results, out: Path, console: Console) -> None:
    """Print the table of one experiment, and where its files are."""
    found, beside = rows(results.of(name)), published_beside(results.of(name))
    console.print(f"\n[bold]{EXPERIMENTS[name].title}[/bold]")
    console.print(summary_table(found, beside))
    if (why := reasons_table(results.of(name))) is not None:
        console.print(why)
    target = write_summary(found, beside, out / name)
    console.print(f"written to {target}; the trials are in {out / name}", markup=False)
