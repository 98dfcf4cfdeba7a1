"""Estimation and compensation of the command delay, and of the base's lag.

Two numbers are estimated: the delay until any part acts on a command, from the joints, which follow their commands at
once; and the lag of the base beyond its profile, from its twist. Each is the candidate whose model has fitted best for
a while, by least squares. With a delay, observations are predicted to the time at which a command given now acts, as
for a robot on a slow link; `Twin` adds the estimated lag to the profile.
"""

import math
from dataclasses import dataclass, field
from typing import Annotated

import msgspec
import numpy as np

from motm_twin.control.motion_check import JOINTS
from motm_twin.control.predictor import FARTHEST, Motion, Predictor
from motm_twin.model.geometry import Array
from motm_twin.model.motion import lag_share
from motm_twin.model.number import OWN, Number
from motm_twin.model.plant import ARM_STEP, LONGEST_PERIOD, Actuation, Observation
from motm_twin.model.profile import DDQ_MAX, DQ_MAX, RobotProfile
from motm_twin.model.state import Stateful

LAGS = (0.0, 0.05, 0.1, 0.15, 0.2, 0.3, 0.4)  # [s] more than the profile says


class ResponseSettings(msgspec.Struct, frozen=True, kw_only=True):
    """Limits for believing another delay or lag; choices of this project."""

    longest: Annotated[
        float, Number("s", OWN, "longest command delay that is tried; another delay must fit better for so long")
    ] = 0.3
    memory: Annotated[
        float,
        Number("s", OWN, "time over which misfits of delay models are added up, those of lag models twice as long"),
    ] = 2.0
    explained: Annotated[
        float, Number("", OWN, "largest misfit of a model that is believed, as a share of the square of its prediction")
    ] = 0.2
    settles: Annotated[
        float,
        Number(
            "s",
            OWN,
            "time after which a base is at its speed; so long another lag must fit better: a fault is reported by then",
        ),
    ] = 1.5
    steady: Annotated[
        float, Number("s", OWN, "time over which the speed scale of the base is estimated while its speed is steady")
    ] = 0.5
    better: Annotated[
        float, Number("", OWN, "ratio of the believed model's misfit to the best one's from which it is given up")
    ] = 3.0
    joints: Annotated[
        float, Number("rad^2/s", OWN, "least difference of two models' misfits for a change of delay")
    ] = 0.02
    base: Annotated[
        float,
        Number(
            "s",
            OWN,
            "least difference of two models' misfits for a change of lag, in shares of the largest speed squared",
        ),
    ] = 0.001
    tells: Annotated[
        float, Number("", OWN, "difference in [rad/s], or share of the largest speed, that tells two models apart")
    ] = 0.01
    slow: Annotated[
        float, Number("", OWN, "share of the largest speed below which the speed scale of the base is not estimated")
    ] = 0.2
    unchanged: Annotated[
        float, Number("", OWN, "share of the largest speed within which the command of the base counts as unchanged")
    ] = 0.02


@dataclass
class ResponseState:
    """Commands, models and misfits."""

    delay: float = 0.0  # [s]
    lag: float = 0.0  # [s] of the base, more than the profile says
    time: float | None = None
    commands: list[tuple[float, Actuation]] = field(default_factory=list)  # with the time [s] of each, newest last
    rates: Array = field(default_factory=lambda: np.zeros((1, JOINTS)))  # model without delay, newest first
    of_delay: Array = field(default_factory=lambda: np.zeros((2, 1)))  # misfit of each, and square of its model
    twists: Array = field(default_factory=lambda: np.zeros((len(LAGS), 2)))  # model of a base with each lag
    of_lag: Array = field(default_factory=lambda: np.zeros((2, len(LAGS))))  # misfit of each, and square of its model
    acting: Array = field(default_factory=lambda: np.zeros(2))  # commanded twist that acts on the base ...
    settled: Array = field(default_factory=lambda: np.zeros(2))  # ... and the time [s] since it last changed
    scale: Array = field(default_factory=lambda: np.ones(2))  # measured share of a steady commanded twist
    late: float = 0.0  # [s] for which another delay has fitted better
    lagging: float = 0.0  # [s] for which another lag has fitted better


