"""Checks of wheels, joints and fingers against their commands."""

import math
from dataclasses import dataclass, field
from typing import Annotated

import msgspec
import numpy as np

from motm_twin.model.geometry import Array
from motm_twin.model.motion import lag_share
from motm_twin.model.number import OWN, Number
from motm_twin.model.plant import LONGEST_PERIOD, PERIOD, Actuation, Observation
from motm_twin.model.profile import Q_MAX, Q_MIN, BaseLimits, RobotProfile
from motm_twin.model.reason import Kind, Reason
from motm_twin.model.state import LATER
from motm_twin.perception.finding import Finding

JOINTS = 7


class MotionSettings(msgspec.Struct, frozen=True, kw_only=True):
    """Limits of the checks of motion. Shares leave room for a base that is 40 % faster or slower than commanded."""

    asked: Annotated[
        float, Number("", OWN, "share of the largest speed from which a motion of the base is distinguished from noise")
    ] = 0.1
    stands: Annotated[float, Number("", OWN, "share of its commanded rate below which a joint stands")] = 0.15
    base_stands: Annotated[
        float,
        Number(
            "",
            OWN,
            "share of its speed below which a base stands: it takes a second to stop, and may be slower than commanded",
        ),
    ] = 0.55
    stuck_after: Annotated[
        float,
        Number(
            "s", OWN, "time after which standing wheels, joints or fingers are stuck, and following wheels no longer"
        ),
    ] = 0.25
    late: Annotated[
        float,
        Number(
            "s",
            OWN,
            "lag of the base beyond its profile that is reported: at full speed its way is more than the margins",
        ),
    ] = 0.1
    memory: Annotated[float, Number("s", OWN, "time over which the speed scale of the base is estimated")] = 1.5
    lately: Annotated[
        float, Number("s", OWN, "time over which the base's lag is estimated: a new one shows at once")
    ] = 0.25
    smooth: Annotated[
        float, Number("s", OWN, "time over which a twist is smoothed, and must change to count as no noise")
    ] = 0.1
    limited: Annotated[
        float, Number("", OWN, "share of a speed or acceleration limit from which no lag is estimated")
    ] = 0.95
    changes: Annotated[
        float, Number("", OWN, "share of the largest acceleration below which a change of speed tells no lag")
    ] = 0.1
    apart: Annotated[
        float,
        Number(
            "",
            OWN,
            "least 1 - correlation^2 of speed and acceleration, which tells lag from another speed than commanded",
        ),
    ] = 0.05
    forgotten: Annotated[
        float, Number("s", OWN, "time without a command after which a stuck part is given another chance")
    ] = 2.0
    joint_asked: Annotated[
        float,
        Number(
            "rad/s", OWN, "commanded rate from which a joint that stands does not follow: above the noise of its rates"
        ),
    ] = 0.08
    joint_room: Annotated[
        float, Number("rad", OWN, "distance from a position limit within which a joint may stand")
    ] = 0.1
    creep: Annotated[float, Number("", OWN, "share of its speed with which a stuck or late base goes on")] = 0.3
    fingers_moved: Annotated[
        float, Number("m", OWN, "change of the gripper's width from which the fingers have moved")
    ] = 0.001


@dataclass
class MotionState:
    """Memory of the checks of motion."""

    expected: Array = field(default_factory=lambda: np.zeros(2))  # twist that the base should have now
    commanded: Array = field(default_factory=lambda: np.zeros(2))  # twist commanded last
    rates: Array = field(default_factory=lambda: np.zeros(JOINTS))  # joint rates commanded last [rad/s]
    recent: list[tuple[float, Array]] = field(default_factory=list)  # times [s] and joint rates of recent commands
    astray: Array = field(default_factory=lambda: np.zeros(JOINTS))  # [rad/s] by which rates are outside of those
    time: float | None = None
    standing: float = 0.0  # [s] that the base has stood although it should move
    moving: float = 0.0  # [s] that the base has moved as it should
    resting: float = 0.0  # [s] that the base was not commanded to move
    smooth: Array = field(default_factory=lambda: np.zeros((2, 2)))  # expected and measured twist, smoothed
    free: Array = field(default_factory=lambda: np.zeros(2))  # [s] since each axis was at a limit
    sums: Array = field(default_factory=lambda: np.zeros((5, 2)))  # of `_lag`, for both axes
    newest: Array = field(default_factory=lambda: np.zeros((3, 2)))  # three of them, over the shorter time `lately`
    late: float = 0.0  # [s] that one axis has been late
    lag: Array = field(default_factory=lambda: np.zeros(2))  # [s] more than the profile says, where it is known
    base: str = ""  # "" | base_stuck | base_late
    still: Array = field(default_factory=lambda: np.zeros(JOINTS))  # [s] that each joint has stood despite a command
    doubted: int = field(default=-1, metadata=LATER)  # a joint that went astray, counted from 0: not relied on ...
    doubt: float = field(default=0.0, metadata=LATER)  # ... until it has moved for so long [s]
    idle: float = 0.0  # [s] that the stuck joint was not commanded to move
    joint: int = -1  # the stuck joint, counted from 0
    gripper: str = "open"
    since: float = 0.0  # [s] when the gripper's command changed
    width: float = 0.0  # [m] of the gripper at that time
    fingers: str = ""  # "" | waited | stuck


