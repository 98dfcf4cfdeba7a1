"""Compiled parts of the agents' behaviour: free distance ahead, and detours."""

import heapq
import math

import numpy as np
from numpy.typing import NDArray

from motm_twin.model.compiler import njit
from motm_twin.model.geometry import Array
from motm_twin.sim.kernels import Index, clearance, polygon_distance, put_rectangle

YAW_RATE = 1.5  # [rad/s]
YAW_ACCELERATION = 4.0  # [rad/s^2]
HEADING_GAIN = 4.0  # [1/s]
TURN_FIRST = 0.6  # [rad] heading error from which an agent turns on the spot
STRAIGHT = 0.1  # [rad] heading error up to which checking straight ahead is enough
CORNERING = 0.1  # [m/s] always allowed in a bend

_BETTER = 0.002  # [m] of distance gained that counts as moving away, per 0.02 m
_NEAR = 0.4  # [m] from a tight start: within this a detour must first lead away
_AWAY = 0.3  # [m] of distance gained per m that counts as leading away
_SQUEEZE = 0.02  # [m] by which a motion past an obstacle within the margin may approach it, and least gap that it keeps
_TOWARDS = 0.5  # [m of distance lost per m] from which a motion leads towards an obstacle, not past it
_LEFT = 1.3  # cost factor of cells on the left of the straight line
_SAME = 1e-6  # [m] of distance lost that counts as none


@njit(cache=True)
def bearing_to(pose: Array, x: float, y: float) -> float:
    """Angle [rad] from the heading to a point, in (-pi, pi]."""
    turn = math.atan2(y - pose[1], x - pose[0]) - pose[2]
    return math.atan2(math.sin(turn), math.cos(turn))


@njit(cache=True)
def _stoppable(room: float, acceleration: float) -> float:
    """Speed [m/s] from which an agent stops within the room [m], with a small reserve."""
    return math.sqrt(2.0 * 0.8 * acceleration * max(0.0, room))


@njit(cache=True)
def steer(
    pose: Array,
    v: float,
    w: float,
    x: float,
    y: float,
    speed: float,
    free: float,
    gap: float,
    rounding: bool,
    dt: float,
    acceleration: float,
) -> tuple[Array, float, float, float]:
    """One substep towards (x, y): pose, forward speed, yaw rate, and the rest of ``free`` [m].

    Its speed lets it stop within ``free`` straight ahead and, in bends and on detours, within ``gap`` on any side.
    """
    bearing = bearing_to(pose, x, y)
    free = max(0.0, free - v * dt)
    desired = min(speed * max(0.0, 1.0 - abs(bearing) / TURN_FIRST), _stoppable(free, acceleration))
    if rounding or abs(bearing) > STRAIGHT:
        desired = min(desired, max(CORNERING, _stoppable(gap, acceleration)))
    turn = min(YAW_RATE, max(-YAW_RATE, HEADING_GAIN * bearing))
    new_v = v + min(acceleration * dt, max(-acceleration * dt, desired - v))
    new_w = w + min(YAW_ACCELERATION * dt, max(-YAW_ACCELERATION * dt, turn - w))
    way, turned = 0.5 * (v + new_v) * dt, 0.5 * (w + new_w) * dt
    chord = way * (1.0 if turned == 0.0 else math.sin(0.5 * turned) / (0.5 * turned))
    middle, heading = pose[2] + 0.5 * turned, pose[2] + turned
    there = np.array(
        [
            pose[0] + chord * math.cos(middle),
            pose[1] + chord * math.sin(middle),
            math.atan2(math.sin(heading), math.cos(heading)),
        ]
    )
    return there, new_v, new_w, free


@njit(cache=True)
def shadow_corners(
    pose: Array, v: float, w: float, times: Array, length: float, width: float, offset_x: float
) -> Array:
    """Predicted rectangles [m] of the robot's base at times [s], counter-clockwise, shape (4 k, 2)."""
    corners = np.empty((4 * times.shape[0], 2))
    for i in range(times.shape[0]):
        ahead = times[i]
        heading, middle = pose[2] + w * ahead, pose[2] + 0.5 * w * ahead
        x = pose[0] + v * ahead * math.cos(middle) + offset_x * math.cos(heading)
        y = pose[1] + v * ahead * math.sin(middle) + offset_x * math.sin(heading)
        put_rectangle(corners, 4 * i, x, y, heading, length, width)
    return corners


