"""Whom the robot keeps off now, by name. The robot sees only points; the names are those of the twin's ground truth."""

import functools
import math
import re
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import shapely
import shapely.ops

from motm_twin.bus.messages import BodyMessage, TickMessage
from motm_twin.model.furniture import Piece, moved_scene, pieces
from motm_twin.model.kinematics import Frankie
from motm_twin.model.profile import RobotProfile
from motm_twin.model.scene import Scene
from motm_twin.model.scene_shapes import outline, rectangle
from motm_twin.ui import words
from motm_twin.ui.aim import body_outline
from motm_twin.ui.words import slowed, stands

NEAR = 1.2  # [m] from the base: nothing further off is named
BESIDE = 0.6  # [m] from the planned way: what is nearer is passed
HELD = 1.0  # [m] from the base to what it stands for
SAME = 0.2  # [m] by which the distance of a named thing may differ from what the lidar says
ROUNDED = 1e-3  # [m], [rad] places of a tick are rounded to less
AHEAD, BEHIND = math.radians(40.0), math.radians(120.0)
_HOLDS = ("braking", "no motion", "no way", "obstacles close", "every gap")
_SEEN = re.compile(r"lidar sees, the nearest (\d+\.\d+) m")


@dataclass(frozen=True)
class Thing:
    """Something the map does not have: a moving or added body, or furniture that the robot was not told of."""

    label: str
    shape: shapely.Polygon  # outline on the floor [m]


def avoided(tick: TickMessage, scene: Scene | None) -> str:
    """Whom the robot keeps off and how, as the end of a sentence; "" when nothing is near its way."""
    if tick.done or scene is None:
        return ""
    things = list(unmapped(tick, scene))
    return _held_up(tick, scene, things) or _gripper(tick, scene, things) or _past(tick, scene, things)


def limited_by(tick: TickMessage, scene: Scene | None) -> str:
    """Name of what the lidar row of the arm keeps the gripper off; "" when it has none (furniture of the map)."""
    if scene is None or not slowed(tick.arm) or tick.arm[-1].obstacle_distance is None:
        return ""
    hand, seen = gripper(tick, scene), tick.arm[-1].obstacle_distance
    found = [(thing.shape.distance(hand), thing.label) for thing in unmapped(tick, scene)]
    distance, label = min(found, default=(math.inf, ""))
    return label if abs(distance - seen) <= SAME else ""


def strange(held_by: str, tick: TickMessage, scene: Scene | None) -> str:
    """What the map does not know about that which holds the arm, as a remark; "" when it is as the map has it.

    ``held_by`` is a phrase of `words.constraints`.
    """
    if scene is None:
        return ""
    if held_by == f"kept off {words.LIDAR}":
        hand = gripper(tick, scene)
        near = min(((thing.shape.distance(hand), thing.label) for thing in unmapped(tick, scene)), default=None)
        return "" if near is None or near[0] > NEAR else f": {near[1].rstrip(',')}"
    for piece in pieces(scene).values():
        parts = {piece.name, *piece.solids}
        astray = piece.name in tick.removed or not _known(piece, tick)
        if astray and held_by.removeprefix("kept off ") in parts:
            return ", where the map still has it (the robot was not told that it moved)"
    return ""


def unmapped(tick: TickMessage, scene: Scene) -> Iterator[Thing]:
    """Everything near the robot that its map does not have."""
    for body in (*tick.agents, *tick.obstacles):
        yield Thing(_called(body), body_outline(body))
    known = pieces(scene)
    moved = {b.name: (b.position[0], b.position[1], b.yaw) for b in tick.furniture if b.name in known}
    strange = [
        piece
        for piece in known.values()
        if piece.name not in tick.removed and not (piece.mapped and _known(piece, tick))
    ]
    if not strange:
        return
    solids = {solid.name: solid for solid in moved_scene(scene, moved, ()).solids}
    for piece in strange:
        shape = shapely.union_all([outline(solids[name].shape) for name in piece.solids])
        where = "which is not in the map" if not piece.mapped else "which is not where the map has it"
        yield Thing(f"{piece.name}, {where},", shapely.Polygon(shape.convex_hull.boundary.coords))


