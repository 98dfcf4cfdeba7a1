"""The arm: joint rates with lag, limits on position, speed and acceleration."""

import math
from dataclasses import dataclass

import numpy as np
from numba import njit

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

    def step(self, state: ArmState, joint_velocity: Array) -> None:
        """One substep towards the commanded joint rates [rad/s], shape (7,)."""
        state.q, state.dq = _follow(state.q, state.dq, joint_velocity, self._factor, self.dt)


@njit(cache=True)
def _follow(q: Array, dq: Array, command: Array, factor: float, dt: float) -> tuple[Array, Array]:
    new_q, new_dq = np.empty_like(q), np.empty_like(dq)
    for i in range(q.shape[0]):
        a, old = DDQ_MAX[i], dq[i]
        wanted = old + factor * (min(DQ_MAX[i], max(-DQ_MAX[i], command[i])) - old)
        wanted = min(wanted, _stoppable(Q_MAX[i] - q[i], old, a, dt))
        wanted = max(wanted, -_stoppable(q[i] - Q_MIN[i], -old, a, dt))
        new_dq[i] = old + min(a * dt, max(-a * dt, wanted - old))
        new_q[i] = min(Q_MAX[i], max(Q_MIN[i], q[i] + 0.5 * (old + new_dq[i]) * dt))
    return new_q, new_dq


@njit(cache=True)
def _stoppable(room: float, speed: float, a: float, dt: float) -> float:
    """Largest next speed from which a joint still stops within the room [rad] that is left.

    Solves v dt / 2 + v' dt / 2 + v'^2 / (2 a) + a dt^2 / 8 = room for v'; the last term covers the final, partial
    braking step. Never negative: at a limit the joint stands still.
    """
    left = room - 0.5 * speed * dt - 0.125 * a * dt * dt
    return max(0.0, math.sqrt(max(0.25 * a * a * dt * dt + 2.0 * a * left, 0.0)) - 0.5 * a * dt)
