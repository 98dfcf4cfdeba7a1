"""The grid of the map: cells of points, centres of cells, and the window of a large map that a period uses.

The map of a whole office floor must take no more time than that of one room. Up to `WHOLE` cells the window is the
whole map. Beyond, it is a rectangle round the robot and the next targets, snapped to steps so that it seldom changes;
nothing is planned outside it.
"""

import math
from collections.abc import Sequence

import msgspec
import numpy as np
from numpy.typing import NDArray

from motm_twin.model.geometry import Array

WHOLE = 600_000  # cells: 1,500 m^2 at 5 cm
AROUND = 9.0  # [m] of window round the robot and its targets: lidar reach and a detour, for most robots
STEP = 4.0  # [m] to whose multiples the window is snapped

Window = tuple[slice, slice]  # rows, columns


class Grid(msgspec.Struct, frozen=True, kw_only=True):
    """A regular grid; row = y, column = x; cell (row, col) starts at ``origin + resolution * (col, row)``."""

    resolution: float  # [m]
    origin: tuple[float, float]  # world corner of cell (0, 0) [m]
    shape: tuple[int, int]  # (rows, columns)

    def cell_of(self, points: Array) -> NDArray[np.intp]:
        """Row and column of the cell each world point lies in, shape (..., 2) to (..., 2); may be outside the grid."""
        scaled = np.floor((np.asarray(points, dtype=float) - np.array(self.origin)) / self.resolution)
        return scaled[..., ::-1].astype(np.intp)

    def centre_of(self, cells: NDArray[np.intp]) -> Array:
        """World centre [m] of each cell (row, col), shape (..., 2) to (..., 2)."""
        return np.array(self.origin) + self.resolution * (np.asarray(cells, dtype=float)[..., ::-1] + 0.5)

    def contains(self, cells: NDArray[np.intp]) -> NDArray[np.bool_]:
        """Test that each cell (row, col) is in the grid, shape (..., 2) to (...)."""
        return np.asarray(((cells >= 0) & (cells < np.array(self.shape))).all(axis=-1))

    def centres(self) -> Array:
        """World centres [m] of all cells, shape (rows, columns, 2)."""
        rows, columns = self.shape
        return self.centre_of(np.stack(np.meshgrid(np.arange(rows), np.arange(columns), indexing="ij"), axis=-1))


def grid_over(bounds: tuple[float, float, float, float], resolution: float) -> Grid:
    """The smallest grid that covers x_min, y_min, x_max, y_max [m] with cells of the resolution [m].

    Raises ValueError for empty bounds or a resolution that is not positive.
    """
    x_min, y_min, x_max, y_max = bounds
    if not (x_max > x_min and y_max > y_min and resolution > 0.0):
        raise ValueError(f"grid bounds {bounds} with resolution {resolution}: need max > min and a positive resolution")
    rows = math.ceil((y_max - y_min) / resolution - 1e-9)
    columns = math.ceil((x_max - x_min) / resolution - 1e-9)
    return Grid(resolution=resolution, origin=(x_min, y_min), shape=(rows, columns))


def whole(grid: Grid) -> Window:
    """The window that is the whole map."""
    return slice(0, grid.shape[0]), slice(0, grid.shape[1])


def window_of(grid: Grid, points: Sequence[Array], around: float = AROUND) -> Window:
    """The window that holds the points (2,) [m] and ``around`` [m] about them; of a small grid, all of it."""
    if grid.shape[0] * grid.shape[1] <= WHOLE:
        return whole(grid)
    inside = [np.clip(point, grid.origin, np.array(grid.origin) + grid.resolution * np.array(grid.shape[::-1]))
              for point in points]  # fmt: skip
    low, high = np.min(inside, axis=0) - around, np.max(inside, axis=0) + around
    cells = max(1, round(STEP / grid.resolution))
    first, last = grid.cell_of(low), grid.cell_of(high)
    rows, columns = (
        slice(max(0, cells * math.floor(a / cells)), min(size, cells * math.ceil((b + 1) / cells)))
        for a, b, size in zip(first, last, grid.shape, strict=True)
    )
    return rows, columns


def occupied_cells(level: np.ndarray, boxes: Sequence[np.ndarray]) -> np.ndarray:
    """Flat indices of cells with evidence, ascending; shape (n,).

    ``boxes``: sets of cells (row, col), (m, 2) each; their common bounds hold all evidence of a large map.
    """
    if level.size <= WHOLE:
        return np.flatnonzero(level.view(bool))
    filled = [box for box in boxes if len(box)]
    if not filled:
        return np.zeros(0, np.int64)
    low = np.maximum(np.min([box.min(axis=0) for box in filled], axis=0), 0)
    high = np.minimum(np.max([box.max(axis=0) for box in filled], axis=0) + 1, level.shape)
    if (high <= low).any():
        return np.zeros(0, np.int64)
    row, column = np.nonzero(level[low[0] : high[0], low[1] : high[1]].view(bool))
    return (row + low[0]) * level.shape[1] + column + low[1]
