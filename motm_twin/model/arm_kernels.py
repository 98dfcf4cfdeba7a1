"""Kinematics and body of the Panda arm as compiled kernels over arrays.

Transforms are relative to the arm mount (= ``panda_link0``). `motm_twin.model.kinematics.Frankie` adds the base; tests
compare every kernel with pinocchio on ``frankie.urdf``, so that the two descriptions of the arm cannot drift apart.
"""

import math

import numpy as np

from motm_twin.model.compiler import njit
from motm_twin.model.exact import fma
from motm_twin.model.geometry import Array, frozen

ARM_FRAMES = (*(f"panda_link{i}" for i in range(9)), "panda_hand", "panda_tcp")
HAND, TCP = ARM_FRAMES.index("panda_hand"), ARM_FRAMES.index("panda_tcp")

# Lengths of the Panda [m]: shoulder over the mount; shoulder to elbow and elbow to wrist along the arm, and across it;
# joint 7 beside joint 6; link 8 beyond link 7; tool centre point beyond the hand, and beyond joint 7.
SHOULDER, UPPER, LOWER, ELBOW_OFFSET, WRIST = 0.333, 0.316, 0.384, 0.0825, 0.088
FLANGE, HAND_LENGTH = 0.107, 0.1034
TOOL = FLANGE + HAND_LENGTH

_JOINTS = 7
_FIXED = (  # joint i in link i - 1: x, y, z [m] and the sine of its turn about x (0 or a quarter turn)
    (0.0, 0.0, SHOULDER, 0.0),
    (0.0, 0.0, 0.0, -1.0),
    (0.0, -UPPER, 0.0, 1.0),
    (ELBOW_OFFSET, 0.0, 0.0, 1.0),
    (-ELBOW_OFFSET, LOWER, 0.0, -1.0),
    (0.0, 0.0, 0.0, 1.0),
    (WRIST, 0.0, 0.0, 1.0),
)
_ORIGINS = np.array(_FIXED)
_HAND_TURN = math.sqrt(0.5)  # the hand is turned by -45 deg about the flange axis
_SINGULAR = 1e-14  # smallest pivot of J J^T that counts as positive


@njit(cache=True)
def fk_arm(q: Array) -> Array:
    """Transforms of `ARM_FRAMES` relative to the arm mount for joints q [rad], shapes (7,) -> (11, 4, 4)."""
    T = np.zeros((11, 4, 4))
    for k in range(4):
        T[0, k, k] = 1.0
    for i in range(_JOINTS):
        x, y, z, sa = _ORIGINS[i, 0], _ORIGINS[i, 1], _ORIGINS[i, 2], _ORIGINS[i, 3]
        ca = 1.0 - abs(sa)
        c, s = math.cos(q[i]), math.sin(q[i])
        for r in range(3):
            x_axis, y_axis, z_axis = T[i, r, 0], T[i, r, 1], T[i, r, 2]
            turned_y = ca * y_axis + sa * z_axis
            T[i + 1, r, 0] = c * x_axis + s * turned_y
            T[i + 1, r, 1] = c * turned_y - s * x_axis
            T[i + 1, r, 2] = ca * z_axis - sa * y_axis
            T[i + 1, r, 3] = T[i, r, 3] + x * x_axis + y * y_axis + z * z_axis
        T[i + 1, 3, 3] = 1.0
    for r in range(3):
        x_axis, y_axis, z_axis = T[7, r, 0], T[7, r, 1], T[7, r, 2]
        flange = T[7, r, 3] + FLANGE * z_axis
        T[8, r, 0], T[8, r, 1], T[8, r, 2], T[8, r, 3] = x_axis, y_axis, z_axis, flange
        for frame in (9, 10):
            T[frame, r, 0] = _HAND_TURN * (x_axis - y_axis)
            T[frame, r, 1] = _HAND_TURN * (x_axis + y_axis)
            T[frame, r, 2] = z_axis
        T[9, r, 3] = flange
        T[10, r, 3] = flange + HAND_LENGTH * z_axis
    T[8, 3, 3] = T[9, 3, 3] = T[10, 3, 3] = 1.0
    return T


@njit(cache=True)
def placed_frames(T: Array, frames: Array) -> Array:
    """``T @ frames``: rigid transforms premultiplied by a transform, shapes (4, 4), (n, 4, 4) -> (n, 4, 4)."""
    there = np.zeros(frames.shape)
    for n in range(frames.shape[0]):
        for r in range(3):
            for k in range(4):
                total = 0.0
                for j in range(4):
                    total = fma(T[r, j], frames[n, j, k], total)
                there[n, r, k] = total
        there[n, 3, 3] = 1.0
    return there


