"""The arm's monitor: the last word on the arm before the plant. It knows limits and mapped furniture, and no goals.

No body of the arm may come to a solid faster than it can brake before it:

    approach speed  <=  sqrt(2 a (d - d_0)),      d_0 = `KEPT`, a = `BRAKING`

whether base or joints move it. Below d_0 it may only move away. The part of the base's motion that joints near their
limits cannot cancel may be no faster than the base can brake. When a command breaks the line, the joints brake the
approach, if need be as hard as they can; near furniture the base brakes, too. Clearance thus does not rest on the rows
of the arm's program alone, which are elastic. The motion of joints that do not follow their commands counts, too.
"""

import math
from typing import Annotated, NamedTuple

import msgspec
import numpy as np

from motm_twin.control.arm.bodies import (
    BODIES,
    COLUMN,
    Balls,
    IntArray,
    Solids,
    arm_balls,
    body_distances,
    mapped_solids,
    own_body,
    placed,
)
from motm_twin.control.arm.limits import approach_row
from motm_twin.control.arm.parameters import Numbers, numbers
from motm_twin.model.arm_kernels import fk_arm
from motm_twin.model.compiler import njit
from motm_twin.model.geometry import Array, frozen, to_frame
from motm_twin.model.known import KnownWorld
from motm_twin.model.number import OWN, Number
from motm_twin.model.plant import ARM_STEP, Actuation, Observation
from motm_twin.model.profile import DDQ_MAX, DQ_MAX, Q_MAX, Q_MIN, WRIST_MIN
from motm_twin.model.reason import Kind, Reason

_REACTION = 2.0 * ARM_STEP  # [s] until an uncommanded motion is measured and braked
_LOOK = 0.15  # [m] from a body of the arm: no hand is so fast that solids further off matter yet
_ROUNDS = 4  # of holding back the body that is most above its speed: a wedged arm has several
_ENOUGH = 1e-3  # [m/s] over the line that is tolerated
NOWHERE = frozen(np.zeros(7))


class ArmMonitorParameters(msgspec.Struct, frozen=True, kw_only=True):
    """Distances that the arm keeps from solids that it must not touch, whatever its program says."""

    kept: Annotated[float, Number("m", OWN, "distance of every arm body from mapped furniture")] = 0.003
    braking: Annotated[
        float,
        Number(
            "m/s^2",
            OWN,
            "deceleration of an arm body before furniture: half of what the joints can with a stretched arm",
        ),
    ] = 5.0
    own_kept: Annotated[float, Number("m", OWN, "distance of every arm body from floor and own base")] = 0.015
    own_braking: Annotated[
        float,
        Number("m/s^2", OWN, "deceleration of an arm body before floor and own base: a folded arm has short levers"),
    ] = 2.0
    taking: Annotated[
        float,
        Number("s", OWN, "time in which joints get to their limits while the arm takes up the way of a braking base"),
    ] = 0.5
    lost: Annotated[
        float,
        Number(
            "rad/s",
            OWN,
            "joint rate beyond all commands from which a joint does not follow: it may stand at once, or go on",
        ),
    ] = 0.1


class Verdict(NamedTuple):
    """The command that passes, and why it differs from the one asked for; None when it does not."""

    actuation: Actuation
    why: Reason | None

    @property
    def reason(self) -> str:
        """`why` in one sentence; "" for none."""
        return "" if self.why is None else str(self.why)


class _Arm(NamedTuple):
    """The arm of one step as kernels read it."""

    q: Array  # [rad], shape (7,)
    dq: Array  # [rad/s], shape (7,)
    rates: Array  # that are to be commanded [rad/s], shape (7,); lowered in place
    astray: Array  # [rad/s] of joints beyond what the commands explain, shape (7,)
    mount: Array  # [m] in the base frame, shape (3,)
    balls: Balls


