"""Leaving an overlap: the quickest simple motion during which nothing gets deeper into the footprint."""

import math
from typing import NamedTuple

import numpy as np

from motm_twin.model.geometry import Array, drive, to_frame
from motm_twin.model.profile import BaseLimits
from motm_twin.perception.world_map import WorldMap
from motm_twin.planning.collision import Body, Field, clearances
from motm_twin.planning.kernel import kernel

STEPS = 40  # of each motion that is tried
TURN = 0.5 * math.pi  # [rad] the farthest turn in place that is tried
DEEP = 0.03  # [m] inside the footprint: no noise
TOLERANCE = 0.01  # [m] a cell may come deeper: its centre is known no better
MORE_ROOM = 0.05  # [m] that backing off must bring
SPEED_SHARE = 0.5  # of the reverse speed (without one, of the forward speed), and of the yaw rate
CURVATURES = (0.0, 0.5, -0.5, 1.0, -1.0, 2.0, -2.0)  # of the arcs that are tried, times the inverse of the outer radius


class Escape(NamedTuple):
    """A motion out of an overlap."""

    twist: Array  # (v, w) to hold [m/s, rad/s], shape (2,)
    poses: Array  # along it, shape (n, 3)
    times: Array  # [s], shape (n,)
    clear: bool  # it ends outside all obstacles


def overlapping_cells(world: WorldMap, pose: Array, body: Body) -> Array:
    """Centres of occupied cells round the body, nearer than it reaches and can move in an escape, (m, 2) [m]."""
    reach = 3.0 * body.outer + abs(body.centre_x)
    low = np.floor((pose[:2] - reach - world.origin) / world.resolution).astype(int).clip(0)
    high = np.ceil((pose[:2] + reach - world.origin) / world.resolution).astype(int).clip(0)
    rows, columns = np.nonzero(world.occupied[low[1] : high[1], low[0] : high[0]])
    cells = np.column_stack((columns + low[0], rows + low[1]))
    return world.origin + world.resolution * (cells + 0.5)


def depth_of(cells: Array, pose: Array, body: Body) -> float:
    """Depth [m] of the deepest cell centre (m, 2) inside the footprint, by its nearest side; negative: its distance."""
    half, turned = half_sizes(body), to_frame(pose, cells)
    nearest = np.maximum(np.abs(turned[:, 0] - half[2]) - half[0], np.abs(turned[:, 1]) - half[1])
    return -float(nearest.min(initial=math.inf))


def half_sizes(body: Body) -> Array:
    """Half length, half width and offset of the footprint [m], shape (3,)."""
    half = body.corner.max(axis=0)
    return np.array([half[0] - body.centre_x, half[1], body.centre_x])


def find_escape(world: WorldMap, pose: Array, body: Body, limits: BaseLimits) -> Escape | None:
    """The quickest arc or turn that leaves every occupied cell, else the one that leaves most; None: none does."""
    cells, sizes, pad = overlapping_cells(world, pose, body), half_sizes(body), 0.5 * world.resolution
    start = rooms(pose, cells, sizes)
    overlap = float(np.maximum(0.0, pad - start).sum())
    if overlap == 0.0:
        return None
    best: tuple[bool, float, float] | None = None
    found: Escape | None = None
    path = np.empty((STEPS + 1, 3))
    for twist in _twists(body, limits):
        duration = TURN / abs(twist[1]) if twist[0] == 0.0 else 2.0 * body.outer / abs(twist[0])
        steps, left = follow_escape(pose, twist, duration / STEPS, cells, start, sizes, pad, path)
        if steps == 0 or left > 0.9 * overlap:
            continue
        rank = (left > 0.0, left, steps * duration)
        if best is None or rank < best:
            times = np.arange(steps + 1) * (duration / STEPS)
            best, found = rank, Escape(twist, path[: steps + 1].copy(), times, left == 0.0)
    return found


def find_room(pose: Array, field: Field, body: Body, limits: BaseLimits, floor: float) -> Escape | None:
    """The arc, not longer than the outer radius, at whose end there is most room; None: not clearly more than here.

    It keeps ``floor`` [m] of clearance, or what there is here.
    """
    here = float(clearances(pose[None], 1.0, field, body)[0])
    most, found = here + MORE_ROOM, None
    for twist in _twists(body, limits):
        if twist[0] == 0.0:
            continue
        times = np.linspace(0.0, body.outer / abs(twist[0]), STEPS // 2)
        poses = _driven(pose, twist, times)
        room = clearances(poses, 1.0, field, body)
        if room.min() >= min(floor, here - 1e-3) and room[-1] > most:
            most, found = float(room[-1]), Escape(twist, poses, times, True)
    return found


def find_turn(pose: Array, field: Field, body: Body, limits: BaseLimits, floor: float) -> Escape | None:
    """The turn in place by a quarter that keeps more room, at least ``floor`` [m] or what there is here; None: none."""
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


@kernel
def _room(px: float, py: float, x: float, y: float, c: float, s: float, sizes: Array) -> float:
    """Room [m] between a point and the footprint at (x, y), by its nearest side; negative inside.

    Deep inside it is the way out along both axes, which also falls while the base drives on along its nearest side.
    """
    dx, dy = px - x, py - y
    along, across = abs(c * dx + s * dy - sizes[2]) - sizes[0], abs(c * dy - s * dx) - sizes[1]
    nearest = max(along, across)
    return nearest if nearest > -DEEP else along + across


@kernel
def _fill_rooms(pose: Array, points: Array, sizes: Array, room: Array) -> None:
    c, s = math.cos(pose[2]), math.sin(pose[2])
    for i in range(points.shape[0]):
        room[i] = _room(points[i, 0], points[i, 1], pose[0], pose[1], c, s, sizes)


def rooms(pose: Array, points: Array, sizes: Array) -> Array:
    """Room [m] between points (m, 2) and the footprint at a pose (3,), negative inside; shape (m,)."""
    room = np.empty(len(points))
    _fill_rooms(np.asarray(pose, dtype=np.float64), points, sizes, room)
    return room


@kernel
def follow_escape(
    pose: Array, twist: Array, dt: float, points: Array, start: Array, sizes: Array, pad: float, path: Array
) -> tuple[int, float]:
    """Drive a twist until nothing overlaps, or something would get deeper: steps, and the sum of what is left [m].

    ``start``: room of the points at the pose; ``path``, shape (n, 3), is filled in.
    """
    x, y, heading = pose[0], pose[1], pose[2]
    path[0, 0], path[0, 1], path[0, 2] = x, y, heading
    left = math.inf
    for step in range(1, path.shape[0]):
        heading += 0.5 * twist[1] * dt
        x += twist[0] * dt * math.cos(heading)
        y += twist[0] * dt * math.sin(heading)
        heading += 0.5 * twist[1] * dt
        c, s = math.cos(heading), math.sin(heading)
        total = 0.0
        for i in range(points.shape[0]):
            room = _room(points[i, 0], points[i, 1], x, y, c, s, sizes)
            if room < min(pad, start[i]) - TOLERANCE:
                return step - 1, left
            total += max(0.0, pad - room)
        path[step, 0], path[step, 1], path[step, 2] = x, y, heading
        left = total
        if total == 0.0:
            return step, left
    return path.shape[0] - 1, left
