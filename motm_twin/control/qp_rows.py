"""Rows, bounds and weights of the redundancy-resolution QP.

Decision ``x = (v, w, seven arm rates, six slacks of the hand's velocity, two elastic variables)``, where (v, w) is the
base twist that is commanded. The hand obeys ``J_b v_hat + J_a qdot + slack = nu`` with the base rates ``v_hat`` that
the base will really have: its velocity loop lags by ``tau``, so that after the time t

    v_hat = v_measured + beta (u - v_measured),   beta = 1 - exp(-t / tau),

and t is half a step plus the lag of the arm, the mean delay until the commanded arm rates act.
"""

import functools
import math

import numpy as np
from numba import njit

from motm_twin.control.arm_reference import polar
from motm_twin.control.parameters import Numbers, QpParameters, numbers
from motm_twin.model.arm_kernels import fk_arm, manipulability_gradient, point_jacobian
from motm_twin.model.geometry import Array
from motm_twin.model.joint_limits import DDQ_MAX, DQ_MAX, Q_MAX, Q_MIN
from motm_twin.model.profile import RobotProfile

BASE = slice(0, 2)
ARM = slice(2, 9)
SLACK = slice(9, 15)
LIDAR_ELASTIC, FURNITURE_ELASTIC = 15, 16
SIZE = 17
TWISTING = (2, 4)  # joints 3 and 5 turn the arm out of its plane
_SLACK_BOUND = 20.0  # [m/s, rad/s]
_FREE = 1.0e3  # bound of elastic variables [m/s]


def lag_factor(dt: float, profile: RobotProfile) -> float:
    """beta: the part of a commanded change of the base twist that is there when the arm's rates act."""
    if profile.base.velocity_lag <= 0.0:
        return 1.0
    return 1.0 - math.exp(-(0.5 * dt + profile.arm.velocity_lag) / profile.base.velocity_lag)


@njit(cache=True)
def point_rows(T: Array, joints: int, point: Array, pose: Array, mount: Array) -> Array:
    """Jacobian of a point of the arm, shape (6, 9): columns v, w, arm; axes of the planar frame of ``pose``.

    ``point`` [m] is in the mount frame and moves with link ``joints``; T from `fk_arm`.
    """
    J = np.zeros((6, 9))
    c, s = math.cos(pose[2]), math.sin(pose[2])
    arm = point_jacobian(T, joints, point)
    for k in range(7):
        for r in (0, 3):
            J[r, 2 + k] = c * arm[r, k] - s * arm[r + 1, k]
            J[r + 1, 2 + k] = s * arm[r, k] + c * arm[r + 1, k]
            J[r + 2, 2 + k] = arm[r + 2, k]
    x, y = mount[0] + point[0], mount[1] + point[1]
    J[0, 0], J[1, 0] = c, s
    J[0, 1], J[1, 1] = -(s * x + c * y), c * x - s * y
    J[5, 1] = 1.0
    return J


@njit(cache=True)
def hand_state(q: Array, pose: Array, mount: Array) -> tuple[Array, Array, Array, Array]:
    """Arm transforms (11, 4, 4), position (3,) and rotation (3, 3) of the tool centre point, its Jacobian (6, 9)."""
    T = fk_arm(q)
    J = point_rows(T, 7, T[10, :3, 3], pose, mount)
    c, s = math.cos(pose[2]), math.sin(pose[2])
    p = np.empty(3)
    x, y = mount[0] + T[10, 0, 3], mount[1] + T[10, 1, 3]
    p[0], p[1], p[2] = pose[0] + c * x - s * y, pose[1] + s * x + c * y, mount[2] + T[10, 2, 3]
    R = np.empty((3, 3))
    for k in range(3):
        R[0, k] = c * T[10, 0, k] - s * T[10, 1, k]
        R[1, k] = s * T[10, 0, k] + c * T[10, 1, k]
        R[2, k] = T[10, 2, k]
    return T, p, R, J


