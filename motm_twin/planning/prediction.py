"""Prediction of dynamic obstacles while a plan is carried out: discs on their course, as long as is asked for.

STAA* expects obstacles to go on as they do for 1 s of its search, and to stand after that. The paper expects nothing
(Sec. VIII, "Obstacle Motion Prediction").
"""

import math

import numpy as np

from motm_twin.model.geometry import Array
from motm_twin.model.motion import kernel
from motm_twin.planning.collision import Body
from motm_twin.planning.kernels import length_of

NOBODY = np.zeros((1, 0, 3))
NOBODY.setflags(write=False)


def expected(movers: Array, step: float, horizon: float) -> Array:
    """Discs x, y, radius [m] of what moves every half ``step`` [s] until ``horizon`` [s], shape (n, k, 3).

    ``movers``: x, y [m], velocity [m/s], radius [m] in the columns, shape (k, 5) or more. The last discs are those of
    the horizon itself.
    """
    if horizon <= 0.0 or not len(movers):
        return NOBODY.copy()
    times = np.minimum(0.5 * step * np.arange(2 * math.ceil(horizon / step - 1e-9) + 1), horizon)
    places = movers[None, :, :2] + times[:, None, None] * movers[None, :, 2:4]
    return np.concatenate((places, np.broadcast_to(movers[None, :, 4:5], (*places.shape[:2], 1))), axis=2)


@kernel
def at_half_steps(count: int, moving: Array) -> int:
    """Row of `expected` after so many half steps."""
    return min(count, moving.shape[0] - 1)


@kernel
def gap_to(x: float, y: float, c: float, s: float, discs: Array, body: Body) -> float:
    """Distance [m] from the footprint at a pose to the nearest disc (k, 3); c, s: cosine and sine of its heading.

    Negative: the disc reaches that far into the footprint, at most its radius.
    """
    least = math.inf
    for i in range(discs.shape[0]):
        least = min(least, gap_to_point(x, y, c, s, discs[i, 0], discs[i, 1], body) - discs[i, 2])
    return least


@kernel
def gap_to_point(x: float, y: float, c: float, s: float, px: float, py: float, body: Body) -> float:
    """Distance [m] from the footprint at a pose to a point; 0 inside."""
    half_l, half_w = body.corner[3, 0] - body.centre_x, body.corner[3, 1]
    dx, dy = px - x, py - y
    along, across = abs(c * dx + s * dy - body.centre_x), abs(c * dy - s * dx)
    return length_of(max(0.0, along - half_l), max(0.0, across - half_w))


@kernel
def way_to(x: float, y: float, discs: Array) -> float:
    """Distance [m] from a point to the nearest disc (k, 3), not less than 0; inf: there is none."""
    least = math.inf
    for i in range(discs.shape[0]):
        least = min(least, length_of(discs[i, 0] - x, discs[i, 1] - y) - discs[i, 2])
    return max(0.0, least)
