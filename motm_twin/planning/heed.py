"""Expectation of who goes on though the robot is in the way: those whom the base has to make way for.

Those who yield brake in time, and making way for them too only costs time: for them a plan is as without foresight.
Whoever is quick needs a long way to stop, and is not relied upon; nobody is, for a while after somebody has come so
near at speed that it could no longer brake before the base. Speeds count once they were kept for a while: as somebody
comes out from behind another, its middle jumps.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from motm_twin.model.geometry import Array
from motm_twin.model.known import KnownWorld
from motm_twin.model.state import Stateful
from motm_twin.perception.tracks import PACE
from motm_twin.planning.collision import Body, body_of
from motm_twin.planning.parameters import HeedParameters
from motm_twin.planning.prediction import GOES, gap_to
from motm_twin.planning.types import BaseProblem


@dataclass
class HeedState:
    """State between periods."""

    wary_until: float = -math.inf  # [s]


class Others(NamedTuple):
    """Tracks (k, 8) of those who move, by what is expected of them."""

    go_on: Array
    yields: Array
    wary: bool  # nobody is expected to yield


class Heed(Stateful[HeedState]):
    """Learns whether the others yield."""

    def __init__(self, known: KnownWorld, parameters: HeedParameters | None = None) -> None:
        """Nobody has failed to yield yet."""
        self._p, self._body = parameters or HeedParameters(), body_of(known.robot.footprint)
        self._state = HeedState()

    def of(self, problem: BaseProblem) -> Others:
        """The others of this period."""
        p, state, tracks = self._p, self._state, problem.world.tracks
        speed = np.hypot(tracks[:, 2], tracks[:, 3])
        moves = speed >= GOES
        if cannot_brake(problem.pose, tracks[moves], p.brakes, self._body):
            state.wary_until = problem.time + p.wary_for
        wary = problem.time < state.wary_until
        go_on = moves & (wary | (tracks[:, PACE] >= p.quick))
        return Others(tracks[go_on], tracks[moves & ~go_on], wary)


def cannot_brake(pose: Array, movers: Array, deceleration: float, body: Body) -> bool:
    """Something drives at the base and is too near to brake before it at a deceleration [m/s^2]."""
    for x, y, vx, vy, radius, _, _, pace in movers:
        speed = math.hypot(vx, vy)
        way = min(speed, pace) ** 2 / (2.0 * deceleration)
        c, s = math.cos(pose[2]), math.sin(pose[2])
        now = gap_to(pose[0], pose[1], c, s, np.array([[x, y, radius]]), body)
        there = np.array([[x + way * vx / speed, y + way * vy / speed, radius]])
        if 0.0 < now and gap_to(pose[0], pose[1], c, s, there, body) < 0.0:
            return True
    return False
