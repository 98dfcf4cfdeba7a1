"""Fault bench: each kind of fault in the paper's experiments, injected where it matters, and its effect.

The robot must cause no contact, find the cause within a second, and resume work when the fault ends.
"""

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import joblib
import msgspec
import numpy as np
from rich.console import Console

from motm_twin.completion import Completion
from motm_twin.control.arm.types import Phase
from motm_twin.control.tick import Tick
from motm_twin.methods.registry import FAST, find_method
from motm_twin.model.edits import InjectFault
from motm_twin.model.faults import KINDS
from motm_twin.model.geometry import from_frame
from motm_twin.model.scene_file import load_scene
from motm_twin.perf.report import Sheet, machine, write_report
from motm_twin.twin import Twin

NAME = "faults"
TITLE = "Faults of sensors and robot: contacts, the cause, and whether the work goes on"
SCENES = {"exp1": "random", "exp1a": "random", "exp2": "random"}
SEEDS = 10
LASTS = 4.0  # [s]
AFTER = LASTS + 3.0  # [s] from a fault in which findings are of it, and no other begins
TIMES = (6.0, 26.0, 46.0)  # [s] from which a fault is injected, as soon as it matters
WITHIN = 1.0  # [s] in which its cause must be found
SPEEDS_UP = (0.3, 1.0)  # [m/s^2], [rad/s^2] of a base whose lag can be noticed: plans turn for a period with 0.9
WITH_NAMES = ("camera_swap",)  # means nothing to a camera that does not name what it sees
NONE = "none"  # the same trials without a fault
CAUSES: dict[str, tuple[str, ...]] = {  # kinds of findings that name a fault
    "lidar_off": ("scan_old",),
    "lidar_frozen": ("scan_frozen",),
    "lidar_blind": ("scan_blind",),
    "lidar_sector": ("scan_sector", "scan_blind"),
    "lidar_nan": ("scan_bad",),
    "lidar_noise": ("scan_noisy",),
    "lidar_delay": ("scan_old", "scan_bad"),
    "camera_off": ("camera_lost",),
    "camera_delay": ("camera_late",),
    "camera_ghost": ("camera_ghost", "camera_twice", "camera_unknown"),
    "camera_swap": ("camera_swap",),
    "camera_lost": ("camera_lost",),
    "pose_jump": ("pose_off", "pose_lost"),
    "pose_drift": ("pose_off", "pose_lost"),
    "odometry_jump": ("odometry_off",),
    "wheel_slip": ("slip",),
    "base_lag": ("base_late", "base_stuck"),
    "base_stuck": ("base_stuck", "base_late"),
    "joint_stuck": ("joint_stuck",),
    "gripper_stuck": ("fingers_stuck",),
    "state_delay": ("state_old",),
}


def _drives(tick: Tick) -> bool:
    return abs(float(tick.observation.twist[0])) > 0.25


def _looks(tick: Tick) -> bool:
    """The camera sees what the hand comes for."""
    if tick.task_index >= len(tick.tasks) or tick.arm[-1].phase not in (Phase.TRANSIT, Phase.FINAL):
        return False
    task = tick.tasks[tick.task_index]
    return task.kind == "pick" and any(one.name == task.target for one in tick.observation.detections)


def _sees_furniture(tick: Tick) -> bool:
    """Mapped furniture returns over a good part of what lies ahead."""
    scan = tick.observation.scan
    if scan is None or not _drives(tick):
        return False
    angles = scan.angle_min + scan.angle_step * np.arange(len(scan.ranges))
    ahead = np.abs(angles) < 0.25 * math.pi
    near = ahead & (scan.ranges < 5.0)
    points = scan.ranges[near, None] * np.column_stack([np.cos(angles[near]), np.sin(angles[near])]) + scan.origin
    points, others = from_frame(scan.pose, points), tick.map.seen_points
    mapped = [not len(others) or np.hypot(*(others - point).T).min() > 0.3 for point in points]
    return sum(mapped) > 0.2 * int(ahead.sum())


