"""Floor that the robot has seen to be free, and when it did. Floor never seen does not count as free."""

import math

import msgspec
import numpy as np
from numpy.typing import NDArray

from motm_twin.model.compiler import njit
from motm_twin.model.profile import RobotProfile
from motm_twin.perception.grid import Grid
from motm_twin.perception.occupancy import NEVER

UNSEEN, STALE, FRESH = 0, 1, 2
SEEN_LASTS = 5.0  # [s] for which seen floor is fresh; later, a person may have walked in from beyond the map's reach
ROOM = 0.5  # [m] of floor kept beyond the stopping distance at full speed


class Floor(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Floor round the robot: `UNSEEN`, `STALE` or `FRESH` for each cell; arrays are read-only."""

    corner: tuple[float, float]  # world corner of cell (0, 0) [m]
    resolution: float  # [m]
    seen: NDArray[np.uint8]  # shape (rows, columns); row = y, column = x


def sight_radius(robot: RobotProfile) -> float:
    """Radius [m] about the base of the floor that is kept: footprint, stopping distance at full speed, and `ROOM`."""
    base, body = robot.base, robot.footprint
    speed = base.full_speed
    corner = math.hypot(0.5 * body.length + abs(body.offset_x), 0.5 * body.width)
    return corner + speed * base.velocity_lag + speed * speed / (2.0 * base.linear_acceleration) + ROOM


def floor_round(seen: NDArray[np.int64], grid: Grid, centre: NDArray[np.float64], radius: float, now_ms: int) -> Floor:
    """The floor in a square of half side ``radius`` [m] about a point (2,), from the times [ms] it was last seen."""
    low = np.clip(grid.cell_of(centre - radius), 0, grid.shape)
    high = np.clip(grid.cell_of(centre + radius) + 1, 0, grid.shape)
    part = seen[low[0] : high[0], low[1] : high[1]]
    state = (part > NEVER).astype(np.uint8) + (part >= now_ms - round(SEEN_LASTS * 1000.0)).astype(np.uint8)
    state.setflags(write=False)
    corner = (grid.origin[0] + grid.resolution * float(low[1]), grid.origin[1] + grid.resolution * float(low[0]))
    return Floor(corner=corner, resolution=grid.resolution, seen=state)


@njit(cache=True)
def mark_seen(seen, pose, origin, ranges, angle_min, angle_step, radius, body, now_ms, frame):
    """Mark the cells that this sweep shows, and those under the footprint, as seen at ``now_ms``.

    A cell is seen when both beams beside it pass it or end in it. If the footprint covers floor never seen before (at
    the start, or after a push), the robot is assumed to have room to turn: its circumscribed circle counts as seen.
    ``body``: half length, half width, offset of the footprint [m]; ``frame``: (origin x, origin y, resolution).
    """
    rows, columns = seen.shape
    c, s = math.cos(pose[2]), math.sin(pose[2])
    x0, y0 = pose[0] + c * origin[0] - s * origin[1], pose[1] + s * origin[0] + c * origin[1]
    cell = frame[2]
    first_row, last_row = (
        math.floor((pose[1] - radius - frame[1]) / cell),
        math.floor((pose[1] + radius - frame[1]) / cell),
    )
    first_column = math.floor((pose[0] - radius - frame[0]) / cell)
    last_column = math.floor((pose[0] + radius - frame[0]) / cell)
    put_down = False
    for row in range(max(0, first_row), min(rows, last_row + 1)):
        for column in range(max(0, first_column), min(columns, last_column + 1)):
            x, y = frame[0] + (column + 0.5) * cell, frame[1] + (row + 0.5) * cell
            dx, dy = x - pose[0], y - pose[1]
            if abs(c * dx + s * dy - body[2]) <= body[0] and abs(c * dy - s * dx) <= body[1]:
                put_down = put_down or seen[row, column] == NEVER
                seen[row, column] = now_ms
                continue
            dx, dy = x - x0, y - y0
            turn = math.atan2(dy, dx) - pose[2] - angle_min
            turn -= 2.0 * math.pi * math.floor(turn / (2.0 * math.pi))
            beam = int(turn / angle_step)
            if beam + 1 < ranges.shape[0]:
                distance = math.sqrt(dx * dx + dy * dy) - 0.5 * cell
                if distance <= ranges[beam] and distance <= ranges[beam + 1]:
                    seen[row, column] = now_ms
    if put_down:
        reach = math.hypot(body[0] + abs(body[2]), body[1]) + cell
        for row in range(max(0, first_row), min(rows, last_row + 1)):
            for column in range(max(0, first_column), min(columns, last_column + 1)):
                x, y = frame[0] + (column + 0.5) * cell - pose[0], frame[1] + (row + 0.5) * cell - pose[1]
                if x * x + y * y <= reach * reach:
                    seen[row, column] = now_ms
