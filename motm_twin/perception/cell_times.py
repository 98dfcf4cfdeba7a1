"""Cells of the map, by numbers that are the same in every map, each with a time."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from motm_twin.perception.base_map import read_only
from motm_twin.perception.world_map import WorldMap

ROWS_APART = 1 << 32  # between the numbers of two cells in the same column
_NEXT = np.arange(-1, 2)
_ONE = np.ones(1, dtype=np.bool_)
AROUND = (ROWS_APART * _NEXT[:, None] + _NEXT).ravel()  # added to a cell: it and its neighbours

Numbers = NDArray[np.int64]  # of cells
Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class CellTimes:
    """Different cells in ascending order and a time [s] of each, shape (n,) both; read-only."""

    cells: Numbers = field(default_factory=lambda: read_only(np.zeros(0, dtype=np.int64)))
    times: NDArray[np.float64] = field(default_factory=lambda: read_only(np.zeros(0)))

    def has(self, cells: Numbers) -> Mask:
        """Which of these are among them, shape (m,)."""
        if not len(self.cells):
            return np.zeros(len(cells), dtype=np.bool_)
        return self.cells[np.minimum(np.searchsorted(self.cells, cells), len(self.cells) - 1)] == cells

    def of(self, cells: Numbers, otherwise: float) -> NDArray[np.float64]:
        """The times [s] of these, shape (m,); ``otherwise`` for those that are not among them."""
        times = np.full(len(cells), otherwise)
        if len(self.cells):
            at = np.minimum(np.searchsorted(self.cells, cells), len(self.cells) - 1)
            found = self.cells[at] == cells
            times[found] = self.times[at[found]]
        return times

    def after(self, time: float) -> "CellTimes":
        """Those whose time is later than this one."""
        late = self.times > time
        return CellTimes(read_only(self.cells[late]), read_only(self.times[late]))


def latest(parts: Sequence[tuple[Numbers, NDArray[np.float64] | float]]) -> CellTimes:
    """All these cells, each with its latest time [s]."""
    cells = np.concatenate([numbers for numbers, _ in parts])
    times = np.concatenate([np.full(len(numbers), time, dtype=float) for numbers, time in parts])
    if not len(cells):
        return CellTimes()
    order = np.argsort(cells)
    ordered = cells[order]
    first = np.flatnonzero(np.concatenate((_ONE, ordered[1:] != ordered[:-1])))  # entry of each cell
    return CellTimes(read_only(ordered[first]), read_only(np.maximum.reduceat(times[order], first)))


def numbers_of(world: WorldMap) -> Numbers:
    """One number per cell of the seen points, the same in every map."""
    column, row = np.floor(world.seen_points.T / world.resolution).astype(np.int64)
    return row * ROWS_APART + column
