"""Groups of trials with goals, and the benchmark of the task time: trials, their execution, and tables."""

import math
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from rich.console import Console
from rich.table import Table

from motm_twin.external.robot import LinkSpec
from motm_twin.measures.measures import PARTS
from motm_twin.methods.registry import FAST, MOTM
from motm_twin.perf.report import (
    Limit,
    Sheet,
    Wanted,
    enough,
    goal_table,
    grid,
    machine,
    number,
    wanted_rows,
    wanted_table,
    write_report,
)
from motm_twin.plants import PLANTS
from motm_twin.studies.catalogue import experiment
from motm_twin.studies.pool import Lost, local_pool, outcomes
from motm_twin.studies.run import Result, Results, run_or_stop
from motm_twin.studies.spec import Experiment, TrialSpec, broken, job_of, run_job
from motm_twin.studies.statistics import caused, drove_into, paired_ratio, touches

Measure = Callable[[list[Result]], float]


class Trial(TrialSpec, frozen=True, kw_only=True):
    """One run, with options beyond those of a `TrialSpec`."""

    link: LinkSpec | None = None  # external robot behind this link, on a shared clock
    beside: bool = False  # also run it on the kinematic plant


@dataclass(frozen=True, kw_only=True)
class Goal(Limit):
    """A number to reach, and its measurement from the results of a group."""

    measure: Measure


@dataclass(frozen=True, kw_only=True)
class Group:
    """Trials that are measured together."""

    name: str
    title: str
    trials: tuple[Trial, ...]
    goals: tuple[Goal, ...]
    alone: bool = False  # one trial at a time: its wall time is measured

    def on(self, plant: str) -> "Group":
        """The same group on another plant; with the default plant, trials keep their own."""
        if plant == PLANTS[0]:
            return self
        return replace(self, trials=tuple(msgspec.structs.replace(trial, plant=plant) for trial in self.trials))


NAN = float("nan")


def _sum_of(key: str) -> Measure:
    return lambda results: sum(result[key] for result in results)


def _mean_of(key: str) -> Measure:
    def mean(results: list[Result]) -> float:
        values = [result[key] for result in results]
        return float(np.mean(values)) if values and None not in values else NAN

    return mean


def _worst(part: str) -> Measure:
    """The worst over all trials but the first, which may have compiled kernels."""
    return lambda results: float(np.max([result["tick_ms"][part] for result in results[1:]]))  # nan stays nan


def _mean_time(results: list[Result], time: Callable[[Result], float] = lambda result: result["time_s"]) -> float:
    """Mean time [s] if all trials are completed, else nan: a trial that gave up early is not fast."""
    completed = bool(results) and all(result["success"] for result in results)
    return float(np.mean(list(map(time, results)))) if completed else NAN


def _mean_time_by(key: str) -> Measure:
    """Mean time over the mean reference time ``key`` of the same trials; nan unless all are completed."""
    return lambda results: _mean_time(results) / _mean_of(key)(results)


def _first_time(results: list[Result]) -> float:
    return next((one["time_s"] for one in results if one["variant"] == "trial1" and one["success"]), NAN)


def _disagreements(results: list[Result]) -> int:
    """Number of contacts found by the referee's geometry only, or by the forces only."""
    return sum(len(result["physics"]["disagreements"]) for result in results if "physics" in result)


def _exactly(name: str, limit: float, measure: Measure) -> Goal:
    return Goal(name=name, unit="", relation="==", limit=limit, measure=measure)


def _done(picks: int, hits: Measure = touches) -> tuple[Goal, ...]:
    return (
        _exactly("picked", picks, _sum_of("picks_done")),
        _exactly("placed", picks, _sum_of("places_done")),
        _exactly("contacts", 0, hits),
        _exactly("trials not completed", 0, lambda results: sum(not result["success"] for result in results)),
    )


def _published(scene: str, links: Iterable[LinkSpec | None] = (None,) * 10) -> tuple[Trial, ...]:
    return tuple(Trial(scene=scene, variant=f"trial{number}", link=link) for number, link in enumerate(links, start=1))


def _mean_limit(limit: float) -> Goal:
    return Goal(name="mean time", unit="s", limit=limit, measure=_mean_time, decimals=1)


