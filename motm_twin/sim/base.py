"""The differential-drive base: speed and acceleration limits, first-order lag, exact arcs."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from motm_twin.model.geometry import Array
from motm_twin.model.motion import drive
from motm_twin.model.profile import BaseLimits


@dataclass
class BaseState:
    """True pose of the base, and what its wheels do, which is how it moves unless they slip."""

    pose: Array  # world, shape (3,)
    v: float = 0.0  # [m/s]
    w: float = 0.0  # [rad/s]


def lag_factor(lag: float, dt: float) -> float:
    """Share of the gap to the command that a first-order lag [s] closes within dt [s]."""
    return 1.0 if lag <= 0.0 else 1.0 - math.exp(-dt / lag)


def _towards(now: float, wanted: float, factor: float, largest: float) -> float:
    change = factor * (wanted - now)
    return now + min(largest, max(-largest, change))


class Base:
    """Follows a commanded twist as well as its limits allow. Nothing in the world stops it: see `SimulatedPlant`."""

    def __init__(self, limits: BaseLimits, dt: float, scale: Sequence[float] | Array = (1.0, 1.0)) -> None:
        """Limits of the profile, for substeps of dt [s]; ``scale``: what it makes of a forward speed and a yaw rate."""
        self.limits = limits
        self.dt = dt
        self.scale = (float(scale[0]), float(scale[1]))
        self._factor = lag_factor(limits.velocity_lag, dt)

    def step(self, state: BaseState, twist: Array, *, more_lag: float = 0.0, grip: float = 1.0) -> None:
        """One substep towards the commanded forward speed and yaw rate, shape (2,).

        ``more_lag`` [s] of the velocity loop; ``grip``: share of the wheels' motion that moves the base.
        """
        limits, dt = self.limits, self.dt
        factor = self._factor if more_lag == 0.0 else lag_factor(limits.velocity_lag + more_lag, dt)
        v_told, w_told = twist.tolist()
        v_wanted = min(limits.forward_speed, max(-limits.reverse_speed, self.scale[0] * v_told))
        w_wanted = min(limits.yaw_rate, max(-limits.yaw_rate, self.scale[1] * w_told))
        v = _towards(state.v, v_wanted, factor, limits.linear_acceleration * dt)
        w = _towards(state.w, w_wanted, factor, limits.yaw_acceleration * dt)
        state.pose = drive(state.pose, 0.5 * grip * (state.v + v), 0.5 * grip * (state.w + w), dt)
        state.v, state.w = v, w