@njit(cache=True)
def _joint_bounds(
    q: Array,
    previous: Array,
    dt: float,
    limits: Array,
    eta: float,
    rho_i: float,
    rho_s: float,
) -> tuple[Array, Array]:
    lower, upper = np.empty(7), np.empty(7)
    for k in range(7):
        q_min, q_max, speed, acceleration = limits[0, k], limits[1, k], limits[2, k], limits[3, k]
        low = -min(speed, damper(q[k] - q_min, eta, rho_i, rho_s))
        high = min(speed, damper(q_max - q[k], eta, rho_i, rho_s))
        slow, fast = previous[k] - acceleration * dt, previous[k] + acceleration * dt
        lower[k] = min(max(low, slow), fast)  # a limit that cannot be met within one step is met as fast as possible
        upper[k] = max(min(high, fast), slow)
        if lower[k] > upper[k]:
            middle = 0.5 * (lower[k] + upper[k])
            lower[k], upper[k] = middle, middle
    return lower, upper


@njit(cache=True)
def damper(rho: float, eta: float, rho_i: float, rho_s: float) -> float:
    """Largest speed towards a limit at distance rho: eta (rho - rho_s) / (rho_i - rho_s); negative below rho_s."""
    if rho >= rho_i:
        return np.inf
    return eta * (rho - rho_s) / (rho_i - rho_s)


_LIMITS = np.vstack([Q_MIN, Q_MAX, DQ_MAX, DDQ_MAX])


def joint_bounds(q: Array, previous: Array, dt: float, parameters: QpParameters) -> tuple[Array, Array]:
    """Bounds of the arm rates: speed, acceleration round the previous command, damper before position limits."""
    p = parameters
    return _joint_bounds(q, previous, dt, joint_limits(p.elbow_limit), p.damper_gain, p.damper_start, p.damper_stop)


@functools.cache
def joint_limits(elbow_limit: float) -> Array:
    """Least and largest joint angles, speeds and accelerations, shape (4, 7), the elbow never straighter than that."""
    limits = _LIMITS.copy()
    limits[1, 3] = min(limits[1, 3], elbow_limit)
    return limits


def base_bounds(previous: Array, dt: float, profile: RobotProfile) -> tuple[Array, Array]:
    """Bounds of the commanded base twist: one step's acceleration round the previous command, and the speed limits."""
    return _base_bounds(previous, dt, numbers(profile.base))


@njit(cache=True)
def _base_bounds(previous: Array, dt: float, base: Numbers) -> tuple[Array, Array]:
    limits = base[0]
    most, fastest = (limits.linear_acceleration, limits.yaw_acceleration), (limits.forward_speed, limits.yaw_rate)
    slowest = (-limits.reverse_speed, -limits.yaw_rate)
    lower, upper = np.empty(2), np.empty(2)
    for k in range(2):
        low = min(max(previous[k] - most[k] * dt, slowest[k]), fastest[k])
        high = max(min(previous[k] + most[k] * dt, fastest[k]), slowest[k])
        lower[k], upper[k] = min(low, high), max(low, high)
    return lower, upper


@njit(cache=True)
def hand_rows(J: Array, nu: Array, beta: float, measured: Array) -> tuple[Array, Array]:
    """A x = b of the hand: ``beta J_b u + J_a qdot + slack = nu - (1 - beta) J_b v_measured``, shapes (6, 17), (6,)."""
    A, b = np.zeros((6, SIZE)), np.empty(6)
    for r in range(6):
        A[r, 0], A[r, 1] = beta * J[r, 0], beta * J[r, 1]
        for k in range(2, 9):
            A[r, k] = J[r, k]
        A[r, 9 + r] = 1.0
        b[r] = nu[r] - (1.0 - beta) * (J[r, 0] * measured[0] + J[r, 1] * measured[1])
    return A, b