def _compared(name: str, key: str) -> Goal:
    return Goal(name=name, unit="", limit=1.05, measure=_mean_time_by(key), decimals=3)


def _at_least(name: str, unit: str, limit: float, measure: Measure, decimals: int) -> Goal:
    return Goal(name=name, unit=unit, relation=">=", limit=limit, measure=measure, decimals=decimals)


def _slowest(results: list[Result]) -> float:
    """Least real-time factor of all trials but the first, which may have compiled kernels."""
    return min((result["realtime_factor"] for result in results[1:]), default=NAN)


_GROUPS = (
    Group(
        name="exp1",
        title="Experiment 1, the ten published trials (paper, simulation: mean 95.9 s, trial 1 85.6 s)",
        trials=_published("exp1"),
        goals=(
            *_done(60),
            _mean_limit(95.9),
            Goal(name="trial 1", unit="s", limit=85.6, measure=_first_time, decimals=1),
            _at_least("base speed while the fingers close", "m/s", 0.2, _mean_of("mean_closing_base_speed_mps"), 3),
        ),
    ),
    Group(
        name="exp1_random",
        title="Experiment 1, six of twelve slots at random, seeds 0 to 19",
        trials=tuple(Trial(scene="exp1", variant="random", seed=seed) for seed in range(20)),
        goals=_done(120),
    ),
    Group(
        name="exp1a",
        title="Experiment 1a, the ten trials with two unmapped boxes",
        trials=_published("exp1a"),
        goals=(*_done(60), _mean_limit(107.0)),
    ),
    Group(
        name="exp2",
        title="Experiment 2, four Temis drive round the table, seeds 0 to 9",
        trials=tuple(Trial(scene="exp2", variant="random", seed=seed) for seed in range(10)),
        goals=_done(60, drove_into),
    ),
    Group(
        name="external",
        title="Experiment 1 with the robot in another process, on a shared clock",
        trials=_published("exp1", (LinkSpec(),) * 10),
        goals=(*_done(60), _compared("mean time by in-process", "in_process_s")),
    ),
    Group(
        name="external_bad_link",
        title="The same through 50 ms latency, 20 ms jitter and 1 % loss in each direction",
        trials=_published("exp1", (LinkSpec(latency=0.05, jitter=0.02, loss=0.01, seed=k) for k in range(1, 11))),
        goals=_done(60),
    ),
    Group(
        name="external_outages",
        title="The same through 20 ms latency, where in every 2 s nothing arrives for 0.25 s, at random times",
        trials=_published("exp1", (LinkSpec(latency=0.02, outage=0.25, every=2.0, seed=k) for k in range(1, 11))),
        goals=tuple(goal for goal in _done(60) if goal.name != "picked"),  # lost cubes are picked again
    ),
    Group(
        name="physics",
        title="Experiment 1 under contact dynamics, beside the kinematic plant: fast and motm",
        trials=tuple(
            msgspec.structs.replace(trial, method=method, plant="mujoco", beside=True)
            for method in ("fast", "motm")
            for trial in _published("exp1")
        ),
        goals=(
            *_done(120),
            _compared("mean time by the kinematic plant's", "kinematic_s"),
            _exactly("referee and forces disagree", 0, _disagreements),
            _at_least("simulated by real time", "x", 2, _slowest, 1),
        ),
    ),
    Group(
        name="period",
        title="One period from observation to command, one core; the same trial three times, the first to warm up",
        trials=(Trial(scene="exp1", variant="trial1", seed=0),) * 3,
        goals=(
            Goal(name="p50", unit="ms", limit=10, measure=_worst("p50"), decimals=2),
            Goal(name="p99", unit="ms", limit=25, measure=_worst("p99"), decimals=2),
            _at_least("simulated by real time", "x", 4, _slowest, 1),
            _exactly("different state hashes", 1, lambda results: len({each["state_hash"] for each in results})),
        ),
        alone=True,
    ),
)
GROUPS: dict[str, Group] = {group.name: group for group in _GROUPS}


LIMIT_S = 1800.0  # [s] of wall time per group; trials not done by then count as failed


