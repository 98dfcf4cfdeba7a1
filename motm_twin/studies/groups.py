"""Groups of trials with numbers to reach: the trials, how they are run, and their tables."""

import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from rich.console import Console

from motm_twin.external.robot import LinkSpec
from motm_twin.perf.report import Limit, Sheet, goal_table, machine, number, write_report
from motm_twin.plants import PLANTS
from motm_twin.studies.pool import Lost, local_pool, outcomes
from motm_twin.studies.spec import TrialSpec, broken, job_of, run_job

Result = dict[str, Any]  # of one trial: what `motm-twin run --json` prints
Measure = Callable[[list[Result]], float]
APPROACH = 0.02  # [m/s] approach speed of a contact point that counts as driving into the other


class Trial(TrialSpec, frozen=True, kw_only=True):
    """One run, and how it is made otherwise."""

    link: LinkSpec | None = None  # the robot in another process, behind this link, on a shared clock
    beside: bool = False  # run on the kinematic plant, too


@dataclass(frozen=True, kw_only=True)
class Goal(Limit):
    """A number to reach, and how it is taken from the results of a group."""

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
        """The same trials with another plant, beside those that have none of their own."""
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


def _mean_time(results: list[Result]) -> float:
    """Mean time [s] over completed trials only when all are: a trial that gave up early is not fast."""
    return _mean_of("time_s")(results) if all(result["success"] for result in results) else NAN


def _mean_time_by(key: str) -> Measure:
    """Mean time as a share of the mean time of the same trials otherwise; nan unless all end."""
    return lambda results: _mean_time(results) / _mean_of(key)(results)


def _first_time(results: list[Result]) -> float:
    return next((one["time_s"] for one in results if one["variant"] == "trial1" and one["success"]), NAN)


def _disagreements(results: list[Result]) -> int:
    """Contacts that the referee's geometry has and the forces have not, and the reverse."""
    return sum(len(result["physics"]["disagreements"]) for result in results if "physics" in result)


def touches(results: Iterable[Result]) -> int:
    """All contacts, whoever caused them."""
    return sum(len(result["contacts"]) for result in results)


def caused(results: list[Result]) -> int:
    """Contacts that the robot caused."""
    return sum(hit["caused_by_robot"] for result in results for hit in result["contacts"])


def drove_into(results: list[Result]) -> int:
    """Contacts in which our robot was moving into the other."""
    hits = (contact for result in results for contact in result["contacts"])
    return sum(hit["caused_by_robot"] or hit["closing_speed"] > APPROACH for hit in hits)


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
    """Over all trials but the first, which may have compiled kernels."""
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
        goals=tuple(goal for goal in _done(60) if goal.name != "picked"),  # what it loses it picks again
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
    """Results in the order of the trials, each as soon as it and those before it are done."""
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
    except Exception as error:  # of the robot in another process; the others are still worth a table
        return failed(trial, f"{type(error).__name__}: {error}")


def failed(trial: Trial, reason: str) -> Result:
    """The result of a trial that gave none."""
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