@njit(cache=True)
def point_jacobian(T: Array, joints: int, point: Array) -> Array:
    """Jacobian of a point fixed to link ``joints``; point [m] in the mount frame, T from `fk_arm`; shape (6, 7).

    Rows: linear, angular, along the axes of the mount. Columns of joints behind that link are zero.
    """
    J = np.zeros((6, 7))
    for i in range(joints):
        ax, ay, az = T[i + 1, 0, 2], T[i + 1, 1, 2], T[i + 1, 2, 2]
        rx, ry, rz = point[0] - T[i + 1, 0, 3], point[1] - T[i + 1, 1, 3], point[2] - T[i + 1, 2, 3]
        J[0, i], J[1, i], J[2, i] = ay * rz - az * ry, az * rx - ax * rz, ax * ry - ay * rx
        J[3, i], J[4, i], J[5, i] = ax, ay, az
    return J


@njit(cache=True)
def arm_jacobian(q: Array) -> Array:
    """Jacobian of the tool centre point in the axes of the mount; rows linear [m/rad], angular; shape (6, 7)."""
    T = fk_arm(q)
    return point_jacobian(T, _JOINTS, T[10, :3, 3])


@njit(cache=True)
def factor(J: Array, L: Array) -> float:
    """Fill in the lower factor (6, 6) of J J^T, J of shape (6, 7); returns the root of its determinant, 0: singular."""
    root = 1.0
    for i in range(6):
        for j in range(i + 1):
            total = 0.0
            for k in range(7):
                total += J[i, k] * J[j, k]
            for k in range(j):
                total -= L[i, k] * L[j, k]
            if i == j:
                if total <= _SINGULAR:
                    return 0.0
                L[i, i] = math.sqrt(total)
                root *= L[i, i]
            else:
                L[i, j] = total / L[j, j]
    return root


@njit(cache=True)
def manipulability(q: Array) -> float:
    """Yoshikawa's measure sqrt(det(J J^T)) of the seven arm joints at the tool centre point."""
    return factor(arm_jacobian(q), np.empty((6, 6)))


@njit(cache=True)
def manipulability_gradient(q: Array) -> Array:
    """Derivative of `manipulability` with respect to q, shape (7,); zero at a singularity."""
    J, L = arm_jacobian(q), np.empty((6, 6))
    return factored_gradient(J, L, factor(J, L))


@njit(cache=True)
def factored_gradient(J: Array, L: Array, m: float) -> Array:
    """`manipulability_gradient` from the results of `factor`: L and the measure m.

    dm/dq_i = m trace((dJ/dq_i) P) with P = J^T (J J^T)^-1 the pseudo-inverse, and the columns of dJ/dq_i by cross
    products of the columns of J: w_i x (v_j, w_j) for i <= j, (w_j x v_i, 0) for i > j.
    """
    gradient = np.zeros(7)
    if m == 0.0:
        return gradient
    P, y = np.empty((7, 6)), np.empty(6)
    for k in range(7):
        for i in range(6):
            total = J[i, k]
            for j in range(i):
                total -= L[i, j] * y[j]
            y[i] = total / L[i, i]
        for i in range(5, -1, -1):
            total = y[i]
            for j in range(i + 1, 6):
                total -= L[j, i] * P[k, j]
            P[k, i] = total / L[i, i]
    for i in range(7):
        total = 0.0
        for j in range(7):
            low, high = min(i, j), max(i, j)
            wx, wy, wz = J[3, low], J[4, low], J[5, low]
            vx, vy, vz = J[0, high], J[1, high], J[2, high]
            total += (wy * vz - wz * vy) * P[j, 0] + (wz * vx - wx * vz) * P[j, 1] + (wx * vy - wy * vx) * P[j, 2]
            if i < j:
                ux, uy, uz = J[3, j], J[4, j], J[5, j]
                total += (wy * uz - wz * uy) * P[j, 3] + (wz * ux - wx * uz) * P[j, 4] + (wx * uy - wy * ux) * P[j, 5]
        gradient[i] = m * total
    return gradient


