"""Cutting in: the robot moves into the area that an agent needs to stop. A contact that follows is the robot's.

The area is what the agent sweeps going straight on until it stands: as wide and tall as it is, and v t + v^2 / 2a long.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import coal
import numpy as np

from motm_twin.model.geometry import Array, about_z
from motm_twin.model.plant import CutIn
from motm_twin.model.scene import AGENT_MOVES, AGENT_REACTION
from motm_twin.sim.agents import AgentState
from motm_twin.sim.referee_geometry import RobotShapes
from motm_twin.sim.responsibility import Gauge

DEEPER = 0.02  # [m] into the area at the agent's last chance to stop that takes this chance away
PARTED = 1.0  # [s] outside the area after which a new entry counts separately
LOOKS = 5  # substeps between two looks
_UPRIGHT = np.eye(3)


class Area(NamedTuple):
    """Position x, y [m] and course [rad] of an agent, and its stopping distance [m]."""

    x: float
    y: float
    course: float
    way: float


class InWay(NamedTuple):
    """The robot in an agent's stopping area."""

    cut_in: bool  # by its own motion
    last: float  # [s] when it was seen there
    chance: Area  # the area when the robot entered: the agent's travel, had it braked then
    depth: float  # [m] of the robot in that area then


def stopping_way(speed: float, braking: float) -> float:
    """Way [m] of an agent from a speed [m/s] to rest: reaction, and braking [m/s^2]."""
    return speed * AGENT_REACTION + speed * speed / (2.0 * braking)


def cuts_in(ways: dict[str, InWay], agent: str, now: float) -> bool:
    """The robot has cut in on this agent, and is still in its way or was just now."""
    way = ways.get(agent)
    return way is not None and way.cut_in and now - way.last <= PARTED


class StoppingAreas:
    """Looks for the robot in the stopping areas of all agents."""

    def __init__(self, robot: RobotShapes) -> None:
        self._robot = robot
        offsets = np.sqrt((robot.centres[:-1] ** 2).sum(axis=1))
        self._reach = offsets + robot.radii[:-1]  # [m] of each part from its frame
        self._gauge = Gauge()
        self._here, self._there = coal.Transform3s(), coal.Transform3s()

    def look(
        self, ways: dict[str, InWay], agents: Sequence[AgentState], now: float, placed: Array, before: Array | None
    ) -> list[CutIn]:
        """Update the agents that have the robot in their way; returns the cut-ins that begin now [s].

        Transforms of the robot's shapes now and at the last look, shape (n, 4, 4); None: what it did since is not its
        own motion. The robot cuts in when it moves into the area, or into what was the area when the agent came near.
        """
        found = []
        for agent in agents:
            name, known = agent.agent.name, ways.get(agent.agent.name)
            if known is not None and now - known.last > PARTED:
                del ways[name]
                known = None
            if agent.v < AGENT_MOVES:
                continue
            x, y, course = agent.pose.tolist()
            area = Area(x, y, course, stopping_way(agent.v, agent.agent.acceleration))
            depth = self._depth(agent, area, placed)
            if depth <= 0.0:
                continue
            if known is None:
                own = before is not None and self._depth(agent, area, before) <= 0.0
                known = InWay(own, now, area, depth)
            else:
                own = not known.cut_in and self._depth(agent, known.chance, placed) > known.depth + DEEPER
                known = known._replace(cut_in=known.cut_in or own, last=now)
            if own:
                gap = self._gap(agent, placed)
                found.append(CutIn(time=now, agent=name, gap=gap, stopping_way=area.way, speed=agent.v))
            ways[name] = known
        return found

    def _depth(self, agent: AgentState, area: Area, placed: Array) -> float:
        """Depth [m] of the robot in an area of this agent; 0 outside."""
        radius, height = agent.agent.radius, agent.agent.height
        c, s = math.cos(area.course), math.sin(area.course)
        near = self._near(placed, (area.x, area.y, c, s), area.way + radius, radius)
        if not near:
            return 0.0
        turn = about_z(area.course)
        middle = np.array([area.x + 0.5 * area.way * c, area.y + 0.5 * area.way * s, 0.5 * height])
        end = np.array([area.x + area.way * c, area.y + area.way * s, 0.5 * height])
        strip, cap = coal.Box(area.way, 2.0 * radius, height), coal.Cylinder(radius, height)
        deepest = 0.0
        for i in near:
            self._here.setTransform(placed[i, :3, :3], placed[i, :3, 3])
            for shape, rotation, place in ((strip, turn, middle), (cap, _UPRIGHT, end)):
                self._there.setTransform(rotation, place)
                deepest = max(deepest, -self._distance(i, shape))
        return deepest

    def _near(self, placed: Array, line: tuple[float, float, float, float], way: float, radius: float) -> list[int]:
        """Parts of the robot that may reach an area ``way`` long and twice ``radius`` wide [m].

        It begins at x, y and leads along a course, given by its cosine and sine.
        """
        x, y, c, s = line
        dx, dy = placed[:-1, 0, 3] - x, placed[:-1, 1, 3] - y
        along, aside = c * dx + s * dy, np.abs(c * dy - s * dx)
        reach = self._reach
        return np.flatnonzero((along > -reach) & (along < way + reach) & (aside < radius + reach)).tolist()

    def _gap(self, agent: AgentState, placed: Array) -> float:
        """Distance [m] between agent and robot, 0 when they touch."""
        x, y, _ = agent.pose.tolist()
        body = coal.Cylinder(agent.agent.radius, agent.agent.height)
        least = math.inf
        self._there.setTransform(_UPRIGHT, np.array([x, y, 0.5 * agent.agent.height]))
        for i in range(len(self._reach)):
            self._here.setTransform(placed[i, :3, :3], placed[i, :3, 3])
            least = min(least, self._distance(i, body))
        return max(0.0, least)

    def _distance(self, i: int, other: coal.CollisionGeometry) -> float:
        return self._gauge((self._robot.shapes[i], self._here), (other, self._there))
