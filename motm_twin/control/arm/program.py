"""The quadratic program of one arm step: cost, motion of the hand, limits, bounds.

Decision ``x = (v, w, seven arm rates, six slacks of the hand's velocity, two elastic variables)``, where (v, w) is the
base twist that is commanded. The hand obeys ``J_b v_hat + J_a qdot + slack = nu`` with the base rates ``v_hat`` that
the base will really have: its velocity loop lags by ``tau``, so that after the time t

    v_hat = v_measured + beta (u - v_measured),   beta = 1 - exp(-t / tau),

and t is half a step plus the lag of the arm, the mean delay until the commanded arm rates act.
"""

import functools
import itertools
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from motm_twin.control.arm.bodies import BODIES, HAND_BODY, arm_balls, placed
from motm_twin.control.arm.geometry import polar
from motm_twin.control.arm.limits import (
    Around,
    IntArray,
    LidarLimits,
    Limit,
    Rows,
    arm_limits,
    damper_line,
    furniture_distances,
    lidar_limits,
)
from motm_twin.control.arm.motion import Motion
from motm_twin.control.arm.parameters import ArmParameters, Numbers, QpParameters, numbers
from motm_twin.control.arm.qp import Program
from motm_twin.control.arm.types import ArmInputs, Phase
from motm_twin.control.arm.view import Arm, ManipulatorState, View
from motm_twin.control.reasons import STANDSTILL
from motm_twin.model.arm_kernels import factored_gradient
from motm_twin.model.compiler import njit
from motm_twin.model.geometry import Array
from motm_twin.model.known import KnownWorld
from motm_twin.model.motion import lag_share
from motm_twin.model.profile import DDQ_MAX, DQ_MAX, Q_MAX, Q_MIN, WRIST_MIN, RobotProfile

SIZE = 17
BASE = slice(0, 2)
ARM = slice(2, 9)
SLACK = slice(9, 15)
LIDAR_ELASTIC, FURNITURE_ELASTIC = 15, 16
AT_SUPPORT = (
    Phase.FINAL,
    Phase.CLOSING,
    Phase.LIFT,
    Phase.RETRY,
)  # phases in which the fingers are at the supporting surface
TWISTING = (2, 4)  # joints 3 and 5 turn the arm out of its plane
_SWINGING = (Phase.STOW, Phase.CARRY, Phase.TRANSIT)
_SLACKS = SLACK.start, SLACK.stop - SLACK.start
_SLACK_BOUND = 20.0  # [m/s, rad/s]
STUCK_RATE = 0.05  # [rad/s] with which a stuck joint is tried: enough to tell from the noise of its rate
_SPEED = 2  # row of `joint_limits`
_CARRIED = tuple(f"{body} - " for body in BODIES[: HAND_BODY - 1])  # prefixes of the rows of elbow and forearm
_FREE = 1.0e3  # bound of elastic variables [m/s]


class ActiveRows(NamedTuple):
    """The inequality rows of one step."""

    names: tuple[str, ...]  # of all possible rows
    hard: frozenset[str]  # names of rows of limits that are not soft
    which: IntArray  # index of each row into `names`, shape (k,)
    limiter: str  # the gripper's obstacle that limits it most: "moving obstacle", "static obstacle", "" none is near
    allowed: float  # [m/s] its damper line, inf when none is near


class _Constants(NamedTuple):
    """Numbers of the program that do not change."""

    qp: Numbers
    base: Numbers
    joints: Array  # of `joint_limits`, shape (4, 7)


