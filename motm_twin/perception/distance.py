"""Distance field and proximity cost of seen cells.

The squared Euclidean distance transform is exact in cells (Felzenszwalb and Huttenlocher 2012: lower envelope of
parabolas, here over only those columns that hold a seen cell). A hit lies anywhere in its cell, so half a cell is
taken off: relative to the occupied square the result is never too small, and too large by at most (sqrt(2) - 1)/2 cell
= 10 mm; relative to the unknown hit itself it errs between -61 and +10 mm for cells of 50 mm.
"""

import math

import numpy as np
from numpy.typing import NDArray

from motm_twin.model.compiler import njit

FAR = 1 << 28


@njit(cache=True)
def squared_cells(cells, rows, columns):
    """Squared distance in cells from every cell to the nearest of the given (row, col); int32 (rows, columns).

    Without any given cell, all distances are `FAR`.
    """
    squared = np.full((rows, columns), FAR, np.int32)
    if cells.shape[0] == 0:
        return squared
    slot = np.full(columns, -1, np.int64)
    for i in range(cells.shape[0]):
        slot[cells[i, 1]] = 0
    used = np.flatnonzero(slot == 0)
    for k in range(used.shape[0]):
        slot[used[k]] = k
    along = np.full((rows, used.shape[0]), rows, np.int32)  # distance to the nearest seen cell of the same column
    for i in range(cells.shape[0]):
        along[cells[i, 0], slot[cells[i, 1]]] = 0
    for row in range(1, rows):
        for k in range(used.shape[0]):
            along[row, k] = min(along[row, k], along[row - 1, k] + np.int32(1))
    for row in range(rows - 2, -1, -1):
        for k in range(used.shape[0]):
            along[row, k] = min(along[row, k], along[row + 1, k] + np.int32(1))
    vertex = np.empty(used.shape[0], np.int64)  # column of each parabola of the envelope
    height = np.empty(used.shape[0], np.int64)
    start = np.empty(used.shape[0], np.float64)  # column from which it is the lowest
    for row in range(rows):
        top = -1
        for k in range(used.shape[0]):
            q = used[k]
            f = np.int64(along[row, k]) * along[row, k]
            at = -math.inf
            while top >= 0:
                at = ((f + q * q) - (height[top] + vertex[top] * vertex[top])) / (2.0 * (q - vertex[top]))
                if at > start[top]:
                    break
                top -= 1
                at = -math.inf
            top += 1
            vertex[top], height[top], start[top] = q, f, at
        first = 0
        for part in range(top + 1):
            end = columns if part == top else min(columns, math.floor(start[part + 1]) + 1)
            for column in range(first, end):
                gap = column - vertex[part]
                squared[row, column] = gap * gap + height[part]
            first = max(first, end)
    return squared


@njit(cache=True)
def seen_distance(squared, resolution):
    """Distance [m] of cell centres to the edge of the nearest seen cell, inf without any; float32."""
    rows, columns = squared.shape
    distance = np.empty((rows, columns), np.float32)
    for row in range(rows):
        for column in range(columns):
            s = squared[row, column]
            distance[row, column] = np.inf if s >= FAR else max(0.0, (math.sqrt(s) - 0.5) * resolution)
    return distance


def proximity_cost(distance: NDArray[np.float32], width: float, blur: int) -> NDArray[np.float32]:
    """STAA*'s inflated, blurred grid: ``clip(1 - distance/width, 0, 1)``, box-blurred over ``2 blur + 1`` cells.

    ``width`` [m]: distance at which the cost, 1 at an obstacle, is 0; ``blur``: cells each way. Shape (rows, columns).
    """
    cost = np.empty_like(distance)
    _blurred(distance, np.float32(-1.0 / width), blur, np.float32(1.0 / (2 * blur + 1) ** 2), cost)
    return cost


@njit(cache=True)
def _blurred(distance, slope, blur, share, cost):
    """Fill ``cost``: sums along columns, then along rows, of ``clip(1 + slope distance, 0, 1)``, times ``share``."""
    rows, columns = distance.shape
    one, zero = np.float32(1.0), np.float32(0.0)
    along = np.empty(columns + 2 * blur, np.float32)
    near = np.empty((rows, columns), np.float32)
    for row in range(rows):
        for column in range(columns):
            near[row, column] = min(max(distance[row, column] * slope + one, zero), one)
    inner = along[blur : blur + columns]
    for row in range(rows):
        first = near[max(0, row - blur)]
        for column in range(columns):
            inner[column] = first[column]
        for k in range(1 - blur, blur + 1):  # border cells are repeated outwards
            other = near[min(rows - 1, max(0, row + k))]
            for column in range(columns):
                inner[column] += other[column]
        for k in range(blur):
            along[k], along[columns + 2 * blur - 1 - k] = inner[0], inner[columns - 1]
        total = cost[row]
        for column in range(columns):
            total[column] = along[column]
        for k in range(1, 2 * blur + 1):
            for column in range(columns):
                total[column] += along[column + k]
        for column in range(columns):
            total[column] *= share