@njit(cache=True)
def elastic_rows(velocity: Array, allowed: Array, lidar: int, beta: float, measured: Array) -> tuple[Array, Array]:
    """G x <= h of speed limits: rows over (v, w, arm), the first ``lidar`` of them with their own elastic variable."""
    count = velocity.shape[0]
    G, h = np.zeros((count, SIZE)), np.empty(count)
    for r in range(count):
        G[r, 0], G[r, 1] = beta * velocity[r, 0], beta * velocity[r, 1]
        for k in range(2, 9):
            G[r, k] = velocity[r, k]
        G[r, LIDAR_ELASTIC if r < lidar else FURNITURE_ELASTIC] = -1.0
        h[r] = allowed[r] - (1.0 - beta) * (velocity[r, 0] * measured[0] + velocity[r, 1] * measured[1])
    return G, h


def weights(parameters: QpParameters, *, swinging: bool) -> Array:
    """Diagonal of the quadratic cost, shape (17,); ``swinging``: on the way, where nothing must be met exactly."""
    p = parameters
    linear = p.swing_linear_slack_weight if swinging else p.linear_slack_weight
    twist = p.swing_twist_rate_weight if swinging else p.twist_rate_weight
    tilt = p.swing_tilt_slack_weight if swinging else p.tilt_slack_weight
    return np.array(
        [p.base_weight] * 2
        + [twist if joint in TWISTING else p.rate_weight for joint in range(7)]
        + [linear] * 3
        + [tilt] * 2
        + [p.swing_yaw_slack_weight if swinging else p.yaw_slack_weight]
        + [p.elastic_weight] * 2
    )


@njit(cache=True)
def fill_program(
    q: Array, p: Array, pose: Array, J: Array, mount: Array, nu: Array, measured: Array, wanted: Array,
    twist: Array, rates: Array, cost: Array, limits: Array, beta: float, dt: float, swinging: bool,
    parameters: Numbers, base: Numbers, c: Array, A: Array, b: Array, lower: Array, upper: Array,
) -> None:  # fmt: skip
    """Fill in linear cost, rows A x = b and bounds of a step's program; ``twist``, ``rates``: commanded last.

    ``wanted`` is the base planner's v_B, ``cost`` from `weights`, ``limits`` from `joint_limits`, ``parameters`` and
    ``base`` are the `numbers` of `QpParameters` and `BaseLimits`.
    """
    n = parameters[0]
    gain, fastest = (n.swing_posture_gain, n.swing_posture_rate) if swinging else (n.posture_gain, n.posture_rate)
    error = posture_error(q, polar(p, pose, mount)[1], gain, fastest)
    c[:2] = -n.base_weight * wanted
    c[2:9] = cost[2:9] * error - n.manipulability_weight * manipulability_gradient(q)
    c[9:15], c[15:] = 0.0, n.elastic_weight
    A[:], b[:] = hand_rows(J, nu, beta, measured)
    lower[:2], upper[:2] = _base_bounds(twist, dt, base)
    lower[2:9], upper[2:9] = _joint_bounds(q, rates, dt, limits, n.damper_gain, n.damper_start, n.damper_stop)
    lower[9:15], upper[9:15] = -_SLACK_BOUND, _SLACK_BOUND
    lower[15:], upper[15:] = 0.0, _FREE


@njit(cache=True)
def anchor(
    twist: Array, rates: Array, wanted: Array, dq: Array, room_v: float, room_w: float, follow: float, near: Array,
    held: Array,
) -> None:  # fmt: skip
    """Fill in the base twist (2,) within ``room`` of the wanted one, and arm rates (7,) near dq and in the limits.

    ``follow`` [s] of the largest acceleration may lie between the rates and dq.
    """
    near[0] = _clipped(twist[0], wanted[0] - room_v, wanted[0] + room_v)
    near[1] = _clipped(twist[1], wanted[1] - room_w, wanted[1] + room_w)
    for k in range(7):
        room = DDQ_MAX[k] * follow
        held[k] = _clipped(_clipped(rates[k], dq[k] - room, dq[k] + room), -DQ_MAX[k], DQ_MAX[k])


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
