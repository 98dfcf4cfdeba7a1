"""The grid: which cell a point of the world lies in, and where a cell is."""

import math

import msgspec
import numpy as np
from numpy.typing import NDArray

from motm_twin.model.geometry import Array


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
        """Whether each cell (row, col) is in the grid, shape (..., 2) to (...)."""
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