NOTICEABLE: dict[str, Callable[[Tick], bool]] = {
    "joint_stuck": lambda tick: abs(float(tick.observation.dq[3])) > 0.2 and _drives(tick),
    "base_lag": lambda tick: bool((np.abs(tick.plan.acceleration) > SPEEDS_UP).any()) and _drives(tick),
    "gripper_stuck": lambda tick: tick.arm[-1].phase == Phase.FINAL,
    "lidar_sector": _sees_furniture,
    **{name: _looks for name, kind in KINDS.items() if kind.group == "camera"},
}


def noticeable(kind: str) -> Callable[[Tick], bool]:
    """Condition in which a fault of this kind can be noticed: the base drives, the camera looks, the hand reaches."""
    return NOTICEABLE.get(kind, _drives)


@dataclass
class Injection:
    """Findings after one injection."""

    at: float  # [s] of it; of stuck fingers the next command to them: before it nothing can show
    named: float | None = None  # [s] after that
    shown: str = ""  # sentence of that period
    fingers: str = ""  # their command then, until another one comes


@dataclass
class Watch:
    """Injects the fault of a trial, and watches what is found."""

    kind: str
    due: list[float] = field(default_factory=lambda: list(TIMES))
    seen: list[Injection] = field(default_factory=list)
    false: dict[str, int] = field(default_factory=dict)  # findings while nothing was wrong: periods

    def next_edit(self, tick: Tick) -> InjectFault | None:
        """The fault, when its time has come and it matters."""
        lasts = bool(self.seen) and tick.time <= self.seen[-1].at + AFTER
        if self.kind == NONE or lasts or not self.due or tick.time < self.due[0] or not noticeable(self.kind)(tick):
            return None
        self.due.pop(0)
        fingers = tick.arm[-1].actuation.gripper if self.kind == "gripper_stuck" else ""
        self.seen.append(Injection(at=tick.time, fingers=fingers))
        return InjectFault(fault=self.kind, seconds=LASTS)

    def look(self, tick: Tick, kinds: Iterable[str]) -> None:
        """Note the robot's findings of this period."""
        now = set(kinds)
        last = self.seen[-1] if self.seen else None
        lasts = last is not None and tick.time <= last.at + AFTER
        if last is not None and last.fingers not in ("", tick.arm[-1].actuation.gripper):
            last.at, last.fingers = tick.time, ""
        if last is not None and lasts and last.named is None and now & set(CAUSES[self.kind]):
            last.named, last.shown = tick.time - last.at, tick.stop_reason
        for kind in now if not lasts else ():
            self.false[kind] = self.false.get(kind, 0) + 1


def run_trial(scene: str, kind: str, seed: int, method: str = FAST.name) -> dict[str, Any]:
    """One trial with a fault."""
    loaded = load_scene(scene, SCENES.get(scene), seed)
    if kind in WITH_NAMES:
        loaded = msgspec.structs.replace(loaded, detections="named")
    twin, watch = Twin(loaded, method=find_method(method)), Watch(kind)
    edit: InjectFault | None = None
    finish = Completion()
    while True:
        if edit is not None:
            twin.post(edit)
        tick = twin.advance()
        watch.look(tick, (one.kind for one in twin.loop.self_check.findings))
        finish.add(tick)
        if finish.over or tick.time >= loaded.time_limit:
            break
        edit = watch.next_edit(tick)
    return _result(watch, twin, tick, scene, kind, seed, method)


def _result(watch: Watch, twin: Twin, tick: Tick, scene: str, kind: str, seed: int, method: str) -> dict[str, Any]:
    truth = tick.truth
    assert truth is not None
    caused = [contact for contact in truth.contacts if contact.caused_by_robot]
    places = sum(task.kind == "place" for task in tick.tasks)
    return {
        "scene": scene, "kind": kind, "seed": seed, "method": method,
        "success": bool(tick.success and truth.places == places), "placed": truth.places, "places": places,
        "time_s": round(tick.time, 2), "contacts": len(truth.contacts), "dropped": list(truth.dropped),
        "caused": [f"{one.body} {one.other} {one.time:.2f} s {one.depth:.3f} m" for one in caused],
        "injected": [round(one.at, 2) for one in watch.seen],
        "named_s": [None if one is None else round(one, 2) for one in (each.named for each in watch.seen)],
        "shown": [one.shown for one in watch.seen],
        "false": dict(sorted(watch.false.items())),
        "reason": "" if tick.success else (tick.stop_reason or "; ".join(twin.loop.sequence.failures)),
    }  # fmt: skip


