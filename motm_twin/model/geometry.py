"""Planar poses and angles.

A planar pose is an array ``(x, y, heading)`` in [m], [m], [rad]. ``T_a_b`` maps points of frame b to frame a.
"""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def wrap_angle(angle: float) -> float:
    """Map an angle [rad] to (-pi, pi]."""
    wrapped = math.remainder(angle, 2.0 * math.pi)
    return math.pi if wrapped == -math.pi else wrapped


def compose(pose_a_b: Array, pose_b_c: Array) -> Array:
    """Pose of c in a, from the pose of b in a and the pose of c in b; shapes (3,)."""
    (x, y, heading), (dx, dy, turn) = pose_a_b.tolist(), pose_b_c.tolist()
    c, s = math.cos(heading), math.sin(heading)
    return np.array([x + c * dx - s * dy, y + s * dx + c * dy, wrap_angle(heading + turn)])


def inverse(pose_a_b: Array) -> Array:
    """Pose of a in b, from the pose of b in a; shape (3,)."""
    x, y, heading = pose_a_b.tolist()
    c, s = math.cos(heading), math.sin(heading)
    return np.array([-c * x - s * y, s * x - c * y, wrap_angle(-heading)])


def to_frame(pose_a_b: Array, points_a: Array) -> Array:
    """Points given in frame a, expressed in frame b; z is kept when there is one. Shapes (..., 2) or (..., 3)."""
    c, s = math.cos(pose_a_b[2]), math.sin(pose_a_b[2])
    points_b = np.array(points_a, dtype=float)
    if points_b.ndim == 1:  # one point: with plain numbers in a third of the time
        (dx, dy), (x, y) = points_b[:2].tolist(), pose_a_b[:2].tolist()
        dx, dy = dx - x, dy - y
        points_b[0], points_b[1] = c * dx + s * dy, -s * dx + c * dy
        return points_b
    dx, dy = points_a[..., 0] - pose_a_b[0], points_a[..., 1] - pose_a_b[1]
    points_b[..., 0] = c * dx + s * dy
    points_b[..., 1] = -s * dx + c * dy
    return points_b


def from_frame(pose_a_b: Array, points_b: Array) -> Array:
    """Points given in frame b, expressed in frame a; z is kept when there is one. Shapes (..., 2) or (..., 3)."""
    c, s = math.cos(pose_a_b[2]), math.sin(pose_a_b[2])
    points_a = np.array(points_b, dtype=float)
    if points_a.ndim == 1:
        (dx, dy), (x, y) = points_a[:2].tolist(), pose_a_b[:2].tolist()
        points_a[0], points_a[1] = x + c * dx - s * dy, y + s * dx + c * dy
        return points_a
    x, y = points_b[..., 0], points_b[..., 1]
    points_a[..., 0] = pose_a_b[0] + c * x - s * y
    points_a[..., 1] = pose_a_b[1] + s * x + c * y
    return points_a


def rectangle(pose: Sequence[float], size: Sequence[float], offset_x: float = 0.0) -> Array:
    """Corners of a rectangle [m] centred at ``(offset_x, 0)`` in a pose's frame, counter-clockwise, shape (4, 2)."""
    a, b = 0.5 * size[0], 0.5 * size[1]
    corners = np.array([[offset_x - a, -b], [offset_x + a, -b], [offset_x + a, b], [offset_x - a, b]])
    return from_frame(np.array(pose, dtype=float), corners)


def about_z(yaw: float) -> Array:
    """Rotation by an angle [rad] about the vertical, shape (3, 3)."""
    c, s = math.cos(yaw), math.sin(yaw)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def frozen(values: object) -> Array:
    """A read-only float64 copy of anything array-like."""
    array = np.array(values, dtype=np.float64)
    array.setflags(write=False)
    return array
