"""Reasons why the footprint does not fit at a candidate pose."""

import math
from enum import StrEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from motm_twin.model.geometry import Array
from motm_twin.model.motion import kernel
from motm_twin.perception.world_map import WorldMap
from motm_twin.planning.collision import Body, Field, clearance
from motm_twin.planning.visibility import Graph


class Rejection(StrEnum):
    """Reasons for which a candidate pose is rejected; users read the value."""

    NONE = ""
    OUTSIDE = "outside the map"
    SEEN = "collision with a seen obstacle"
    MAPPED = "collision with mapped furniture"
    NO_PATH = "no path"
    HIDDEN = "was not free, and is not in sight"
    NO_REACH = "arm cannot reach"
    NOT_FREE = "not free"
    REFUSED = "the base did not get there"


_OF_FOOTPRINT = (Rejection.NONE, Rejection.OUTSIDE, Rejection.SEEN, Rejection.MAPPED)
OUTSIDE, SEEN, MAPPED = 1, 2, 3  # indices into _OF_FOOTPRINT
BESIDE = 0.1  # [m] a collision is with a seen obstacle if a seen point is this near to the footprint


class Here(NamedTuple):
    """One period's map, prepared for tests of poses."""

    world: WorldMap
    field: Field
    body: Body
    graph: Graph
    eye: Array  # place of the lidar, (2,) [m]


def rejections(pose: Array, needed: float, here: Here) -> list[Rejection]:
    """Reason why the footprint with a clearance `needed` [m] does not fit at each pose (m, 3); "" where it fits."""
    reason = np.zeros(len(pose), np.uint8)
    c, s = np.cos(pose[:, 2]), np.sin(pose[:, 2])
    _judge(pose, c, s, needed, here.world.seen_points, here.world.resolution, here.field, here.body, reason)
    return [_OF_FOOTPRINT[i] for i in reason.tolist()]


def leaves_room(pose: Array, room: float, here: Here) -> Array:
    """Test that no point that may be moving is in the footprint grown by `room` [m] all round, shape (m,) of bool."""
    result = np.zeros(len(pose), dtype=bool)
    mark_free(pose, np.cos(pose[:, 2]), np.sin(pose[:, 2]), may_move(here.world), room, here.body, result)
    return result


def may_move(world: WorldMap) -> Array:
    """Points of the map that are not static, including far sides hidden from the lidar, (m, 2) [m]."""
    return np.concatenate((world.seen_points[~world.seen_static], world.hidden))


def in_sight(pose: Array, here: Here) -> Array:
    """Test that no seen point hides a corner of the footprint at each pose (m, 3) from the lidar, shape (m,) of bool.

    A seen obstacle may extend beyond its seen points: the far side of a box is not free floor.
    """
    result = np.ones(len(pose), dtype=bool)
    c, s = np.cos(pose[:, 2]), np.sin(pose[:, 2])
    _mark_in_sight(here.eye, pose, c, s, here.world.seen_points, here.world.resolution, here.body, result)
    return result


@kernel
def _mark_in_sight(
    eye: Array, pose: Array, c: Array, s: Array, seen: Array, resolution: float, body: Body,
    result: NDArray[np.bool_],
) -> None:  # fmt: skip
    """Clear `result` of poses (n, 3) with a seen point (m, 2) on the line to one of their corners; c, s of headings."""
    for i in range(pose.shape[0]):
        for k in range(4):
            x = pose[i, 0] + c[i] * body.corner[k, 0] - s[i] * body.corner[k, 1]
            y = pose[i, 1] + s[i] * body.corner[k, 0] + c[i] * body.corner[k, 1]
            if _hidden(eye[0], eye[1], x, y, seen, resolution):
                result[i] = False
                break


@kernel
def _hidden(ax: float, ay: float, bx: float, by: float, seen: Array, resolution: float) -> bool:
    """Test that a seen point (m, 2) is on the line from a to b."""
    dx, dy = bx - ax, by - ay
    squared = dx * dx + dy * dy
    for k in range(seen.shape[0]):
        px, py = seen[k, 0] - ax, seen[k, 1] - ay
        along = px * dx + py * dy
        if 0.0 < along < squared and abs(px * dy - py * dx) < resolution * math.sqrt(squared):
            return True
    return False


@kernel
def _judge(
    pose: Array,
    c: Array,
    s: Array,
    needed: float,
    seen: Array,
    resolution: float,
    field: Field,
    body: Body,
    reason: NDArray[np.uint8],
) -> None:
    """Fill in the index of the `Rejection` of each pose (n, 3); c, s of the headings, ``seen`` points (m, 2) [m]."""
    rows, columns = field.value.shape
    for i in range(pose.shape[0]):
        if clearance(pose[i, 0], pose[i, 1], pose[i, 2], needed, field, body) >= needed:
            continue
        if _beyond_border(
            pose[i, 0], pose[i, 1], c[i], s[i], needed, columns * resolution, rows * resolution, field, body
        ):
            reason[i] = OUTSIDE
        elif _any_within(pose[i, 0], pose[i, 1], c[i], s[i], seen, BESIDE, body):
            reason[i] = SEEN
        else:
            reason[i] = MAPPED


@kernel
def _beyond_border(
    px: float, py: float, c: float, s: float, margin: float, width: float, height: float, field: Field, body: Body
) -> bool:
    """Test that a corner of the body is nearer than a margin to the border of the map, or beyond it; all in [m]."""
    x_low, y_low = field.x + margin, field.y + margin
    x_high, y_high = x_low - 2.0 * margin + width, y_low - 2.0 * margin + height
    for k in range(body.corner.shape[0]):
        x = c * body.corner[k, 0] - s * body.corner[k, 1] + px
        y = s * body.corner[k, 0] + c * body.corner[k, 1] + py
        if x < x_low or x > x_high or y < y_low or y > y_high:
            return True
    return False


@kernel
def _any_within(px: float, py: float, c: float, s: float, points: Array, margin: float, body: Body) -> bool:
    """Test that a point (m, 2) lies in the footprint grown by the margin [m] on all sides."""
    half_x, half_y = -math.inf, -math.inf
    for k in range(body.corner.shape[0]):
        half_x, half_y = max(half_x, body.corner[k, 0]), max(half_y, body.corner[k, 1])
    half_x, half_y = half_x - body.centre_x + margin, half_y + margin
    for k in range(points.shape[0]):
        dx, dy = points[k, 0] - px, points[k, 1] - py
        if abs(c * dx + s * dy - body.centre_x) <= half_x and abs(-s * dx + c * dy) <= half_y:
            return True
    return False


@kernel
def mark_free(
    pose: Array, c: Array, s: Array, points: Array, margin: float, body: Body, result: NDArray[np.bool_]
) -> None:
    """Mark each pose (n, 3) with no point in its footprint grown by the margin; c, s of the headings."""
    for i in range(pose.shape[0]):
        result[i] = not _any_within(pose[i, 0], pose[i, 1], c[i], s[i], points, margin, body)