def bench_faults(
    out: Path, share: float, workers: int, console: Console, *, kinds: Iterable[str] = (), scenes: Iterable[str] = ()
) -> bool:
    """Run, print, write ``out/faults.json``; True when nothing was hit, every cause was found in time and all was done.

    ``share`` of ten seeds; only these ``kinds`` and ``scenes`` when any are named.
    """
    console.print(f"\n[bold]{NAME}[/bold]: {TITLE}")
    seeds = range(math.ceil(SEEDS * share))
    chosen, places = list(kinds) or [NONE, *KINDS], list(scenes) or list(SCENES)
    cells = [(scene, kind, seed) for seed in seeds for kind in chosen for scene in places]
    run: Any = joblib.Parallel(n_jobs=workers, return_as="generator_unordered")
    results: list[dict[str, Any]] = []
    for one in run(joblib.delayed(run_trial)(*cell) for cell in cells):
        results.append(one)
        if not good(one):
            console.print(f"  {failure_line(one)}", style="yellow", markup=False)
        results.sort(key=lambda one: (chosen.index(one["kind"]), places.index(one["scene"]), one["seed"]))
        whole = len(results) == len(cells)  # a bench that takes hours may be stopped: what is there so far is written
        write_report(out, NAME, TITLE, whole=whole, reached=whole and all(map(good, results)), trials=results)
        SHEET.write(out / f"{NAME}.md", rows_of(results))
    console.print(SHEET.table(rows_of(results), title=f"each {LASTS:g} s long, up to {len(TIMES)} times a trial"))
    console.print(f"{machine()}, {workers} processes; written to {out / f'{NAME}.json'} and {NAME}.md")
    return all(map(good, results))


def good(one: dict[str, Any]) -> bool:
    """Nothing was hit, every cause was found in time, and all was done."""
    return bool(one["success"]) and not one["caused"] and not one["dropped"] and all(map(in_time, one["named_s"]))


def in_time(delay: float | None) -> bool:
    """The cause was found within a second."""
    return delay is not None and delay <= WITHIN + 1e-6


def failure_line(one: dict[str, Any]) -> str:
    """A trial that was not good, in one line."""
    where = f"{one['scene']} seed {one['seed']} {one['kind']}: {one['placed']}/{one['places']} in {one['time_s']} s"
    caused = f"; {'; '.join(one['caused'])}" if one["caused"] else ""
    return f"{where}, named after {one['named_s']} s{caused}{'; ' + one['reason'] if one['reason'] else ''}"


HEAD = ("fault", "trials", "done", "placed", "contacts", "caused", "named in time", "slowest", "false", "time")
SHEET = Sheet(head=HEAD, texts=("fault", "false"), cells=tuple)


def rows_of(results: list[dict[str, Any]]) -> list[tuple[str, ...]]:
    """One row of text for each kind."""
    rows = []
    for kind in dict.fromkeys(one["kind"] for one in results):
        these = [one for one in results if one["kind"] == kind]
        named = [delay for one in these for delay in one["named_s"]]
        times = [one["time_s"] for one in these if one["success"]]
        placed, places, done, contacts = (
            sum(one[key] for one in these) for key in ("placed", "places", "success", "contacts")
        )
        slowest = max((delay for delay in named if delay is not None), default=math.nan)
        rows.append((
            kind, str(len(these)), str(done), f"{placed}/{places}", str(contacts),
            str(sum(len(one["caused"]) for one in these)),
            f"{sum(map(in_time, named))}/{len(named)}" if named else "", f"{slowest:.2f} s" if named else "",
            ", ".join(sorted({key for one in these for key in one["false"]})),
            f"{sum(times) / len(times):.1f} s" if times else "",
        ))  # fmt: skip
    return rows
