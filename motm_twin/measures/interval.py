"""The interval between two Ticks: the decision at its start, and all motion until its end.

A Tick holds the decisions at its time, and the truth at the end of its period. So the truth at the time of a Tick is
in the Tick before; for the first one it is the start of the scene.
"""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from motm_twin.control.tick import Tick
from motm_twin.model.geometry import Array, wrap_angle
from motm_twin.model.kinematics import Frankie
from motm_twin.model.scene import Scene

STANDS = 0.02  # [m/s] up to which a base or agent counts as standing
STANDS_TURNING = math.radians(2.0)  # [rad/s] the same for its yaw rate


@dataclass(frozen=True, kw_only=True)
class Sample:
    """The true state at the time of a Tick."""

    time: float  # [s]
    pose: Array  # base, world frame, shape (3,)
    mount: Array  # [m] foot of the arm, world frame, shape (2,)
    gripper: Array  # [m] gripper centre, world frame, shape (2,)
    ee_obstacle: float  # [m] from the gripper centre to the nearest unmapped body; inf without one
    agents: dict[str, tuple[float, float, float]]  # x, y, radius [m]
    tick: Tick


@dataclass(frozen=True, kw_only=True)
class Interval:
    """From one Tick to the next."""

    start: Sample
    end: Sample

    @cached_property
    def dt(self) -> float:
        """Length [s]."""
        return self.end.time - self.start.time

    @property
    def tick(self) -> Tick:
        """Tick at its start."""
        return self.start.tick

    @cached_property
    def path(self) -> float:
        """Distance [m] that the base drove."""
        return float(np.hypot(*(self.end.pose[:2] - self.start.pose[:2])))

    @cached_property
    def twist(self) -> tuple[float, float]:
        """Mean forward speed [m/s], negative in reverse, and yaw rate [rad/s] of the base."""
        (x, y, heading), (end_x, end_y, end_heading) = self.start.pose.tolist(), self.end.pose.tolist()
        turned = wrap_angle(end_heading - heading)
        heading += 0.5 * turned
        forward = (end_x - x) * math.cos(heading) + (end_y - y) * math.sin(heading)
        return forward / self.dt, turned / self.dt

    @property
    def moving(self) -> bool:
        """True while the base moves."""
        v, w = self.twist
        return abs(v) > STANDS or abs(w) > STANDS_TURNING

    def velocity(self, agent: str) -> Array:
        """Mean velocity [m/s] of an agent, world frame, shape (2,)."""
        if agent not in self.start.agents or agent not in self.end.agents:
            return np.zeros(2)
        return np.subtract(self.end.agents[agent][:2], self.start.agents[agent][:2]) / self.dt

    @cached_property
    def gripper_velocity(self) -> Array:
        """Mean velocity [m/s] of the gripper centre, world frame, shape (2,)."""
        return (self.end.gripper - self.start.gripper) / self.dt


def finite(value: float, digits: int) -> float | None:
    """The number, rounded to ``digits`` decimals; None for infinity, which JSON lacks."""
    return round(value, digits) if math.isfinite(value) else None


class Sampler:
    """Makes samples, and intervals from consecutive samples."""

    def __init__(self, scene: Scene) -> None:
        self._scene = scene
        self._robot = Frankie(scene.robot)
        self._last: Sample | None = None

    def interval(self, tick: Tick) -> Interval | None:
        """The interval that ends at this Tick; None for the first one."""
        before = self._last
        self._last = self._sample(tick, before)
        if before is None or self._last.time <= before.time:
            return None
        return Interval(start=before, end=self._last)

    def _sample(self, tick: Tick, before: Sample | None) -> Sample:
        truth = before.tick.truth if before is not None else None
        agents = {agent.name: (*agent.start[:2], agent.radius) for agent in self._scene.agents}
        pose, distance = np.array(self._scene.start), math.inf
        if truth is not None:
            agents = {agent.name: (*agent.position[:2], 0.5 * agent.size[0]) for agent in truth.agents}
            pose, distance = truth.pose, truth.ee_obstacle
        return Sample(
            time=tick.time, pose=pose, mount=self._robot.mount_transform(pose)[:2, 3],
            gripper=self._robot.tcp_pose(pose, tick.observation.q)[0][:2], ee_obstacle=distance, agents=agents,
            tick=tick,
        )  # fmt: skip
