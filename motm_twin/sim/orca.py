"""Agents by optimal reciprocal collision avoidance; without state, since the neighbours are gathered at every look."""

import math

import numpy as np

from motm_twin.model.geometry import Array
from motm_twin.model.rvo import Neighbours
from motm_twin.sim.crowd import Crowd

STEP = 0.05  # [s] after which overlapping bodies are to be apart: a look


def orca(crowd: Crowd) -> Array:
    """Velocity [m/s] that each agent chooses, shape (n, 2)."""
    chosen = np.zeros_like(crowd.preferred)
    for sees in (True, False):
        if (of := crowd.sees_robot == sees).any():
            chosen[of] = _choices(crowd, with_robot=sees and crowd.robot.seen)[of]
    return chosen


def _choices(crowd: Crowd, *, with_robot: bool) -> Array:
    """Velocities when all see the robot, or none."""
    around = Neighbours(STEP)
    bodies = (crowd.positions, crowd.velocities, crowd.radii, crowd.speeds, crowd.preferred)
    for position, velocity, radius, speed, preferred in zip(*(part.tolist() for part in bodies), strict=True):
        around.prefer(around.add(position, velocity, radius, speed), preferred)
    if with_robot:
        speed = math.hypot(*crowd.robot.velocity)
        for x, y, radius in crowd.robot.round().tolist():
            around.add((x, y), crowd.robot.velocity, radius, speed)
    walls = crowd.obstacles
    around.stand((walls.polygon(i) for i in range(len(walls.first) - 1)), walls.discs.tolist())
    return around.chosen(len(crowd.positions))
