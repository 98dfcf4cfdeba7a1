"""How late the robot acts on its commands: found out from what it does, and looked past.

Two numbers: the delay after which anything acts on a command, told by the joints, which follow theirs at once; and the
lag of the base beyond that of its profile, told by its twist. Each is the one of a few whose model has fitted best for
a while, by least squares. With a delay, an observation is moved on to when a command that is given now acts, as that of
a robot on a slow link is; a lag becomes that of the profile (`Twin`).
"""

import math
from dataclasses import dataclass, field

import msgspec
import numpy as np

from motm_twin.control.predictor import Motion, Predictor
from motm_twin.model.geometry import Array
from motm_twin.model.joint_limits import DDQ_MAX, DQ_MAX
from motm_twin.model.plant import Actuation, Observation
from motm_twin.model.profile import RobotProfile
from motm_twin.model.state import Stateful

JOINTS = 7
LAGS = (0.0, 0.05, 0.1, 0.15, 0.2, 0.3, 0.4)  # [s] more than the profile says


class ResponseSettings(msgspec.Struct, frozen=True, kw_only=True):
    """When another delay or lag is believed; choices of this project."""

    step: float = 0.01  # [s] between the delays that are tried
    longest: float = 0.3  # [s]
    memory: float = 2.0  # [s] over which misfits are added up
    base_memory: float = 4.0  # [s] the same of the base, which changes its speed less often
    better: float = 3.0  # times as large as the best misfit is that of the one believed so far, before it is given up
    joints: float = 0.02  # [rad^2/s^2 s] by which a misfit of the joints is larger at least ...
    base: float = 0.004  # [s] ... and one of the base, in shares of its largest speed squared
    sure: float = 0.3  # [s] for which that has been so
    sure_base: float = 1.5  # [s] longer than a fault is told by another name first


@dataclass
class ResponseState:
    """Commands, models and misfits."""

    delay: float = 0.0  # [s]
    lag: float = 0.0  # [s] of the base, more than the profile says
    time: float | None = None
    commands: list[tuple[float, Actuation]] = field(default_factory=list)  # with when they were given [s], newest last
    rates: Array = field(default_factory=lambda: np.zeros((1, JOINTS)))  # of joints without a delay, newest first
    of_delay: Array = field(default_factory=lambda: np.zeros(1))  # misfit of each
    twists: Array = field(default_factory=lambda: np.zeros((len(LAGS), 2)))  # of a base with each lag
    sums: Array = field(default_factory=lambda: np.zeros((len(LAGS), 3, 2)))  # model^2, model * measured, measured^2
    late: float = 0.0  # [s] that another delay has fitted better
    lagging: float = 0.0  # [s] that another lag has


