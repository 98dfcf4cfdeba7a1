"""Cells of the map, by numbers that are the same in every map, each with a time."""

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from motm_twin.model.compiler import njit
from motm_twin.perception.world_map import WorldMap

ROWS_APART = 1 << 32  # between the numbers of two cells in the same column
ROUNDING = 1e-6  # of a cell: centres are at its edges where a map begins at half a cell
_NEXT = np.arange(-1, 2)
AROUND = (ROWS_APART * _NEXT[:, None] + _NEXT).ravel()  # added to a cell: it and its neighbours

Numbers = NDArray[np.int64]  # of cells
Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class CellTimes:
    """Sorted set of cell numbers with a time [s] for each, shape (n,) both; never modified in place."""

    cells: Numbers = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    times: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))

    def has(self, cells: Numbers) -> Mask:
        """Membership of each of the cells (m,) in the set, shape (m,) of bool; fastest for sorted cells."""
        return among(self.cells, cells)

    def of(self, cells: Numbers, otherwise: float) -> NDArray[np.float64]:
        """The times [s] of these, shape (m,); ``otherwise`` for those that are not among them."""
        return _times_of(self.cells, self.times, cells, otherwise)

    def after(self, time: float) -> "CellTimes":
        """Those whose time is later than this one."""
        late = self.times > time
        return CellTimes(self.cells[late], self.times[late])

    def without(self, cells: Numbers) -> "CellTimes":
        """Those that are none of these, which ascend."""
        kept = ~among(cells, self.cells)
        return CellTimes(self.cells[kept], self.times[kept])

    def also(self, cells: Numbers, times: NDArray[np.float64]) -> "CellTimes":
        """Union with cells (m,) at ``times`` [s], in any order and with repeats; each cell keeps its latest time."""
        order = np.argsort(cells)
        return CellTimes(*_merged(self.cells, self.times, cells[order], times[order]))


@njit(cache=True)
def _step_to(cell, known, at):
    """The first of the ascending cells from ``at`` on that is not less than this one."""
    while at < known.shape[0] and known[at] < cell:
        at += 1
    return at


@njit(cache=True)
def among(known, cells):
    """Which of the cells (m,) are among the ``known`` ones (n,), which ascend; shape (m,)."""
    found = np.zeros(cells.shape[0], np.bool_)
    at = 0
    for i in range(cells.shape[0]):
        at = _step_to(cells[i], known, 0 if i > 0 and cells[i] < cells[i - 1] else at)
        found[i] = at < known.shape[0] and known[at] == cells[i]
    return found


@njit(cache=True)
def _times_of(known, times, cells, otherwise):
    """The times (n,) of those of the cells (m,) that are among the ``known`` ones (n,), which ascend; shape (m,)."""
    found = np.full(cells.shape[0], otherwise)
    at = 0
    for i in range(cells.shape[0]):
        at = _step_to(cells[i], known, 0 if i > 0 and cells[i] < cells[i - 1] else at)
        if at < known.shape[0] and known[at] == cells[i]:
            found[i] = times[at]
    return found


@njit(cache=True)
def _merged(cells, times, more, until):
    """Two ascending lists of cells with times as one, in which no cell repeats: each with its latest time."""
    total = cells.shape[0] + more.shape[0]
    merged, latest = np.empty(total, np.int64), np.empty(total, np.float64)
    count, i, k = 0, 0, 0
    while i + k < total:
        if k == more.shape[0] or (i < cells.shape[0] and cells[i] <= more[k]):
            cell, time = cells[i], times[i]
            i += 1
        else:
            cell, time = more[k], until[k]
            k += 1
        if count > 0 and merged[count - 1] == cell:
            latest[count - 1] = max(latest[count - 1], time)
        else:
            merged[count], latest[count] = cell, time
            count += 1
    return merged[:count].copy(), latest[:count].copy()


@njit(cache=True)
def _numbers(points, resolution):
    numbers = np.empty(points.shape[0], np.int64)
    for i in range(points.shape[0]):
        row = math.floor(points[i, 1] / resolution + ROUNDING)
        column = math.floor(points[i, 0] / resolution + ROUNDING)
        numbers[i] = row * ROWS_APART + column
    return numbers


def cell_numbers(world: WorldMap) -> Numbers:
    """One number per cell of the seen points, the same in every map; ascending, as the cells of the map do."""
    return _numbers(world.seen_points, world.resolution)
