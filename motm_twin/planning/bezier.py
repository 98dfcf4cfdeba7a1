"""Bezier heuristic: time of a smooth curve from pose to pose (Paper, Sec. III-E)."""

import math

import numpy as np
from numba import njit

from motm_twin.model.geometry import Array
from motm_twin.planning.rtr import turn


@njit(cache=True)
def bezier_curve(
    x: float, y: float, heading: float, gx: float, gy: float, goal_heading: float, offset: float, samples: int
) -> Array:
    """Points of the cubic curve, shape (samples + 1, 2) [m].

    Control points lie ahead of the start and behind the goal, at ``offset`` times the straight distance.
    """
    reach = offset * math.hypot(gx - x, gy - y)
    x1, y1 = x + reach * math.cos(heading), y + reach * math.sin(heading)
    x2, y2 = gx - reach * math.cos(goal_heading), gy - reach * math.sin(goal_heading)
    points = np.empty((samples + 1, 2))
    for i in range(samples + 1):
        t = i / samples
        s = 1.0 - t
        b0, b1, b2, b3 = s * s * s, 3.0 * s * s * t, 3.0 * s * t * t, t * t * t
        points[i, 0] = b0 * x + b1 * x1 + b2 * x2 + b3 * gx
        points[i, 1] = b0 * y + b1 * y1 + b2 * y2 + b3 * gy
    return points


@njit(cache=True)
def curve_length(points: Array) -> float:
    """Length [m] of sampled points, shape (n, 2)."""
    total = 0.0
    for i in range(1, points.shape[0]):
        total += math.hypot(points[i, 0] - points[i - 1, 0], points[i, 1] - points[i - 1, 1])
    return total


@njit(cache=True)
def curve_time(points: Array, heading: float, goal_heading: float, v_f: float, w_max: float) -> float:
    """Time [s] of a sampled curve: integral of the slower of driving (ds / v_f) and turning (d theta / w_max).

    Equals length / v_f where the curve is gentle, as in the paper's figure, and is not optimistic in tight bends.
    The directions at both ends are the headings there.
    """
    total = 0.0
    n = points.shape[0]
    before = heading
    for i in range(1, n):
        dx, dy = points[i, 0] - points[i - 1, 0], points[i, 1] - points[i - 1, 1]
        step = math.hypot(dx, dy)
        if i == n - 1:
            after = goal_heading
        elif step > 1e-9:
            after = math.atan2(points[i + 1, 1] - points[i - 1, 1], points[i + 1, 0] - points[i - 1, 0])
        else:
            after = before
        total += max(step / v_f, turn(before, after) / w_max)
        before = after
    return total
