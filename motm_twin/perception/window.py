"""The part of a large map that a period looks at: an office floor must not cost more than the room that is worked in.

Up to `WHOLE` cells the part is the whole map. Beyond, it is a rectangle round the robot and the next targets, snapped
to steps so that it seldom changes; outside it nothing is planned.
"""

import math
from collections.abc import Sequence

import numpy as np

from motm_twin.model.geometry import Array
from motm_twin.perception.grid import Grid

WHOLE = 600_000  # cells: 1,500 m^2 at 5 cm
AROUND = 9.0  # [m] kept round the robot and its targets: lidar reach and a way round, for most robots
STEP = 4.0  # [m] to which the rectangle is snapped

Window = tuple[slice, slice]  # rows, columns


def whole(grid: Grid) -> Window:
    """All of a map."""
    return slice(0, grid.shape[0]), slice(0, grid.shape[1])


def window_of(grid: Grid, points: Sequence[Array], around: float = AROUND) -> Window:
    """The part of the grid that holds the points (2,) [m] and what is round them."""
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

    ``boxes``: sets of cells (row, col), (m, 2) each, of a large map, outside all of which there is none.
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
