"""Encounters of a plan with dynamic obstacles, and courtesy: the time [s] that the plan costs them.

The stopping path of a dynamic obstacle is the floor that it sweeps until it can stand. Courtesy is the time that the
footprint spends there, weighted by nearness: 1 right before the obstacle, 0 at the end of its stopping path. Passing
behind costs nothing; cutting in does, and so does standing in a stopping path.
"""

import math
from typing import NamedTuple

import numpy as np

from motm_twin.model.geometry import Array
from motm_twin.model.motion import kernel
from motm_twin.model.scene import AGENT_REACTION, TEMI_ACCELERATION
from motm_twin.planning.collision import Body
from motm_twin.planning.kernels import length_of
from motm_twin.planning.prediction import Spread, gap_to_point, moved_on, probability_taken
from motm_twin.planning.types import Encounter, Passes, Yields

STEP = 0.1  # [s] between two states of a plan
BESIDE = 0.1  # [m] that a dynamic obstacle needs beside its body: nearer than that, one of the two must give way
LOOKS = 6  # samples along a stopping path
CLOSE = 1.0  # [m] encounters with a smaller gap are reported
WORTH = 0.3  # [s] a plan whose cost among dynamic obstacles is at least this is worth another search
AROUND = 0.5  # [m] added to the distance within which a dynamic obstacle can meet the base
TRACK, GOES_ON = 6, 7  # columns: identity of the track; 1: it goes on as predicted, 0: it yields
COURTESY_OF_GOING_ON = 0.2  # share of the courtesy charged for a track that goes on: its risk is charged already


class Weights(NamedTuple):
    """Weights of the cost of a node among dynamic obstacles."""

    risk: float  # [s] of the probability that its place is taken
    courtesy: float  # [s] of its nearness in a stopping path, see `in_the_way`
    spread: Spread


@kernel
def in_the_way(x: float, y: float, c: float, s: float, time: float, mover: Array, body: Body) -> float:
    """Nearness, 0 to 1, of the footprint in the stopping path of a mover (5 or more,) at a pose after a time [s]."""
    speed = length_of(mover[2], mover[3])
    if speed < 1e-3:
        return 0.0
    way = speed * AGENT_REACTION + speed * speed / (2.0 * TEMI_ACCELERATION)
    px, py = mover[0] + time * mover[2], mover[1] + time * mover[3]
    c_x, c_y = x + c * body.centre_x - px, y + s * body.centre_x - py
    if length_of(c_x, c_y) > way + mover[4] + BESIDE + body.outer:
        return 0.0
    if c_x * mover[2] + c_y * mover[3] < 0.0:
        return 0.0  # the mover is past
    for k in range(LOOKS + 1):
        ahead = way * k / LOOKS / speed
        gap = gap_to_point(x, y, c, s, px + ahead * mover[2], py + ahead * mover[3], body) - mover[4]
        if gap < BESIDE:
            return 1.0 - k / (LOOKS + 1)
    return 0.0


@kernel
def cost_among(
    x: float, y: float, c: float, s: float, time: float, others: Array, body: Body, weights: Weights
) -> float:
    """Cost [s] of the footprint at a pose after a time [s] among dynamic obstacles (k, 8), see `others_of`."""
    cost = 0.0
    for k in range(others.shape[0]):
        courtesy = weights.courtesy
        if others[k, GOES_ON] > 0.0:
            cost += weights.risk * probability_taken(x, y, c, s, time, others[k], weights.spread, body)
            courtesy *= COURTESY_OF_GOING_ON
        if courtesy > 0.0:
            cost += courtesy * in_the_way(x, y, c, s, time, others[k], body)
    return cost


def others_of(tracks: Array, yielding: Array, lag: float) -> Array:
    """Moving tracks when the base begins to follow a plan, ``lag`` [s] from now, with their `GOES_ON`, (k, 8).

    ``tracks``: those that go on, ``yielding``: those that brake for the base, (n, 7) each.
    """
    rows = [
        np.column_stack([one, np.full(len(one), goes)])
        for one, goes in ((moved_on(tracks, lag), 1.0), (moved_on(yielding, lag), 0.0))
    ]
    return np.concatenate(rows)


def near(movers: Array, here: Array, horizon: float, speed: float, body: Body) -> Array:
    """Those of the movers (k, 5 or more) that can meet the base within the horizon [s]."""
    apart = np.hypot(movers[:, 0] - here[0], movers[:, 1] - here[1]) - movers[:, 4] - body.reach
    return movers[apart < horizon * (speed + np.hypot(movers[:, 2], movers[:, 3])) + AROUND]


def costs_along(states: Array, times: Array, others: Array, body: Body, weights: Weights) -> Array:
    """Largest `cost_among` on the way to each of the states (n, 3 or more), reached after times [s] (n,); shape (n,).

    ``weights`` are those of a whole node; the first state costs nothing.
    """
    costs = np.zeros(len(states))
    _fill_costs(np.ascontiguousarray(states), times, others, body, weights, costs)
    return costs


@kernel
def _fill_costs(states: Array, times: Array, others: Array, body: Body, weights: Weights, costs: Array) -> None:
    for i in range(1, states.shape[0]):
        for k in range(1, 3):
            part = 0.5 * k
            x = (1.0 - part) * states[i - 1, 0] + part * states[i, 0]
            y = (1.0 - part) * states[i - 1, 1] + part * states[i, 1]
            swing = states[i, 2] - states[i - 1, 2]
            swing -= 2.0 * math.pi * math.floor(swing / (2.0 * math.pi) + 0.5)
            heading = states[i - 1, 2] + part * swing
            time = (1.0 - part) * times[i - 1] + part * times[i]
            cost = cost_among(x, y, math.cos(heading), math.sin(heading), time, others, body, weights)
            costs[i] = max(costs[i], cost)


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

    ``evaded``: encounters of the plan that these states replace; the robot yields to those tracks that it now passes
    at a larger gap.
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
                yields=Yields.ROBOT if gives_way else Yields.OTHER if gap < BESIDE else Yields.NOBODY,
                passes=passes,
                time=float(time),
                gap=float(gap),
                speed=math.hypot(mover[2], mover[3]),
                courtesy=float(courtesy),
            )
        )
    found.sort(key=lambda other: (other.time, other.track))
    return tuple(found)