class ArmMonitor:
    """Keeps the arm off mapped furniture, bins, floor and its own base, whatever its program says. It has no state."""

    def __init__(self, known: KnownWorld, parameters: ArmMonitorParameters | None = None) -> None:
        """The robot and the furniture of its map."""
        parameters = parameters or ArmMonitorParameters()
        self._lost, self._numbers = parameters.lost, numbers(parameters)
        mapped, own = mapped_solids(known), own_body(known, floor=True)
        self._names = (*mapped.names, *own.names)
        self._furniture, self._own = mapped.solids, own.solids
        self._balls = arm_balls()
        arm, self._base = known.robot.arm, known.robot.base
        self._mount = np.array([arm.mount_x, arm.mount_y, arm.mount_z])
        self._has_arm, self._lag = known.robot.has_arm, arm.velocity_lag

    def check(
        self, actuation: Actuation, observation: Observation, twist: Array, dt: float, *,
        T_odom_world: Array, held_side: float, astray: Array = NOWHERE,
    ) -> Verdict:  # fmt: skip
        """The actuation for the next dt [s], slowed where the arm would come too near to a solid.

        ``twist`` (2,): base twist commanded last, from which the base brakes. ``held_side`` [m] of a cube in the hand
        that is clear of its support, 0: none. ``astray`` (7,): joint rates [rad/s] beyond what the commands explain.
        """
        rates = actuation.joint_velocity
        parts = (rates, observation.odometry, observation.twist, observation.q, observation.dq)
        if not self._has_arm or not math.isfinite(sum(float(part.sum()) for part in parts)):
            return Verdict(actuation, None)  # the base's monitor stops the robot
        there = np.append(to_frame(T_odom_world, observation.odometry[:2]), observation.odometry[2] - T_odom_world[2])
        balls = placed(self._balls, observation.gripper_width, held_side)
        kept = rates.copy()
        folds = _unfold(kept, observation, dt)
        arm = _Arm(observation.q, observation.dq, kept, astray, self._mount, balls)
        lost = bool((np.abs(astray) > self._lost).any())
        settles = dt + self._lag if lost else dt  # the other joints may brake harder if one of them does not follow
        body, solid, distance, speed = _hold_back(
            arm,
            there,
            observation.twist,
            settles,
            self._furniture,
            self._own,
            self._base.linear_acceleration,
            self._numbers,
        )
        if body < 0:
            why = Reason(kind=Kind.ARM_FOLDS, subject="hand", other="forearm") if folds else None
            return Verdict(msgspec.structs.replace(actuation, joint_velocity=kept) if folds else actuation, why)
        limits = np.array([self._base.linear_acceleration, self._base.yaw_acceleration]) * dt
        slower = twist - np.clip(twist, -limits, limits) if solid < len(self._furniture.z) else actuation.twist
        why = Reason(
            kind=Kind.ARM_NEAR_SOLID, subject=BODIES[body], other=self._names[solid], value=speed,
            limit=max(distance, 0.0), unit="m/s",
        )  # fmt: skip
        return Verdict(msgspec.structs.replace(actuation, twist=slower, joint_velocity=kept), why)


def _unfold(rates: Array, now: Observation, dt: float) -> bool:
    """Slow joint 6 in ``rates`` (7,), in place, so that it stops before the hand is folded onto the forearm.

    Returns whether it was too fast. It is slowed no harder than it brakes in dt [s].
    """
    braking = 0.5 * float(DDQ_MAX[5])
    slowest = -math.sqrt(2.0 * braking * max(float(now.q[5]) - WRIST_MIN, 0.0))
    if rates[5] >= slowest - _ENOUGH:
        return False
    rates[5] = min(slowest, float(now.dq[5]) + float(DDQ_MAX[5]) * dt)
    return True


@njit(cache=True)
def _hold_back(
    arm: _Arm, pose: Array, twist: Array, settles: float, furniture: Solids, own: Solids, braking: float,
    numbers: Numbers,
) -> tuple[int, int, float, float]:  # fmt: skip
    """Lower the arm's rates, in place, until no body exceeds its speed limit or the joints brake as hard as they can.

    ``pose`` (3,): base in the frame of the furniture; ``twist`` (2,): its measured twist; ``braking`` [m/s^2]: its
    deceleration; ``settles`` [s]: time in which joints reach a rate. Returns body and solid (furniture first, then
    ``own``) with the largest excess in the first round, their distance [m] and speed [m/s]; body -1: no excess.
    """
    T, p, origin = fk_arm(arm.q), numbers[0], np.zeros(3)
    seen, own_seen = _near(T, arm, pose, furniture, np.int64(-1)), _near(T, arm, origin, own, np.int64(COLUMN))
    solids = furniture.z.shape[0]
    found, solid, near, speed = -1, 0, np.inf, 0.0
    row, own_row = np.empty(9), np.empty(9)
    for _ in range(_ROUNDS):
        excess, b, k, fast = _worst(T, arm, pose, twist, seen, (p.kept, p.braking, braking), row, numbers)
        own_excess, own_b, own_k, own_fast = _worst(
            T, arm, origin, origin, own_seen, (p.own_kept, p.own_braking, braking), own_row, numbers
        )
        if max(excess, own_excess) < _ENOUGH:
            break
        if own_excess > excess:
            excess, b, k, fast = own_excess, own_b, own_k + solids, own_fast
            for joint in range(9):
                row[joint] = own_row[joint]
        if found < 0:
            found, solid, speed = b, k, fast
            near = seen[0][b, k] if k < solids else own_seen[0][b, k - solids]
        _slow(arm, row, excess, settles, p.lost)
    return found, solid, near, speed


