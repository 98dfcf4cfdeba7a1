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
from motm_twin.control.slate import Record
from motm_twin.model.arm_kernels import TCP, factored_gradient, fk_arm, point_jacobian
from motm_twin.model.geometry import Array
from motm_twin.model.joint_limits import DDQ_MAX, DQ_MAX, Q_MAX, Q_MIN
from motm_twin.model.profile import RobotProfile

BASE = slice(0, 2)
ARM = slice(2, 9)
SLACK = slice(9, 15)
LIDAR_ELASTIC, FURNITURE_ELASTIC = 15, 16
TWISTING = (2, 4)  # joints 3 and 5 turn the arm out of its plane
_SLACK_BOUND = 20.0  # [m/s, rad/s]
_FREE = 1.0e3  # bound of elastic variables [m/s]


def lag_factor(dt: float, profile: RobotProfile) -> float:
    """beta: the part of a commanded change of the base twist that is there when the arm's rates act."""
    if profile.base.velocity_lag <= 0.0:
        return 1.0
    return 1.0 - math.exp(-(0.5 * dt + profile.arm.velocity_lag) / profile.base.velocity_lag)


@njit(cache=True)
def approach_row(
    T: Array, frame: int, local: Array, pose: Array, mount: Array, nx: float, ny: float, nz: float, row: Array
) -> None:
    """Fill in coefficients (9,) of v, w and the arm for the speed of a point of the arm against a direction.

    ``local`` (3,) [m]: the point in its frame, an index into `ARM_FRAMES`; T from `fk_arm`. The direction is along the
    axes of the planar frame of ``pose``.
    """
    px, py, pz = T[frame, 0, 3], T[frame, 1, 3], T[frame, 2, 3]
    for a in range(3):
        px += T[frame, 0, a] * local[a]
        py += T[frame, 1, a] * local[a]
        pz += T[frame, 2, a] * local[a]
    c, s = math.cos(pose[2]), math.sin(pose[2])
    x, y = mount[0] + px, mount[1] + py
    row[0] = -(nx * c + ny * s + nz * 0.0)
    row[1] = -(nx * -(s * x + c * y) + ny * (c * x - s * y) + nz * 0.0)
    for k in range(7):
        vx, vy, vz = 0.0, 0.0, 0.0
        if k < frame:
            ax, ay, az = T[k + 1, 0, 2], T[k + 1, 1, 2], T[k + 1, 2, 2]
            rx, ry, rz = px - T[k + 1, 0, 3], py - T[k + 1, 1, 3], pz - T[k + 1, 2, 3]
            vx, vy, vz = ay * rz - az * ry, az * rx - ax * rz, ax * ry - ay * rx
        row[2 + k] = -(nx * (c * vx - s * vy) + ny * (s * vx + c * vy) + nz * vz)


@njit(cache=True)
def hand_state(q: Array, pose: Array, mount: Array) -> tuple[Array, Array, Array, Array]:
    """Arm transforms (11, 4, 4), position (3,) and rotation (3, 3) of the tool centre point, its Jacobian (6, 9)."""
    T, p, R, J = fk_arm(q), np.empty(3), np.empty((3, 3)), np.empty((6, 9))
    hand_of(T, point_jacobian(T, 7, T[TCP, :3, 3]), pose, mount, p, R, J)
    return T, p, R, J


@njit(cache=True)
def hand_of(T: Array, arm: Array, pose: Array, mount: Array, p: Array, R: Array, J: Array) -> None:
    """Fill in p, R, J of `hand_state`; T from `fk_arm`, ``arm``: Jacobian in the axes of the mount, shape (6, 7).

    Columns of J: v, w, arm; axes of the planar frame of ``pose``.
    """
    c, s = math.cos(pose[2]), math.sin(pose[2])
    x, y = mount[0] + T[TCP, 0, 3], mount[1] + T[TCP, 1, 3]
    p[0], p[1], p[2] = pose[0] + c * x - s * y, pose[1] + s * x + c * y, mount[2] + T[TCP, 2, 3]
    for k in range(3):
        R[0, k] = c * T[TCP, 0, k] - s * T[TCP, 1, k]
        R[1, k] = s * T[TCP, 0, k] + c * T[TCP, 1, k]
        R[2, k] = T[TCP, 2, k]
    J[:, :2] = 0.0
    J[0, 0], J[1, 0] = c, s
    J[0, 1], J[1, 1] = -(s * x + c * y), c * x - s * y
    J[5, 1] = 1.0
    for k in range(7):
        for r in (0, 3):
            J[r, 2 + k] = c * arm[r, k] - s * arm[r + 1, k]
            J[r + 1, 2 + k] = s * arm[r, k] + c * arm[r + 1, k]
            J[r + 2, 2 + k] = arm[r + 2, k]


@njit(cache=True)
def _joint_bounds(
    q: Array, previous: Array, dt: float, limits: Array, eta: float, rho_i: float, rho_s: float, lower: Array,
    upper: Array,
) -> None:  # fmt: skip
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


@njit(cache=True)
def damper(rho: float, eta: float, rho_i: float, rho_s: float) -> float:
    """Largest speed towards a limit at distance rho: eta (rho - rho_s) / (rho_i - rho_s); negative below rho_s."""
    if rho >= rho_i:
        return np.inf
    return eta * (rho - rho_s) / (rho_i - rho_s)