class ArmProgram:
    """min 1/2 x'Px + c'x: track v_B, small arm rates, manipulability, little slack; s.t. the hand's velocity."""

    def __init__(self, known: KnownWorld, parameters: ArmParameters, more: Sequence[Limit] = ()) -> None:
        """Programs of one robot among its mapped furniture; ``more``: limits beside the usual ones."""
        p = parameters
        limits = (*arm_limits(known, p.avoidance), *more)
        self._names = tuple(name for limit in limits for name in limit.names)
        self._carried = np.array(
            [not limit.soft and name.startswith(_CARRIED) for limit in limits for name in limit.names]
        )
        self._hard = frozenset(name for limit in limits if not limit.soft for name in limit.names)
        first = itertools.accumulate((len(limit.names) for limit in limits), initial=0)
        self._limits = list(zip(limits, first, strict=False))
        self._avoidance = numbers(p.avoidance)
        self._braking = known.robot.base.linear_acceleration
        self._slope = (p.avoidance.furniture_d_i - p.avoidance.furniture_d_s) / p.avoidance.xi
        self._blind = p.avoidance.blind
        self._lag = known.robot.arm.velocity_lag
        self._weights = {
            (swinging, kept): weights(p.qp, swinging=swinging, kept=kept)
            for swinging in (False, True)
            for kept in (False, True)
        }
        joints = joint_limits(p.qp.elbow_limit)
        self._constants = _Constants(numbers(p.qp), numbers(known.robot.base), joints)
        self._balls = arm_balls()

    def fill(
        self, view: View, state: ManipulatorState, inputs: ArmInputs, relaxing: Array, motion: Motion
    ) -> tuple[Program, ActiveRows]:
        """The program of one step, for a motion of the hand.

        ``relaxing`` [m], shape (t, 2): grasps for which static obstacles give way. The commands remembered in the state
        are kept near the motion of the robot, in case another program commanded it.
        """
        swinging, arm, base = state.phase in _SWINGING, view.arm, self._constants.base
        anchor(state.twist, state.rates, (arm.desired, arm.dq), base, inputs.dt, self._lag)
        around = self._around(view, state, inputs, relaxing)
        found = [(limit.rows(arm, around), first, limit.soft) for limit, first in self._limits]
        found = [one for one in found if len(one[0].h)]
        G, h, which = stacked(found, view.beta, arm.measured)
        cost = self._weights[swinging, state.holding or motion.crosses]
        c, A, b, lower, upper = _program(
            arm, motion.velocity, self._brakable(arm.desired, found), state.twist,
            *self._joints(state.rates, inputs.stuck_joint), cost, (view.manipulability, view.beta, inputs.dt, swinging),
        )  # fmt: skip
        program = Program(P=cost, c=c, A=A, b=b, G=G, h=h, lower=lower, upper=upper, slack=_SLACKS)
        return program, ActiveRows(self._names, self._hard, which, *_limiter(around.gripper))

    def _brakable(self, desired: Array, found: Sequence[tuple[Rows, int, bool]]) -> Array:
        """The base twist (2,), slowed where the base could not brake before it carried the arm into furniture.

        Only elbow and forearm count: the hand keeps its place whatever the base does, but elbow and forearm must follow
        the base.
        """
        share = 1.0
        for rows, first, _ in found:
            of = self._carried[first + rows.name]
            share = min(share, brakable_share(rows, of, desired, self._braking, self._slope))
        return share * desired

    def _joints(self, rates: Array, stuck: int | None) -> tuple[Array, _Constants]:
        """Arm rates commanded last and constants; a ``stuck`` joint gets `STUCK_RATE`, and the others do its work."""
        if stuck is None:
            return rates, self._constants
        rates, joints = rates.copy(), self._constants.joints.copy()
        rates[stuck], joints[_SPEED, stuck] = 0.0, STUCK_RATE
        return rates, self._constants._replace(joints=joints)

    def _around(self, view: View, state: ManipulatorState, inputs: ArmInputs, relaxing: Array) -> Around:
        points, static = inputs.obstacles.kept_from()
        blind = self._blind if inputs.observation.ahead > 0.0 else 0.0
        d_s, d_i = furniture_distances(
            self._avoidance, state.phase in AT_SUPPORT, blind, float(inputs.observation.pose_sd)
        )
        return Around(
            points=points,
            static=static,
            gripper=lidar_limits(view.p, points, static, relaxing, self._avoidance),
            balls=placed(self._balls, view.width, state.side if state.holding else 0.0),
            d_s=d_s,
            d_i=d_i,
        )


def _limiter(gripper: LidarLimits) -> tuple[str, float]:
    if not len(gripper.allowed):
        return "", math.inf
    tightest = int(gripper.allowed.argmin())
    kind = "static obstacle" if gripper.static[tightest] else "moving obstacle"
    return kind, float(gripper.allowed[tightest])


def lag_factor(dt: float, profile: RobotProfile) -> float:
    """beta: the share of a commanded change of the base twist that is reached when the arm's rates act."""
    return lag_share(profile.base.velocity_lag, 0.5 * dt + profile.arm.velocity_lag)


@njit(cache=True)
def _joint_bounds(
    q: Array, previous: Array, dt: float, limits: Array, eta: float, rho_i: float, rho_s: float, lower: Array,
    upper: Array,
) -> None:  # fmt: skip
    for k in range(7):
        q_min, q_max, speed, acceleration = limits[0, k], limits[1, k], limits[2, k], limits[3, k]
        low = -min(speed, _damped(q[k] - q_min, eta, rho_i, rho_s))
        high = min(speed, _damped(q_max - q[k], eta, rho_i, rho_s))
        slow, fast = previous[k] - acceleration * dt, previous[k] + acceleration * dt
        lower[k] = min(max(low, slow), fast)  # a limit that cannot be met within one step is met as fast as possible
        upper[k] = max(min(high, fast), slow)
        if lower[k] > upper[k]:
            middle = 0.5 * (lower[k] + upper[k])
            lower[k], upper[k] = middle, middle


