"""`motm-twin bench barn`: worlds of the BARN challenge as scene files, or worlds like them from seeds.

As in the challenge, time starts after 0.1 m, and a run succeeds within 1 m of the goal in 100 s without a contact.
Its metric is OT / clip(AT, 2 OT, 8 OT), 0 without success: AT is its time, OT = (length of the path) / 2 m/s. A
converted file has OT in a comment, as ``optimal time 5.6259 s``. Without one, OT is that of the shortest path of a disc
with the inscribed radius of the footprint; it is shorter than the grid paths of the challenge, and so not easier.
"""

import math
import re
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from rich.console import Console
from rich.table import Table

from motm_twin.generate.challenges import CONTROLLER, LIMIT, NOMINAL
from motm_twin.methods.registry import FAST, find_method
from motm_twin.model.profile import DEG, BaseLimits, Lidar
from motm_twin.model.scene import DriveTo, Scene
from motm_twin.model.scene_file import find_scene, is_made, load_scene
from motm_twin.perception.footprints import outline
from motm_twin.perf.report import grid, load_average, spread, write_report
from motm_twin.planning.global_path import shortest_path
from motm_twin.planning.visibility import build_graph
from motm_twin.studies.pool import Lost, local_pool, outcomes
from motm_twin.twin import Twin

NAME = "barn"
TITLE = "BARN: through fields of cylinders that no map shows"
BEGUN = 0.1  # [m] from the start, after which the time begins
OPTIMAL_SPEED = 2.0  # [m/s] of OT
AT_LEAST, AT_MOST = 2.0, 8.0  # limits to which the time is clipped, in multiples of OT
WARM_UP = 20  # periods whose computing time is not counted
LIDAR = Lidar(x=0.12, field_of_view=270.0 * DEG, beams=720, range_min=0.1, range_max=30.0, rate=40.0)
PROFILES = ("nominal", "controller")
_OPTIMAL = re.compile(r"optimal time ([0-9.]+) s")
Result = dict[str, Any]


class World(msgspec.Struct, frozen=True, kw_only=True):
    """One run: a world with its robot, and the method."""

    scene: Scene
    method: str
    optimal: float  # [s] OT


def limits_of(profile: str) -> BaseLimits:
    """The Jackal's limits: ``nominal`` ones, or those of its ``controller``."""
    given = NOMINAL if profile == "nominal" else CONTROLLER
    return BaseLimits(
        forward_speed=given["forward_speed_mps"],
        reverse_speed=given["reverse_speed_mps"],
        yaw_rate=given["yaw_rate_dps"] * DEG,
        linear_acceleration=given["linear_acceleration_mps2"],
        yaw_acceleration=given["yaw_acceleration_dps2"] * DEG,
        velocity_lag=given["velocity_lag"],
    )


def worlds(names: Sequence[str], methods: Sequence[str], profile: str | None) -> list[World]:
    """The runs of scene files or ``barn:SEED``; ``profile``: one of `PROFILES`; None: the robot of the file.

    Raises SceneError, and MethodError for an unknown method.
    """
    found = []
    for method in methods:
        find_method(method)
    for name in names:
        scene = load_scene(name)
        goal_of(scene)
        if profile is not None:
            robot = msgspec.structs.replace(scene.robot, base=limits_of(profile), lidar=LIDAR)
            scene = msgspec.structs.replace(scene, robot=robot)
        text = "" if is_made(name) else find_scene(name)[0].read_text(encoding="utf-8")  # a comment may have OT
        optimal = optimal_time(scene, text)
        found += [World(scene=scene, method=method, optimal=optimal) for method in methods]
    return found


def optimal_time(scene: Scene, text: str = "") -> float:
    """OT [s]: from a comment of the scene file, else from the shortest path of the inscribed disc."""
    found = _OPTIMAL.search(text)
    if found:
        return float(found[1])
    body = scene.robot.footprint
    graph = build_graph(
        tuple(outline(solid.shape) for solid in scene.solids), 0.5 * min(body.length, body.width), scene.bounds
    )
    path = shortest_path(graph, np.array(scene.start), np.array(goal_of(scene).point), scene.robot.base)
    return float(np.hypot(*np.diff(path, axis=0).T).sum()) / OPTIMAL_SPEED


def goal_of(scene: Scene) -> DriveTo:
    """Goal of the scene: its last task. Raises ValueError when that is not a drive."""
    goal = scene.tasks[-1]
    if not isinstance(goal, DriveTo):
        raise ValueError(f"{scene.name} is no BARN world: its last task is not drive_to")
    return goal


def metric(success: bool, seconds: float, optimal: float) -> float:
    """OT / clip(AT, 2 OT, 8 OT); 0 without success."""
    return optimal / min(max(seconds, AT_LEAST * optimal), AT_MOST * optimal) if success else 0.0


