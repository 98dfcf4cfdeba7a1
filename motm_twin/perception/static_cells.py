"""Static cells of the map: standing cells (hit for 3 s, on no track that may move), and cells connected to them."""

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from motm_twin.model.compiler import njit
from motm_twin.model.geometry import Array
from motm_twin.perception.clusters import touching
from motm_twin.perception.grid import Grid
from motm_twin.perception.mapper import MapSettings
from motm_twin.perception.world_map import WorldMap

JOINED = 2  # cells at most this far apart are connected
_REMEMBERS = MapSettings().static_after  # [s] without a hit after which a cell is no longer a standing one

Mask = NDArray[np.bool_]


@dataclass
class StandingCells:
    """Cells that were standing lately; both arrays of shape (n,)."""

    cells: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))  # flat indices, ascending
    until: Array = field(default_factory=lambda: np.zeros(0))  # [s] time until which each is standing when hit again

    def has(self, cells: NDArray[np.int64]) -> Mask:
        """Mask of cells (m,), by flat index, that are among these; shape (m,)."""
        return _among(cells, self.cells)

    def renew(self, cells: NDArray[np.int64], now: float) -> None:
        """Remember these from now [s] on, and forget the others whose time is over."""
        kept = (self.until > now) & ~_among(self.cells, cells)
        until = np.concatenate((self.until[kept], np.full(len(cells), now + _REMEMBERS)))
        cells = np.concatenate((self.cells[kept], cells))
        order = np.argsort(cells)
        self.cells, self.until = cells[order], until[order]


def static_cells(memory: StandingCells, world: WorldMap, grid: Grid, on_tracks: Mask) -> tuple[Mask, Mask]:
    """Masks of the map's seen cells: standing ones, and these with all cells connected to them; shape (m,) both.

    A cell is standing if it was hit for 3 s and is on no track that may move (``on_tracks``, (m,)), or if it is hit
    again within 3 s after it was. Sides of a box that flicker or come into sight are connected to the box.
    """
    cells = grid.cell_of(world.seen_points)
    numbers = cells[:, 0] * grid.shape[1] + cells[:, 1]
    stood = (world.seen_static & ~on_tracks) | memory.has(numbers)
    memory.renew(numbers[stood], world.stamp)
    return stood, stood | touching(cells.astype(np.int32), stood, ~on_tracks, JOINED)


def _among(cells: NDArray[np.int64], known: NDArray[np.int64]) -> Mask:
    """Mask of cells (m,) that are among the known ones (n,), in ascending order; shape (m,)."""
    if not len(known):
        return np.zeros(len(cells), dtype=bool)
    return known[np.minimum(np.searchsorted(known, cells), len(known) - 1)] == cells


@njit(cache=True)
def beside(points, seen, stood, static, origin, resolution, shape):
    """Masks of points (n, 2): in or beside a standing cell, and in or beside a static one; shape (n,) both.

    ``seen``: centres of cells [m], (m, 2), with their masks ``stood`` and ``static``, (m,); ``shape`` of the map.
    """
    rows, columns = shape
    marks = np.zeros((rows + 2, columns + 2), np.int8)  # 1: beside a static cell, 2: beside a standing one, too
    for i in range(seen.shape[0]):
        row = math.floor((seen[i, 1] - origin[1]) / resolution)
        column = math.floor((seen[i, 0] - origin[0]) / resolution)
        mark = 2 if stood[i] else 1 if static[i] else 0
        for r in range(row, row + 3):
            for c in range(column, column + 3):
                marks[r, c] = max(marks[r, c], mark)
    by_stood, by_static = np.zeros(points.shape[0], np.bool_), np.zeros(points.shape[0], np.bool_)
    for i in range(points.shape[0]):
        row = math.floor((points[i, 1] - origin[1]) / resolution) + 1
        column = math.floor((points[i, 0] - origin[0]) / resolution) + 1
        if 0 <= row < rows + 2 and 0 <= column < columns + 2:
            by_stood[i], by_static[i] = marks[row, column] == 2, marks[row, column] > 0
    return by_stood, by_static