_LIMITS = np.vstack([Q_MIN, Q_MAX, DQ_MAX, DDQ_MAX])


def joint_bounds(q: Array, previous: Array, dt: float, parameters: QpParameters) -> tuple[Array, Array]:
    """Bounds of the arm rates: speed, acceleration round the previous command, damper before position limits."""
    p, lower, upper = parameters, np.empty(7), np.empty(7)
    limits = joint_limits(p.elbow_limit, p.wrist_limit)
    _joint_bounds(q, previous, dt, limits, p.damper_gain, p.damper_start, p.damper_stop, lower, upper)
    return lower, upper


@functools.cache
def joint_limits(elbow_limit: float, wrist_limit: float) -> Array:
    """Least and largest joint angles, speeds and accelerations, shape (4, 7).

    ``elbow_limit`` is the largest angle of joint 4, ``wrist_limit`` the least of joint 6 [rad].
    """
    limits = _LIMITS.copy()
    limits[0, 5] = max(limits[0, 5], wrist_limit)
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


@njit(cache=True)
def elastic_rows(G: Array, h: Array, lidar: int, seen: int, beta: float, measured: Array) -> None:
    """G x <= h (k, 17) of speed limits, of which rows over (v, w, arm) and allowed speeds [m/s] are filled in already.

    The first ``lidar`` of them and those from ``seen`` on give way with an elastic variable of their own: mapped
    furniture, and the robot's own base, must not give way for them.
    """
    G[:, 9:] = 0.0
    for r in range(G.shape[0]):
        G[r, FURNITURE_ELASTIC if lidar <= r < seen else LIDAR_ELASTIC] = -1.0
        h[r] -= (1.0 - beta) * (G[r, 0] * measured[0] + G[r, 1] * measured[1])
        G[r, 0], G[r, 1] = beta * G[r, 0], beta * G[r, 1]


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
    slate: Record, twist: Array, rates: Array, cost: Array, dexterity: float, beta: float, dt: float, swinging: bool
) -> None:
    """Fill in linear cost, rows A x = b and bounds of a step's program; ``twist``, ``rates``: commanded last.

    ``cost`` is from `weights`, ``dexterity`` the arm's manipulability.
    """
    s = slate[0]
    n = s.qp[0]
    gain, fastest = (n.swing_posture_gain, n.swing_posture_rate) if swinging else (n.posture_gain, n.posture_rate)
    s.c[:] = 0.0
    gradient = factored_gradient(s.arm, s.factor, dexterity)
    error = posture_error(s.q, polar(s.p, s.pose, s.base_mount)[1], gain, fastest)
    for k in range(2):
        s.c[k] = -n.base_weight * s.wanted[k]
    for k in range(7):
        s.c[2 + k] = cost[2 + k] * error[k] - n.manipulability_weight * gradient[k]
    s.c[LIDAR_ELASTIC] = s.c[FURNITURE_ELASTIC] = n.elastic_weight
    _hand_rows(slate, beta)
    _base_bounds(twist, dt, s.base, s.lower[:2], s.upper[:2])
    _joint_bounds(
        s.q, rates, dt, s.joint_limits, n.damper_gain, n.damper_start, n.damper_stop, s.lower[2:9], s.upper[2:9]
    )
    s.lower[9:15], s.upper[9:15] = -_SLACK_BOUND, _SLACK_BOUND
    s.lower[15:], s.upper[15:] = 0.0, _FREE


@njit(cache=True)
def _hand_rows(slate: Record, beta: float) -> None:
    """A x = b of the hand: ``beta J_b u + J_a qdot + slack = nu - (1 - beta) J_b v_measured``, shapes (6, 17), (6,)."""
    s = slate[0]
    s.A[:] = 0.0
    for r in range(6):
        s.A[r, 0], s.A[r, 1] = beta * s.J[r, 0], beta * s.J[r, 1]
        for k in range(2, 9):
            s.A[r, k] = s.J[r, k]
        s.A[r, 9 + r] = 1.0
        s.b[r] = s.velocity[r] - (1.0 - beta) * (s.J[r, 0] * s.measured[0] + s.J[r, 1] * s.measured[1])


@njit(cache=True)
def anchor(slate: Record, twist: Array, rates: Array, dt: float, lag: float) -> None:
    """Bring a base twist (2,) near the wanted one, and arm rates (7,) near the measured ones and within the limits.

    ``lag`` [s] of the arm: what its rates may be behind, and three steps.
    """
    s, follow = slate[0], lag + 3.0 * dt
    limits = s.base[0]
    room_v, room_w = 2.0 * dt * limits.linear_acceleration, 2.0 * dt * limits.yaw_acceleration
    twist[0] = _clipped(twist[0], s.wanted[0] - room_v, s.wanted[0] + room_v)
    twist[1] = _clipped(twist[1], s.wanted[1] - room_w, s.wanted[1] + room_w)
    for k in range(7):
        room = DDQ_MAX[k] * follow
        rates[k] = _clipped(_clipped(rates[k], s.dq[k] - room, s.dq[k] + room), -DQ_MAX[k], DQ_MAX[k])


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
