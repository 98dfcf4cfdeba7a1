"""Prediction of dynamic obstacles while a plan is carried out.

STAA* predicts them as discs that keep their velocity for 1 s of its search and stand after that. The paper predicts
nothing (Sec. VIII, "Obstacle Motion Prediction"). A method with foresight asks for the probability that a place is
taken at a time: each obstacle goes straight on, within an ellipse that grows, more along its way than across.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from motm_twin.model.geometry import Array, frozen
from motm_twin.model.motion import kernel
from motm_twin.model.scene import AGENT_MOVES
from motm_twin.planning.collision import Body
from motm_twin.planning.kernels import length_of

GOES = AGENT_MOVES  # slower tracks are obstacles at their present place
WAIT_STEP, LONGEST = 0.5, 6.0  # [s] between two waiting times, and the longest: no prediction reaches beyond it
STARTS = 0.5  # [m/s] faster tracks are under way: they do not start to walk
HIDES = 0.25  # [m] least radius of a dynamic obstacle: a part of it may be hidden
FARTHEST = 3.0  # standard deviations beyond which no dynamic obstacle is expected
SHOWN = 2.0  # standard deviations that an ellipse holds: 95 % along either axis


class Spread(NamedTuple):
    """Growth rates [m/s] of the standard deviation of a predicted position, and the room that is kept [m]."""

    along: float = 0.08  # along the path: from errors of speed
    across: float = 0.06  # across the path: from errors of direction
    starts: float = 0.20  # added to both while a track stands and may start to walk; less the faster it is
    room: float = 0.05


SPREAD = Spread()
NOBODY = np.zeros((1, 0, 3))
NOBODY.setflags(write=False)


def expected(movers: Array, step: float, horizon: float) -> Array:
    """Discs x, y, radius [m] of dynamic obstacles every half ``step`` [s] until ``horizon`` [s], shape (n, k, 3).

    Read-only. ``movers``: x, y [m], velocity [m/s], radius [m], shape (k, 5) or more. The last discs are those at
    the horizon itself.
    """
    if horizon <= 0.0 or not len(movers):
        return NOBODY
    times = np.minimum(0.5 * step * np.arange(2 * math.ceil(horizon / step - 1e-9) + 1), horizon)
    places = movers[None, :, :2] + times[:, None, None] * movers[None, :, 2:4]
    return frozen(np.concatenate((places, np.broadcast_to(movers[None, :, 4:5], (*places.shape[:2], 1))), axis=2))


@kernel
def at_half_steps(count: int, moving: Array) -> int:
    """Row of `expected` after ``count`` half steps."""
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
    return max(0.0, signed_gap(x, y, c, s, px, py, body))


@kernel
def signed_gap(x: float, y: float, c: float, s: float, px: float, py: float, body: Body) -> float:
    """Distance [m] from the footprint at a pose to a point; inside it negative, to the nearest side."""
    half_l, half_w = body.corner[3, 0] - body.centre_x, body.corner[3, 1]
    dx, dy = px - x, py - y
    along, across = abs(c * dx + s * dy - body.centre_x) - half_l, abs(c * dy - s * dx) - half_w
    if along < 0.0 and across < 0.0:
        return max(along, across)
    return length_of(max(0.0, along), max(0.0, across))


@kernel
def way_to(x: float, y: float, discs: Array) -> float:
    """Distance [m] from a point to the nearest disc (k, 3), not less than 0; inf if there is no disc."""
    least = math.inf
    for i in range(discs.shape[0]):
        least = min(least, length_of(discs[i, 0] - x, discs[i, 1] - y) - discs[i, 2])
    return max(0.0, least)


def ellipses(track: Array, times: Sequence[float]) -> Array:
    """Ellipses that hold a track (8,) after each time [s], shape (n, 6).

    Rows: time, x, y, half axes along and across its way [m], direction of the way [rad].
    """
    x, y, vx, vy, radius, sd = (float(value) for value in track[:6])
    way, more = math.atan2(vy, vx), may_start(math.hypot(vx, vy), SPREAD)
    rates = (SPREAD.along + more, SPREAD.across + more)
    rows = [(t, x + t * vx, y + t * vy, *(radius + SHOWN * grown(sd, rate, t) for rate in rates), way) for t in times]
    return np.array(rows).reshape(-1, 6)


def moved_on(tracks: Array, lag: float) -> Array:
    """The moving tracks of (k, 7), predicted ``lag`` [s] ahead, when the base begins to follow a plan."""
    going = tracks[np.hypot(tracks[:, 2], tracks[:, 3]) >= GOES].copy()
    going[:, :2] += lag * going[:, 2:4]
    going[:, 4] = np.maximum(going[:, 4], HIDES)
    return going


@kernel
def may_start(speed: float, spread: Spread) -> float:
    """Addition [m/s] to both growth rates for a track at a speed [m/s] that may start to walk."""
    return spread.starts * max(0.0, 1.0 - speed / STARTS)


@kernel
def grown(sd: float, rate: float, time: float) -> float:
    """Standard deviation [m] of a place after a time [s], ``sd`` now."""
    return math.sqrt(sd * sd + (rate * time) * (rate * time))


@kernel
def probability_taken(
    x: float, y: float, c: float, s: float, time: float, mover: Array, spread: Spread, body: Body
) -> float:
    """Probability that a mover (6 or more,) is nearer than ``spread.room`` to the footprint at a pose after a time [s].

    c, s: cosine and sine of the heading. The position error of the mover is normal along the line to the base, and
    the footprint counts as a wall across that line.
    """
    px, py = mover[0] + time * mover[2], mover[1] + time * mover[3]
    speed, dx, dy = length_of(mover[2], mover[3]), x + c * body.centre_x - px, y + s * body.centre_x - py
    away = length_of(dx, dy)
    ahead = (mover[2] * dx + mover[3] * dy) / (speed * away) if speed * away > 1e-6 else 0.0
    more = may_start(speed, spread)
    along, across = grown(mover[5], spread.along + more, time), grown(mover[5], spread.across + more, time)
    sd = max(1e-3, math.sqrt((ahead * along) ** 2 + (1.0 - ahead * ahead) * across * across))
    if away > body.outer + mover[4] + spread.room + FARTHEST * sd:
        return 0.0
    gap = signed_gap(x, y, c, s, px, py, body) - mover[4] - spread.room
    return 0.5 * math.erfc(gap / (sd * math.sqrt(2.0)))
