"""Bezier heuristic: time of a smooth curve from pose to pose (Paper, Sec. III-E)."""

import math

import numpy as np

from motm_twin.model.geometry import Array
from motm_twin.model.motion import kernel
from motm_twin.planning.kernels import length_of
from motm_twin.planning.rtr import turn

ROUNDING = 1e-9  # [s] in sums of times


def bernstein(samples: int) -> Array:
    """Weights of the four control points at each point of a sampled cubic curve, shape (samples + 1, 4)."""
    rows = []
    for i in range(samples + 1):
        t = i / samples
        s = 1.0 - t
        rows.append((s * s * s, 3.0 * s * s * t, 3.0 * s * t * t, t * t * t))
    return np.array(rows)


@kernel
def bezier_points(
    x: float, y: float, c: float, s: float, gx: float, gy: float, goal_c: float, goal_s: float, offset: float,
    weights: Array, points: Array,
) -> None:  # fmt: skip
    """Fill `points`, shape (n, 2) [m], with the cubic curve between two poses; c, s: cosine and sine of their headings.

    Control points lie ahead of the start and behind the goal, at ``offset`` times the straight distance.
    """
    reach = offset * length_of(gx - x, gy - y)
    x1, y1 = x + reach * c, y + reach * s
    x2, y2 = gx - reach * goal_c, gy - reach * goal_s
    for i in range(points.shape[0]):
        b0, b1, b2, b3 = weights[i, 0], weights[i, 1], weights[i, 2], weights[i, 3]
        points[i, 0] = b0 * x + b1 * x1 + b2 * x2 + b3 * gx
        points[i, 1] = b0 * y + b1 * y1 + b2 * y2 + b3 * gy


@kernel
def _between(start: Array, goal: Array, offset: float, weights: Array, points: Array) -> None:
    c, s, goal_c, goal_s = math.cos(start[2]), math.sin(start[2]), math.cos(goal[2]), math.sin(goal[2])
    bezier_points(start[0], start[1], c, s, goal[0], goal[1], goal_c, goal_s, offset, weights, points)


def bezier_curve(start: Array, goal: Array, *, offset: float = 0.25, samples: int = 16) -> Array:
    """The cubic curve between two poses (3,), shape (samples + 1, 2) [m]."""
    points = np.empty((samples + 1, 2))
    ends = np.array([start, goal], dtype=np.float64)
    _between(ends[0], ends[1], offset, bernstein(samples), points)
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
    The directions at both ends are the headings there. Once the time cannot be below ``limit``, ``limit`` is returned.
    """
    c, s, goal_c, goal_s = math.cos(heading), math.sin(heading), math.cos(goal_heading), math.sin(goal_heading)
    return time_below(points, heading, c, s, goal_heading, goal_c, goal_s, v_f, w_max, limit)


@kernel
def time_below(
    points: Array, heading: float, c: float, s: float, goal_heading: float, goal_c: float, goal_s: float, v_f: float,
    w_max: float, limit: float,
) -> float:  # fmt: skip
    """`curve_time` for headings whose cosines c and sines s are known.

    Gentle pieces need no angle: with u the direction before and w the one after, turn <= |u x w| / (u . w).
    """
    n = points.shape[0]
    rest = curve_length(points) / v_f  # turning only adds to it
    if rest - ROUNDING >= limit:
        return limit
    total = 0.0
    before, before_x, before_y = heading, c, s
    for i in range(1, n):
        step = length_of(points[i, 0] - points[i - 1, 0], points[i, 1] - points[i - 1, 1])
        after, after_x, after_y = math.nan, before_x, before_y  # an angle of nan: not computed yet
        if i == n - 1:
            after, after_x, after_y = goal_heading, goal_c, goal_s
        elif step > 1e-9:
            after_x, after_y = points[i + 1, 0] - points[i - 1, 0], points[i + 1, 1] - points[i - 1, 1]
        else:
            after = before
        drive = step / v_f
        spent = drive
        cross, dot = abs(before_x * after_y - before_y * after_x), before_x * after_x + before_y * after_y
        if not cross < 0.999 * drive * w_max * dot:
            if math.isnan(before):
                before = math.atan2(before_y, before_x)
            if math.isnan(after):
                after = math.atan2(after_y, after_x)
            spent = max(drive, turn(before, after) / w_max)
        total += spent
        rest -= drive
        if total + rest - ROUNDING >= limit:
            return limit
        before, before_x, before_y = after, after_x, after_y
    return total
