"""The arm: joint rates with lag, limits on position, speed and acceleration."""

from dataclasses import dataclass

import numpy as np

from motm_twin.model.geometry import Array
from motm_twin.model.joint_limits import DDQ_MAX, DQ_MAX, Q_MAX, Q_MIN
from motm_twin.sim.base import lag_factor


@dataclass
class ArmState:
    """True motion of the arm's joints."""

    q: Array  # [rad], shape (7,)
    dq: Array  # [rad/s], shape (7,)


class Arm:
    """Follows commanded joint rates as well as its limits allow, and brakes in time before a position limit."""

    def __init__(self, velocity_lag: float, dt: float) -> None:
        """Lag [s] of the velocity loop, for substeps of dt [s]."""
        self.dt = dt
        self._factor = lag_factor(velocity_lag, dt)
        self._change = DDQ_MAX * dt

    def step(self, state: ArmState, joint_velocity: Array) -> None:
        """One substep towards the commanded joint rates [rad/s], shape (7,)."""
        wanted = np.minimum(np.maximum(joint_velocity, -DQ_MAX), DQ_MAX)
        wanted = state.dq + self._factor * (wanted - state.dq)
        wanted = np.minimum(wanted, self._stoppable(Q_MAX - state.q, state.dq))
        wanted = np.maximum(wanted, -self._stoppable(state.q - Q_MIN, -state.dq))
        dq = state.dq + np.minimum(np.maximum(wanted - state.dq, -self._change), self._change)
        state.q = np.minimum(np.maximum(state.q + 0.5 * (state.dq + dq) * self.dt, Q_MIN), Q_MAX)
        state.dq = dq

    def _stoppable(self, room: Array, speed: Array) -> Array:
        """Largest next speed from which the joint still stops within the room [rad] that is left.

        Solves v dt / 2 + v'dt / 2 + v'^2 / (2 a) + a dt^2 / 8 = room for v'; the last term covers the final, partial
        braking step. Never negative: at a limit the joint stands still.
        """
        a, dt = DDQ_MAX, self.dt
        left = room - 0.5 * speed * dt - 0.125 * a * dt * dt
        speed = np.sqrt(np.maximum(0.25 * a * a * dt * dt + 2.0 * a * left, 0.0)) - 0.5 * a * dt
        return np.maximum(speed, 0.0)