def _known(piece: Piece, tick: TickMessage) -> bool:
    """Whether a piece stands where the robot's map has it: where it was announced, else where the scene has it."""
    home = (*piece.centre, 0.0)
    here = next(((*body.position[:2], body.yaw) for body in tick.furniture if body.name == piece.name), home)
    x, y, turn = tick.announced.get(piece.name, home)
    return math.dist(here[:2], (x, y)) < ROUNDED and abs(math.remainder(here[2] - turn, 2 * math.pi)) < ROUNDED


def gripper(tick: TickMessage, scene: Scene) -> shapely.Point:
    """Where the fingers truly are on the plan [m]."""
    place, _ = _frankie(scene.robot).tcp_pose(np.array(tick.robot.true_pose), np.array(tick.robot.q))
    return shapely.Point(place[:2])


def _held_up(tick: TickMessage, scene: Scene, things: list[Thing]) -> str:
    why = tick.stop_reason
    if tick.plan.status != "braking" and not any(word in why for word in _HOLDS):
        return ""
    found = _nearest(tick, scene, things, HELD)
    verb = "held up by" if stands(tick) else "braking for"
    if found is not None:
        return f"{verb} {_spelled(*found)}"
    seen = _SEEN.search(why)
    return "" if seen is None else f"{verb} something the lidar sees {float(seen[1]):.1f} m away"


def _gripper(tick: TickMessage, scene: Scene, things: list[Thing]) -> str:
    if not slowed(tick.arm) or tick.arm[-1].obstacle_distance is None:
        return ""
    seen = tick.arm[-1].obstacle_distance
    hand = gripper(tick, scene)
    distance, label = min(((thing.shape.distance(hand), thing.label) for thing in things), default=(math.inf, ""))
    if abs(distance - seen) > SAME:
        if tick.arm[-1].limiter != "moving obstacle":
            return ""  # furniture of the map, which it works at
        label = "something that moves"
    return f"keeping the gripper off {label.rstrip(',')} ({seen:.1f} m)"


def _past(tick: TickMessage, scene: Scene, things: list[Thing]) -> str:
    if stands(tick):
        return ""
    here = tick.robot.true_pose[:2]
    points = [here, *(pose[:2] for pose in tick.plan.local_poses)]
    way = shapely.LineString(points) if len(points) > 1 else shapely.Point(here)
    half = scene.robot.footprint.width / 2
    found = _nearest(tick, scene, [t for t in things if t.shape.distance(way) - half < BESIDE], NEAR)
    if found is None or found[2] == "behind":
        return ""
    return f"past {_spelled(*found)}"


def _nearest(tick: TickMessage, scene: Scene, things: list[Thing], limit: float) -> tuple[str, float, str] | None:
    """Label, distance from the base [m] and side of the nearest thing."""
    x, y, heading = tick.robot.true_pose
    body = scene.robot.footprint
    centre = (x + body.offset_x * math.cos(heading), y + body.offset_x * math.sin(heading))
    base = rectangle((*centre, heading), (body.length, body.width))
    distance, number = min(((thing.shape.distance(base), k) for k, thing in enumerate(things)), default=(math.inf, -1))
    if distance > limit:
        return None
    point = shapely.ops.nearest_points(things[number].shape, shapely.Point(x, y))[0]
    side = math.remainder(math.atan2(point.y - y, point.x - x) - heading, 2 * math.pi)
    where = "ahead" if abs(side) < AHEAD else "behind" if abs(side) > BEHIND else "to its left" if side > 0 else ""
    return things[number].label, float(distance), where or "to its right"


def _spelled(label: str, distance: float, where: str) -> str:
    end = " " if label.endswith(",") else ", "
    return f"{label}{end}{distance:.1f} m {where}"


def _called(body: BodyMessage) -> str:
    """A body by name, with its kind where the name does not tell."""
    return body.name if body.kind.lower() in body.name.lower() else f"{body.name} ({body.kind})"


@functools.lru_cache(maxsize=4)
def _frankie(profile: RobotProfile) -> Frankie:
    return Frankie(profile)
