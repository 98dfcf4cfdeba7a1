"""Things put where the robot is or goes: before the moving base, onto its goal, and onto its hand.

On touch the base brakes fully, and then only moves out of the overlap; it does not circle round a goal that
is occupied; and the arm moves no further into an obstacle that it overlaps.
"""

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import joblib
import msgspec
import numpy as np
from rich.console import Console
from rich.table import Table

from motm_twin.control.arm.types import Phase
from motm_twin.control.targets import odometry_to_world
from motm_twin.control.tick import Tick
from motm_twin.methods.registry import find_method
from motm_twin.model.edits import AddObstacle, RemoveBody
from motm_twin.model.geometry import to_frame
from motm_twin.model.scene import DriveTo, Scene
from motm_twin.model.scene_file import load_scene
from motm_twin.perf.report import grid, write_report
from motm_twin.twin import Twin

NAME = "surprise"
TITLE = "Things put before the moving base, onto its goal, and onto its hand"
SCENE = "playground"
METHODS = ("fast", "motm", "staa")
GAPS = (-0.04, 0.0, 0.02, 0.05, 0.10)  # [m] between the front of the base and the box
SPEEDS = (0.1, 0.25, 0.5, 1.0)  # [m/s] of the base
OVER = 0.02  # [m] beyond the stopping distance that the base may travel in contact
REVERSALS = 3  # most of them before a taken goal
GOALS = (  # name, shape, size [m]
    ("box 0.3 m", "box", 0.3), ("box 0.5 m", "box", 0.5), ("box 0.8 m", "box", 0.8),
    ("cylinder 0.4 m", "cylinder", 0.4), ("person", "person", 0.0), ("temi", "temi", 0.0),
)  # fmt: skip
PHASES = (Phase.TRANSIT, Phase.FINAL, Phase.LIFT, Phase.CARRY, Phase.RELEASE)
STAYS = 14.0  # [s] that a box stays on the hand
_PUT_AT = 40  # period in which the base has its speed, but for quick ones
_LAG = 0.05  # [s] a period: a placed body is seen in the next
_BOX_LENGTH = 1.5  # [m] along the way: more than a quick base needs to stop
_MOVES = 0.03  # [m/s]
_OUT = 0.6  # [m] from the middle of the base: the hand is beside it


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
    """Frankie on an empty floor, at most that fast [m/s], driving to points one after the other."""
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
    """A box before the base that drives: how far it goes on [m] while it touches it, and what is allowed.

    The arm may not touch itself while it dodges.
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
    return _result(tick, good=good, told=f"{went:.3f} of {allowed:.3f} m")


def _goal(case: Case) -> dict[str, Any]:
    """The goal is taken while the robot drives there: when it gives up, and how often it turns back before."""
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
    return _result(tick, good=good, told=f"left at {given_up:.1f} s, {reversals} reversals")


def _hand(case: Case) -> dict[str, Any]:
    """A box onto the hand in a phase of a trial, for a while: what the robot touches by its own doing, and the rest."""
    scene = load_scene("exp1", "trial1")
    twin = Twin(scene, method=find_method(case.method))
    put, gone = math.nan, False
    for tick in twin.ticks():
        hand = to_frame(odometry_to_world(tick.observation), tick.arm[-1].reference[:2])
        out = math.dist(hand, tick.observation.pose[:2]) > _OUT
        if math.isnan(put) and tick.arm[-1].phase == case.what and out:
            put = tick.time
            twin.post(AddObstacle(name="box", x=float(hand[0]), y=float(hand[1]), size=(0.3, 0.3, 1.2)))
        elif tick.time > put + STAYS and not gone:
            gone = True
            twin.post(RemoveBody(name="box"))
    return _result(tick, good=tick.success and not _caused(tick), told=f"{len(_caused(tick))} caused")


def _caused(tick: Tick) -> list[str]:
    assert tick.truth is not None
    return [
        f"{' '.join(one.bodies)} - {one.other} {one.time:.2f} s" for one in tick.truth.contacts if one.caused_by_robot
    ]


def _result(tick: Tick, *, good: bool, told: str) -> dict[str, Any]:
    """Fields of a result that all parts have."""
    return {
        "good": bool(good), "told": told, "time_s": round(tick.time, 2), "done": tick.done, "success": tick.success,
        "caused": _caused(tick), "reason": tick.stop_reason,
    }  # fmt: skip


def bench_surprise(out: Path, workers: int, console: Console) -> bool:
    """Run all cases, print the table, write ``out/surprise.json``; True when every one was good."""
    console.print(f"\n[bold]{NAME}[/bold]: {TITLE}")
    run: Any = joblib.Parallel(n_jobs=workers)
    results = run(joblib.delayed(run_case)(case) for case in cases())
    console.print(table(results))
    good = all(result["good"] for result in results)
    write_report(out, NAME, TITLE, reached=good, rows=results)
    return good


def table(results: list[dict[str, Any]]) -> Table:
    """A row for each case."""
    names = ("where", "method", "what", "", "ended s", "success", "caused", "said at the end")
    rows = grid(*names, texts=names)
    for result in results:
        rows.add_row(
            result["part"], result["method"], result["what"], result["told"], f"{result['time_s']:.1f}",
            "yes" if result["success"] else "no", ", ".join(result["caused"]), result["reason"],
            style=None if result["good"] else "red",
        )  # fmt: skip
    counts = np.bincount([result["good"] for result in results], minlength=2)
    rows.add_row(f"all {counts.sum()}", "", f"{counts[1]} good", style="bold")
    return rows
