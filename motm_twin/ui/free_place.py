"""Where to put a new body: on the robot's way and in sight, on free floor."""

import math
from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import numpy as np
import shapely

from motm_twin.bus.client import Grid
from motm_twin.bus.messages import Vector

ON_WAY = (1.5, 1.3, 1.8, 2.2)  # [m] along the way of the robot
DISTANCES = (1.5, 1.8, 1.3, 2.2)  # [m] from the robot
ANGLES = (0.0, 0.35, -0.35, 0.7, -0.7, 1.1, -1.1, 1.5, -1.5, 2.2, -2.2)  # [rad] from its heading
AROUND = (0.0, 0.6, 1.2, 1.8)  # [m] from the middle of the view
SIDES = 8
NEAREST = 1.1  # [m] from the robot
ROOM = 0.4  # [m] radius that must be free
APART = 0.7  # [m] from other bodies
Point = tuple[float, float]


class FreePlace(NamedTuple):
    """Place [m, m], heading [rad], and where that is in words."""

    x: float
    y: float
    heading: float
    where: str


def free_place(
    pose: Vector,
    grid: Grid | None,
    taken: Sequence[Sequence[float]],
    *,
    way: Sequence[Sequence[float]] = (),
    look_at: Point | None = None,
    sees: Callable[[Point], bool] = lambda _: True,
) -> FreePlace:
    """The first free place in sight: on the way of the robot, round it, or in the middle of the view.

    ``way``: the robot's path [m], from where it is; ``look_at``: floor point [m] in the middle of the view; ``sees``:
    whether something that stands there can be seen. When no free place can be seen, the first free one is taken, and
    when there is none, that before the robot.
    """
    hidden: FreePlace | None = None
    for place in _wanted(pose, way, look_at):
        here = (place.x, place.y)
        if any(math.dist(here, other) <= APART for other in taken) or not is_free(grid, here):
            continue
        if sees(here):
            return place
        hidden = hidden or place
    return hidden or _beside(pose, DISTANCES[0], 0.0)


def _wanted(pose: Vector, way: Sequence[Sequence[float]], look_at: Point | None) -> Iterator[FreePlace]:
    x, y, heading = pose
    if len(way) > 1:
        line = shapely.LineString(way)
        for along in ON_WAY:
            point = line.interpolate(along)
            if along < line.length and math.dist((x, y), (point.x, point.y)) >= NEAREST:
                yield FreePlace(point.x, point.y, heading, f"{along:.1f} m before the robot, on its way")
    for distance in DISTANCES:
        for angle in ANGLES:
            yield _beside(pose, distance, angle)
    if look_at is not None:
        for distance in AROUND:
            for k in range(SIDES if distance else 1):
                turn = heading + 2.0 * math.pi * k / SIDES
                place = (look_at[0] + distance * math.cos(turn), look_at[1] + distance * math.sin(turn))
                if math.dist(place, (x, y)) >= NEAREST:
                    yield FreePlace(*place, heading, "in the middle of the view")


def _beside(pose: Vector, distance: float, angle: float) -> FreePlace:
    x, y, heading = pose
    side = "before" if abs(angle) < 0.5 else "behind" if abs(angle) > 2.0 else "beside"
    where = f"{distance:.1f} m {side} the robot"
    return FreePlace(x + distance * math.cos(heading + angle), y + distance * math.sin(heading + angle), heading, where)


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