# The arm's body as control sees it: capsules round its links. Fitted by ``tools/fit_capsules.py``: every row contains
# its half of the link's collision hull, so control keeps clear of a larger body than the referee judges. The base is no
# capsule: its footprint is in the profile, and ``link0`` stands within it. Fingers are regions of the hand that contain
# them at every gripper width.
_CAPSULES = (  # link, end points x, y, z, x, y, z and radius [m] in the link's frame
    ("panda_link1", 0.0002, -0.0488, 0.0000, -0.0010, -0.0043, -0.1486, 0.0742),
    ("panda_link1", 0.0000, -0.1017, 0.0001, -0.0002, -0.1017, -0.0309, 0.0482),
    ("panda_link2", 0.0000, 0.0001, 0.1017, 0.0014, -0.0312, 0.1014, 0.0482),
    ("panda_link2", 0.0004, -0.1453, 0.0010, 0.0001, 0.0001, 0.0502, 0.0749),
    ("panda_link3", -0.0035, -0.0446, -0.0933, -0.0477, 0.0114, -0.0904, 0.0400),
    ("panda_link3", 0.0832, 0.0427, 0.0008, 0.0033, 0.0027, -0.0800, 0.0697),
    ("panda_link4", -0.1259, 0.0938, 0.0103, -0.0852, 0.0948, -0.0446, 0.0407),
    ("panda_link4", -0.0001, 0.0003, 0.0422, -0.0792, 0.0827, 0.0024, 0.0701),
    ("panda_link5", 0.0002, 0.0187, -0.1998, 0.0000, 0.0641, 0.0005, 0.0685),
    ("panda_link5", 0.0003, -0.0051, -0.2400, 0.0001, 0.0023, -0.2444, 0.0579),
    ("panda_link6", 0.0965, -0.0292, -0.0012, 0.0290, -0.0391, 0.0077, 0.0494),
    ("panda_link6", 0.0773, 0.0277, 0.0022, 0.0024, -0.0011, 0.0167, 0.0603),
    ("panda_link7", -0.0051, -0.0051, 0.0733, 0.0329, 0.0330, 0.0807, 0.0498),
    ("panda_hand", 0.0000, -0.0835, 0.0447, 0.0000, 0.0836, 0.0446, 0.0274),
    ("panda_hand", 0.0000, -0.0811, 0.0079, -0.0001, 0.0779, 0.0129, 0.0354),
    ("panda_leftfinger", 0.0000, 0.0063, 0.0734, 0.0000, 0.0629, 0.0734, 0.0194),
    ("panda_leftfinger", 0.0000, 0.0032, 0.1004, 0.0000, 0.0536, 0.1004, 0.0168),
    ("panda_rightfinger", 0.0000, -0.0063, 0.0734, 0.0000, -0.0629, 0.0734, 0.0194),
    ("panda_rightfinger", 0.0000, -0.0032, 0.1004, 0.0000, -0.0536, 0.1004, 0.0168),
)


def _frame(link: str) -> int:
    return ARM_FRAMES.index("panda_hand" if link.endswith("finger") else link)


CAPSULE_LINKS = tuple(row[0] for row in _CAPSULES)  # name of the link of each capsule
CAPSULE_FRAMES = np.array([_frame(row[0]) for row in _CAPSULES])  # index into ARM_FRAMES, shape (n,)
CAPSULE_FRAMES.setflags(write=False)
CAPSULE_P0 = frozen([row[1:4] for row in _CAPSULES])  # [m] in the frame, shape (n, 3)
CAPSULE_P1 = frozen([row[4:7] for row in _CAPSULES])  # [m] in the frame, shape (n, 3)
CAPSULE_RADII = frozen([row[7] for row in _CAPSULES])  # [m], shape (n,)


@njit(cache=True)
def capsule_segments(T: Array) -> Array:
    """End points [m] of all capsules for the transforms of `fk_arm` (or those times a base transform).

    Shapes (11, 4, 4) -> (n, 2, 3), in the frame that T maps to.
    """
    count = CAPSULE_FRAMES.shape[0]
    segments = np.empty((count, 2, 3))
    for i in range(count):
        frame = CAPSULE_FRAMES[i]
        for r in range(3):
            x, y, z, origin = T[frame, r, 0], T[frame, r, 1], T[frame, r, 2], T[frame, r, 3]
            segments[i, 0, r] = origin + x * CAPSULE_P0[i, 0] + y * CAPSULE_P0[i, 1] + z * CAPSULE_P0[i, 2]
            segments[i, 1, r] = origin + x * CAPSULE_P1[i, 0] + y * CAPSULE_P1[i, 1] + z * CAPSULE_P1[i, 2]
    return segments
