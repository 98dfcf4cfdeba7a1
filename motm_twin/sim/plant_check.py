"""Whether the plant keeps its own promises: limits of speed and acceleration, no teleporting."""

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from motm_twin.model.geometry import Array, wrap_angle
from motm_twin.model.joint_limits import DDQ_MAX, DQ_MAX, Q_MAX, Q_MIN
from motm_twin.model.profile import RobotProfile

if TYPE_CHECKING:
    from motm_twin.sim.referee import World

SLACK = 1e-6  # by which a limit may be exceeded
OBJECT_JUMP = 0.08  # [m] per substep that only a teleported object moves


@dataclass
class PlantCheckState:
    """The substep before."""

    pose: Array
    twist: Array  # forward speed and yaw rate, shape (2,)
    q: Array
    dq: Array
    objects: Array  # positions, shape (n, 3)
    faults: dict[str, str] = field(default_factory=dict)  # kind: first occurrence


class PlantCheck:
    """Compares consecutive substeps, from positions as well as from reported rates."""

    def __init__(self, profile: RobotProfile, dt: float) -> None:
        """Limits of the profile; substeps of dt [s]."""
        self.limits = profile.base
        self.dt = dt

    def start(self, world: "World") -> PlantCheckState:
        """State before the first substep."""
        return PlantCheckState(
            world.pose.copy(), world.twist.copy(), world.q.copy(), world.dq.copy(), _positions(world)
        )

    def step(self, state: PlantCheckState, world: "World") -> None:
        """Compare with the substep before and go on."""
        self._base(state, world)
        self._arm(state, world)
        objects = _positions(world)
        if len(objects) and np.max(np.abs(objects - state.objects)) > OBJECT_JUMP:
            self._fault(state, world, "object teleported", float(np.max(np.abs(objects - state.objects))))
        state.pose, state.twist, state.q, state.dq = world.pose, world.twist, world.q, world.dq
        state.objects = objects

    def _base(self, state: PlantCheckState, world: "World") -> None:
        limits, dt = self.limits, self.dt
        v, w = (float(value) for value in world.twist)
        old_v, old_w = (float(value) for value in state.twist)
        self._limit(state, world, "forward speed", v, limits.forward_speed)
        self._limit(state, world, "reverse speed", -v, limits.reverse_speed)
        self._limit(state, world, "yaw rate", abs(w), limits.yaw_rate)
        self._limit(state, world, "linear acceleration", abs(v - old_v) / dt, limits.linear_acceleration)
        self._limit(state, world, "yaw acceleration", abs(w - old_w) / dt, limits.yaw_acceleration)
        dx, dy = (float(value) for value in world.pose[:2] - state.pose[:2])
        turned = wrap_angle(float(world.pose[2] - state.pose[2]))
        middle = float(state.pose[2]) + 0.5 * turned
        self._limit(state, world, "base moved further than its speed", math.hypot(dx, dy), max(abs(v), abs(old_v)) * dt)
        sideways = abs(-math.sin(middle) * dx + math.cos(middle) * dy)
        self._limit(state, world, "base moved sideways", sideways, 0.0)
        self._limit(state, world, "base turned further than its rate", abs(turned), max(abs(w), abs(old_w)) * dt)

    def _arm(self, state: PlantCheckState, world: "World") -> None:
        dt = self.dt
        worst = float(np.max(np.maximum(world.q - Q_MAX, Q_MIN - world.q)))
        self._limit(state, world, "joint position", worst, 0.0)
        self._limit(state, world, "joint speed", float(np.max(np.abs(world.dq) - DQ_MAX)), 0.0)
        self._limit(state, world, "joint acceleration", float(np.max(np.abs(world.dq - state.dq) / dt - DDQ_MAX)), 0.0)
        allowed = np.maximum(np.abs(world.dq), np.abs(state.dq)) * dt
        self._limit(
            state, world, "joint moved further than its speed", float(np.max(np.abs(world.q - state.q) - allowed)), 0.0
        )

    def _limit(self, state: PlantCheckState, world: "World", kind: str, value: float, limit: float) -> None:
        if not value <= limit + SLACK:
            self._fault(state, world, kind, value - limit)

    @staticmethod
    def _fault(state: PlantCheckState, world: "World", kind: str, value: float) -> None:
        state.faults.setdefault(kind, f"{world.time:.2f} s: {kind} by {value:.3g}")


def _positions(world: "World") -> Array:
    return np.array([item.position for item in world.objects], dtype=float).reshape(-1, 3)
