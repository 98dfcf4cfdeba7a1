"""Thrown bodies: they slide over the floor with friction, until they stop or meet something.

A body stops short of furniture and of other bodies. It stops where it has touched the robot, so that the referee sees
the contact. Nothing is pushed.
"""

import math
from collections.abc import Sequence

import numpy as np

from motm_twin.model.geometry import Array
from motm_twin.model.scene import Point
from motm_twin.sim.agents import AgentState
from motm_twin.sim.bodies import Outline
from motm_twin.sim.overlap import entered, gaps
from motm_twin.sim.solids import Solids

FRICTION = 2.0  # [m/s^2] by which a sliding body gets slower
FASTEST = 3.0  # [m/s] of a throw; what is thrown faster is slowed to this
ARM_RADIUS = 0.055  # [m] of the arm as something a sliding body meets
STRIDE = 0.002  # [m] between two looks for what a sliding body meets


class Obstruction:
    """What a body of some height can meet: polygons first, then discs, by name."""

    def __init__(self, solids: Solids, agents: Sequence[AgentState], *, height: float, without: str = "") -> None:
        """Solids and agents below ``height`` [m], except the one that is called ``without``."""
        low = solids.below(height)
        discs = [[s.pose[0], s.pose[1], s.agent.radius] for s in agents]
        self.names = (*low.names, *low.disc_names, *(s.agent.name for s in agents))
        self._own = np.array([name == without for name in self.names], dtype=bool)
        self._world = (low.corners, low.first, np.vstack([low.discs, np.array(discs, dtype=float).reshape(-1, 3)]))

    def gaps(self, body: Outline) -> Array:
        """Gap [m] to each of `names`; infinite to the body itself."""
        found = gaps(body.corners, body.radius, *self._world)
        found[self._own] = math.inf
        return found

    def entered(self, body: Outline, ways: Sequence[Array]) -> tuple[int, str]:
        """How many of the ways [m] (each from the start) are free one after the other, and what the next one enters."""
        before = self.gaps(body)
        for count, way in enumerate(ways):
            after = self.gaps(body.shifted(way))
            hit = entered(before, after)
            if len(hit) > 0:
                return count, self.names[int(hit[np.argmin(after[hit])])]
            before = after
        return len(ways), ""


class RobotObstruction:
    """The robot as a sliding body meets it: its base as it is, its arm as balls along its links."""

    def __init__(self, base: Array, joints: Array) -> None:
        """Corners of the base (4, 2), and the places of the arm's frames one after the other [m], shape (n, 3)."""
        self._base = base
        between = [joints[:-1] + share * (joints[1:] - joints[:-1]) for share in (0.0, 1 / 3, 2 / 3)]
        self._balls = np.vstack([*between, joints[-1:]])

    def gaps(self, body: Outline) -> Array:
        """Gap [m] to the base, then to each ball that is not above the body."""
        low = self._balls[self._balls[:, 2] - ARM_RADIUS < body.height]
        discs = np.column_stack([low[:, :2], np.full(len(low), ARM_RADIUS)])
        return gaps(body.corners, body.radius, self._base, np.array([0, 4], dtype=np.int64), discs)

    def touched(self, body: Outline, ways: Sequence[Array]) -> tuple[int, bool]:
        """How many of the ways are gone until the body has touched the robot, and whether it has."""
        before = self.gaps(body)
        for count, way in enumerate(ways):
            after = self.gaps(body.shifted(way))
            if len(entered(before, after)) > 0:
                return count + 1, True
            before = after
        return len(ways), False


def slide(
    body: Outline, velocity: Point, world: Obstruction, robot: RobotObstruction, dt: float
) -> tuple[Array, Point]:
    """The way [m] that a sliding body goes in a substep, shape (2,), and its velocity [m/s] at the end."""
    speed = math.hypot(*velocity)
    later = max(0.0, speed - FRICTION * dt)
    way = 0.5 * (speed + later) * dt * np.array(velocity) / speed
    strides = max(1, math.ceil(math.hypot(*way) / STRIDE))
    ways = [way * (k + 1) / strides for k in range(strides)]
    free, _ = world.entered(body, ways)
    gone, touched = robot.touched(body, ways[:free])
    if gone < strides or touched or later == 0.0:
        return (ways[gone - 1] if gone else np.zeros(2)), (0.0, 0.0)
    return way, (velocity[0] * later / speed, velocity[1] * later / speed)