@njit(cache=True)
def _near(T: Array, arm: _Arm, pose: Array, solids: Solids, column: int) -> tuple[Array, Array, IntArray]:
    """`body_distances` of solids in whose frame the base is at a pose (3,)."""
    c, s, mount = math.cos(pose[2]), math.sin(pose[2]), arm.mount
    there = np.array([
        pose[0] + c * mount[0] - s * mount[1], pose[1] + s * mount[0] + c * mount[1], mount[2], pose[2]
    ])  # fmt: skip
    return body_distances(T, arm.balls, np.full(len(BODIES), _LOOK), there, solids, column)


@njit(cache=True)
def _worst(
    T: Array, arm: _Arm, pose: Array, twist: Array, seen: tuple[Array, Array, IntArray],
    line: tuple[float, float, float], worst: Array, numbers: Numbers,
) -> tuple[float, int, int, float]:  # fmt: skip
    """Largest excess [m/s] of a body over its speed limit, body and solid, its speed; fills in its row (9,).

    ``seen`` is from `_near`; ``line``: the distance [m] kept, and the braking [m/s^2]
    of the arm, and of the base for motion that the arm cannot take up.
    """
    distance, away, ball = seen
    p = numbers[0]
    excess, b, k, fast, row = 0.0, -1, 0, 0.0, np.empty(9)
    for i in range(distance.shape[0]):
        for n in range(distance.shape[1]):
            d = distance[i, n]
            if not d < _LOOK:
                continue
            to, normal = ball[i, n], away[i, n]
            frame, centre = arm.balls.frame[to], arm.balls.centre[to]
            approach_row(T, frame, centre, pose, arm.mount, normal[0], normal[1], normal[2], row)
            carried = row[0] * twist[0] + row[1] * twist[1]
            approach, feared = carried, 0.0
            for joint in range(7):
                part = row[2 + joint] * arm.rates[joint]
                approach += part
                if abs(arm.astray[joint]) > p.lost:
                    feared += max(row[2 + joint] * arm.dq[joint], 0.0) - part
            room = max(d - line[0], 0.0)
            over = approach - math.sqrt(2.0 * line[1] * room)
            if feared > 0.0:
                left = max(room - _REACTION * (approach + feared), 0.0)
                over = max(over, approach + feared - math.sqrt(2.0 * line[1] * left))
            if carried > 0.0:
                over = max(over, carried - _taken_up(arm.q, row, p.taking) - math.sqrt(2.0 * line[2] * room))
            if over > excess:
                excess, b, k, fast = over, i, n, approach
                for joint in range(9):
                    worst[joint] = row[joint]
    return excess, b, k, fast


@njit(cache=True)
def _taken_up(q: Array, row: Array, taking: float) -> float:
    """Base speed [m/s] along a row (9,) that joint motion can cancel before the joints reach their limits."""
    total = 0.0
    for k in range(7):
        room = q[k] - Q_MIN[k] if row[2 + k] > 0.0 else Q_MAX[k] - q[k]
        total += abs(row[2 + k]) * min(DQ_MAX[k], max(room, 0.0) / taking)
    return total


@njit(cache=True)
def _slow(arm: _Arm, row: Array, excess: float, settles: float, lost: float) -> None:
    """Take a speed [m/s] along a row off the arm's rates, each joint in proportion to how hard it can brake.

    Joints reach a rate in the time ``settles`` [s]; those that do not follow their commands are not counted on.
    """
    able = 0.0
    for k in range(7):
        able += abs(row[2 + k]) * DDQ_MAX[k] * settles if abs(arm.astray[k]) < lost else 0.0
    share = min(1.0, excess / max(able, 1e-9))
    for k in range(7):
        most = DDQ_MAX[k] * settles
        rate = arm.rates[k] - share * math.copysign(most, row[2 + k])
        rate = min(max(rate, arm.dq[k] - most), arm.dq[k] + most)
        arm.rates[k] = min(max(rate, -DQ_MAX[k]), DQ_MAX[k])
