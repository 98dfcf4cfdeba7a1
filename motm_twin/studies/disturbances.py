"""Disturbances of a run and their effect: faults of sensors and robot, and bodies put in the robot's way.

Faults of each kind are injected into the paper's experiments, where they matter. The robot must cause no contact, find
the cause within a second, and resume work when the fault ends.

Bodies are put before the moving base, onto its goal, and onto its hand. On contact the base brakes fully, and then
only moves out of the overlap; it does not circle round an occupied goal; and the arm moves no further into an
obstacle that it overlaps.
"""

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import joblib
import msgspec
import numpy as np
from rich.console import Console
from rich.table import Table

from motm_twin.control.arm.types import Phase
from motm_twin.control.targets import world_in_odometry
from motm_twin.control.tick import Completion, Tick
from motm_twin.methods.registry import FAST, find_method
from motm_twin.model.edits import AddObstacle, InjectFault, RemoveBody
from motm_twin.model.faults import KINDS
from motm_twin.model.geometry import from_frame, to_frame
from motm_twin.model.scene import DriveTo, Scene
from motm_twin.model.scene_file import load_scene
from motm_twin.perf.report import Sheet, grid, machine, write_report
from motm_twin.sessions.session import SOURCE, made_with
from motm_twin.twin import Twin

NAME = "faults"
TITLE = "Faults of sensors and robot: contacts, the cause, and whether the work goes on"
SCENES = {"exp1": "random", "exp1a": "random", "exp2": "random"}
SEEDS = 10
LASTS = 4.0  # [s] duration of a fault
AFTER = LASTS + 3.0  # [s] from a fault on in which findings count as due to it, and no other begins
TIMES = (6.0, 26.0, 46.0)  # [s] from which the next fault is injected, as soon as it matters
WITHIN = 1.0  # [s] within which its cause must be found
SPEEDS_UP = (0.3, 1.0)  # [m/s^2], [rad/s^2] that reveal a base's lag: plans turn with 0.9 for single periods
WITH_NAMES = ("camera_swap",)  # faults that need a camera with named detections
NONE = "none"  # the same trials without a fault
CAUSES: dict[str, tuple[str, ...]] = {  # kinds of findings that name a fault
    "lidar_off": ("scan_old",),
    "lidar_frozen": ("scan_frozen",),
    "lidar_blind": ("scan_blind",),
    "lidar_sector": ("scan_sector", "scan_blind"),
    "lidar_nan": ("scan_bad",),
    "lidar_noise": ("scan_noisy",),
    "lidar_delay": ("scan_old", "scan_bad"),
    "camera_off": ("camera_late",),
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
    """True when the camera sees the object that the hand approaches."""
    if tick.task_index >= len(tick.tasks) or tick.arm[-1].phase not in (Phase.TRANSIT, Phase.FINAL):
        return False
    task = tick.tasks[tick.task_index]
    return task.kind == "pick" and any(one.name == task.target for one in tick.observation.detections)


def _sees_furniture(tick: Tick) -> bool:
    """True when a good part of the beams ahead hits mapped furniture."""
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

    at: float  # [s] of the injection; for stuck fingers of their next command, before which nothing shows
    named: float | None = None  # [s] after that: the cause was found
    shown: str = ""  # sentence of that period
    fingers: str = ""  # command of stuck fingers at the injection, until it changes


@dataclass
class Watch:
    """Injects the fault of a trial, and collects the robot's findings."""

    kind: str
    due: list[float] = field(default_factory=lambda: list(TIMES))
    seen: list[Injection] = field(default_factory=list)
    false: dict[str, int] = field(default_factory=dict)  # false finding: number of periods

    def next_edit(self, tick: Tick) -> InjectFault | None:
        """The fault, when it is due and matters; else None."""
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

    ``share`` of ten seeds; only these ``kinds`` and ``scenes`` if any are named. Trials that were run by the same
    source are taken from that file.
    """
    console.print(f"\n[bold]{NAME}[/bold]: {TITLE}")
    seeds = range(math.ceil(SEEDS * share))
    chosen, places = list(kinds) or [NONE, *KINDS], list(scenes) or list(SCENES)
    cells = [(scene, kind, seed) for seed in seeds for kind in chosen for scene in places]
    source = made_with()[SOURCE]
    before = _known(out / f"{NAME}.json", source)
    results = [one for one in before if _cell(one) in cells]
    others, known = [one for one in before if _cell(one) not in cells], {_cell(one) for one in results}
    if known:
        console.print(f"  {len(known)} of {len(cells)} trials are known")
    run: Any = joblib.Parallel(n_jobs=workers, return_as="generator_unordered")
    for one in run(joblib.delayed(run_trial)(*cell) for cell in cells if cell not in known):
        results.append(one)
        if not good(one):
            console.print(f"  {failure_line(one)}", style="yellow", markup=False)
        results.sort(key=lambda one: (chosen.index(one["kind"]), places.index(one["scene"]), one["seed"]))
        whole = len(results) == len(cells)  # a bench that takes hours may be stopped: results so far are written
        reached = whole and all(map(good, results))
        write_report(out, NAME, TITLE, whole=whole, reached=reached, source=source, trials=results + others)
        SHEET.write(out / f"{NAME}.md", rows_of(results))
    console.print(SHEET.table(rows_of(results), title=f"each {LASTS:g} s long, up to {len(TIMES)} times a trial"))
    console.print(f"{machine()}, {workers} processes; written to {out / f'{NAME}.json'} and {NAME}.md")
    return all(map(good, results))


def _known(file: Path, source: str) -> list[dict[str, Any]]:
    """Trials in an earlier report, if the same source ran them."""
    if not file.is_file():
        return []
    report = msgspec.json.decode(file.read_bytes(), type=dict[str, Any])
    return list(report["trials"]) if report.get("source") == source else []


def _cell(one: dict[str, Any]) -> tuple[str, str, int]:
    return one["scene"], one["kind"], one["seed"]


def good(one: dict[str, Any]) -> bool:
    """True when nothing was hit, every cause was found in time, and all tasks were done."""
    return bool(one["success"]) and not one["caused"] and not one["dropped"] and all(map(in_time, one["named_s"]))


def in_time(delay: float | None) -> bool:
    """True when the cause was found within a second."""
    return delay is not None and delay <= WITHIN + 1e-6


def failure_line(one: dict[str, Any]) -> str:
    """A failed trial in one line."""
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


SURPRISE = "surprise"
SURPRISE_TITLE = "Things put before the moving base, onto its goal, and onto its hand"
SCENE = "playground"
METHODS = ("fast", "motm", "staa")
GAPS = (-0.04, 0.0, 0.02, 0.05, 0.10)  # [m] between the front of the base and the box
SPEEDS = (0.1, 0.25, 0.5, 1.0)  # [m/s] of the base
OVER = 0.02  # [m] beyond the stopping distance that the base may travel in contact
REVERSALS = 3  # most reversals before an occupied goal
GOALS = (  # name, shape, size [m]
    ("box 0.3 m", "box", 0.3), ("box 0.5 m", "box", 0.5), ("box 0.8 m", "box", 0.8),
    ("cylinder 0.4 m", "cylinder", 0.4), ("person", "person", 0.0), ("temi", "temi", 0.0),
)  # fmt: skip
PHASES = (Phase.TRANSIT, Phase.FINAL, Phase.LIFT, Phase.CARRY, Phase.RELEASE)
STAYS = 14.0  # [s] for which a box stays on the hand
_PUT_AT = 40  # period in which the base has its speed, unless it is fast
_LAG = 0.05  # [s] one period: a body is seen in the period after it was put
_BOX_LENGTH = 1.5  # [m] along the way: longer than the stopping distance of a fast base
_MOVES = 0.03  # [m/s]
_OUT = 0.6  # [m] from the middle of the base, beyond which the hand is beside it


class Case(NamedTuple):
    """One run."""

    part: str  # before | goal | hand
    method: str
    what: str
    gap: float = 0.0  # [m]
    speed: float = 0.0  # [m/s]
    shape: str = "box"
    size: float = 0.0  # [m]


def cases() -> list[Case]:
    """All runs."""
    return [
        *(Case("before", method, f"{100 * gap:+.0f} cm at {speed:g} m/s", gap=gap, speed=speed)
          for method in METHODS for gap in GAPS for speed in SPEEDS),
        *(Case("goal", method, name, shape=shape, size=size) for method in METHODS[:2] for name, shape, size in GOALS),
        *(Case("hand", method, phase) for method in METHODS[:2] for phase in PHASES),
    ]  # fmt: skip


def run_case(case: Case) -> dict[str, Any]:
    """One run; its result."""
    run: Callable[[Case], dict[str, Any]] = {"before": _before, "goal": _goal, "hand": _hand}[case.part]
    return {"part": case.part, "method": case.method, "what": case.what, **run(case)}


def _open_floor(speed: float, goals: tuple[tuple[float, float], ...], limit: float) -> Scene:
    """Frankie on an empty floor with a ``speed`` limit [m/s], driving to points one after the other."""
    scene = load_scene(SCENE)
    base = scene.robot.base
    base = msgspec.structs.replace(base, forward_speed=speed, reverse_speed=min(base.reverse_speed, speed))
    return msgspec.structs.replace(
        scene,
        robot=msgspec.structs.replace(scene.robot, base=base),
        start=(0.0, 0.0, 0.0),
        solids=(), bins=(), objects=(), agents=(),
        tasks=tuple(DriveTo(point=goal) for goal in goals),
        bounds=(-4.0, -5.0, 12.0, 5.0),
        time_limit=limit,
    )  # fmt: skip


def _before(case: Case) -> dict[str, Any]:
    """Put a box before the driving base: distance [m] that the base goes on in contact, and the allowed distance.

    The arm must not touch itself while it evades.
    """
    scene = _open_floor(case.speed, ((9.0, 0.0),), 120.0)
    base, body = scene.robot.base, scene.robot.footprint
    twin = Twin(scene, method=find_method(case.method))
    start, front, went, put = 0.0, 0.0, 0.0, False
    for tick in twin.ticks():
        assert tick.truth is not None
        x, fast = float(tick.truth.pose[0]), float(tick.observation.twist[0])
        if not put and tick.index >= _PUT_AT and (fast > 0.97 * case.speed or tick.index > 4 * _PUT_AT):
            put, start, front = True, x, x + fast * _LAG + 0.5 * body.length + body.offset_x
            size = (_BOX_LENGTH, 1.2, 1.0)
            twin.post(AddObstacle(name="box", x=front + case.gap + 0.5 * _BOX_LENGTH, y=0.0, size=size))
        for contact in tick.truth.contacts:
            if "base" in contact.bodies and contact.time + contact.duration >= tick.time - 1.01 * _LAG:
                went = max(went, x - start)
    v = case.speed
    allowed = v * v / (2.0 * base.linear_acceleration) + v * (_LAG + base.velocity_lag) + OVER
    assert tick.truth is not None
    itself = [one for one in tick.truth.contacts if one.other.startswith("panda")]
    good = went <= allowed and tick.done and not itself
    return _ended(tick, good=good, finding=f"{went:.3f} of {allowed:.3f} m")


def _goal(case: Case) -> dict[str, Any]:
    """Occupy the goal while the robot drives there: time until it gives up, and number of reversals before."""
    scene = _open_floor(load_scene(SCENE).robot.base.forward_speed, ((3.0, 0.0), (0.0, 1.0)), 60.0)
    twin = Twin(scene, method=find_method(case.method))
    reversals, sign, given_up = 0, 0, math.nan
    for tick in twin.ticks():
        if tick.index == _PUT_AT // 2:
            size = (case.size, case.size, 1.0) if case.size else (0.5, 0.5, 0.6)
            twin.post(AddObstacle(name="taken", shape=case.shape, x=3.0, y=0.0, size=size))
        v = float(tick.observation.twist[0])
        now = 0 if abs(v) < _MOVES else int(math.copysign(1, v))
        if math.isnan(given_up):
            reversals += bool(now and sign and now != sign)
            given_up = tick.time if tick.task_index else math.nan
        sign = now or sign
    good = tick.done and reversals <= REVERSALS and not _caused(tick)
    return _ended(tick, good=good, finding=f"left at {given_up:.1f} s, {reversals} reversals")


def _hand(case: Case) -> dict[str, Any]:
    """Put a box onto the hand for a while in one phase of a trial: contacts that the robot causes."""
    scene = load_scene("exp1", "trial1")
    twin = Twin(scene, method=find_method(case.method))
    put, gone = math.nan, False
    for tick in twin.ticks():
        hand = to_frame(world_in_odometry(tick.observation), tick.arm[-1].reference[:2])
        out = math.dist(hand, tick.observation.pose[:2]) > _OUT
        if math.isnan(put) and tick.arm[-1].phase == case.what and out:
            put = tick.time
            twin.post(AddObstacle(name="box", x=float(hand[0]), y=float(hand[1]), size=(0.3, 0.3, 1.2)))
        elif tick.time > put + STAYS and not gone:
            gone = True
            twin.post(RemoveBody(name="box"))
    return _ended(tick, good=tick.success and not _caused(tick), finding=f"{len(_caused(tick))} caused")


def _caused(tick: Tick) -> list[str]:
    assert tick.truth is not None
    return [
        f"{' '.join(one.bodies)} - {one.other} {one.time:.2f} s" for one in tick.truth.contacts if one.caused_by_robot
    ]


def _ended(tick: Tick, *, good: bool, finding: str) -> dict[str, Any]:
    """Fields that the results of all parts have."""
    return {
        "good": bool(good), "finding": finding, "time_s": round(tick.time, 2), "done": tick.done,
        "success": tick.success, "caused": _caused(tick), "reason": tick.stop_reason,
    }  # fmt: skip


def bench_surprise(out: Path, workers: int, console: Console) -> bool:
    """Run all cases, print the table, write ``out/surprise.json``; True when every one was good."""
    console.print(f"\n[bold]{SURPRISE}[/bold]: {SURPRISE_TITLE}")
    run: Any = joblib.Parallel(n_jobs=workers)
    results = run(joblib.delayed(run_case)(case) for case in cases())
    console.print(table(results))
    good = all(result["good"] for result in results)
    write_report(out, SURPRISE, SURPRISE_TITLE, reached=good, rows=results)
    return good


def table(results: list[dict[str, Any]]) -> Table:
    """A row for each case."""
    names = ("where", "method", "what", "", "ended s", "success", "caused", "said at the end")
    rows = grid(*names, texts=names)
    for result in results:
        rows.add_row(
            result["part"], result["method"], result["what"], result["finding"], f"{result['time_s']:.1f}",
            "yes" if result["success"] else "no", ", ".join(result["caused"]), result["reason"],
            style=None if result["good"] else "red",
        )  # fmt: skip
    counts = np.bincount([result["good"] for result in results], minlength=2)
    rows.add_row(f"all {counts.sum()}", "", f"{counts[1]} good", style="bold")
    return rows
