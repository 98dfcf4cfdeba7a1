"""Experiment 1 in other settings: grasps on the move under contact dynamics, by closing time, by grasp rule; mismatch.

A row of each study is a setting of the scene on one plant; all rows have the same arrangements. Trials are an
experiment's (`studies.run`), kept on disk and resumed after Ctrl-C.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
import numpy as np
from rich.console import Console

from motm_twin.methods.registry import FAST, MOTM
from motm_twin.perf.report import Sheet, machine, number, plain, write_report
from motm_twin.plants import MUJOCO, PLANTS
from motm_twin.studies import statistics
from motm_twin.studies.catalogue import MISMATCHES, SHAKEN
from motm_twin.studies.groups import touches
from motm_twin.studies.run import Result, run_or_stop
from motm_twin.studies.spec import Experiment, TrialSpec
from motm_twin.studies.summary import completed

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
    touches: bool = False  # a contact that the robot caused is no failure
    minutes: int = 0  # about, on two cores


ERRORS: Mapping[str, Mapping[str, float]] = {
    "pad friction 0.4": {"physics.pad_friction": 0.4},
    "grip force 20 N": {"physics.grip_force": 20.0},
    "objects of 150 g": {"physics.object_mass": 0.15},
    "arm lag 50 ms": {"mismatch.arm_lag": 0.05},  # 10 ms are in its profile
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
BUMPS = (  # of 10 mm, where the way to the table, to its other side and along it crosses them
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
    """Run, print, write ``out/<study>.json`` and ``.md``; True when every row places what it must.

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
    """The trials of a study: all settings of one arrangement, then the next, so that an early end compares."""
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
    """A row: cubes placed, grasps tried for them, times of completed trials, and what was felt."""
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
    """A row places its share of the cubes without a contact that the robot caused, if it has a share to reach."""
    caused = row["caused"] and not row.get("touches")
    return not row["least"] or (row["placed"] >= row["least"] * row["places"] > 0 and not caused)


def cells(row: Mapping[str, Any]) -> tuple[str, ...]:
    """A row as the texts of `HEAD`."""
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