def run_group(group: Group, workers: int, limit_s: float = LIMIT_S) -> Iterator[Result]:
    """Results in the order of the trials, each as soon as it and all before it are done."""
    deadline = time.monotonic() + limit_s
    calls = [(trial, deadline) for trial in group.trials]
    done: dict[int, Result] = {}
    following = 0
    for index, outcome in outcomes(_run_until, calls, local_pool(1 if group.alone else workers)):
        done[index] = failed(group.trials[index], outcome.reason) if isinstance(outcome, Lost) else outcome
        while following in done:
            yield done.pop(following)
            following += 1


def run_one(trial: Trial) -> Result:
    """One trial; one that breaks gives a failed result."""
    result = run_job(job_of(trial)).result
    result = {**result, **result["wall"]} if "tick_ms" in result["wall"] else failed(trial, result["reason"])
    if trial.beside:
        other = run_job(job_of(msgspec.structs.replace(trial, plant=PLANTS[0]))).result
        return {**result, "kinematic_s": other["time_s"] if other["success"] else None}
    if trial.link is None:
        return result
    from motm_twin.perf.processes import run_external

    outside = run_external(trial.scene, trial.variant, trial.link, method=trial.method)
    return {**outside, "in_process_s": result["time_s"], "link": msgspec.to_builtins(trial.link)}


def _run_until(call: tuple[Trial, float]) -> Result:
    """One trial, or a failed result when the time is over or the trial broke."""
    trial, deadline = call
    if time.monotonic() > deadline:
        return failed(trial, f"not run: the group's limit of {LIMIT_S:.0f} s of wall time was over")
    try:
        return run_one(trial)
    except Exception as error:  # of the external robot; the other trials are still worth a table
        return failed(trial, f"{type(error).__name__}: {error}")


def failed(trial: Trial, reason: str) -> Result:
    """Placeholder for the result of a trial that had none."""
    return {
        **broken(job_of(trial), reason), "in_process_s": 0.0, "kinematic_s": None, "reference_tour_s": 0.0,
        "tick_ms": dict.fromkeys(("p50", "p99", "max"), NAN), "realtime_factor": 0.0, "state_hash": f"none: {reason}",
    }  # fmt: skip


def bench_group(group: Group, out: Path, workers: int, console: Console) -> bool:
    """Run a group, print its table, write ``out/<group>.json``; True when every goal was reached."""
    console.print(f"\n[bold]{group.name}[/bold]: {group.title}")
    results = []
    for result in run_group(group, workers):
        results.append(result)
        console.print(f"  {len(results)}/{len(group.trials)} {progress(result)}", markup=False)
    goals = judged(group, results)
    reached = len(results) == len(group.trials) and all(goal["reached"] for goal in goals)
    console.print(SHEET.table(results))
    console.print(goal_table(goals))
    target = write_report(out, group.name, group.title, reached=reached, goals=goals, trials=results)
    console.print(f"{machine()}, {workers} processes; written to {target}")
    return reached


def judged(group: Group, results: list[Result]) -> list[dict[str, Any]]:
    """Every goal with its measured value."""
    return [goal.judged(float(goal.measure(results))) for goal in group.goals]


def progress(result: Result) -> str:
    """One trial in one line, as soon as it is done."""
    name = f"{result['scene']}/{result['variant']} seed {result['seed']}: {result['time_s']:.1f} s"
    return name if result["success"] else f"{name}, not completed: {result['reason']}"


COLUMNS: dict[str, Callable[[Result], str]] = {
    "trial": lambda one: f"{one['scene']}/{one['variant']}",
    "seed": lambda one: str(one["seed"]),
    "time s": lambda one: f"{one['time_s']:.1f}",
    "tour s": lambda one: f"{one['reference_tour_s']:.1f}",
    "picked": lambda one: f"{one['picks_done']}/{one['picks_total']}",
    "placed": lambda one: str(one["places_done"]),
    "contacts": lambda one: str(len(one["contacts"])),
    "caused": lambda one: str(caused([one])),
    "base m": lambda one: number(one["min_base_clearance_m"], 3),
    "arm m": lambda one: number(one["min_arm_clearance_m"], 3),
    "path m": lambda one: number(one["path_length_m"], 1),
    "closing m/s": lambda one: number(one["mean_closing_base_speed_mps"], 3),
    "p50 ms": lambda one: number(one["tick_ms"]["p50"], 1),
    "p99 ms": lambda one: number(one["tick_ms"]["p99"], 1),
    "x real": lambda one: f"{one['realtime_factor']:.1f}",
    "done": lambda one: "yes" if one["success"] else "NO",
}
SHEET = Sheet(
    head=COLUMNS,
    cells=lambda one: [write(one) for write in COLUMNS.values()],
    good=lambda one: one["success"],
    bad="red",
)


