"""A run among people: distances, time to collision, discomfort, freezing, and who made way in each conflict.

Measures of the field of social navigation: the comfort distance is that of CrowdNav (Chen et al., 2019); who made way
is told by counterfactuals: each of the two alone keeps to the motion that it had when the conflict began.
"""

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from motm_twin.measures.agents import CONFLICT, FAR, HORIZON, Body, base_gap, body_of, predicted_gap
from motm_twin.measures.interval import Interval, finite
from motm_twin.model.compiler import njit
from motm_twin.model.geometry import Array
from motm_twin.model.motion import arc
from motm_twin.model.scene import Scene

DISCOMFORT = 0.2  # [m] gap below which somebody feels uneasy (CrowdNav)
COLLISION_WITHIN, COLLISION_STEP = 5.0, 0.05  # [s] ahead that a collision is looked for at constant velocities
CLEAR_SHARE = 2.0 / 3.0  # of the gap gained, from which on one of the two made way
GAINED = 0.05  # [m] by both together, below which nobody did


@njit(cache=True)
def time_to_collision(body: Body, pose: Array, twist: tuple[float, float], agent: Array, radius: float) -> float:
    """Time [s] until base and agent touch at constant velocities; inf beyond 5 s.

    ``agent``: x, y, and its velocity, shape (4,).
    """
    v, w = twist
    for i in range(round(COLLISION_WITHIN / COLLISION_STEP) + 1):
        time = i * COLLISION_STEP
        there = arc(pose[0], pose[1], pose[2], v, w, time)
        if base_gap(body, there, agent[0] + time * agent[2], agent[1] + time * agent[3], radius) <= 0.0:
            return time
    return np.inf


def compile_meetings() -> None:
    """Compile now, not at the first meeting."""
    time_to_collision((0.0, 1.0, 1.0), np.zeros(3), (0.1, 0.1), np.ones(4), 0.1)


@dataclass
class _Conflict:
    """Base and agent that would have come too close, had both kept their motion of ``time``."""

    time: float
    pose: Array
    twist: tuple[float, float]
    agent: Array  # x, y, and its velocity, shape (4,)
    predicted: float  # [m] gap
    actual: float = math.inf  # [m] gap since then
    robot_alone: float = math.inf  # [m] the same, had the agent kept its motion
    agent_alone: float = math.inf  # [m] the same, had the base kept its motion

    def add(self, body: Body, time: float, pose: Array, agent: tuple[float, float, float]) -> None:
        """Take the place of both into account."""
        (x, y, radius), since = agent, time - self.time
        kept_x, kept_y = (self.agent[:2] + since * self.agent[2:]).tolist()
        kept = np.array(arc(*self.pose.tolist(), *self.twist, since))
        self.actual = min(self.actual, base_gap(body, pose, x, y, radius))
        self.robot_alone = min(self.robot_alone, base_gap(body, pose, kept_x, kept_y, radius))
        self.agent_alone = min(self.agent_alone, base_gap(body, kept, x, y, radius))

    def report(self, name: str) -> dict[str, Any]:
        """The conflict with the gaps [m] that each of the two gained by its change of motion, and who made way."""
        robot, agent = (max(0.0, gap - self.predicted) for gap in (self.robot_alone, self.agent_alone))
        whole = robot + agent
        if whole < GAINED:
            who = "nobody"
        elif robot >= CLEAR_SHARE * whole:
            who = "robot"
        else:
            who = "agent" if agent >= CLEAR_SHARE * whole else "both"
        return {
            "time": round(self.time, 2),
            "agent": name,
            "predicted_gap_m": round(self.predicted, 3),
            "gap_m": round(self.actual, 3),
            "gained_by_robot_m": round(robot, 3),
            "gained_by_agent_m": round(agent, 3),
            "made_way": who,
        }


@dataclass
class AmongPeople:
    """Measures of a base among agents; add every interval of a run in order.

    A conflict begins when at constant velocities the gap would fall below 0.30 m within 2 s, and lasts these 2 s. Base
    freezing: it stands while a place to drive to is not reached, or for another reason than its arm.
    """

    scene: Scene
    conflicts: list[dict[str, Any]] = field(default_factory=list)
    _open: dict[str, _Conflict] = field(default_factory=dict)
    _least_gap: float = math.inf
    _least_time: float = math.inf
    _discomfort: float = 0.0
    _freezing: float = 0.0

    def __post_init__(self) -> None:
        self._body = body_of(self.scene.robot.footprint)

    def add(self, interval: Interval, *, waits_for_arm: bool) -> None:
        """Take an interval into account."""
        start, tick = interval.start, interval.tick
        drives = tick.task_index < len(tick.tasks) and tick.tasks[tick.task_index].kind == "drive_to"
        if not tick.done and not interval.moving and (drives or not waits_for_arm):
            self._freezing += interval.dt
        uneasy = False
        for name, (x, y, radius) in start.agents.items():
            gap = base_gap(self._body, start.pose, x, y, radius)
            self._least_gap = min(self._least_gap, gap)
            uneasy = uneasy or gap < DISCOMFORT
            self._conflict(interval, name)
            if gap > FAR:
                continue
            agent = np.array([x, y, *interval.velocity(name).tolist()])
            time = time_to_collision(self._body, start.pose, interval.twist, agent, radius)
            self._least_time = min(self._least_time, time)
        self._discomfort += interval.dt * uneasy

    def _conflict(self, interval: Interval, name: str) -> None:
        """Begin, follow or end the conflict with an agent."""
        start, known = interval.start, self._open.get(name)
        x, y, radius = start.agents[name]
        if known is not None:
            known.add(self._body, start.time, start.pose, start.agents[name])
            if start.time - known.time >= HORIZON - 1e-9:
                self.conflicts.append(self._open.pop(name).report(name))
            return
        if math.hypot(x - start.pose[0], y - start.pose[1]) > FAR:
            return
        agent = np.array([x, y, *interval.velocity(name).tolist()])
        moves = interval.moving or math.hypot(*agent[2:]) > 0.0
        gap = predicted_gap(self._body, start.pose, interval.twist, agent, radius)
        if moves and gap < CONFLICT:
            found = _Conflict(start.time, start.pose, interval.twist, agent, gap)
            found.add(self._body, start.time, start.pose, start.agents[name])
            self._open[name] = found

    def report(self) -> dict[str, Any]:
        """Least gap [m] and time to collision [s] (None: never within 5 s), seconds of discomfort and freezing."""
        going_on = [conflict.report(name) for name, conflict in self._open.items()]
        return {
            "least_gap_m": finite(self._least_gap, 3),
            "least_time_to_collision_s": finite(self._least_time, 3),
            "discomfort_s": round(self._discomfort, 2),
            "freezing_s": round(self._freezing, 2),
            "conflicts": [*self.conflicts, *going_on],
        }
