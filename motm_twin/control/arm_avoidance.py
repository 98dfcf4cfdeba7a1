"""Arm obstacle avoidance (Paper, Sec. V): the gripper's speed towards what the lidar sees outside the map is limited.

    approach speed  <=  xi (d - d_s) / (d_i - d_s)      for d < d_i, horizontal distance d

As printed in the paper the line reads as a bound of d-dot; it must bound the approach, -d-dot. Below d_s it asks the
gripper to retreat. The line goes on beyond d_i, as an allowance above xi: where it began only at d_i, a hand that
swings at 1 m/s was 0.4 m/s over it. For what moves it counts from where the obstacle may begin within its cell.

A static obstacle (occupied for 3 s, at rest for 12 s if it was seen to move) close to the target would forbid the
grasp, so its d_s shrinks to the target's distance to it less a margin, from the approach until the gripper is d_s away
again. A moving one keeps d_s.

Nobody knows how tall it is: as long as the gripper must retreat from something, it may not sink (`speed_limits.py`).
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from motm_twin.control.nearest_first import nearest_first
from motm_twin.control.parameters import AvoidanceParameters, Numbers
from motm_twin.model.geometry import Array

_LINK = 0.16  # [m] cells nearer than this belong to one obstacle
_NEAR = 1.2  # [m] from gripper or target beyond which cells do not matter


class LidarLimits(NamedTuple):
    """Directions in which the gripper is limited now, by what moves and by what does not; all arrays of length k."""

    normal: Array  # horizontal unit vectors towards the obstacle, shape (k, 2)
    distance: Array  # [m]
    d_s: Array  # [m]
    allowed: Array  # [m/s] damper line
    static: NDArray[np.bool_]


def damper_line(d: float, d_s: float, d_i: float, xi: float) -> float:
    """Allowed approach speed [m/s] at distance d [m]; infinite from d_i on, negative below d_s."""
    if d >= d_i:
        return math.inf
    return xi * (d - d_s) / (d_i - d_s)


def static_d_s(target_distance: float, parameters: AvoidanceParameters) -> float:
    """d_s of a static obstacle during a grasp at ``target_distance`` [m] from it."""
    return max(0.0, min(parameters.d_s, target_distance - parameters.static_margin))


@njit(cache=True)
def lidar_limits(
    gripper: Array, points: Array, static: NDArray[np.bool_], targets: Array, avoidance: Numbers
) -> LidarLimits:
    """The nearest moving and the nearest static point of each sector round the gripper, with d_s and damper line.

    ``points`` (m, 2) [m] and ``static`` (m,) as in `ArmObstacles`. ``targets`` (t, 2) [m]: grasps that are under way,
    for which static obstacles give way.
    """
    a = avoidance[0]
    count = 0
    near = np.empty(points.shape)
    standing = np.empty(points.shape[0], dtype=np.bool_)
    if a.enabled:
        for i in range(points.shape[0]):
            if _near(points[i], gripper, targets):
                near[count, 0], near[count, 1], standing[count] = points[i, 0], points[i, 1], static[i]
                count += 1
    if count == 0:
        none = np.empty(0)
        return LidarLimits(near[:0], none, none, none, standing[:0])
    d_s = np.full(count, a.d_s)
    if targets.shape[0]:
        distances = np.full(count, np.inf)
        label_target_distance(near[:count], standing[:count], targets, _LINK, distances)
        for i in range(count):
            d_s[i] = max(0.0, min(d_s[i], distances[i] - a.static_margin))
    seen, still = near[:count], standing[:count]
    reach, x, y = a.d_i + a.lead, gripper[0], gripper[1]
    picked = np.concatenate((
        _nearest_per_sector(seen, ~still, reach, x, y, a.moving_sectors),
        _nearest_per_sector(seen, still, reach, x, y, a.sectors),
    ))  # fmt: skip
    normal, distance = np.empty((len(picked), 2)), np.empty(len(picked))
    chosen, allowed = np.empty(len(picked)), np.empty(len(picked))
    for k in range(len(picked)):
        i = picked[k]
        dx, dy = near[i, 0] - gripper[0], near[i, 1] - gripper[1]
        distance[k], chosen[k] = math.hypot(dx, dy), d_s[i]
        normal[k, 0], normal[k, 1] = dx / max(distance[k], 1e-6), dy / max(distance[k], 1e-6)
        room = distance[k] - (0.0 if standing[i] else a.moving_margin)
        allowed[k] = a.xi * (room - chosen[k]) / (a.d_i - chosen[k])
    return LidarLimits(normal, distance, chosen, allowed, standing[picked])


@njit(cache=True)
def nearest_distance(gripper: Array, points: Array) -> float:
    """Horizontal distance [m] of the gripper centre to the nearest seen point, inf when there is none."""
    nearest = math.inf
    for i in range(points.shape[0]):
        dx, dy = points[i, 0] - gripper[0], points[i, 1] - gripper[1]
        nearest = min(nearest, dx * dx + dy * dy)
    return math.sqrt(nearest)


@njit(cache=True)
def nearest_static(gripper: Array, points: Array, static: NDArray[np.bool_]) -> float:
    """The same to the nearest static one."""
    nearest = math.inf
    for i in range(points.shape[0]):
        if static[i]:
            nearest = min(nearest, math.hypot(points[i, 0] - gripper[0], points[i, 1] - gripper[1]))
    return nearest


@njit(cache=True)
def _near(point: Array, gripper: Array, targets: Array) -> bool:
    """Whether a point is where it may matter to the gripper or to a grasp."""
    dx, dy = point[0] - gripper[0], point[1] - gripper[1]
    if dx * dx + dy * dy < _NEAR * _NEAR:
        return True
    for t in range(targets.shape[0]):
        dx, dy = point[0] - targets[t, 0], point[1] - targets[t, 1]
        if dx * dx + dy * dy < _NEAR * _NEAR:
            return True
    return False


@njit(cache=True)
def label_target_distance(points: Array, static: NDArray[np.bool_], targets: Array, link: float, out: Array) -> None:
    """For each static cell, the distance of its whole obstacle to the nearest target; others keep what they have.

    Static cells less than ``link`` apart are one obstacle.
    """
    count = points.shape[0]
    label = np.full(count, -1, dtype=np.int64)
    stack = np.empty(count, dtype=np.int64)
    members = np.empty(count, dtype=np.int64)
    for seed in range(count):
        if label[seed] >= 0 or not static[seed]:
            continue
        label[seed] = seed
        stack[0] = seed
        size, found = 1, 0
        nearest = np.inf
        while size:
            size -= 1
            i = stack[size]
            members[found] = i
            found += 1
            for t in range(targets.shape[0]):
                nearest = min(nearest, math.hypot(points[i, 0] - targets[t, 0], points[i, 1] - targets[t, 1]))
            for j in range(count):
                if label[j] < 0 and static[j]:
                    dx, dy = points[i, 0] - points[j, 0], points[i, 1] - points[j, 1]
                    if dx * dx + dy * dy < link * link:
                        label[j] = seed
                        stack[size] = j
                        size += 1
        for k in range(found):
            out[members[k]] = nearest


@njit(cache=True)
def _nearest_per_sector(
    points: Array, of_kind: NDArray[np.bool_], reach: float, x: float, y: float, sectors: int
) -> NDArray[np.int64]:
    """Of the points of that kind the nearest in each sector, within reach, nearest first."""
    best = np.full(sectors, np.inf)
    index = np.full(sectors, -1, dtype=np.int64)
    for i in range(points.shape[0]):
        dx, dy = points[i, 0] - x, points[i, 1] - y
        if not of_kind[i] or dx * dx + dy * dy >= reach * reach:
            continue
        d = math.sqrt(dx * dx + dy * dy)
        sector = int((math.atan2(dy, dx) + math.pi) / (2.0 * math.pi) * sectors) % sectors
        if d < best[sector]:
            best[sector], index[sector] = d, i
    return index[nearest_first(best)]
