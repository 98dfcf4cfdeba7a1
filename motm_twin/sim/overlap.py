"""How far convex bodies in the plane are apart: for whatever must not be moved into something."""

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from motm_twin.model.geometry import Array
from motm_twin.sim.kernels import Index, polygon_distance

_GRAZE = 1e-9  # [m] of overlap that rounding makes


@njit(cache=True)
def _between(a: Array, b: Array) -> float:
    """Largest gap [m] along an edge normal of convex polygon a; negative: overlap along every one of them."""
    best = -np.inf
    for i in range(a.shape[0]):
        j = (i + 1) % a.shape[0]
        nx, ny = a[j, 1] - a[i, 1], a[i, 0] - a[j, 0]
        length = math.hypot(nx, ny)
        if length == 0.0:
            continue
        nearest = np.inf
        for k in range(b.shape[0]):
            nearest = min(nearest, ((b[k, 0] - a[i, 0]) * nx + (b[k, 1] - a[i, 1]) * ny) / length)
        best = max(best, nearest)
    return best


@njit(cache=True)
def gaps(body: Array, radius: float, corners: Array, first: Index, discs: Array) -> Array:
    """Gap [m] between a body and each polygon, then each disc; negative where they overlap, shape (p + d,).

    The body is a convex counter-clockwise polygon (k, 2), or with one corner a disc of ``radius`` [m] about it. A
    positive gap between two polygons may be less than their distance.
    """
    polygons = first.shape[0] - 1
    found = np.empty(polygons + discs.shape[0])
    for i in range(polygons):
        if body.shape[0] == 1:
            found[i] = polygon_distance(body[0, 0], body[0, 1], corners, first[i], first[i + 1]) - radius
        else:
            other = corners[first[i] : first[i + 1]]
            found[i] = max(_between(body, other), _between(other, body))
    for k in range(discs.shape[0]):
        if body.shape[0] == 1:
            away = math.hypot(body[0, 0] - discs[k, 0], body[0, 1] - discs[k, 1]) - radius
        else:
            away = polygon_distance(discs[k, 0], discs[k, 1], body, 0, body.shape[0])
        found[polygons + k] = away - discs[k, 2]
    return found


def entered(before: Array, after: Array) -> NDArray[np.int64]:
    """Indices of what a body overlaps after a motion and did not, or overlapped less, before; shape (k,)."""
    return np.flatnonzero((after < -_GRAZE) & (after < before - _GRAZE))


def compile_gaps() -> None:
    """Compile now, not at the first throw."""
    square = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    gaps(square, 0.0, square, np.array([0, 4], dtype=np.int64), np.zeros((1, 3)))
