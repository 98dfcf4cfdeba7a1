"""Why the footprint does not fit at a candidate pose."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from motm_twin.model.geometry import Array
from motm_twin.perception.world_map import WorldMap
from motm_twin.planning.collision import Body, Field, clearances
from motm_twin.planning.kernel import kernel
from motm_twin.planning.visibility import Graph


class Here(NamedTuple):
    """One period's map, ready for tests."""

    world: WorldMap
    field: Field
    body: Body
    graph: Graph


def rejections(pose: Array, wanted: float, here: Here) -> list[str]:
    """Why the footprint with a clearance `wanted` [m] does not fit at each pose (m, 3); "" where it does."""
    free = clearances(pose, wanted, here.field, here.body) >= wanted
    why = [""] * len(pose)
    if free.all():
        return why
    seen = _near_seen(pose, here)
    outside = _beyond_border(pose, wanted, here)
    for i in np.flatnonzero(~free).tolist():
        collides = "collision with a seen obstacle" if seen[i] else "collision with mapped furniture"
        why[i] = "outside the map" if outside[i] else collides
    return why


def leaves_room(pose: Array, room: float, here: Here) -> Array:
    """Whether nothing that may be moving is in the footprint larger by `room` [m] on all sides, shape (m,) of bool."""
    result = np.zeros(len(pose), dtype=bool)
    _mark_within(pose, may_move(here.world), room, here.body, result)
    return ~result


def may_move(world: WorldMap) -> Array:
    """Where the map shows what is not static, the far sides of it that the lidar does not see included, (m, 2) [m]."""
    return np.concatenate((world.seen_points[~world.seen_static], world.hidden))


def _beyond_border(pose: Array, margin: float, here: Here) -> Array:
    """Whether the footprint with a margin [m] reaches over the border of the map, shape (m,) of bool."""
    low = np.array([here.field.x, here.field.y]) + margin
    high = low - 2.0 * margin + np.array(here.world.distance.shape[::-1]) * here.world.resolution
    result = np.zeros(len(pose), dtype=bool)
    _any_beyond(pose, np.cos(pose[:, 2]), np.sin(pose[:, 2]), here.body.corner, low, high, result)
    return result


@kernel
def _any_beyond(
    pose: Array, c: Array, s: Array, corner: Array, low: Array, high: Array, result: NDArray[np.bool_]
) -> None:
    """Whether a corner (4, 2) of the body at each pose (n, 3) is outside a rectangle; c, s of the headings."""
    for i in range(pose.shape[0]):
        for k in range(corner.shape[0]):
            x = c[i] * corner[k, 0] - s[i] * corner[k, 1] + pose[i, 0]
            y = s[i] * corner[k, 0] + c[i] * corner[k, 1] + pose[i, 1]
            if x < low[0] or x > high[0] or y < low[1] or y > high[1]:
                result[i] = True
                break


def _near_seen(pose: Array, here: Here) -> Array:
    """Whether an obstacle seen outside the map is at the footprint of each pose, shape (m,) of bool."""
    points = here.world.seen_points
    result = np.zeros(len(pose), dtype=bool)
    if not len(points):
        return result
    reach = here.body.outer + 0.1
    low, high = pose[:, :2].min(axis=0) - reach, pose[:, :2].max(axis=0) + reach
    near = points[((points >= low) & (points <= high)).all(axis=1)]
    if not len(near):
        return result
    _mark_within(pose, near, 0.1, here.body, result)
    return result


def _mark_within(pose: Array, points: Array, margin: float, body: Body, result: NDArray[np.bool_]) -> None:
    """Set what `_any_within` finds in footprints that are larger by the margin [m] on all sides."""
    half = body.corner.max(axis=0) - (body.centre_x, 0.0) + margin
    _any_within(pose, np.cos(pose[:, 2]), np.sin(pose[:, 2]), points, half, body.centre_x, result)


@kernel
def _any_within(
    pose: Array, c: Array, s: Array, points: Array, half: Array, centre_x: float, result: NDArray[np.bool_]
) -> None:
    """Whether a point (m, 2) lies in a rectangle of that half size at each pose (n, 3); c, s of the headings."""
    for i in range(pose.shape[0]):
        for k in range(points.shape[0]):
            dx, dy = points[k, 0] - pose[i, 0], points[k, 1] - pose[i, 1]
            if abs(c[i] * dx + s[i] * dy - centre_x) <= half[0] and abs(-s[i] * dx + c[i] * dy) <= half[1]:
                result[i] = True
                break