class Response(Stateful[ResponseState]):
    """Watches what becomes of commands."""

    def __init__(self, profile: RobotProfile, settings: ResponseSettings | None = None) -> None:
        """``profile``: what the robot was told of itself."""
        self._profile, self._settings = profile, settings or ResponseSettings()
        self._count = round(self._settings.longest / self._settings.step) + 1
        self._state = ResponseState(rates=np.zeros((self._count, JOINTS)), of_delay=np.zeros(self._count))

    @property
    def delay(self) -> float:
        """After which the robot acts on a command [s]."""
        return self._state.delay

    @property
    def lag(self) -> float:
        """Lag of the base beyond that of the profile [s]."""
        return self._state.lag

    def observed(self, now: Observation) -> Observation:
        """The observation at the time at which a command that is given now acts; the same one without a delay."""
        self._watch(now)
        delay = self._state.delay
        if delay == 0.0 or now.ahead > 0.0:
            return now
        commands = [(given + delay, actuation) for given, actuation in self._state.commands]
        motion = Motion(
            stamp=now.time, pose=now.pose, odometry=now.odometry, twist=now.twist, q=now.q, dq=now.dq,
            gripper_moving=now.gripper_moving,
        )  # fmt: skip
        later = Predictor(self._lagging(), math.inf, commands).predict(motion, now.time + delay)
        return msgspec.structs.replace(
            now, time=later.stamp, pose=later.pose, odometry=later.odometry, twist=later.twist, q=later.q, dq=later.dq,
            gripper_moving=later.gripper_moving, ahead=delay,
        )  # fmt: skip

    def told(self, actuation: Actuation, reported: Observation) -> None:
        """Remember a command, given when this was reported."""
        state, keep = self._state, 2.0 * self._settings.longest
        now = reported.time
        state.commands = [*(one for one in state.commands if now - one[0] <= keep), (now, actuation)]

    def _lagging(self) -> RobotProfile:
        base = self._profile.base
        lagging = msgspec.structs.replace(base, velocity_lag=base.velocity_lag + self._state.lag)
        return msgspec.structs.replace(self._profile, base=lagging)

    def _watch(self, now: Observation) -> None:
        """One more comparison of the robot with its models."""
        state = self._state
        dt, state.time = 0.0 if state.time is None else now.time - state.time, now.time
        if not (0.0 < dt <= 0.05) or now.ahead > 0.0 or now.age > 0.0 or not state.commands or not _finite(now):
            return
        self._joints(now, dt)
        self._base(now, dt)

    def _joints(self, now: Observation, dt: float) -> None:
        state, settings = self._state, self._settings
        wanted = np.clip(state.commands[-1][1].joint_velocity, -DQ_MAX, DQ_MAX)
        share = _share(self._profile.arm.velocity_lag, dt)
        newest = state.rates[0] + np.clip(share * (wanted - state.rates[0]), -DDQ_MAX * dt, DDQ_MAX * dt)
        state.rates = np.vstack([newest[None], state.rates[:-1]])
        off = now.dq[None] - state.rates
        state.of_delay = math.exp(-dt / settings.memory) * state.of_delay + dt * (off * off).sum(axis=1)
        believed, best = round(state.delay / settings.step), int(np.argmin(state.of_delay))
        here, least = float(state.of_delay[believed]), float(state.of_delay[best])
        other = best != believed and here > settings.better * least and here - least > settings.joints
        state.late = state.late + dt if other else 0.0
        if state.late > settings.sure:
            state.delay, state.late = settings.step * best, 0.0
            state.twists, state.sums = np.tile(now.twist, (len(LAGS), 1)), np.zeros_like(state.sums)

    def _base(self, now: Observation, dt: float) -> None:
        state, settings, base = self._state, self._settings, self._profile.base
        given = now.time - dt - state.delay + 1e-6
        acting = next((one.twist for at, one in reversed(state.commands) if at <= given), np.zeros(2))
        largest = np.array([base.forward_speed, base.yaw_rate])
        most = dt * np.array([base.linear_acceleration, base.yaw_acceleration])
        shares = np.array([_share(base.velocity_lag + lag, dt) for lag in LAGS])[:, None]
        state.twists = state.twists + np.clip(shares * (acting[None] - state.twists), -most, most)
        model, measured = state.twists / largest, (now.twist / largest)[None]
        fresh = np.stack([model * model, model * measured, np.broadcast_to(measured * measured, model.shape)], axis=1)
        state.sums = math.exp(-dt / settings.base_memory) * state.sums + dt * fresh
        square, mixed, whole = state.sums[:, 0], state.sums[:, 1], state.sums[:, 2]
        # a base that is faster or slower than told by a share is none that lags
        misfit = (whole - mixed * mixed / np.maximum(square, 1e-9)).sum(axis=1)
        believed, best = LAGS.index(state.lag), int(np.argmin(misfit))
        here, least = float(misfit[believed]), float(misfit[best])
        other = best != believed and here > settings.better * least and here - least > settings.base
        state.lagging = state.lagging + dt if other else 0.0
        if state.lagging > settings.sure_base:
            state.lag, state.lagging = LAGS[best], 0.0


def _share(lag: float, dt: float) -> float:
    return 1.0 if lag <= 0.0 else 1.0 - math.exp(-dt / lag)


def _finite(now: Observation) -> bool:
    return math.isfinite(float(now.twist.sum() + now.dq.sum()))