@njit(cache=True)
def look_about(
    pose: Array,
    body: float,
    margin: float,
    keep: float,
    reach: float,
    corners: Array,
    first: Index,
    fixed: Array,
    expected: Array,
    own: int,
    robot_corners: Array,
    robot_first: Index,
    robot_discs: Array,
) -> tuple[float, float]:
    """Free distance [m] straight ahead of agent ``own``, at most ``reach``, and the gap [m] on its tightest side.

    The agent keeps ``margin`` from everything but the robot, and ``keep`` from the robot. ``fixed``: discs, shape
    (d, 3); ``expected``: predicted discs of each agent, shape (agents, times, 3).
    """
    count, others = fixed.shape[0], expected.shape[0] - 1
    discs = np.empty((count + others * expected.shape[1], 3))
    _put(fixed, discs, 0)
    for i in range(expected.shape[0]):
        if i != own:
            _put(expected[i], discs, count)
            count += expected.shape[1]
    free = min(
        free_ahead(pose, body, margin, reach, corners, first, discs),
        free_ahead(pose, body, keep, reach, robot_corners, robot_first, robot_discs),
    )
    gap = min(
        clearance(pose[0], pose[1], corners, first, discs),
        clearance(pose[0], pose[1], robot_corners, robot_first, robot_discs),
    )
    return free, gap - body


@njit(cache=True)
def _put(some: Array, discs: Array, begin: int) -> None:
    """Write some discs, shape (k, 3), from index ``begin`` on."""
    for i in range(some.shape[0]):
        for k in range(3):
            discs[begin + i, k] = some[i, k]


@njit(cache=True)
def free_ahead(
    pose: Array, body: float, margin: float, reach: float, corners: Array, first: Index, discs: Array
) -> float:
    """Distance [m] that a disc of radius ``body`` can drive straight on with a margin, at most ``reach``.

    An obstacle that is already within the margin does not stop a motion that passes it. One that overlaps the body, now
    or as predicted, stops every motion except one that clearly leads away.
    """
    free = reach
    for i in range(first.shape[0] - 1 + discs.shape[0]):
        free = min(free, _free_of(pose, body, margin, free, i, corners, first, discs))
    return free


@njit(cache=True)
def _gap_to(x: float, y: float, i: int, corners: Array, first: Index, discs: Array) -> float:
    polygons = first.shape[0] - 1
    if i < polygons:
        return polygon_distance(x, y, corners, first[i], first[i + 1])
    k = i - polygons
    return max(0.0, math.hypot(x - discs[k, 0], y - discs[k, 1]) - discs[k, 2])


@njit(cache=True)
def _free_of(
    pose: Array, body: float, margin: float, reach: float, i: int, corners: Array, first: Index, discs: Array
) -> float:
    """`free_ahead` for obstacle i only: a nearer one on another side must not mask it."""
    radius = body + margin
    c, s = math.cos(pose[2]), math.sin(pose[2])
    gap = _gap_to(pose[0], pose[1], i, corners, first, discs)
    least = max(body + _SQUEEZE, min(radius, gap - _SQUEEZE))
    travelled = 0.0
    while travelled < reach and gap - radius < reach - travelled:
        step = min(max(gap - radius, 0.02), reach - travelled)
        ahead = _gap_to(pose[0] + c * (travelled + step), pose[1] + s * (travelled + step), i, corners, first, discs)
        if ahead < body and ahead < gap + _BETTER * (step / 0.02):
            return travelled
        if ahead < least and ahead < gap - _SAME:
            return travelled
        if ahead < radius - _SAME and ahead < gap - _TOWARDS * step:  # otherwise it would creep closer head-on
            return travelled
        travelled += step
        gap = ahead
    return reach


