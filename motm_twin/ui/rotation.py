"""Rotations as the viewer wants them: unit quaternions (w, x, y, z)."""

import math

import numpy as np
from numpy.typing import NDArray

Quaternion = tuple[float, float, float, float]


def yaw_wxyz(yaw: float) -> Quaternion:
    """Quaternion of a turn about z [rad]."""
    return (math.cos(yaw / 2), 0.0, 0.0, math.sin(yaw / 2))


def yaws_wxyz(yaws: NDArray[np.float64]) -> NDArray[np.float64]:
    """`yaw_wxyz` of many, shape (n,) to (n, 4)."""
    zero = np.zeros_like(yaws)
    return np.stack([np.cos(yaws / 2), zero, zero, np.sin(yaws / 2)], axis=-1)


def matrices_wxyz(R: NDArray[np.float64]) -> NDArray[np.float64]:
    """Quaternions of rotation matrices, shape (..., 3, 3) to (..., 4); the largest component is computed first."""
    m00, m11, m22 = R[..., 0, 0], R[..., 1, 1], R[..., 2, 2]
    squares = np.stack([1 + m00 + m11 + m22, 1 + m00 - m11 - m22, 1 - m00 + m11 - m22, 1 - m00 - m11 + m22], axis=-1)
    a, b, c = R[..., 2, 1] - R[..., 1, 2], R[..., 0, 2] - R[..., 2, 0], R[..., 1, 0] - R[..., 0, 1]
    d, e, f = R[..., 0, 1] + R[..., 1, 0], R[..., 0, 2] + R[..., 2, 0], R[..., 1, 2] + R[..., 2, 1]
    rows = np.stack(
        [
            np.stack([squares[..., 0], a, b, c], axis=-1),
            np.stack([a, squares[..., 1], d, e], axis=-1),
            np.stack([b, d, squares[..., 2], f], axis=-1),
            np.stack([c, e, f, squares[..., 3]], axis=-1),
        ],
        axis=-2,
    )
    best = squares.argmax(axis=-1)
    q = np.take_along_axis(rows, best[..., None, None], axis=-2)[..., 0, :]
    return q / np.linalg.norm(q, axis=-1, keepdims=True)
