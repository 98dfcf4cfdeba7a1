"""`motm-twin bench NAME ...`: groups of trials with numbers to reach, benchmarks, and experiments by name.

`motm-twin paper`: the experiments, the figures and tables, and the report, in one command.
"""

from collections.abc import Callable, Iterable
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
import tyro
from rich.console import Console
from rich.table import Table

from motm_twin.cli.settings import BenchSettings, PaperSettings
from motm_twin.generate.challenges import PREFIX
from motm_twin.model.names import hint
from motm_twin.perf import bus, growth, page, period, soak
from motm_twin.perf.report import machine
from motm_twin.plants import MUJOCO, require_mujoco
from motm_twin.program import BAD_INPUT, FAILED, INTERRUPTED, OK, folder_problem, plain_console, table_console
from motm_twin.sessions.session import SOURCE, made_with
from motm_twin.studies import barn, disturbances, groups, people, pool, sensitivity
from motm_twin.studies.catalogue import EXPERIMENTS, experiment
from motm_twin.studies.groups import GROUPS, bench_group
from motm_twin.studies.paper import data, parts, report
from motm_twin.studies.pool import BACKENDS
from motm_twin.studies.run import Results, kept_text, run
from motm_twin.studies.statistics import published_beside, reasons_table, rows, summary_table, write_summary
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


def _study(study: sensitivity.Study) -> Run:
    def run_study(given: BenchSettings, console: Console) -> bool:
        if any(setting.plant == MUJOCO for setting in study.settings):
            require_mujoco()
        return sensitivity.bench_study(study, given.out, given.share, given.workers, console)

    return run_study


class Bench(NamedTuple):
    """A benchmark that is not a group of trials."""

    minutes: int  # approximate duration on two cores
    title: str
    run: Run


BENCHES = {
    "period": Bench(5, period.TITLE, _period),
    page.NAME: Bench(10, page.TITLE, lambda given, console: page.bench_page(
        given.out, given.seconds, given.minutes, given.visits, console)),
    bus.NAME: Bench(6, bus.TITLE, lambda given, console: bus.bench_bus(given.out, given.seconds, console)),
    soak.NAME: Bench(45, soak.TITLE, lambda given, console: soak.bench_soak(given.out, given.share, console)),
    bus.SCALE: Bench(12, bus.SCALE_TITLE, lambda given, console: bus.bench_scale(given.out, given.seconds, console)),
    pool.NAME: Bench(6, pool.TITLE, lambda given, console: pool.bench_efficiency(given.out, given.workers, console)),
    growth.NAME: Bench(5, growth.TITLE, lambda given, console: growth.bench_growth(
        given.out, console, quick=given.quick)),
    period.ANYTIME: Bench(7, period.ANYTIME_TITLE, lambda given, console: period.bench_anytime(
        given.out, console, quick=given.quick)),
    period.SOLVERS_NAME: Bench(1, period.SOLVERS_TITLE, lambda given, console: period.bench_solvers(
        given.out, console, quick=given.quick)),
    groups.TASK: Bench(40, groups.TASK_TITLE, lambda given, console: groups.bench_task(
        given.out, given.share, given.workers, console)),
    disturbances.NAME: Bench(120, disturbances.TITLE, lambda given, console: disturbances.bench_faults(
        given.out, given.share, given.workers, console, kinds=given.kinds, scenes=given.scenes)),
    disturbances.SURPRISE: Bench(12, disturbances.SURPRISE_TITLE, lambda given, console: disturbances.bench_surprise(
        given.out, given.workers, console)),
    sensitivity.SCREENING: Bench(900, sensitivity.SCREENING_TITLE, lambda given, console: sensitivity.bench_screening(
        given.out, given.share, given.workers, console, given.numbers)),
    GRASP_RULE: Bench(6, GRASP_RULE_TITLE, _grasp_rule),
    **{name: Bench(study.minutes, study.title, _study(study)) for name, study in sensitivity.STUDIES.items()},
}  # fmt: skip
RUNS: dict[str, Run] = {name: _group(name) for name in GROUPS} | {name: bench.run for name, bench in BENCHES.items()}
OF_EXTRA = "physics"  # group that needs an extra
ALL = (*(name for name in GROUPS if name != OF_EXTRA), groups.TASK)  # for the name "all"
TRIAL = 0.12  # [min] per trial on one of two processes
ALONE = (barn.NAME, people.NAME, people.TRACKER)  # must be named first, and have their own arguments
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
    whole |= {name: (bench.minutes, bench.title) for name, bench in BENCHES.items()}
    for name in (*ALL, *(name for name in whole if name not in ALL)):
        table.add_row(name, f"{whole[name][0]} min", whole[name][1], end_section=name == ALL[-1])
    table.add_row(barn.NAME, "", f"{barn.TITLE}; then scene files, or --worlds N")
    table.add_row(people.NAME, "", f"{people.TITLE}; --situations, --methods, --trials N of each from seed --first")
    table.add_row(people.TRACKER, "", f"{people.TRACKER_TITLE}; --situations, --trials N of each")
    table.add_section()
    for name in ONLY_EXPERIMENTS:
        table.add_row(name, "", EXPERIMENTS[name].title)
    console.print(table)
    total = sum(whole[name][0] for name in ALL)
    console.print(f"[bold]motm-twin bench all[/bold] takes about {total} minutes on two cores. Name a group.")


