"""Agents by optimal reciprocal collision avoidance (van den Berg et al., Reciprocal n-Body Collision Avoidance, 2011).

Each takes half of the way out of every velocity that leads to a contact within the time horizon, and trusts the others
to take the other half. The simulator of `pyrvo` (extra "people") is built anew at every look, so it has no state.
"""

import math
from importlib import import_module
from importlib.util import find_spec
from typing import Any

import numpy as np

from motm_twin.model.geometry import Array
from motm_twin.model.scene_error import SceneError
from motm_twin.sim.crowd import Crowd

NEIGHBOURS_WITHIN, NEIGHBOURS = 10.0, 10  # [m], and at most so many: those of CrowdNav (Chen et al., 2019)
HORIZON = 5.0  # [s] the same
SPACE = 0.01  # [m] of radius besides: the same
WALL_HORIZON = 1.0  # [s] for what stands: more makes narrow ways impassable (a choice of this project)
STEP = 0.05  # [s] after which overlapping bodies are to be apart
CORNERS = 12  # of the polygon round a disc that stands


def require_pyrvo() -> None:
    """Raise SceneError without pyrvo."""
    if find_spec("pyrvo") is None:
        raise SceneError('agents and methods by ORCA need pyrvo: pip install "motm_twin[people]"')


def orca(crowd: Crowd) -> Array:
    """Velocity [m/s] that each agent chooses, shape (n, 2)."""
    chosen = np.zeros_like(crowd.preferred)
    for sees in (True, False):
        if (of := crowd.sees_robot == sees).any():
            chosen[of] = _choices(crowd, with_robot=sees and crowd.robot.seen)[of]
    return chosen


def _choices(crowd: Crowd, *, with_robot: bool) -> Array:
    """Velocities when all see the robot, or none."""
    sim: Any = import_module("pyrvo").RVOSimulator()
    sim.set_time_step(STEP)
    own = zip(crowd.positions, crowd.velocities, crowd.radii, crowd.speeds, crowd.preferred, strict=True)
    for position, velocity, radius, speed, preferred in own:
        _add(sim, position, velocity, radius, speed)
        sim.set_agent_pref_velocity(sim.get_num_agents() - 1, tuple(preferred.tolist()))
    if with_robot:
        speed = math.hypot(*crowd.robot.velocity)
        for *middle, radius in crowd.robot.round().tolist():
            _add(sim, np.array(middle), np.array(crowd.robot.velocity), radius, speed)
    for i in range(len(crowd.obstacles.first) - 1):
        sim.add_obstacle([tuple(corner) for corner in crowd.obstacles.polygon(i).tolist()])
    angles = [2.0 * math.pi * i / CORNERS for i in range(CORNERS)]
    for x, y, radius in crowd.obstacles.discs.tolist():
        sim.add_obstacle([(x + radius * math.cos(angle), y + radius * math.sin(angle)) for angle in angles])
    sim.process_obstacles()
    sim.do_step()
    found = [sim.get_agent_velocity(i) for i in range(len(crowd.positions))]
    return np.array([(velocity.x, velocity.y) for velocity in found])


def _add(sim: Any, position: Array, velocity: Array, radius: float, speed: float) -> None:
    limits = NEIGHBOURS_WITHIN, NEIGHBOURS, HORIZON, WALL_HORIZON, radius + SPACE, speed
    sim.add_agent(tuple(position.tolist()), *limits, tuple(velocity.tolist()))
