"""Where to put a new obstacle: near the robot, beside its way, on free floor."""

import math
from collections.abc import Sequence

import numpy as np

from motm_twin.bus.client import Grid
from motm_twin.bus.messages import Vector

DISTANCES = (1.3, 1.7, 2.2)  # [m] from the robot
ANGLES = (0.9, -0.9, 1.5, -1.5, 2.2, -2.2, 0.4, -0.4)  # [rad] from its heading
ROOM = 0.4  # [m] radius that must be free
APART = 0.7  # [m] from other bodies


def free_place(pose: Vector, grid: Grid | None, taken: Sequence[Sequence[float]]) -> tuple[float, float, float]:
    """Place and heading [m, m, rad]: the first one round the robot that is free, else one at its side."""
    x, y, heading = pose
    for distance in DISTANCES:
        for angle in ANGLES:
            place = (x + distance * math.cos(heading + angle), y + distance * math.sin(heading + angle))
            if all(math.dist(place, other) > APART for other in taken) and is_free(grid, place):
                return (*place, heading)
    return x + DISTANCES[0] * math.cos(heading + 1.5), y + DISTANCES[0] * math.sin(heading + 1.5), heading


def is_free(grid: Grid | None, place: Sequence[float]) -> bool:
    """Whether the known map is free within `ROOM` of a place."""
    if grid is None:
        return True
    info = grid.info
    column, row = ((place[i] - info.origin[i]) / info.resolution for i in (0, 1))
    reach = ROOM / info.resolution
    if not (reach <= column <= info.width - reach and reach <= row <= info.height - reach):
        return False
    low_row, low_column = int(row - reach), int(column - reach)
    cells = grid.cells[low_row : int(row + reach) + 1, low_column : int(column + reach) + 1]
    return not bool(np.any(cells == 255))
