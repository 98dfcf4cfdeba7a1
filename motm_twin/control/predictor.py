"""The robot's state when the next command acts: its newest state, predicted with the commands already sent.

Plans of the base start at `command_pose`, to which the commands given so far will take it; the base follows a plan
later, by its lag. A command that has expired brings base and arm to rest; robot and twin agree on that.
The model is that of the robot's profile: first-order lag, limits of speed and acceleration, exact arcs.
"""

from collections import deque
from collections.abc import Iterable

import msgspec
import numpy as np

from motm_twin.model.compiler import njit
from motm_twin.model.geometry import Array
from motm_twin.model.motion import drive, lag_share
from motm_twin.model.plant import ARM_STEP, Actuation
from motm_twin.model.profile import DDQ_MAX, DQ_MAX, Q_MAX, Q_MIN, RobotProfile, braking_time
from motm_twin.planning.types import BasePlan

ROUNDING = 1e-6  # [s]
KEPT = 1000  # commands
DOUBT = 0.1  # [s] after a change of the gripper's command, in which a reported state may not show it yet
FARTHEST = 0.6  # [s] longest prediction


class Motion(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """State of the robot's moving parts."""

    stamp: float  # [s]
    pose: Array
    odometry: Array
    twist: Array
    q: Array
    dq: Array
    gripper_moving: bool


class Predictor:
    """Remembers commands, and predicts with them."""

    def __init__(
        self, profile: RobotProfile, lifetime: float, commands: Iterable[tuple[float, Actuation]] = ()
    ) -> None:
        """``lifetime`` [s] after which a command expires; ``commands`` given before, each with the time it acts [s]."""
        self._profile, self._lifetime = profile, lifetime
        self._commands: deque[tuple[float, Actuation]] = deque(commands, maxlen=KEPT)

    def clear(self) -> None:
        """Forget the commands."""
        self._commands.clear()

    def sent(self, act_at: float, actuation: Actuation) -> None:
        """Remember a command that acts from ``act_at`` [s] on; these times never decrease."""
        self._commands.append((act_at, actuation))

    def predict(self, motion: Motion, until: float) -> Motion:
        """The motion at ``until`` [s]; the same one when that is not later than its stamp."""
        until = min(until, motion.stamp + FARTHEST)
        if until <= motion.stamp + ROUNDING:
            return motion
        stamp, pose, odometry = motion.stamp, motion.pose, motion.odometry
        v, w = float(motion.twist[0]), float(motion.twist[1])
        q, dq = motion.q, motion.dq
        known, moving = self._acting(stamp - DOUBT), motion.gripper_moving
        lag = self._profile.arm.velocity_lag
        while stamp < until - ROUNDING:
            dt = min(ARM_STEP, until - stamp)
            acting = self._acting(stamp)
            new_v, new_w = self._base(v, w, acting.twist, dt)
            pose = drive(pose, 0.5 * (v + new_v), 0.5 * (w + new_w), dt)
            odometry = drive(odometry, 0.5 * (v + new_v), 0.5 * (w + new_w), dt)
            v, w = new_v, new_w
            q, dq = _arm(q, dq, acting.joint_velocity, lag_share(lag, dt), dt, Q_MIN, Q_MAX, DQ_MAX, DDQ_MAX)
            moving = moving or (acting.gripper, acting.opening) != (known.gripper, known.opening)
            stamp += dt
        return Motion(
            stamp=until, pose=pose, odometry=odometry, twist=np.array([v, w]), q=q, dq=dq, gripper_moving=moving
        )

    def _acting(self, now: float) -> Actuation:
        """The command that acts now [s]."""
        for act_at, actuation in reversed(self._commands):
            if act_at <= now + ROUNDING:
                over = now - act_at - self._lifetime
                if over < -ROUNDING:
                    return actuation
                return expired(actuation, max(0.0, over))
        at_rest = Actuation(twist=np.zeros(2), joint_velocity=np.zeros(7), gripper="open")
        if not self._commands:
            return at_rest
        first = self._commands[0][1]
        return msgspec.structs.replace(at_rest, gripper=first.gripper, opening=first.opening)

    def _base(self, v: float, w: float, desired: Array, dt: float) -> tuple[float, float]:
        limits = self._profile.base
        share = lag_share(limits.velocity_lag, dt)
        dv, dw = limits.linear_acceleration * dt, limits.yaw_acceleration * dt
        return v + min(dv, max(-dv, share * (desired[0] - v))), w + min(dw, max(-dw, share * (desired[1] - w)))


@njit(cache=True)
def _arm(
    q: Array, dq: Array, command: Array, share: float, dt: float,
    q_min: Array, q_max: Array, dq_max: Array, ddq_max: Array,
) -> tuple[Array, Array]:  # fmt: skip
    """Joint positions and rates after dt [s]; a joint stops at its limit."""
    new_q, new_dq = np.empty_like(q), np.empty_like(dq)
    for i in range(q.shape[0]):
        change = share * (min(dq_max[i], max(-dq_max[i], command[i])) - dq[i])
        new_dq[i] = dq[i] + min(ddq_max[i] * dt, max(-ddq_max[i] * dt, change))
        new_q[i] = q[i] + 0.5 * (dq[i] + new_dq[i]) * dt
        if new_q[i] > q_max[i] or new_q[i] < q_min[i]:
            new_q[i], new_dq[i] = min(q_max[i], max(q_min[i], new_q[i])), 0.0
    return new_q, new_dq


def expired(acting: Actuation, since: float) -> Actuation:
    """The command in effect ``since`` [s] after ``acting`` has expired.

    The base ramps to a stop within its limits, the joints come to rest together, the gripper stays as it is.
    """
    longest = braking_time(acting.joint_velocity)
    share = 1.0 - since / longest if since < longest else 0.0
    return msgspec.structs.replace(acting, twist=np.zeros(2), joint_velocity=share * acting.joint_velocity)


def dwell_to_plan(dwell: float | None, engaged: bool, lag: float) -> float | None:
    """Time [s] for which a plan must keep the target in reach; None: as long as the whole job takes.

    While the arm is engaged, the lag of the base keeps the target in reach for longer, so the plan needs to cover less.
    """
    return max(0.0, dwell - lag) if engaged and dwell is not None else dwell


def followed(plan: BasePlan, lag: float, passed: float = 0.0) -> tuple[float, Array]:
    """Time [s] until the target comes into range, and until the base is at each pose of a plan ``passed`` [s] old."""
    later = lag - passed
    to_range = max(0.0, plan.time_to_range + later) if plan.time_to_range > 0.0 else 0.0
    return to_range, np.maximum(0.0, plan.local_times + later)
