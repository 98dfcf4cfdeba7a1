"""Waiting for dynamic obstacles to pass: the path is kept, and driven later.

The best delay has the least sum of the delay itself and of the cost of encounters while the base stands and then drives
along the path. A base that cannot pass in front of a dynamic obstacle stands until it can pass behind.
"""

import math
from typing import NamedTuple

import numpy as np

from motm_twin.model.geometry import Array
from motm_twin.model.motion import kernel
from motm_twin.model.profile import BaseLimits
from motm_twin.planning.collision import Body
from motm_twin.planning.encounters import Weights, cost_among
from motm_twin.planning.parameters import StaaParameters
from motm_twin.planning.prediction import LONGEST, WAIT_STEP

LOOK = StaaParameters().node_duration  # [s] between samples
AHEAD = 4.0  # [s] of driving along the path, after the delay, that are judged


class Wait(NamedTuple):
    """A delay, and its extra cost over driving at once without any dynamic obstacle."""

    delay: float  # [s]
    cost: float  # [s], the delay included
    track: int  # row of the dynamic obstacle that the base waits for; -1: none


class Among(NamedTuple):
    """Dynamic obstacles and the weights of their costs."""

    others: Array  # the moving ones, (k, 8), see `others_of`
    body: Body
    weights: Weights


def best_wait(state: Array, path: Array, limits: BaseLimits, among: Among, begins: float = 0.0) -> Wait:
    """The best delay of a base in a state x, y, heading, v, w that follows a path (n, 2) [m] from ``begins`` [s] on."""
    steps = np.hypot(*np.diff(path, axis=0).T) if len(path) > 1 else np.zeros(0)
    steps, kept = steps[steps > 1e-6], np.concatenate(([True], steps > 1e-6))
    path, length = path[kept], np.concatenate(([0.0], np.cumsum(steps)))
    v, a, top = abs(float(state[3])), limits.linear_acceleration, limits.forward_speed
    times = np.arange(1, round(AHEAD / LOOK) + 1) * LOOK
    stands = min(0.5 * v * v / a, float(length[-1]))
    going = _along(path, length, gone(v, top, a, times))
    after_stop = _along(path, length, stands + gone(0.0, top, a, times))
    here = np.array([*(np.interp(stands, length, column) for column in path.T), state[2]])
    best = Wait(0.0, _cost(here, *going, begins + times, 0.0, *among), -1)
    for delay in np.arange(WAIT_STEP, LONGEST + 0.5 * WAIT_STEP, WAIT_STEP).tolist():
        again = 0.5 * top / a  # [s] lost by setting off
        cost = delay + again + _cost(here, *after_stop, begins + times, delay, *among)
        if cost < best.cost:
            best = Wait(delay, cost, 0)
    if best.delay == 0.0:
        return best
    return best._replace(track=int(_whom(*going, begins + times, *among)))


def gone(speed: float, top: float, acceleration: float, times: Array) -> Array:
    """Distances [m] driven after times [s] by a base that speeds up to its top speed [m/s], at [m/s^2]."""
    until = (top - speed) / acceleration  # [s]
    speeding = np.minimum(times, until)
    return speed * speeding + 0.5 * acceleration * speeding**2 + top * np.maximum(0.0, times - until)


def _along(path: Array, length: Array, gone: Array) -> tuple[Array, Array]:
    """Places (m, 2) and directions (m, 2) on a path (n, 2) of lengths (n,) [m] so far, after distances (m,) [m]."""
    at = np.minimum(gone, length[-1])
    places = np.column_stack([np.interp(at, length, column) for column in path.T])
    if len(path) < 2:
        return places, np.tile([1.0, 0.0], (len(at), 1))
    leg = np.clip(np.searchsorted(length, at) - 1, 0, len(path) - 2)
    return places, np.diff(path, axis=0)[leg] / np.diff(length)[leg][:, None]


@kernel
def _cost(
    here: Array, places: Array, way: Array, times: Array, delay: float, others: Array, body: Body, weights: Weights
) -> float:
    cost, c, s = 0.0, math.cos(here[2]), math.sin(here[2])
    begins = times[0] - LOOK
    for i in range(int(delay / LOOK)):
        cost += cost_among(here[0], here[1], c, s, begins + (i + 1) * LOOK, others, body, weights)
    for i in range(times.shape[0]):
        cost += cost_among(places[i, 0], places[i, 1], way[i, 0], way[i, 1], delay + times[i], others, body, weights)
    return cost


@kernel
def _whom(places: Array, way: Array, times: Array, others: Array, body: Body, weights: Weights) -> int:
    """Row of the dynamic obstacle that costs most without a delay."""
    worst, most = -1, 0.0
    for k in range(others.shape[0]):
        cost = 0.0
        for i in range(times.shape[0]):
            x, y, c, s = places[i, 0], places[i, 1], way[i, 0], way[i, 1]
            cost += cost_among(x, y, c, s, times[i], others[k : k + 1], body, weights)
        if cost > most:
            worst, most = k, cost
    return worst
