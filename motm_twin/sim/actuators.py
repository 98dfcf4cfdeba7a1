"""Base and arm of the simulated robot: limits, first-order lag, and errors between command and motion."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import msgspec
import numpy as np

from motm_twin.model.compiler import njit
from motm_twin.model.exact import norm
from motm_twin.model.geometry import Array
from motm_twin.model.motion import drive, lag_share
from motm_twin.model.profile import DDQ_MAX, DQ_MAX, Q_MAX, Q_MIN, BaseLimits
from motm_twin.model.scene import Mismatch, Noise, Scene


@dataclass
class BaseState:
    """True pose of the base, and the speeds of its wheels, which are its own unless they slip."""

    pose: Array  # world, shape (3,)
    v: float = 0.0  # [m/s]
    w: float = 0.0  # [rad/s]


def _towards(now: float, wanted: float, factor: float, largest: float) -> float:
    change = factor * (wanted - now)
    return now + min(largest, max(-largest, change))


class Base:
    """Follows a commanded twist within its limits. Nothing in the world stops it: see `SimulatedPlant`."""

    def __init__(self, limits: BaseLimits, dt: float, scale: Sequence[float] | Array = (1.0, 1.0)) -> None:
        """Limits of the profile, for substeps of dt [s]; ``scale``: factors on the commanded speeds."""
        self.limits = limits
        self.dt = dt
        self.scale = (float(scale[0]), float(scale[1]))
        self._factor = lag_share(limits.velocity_lag, dt)

    def step(self, state: BaseState, twist: Array, *, more_lag: float = 0.0, grip: float = 1.0) -> None:
        """One substep towards the commanded forward speed and yaw rate, shape (2,).

        ``more_lag`` [s] of the velocity loop; ``grip``: share of the wheels' motion that moves the base.
        """
        limits, dt = self.limits, self.dt
        factor = self._factor if more_lag == 0.0 else lag_share(limits.velocity_lag + more_lag, dt)
        v_told, w_told = twist.tolist()
        v_wanted = min(limits.forward_speed, max(-limits.reverse_speed, self.scale[0] * v_told))
        w_wanted = min(limits.yaw_rate, max(-limits.yaw_rate, self.scale[1] * w_told))
        v = _towards(state.v, v_wanted, factor, limits.linear_acceleration * dt)
        w = _towards(state.w, w_wanted, factor, limits.yaw_acceleration * dt)
        state.pose = drive(state.pose, 0.5 * grip * (state.v + v), 0.5 * grip * (state.w + w), dt)
        state.v, state.w = v, w


@dataclass
class ArmState:
    """True motion of the arm's joints."""

    q: Array  # [rad], shape (7,)
    dq: Array  # [rad/s], shape (7,)


class Arm:
    """Follows commanded joint rates within its limits, and brakes in time before a position limit."""

    def __init__(self, velocity_lag: float, dt: float) -> None:
        """Lag [s] of the velocity loop, for substeps of dt [s]."""
        self.dt = dt
        self._factor = lag_share(velocity_lag, dt)

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


_RNG_BASE, _RNG_ARM, _RNG_HAND_EYE = 0xBA5E5C, 0xA53A4E, 0xE7E0FF


class ControlErrors:
    """Actuation and hand-eye errors of one seed. Stateless: each is drawn from the seed and its substep."""

    def __init__(self, noise: Noise, mismatch: Mismatch, seed: int) -> None:
        """Noise of the scene, and its mismatch to the robot's model."""
        drawn = np.random.default_rng([seed, _RNG_BASE]).standard_normal(2)
        scale = 1.0 + noise.base_speed_scale_sd * drawn
        self.base_scale = scale * (1.0 + mismatch.base_scale)  # of forward speed and yaw rate, shape (2,)
        self.camera_bias = hand_eye(mismatch, seed)  # [m] in the hand's frame, shape (3,)
        self._rate_sd, self._seed = noise.arm_rate_sd, seed

    def rates(self, told: Array, substep: int) -> Array:
        """Joint rates [rad/s] that the arm tracks in a substep, given the commanded ones, shape (7,).

        A joint commanded to stand holds its position.
        """
        if self._rate_sd == 0.0:
            return told
        off = self._rate_sd * np.random.default_rng([self._seed, _RNG_ARM, substep]).standard_normal(7)
        return np.where(told == 0.0, told, told + off)


def hand_eye(mismatch: Mismatch, seed: int) -> Array:
    """Offset [m] between reported and true position, in the hand's frame, shape (3,), in a random direction."""
    if mismatch.hand_eye == 0.0:
        return np.zeros(3)
    drawn = np.random.default_rng([seed, _RNG_HAND_EYE]).standard_normal(3)
    return mismatch.hand_eye / norm(drawn) * drawn


def drives(scene: Scene, dt: float) -> tuple[Base, Arm]:
    """Base and arm of a scene, with their errors and mismatch, for substeps of dt [s]."""
    robot, mismatch = scene.robot, scene.mismatch
    limits = msgspec.structs.replace(robot.base, velocity_lag=robot.base.velocity_lag + mismatch.base_lag)
    scale = ControlErrors(scene.noise, mismatch, scene.seed).base_scale
    return Base(limits, dt, scale), Arm(robot.arm.velocity_lag + mismatch.arm_lag, dt)