@njit(cache=True)
def way_round(
    start: Array, goal: Array, radius: float, cell: float, window: float, corners: Array, first: Index, discs: Array
) -> Array:
    """Points [m] of a shortest path on a grid for a disc, shape (n, 2); empty when there is none.

    The grid is a square of half width ``window`` about the start; a goal outside is replaced by the free cell nearest
    to it. Dijkstra over eight neighbours; cells left of the line to the goal cost more, so that two agents that meet
    both pass on their right. Near a start within ``radius`` of an obstacle, cells that lead away from it are free, too.
    """
    half = int(window / cell)
    n = 2 * half + 1
    free = free_cells(start, radius, cell, half, corners, first, discs)
    cost = np.full((n, n), np.inf)
    parent = np.full((n, n), -1, dtype=np.int64)
    done = np.zeros((n, n), dtype=np.bool_)
    to_x, to_y = goal[0] - start[0], goal[1] - start[1]
    heap = [(0.0, half * n + half)]
    cost[half, half] = 0.0
    best, best_left = -1, math.hypot(goal[0] - start[0], goal[1] - start[1]) - 2.0 * cell
    best_total = np.inf
    while len(heap) > 0:
        value, node = heapq.heappop(heap)
        i, j = node // n, node % n
        if done[i, j]:
            continue
        done[i, j] = True
        left = math.hypot(goal[0] - start[0] - (i - half) * cell, goal[1] - start[1] - (j - half) * cell)
        total = left + 0.3 * value
        if left < best_left and total < best_total:
            best, best_total = node, total
        if left < cell:
            best = node
            break
        for di in range(-1, 2):
            for dj in range(-1, 2):
                a, b = i + di, j + dj
                if a < 0 or b < 0 or a >= n or b >= n or not free[a, b] or done[a, b]:
                    continue
                left_of_way = (a - half) * -to_y + (b - half) * to_x > 0.0
                new = value + cell * math.sqrt(di * di + dj * dj) * (_LEFT if left_of_way else 1.0)
                if new < cost[a, b]:
                    cost[a, b] = new
                    parent[a, b] = node
                    heapq.heappush(heap, (new, a * n + b))
    count, node = 0, best
    while node >= 0:
        count += 1
        node = parent[node // n, node % n]
    path = np.empty((max(0, count - 1), 2))
    node = best
    for k in range(count - 2, -1, -1):
        path[k, 0] = start[0] + (node // n - half) * cell
        path[k, 1] = start[1] + (node % n - half) * cell
        node = parent[node // n, node % n]
    return path


@njit(cache=True)
def free_cells(
    start: Array, radius: float, cell: float, half: int, corners: Array, first: Index, discs: Array
) -> NDArray[np.bool_]:
    """Cells of the grid of `way_round` that the disc may enter; each obstacle blocks those near it, shape (n, n)."""
    n = 2 * half + 1
    free = np.ones((n, n), dtype=np.bool_)
    here = clearance(start[0], start[1], corners, first, discs)
    polygons = first.shape[0] - 1
    for k in range(polygons + discs.shape[0]):
        if k < polygons:
            x_min, y_min, x_max, y_max = np.inf, np.inf, -np.inf, -np.inf
            for c in range(first[k], first[k + 1]):
                x_min, x_max = min(x_min, corners[c, 0]), max(x_max, corners[c, 0])
                y_min, y_max = min(y_min, corners[c, 1]), max(y_max, corners[c, 1])
        else:
            x, y, r = discs[k - polygons, 0], discs[k - polygons, 1], discs[k - polygons, 2]
            x_min, y_min, x_max, y_max = x - r, y - r, x + r, y + r
        low_i, high_i = _cells(x_min - radius - start[0], x_max + radius - start[0], cell, half)
        low_j, high_j = _cells(y_min - radius - start[1], y_max + radius - start[1], cell, half)
        for i in range(low_i, high_i):
            for j in range(low_j, high_j):
                if free[i, j]:
                    x, y = start[0] + (i - half) * cell, start[1] + (j - half) * cell
                    gap = _gap_to(x, y, k, corners, first, discs)
                    away = math.hypot(x - start[0], y - start[1])
                    free[i, j] = gap >= radius or (away < _NEAR and gap >= here + _AWAY * away)
    return free


@njit(cache=True)
def _cells(low: float, high: float, cell: float, half: int) -> tuple[int, int]:
    """Range of the cells between two coordinates [m] from the start, and one more on either side."""
    first, last = half + math.floor(low / cell) - 1, half + math.ceil(high / cell) + 1
    return min(max(first, 0), 2 * half + 1), min(max(last + 1, 0), 2 * half + 1)
