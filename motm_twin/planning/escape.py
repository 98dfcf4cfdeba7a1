"""Leaving an overlap: the quickest simple motion during which no obstacle gets deeper into the footprint."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from motm_twin.model.geometry import Array, to_frame
from motm_twin.model.motion import drive, kernel, step
from motm_twin.model.profile import BaseLimits
from motm_twin.perception.clusters import label_cells
from motm_twin.perception.world_map import WorldMap
from motm_twin.planning.collision import Body, Field, clearances

IntArray = NDArray[np.int32]
STEPS = 40  # of each motion that is tried
TURN = 0.5 * math.pi  # [rad] the farthest turn in place that is tried
SAME_BODY = 2  # cells: occupied cells at most this far apart belong to one body
LESS = 0.9  # share of the depth: a motion that leaves more of it is not worth driving
TOLERANCE = 0.01  # [m] by which a cell may get deeper: its centre is not known more precisely
MORE_ROOM = 0.02  # [m] of clearance that backing off must gain
SPEED_SHARE = 0.5  # of the reverse speed (without one, of the forward speed), and of the yaw rate
CURVATURES = (0.0, 0.5, -0.5, 1.0, -1.0, 2.0, -2.0)  # of the arcs that are tried, times the inverse of the outer radius


class Escape(NamedTuple):
    """A motion of constant twist: out of an overlap, to more clearance, or a turn to look."""

    twist: Array  # (v, w) to hold [m/s, rad/s], shape (2,)
    poses: Array  # along the motion, shape (n, 3)
    times: Array  # [s], shape (n,)
    clear: bool  # the motion ends outside all obstacles


def overlapping_cells(world: WorldMap, pose: Array, body: Body) -> Array:
    """Centres of the occupied cells that the body could touch during an escape, shape (m, 2) [m]."""
    reach = 3.0 * body.outer + abs(body.centre_x)
    low = np.floor((pose[:2] - reach - world.origin) / world.resolution).astype(int).clip(0)
    high = np.ceil((pose[:2] + reach - world.origin) / world.resolution).astype(int).clip(0)
    rows, columns = np.nonzero(world.occupied[low[1] : high[1], low[0] : high[0]])
    cells = np.column_stack((columns + low[0], rows + low[1]))
    return world.origin + world.resolution * (cells + 0.5)


def depth_of(cells: Array, pose: Array, body: Body) -> float:
    """Depth [m] of the deepest cell centre (m, 2) inside the footprint, to its nearest side; negative: its distance."""
    return -float(rooms(pose, cells, half_sizes(body)).min(initial=math.inf))


def half_sizes(body: Body) -> Array:
    """Half length, half width and offset of the footprint [m], shape (3,)."""
    half = body.corner.max(axis=0)
    return np.array([half[0] - body.centre_x, half[1], body.centre_x])


def find_escape(world: WorldMap, pose: Array, body: Body, limits: BaseLimits, attempt: int = 0) -> Escape | None:
    """The quickest arc or turn out of all occupied cells, else the one that leaves least overlap; None: none helps.

    Every ``attempt`` takes another one: the present scan may forbid a motion that the map allows.
    """
    cells, sizes, pad = overlapping_cells(world, pose, body), half_sizes(body), 0.5 * world.resolution
    inside = rooms(pose, cells, sizes) < pad
    if not inside.any():
        return None
    ways: list[tuple[tuple[bool, float, float], Escape]] = []
    part_of = np.full(len(cells), -1, np.int32)
    numbers = np.floor((cells[inside, ::-1] - world.origin[::-1]) / world.resolution).astype(np.int32)
    part_of[inside], count = label_cells(numbers, SAME_BODY)
    least = np.empty((count, 5))
    path = np.empty((STEPS + 1, 3))
    for twist in _twists(body, limits):
        duration = TURN / abs(twist[1]) if twist[0] == 0.0 else 2.0 * body.outer / abs(twist[0])
        _, overlap = follow_escape(pose, twist, 0.0, cells, part_of, sizes, pad, least, path[:1])
        steps, left = follow_escape(pose, twist, duration / STEPS, cells, part_of, sizes, pad, least, path)
        if steps <= 0 or left > LESS * overlap:
            continue
        rank = (left > 0.0, left, steps * duration)
        times = np.arange(steps + 1) * (duration / STEPS)
        ways.append((rank, Escape(twist, path[: steps + 1].copy(), times, left == 0.0)))
    ways.sort(key=lambda way: way[0])
    return ways[attempt % len(ways)][1] if ways else None


def ways_to_room(pose: Array, field: Field, body: Body, limits: BaseLimits, floor: float) -> list[Escape]:
    """Arcs, at most as long as the outer radius, each up to its pose of most clearance; the one with most comes first.

    They keep ``floor`` [m] of clearance, or that of the present pose if less, and end with clearly more than here.
    """
    here = float(clearances(pose[None], 1.0, field, body)[0])
    found: list[tuple[float, Escape]] = []
    for twist in _twists(body, limits):
        if twist[0] == 0.0:
            continue
        times = np.linspace(0.0, body.outer / abs(twist[0]), STEPS // 2)
        poses = _driven(pose, twist, times)
        room = clearances(poses, 1.0, field, body)
        blocked = np.flatnonzero(room < min(floor, here - 1e-3))
        best = int(np.argmax(room[: blocked[0]] if len(blocked) else room))
        if room[best] > here + MORE_ROOM:
            found.append((float(room[best]), Escape(twist, poses[: best + 1], times[: best + 1], True)))
    return [way for _, way in sorted(found, key=lambda one: -one[0])]


def find_turn(pose: Array, field: Field, body: Body, limits: BaseLimits, floor: float) -> Escape | None:
    """The quarter turn in place that keeps more clearance, at least ``floor`` [m] or that of the pose; None: none."""
    here = float(clearances(pose[None], 1.0, field, body)[0])
    most, found = min(floor, here - 1e-3), None
    for twist in _twists(body, limits)[-2:]:
        times = np.linspace(0.0, TURN / abs(twist[1]), STEPS // 2)
        poses = _driven(pose, twist, times)
        room = float(clearances(poses, 1.0, field, body).min())
        if room >= most and (found is None or room > most):
            most, found = room, Escape(twist, poses, times, True)
    return found


def _driven(pose: Array, twist: Array, times: Array) -> Array:
    """Poses (n, 3) at times (n,) [s] of a constant twist."""
    return np.array([drive(pose, float(twist[0]), float(twist[1]), float(time)) for time in times])


def _twists(body: Body, limits: BaseLimits) -> list[Array]:
    """Twists (v, w) that are tried: arcs in reverse and forward, then turns in place."""
    speed = SPEED_SHARE * (limits.reverse_speed or limits.forward_speed)
    turning = SPEED_SHARE * limits.yaw_rate
    speeds = [-speed, speed] if limits.reverse_speed > 0.0 else [speed]
    arcs = [(v, min(turning, max(-turning, v * k / body.outer))) for v in speeds for k in CURVATURES]
    return [np.array(twist) for twist in (*arcs, (0.0, turning), (0.0, -turning))]


def rooms(pose: Array, points: Array, sizes: Array) -> Array:
    """Distance [m] from points (m, 2) to the nearest side of the footprint at a pose (3,); negative inside; (m,)."""
    turned = to_frame(pose, points)
    return np.maximum(np.abs(turned[:, 0] - sizes[2]) - sizes[0], np.abs(turned[:, 1]) - sizes[1])


@kernel
def follow_escape(
    pose: Array, twist: Array, dt: float, points: Array, body: IntArray, sizes: Array, pad: float, least: Array,
    path: Array,
) -> tuple[int, float]:  # fmt: skip
    """Drive a twist until the overlap ends, deepens, or takes in a new point: steps driven, and depth left [m].

    ``body``: number of the overlapped body that each point belongs to, -1: none. The depth of a body is the distance by
    which the footprint must be shifted, square to a side, to clear those of its points that are nearer than ``pad``
    [m]. ``least``, shape (bodies, 5), is a buffer for the depths; ``path``, shape (n, 3), is filled in.
    """
    x, y, heading = pose[0], pose[1], pose[2]
    left = math.inf
    least[:, 4] = math.inf
    for node in range(path.shape[0]):
        if node > 0:
            x, y, heading = step(x, y, heading, twist[0], twist[1], twist[0], twist[1], dt)
        c, s = math.cos(heading), math.sin(heading)
        least[:, :4] = 0.0
        for i in range(points.shape[0]):
            dx, dy = points[i, 0] - x, points[i, 1] - y
            along, across = c * dx + s * dy - sizes[2], c * dy - s * dx
            room = max(abs(along) - sizes[0], abs(across) - sizes[1])
            if body[i] < 0:
                if room < pad - TOLERANCE:
                    return node - 1, left
            elif room < pad:
                side = least[body[i]]
                side[0], side[1] = max(side[0], sizes[0] + pad - along), max(side[1], sizes[0] + pad + along)
                side[2], side[3] = max(side[2], sizes[1] + pad - across), max(side[3], sizes[1] + pad + across)
        depth = 0.0
        for k in range(least.shape[0]):
            deep = min(least[k, 0], least[k, 1], least[k, 2], least[k, 3])
            if deep > least[k, 4] + TOLERANCE:
                return node - 1, left
            least[k, 4] = min(least[k, 4], deep)
            depth += deep
        path[node, 0], path[node, 1], path[node, 2] = x, y, heading
        left = depth
        if depth == 0.0:
            return node, 0.0
    return path.shape[0] - 1, left