def _problem(given: BenchSettings) -> str:
    """Refusal of the first impossible setting; "" when there is none."""
    if problem := _wrong_name(given):
        return problem
    if given.worlds is not None and given.worlds < 1:
        return f"--worlds {given.worlds}: at least 1 is needed"
    if not 0.0 < given.share <= 1.0:
        return f"--share {given.share:g}: give a share above 0, at most 1"
    return _impossible(given.workers, given.out)


def _impossible(workers: int, out: Path) -> str:
    """Refusal of a number of processes, or of a folder; "" when both are possible."""
    if workers < 1:
        return f"--workers {workers}: at least 1 is needed"
    problem = folder_problem(out)
    return f"--out {out}: {problem}" if problem else ""


def _wrong_name(given: BenchSettings) -> str:
    """Refusal of the first unknown name, with the known ones; "" when all are known."""
    possible = tuple(EXPERIMENTS) if given.experiment else ("all", *RUNS, *ONLY_EXPERIMENTS, *ALONE)
    named = given.groups if given.groups[0] not in ALONE else []  # scene files may follow
    for what, names, known in (
        ("experiment" if given.experiment else "group", named, possible),
        ("fault", given.kinds, (disturbances.NONE, *disturbances.KINDS)),
        ("scene", given.scenes, tuple(disturbances.SCENES)),
    ):
        if wrong := [name for name in names if name not in known]:
            return f"unknown {what} {wrong[0]!r}; {hint(wrong[0], known)}"
    return ""


def _bench_alone(given: BenchSettings, console: Console) -> int:
    """Run barn, people or tracker; the exit code: 2 for bad input, 1 when a world was not crossed, or a run failed."""
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
            good = people.bench_tracker(given.situations, given.trials, workers, out, console)
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
    except ValueError as error:  # a wrong argument: errors of trials are in their results
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


WARN_HOURS = 3.0  # beyond this, --yes is required


def write_paper(given: PaperSettings) -> int:
    """Run the trials for the report of the paper's experiments, and write it; the exit code."""
    console = plain_console()
    if problem := _paper_problem(given):
        return _refused_paper(problem)
    plan = data.PLANS[given.plan]()
    try:
        records = _records_in_folder(given, plan) if given.draw else _run(given, plan, console)
    except ValueError as error:  # an unusable scene, method or folder, or unconfirmed hours
        return _refused_paper(str(error))
    except KeyboardInterrupt:
        text = f"\nstopped; the finished trials are in {given.out}: the same command resumes there"
        console.print(text, markup=False)
        return INTERRUPTED
    console.print("figures and tables:")
    target = _write(given, plan, records, console)
    console.print(f"written: {target}")
    return 0