def cross(world: World) -> Result:
    """Run one world; the times of its periods are by processor time."""
    scene, goal = world.scene, goal_of(world.scene)
    twin = Twin(scene, method=find_method(world.method), clock=time.thread_time)
    start, place = np.array(scene.start[:2]), np.array(goal.point)
    begun, periods, reached, why, spent = math.nan, [], False, "", 0.0
    for tick in twin.ticks():
        assert tick.truth is not None
        periods.append(tick.stage_ms["period"])
        at = tick.truth.pose[:2]
        if math.isnan(begun) and math.dist(at, start) > BEGUN:
            begun = tick.time
        spent = 0.0 if math.isnan(begun) else tick.time - begun
        reached = math.dist(at, place) <= goal.tolerance
        why = tick.stop_reason or tick.plan.reason or why
        if reached or tick.truth.contacts or spent > LIMIT:
            break
    assert tick.truth is not None
    contacts = len(tick.truth.contacts)
    caused = sum(contact.caused_by_robot for contact in tick.truth.contacts)
    success = reached and not contacts
    if contacts:
        why = f"contact with {tick.truth.contacts[0].other}"
    return _result(
        world, success=success, contacts=contacts, contacts_caused_by_robot=caused, time_s=round(spent, 3),
        optimal_s=round(world.optimal, 4), metric=round(metric(success, spent, world.optimal), 4),
        clearance_m=round(float(tick.truth.min_base_clearance), 3), period_ms=periods[WARM_UP:] or periods,
        reason="" if success else why or "not there in time", state_hash=twin.state_hash(),
    )  # fmt: skip


def _result(world: World, **measured: Any) -> Result:
    """The result of a run, with what was ``measured``; the defaults are those of a run whose process died."""
    return {
        "world": world.scene.name, "method": world.method, "success": False, "contacts": 0,
        "contacts_caused_by_robot": 0, "time_s": 0.0, "optimal_s": world.optimal, "metric": 0.0,
        "clearance_m": math.nan, "period_ms": [0.0], "reason": "", "state_hash": "", **measured,
    }  # fmt: skip


def bench_barn(
    names: Sequence[str], methods: Sequence[str], profile: str | None, workers: int, out: Path, console: Console
) -> bool:
    """Run all worlds, print the table, write ``out/barn.json``; True when every world was crossed without a contact.

    Raises ValueError (SceneError, MethodError) for unknown names.
    """
    runs = worlds(names, methods or (FAST.name,), profile)
    console.print(f"\n[bold]{NAME}[/bold]: {TITLE}")
    results: list[Result] = [{}] * len(runs)
    for done, (index, outcome) in enumerate(outcomes(cross, runs, local_pool(workers)), 1):
        results[index] = _result(runs[index], reason=outcome.reason) if isinstance(outcome, Lost) else outcome
        result = results[index]
        verdict = f"{result['time_s']:.1f} s" if result["success"] else f"NO: {result['reason']}"
        console.print(f"  {done}/{len(runs)} {result['world']} {result['method']}: {verdict}", markup=False)
    console.print(table(results))
    rows = [{**result, "period_ms": spread(result["period_ms"])} for result in results]
    write_report(
        out, NAME, TITLE, profile=profile or "as in the files", rows=rows, whole=whole(results),
        load_average=load_average(console),
    )  # fmt: skip
    return all(result["success"] for result in results)


def whole(results: Sequence[Result]) -> dict[str, dict[str, Any]]:
    """All worlds of each method: share of successes, contacts, means, and the spread of all periods."""
    found = {}
    for method in dict.fromkeys(result["method"] for result in results):
        of = [result for result in results if result["method"] == method]
        crossed = [result["time_s"] for result in of if result["success"]]
        found[method] = {
            "worlds": len(of),
            "success_percent": round(100.0 * len(crossed) / len(of), 1),
            "contacts": sum(result["contacts"] for result in of),
            "contacts_caused_by_robot": sum(result["contacts_caused_by_robot"] for result in of),
            "time_s": round(float(np.mean(crossed)), 3) if crossed else None,
            "metric": round(float(np.mean([result["metric"] for result in of])), 4),
            "period_ms": spread([value for result in of for value in result["period_ms"]]),
        }
    return found


def table(results: Sequence[Result]) -> Table:
    """A row for each world, and one for all worlds of each method."""
    names = ("world", "method", "success", "contacts", "caused", "time s", "OT s", "metric", "clear m", "p50 ms", "p99")
    rows = grid(*names, "max", texts=("world", "method"))
    for result in results:
        times = spread(result["period_ms"]).values()
        rows.add_row(
            result["world"], result["method"], "yes" if result["success"] else "NO", str(result["contacts"]),
            str(result["contacts_caused_by_robot"]),
            f"{result['time_s']:.2f}", f"{result['optimal_s']:.2f}", f"{result['metric']:.3f}",
            f"{result['clearance_m']:.3f}", *(f"{value:.1f}" for value in times),
            style=None if result["success"] else "red",
        )  # fmt: skip
    for method, all_of in whole(results).items():
        mean = "-" if all_of["time_s"] is None else f"{all_of['time_s']:.2f}"
        rows.add_row(
            f"all {all_of['worlds']}", method, f"{all_of['success_percent']:g} %", str(all_of["contacts"]),
            str(all_of["contacts_caused_by_robot"]), mean, "",
            f"{all_of['metric']:.3f}", "", *(f"{value:.1f}" for value in all_of["period_ms"].values()), style="bold",
        )  # fmt: skip
    return rows
