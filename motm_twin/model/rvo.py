"""Optimal reciprocal collision avoidance (ORCA) by `pyrvo`, extra "people", for agents and for a method.

van den Berg, Guy, Lin and Manocha, Reciprocal n-Body Collision Avoidance (2011): each body makes half of the change
that avoids a contact within the time horizon, and trusts the others to make the other half.
"""

import math
from collections.abc import Iterable, Sequence
from importlib import import_module
from importlib.util import find_spec
from typing import Any

import numpy as np

from motm_twin.model.geometry import Array

NEIGHBOURS_WITHIN, NEIGHBOURS = 10.0, 10  # [m], and at most this number: those of CrowdNav (Chen et al., 2019)
HORIZON = 5.0  # [s] of CrowdNav
SPACE = 0.01  # [m] added to each radius, as in CrowdNav
WALL_HORIZON = 1.0  # [s] for static obstacles: more makes narrow passages impassable (a choice of this project)
CORNERS = 12  # of the polygon that stands for a static disc


def require_pyrvo(error: type[ValueError]) -> None:
    """Raise this error if pyrvo is not installed."""
    if find_spec("pyrvo") is None:
        raise error('ORCA needs pyrvo: pip install "motm_twin[people]"')


class Neighbours:
    """Bodies and walls at one instant; made anew for every choice, so that nothing is remembered."""

    def __init__(self, step: float) -> None:
        """``step`` [s]: time within which overlapping bodies must separate."""
        self._sim: Any = import_module("pyrvo").RVOSimulator()
        self._sim.set_time_step(step)
        self._count = 0

    def add(self, position: Sequence[float], velocity: Sequence[float], radius: float, speed: float) -> int:
        """Add a body with a largest ``speed`` [m/s]; returns its number."""
        limits = NEIGHBOURS_WITHIN, NEIGHBOURS, HORIZON, WALL_HORIZON, radius + SPACE, speed
        self._sim.add_agent((position[0], position[1]), *limits, (velocity[0], velocity[1]))
        self._count += 1
        return self._count - 1

    def prefer(self, number: int, velocity: Sequence[float]) -> None:
        """Set the velocity [m/s] that a body would have alone."""
        self._sim.set_agent_pref_velocity(number, (velocity[0], velocity[1]))

    def stand(self, polygons: Iterable[Array], discs: Iterable[Sequence[float]] = ()) -> None:
        """Add walls: outlines (k, 2), counter-clockwise, and discs x, y, radius; all at once."""
        for corners in polygons:
            self._sim.add_obstacle([tuple(corner) for corner in corners.tolist()])
        angles = [2.0 * math.pi * i / CORNERS for i in range(CORNERS)]
        for x, y, radius in discs:
            self._sim.add_obstacle([(x + radius * math.cos(a), y + radius * math.sin(a)) for a in angles])
        self._sim.process_obstacles()

    def chosen(self, count: int) -> Array:
        """Velocities [m/s] that the first ``count`` bodies choose, shape (count, 2)."""
        self._sim.do_step()
        found = (self._sim.get_agent_velocity(number) for number in range(count))
        return np.array([(velocity.x, velocity.y) for velocity in found]).reshape(-1, 2)
