"""RTR and PathRTR: time to rotate, translate and rotate along a path (STAA*; Paper, Sec. III-B and III-E)."""

import math

import numpy as np

from motm_twin.model.geometry import Array
from motm_twin.model.motion import kernel

TWO_PI = 2.0 * math.pi


@kernel
def turn(angle_from: float, angle_to: float) -> float:
    """Smallest rotation [rad] between two directions, 0 .. pi."""
    difference = abs(angle_to - angle_from)
    if difference >= TWO_PI:  # seldom, and a division takes longer than all the rest
        difference -= TWO_PI * math.floor(difference / TWO_PI)
    return TWO_PI - difference if difference > math.pi else difference


@kernel
def path_rtr_both(
    path: Array, heading: float, goal_heading: float, v_f: float, v_r: float, w_max: float
) -> tuple[float, float]:
    """Times [s] of a path driven forwards and in reverse: h_front, h_back.

    path: shape (n, 2) [m]; headings [rad], a goal heading of nan is free; v_f, v_r [m/s], w_max [rad/s]. A base
    with a v_r of 0 cannot reverse.
    """
    length, bends = 0.0, 0.0
    first, last = math.nan, math.nan
    for i in range(1, path.shape[0]):
        dx, dy = path[i, 0] - path[i - 1, 0], path[i, 1] - path[i - 1, 1]
        step = math.hypot(dx, dy)
        if step < 1e-9:
            continue
        direction = math.atan2(dy, dx)
        if math.isnan(first):
            first = direction
        else:
            bends += turn(last, direction)
        last = direction
        length += step
    if math.isnan(first):
        spin = 0.0 if math.isnan(goal_heading) else turn(heading, goal_heading) / w_max
        return spin, spin
    a_0 = turn(heading, first)
    a_g = 0.0 if math.isnan(goal_heading) else turn(last, goal_heading)
    a_g_back = 0.0 if math.isnan(goal_heading) else math.pi - a_g
    front = (a_0 + bends + a_g) / w_max + length / v_f
    back = (math.pi - a_0 + bends + a_g_back) / w_max + (length / v_r if v_r > 0.0 else math.inf)
    return front, back


def path_rtr(path: Array, heading: float, goal_heading: float | None, *, v_f: float, v_r: float, w_max: float) -> float:
    """PathRTR [s] = min(h_front, h_back) of a path of shape (n, 2) [m]; a goal heading of None is free."""
    goal = math.nan if goal_heading is None else goal_heading
    return min(path_rtr_both(np.asarray(path, dtype=np.float64), heading, goal, v_f, v_r, w_max))