def _paper_problem(given: PaperSettings) -> str:
    if unknown := [name for name in given.only if name not in parts.NAMES]:
        return f"there is no figure or table {unknown[0]!r}; {hint(unknown[0], parts.NAMES)}"
    if given.quick and given.full:
        return "--quick and --full exclude each other"
    return _impossible(given.workers, given.out)


def _records_in_folder(given: PaperSettings, plan: data.Plan) -> data.Records:
    """The records in the folder. Raises ValueError when there are none and the requested parts need them."""
    records = data.stored(given.out)
    if not any(records.values()) and parts.needed(plan.experiments, given.only or parts.NAMES):
        raise ValueError(f"--out {given.out}: there is no trial in it to draw: give the folder of a run")
    return records


def _run(given: PaperSettings, plan: data.Plan, console: Console) -> data.Records:
    """Run missing trials; returns the records of the plan and all others in the folder. Raises ValueError."""
    compile_kernels()
    experiments = parts.needed(plan.experiments, given.only) if given.only else plan.experiments
    planned = data.keys(experiments)
    _announce(given, planned, console)
    results = run(
        experiments,
        out=given.out,
        workers=given.workers,
        backend=given.backend,
        address=given.address,
        console=console,
        retry_failed=given.retry_failed,
        about={data.PLAN: plan.name, data.COMMAND: given.command()},
    )
    for note in results.notes:
        console.print(f"  {note}", markup=False)
    if not given.only:
        return {**data.stored(given.out, without=planned), **data.of_plan(given.out, planned)}
    whole = data.keys(each for each in plan.experiments if (given.out / each.name).is_dir())
    data.write_completed(given.out, whole)
    return {**data.stored(given.out, without=whole), **data.of_plan(given.out, whole)}


def _announce(given: PaperSettings, planned: data.Keys, console: Console) -> None:
    """Print the expected duration. Raises ValueError for unconfirmed hours."""
    left, count = data.missing(given.out, planned, retry_failed=given.retry_failed)
    expected_h = data.hours(left, given.workers)
    expected = f"{expected_h:.1f} h" if expected_h >= 1.0 else f"{60.0 * expected_h:.0f} min"
    console.print(
        f"{len(left)} of {count} trials to run, expected to take {expected} with {given.workers} processes on this "
        "machine; then the figures"
    )
    if expected_h > WARN_HOURS and not given.yes and not _begun(given):
        raise ValueError(f"that is long: add --yes to start, more --workers, or --backend ray; expected {expected}")


def _begun(given: PaperSettings) -> bool:
    """True when the folder has trials of this plan, run with the current source."""
    current = (given.plan, made_with()[SOURCE])
    notes = (record.made_with for these in data.stored(given.out).values() for record in these)
    return any((note.get(data.PLAN), note.get(SOURCE)) == current for note in notes)


def _write(given: PaperSettings, plan: data.Plan, records: data.Records, console: Console) -> Path:
    """Draw the report, and note the origin of the trials."""
    ran = data.origin((record for these in records.values() for record in these), given.command())
    known = [name for name in data.PLANS if name in ran.plans]  # the largest plan that ran the trials comes last
    shown = data.PLANS[known[-1]]() if given.draw and known else plan
    trials = {name: [record.result for record in these] for name, these in records.items()}
    context = parts.Context(data.Store(trials), given.out, console, not given.no_page, shown.name, ran.sources)
    given.out.mkdir(parents=True, exist_ok=True)
    for warning in report.stale(ran):
        console.print(f"  {warning}", markup=False)
    return report.write(context, ran, given.command(), given.only or parts.NAMES, shown.notes)


def _refused_paper(why: str) -> int:
    plain_console(stderr=True).print(f"motm-twin paper: {why}", markup=False)
    return BAD_INPUT