class Response(Stateful[ResponseState]):
    """Estimates delay and lag of the robot."""

    def __init__(self, profile: RobotProfile, settings: ResponseSettings | None = None) -> None:
        """``profile``: of the robot, without the estimated lag."""
        self._profile, self._settings = profile, settings or ResponseSettings()
        self._count = round(self._settings.longest / ARM_STEP) + 1
        self._state = ResponseState(rates=np.zeros((self._count, JOINTS)), of_delay=np.zeros((2, self._count)))

    @property
    def delay(self) -> float:
        """Time after which the robot acts on a command [s]."""
        return self._state.delay

    @property
    def lag(self) -> float:
        """Lag of the base beyond that of the profile [s]."""
        return self._state.lag

    def observed(self, now: Observation) -> Observation:
        """The observation predicted to the time at which a command given now acts; unchanged without delay or age.

        A late report is predicted with the commands given since; otherwise the arm would repeat them all.
        """
        self._watch(now)
        delay = self._state.delay if now.ahead == 0.0 else 0.0
        if delay == 0.0 and now.behind == 0.0:
            return now
        commands = [(given + delay, actuation) for given, actuation in self._state.commands]
        motion = Motion(
            stamp=now.time - now.behind, pose=now.pose, odometry=now.odometry, twist=now.twist, q=now.q, dq=now.dq,
            gripper_moving=now.gripper_moving,
        )  # fmt: skip
        later = Predictor(self._lagging(), math.inf, commands).predict(motion, now.time + delay)
        return msgspec.structs.replace(
            now, time=now.time + delay, pose=later.pose, odometry=later.odometry, twist=later.twist, q=later.q,
            dq=later.dq, gripper_moving=later.gripper_moving, ahead=now.ahead + delay, behind=0.0,
        )  # fmt: skip

    def note_command(self, actuation: Actuation, reported: Observation) -> None:
        """Remember a command given in answer to a report."""
        state, keep = self._state, self._settings.longest + FARTHEST
        now = reported.time
        state.commands = [*(one for one in state.commands if now - one[0] <= keep), (now, actuation)]

    def _lagging(self) -> RobotProfile:
        base = self._profile.base
        lagging = msgspec.structs.replace(base, velocity_lag=base.velocity_lag + self._state.lag)
        return msgspec.structs.replace(self._profile, base=lagging)

    def _watch(self, now: Observation) -> None:
        """Update the models and their misfits with a new observation."""
        state = self._state
        dt, state.time = 0.0 if state.time is None else now.time - state.time, now.time
        if not _finite(now):
            return
        if not (0.0 < dt <= LONGEST_PERIOD) or now.ahead > 0.0 or now.age > 0.0 or not state.commands:
            state.rates, state.twists = np.tile(now.dq, (self._count, 1)), np.tile(now.twist, (len(LAGS), 1))
            return
        self._joints(now, dt)
        self._base(now, dt)

    def _joints(self, now: Observation, dt: float) -> None:
        state, settings = self._state, self._settings
        desired = np.clip(state.commands[-1][1].joint_velocity, -DQ_MAX, DQ_MAX)
        share = lag_share(self._profile.arm.velocity_lag, dt)
        newest = state.rates[0] + np.clip(share * (desired - state.rates[0]), -DDQ_MAX * dt, DDQ_MAX * dt)
        state.rates = np.vstack([newest[None], state.rates[:-1]])
        off = now.dq[None] - state.rates
        fresh = np.array([(off * off).sum(axis=1), (state.rates * state.rates).sum(axis=1)])
        state.of_delay = math.exp(-dt / settings.memory) * state.of_delay + dt * fresh
        believed = round(state.delay / ARM_STEP)
        best = self._better(state.of_delay, believed, settings.joints)
        apart = 0.0 if best is None else float(np.abs(state.rates[best] - state.rates[believed]).max())
        state.late = 0.0 if best is None else state.late + dt * (apart > self._settings.tells)
        if best is not None and state.late > settings.longest:
            state.delay, state.late, state.lagging = ARM_STEP * best, 0.0, 0.0
            state.twists, state.of_lag = np.tile(now.twist, (len(LAGS), 1)), np.zeros_like(state.of_lag)

    def _base(self, now: Observation, dt: float) -> None:
        state, settings, base = self._state, self._settings, self._profile.base
        given = now.time - dt - state.delay + 1e-6
        acting = next((one.twist for at, one in reversed(state.commands) if at <= given), np.zeros(2))
        largest = np.array([base.forward_speed, base.yaw_rate])
        most = dt * np.array([base.linear_acceleration, base.yaw_acceleration])
        shares = np.array([lag_share(base.velocity_lag + lag, dt) for lag in LAGS])[:, None]
        desired = state.scale * acting
        state.twists = state.twists + np.clip(shares * (desired[None] - state.twists), -most, most)
        same = np.abs(acting - state.acting) < settings.unchanged * largest
        state.settled, state.acting = np.where(same, state.settled + dt, 0.0), np.where(same, state.acting, acting)
        steady = (state.settled > settings.settles) & (np.abs(acting) > settings.slow * largest)
        ratio = np.clip(now.twist / np.where(steady, acting, 1.0), 0.5, 1.5)
        state.scale = np.where(steady, state.scale + dt / settings.steady * (ratio - state.scale), state.scale)
        model, off = state.twists / largest, (state.twists - now.twist[None]) / largest
        fresh = np.array([(off * off).sum(axis=1), (model * model).sum(axis=1)])
        state.of_lag = math.exp(-dt / (2.0 * settings.memory)) * state.of_lag + dt * fresh
        believed = LAGS.index(state.lag)
        best = self._better(state.of_lag, believed, settings.base)
        apart = 0.0 if best is None else float(np.abs(model[best] - model[believed]).max())
        state.lagging = 0.0 if best is None else state.lagging + dt * (apart > self._settings.tells)
        if best is not None and state.lagging > settings.settles:
            state.lag, state.lagging, state.of_lag = LAGS[best], 0.0, np.zeros_like(state.of_lag)

    def _better(self, misfits: Array, believed: int, least: float) -> int | None:
        """Index of a model that explains the measurements, much better than the one believed does; None: no model.

        ``misfits``: of every model, and the squares of its predictions, (2, n).
        """
        (off, square), settings = misfits, self._settings
        best = int(np.argmin(off))
        here, there = float(off[believed]), float(off[best])
        better = here > settings.better * there and here - there > least
        return best if better and there < settings.explained * float(square[best]) else None


def _finite(now: Observation) -> bool:
    return math.isfinite(float(now.twist.sum() + now.dq.sum()))