TASK = "task"
TASK_TITLE = (
    "How long the task takes: the paper's experiments, a quicker robot, and scenes that the code was not made for"
)
METHODS = (FAST.name, MOTM.name)  # the first is judged
RANDOM = 50  # seeds of the random arrangements
GENERATED = 200  # scenes


def _completed_share(key: str, what: str, least: float) -> Wanted:
    return Wanted(key=key, name=f"{what}, completed", unit="%", least=least, best=100.0, more=True, decimals=1)


WANTED = (
    Wanted(key="exp1", name="exp1, ten trials, mean", unit="s", least=88.0, best=80.0, decimals=1),
    Wanted(key="exp1a", name="exp1a, ten trials, mean", unit="s", least=97.0, best=88.0, decimals=1),
    Wanted(key="random", name="exp1, random arrangements, mean", unit="s", least=88.0, best=80.0, decimals=1),
    Wanted(key="four", name="exp2, four Temis, over exp1 by seed", unit="%", least=20.0, best=12.0, decimals=1),
    Wanted(key="one", name="exp2, one Temi, over exp1 by seed", unit="%", least=4.0, best=2.0, decimals=1),
    Wanted(
        key="closing", name="exp1, base speed while the fingers close", unit="m/s", least=0.3, best=0.4, more=True,
        decimals=3,
    ),
    Wanted(key="quick", name="quick robot, time by reference tour", unit="", least=1.7, best=1.5),
    _completed_share("further", "further scenes", 100.0),
    _completed_share("generated", "generated scenes", 99.0),
    _completed_share("paper", "the paper's experiments", 100.0),
    Wanted(key="contacts", name="contacts (exp2: driven into)", unit="", least=0.0, best=0.0, decimals=0),
)  # fmt: skip


def experiments(share: float) -> dict[str, Experiment]:
    """The experiments by the folder of their results; ``share`` of the random seeds and generated scenes."""
    random, generated = math.ceil(RANDOM * share), math.ceil(GENERATED * share)
    trials = dict.fromkeys(("exp1", "exp1a", "exp1_random", "exp2", "one_temi", "quick_robot", "further_scenes"))
    trials |= dict.fromkeys(("exp1_random", "exp2", "one_temi"), random) | {"generated": generated}
    wanted = {name: experiment(name.removesuffix("_random"), METHODS, count) for name, count in trials.items()}
    return {name: Experiment(name, each.title, each.specs) for name, each in wanted.items()}