@njit(cache=True)
def _damped(room: float, eta: float, start: float, stop: float) -> float:
    """Largest speed towards a limit that is ``room`` away: the damper line from ``start`` on."""
    return np.inf if room >= start else damper_line(room, stop, start, eta)


_LIMITS = np.vstack([Q_MIN, Q_MAX, DQ_MAX, DDQ_MAX])


def joint_bounds(q: Array, previous: Array, dt: float, parameters: QpParameters) -> tuple[Array, Array]:
    """Bounds of the arm rates: speed, acceleration round the previous command, damper before position limits."""
    p, lower, upper = parameters, np.empty(7), np.empty(7)
    limits = joint_limits(p.elbow_limit)
    _joint_bounds(q, previous, dt, limits, p.damper_gain, p.damper_start, p.damper_stop, lower, upper)
    return lower, upper


@functools.cache
def joint_limits(elbow_limit: float) -> Array:
    """Least and largest joint angles, speeds and accelerations, shape (4, 7); joint 4 up to ``elbow_limit`` [rad]."""
    limits = _LIMITS.copy()
    limits[0, 5] = max(limits[0, 5], WRIST_MIN)
    limits[1, 3] = min(limits[1, 3], elbow_limit)
    return limits


def base_bounds(previous: Array, dt: float, profile: RobotProfile) -> tuple[Array, Array]:
    """Bounds of the commanded base twist: one step's acceleration round the previous command, and the speed limits."""
    lower, upper = np.empty(2), np.empty(2)
    _base_bounds(previous, dt, numbers(profile.base), lower, upper)
    return lower, upper


@njit(cache=True)
def _base_bounds(previous: Array, dt: float, base: Numbers, lower: Array, upper: Array) -> None:
    limits = base[0]
    most, fastest = (limits.linear_acceleration, limits.yaw_acceleration), (limits.forward_speed, limits.yaw_rate)
    slowest = (-limits.reverse_speed, -limits.yaw_rate)
    for k in range(2):
        low = min(max(previous[k] - most[k] * dt, slowest[k]), fastest[k])
        high = max(min(previous[k] + most[k] * dt, fastest[k]), slowest[k])
        lower[k], upper[k] = min(low, high), max(low, high)


def stacked(limits: Sequence[tuple[Rows, int, bool]], beta: float, measured: Array) -> tuple[Array, Array, IntArray]:
    """G (k, 17), h (k,), and the index of each row's name; ``limits``: rows, index of the first name, soft or not.

    Soft rows give way with another elastic variable than the others.
    """
    count = sum(len(rows.h) for rows, _, _ in limits)
    G, h, which = np.zeros((count, SIZE)), np.empty(count), np.empty(count, np.int64)
    r = 0
    for rows, first, soft in limits:
        end = r + len(rows.h)
        G[r:end, :9], h[r:end], which[r:end] = rows.G, rows.h, rows.name + first
        G[r:end, LIDAR_ELASTIC if soft else FURNITURE_ELASTIC] = -1.0
        r = end
    _of_commands(G, h, beta, measured)
    return G, h, which


@njit(cache=True)
def brakable_share(rows: Rows, of: NDArray[np.bool_], desired: Array, braking: float, slope: float) -> float:
    """Largest share of a base twist (2,) with which no row marked in ``of`` (k,) is approached too fast to brake.

    ``braking`` [m/s^2]: of the base; ``slope`` [s]: room over speed of the rows' damper line.
    """
    share = 1.0
    for k in range(rows.h.shape[0]):
        carried = rows.G[k, 0] * desired[0] + rows.G[k, 1] * desired[1]
        if of[k] and carried > STANDSTILL[0]:
            fastest = max(STANDSTILL[0], math.sqrt(2.0 * braking * slope * max(rows.h[k], 0.0)))
            share = min(share, fastest / carried)
    return share


@njit(cache=True)
def _of_commands(G: Array, h: Array, beta: float, measured: Array) -> None:
    """Turn rows over the resulting base twist into rows over the commanded one, in place."""
    for r in range(G.shape[0]):
        h[r] -= (1.0 - beta) * (G[r, 0] * measured[0] + G[r, 1] * measured[1])
        G[r, 0], G[r, 1] = beta * G[r, 0], beta * G[r, 1]


