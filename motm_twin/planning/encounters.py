"""Encounters of a plan with dynamic obstacles, and courtesy: what the plan costs the others, in seconds.

Everybody needs the way ahead that it sweeps until it can stand. Courtesy is the time that the footprint spends in
there, weighted by nearness: 1 right before somebody, 0 at the end of its stopping way. Passing behind costs nothing,
cutting in does, and so does standing where somebody has to pass.
"""

import math

from motm_twin.model.geometry import Array
from motm_twin.model.motion import kernel
from motm_twin.planning.collision import Body
from motm_twin.planning.kernels import length_of
from motm_twin.planning.prediction import gap_to_point
from motm_twin.planning.types import Encounter, Passes, Yields

STEP = 0.1  # [s] between two states of a plan
REACTION, BRAKING = 1.0, 0.5  # [s], [m/s^2] of others: their stopping way (`sim/cut_in.py` counts by the same)
BESIDE = 0.1  # [m] beside its body that somebody needs, too
LOOKS = 6  # along a stopping way
CLOSE = 1.0  # [m] nearer than which an encounter is told
MEETS = 0.1  # [m] nearer than which somebody has to give way
TRACK = 6  # column of the identity


@kernel
def in_the_way(x: float, y: float, c: float, s: float, time: float, mover: Array, body: Body) -> float:
    """Share of the stopping way of a mover (5 or more,) that the footprint takes at a pose after a time [s]."""
    speed = length_of(mover[2], mover[3])
    if speed < 1e-3:
        return 0.0
    way = speed * REACTION + speed * speed / (2.0 * BRAKING)
    px, py = mover[0] + time * mover[2], mover[1] + time * mover[3]
    c_x, c_y = x + c * body.centre_x - px, y + s * body.centre_x - py
    if length_of(c_x, c_y) > way + mover[4] + BESIDE + body.outer:
        return 0.0
    if c_x * mover[2] + c_y * mover[3] < 0.0:
        return 0.0  # it is past
    for k in range(LOOKS + 1):
        ahead = way * k / LOOKS / speed
        gap = gap_to_point(x, y, c, s, px + ahead * mover[2], py + ahead * mover[3], body) - mover[4]
        if gap < BESIDE:
            return 1.0 - k / (LOOKS + 1)
    return 0.0


@kernel
def _met(states: Array, mover: Array, body: Body) -> tuple[float, float, float, int]:
    """Time [s] and gap [m] of the nearest approach, courtesy [s], and the side: -1 behind, 1 in front, 0 neither.

    ``states``: x, y, heading, ... every `STEP`, shape (n, 3 or more).
    """
    speed = max(length_of(mover[2], mover[3]), 1e-3)
    least, when, courtesy, side, before = math.inf, 0.0, 0.0, 0, 0.0
    for i in range(states.shape[0]):
        time, c, s = i * STEP, math.cos(states[i, 2]), math.sin(states[i, 2])
        x, y = states[i, 0], states[i, 1]
        gap = gap_to_point(x, y, c, s, mover[0] + time * mover[2], mover[1] + time * mover[3], body) - mover[4]
        if gap < least:
            least, when = gap, time
        courtesy += STEP * in_the_way(x, y, c, s, time, mover, body)
        dx, dy = x + c * body.centre_x - mover[0], y + s * body.centre_x - mover[1]
        across = (mover[2] * dy - mover[3] * dx) / speed
        if side == 0 and i > 0 and across * before < 0.0:
            side = 1 if (mover[2] * dx + mover[3] * dy) / speed > time * speed else -1
        before = across
    return when, least, courtesy, side


def encounters(states: Array, movers: Array, body: Body, evaded: tuple[Encounter, ...] = ()) -> tuple[Encounter, ...]:
    """Encounters of states (n, 3 or more) every `STEP` with tracks (k, 7), the soonest first.

    ``evaded``: encounters of the plan in whose stead these states are driven; the robot yields to those that are
    farther from it now.
    """
    before = {other.track: other for other in evaded}
    found: list[Encounter] = []
    for mover in movers:
        time, gap, courtesy, side = _met(states, mover, body)
        passes = Passes.IN_FRONT if side > 0 else Passes.BEHIND if side < 0 else Passes.NEITHER
        old = before.get(int(mover[TRACK]))
        yielded = old is not None and old.yields == Yields.OTHER and gap > old.gap
        if gap > CLOSE and passes == Passes.NEITHER and not yielded:
            continue
        gives_way = yielded or passes == Passes.BEHIND
        found.append(
            Encounter(
                track=int(mover[TRACK]),
                yields=Yields.ROBOT if gives_way else Yields.OTHER if gap < MEETS else Yields.NOBODY,
                passes=passes,
                time=float(time),
                gap=float(gap),
                speed=math.hypot(mover[2], mover[3]),
                courtesy=float(courtesy),
            )
        )
    found.sort(key=lambda other: (other.time, other.track))
    return tuple(found)
