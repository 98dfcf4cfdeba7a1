"""Sensitivity: Experiment 1 in other settings, and with every number of ours halved and doubled.

A row of a study is a setting of the scene on one plant: grasps on the move under contact dynamics, by closing time, by
grasp rule, and mismatch; all rows have the same arrangements. A row of the screening is a number with another value, or
a switch flipped, on the same seeds of Experiments 1 and 2: a number that changes no run must be justified by a test, or
is removed with its code. Trials are those of an experiment (`studies.run`), stored on disk and resumed after Ctrl-C.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
import numpy as np
from rich.console import Console

from motm_twin.control.tuning import tuned
from motm_twin.methods.registry import FAST, MOTM
from motm_twin.model.number import Found, numbers_of, replaced
from motm_twin.perf.report import Sheet, machine, number, plain, write_report
from motm_twin.plants import MUJOCO, PLANTS
from motm_twin.studies import statistics
from motm_twin.studies.catalogue import MISMATCHES, SHAKEN
from motm_twin.studies.run import Result, Results, run_or_stop
from motm_twin.studies.spec import Experiment, TrialSpec
from motm_twin.studies.statistics import completed, drove_into, touches

SCENE, PUBLISHED = "exp1", 10
METHODS = (FAST.name, MOTM.name)
SIMULATED = PLANTS[0]
ALONE, TOGETHER = 0.99, 0.95  # share of the cubes that must be placed with one error, and with all of them
HEAD = (
    "setting", "plant", "method", "trials", "placed", "placed %", "grasps", "held %", "contacts", "caused",
    "mean time s", "base m/s closing", "shift mm", "over 10, 20 Nm", "peak Nm",
)  # fmt: skip


class Setting(NamedTuple):
    """Trials of a row."""

    name: str
    changes: Mapping[str, Any]
    plant: str = MUJOCO
    least: float = 0.0  # share of the cubes that must be placed


@dataclass(frozen=True, kw_only=True)
class Study:
    """Settings that are compared; ``together``: all methods in one row."""

    name: str
    title: str
    settings: tuple[Setting, ...]
    methods: tuple[str, ...] = METHODS
    together: bool = False
    random: bool = False  # random arrangements instead of the published ones
    touches: bool = False  # contacts caused by the robot are no failures
    minutes: int = 0  # approximate duration on two cores


ERRORS: Mapping[str, Mapping[str, float]] = {
    "pad friction 0.4": {"physics.pad_friction": 0.4},
    "grip force 20 N": {"physics.grip_force": 20.0},
    "objects of 150 g": {"physics.object_mass": 0.15},
    "arm lag 50 ms": {"mismatch.arm_lag": 0.05},  # plus 10 ms in its profile
    "base 7 % slow": {"mismatch.base_scale": -0.07},
    "hand-eye 8 mm": {"mismatch.hand_eye": 0.008},
    "gripper 0.25 s late": {"physics.closing_delay": 0.25},
}
_ALL = {name: value for changes in ERRORS.values() for name, value in changes.items()}
ROBUSTNESS = Study(
    name="physics_robustness",
    title="Experiment 1 under contact dynamics, with what the robot is not told: each alone, and all together",
    settings=(
        Setting("none", {}, least=ALONE),
        *(Setting(name, changes, least=ALONE) for name, changes in ERRORS.items()),
        Setting("all together", _ALL, least=TOGETHER),
    ),
    together=True,
    minutes=45,
)
CLOSING_TIMES = (0.2, 0.4, 0.6, 0.8)  # [s]
QUICK_GRIPPER = Study(
    name="quick_gripper",
    title="Experiment 1 with fingers that close in 0.2 to 0.8 s, kinematic and under contact dynamics",
    settings=tuple(
        Setting(f"closing {time:g} s", {"robot.gripper.closing_time": time}, plant, ALONE)
        for plant in PLANTS
        for time in CLOSING_TIMES
    ),
    minutes=30,
)
GRASP_SPEEDS = (0.03, 0.015, 0.01)  # [m/s]
SENSITIVITY = Study(
    name="grasp_sensitivity",
    title="Experiment 1 by grasp rule: strict beyond 30, 15 and 10 mm/s, swept, and contact dynamics",
    settings=(
        *(
            Setting(f"strict {1e3 * speed:g} mm/s", {"grasp_rule": "strict", "grasp_speed": speed}, SIMULATED)
            for speed in GRASP_SPEEDS
        ),
        Setting("swept", {}, SIMULATED, ALONE),
        Setting("contact dynamics", {}, least=ALONE),
    ),
    minutes=15,
)
BUMPS = (  # 10 mm high, across the paths to the table, to its other side and along it
    {"name": "on_the_way", "centre": (1.6, 1.5), "length": 2.5, "yaw": 0.5 * math.pi},
    {"name": "in_front", "centre": (3.4, 0.7), "length": 1.2, "yaw": 0.5 * math.pi},
    {"name": "behind", "centre": (4.2, 2.8), "length": 1.0, "yaw": 0.5 * math.pi},
)
FLOOR = Study(
    name="floor_bumps",
    title="Experiment 1 under contact dynamics on a level floor, and over three bumps of 5 and 10 mm",
    settings=(
        Setting("level floor", {}, least=ALONE),
        *(Setting(f"bumps of {1e3 * h:g} mm", {"bumps": [{**one, "height": h} for one in BUMPS]})
          for h in (0.005, 0.01)),
    ),
    minutes=15,
)  # fmt: skip
MISMATCH = Study(
    name="mismatch",
    title="What robot and world do otherwise than the robot is told, and the usual noise: Experiment 1",
    settings=tuple(
        Setting(name, changes, SIMULATED, 0.0 if name == SHAKEN else 59 / 60) for name, changes in MISMATCHES.items()
    ),
    methods=METHODS[:1],
    random=True,
    touches=True,
    minutes=20,
)
STUDIES = {study.name: study for study in (ROBUSTNESS, QUICK_GRIPPER, SENSITIVITY, FLOOR, MISMATCH)}


def bench_study(study: Study, out: Path, share: float, workers: int, console: Console) -> bool:
    """Run, print, write ``out/<study>.json`` and ``.md``; True when every row places its share.

    ``share`` of the ten arrangements.
    """
    console.print(f"\n[bold]{study.name}[/bold]: {study.title}")
    chosen = experiment_of(study, math.ceil(PUBLISHED * share))
    results = run_or_stop([chosen], out=out / study.name, workers=workers, console=console)
    if results is None:
        return False
    rows = rows_of(study, list(zip(chosen.specs, results.of(study.name), strict=True)))
    console.print(SHEET.table(rows))
    for result in results.of(study.name):
        if not result["success"]:
            what = f"{result['variant']}, {result['method']}, {result['changes'] or 'none'}: {result['reason']}"
            console.print(f"  {what}", style="yellow", markup=False)
    reached = all(map(good, rows))
    write_report(out, study.name, study.title, reached=reached, rows=plain(msgspec.to_builtins(rows)))
    SHEET.write(out / f"{study.name}.md", rows)
    console.print(f"{machine()}, {workers} processes; written to {out / f'{study.name}.json'} and {study.name}.md")
    return reached


def experiment_of(study: Study, trials: int = PUBLISHED) -> Experiment:
    """The trials of a study, arrangement by arrangement, so that an early end still allows a comparison."""
    arrangements = [("random", seed) if study.random else (f"trial{seed + 1}", None) for seed in range(trials)]
    specs = (
        TrialSpec(SCENE, variant, seed, method, changes=dict(one.changes), plant=one.plant)
        for variant, seed in arrangements
        for one in study.settings
        for method in study.methods
    )
    return Experiment(study.name, study.title, tuple(specs))


def rows_of(study: Study, pairs: Sequence[tuple[TrialSpec, Result]]) -> list[dict[str, Any]]:
    """One row for each setting, or for each setting and method, of trials with their results."""
    rows = []
    for one in study.settings:
        for methods in (study.methods,) if study.together else tuple((name,) for name in study.methods):
            row = dict(one.changes), one.plant
            these = [result for spec, result in pairs if (spec.changes, spec.plant) == row and spec.method in methods]
            rows.append({**row_of(one, methods, these), "touches": study.touches})
    return rows


def row_of(one: Setting, methods: Sequence[str], these: Sequence[Result]) -> dict[str, Any]:
    """A row: cubes placed, grasps tried for them, times of completed trials, and measured forces."""
    placed, places = (sum(result[key] for result in these) for key in ("places_done", "places_total"))
    picks, grasps = (sum(result[key] for result in these) for key in ("picks_done", "picks_attempted"))
    closing = [result["mean_closing_base_speed_mps"] for result in these]
    felt = [result["physics"] for result in these if result.get("physics")]
    return {
        "setting": one.name, "plant": one.plant, "method": " + ".join(methods), "trials": len(these), "placed": placed,
        "places": places, "share": statistics.proportion(placed, places) if places else None, "least": one.least,
        "grasps": grasps, "held": statistics.proportion(min(picks, grasps), grasps) if grasps else None,
        "contacts": touches(these), "caused": sum(result["contacts_caused_by_robot"] for result in these),
        "time": statistics.mean(result["time_s"] for result in these if completed(result)),
        "closing": float(np.mean([speed for speed in closing if speed is not None])) if any(closing) else math.nan,
        "shift": [grasp["shift"] for one in felt for grasp in one["grasps"]],
        "phantoms": [sum(one["phantoms"][k] for one in felt) for k in (0, 1)],
        "torque": max((max(one["torque_peaks"]) for one in felt), default=math.nan),
        "wrist": max((one["wrist_peaks"][0] for one in felt), default=math.nan),
    }  # fmt: skip


def good(row: Mapping[str, Any]) -> bool:
    """True when a row places its required share of the cubes, if any, without a contact caused by the robot."""
    caused = row["caused"] and not row.get("touches")
    return not row["least"] or (row["placed"] >= row["least"] * row["places"] > 0 and not caused)


def cells(row: Mapping[str, Any]) -> tuple[str, ...]:
    """A row as texts for the columns of `HEAD`."""
    shift = [1e3 * one for one in row["shift"]]
    percent = {name: "-" if row[name] is None else row[name].text(scale=100.0) for name in ("share", "held")}
    felt = row["plant"] == MUJOCO
    return (
        row["setting"], row["plant"], row["method"], str(row["trials"]), f"{row['placed']}/{row['places']}",
        percent["share"], str(row["grasps"]), percent["held"], str(row["contacts"]), str(row["caused"]),
        row["time"].text(), number(row["closing"], 3), f"{np.median(shift):.1f}, {max(shift):.1f}" if shift else "-",
        "{}, {}".format(*row["phantoms"]) if felt else "-", number(row["torque"], 1),
    )  # fmt: skip


SHEET = Sheet(head=HEAD, texts=HEAD[:3], cells=cells, good=good)


SCREENING = "screening"
SCREENING_TITLE = "Every number of ours halved and doubled: Experiments 1 and 2"
SCREENED = (("exp1", "random"), ("exp2", "random"))
SEEDS = 4  # seeds of each scene
FACTORS = (0.5, 2.0)
SMALL, WHOLE = 0.05, 1  # instead of half and double of 0
NUMBER_HEAD = ("number", "value", "trials", "the same", "time", "placed", "contacts, caused")


class Change(NamedTuple):
    """A number with another value."""

    name: str  # its path in the tree
    value: float | bool


def ours(given: Iterable[str] = ()) -> list[Found]:
    """Numbers of ours, only with ``given`` paths or groups if there are any. Raises ValueError for an unknown one."""
    found = [each for each in numbers_of(tuned(FAST.parameters)) if each.ours and not isinstance(each.default, str)]
    for name in given:
        if not any(_within(each, name) for each in found):
            raise ValueError(f"no number or group of numbers of ours is called {name!r}: docs/parameters.md lists all")
    return [each for each in found if not given or any(_within(each, name) for name in given)]


def _within(found: Found, name: str) -> bool:
    path = name.split(".")
    return list(found.path[: len(path)]) == path


def changes_of(found: Found) -> list[Change]:
    """The other values of a number, without those that its parameter class refuses."""
    value = found.default
    if isinstance(value, bool):
        others: list[float | bool] = [not value]
    elif value == 0:
        others = [WHOLE if isinstance(value, int) else SMALL]
    elif isinstance(value, int):
        others = [max(1, round(factor * value)) for factor in FACTORS]
    else:
        others = [factor * value for factor in FACTORS]
    return [Change(".".join(found.path), other) for other in others if other != value and _possible(found, other)]


def _possible(found: Found, value: float | bool) -> bool:
    try:
        replaced(tuned(FAST.parameters), found.path, value)
    except ValueError:
        return False
    return True


def screening_specs(changes: Iterable[Change], seeds: int) -> Iterable[TrialSpec]:
    """The trials: first without a change, then each change on the same scenes and seeds."""
    for change in (None, *changes):
        numbers = {} if change is None else {change.name: change.value}
        for scene, variant in SCREENED:
            for seed in range(seeds):
                yield TrialSpec(scene, variant, seed, FAST.name, numbers=numbers)


def bench_screening(out: Path, share: float, workers: int, console: Console, given: Sequence[str] = ()) -> bool:
    """Run, print, write ``out/screening.json`` and ``.md``; True when all trials have run.

    ``share`` of four seeds of each scene; ``given``: only these numbers, or groups of them. About 5,700 trials for all.
    """
    console.print(f"\n[bold]{SCREENING}[/bold]: {SCREENING_TITLE}")
    try:
        found = ours(given)
    except ValueError as error:
        console.print(f"  {error}", style="red", markup=False)
        return False
    changes = [change for each in found for change in changes_of(each)]
    chosen = Experiment(SCREENING, SCREENING_TITLE, tuple(screening_specs(changes, math.ceil(SEEDS * share))))
    results = run_or_stop([chosen], out=out / SCREENING, workers=workers, console=console)
    if results is None:
        return False
    rows = number_rows(results, changes)
    console.print(NUMBER_SHEET.table(rows))
    NUMBER_SHEET.write(out / f"{SCREENING}.md", rows)
    target = write_report(out, SCREENING, SCREENING_TITLE, reached=True, rows=rows)
    console.print(f"{machine()}, {workers} processes; written to {target} and {SCREENING}.md")
    return True


def number_rows(results: Results, changes: Iterable[Change]) -> list[dict[str, Any]]:
    """A row for each change against the runs without it. The change of time is over trials that both complete."""
    shipped = {(each["scene"], each["seed"]): each for each in results.of(SCREENING, numbers={})}
    rows = [_row(Change(SHIPPED, 1.0), list(shipped.values()), shipped)]
    for change in changes:
        rows.append(_row(change, results.of(SCREENING, numbers={change.name: change.value}), shipped))
    return rows


def _row(change: Change, these: list[Result], shipped: dict[tuple[str, int], Result]) -> dict[str, Any]:
    both = [(each, shipped[each["scene"], each["seed"]]) for each in these]
    done = [(one, other) for one, other in both if one["success"] and other["success"]]
    slower = statistics.mean([one["time_s"] - other["time_s"] for one, other in done])
    return {
        "number": change.name, "value": change.value, "trials": len(these),
        "same": sum(one["state_hash"] == other["state_hash"] for one, other in both),
        "slower_s": slower.value, "slower_low_s": slower.low, "slower_high_s": slower.high,
        "placed": sum(each["places_done"] for each in these), "places": sum(each["places_total"] for each in these),
        "contacts": touches(these), "caused": drove_into(these),
    }  # fmt: skip


def number_cells(row: dict[str, Any]) -> tuple[str, ...]:
    """A row as texts for the columns of `NUMBER_HEAD`."""
    slower = f"{row['slower_s']:+.1f}"
    if math.isfinite(row["slower_low_s"]):
        slower += f" [{row['slower_low_s']:+.1f}, {row['slower_high_s']:+.1f}]"
    value = row["value"] if isinstance(row["value"], bool) else f"{row['value']:.4g}"
    return (
        f"`{row['number']}`", str(value), str(row["trials"]), str(row["same"]), f"{slower} s",
        f"{row['placed']}/{row['places']}", f"{row['contacts']}, {row['caused']}",
    )  # fmt: skip


SHIPPED = "as shipped"
NUMBER_SHEET = Sheet(  # numbers that changed no run are yellow
    head=NUMBER_HEAD,
    texts=NUMBER_HEAD[:1],
    cells=number_cells,
    good=lambda row: row["number"] == SHIPPED or row["same"] < row["trials"],
)
