"""All postures of the Panda that bring the hand to a pose, in closed form, with joint 7 as the free parameter.

Shoulder and wrist are spherical, but joint 7 stands 88 mm beside the wrist's centre. So: joint 7 gives the wrist's
centre, its distance from the shoulder gives joint 4, the direction of the shoulder joints 5 and 6 (two ways), and what
is left of the rotation is that of the shoulder (two ways).
"""

import math

import numpy as np
from numba import njit

from motm_twin.control.arm.geometry import ELBOW
from motm_twin.model.geometry import Array

POSTURES = 4  # per value of joint 7
_SHOULDER_Z = 0.333  # [m] shoulder over the mount
_UPPER, _LOWER, _OFFSET = 0.316, 0.384, 0.0825  # [m] along and across the arm, from the elbow's axis
_WRIST, _TOOL = 0.088, 0.2104  # [m] joint 7 beside the wrist's centre; tool centre point beyond joint 7
_TURNED = -math.pi / 4.0  # [rad] of the hand about the flange
_FLAT = 1e-9  # sine of joint 2 below which joints 1 and 3 turn about the same line


@njit(cache=True)
def _angle(value: float) -> float:
    """Wrapped to -pi .. pi."""
    return value - 2.0 * math.pi * math.floor((value + math.pi) / (2.0 * math.pi))


@njit(cache=True)
def _wrist_centre(R: Array, p: Array, q7: float) -> tuple[Array, Array]:
    """Rotation of link 6 with its joint at zero in link 7's place, and the wrist's centre [m]."""
    turn = q7 + _TURNED
    c, s = math.cos(turn), math.sin(turn)
    frame = np.empty((3, 3))
    for r in range(3):
        x, y, z = R[r, 0], R[r, 1], R[r, 2]
        frame[r, 0] = c * x - s * y  # link 6: x beside the flange's axis,
        frame[r, 1] = -z  # y against it,
        frame[r, 2] = s * x + c * y  # z is joint 6
    centre = p - _TOOL * R[:, 2] - _WRIST * frame[:, 0]
    return frame, centre


@njit(cache=True)
def _shoulder(R3: Array, side: int) -> tuple[float, float, float]:
    """Joints 1 to 3 of R3 = Rz(q1) Ry(q2) Rz(q3), joint 2 to the given side."""
    sine = math.hypot(R3[0, 2], R3[1, 2])
    q2 = side * math.atan2(sine, R3[2, 2])
    if sine < _FLAT:
        return math.atan2(R3[1, 0], R3[0, 0]), q2, 0.0
    return math.atan2(side * R3[1, 2], side * R3[0, 2]), q2, math.atan2(side * R3[2, 1], -side * R3[2, 0])


@njit(cache=True)
def solve_arm(R: Array, p: Array, q7: float, found: Array) -> int:
    """Write the postures that reach a pose with joint 7 at ``q7`` [rad]; returns how many, 0 to 4.

    R (3, 3), p (3,) [m]: tool centre point relative to the mount. found: room for (4, 7) [rad]. The elbow is bent the
    way in which it has 2.6 rad of room. Joint limits are the caller's.
    """
    R6, wrist = _wrist_centre(R, p, q7)
    to_x, to_y, to_z = -wrist[0], -wrist[1], _SHOULDER_Z - wrist[2]
    upper, lower = math.hypot(_UPPER, _OFFSET), math.hypot(_LOWER, _OFFSET)
    square = to_x * to_x + to_y * to_y + to_z * to_z
    cosine = (upper * upper + lower * lower - square) / (2.0 * upper * lower)
    if abs(cosine) > 1.0:
        return 0
    q4 = ELBOW - (math.pi - math.acos(cosine))
    c4, s4 = math.cos(q4), math.sin(q4)
    across = -_OFFSET * c4 - _UPPER * s4 + _OFFSET  # shoulder from the wrist's centre, in link 4
    along = _OFFSET * s4 - _UPPER * c4 - _LOWER
    v = np.empty(3)
    for k in range(3):
        v[k] = R6[0, k] * to_x + R6[1, k] * to_y + R6[2, k] * to_z
    if abs(across) < 1e-9 or abs(v[2]) > abs(across):
        return 0
    first = math.asin(v[2] / across)
    count = 0
    for way in range(2):
        q5 = first if way == 0 else _angle(math.pi - first)
        c5, s5 = math.cos(q5), math.sin(q5)
        q6 = _angle(math.atan2(along, across * c5) - math.atan2(v[1], v[0]))
        if q6 < -0.5 * math.pi:
            q6 += 2.0 * math.pi  # its range is 0 .. 3.75
        R3 = _upper_arm(R6, c4, s4, c5, s5, math.cos(q6), math.sin(q6))
        for side in (1, -1):
            q1, q2, q3 = _shoulder(R3, side)
            found[count, 0], found[count, 1], found[count, 2] = q1, q2, q3
            found[count, 3], found[count, 4], found[count, 5], found[count, 6] = q4, q5, q6, q7
            count += 1
    return count


@njit(cache=True)
def _upper_arm(R6: Array, c4: float, s4: float, c5: float, s5: float, c6: float, s6: float) -> Array:
    """Rotation of link 3: joints 6, 5 and 4 taken back one after the other."""
    R3 = np.empty((3, 3))
    for r in range(3):
        x, y, z = R6[r, 0], R6[r, 1], R6[r, 2]
        x, y = c6 * x - s6 * y, s6 * x + c6 * y
        y, z = -z, y  # link 5
        x, y = c5 * x - s5 * y, s5 * x + c5 * y
        y, z = z, -y  # link 4
        x, y = c4 * x - s4 * y, s4 * x + c4 * y
        R3[r, 0], R3[r, 1], R3[r, 2] = x, -z, y  # link 3
    return R3