def skip(state: MotionState) -> None:
    """Reset the checks when the reported state is too old to judge the motion by."""
    state.expected = state.commanded.copy()
    state.smooth = np.array([state.commanded, state.commanded])
    state.standing = state.moving = 0.0
    state.sums, state.newest, state.late = np.zeros((5, 2)), np.zeros((3, 2)), 0.0
    state.still, state.astray = np.zeros(JOINTS), np.zeros(JOINTS)
    state.doubted, state.doubt = -1, 0.0
    state.recent.clear()


def note_command(state: MotionState, actuation: Actuation, now: Observation) -> None:
    """Remember the command that the robot gets now."""
    state.commanded, state.rates = actuation.twist.copy(), actuation.joint_velocity.copy()
    state.recent.append((now.time, state.rates))
    if actuation.gripper != state.gripper:
        state.gripper, state.since, state.width = actuation.gripper, now.time, now.gripper_width
        state.fingers = "waited"


def check_base(state: MotionState, now: Observation, dt: float, base: BaseLimits, settings: MotionSettings) -> None:
    """Compare the measured twist with that of a base of this profile."""
    share = lag_share(base.velocity_lag, dt)
    most = np.array([base.linear_acceleration, base.yaw_acceleration])
    change = np.clip(share * (state.commanded - state.expected), -most * dt, most * dt)
    state.expected = state.expected + change
    if dt <= 0.0:
        return
    largest = np.array([base.forward_speed, base.yaw_rate])
    asked = np.abs(state.expected) > settings.asked * largest
    stands = asked & (np.abs(now.twist) < settings.base_stands * np.abs(state.expected))
    follows = asked & ~stands
    state.standing = state.standing + dt if bool(stands.any()) and not bool(follows.any()) else 0.0
    state.moving = state.moving + dt if bool(follows.any()) and not bool(stands.any()) else 0.0
    state.resting = 0.0 if bool(asked.any()) else state.resting + dt
    known = _lag(state, now.twist, dt, (largest, most), settings)
    state.late = state.late + dt if bool((known & (state.lag > settings.late)).any()) else 0.0
    if state.standing > settings.stuck_after:
        state.base = "base_stuck"
    elif state.base == "base_stuck":
        state.base = "" if state.moving > settings.stuck_after or state.resting > settings.forgotten else state.base
    elif state.late > PERIOD:
        state.base = "base_late"
    elif state.base == "base_late" and (
        (bool(known.any()) and bool((state.lag[known] < 0.5 * settings.late).all()))
        or state.resting > settings.forgotten
    ):
        state.base = ""
    if state.base == "base_stuck":
        state.expected = np.where(stands, state.expected, now.twist)
        state.smooth = np.array([now.twist, now.twist])
        state.sums, state.newest = np.zeros((5, 2)), np.zeros((3, 2))


def _lag(
    state: MotionState, measured: Array, dt: float, limits: tuple[Array, Array], settings: MotionSettings
) -> Array:
    """Estimate the lag of both axes; returns a mask of the axes whose recent motion determines it, shape (2,).

    Model: expected - measured speed = share * expected speed + lag * measured acceleration, all smoothed alike. Least
    squares over ``memory`` give the share, the newest samples the lag. Samples at the ``limits`` of speed and
    acceleration are left out: there a base that is faster than commanded falls short, too.
    """
    smooth = 1.0 - math.exp(-dt / settings.smooth)
    before = state.smooth
    state.smooth = before + smooth * (np.array([state.expected, measured]) - before)
    speed, change = state.smooth[0], (state.smooth[1] - before[1]) / dt
    short = speed - state.smooth[1]
    largest, most = limits
    limited = (np.abs(measured) > settings.limited * largest) | (np.abs(change) > settings.limited * most)
    state.free = np.where(limited, 0.0, state.free + dt)
    free = state.free > settings.stuck_after
    now = np.array([speed * speed, speed * change, change * change, short * speed, short * change])
    state.sums = np.where(free, math.exp(-dt / settings.memory) * state.sums + dt * now, state.sums)
    state.newest = math.exp(-dt / settings.lately) * state.newest + np.where(free, dt * now[[1, 2, 4]], 0.0)
    vv, va, aa, sv, sa = state.sums
    square, enough = vv * aa - va * va, settings.smooth * (settings.changes * most) ** 2
    known = (aa > enough) & (square > settings.apart * vv * aa) & (state.newest[1] > enough)
    share = (sv * aa - sa * va) / np.where(known, square, 1.0)
    va, aa, sa = state.newest
    state.lag = np.where(known, (sa - share * va) / np.where(known, aa, 1.0), state.lag)
    return known


