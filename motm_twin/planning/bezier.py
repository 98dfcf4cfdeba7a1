"""Bezier heuristic: time of a smooth curve from pose to pose (Paper, Sec. III-E)."""

import math

import numpy as np

from motm_twin.model.geometry import Array
from motm_twin.planning.kernel import kernel, length_of
from motm_twin.planning.rtr import turn


@kernel
def bezier_points(
    x: float, y: float, heading: float, gx: float, gy: float, goal_heading: float, offset: float, points: Array
) -> None:
    """Fill `points`, shape (n, 2) [m], with the cubic curve between two poses.

    Control points lie ahead of the start and behind the goal, at ``offset`` times the straight distance.
    """
    reach = offset * length_of(gx - x, gy - y)
    x1, y1 = x + reach * math.cos(heading), y + reach * math.sin(heading)
    x2, y2 = gx - reach * math.cos(goal_heading), gy - reach * math.sin(goal_heading)
    last = points.shape[0] - 1
    for i in range(last + 1):
        t = i / last
        s = 1.0 - t
        b0, b1, b2, b3 = s * s * s, 3.0 * s * s * t, 3.0 * s * t * t, t * t * t
        points[i, 0] = b0 * x + b1 * x1 + b2 * x2 + b3 * gx
        points[i, 1] = b0 * y + b1 * y1 + b2 * y2 + b3 * gy


def bezier_curve(start: Array, goal: Array, *, offset: float = 0.25, samples: int = 16) -> Array:
    """The cubic curve between two poses (3,), shape (samples + 1, 2) [m]."""
    points = np.empty((samples + 1, 2))
    x, y, heading = (float(value) for value in start)
    bezier_points(x, y, heading, float(goal[0]), float(goal[1]), float(goal[2]), offset, points)
    return points


@kernel
def curve_length(points: Array) -> float:
    """Length [m] of sampled points, shape (n, 2)."""
    total = 0.0
    for i in range(1, points.shape[0]):
        total += length_of(points[i, 0] - points[i - 1, 0], points[i, 1] - points[i - 1, 1])
    return total


@kernel
def curve_time(
    points: Array, heading: float, goal_heading: float, v_f: float, w_max: float, limit: float = math.inf
) -> float:
    """Time [s] of a sampled curve: integral of the slower of driving (ds / v_f) and turning (d theta / w_max).

    Equals length / v_f where the curve is gentle, as in the paper's figure, and is not optimistic in tight bends.
    The directions at both ends are the headings there. Any number that is not below ``limit`` once it can not be.
    """
    n = points.shape[0]
    total = 0.0
    for i in range(1, n):
        total += length_of(points[i, 0] - points[i - 1, 0], points[i, 1] - points[i - 1, 1]) / v_f
    if total >= limit:  # turning only adds to it
        return total
    total = 0.0
    before = heading
    for i in range(1, n):
        dx, dy = points[i, 0] - points[i - 1, 0], points[i, 1] - points[i - 1, 1]
        step = length_of(dx, dy)
        if i == n - 1:
            after = goal_heading
        elif step > 1e-9:
            after = math.atan2(points[i + 1, 1] - points[i - 1, 1], points[i + 1, 0] - points[i - 1, 0])
        else:
            after = before
        total += max(step / v_f, turn(before, after) / w_max)
        before = after
        if total >= limit:
            return total
    return total