def weights(parameters: QpParameters, *, swinging: bool, kept: bool) -> Array:
    """Diagonal of the quadratic cost, shape (17,); ``swinging``: on the way, where the hand need not move exactly.

    ``kept``: its height is kept all the same, since a low hand, or the object that it holds, would hit objects below.
    """
    p = parameters
    linear = p.swing_linear_slack_weight if swinging else p.linear_slack_weight
    twist = p.swing_twist_rate_weight if swinging else p.twist_rate_weight
    tilt = p.swing_tilt_slack_weight if swinging else p.tilt_slack_weight
    return np.array(
        [p.base_weight] * 2
        + [twist if joint in TWISTING else p.rate_weight for joint in range(7)]
        + [linear] * 2
        + [p.linear_slack_weight if kept else linear]
        + [tilt] * 2
        + [p.swing_yaw_slack_weight if swinging else p.yaw_slack_weight]
        + [p.elastic_weight] * 2
    )


@njit(cache=True)
def _program(
    arm: Arm, velocity: Array, desired: Array, twist: Array, rates: Array, constants: _Constants, cost: Array,
    now: tuple[float, float, float, bool],
) -> tuple[Array, Array, Array, Array, Array]:  # fmt: skip
    """Linear cost, rows A x = b and bounds; ``twist``, ``rates``: commanded last, ``cost`` from `weights`.

    ``now``: manipulability, beta, step [s], and whether the hand swings.
    """
    dexterity, beta, dt, swinging = now
    n = constants.qp[0]
    more = n.swing_posture if swinging else 1.0
    c, lower, upper = np.zeros(SIZE), np.empty(SIZE), np.empty(SIZE)
    gradient = factored_gradient(arm.jacobian, arm.factor, dexterity)
    azimuth = polar(arm.p, arm.pose, arm.base_mount)[1]
    error = posture_error(arm.q, azimuth, more * n.posture_gain, more * n.posture_rate)
    for k in range(2):
        c[k] = -n.base_weight * desired[k]
    for k in range(7):
        c[2 + k] = cost[2 + k] * error[k] - n.manipulability_weight * gradient[k]
    c[LIDAR_ELASTIC] = c[FURNITURE_ELASTIC] = n.elastic_weight
    A, b = _hand_rows(arm, velocity, beta)
    _base_bounds(twist, dt, constants.base, lower[:2], upper[:2])
    _joint_bounds(
        arm.q, rates, dt, constants.joints, n.damper_gain, n.damper_start, n.damper_stop, lower[2:9], upper[2:9]
    )
    lower[9:15], upper[9:15] = -_SLACK_BOUND, _SLACK_BOUND
    lower[15:], upper[15:] = 0.0, _FREE
    return c, A, b, lower, upper


@njit(cache=True)
def _hand_rows(arm: Arm, velocity: Array, beta: float) -> tuple[Array, Array]:
    """A x = b of the hand: ``beta J_b u + J_a qdot + slack = nu - (1 - beta) J_b v_measured``, shapes (6, 17), (6,)."""
    A, b, J = np.zeros((6, SIZE)), np.empty(6), arm.J
    for r in range(6):
        A[r, 0], A[r, 1] = beta * J[r, 0], beta * J[r, 1]
        for k in range(2, 9):
            A[r, k] = J[r, k]
        A[r, 9 + r] = 1.0
        b[r] = velocity[r] - (1.0 - beta) * (J[r, 0] * arm.measured[0] + J[r, 1] * arm.measured[1])
    return A, b


@njit(cache=True)
def anchor(twist: Array, rates: Array, near: tuple[Array, Array], base: Numbers, dt: float, lag: float) -> None:
    """Clamp, in place, the last base twist (2,) near the wanted one and the last arm rates (7,) near the measured ones.

    ``near``: desired twist and measured rates. Rates may differ by what joints change in ``lag`` [s] and three steps.
    """
    desired, dq = near
    limits, follow = base[0], lag + 3.0 * dt
    room_v, room_w = 2.0 * dt * limits.linear_acceleration, 2.0 * dt * limits.yaw_acceleration
    twist[0] = _clipped(twist[0], desired[0] - room_v, desired[0] + room_v)
    twist[1] = _clipped(twist[1], desired[1] - room_w, desired[1] + room_w)
    for k in range(7):
        room = DDQ_MAX[k] * follow
        rates[k] = _clipped(_clipped(rates[k], dq[k] - room, dq[k] + room), -DQ_MAX[k], DQ_MAX[k])


@njit(cache=True)
def _clipped(value: float, low: float, high: float) -> float:
    """As np.clip: the value itself unless it is outside."""
    lifted = low if value < low else value
    return high if lifted > high else lifted


@njit(cache=True)
def posture_error(q: Array, azimuth: float, gain: float, fastest: float) -> Array:
    """Rates [rad/s] of joints 1, 3 and 5 away from an arm in the plane of that azimuth, shape (7,)."""
    error = np.zeros(7)
    error[0] = _clipped(gain * (q[0] - azimuth), -fastest, fastest)
    error[2] = _clipped(gain * (q[2] - 0.0), -fastest, fastest)
    error[4] = _clipped(gain * (q[4] - 0.0), -fastest, fastest)
    return error