def check_joints(state: MotionState, now: Observation, dt: float, settings: MotionSettings) -> None:
    """Find the joint that stands although it is commanded to move."""
    rates = state.rates
    state.astray = _astray(state, now)
    at_end = np.where(rates > 0.0, Q_MAX - now.q, now.q - Q_MIN) < settings.joint_room
    worst = int(np.argmax(np.abs(state.astray)))
    if abs(state.astray[worst]) > settings.joint_asked:
        state.doubted, state.doubt = worst, settings.stuck_after
    elif state.doubted >= 0 and state.still[state.doubted] == 0.0:
        state.doubt = max(state.doubt - dt, 0.0)
        state.doubted = state.doubted if state.doubt > 0.0 else -1
    tried = np.arange(JOINTS) == state.doubted  # commanded at a small rate only
    asked = ((np.abs(rates) > settings.joint_asked) | tried) & ~at_end
    stands = np.abs(now.dq) < np.where(tried, 0.5, settings.stands) * np.abs(rates)
    state.still = np.where(asked & stands, state.still + dt, np.where(stands & ~at_end, state.still, 0.0))
    if state.joint >= 0:
        k = state.joint
        follows = abs(now.dq[k]) > 0.5 * abs(rates[k]) and abs(rates[k]) > 0.01
        state.idle = state.idle + dt if abs(rates[k]) <= 0.01 else 0.0
        if follows or state.idle > settings.forgotten:
            state.joint, state.idle = -1, 0.0
            state.still = np.zeros(JOINTS)
        return
    if float(state.still.max()) > settings.stuck_after:
        state.joint, state.idle = int(np.argmax(state.still)), 0.0


def failing_joint(state: MotionState) -> int | None:
    """The stuck joint, or, before one is found, the joint that last went astray, counted from 0; None: neither."""
    joint = state.joint if state.joint >= 0 else state.doubted
    return None if joint < 0 else joint


def _astray(state: MotionState, now: Observation) -> Array:
    """Joint rates beyond all recent commands [rad/s], shape (7,): no lag explains these."""
    lately = LONGEST_PERIOD + now.ahead + now.age
    state.recent = [one for one in state.recent if now.time - one[0] <= lately]
    if not state.recent:
        return np.zeros(JOINTS)
    commanded = np.array([rates for _, rates in state.recent])
    return now.dq - np.clip(now.dq, commanded.min(axis=0), commanded.max(axis=0))


def check_fingers(state: MotionState, now: Observation, profile: RobotProfile, settings: MotionSettings) -> None:
    """Find fingers that do not move for a while after their command: they are stuck until they move."""
    if not state.fingers:
        return
    moved = now.gripper_moving or abs(now.gripper_width - state.width) > settings.fingers_moved
    widest = profile.gripper.max_width
    due = state.width > 0.9 * widest if state.gripper == "close" else state.width < 0.9 * widest
    if moved or not due:
        state.fingers = ""
    elif now.time - state.since > settings.stuck_after + now.ahead + now.age:
        state.fingers = "stuck"


def findings(state: MotionState, now: Observation, base: BaseLimits, settings: MotionSettings) -> list[Finding]:
    """Findings about wheels, joints and fingers."""
    found = []
    if state.base:
        axis = int(np.argmax(np.abs(state.expected - now.twist) / [base.forward_speed, base.yaw_rate]))
        found.append(_of_base(state, float(now.twist[axis]), axis, base, settings))
    if state.joint >= 0:
        rate = float(state.rates[state.joint])
        name, does = f"joint {state.joint + 1}", float(now.dq[state.joint])
        why = Reason(kind=Kind.JOINT_STUCK, subject=name, value=does, limit=rate, unit="rad/s")
        found.append(Finding(reason=why, base=0.0))
    if state.fingers == "stuck":
        stand = 1e3 * now.gripper_width
        why = Reason(kind=Kind.FINGERS_STUCK, subject="fingers", other=state.gripper, value=stand, unit="mm")
        found.append(Finding(reason=why, base=0.0))
    return found


def joint_shares(state: MotionState, *, stands: bool) -> Array | None:
    """Shares of their rates that the joints keep, shape (7,), while one of them is stuck; None: full rates.

    The others go on until the base ``stands``; the stuck one is still commanded, to find out when it is free.
    """
    if state.joint < 0:
        return None
    shares = np.zeros(JOINTS) if stands else np.ones(JOINTS)
    shares[state.joint] = 1.0
    return shares


def lag_of(state: MotionState) -> float:
    """Time [s] by which a base that was found late follows its commands later than its profile says; else 0."""
    return max(float(state.lag.max()), 0.0) if state.base == "base_late" else 0.0


def _of_base(state: MotionState, measured: float, axis: int, base: BaseLimits, settings: MotionSettings) -> Finding:
    expected, unit = float(state.expected[axis]), ("m/s", "rad/s")[axis]
    if state.base == "base_stuck":
        why = Reason(kind=Kind.BASE_STUCK, subject="wheels", value=measured, limit=expected, unit=unit)
        return Finding(reason=why, base=settings.creep)
    largest = base.forward_speed, base.yaw_rate
    overshoot = abs(measured) > abs(expected) + settings.asked * largest[axis]
    share = 0.0 if overshoot else settings.creep
    late = float(state.lag.max())
    return Finding(
        reason=Reason(kind=Kind.BASE_LATE, subject="wheels", value=late, limit=settings.late, unit="s"), base=share
    )
