"""Wheels, joints and fingers against what they were told."""

import math
from dataclasses import dataclass, field

import msgspec
import numpy as np

from motm_twin.model.geometry import Array
from motm_twin.model.joint_limits import Q_MAX, Q_MIN
from motm_twin.model.plant import Actuation, Observation
from motm_twin.model.profile import BaseLimits, RobotProfile
from motm_twin.perception.finding import Finding

JOINTS = 7


class MotionSettings(msgspec.Struct, frozen=True, kw_only=True):
    """Limits of the checks of motion. Shares leave room for a base that is 40 % faster or slower than told."""

    asked: float = 0.1  # share of the largest speed from which a base that stands does not follow
    stands: float = 0.15  # share of what was asked: less stands
    stuck_after: float = 0.3  # [s] that the base stands although it should move
    late: float = 0.15  # share of the largest speed, and ...
    late_share: float = 0.5  # ... of the expected one, by which a base differs that follows late
    late_after: float = 0.15  # [s]
    back_after: float = 1.5  # [s] of good following after which the base counts as well
    braking: float = 0.3  # [s] that are left to a base between a stop and what it was told before
    joint_asked: float = 0.08  # [rad/s] from which a joint that stands does not follow: above the noise of its rates
    joint_after: float = 0.2  # [s]
    joint_room: float = 0.1  # [rad] from a limit of position within which a joint may stand
    joint_forgotten: float = 2.0  # [s] without a demand after which a stuck joint is given another chance
    probe: float = 0.15  # share of its rate with which a stuck joint is tried
    creep: float = 0.3  # share of its speed with which a stuck or late base goes on
    fingers_after: float = 0.3  # [s] after their command within which fingers move
    fingers_moved: float = 0.001  # [m]


@dataclass
class MotionState:
    """Memory of the checks of motion."""

    expected: Array = field(default_factory=lambda: np.zeros(2))  # twist that the base should have now
    told: Array = field(default_factory=lambda: np.zeros(2))  # twist
    rates: Array = field(default_factory=lambda: np.zeros(JOINTS))  # joint rates told last [rad/s]
    time: float | None = None
    standing: float = 0.0  # [s] that the base has stood although it should move
    differing: float = 0.0  # [s] that it has differed from what is expected
    well: float = 0.0  # [s] that it has followed well
    base: str = ""  # "" | base_stuck | base_late
    still: Array = field(default_factory=lambda: np.zeros(JOINTS))  # [s] that each joint has stood although told
    idle: float = 0.0  # [s] that nothing was asked of the stuck joint
    joint: int = -1  # the stuck one, counted from 0
    gripper: str = "open"
    since: float = 0.0  # [s] when the gripper's command changed
    width: float = 0.0  # [m] then
    fingers: str = ""  # "" | waited | stuck


def told(state: MotionState, actuation: Actuation, now: Observation) -> None:
    """Remember what the robot is told from now on."""
    state.told, state.rates = actuation.twist.copy(), actuation.joint_velocity.copy()
    if actuation.gripper != state.gripper:
        state.gripper, state.since, state.width, state.fingers = actuation.gripper, now.time, now.gripper_width, ""
        state.fingers = "waited"


def check_base(state: MotionState, now: Observation, dt: float, base: BaseLimits, settings: MotionSettings) -> None:
    """Compare the measured twist with what a base of this profile would do."""
    share = 1.0 if base.velocity_lag <= 0.0 else 1.0 - math.exp(-dt / base.velocity_lag)
    most = np.array([base.linear_acceleration, base.yaw_acceleration]) * dt
    state.expected = state.expected + np.clip(share * (state.told - state.expected), -most, most)
    largest = np.array([base.forward_speed, base.yaw_rate])
    expected, measured = state.expected / largest, now.twist / largest
    asked = np.abs(expected) > settings.asked
    stands = asked & (np.abs(measured) < settings.stands * np.abs(expected))
    differs = np.abs(measured - expected) > settings.late + settings.late_share * np.abs(expected)
    state.standing = state.standing + dt if bool(stands.any()) and not bool((asked & ~stands).any()) else 0.0
    state.differing = state.differing + dt if bool(differs.any()) else 0.0
    moves = asked & ~stands & ~differs
    if not bool((stands | differs).any()):
        state.well += dt if bool(moves.any()) or not state.base else 0.0
    else:
        state.well = 0.0
    if state.standing > settings.stuck_after:
        state.base = "base_stuck"
    elif state.differing > settings.late_after and state.base != "base_stuck":
        state.base = "base_late"
    if state.base and state.well > (settings.back_after if state.base == "base_late" else settings.stuck_after):
        state.base = ""
    if state.base == "base_stuck":
        state.expected = np.where(stands, state.expected, now.twist)


