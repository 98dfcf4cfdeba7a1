"""Evidence of seen obstacles: hits add to it, beams that pass through a cell reduce it, and old evidence is forgotten.

Every cell holds a small integer, like log-odds clipped at both ends. One hit makes a cell occupied; a cell that is hit
repeatedly is cleared by ``evidence_most`` free scans, so that noise at its border causes no flicker.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from motm_twin.model.compiler import njit

NEVER = -(2**30)  # [ms] time stamp of an event that has not happened
SECTORS = 256  # of the view round the sensor; a beam is followed as far as there is evidence in its sector


class Fading(NamedTuple):
    """Rules by which evidence is added and removed; see `MapSettings`."""

    hit: int  # evidence of one hit
    most: int
    static_ms: int
    grace_ms: int
    hidden_ms: int
    shadow: float  # [m]
    forget_ms: int


@dataclass
class Evidence:
    """Evidence of the lidar about every cell; time stamps in integer milliseconds, shape (rows, columns) each."""

    level: NDArray[np.int8]  # 0 free or unknown, > 0 occupied
    last_hit: NDArray[np.int64]  # of this cell
    near_since: NDArray[np.int64]  # 3x3 neighbourhood occupied without a break since
    near_last: NDArray[np.int64]  # 3x3 neighbourhood occupied until
    near_hit: NDArray[np.int64]  # last hit in the 3x3 neighbourhood
    outside: NDArray[np.uint8]  # 1: occupied while it was not under the robot's own body
    seen: NDArray[np.int64]  # last time that a beam showed this cell, or the robot stood on it


def no_evidence(shape: tuple[int, int]) -> Evidence:
    """Evidence before the first scan."""
    hit, since, last, near, seen = (np.full(shape, NEVER, dtype=np.int64) for _ in range(5))
    level, outside = np.zeros(shape, dtype=np.int8), np.zeros(shape, dtype=np.uint8)
    return Evidence(level, hit, since, last, near, outside, seen)


@njit(cache=True)
def mark_hits(
    level, last_hit, outside, hit_now, visible_distance, inside, ends, ranges, now_ms, frame, explained, fading
):
    """Add evidence in the cells the beams end in, unless the map explains the hit.

    ``ends``: beam end points [m], shape (n, 2); ``ranges``: [m], < 0 where the beam hit nothing usable;
    ``frame``: (origin x, origin y, resolution); ``explained``: (margin [m], margin per range [m/m]).
    """
    rows, columns = level.shape
    for beam in range(ranges.shape[0]):
        if ranges[beam] < 0.0:
            continue
        row = math.floor((ends[beam, 1] - frame[1]) / frame[2])
        column = math.floor((ends[beam, 0] - frame[0]) / frame[2])
        if row < 0 or column < 0 or row >= rows or column >= columns or hit_now[row, column]:
            continue
        if inside[row, column] or visible_distance[row, column] < explained[0] + explained[1] * ranges[beam]:
            continue
        hit_now[row, column] = 1
        if level[row, column] == 0:
            outside[row, column] = 0
        last_hit[row, column] = now_ms
        level[row, column] = min(fading.most, level[row, column] + fading.hit)


@njit(cache=True)
def _evidence_in_sectors(occupied, columns, x0, y0):
    """Distance [cells] of the farthest evidence in each sector round (x0, y0) [cells], 0 without any; (SECTORS,)."""
    far = np.zeros(SECTORS)
    per_radian = SECTORS / (2.0 * math.pi)
    for i in range(occupied.shape[0]):
        dx, dy = occupied[i] % columns + 0.5 - x0, occupied[i] // columns + 0.5 - y0
        distance = math.sqrt(dx * dx + dy * dy)
        half = 1.0 / distance if distance > 2.0 else math.pi  # [rad] half a cell's angle: at most asin(0.71 / distance)
        middle = math.atan2(dy, dx)
        first, last = math.floor((middle - half) * per_radian), math.floor((middle + half) * per_radian)
        for k in range(first, min(last, first + SECTORS - 1) + 1):
            far[k % SECTORS] = max(far[k % SECTORS], distance + 2.0)
    return far


@njit(cache=True)
def clear_rays(
    level, hit_now, passed_now, last_hit, near_since, near_hit, occupied, sensor, ends, struck, now_ms, frame,
    fading,
):  # fmt: skip
    """Reduce evidence, once per scan, in every cell that a beam passed through before its end.

    In the shadow of a hit (``struck``: its range [m], < 0: none), cells that are not static and were not hit for a
    while are freed: an agent that approaches the robot hides the cells in which it was seen before.
    ``occupied``: flat indices of cells with evidence; no beam is followed beyond the last of them in its direction.
    """
    rows, columns = level.shape
    x0, y0 = (sensor[0] - frame[0]) / frame[2], (sensor[1] - frame[1]) / frame[2]
    far = _evidence_in_sectors(occupied, columns, x0, y0)
    for beam in range(ends.shape[0]):
        if math.isnan(ends[beam, 0]):
            continue
        dx, dy = (ends[beam, 0] - frame[0]) / frame[2] - x0, (ends[beam, 1] - frame[1]) / frame[2] - y0
        column, row = math.floor(x0), math.floor(y0)
        step_x, step_y = (1 if dx > 0.0 else -1), (1 if dy > 0.0 else -1)
        per_x = abs(1.0 / dx) if dx != 0.0 else math.inf
        per_y = abs(1.0 / dy) if dy != 0.0 else math.inf
        next_x = ((column + 1 - x0) if dx > 0.0 else (x0 - column)) * per_x if dx != 0.0 else math.inf
        next_y = ((row + 1 - y0) if dy > 0.0 else (y0 - row)) * per_y if dy != 0.0 else math.inf
        last = 1.0 + fading.shadow / struck[beam] if struck[beam] > 0.0 else 1.0
        reach = far[math.floor(math.atan2(dy, dx) * (SECTORS / (2.0 * math.pi))) % SECTORS]
        last = min(last, reach / max(1e-9, math.sqrt(dx * dx + dy * dy)))
        entered = 0.0  # where the beam entered this cell, as a share of its length
        while entered < last:
            leaves = min(next_x, next_y)
            if 0 <= row < rows and 0 <= column < columns and level[row, column] > 0 and hit_now[row, column] == 0:
                if leaves < 1.0:  # the cell that the beam ends in is never cleared by it
                    if passed_now[row, column] == 0:
                        passed_now[row, column] = 1
                        level[row, column] -= 1
                elif entered > 1.0 and now_ms - last_hit[row, column] > fading.hidden_ms:
                    if near_hit[row, column] - near_since[row, column] < fading.static_ms:
                        level[row, column] = 0
            entered = leaves
            if next_x < next_y:
                column += step_x
                next_x += per_x
            else:
                row += step_y
                next_y += per_y


@njit(cache=True)
def settle(occupied, level, last_hit, near_since, near_last, near_hit, now_ms, fading):
    """Free cells that were not confirmed, update how long cells have been occupied, and list the occupied cells.

    ``occupied``: flat indices, ascending, of all cells with evidence and perhaps others. Returns (cells, static): row
    and column of those that remain, in the same order, shape (m, 2), and the mask of static ones, shape (m,).
    """
    rows, columns = level.shape
    cells = np.empty((occupied.shape[0], 2), np.int32)
    count = 0
    for i in range(occupied.shape[0]):
        row, column = occupied[i] // columns, occupied[i] % columns
        if level[row, column] == 0:
            continue
        lasting = near_hit[row, column] - near_since[row, column] >= fading.static_ms
        if not lasting and now_ms - last_hit[row, column] > fading.forget_ms:
            level[row, column] = 0
            continue
        cells[count, 0], cells[count, 1] = row, column
        count += 1
        hit = last_hit[row, column] == now_ms
        for r in range(max(0, row - 1), min(rows, row + 2)):
            for c in range(max(0, column - 1), min(columns, column + 2)):
                if now_ms - near_last[r, c] > fading.grace_ms:
                    near_since[r, c] = now_ms
                    near_hit[r, c] = now_ms
                near_last[r, c] = now_ms
                if hit:
                    near_hit[r, c] = now_ms
    static = np.empty(count, np.bool_)
    for i in range(count):
        row, column = cells[i, 0], cells[i, 1]
        static[i] = near_hit[row, column] - near_since[row, column] >= fading.static_ms
    return cells[:count].copy(), static


@njit(cache=True)
def clear_footprint(level, outside, hit_now, occupied, pose, body, frame):
    """Free the cells under the robot's body, except those that are hit now or were occupied before it was there.

    A cell that became occupied under the footprint is noise, or the robot itself. One that was occupied before is an
    obstacle that the robot overlaps. ``occupied``: flat indices of cells with evidence; ``body``: half length, half
    width and offset of the footprint [m]; ``outside`` is updated.
    """
    columns = level.shape[1]
    cos, sin = math.cos(pose[2]), math.sin(pose[2])
    x0, y0 = pose[0] + body[2] * cos, pose[1] + body[2] * sin
    for i in range(occupied.shape[0]):
        row, column = occupied[i] // columns, occupied[i] % columns
        dx = frame[0] + (column + 0.5) * frame[2] - x0
        dy = frame[1] + (row + 0.5) * frame[2] - y0
        if abs(cos * dx + sin * dy) >= body[0] or abs(cos * dy - sin * dx) >= body[1]:
            outside[row, column] = 1
        elif not hit_now[row, column] and not outside[row, column]:
            level[row, column] = 0