def bench_task(out: Path, share: float, workers: int, console: Console) -> bool:
    """Run, print, write ``out/task.json``; True when `fast` reaches all least goals.

    About 900 trials with a share of 1: estimated at two hours of one core.
    """
    console.print(f"\n[bold]{TASK}[/bold]: {TASK_TITLE}")
    chosen = experiments(share)
    results = run_or_stop(chosen.values(), out=out / TASK, workers=workers, console=console)
    if results is None:
        return False
    columns = {method: values(results, method) for method in METHODS}
    console.print(wanted_table(WANTED, columns))
    spent = {method: parts(results, method) for method in METHODS}
    console.print(parts_table(spent))
    for method in METHODS:
        for result in _without_success(results, method):
            what = f"{result['scene']}/{result['variant']} seed {result['seed']} {method}: {result['reason']}"
            console.print(f"  not completed: {what}", style="yellow", markup=False)
    reached = all(enough(row, columns[METHODS[0]][row.key], row.least) for row in WANTED)
    rounded = {method: {key: round(value, 4) for key, value in column.items()} for method, column in columns.items()}
    rows = wanted_rows(WANTED, rounded)
    counts = {name: len(each.specs) // len(METHODS) for name, each in chosen.items()}
    target = write_report(out, TASK, TASK_TITLE, reached=reached, trials=counts, rows=rows, parts=spent)
    console.print(f"{machine()}, {workers} processes; written to {target}")
    return reached


def values(results: Results, method: str) -> dict[str, float]:
    """Every number of `WANTED` for one method. A mean time is nan unless all trials were completed."""
    of = {name: results.of(name, method=method) for name in results.trials}
    ten, quick = of["exp1"], of["quick_robot"]
    paper = [result for name in ("exp1", "exp1a", "exp1_random", "exp2", "one_temi") for result in of[name]]
    every = [result for these in of.values() for result in these]
    return {
        "exp1": _mean_time(ten), "exp1a": _mean_time(of["exp1a"]), "random": _mean_time(of["exp1_random"]),
        "four": _over_exp1(of["exp2"]), "one": _over_exp1(of["one_temi"]),
        "closing": float(np.mean([result["mean_closing_base_speed_mps"] or 0.0 for result in ten])),
        "quick": _mean_time(quick, lambda result: result["time_s"] / result["reference_tour_s"]),
        "further": _completed(of["further_scenes"]), "generated": _completed(of["generated"]),
        "paper": _completed(paper), "contacts": float(sum(map(_hits, every))),
    }  # fmt: skip


def parts(results: Results, method: str) -> dict[str, dict[str, float]]:
    """Time by part and smoothness of each experiment: means of the completed trials, largest of the largest.

    Seconds by `measures.PARTS`; path and reference tour [m]; acceleration of the arm's foot [m/s^2]; changes of
    turning per metre.
    """
    found = {}
    for name in results.trials:
        done = [each["measures"] | {"path": each["path_length_m"]} for each in results.of(name, method=method)
                if each["success"] and each.get("measures")]  # fmt: skip
        if not done:
            continue
        felt = [each["arm_base_acceleration_mps2"] for each in done]
        found[name] = {
            **{part: float(np.mean([each["parts_s"][part] for each in done])) for part in PARTS},
            "path_m": float(np.mean([each["path"] for each in done])),
            "reference_m": float(np.mean([sum(leg["reference_m"] or 0.0 for leg in each["legs"]) for each in done])),
            "felt_p99": float(np.mean([each["p99"] for each in felt])),
            "felt_max": float(max(each["max"] for each in felt)),
            "turns_per_m": float(np.mean([each["yaw_sign_changes_per_m"] for each in done])),
        }
    return found


def parts_table(spent: dict[str, dict[str, dict[str, float]]]) -> Table:
    """`parts` of every method, a row for each experiment."""
    names = [*(part.replace("_", " ") for part in PARTS), "path m", "tour m", "m/s2 p99", "max", "turns/m"]
    texts = ("mean seconds of", "method")
    table = grid(*texts, *names, texts=texts)
    for method, by_experiment in spent.items():
        for name, values_ in by_experiment.items():
            *seconds, felt_p99, felt_max, turns = values_.values()
            table.add_row(
                name, method, *(f"{value:.1f}" for value in seconds), f"{felt_p99:.2f}", f"{felt_max:.2f}",
                f"{turns:.2f}",
            )  # fmt: skip
    return table


def _over_exp1(results: Iterable[Result]) -> float:
    """Additional time [%] of the trials with Temis against those without, paired by seed."""
    times: dict[str, dict[int, float]] = {"exp1": {}, "exp2": {}}
    for result in results:
        if not result["success"]:
            return NAN
        times[result["scene"]][result["seed"]] = result["time_s"]
    return 100.0 * paired_ratio(times["exp2"], times["exp1"]).value


def _hits(result: Result) -> int:
    """Contacts that count: in Experiment 2 those that the robot drove into, elsewhere every one."""
    return drove_into([result]) if result["scene"] == "exp2" else len(result["contacts"])


def _completed(results: list[Result]) -> float:
    return 100.0 * sum(result["success"] for result in results) / len(results)


def _without_success(results: Results, method: str) -> list[Result]:
    """Failed trials, each once: the arrangements of Experiment 1 are in several experiments."""
    found = {
        (result["scene"], result["variant"], result["seed"]): result
        for name in results.trials
        for result in results.of(name, method=method)
        if not result["success"]
    }
    return list(found.values())