def check_joints(state: MotionState, now: Observation, dt: float, settings: MotionSettings) -> None:
    """Find the joint that stands although it is told to move."""
    rates = state.rates
    at_end = np.where(rates > 0.0, Q_MAX - now.q, now.q - Q_MIN) < settings.joint_room
    asked = (np.abs(rates) > settings.joint_asked) & ~at_end
    stands = np.abs(now.dq) < settings.stands * np.abs(rates)
    state.still = np.where(asked & stands, state.still + dt, np.where(stands & ~at_end, state.still, 0.0))
    if state.joint >= 0:
        k = state.joint
        follows = abs(now.dq[k]) > 0.5 * abs(rates[k]) and abs(rates[k]) > 0.01
        state.idle = state.idle + dt if abs(rates[k]) <= 0.01 else 0.0
        if follows or state.idle > settings.joint_forgotten:
            state.joint, state.idle = -1, 0.0
            state.still = np.zeros(JOINTS)
        return
    if float(state.still.max()) > settings.joint_after:
        state.joint, state.idle = int(np.argmax(state.still)), 0.0


def check_fingers(state: MotionState, now: Observation, profile: RobotProfile, settings: MotionSettings) -> None:
    """Fingers that have not moved a while after their command are stuck until they do."""
    if not state.fingers:
        return
    moved = now.gripper_moving or abs(now.gripper_width - state.width) > settings.fingers_moved
    widest = profile.gripper.max_width
    due = state.width > 0.9 * widest if state.gripper == "close" else state.width < 0.9 * widest
    if moved or not due:
        state.fingers = ""
    elif now.time - state.since > settings.fingers_after + now.ahead + now.age:
        state.fingers = "stuck"


def findings(state: MotionState, now: Observation, base: BaseLimits, settings: MotionSettings) -> list[Finding]:
    """Of wheels, joints and fingers."""
    found = []
    if state.base:
        axis = int(np.argmax(np.abs(state.expected - now.twist) / [base.forward_speed, base.yaw_rate]))
        found.append(_of_base(state, float(now.twist[axis]), axis, settings))
    if state.joint >= 0:
        rate = float(state.rates[state.joint])
        found.append(
            Finding(
                kind="joint_stuck", subject=f"joint {state.joint + 1}", value=float(now.dq[state.joint]), limit=rate,
                unit="rad/s", base=0.0,
                text=f"stopped: joint {state.joint + 1} of the arm does not follow its commands",
            )
        )  # fmt: skip
    if state.fingers == "stuck":
        found.append(
            Finding(
                kind="fingers_stuck", subject="fingers", value=now.gripper_width, limit=state.width, unit="m",
                base=0.0, arm=0.0,
                text=f"stopped: the fingers are told to {state.gripper} and stand at {1e3 * state.width:.0f} mm",
            )
        )  # fmt: skip
    return found


def joint_shares(state: MotionState, settings: MotionSettings, *, stands: bool) -> Array | None:
    """Shares of their rates that the joints keep, shape (7,), while one of them is stuck; None: all of it.

    The stuck one is tried gently, to find out when it is free. The others go on until the base ``stands``.
    """
    if state.joint < 0:
        return None
    shares = np.zeros(JOINTS) if stands else np.ones(JOINTS)
    shares[state.joint] = settings.probe
    return shares


def _of_base(state: MotionState, measured: float, axis: int, settings: MotionSettings) -> Finding:
    expected, unit = float(state.expected[axis]), ("m/s", "rad/s")[axis]
    if state.base == "base_stuck":
        text = f"the base does not follow: it is told {state.told[axis]:.2f} {unit} and does {measured:.2f} {unit}"
        return Finding(
            kind="base_stuck", subject="wheels", value=measured, limit=expected, unit=unit, base=settings.creep,
            text=text,
        )  # fmt: skip
    overshoot = abs(measured) > abs(expected) + 1e-9 and state.differing > 0.0
    share = 0.0 if overshoot else settings.creep
    did = "stopped" if overshoot else "slowed"
    return Finding(
        kind="base_late", subject="wheels", value=measured, limit=expected, unit=unit, base=share,
        text=f"{did}: the base follows late, it does {measured:.2f} {unit} where {expected:.2f} {unit} were due",
    )  # fmt: skip
