"""Outlines of obstacle polygons grown by the room that the base needs, from which a visibility graph is made.

Rings keep the obstacle on their left. Each comes with its wall, which is the ring shrunk by 2 mm.
"""

import functools
import math
from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from motm_twin.model.geometry import Array
from motm_twin.model.motion import kernel

SHRINK = 0.002  # [m]
SAME = 1e-6  # [m] points of a ring this close to the one before are left out
KEPT = 512  # polygons whose grown shape is remembered


class Rings(NamedTuple):
    """Closed polygon rings: points (n, 2); per ring (r, 6) x_low, y_low, x_high, y_high, first point, end of points."""

    point: Array
    ring: Array


def rings_of(polygons: tuple[Array, ...]) -> Rings:
    """Polygons (n, 2) [m] as they are."""
    if not polygons:
        return Rings(np.zeros((0, 2)), np.zeros((0, 6)))
    points, ring = np.concatenate(polygons).astype(np.float64), np.empty((len(polygons), 6))
    ring[:, 5] = np.cumsum([len(polygon) for polygon in polygons])
    ring[:1, 4], ring[1:, 4] = 0, ring[:-1, 5]
    _fill_boxes(points, ring)
    return Rings(points, ring)


def grown_outlines(
    polygons: tuple[Array, ...], g: float, bounds: tuple[float, float, float, float]
) -> tuple[Rings, Rings, Array]:
    """Outlines of the union of the polygons grown by g [m], two chamfers per right angle, their walls, and corners.

    Corners (c, 6) are the convex ones between the bounds (x_min, y_min, x_max, y_max): x, y and the same of the
    neighbours before and after on the outline [m].
    """
    points, ends, outside = _closed_rings(polygons, g)
    ring, wall, corner = np.empty_like(points), np.empty_like(points), np.empty((len(points), 6))
    table = np.empty((len(ends), 6))
    rings, corners = _trace(points, ends, outside, bounds, ring, table, wall, corner)
    table = table[:rings]
    total = int(table[-1, 5]) if rings else 0
    walls = table.copy()
    _fill_boxes(ring, table)
    _fill_boxes(wall, walls)
    return Rings(ring[:total], table), Rings(wall[:total], walls), corner[:corners]


def _closed_rings(polygons: tuple[Array, ...], g: float) -> tuple[Array, NDArray[np.int64], NDArray[np.bool_]]:
    """The union of the grown polygons: points (n, 2), end of each ring (r,), and True for outer rings, not holes (r,).

    The last point of each ring is its first.
    """
    grown = [_grown(np.asarray(polygon, dtype=np.float64).tobytes(), g) for polygon in polygons]
    area = shapely.simplify(shapely.union_all(grown), 0.005)
    rings, part = shapely.get_rings(shapely.get_parts(area), return_index=True)
    points, ring = shapely.get_coordinates(rings, return_index=True)
    ends = np.cumsum(np.bincount(ring, minlength=len(rings)))
    outside = np.ones(len(rings), dtype=np.bool_)
    outside[1:] = part[1:] != part[:-1]
    return points, ends, outside


# Few polygons change from one map to the next. A pure function of bytes of float64, shape (n, 2).
@functools.lru_cache(maxsize=KEPT)
def _grown(polygon: bytes, g: float) -> shapely.Geometry:
    return shapely.buffer(shapely.polygons(np.frombuffer(polygon).reshape(-1, 2)), g, quad_segs=2)


@kernel
def _fill_boxes(points: Array, table: Array) -> None:
    """Fill in the bounds of rings whose first point and end are known."""
    for r in range(table.shape[0]):
        x_low, y_low, x_high, y_high = math.inf, math.inf, -math.inf, -math.inf
        for i in range(int(table[r, 4]), int(table[r, 5])):
            x_low, x_high = min(x_low, points[i, 0]), max(x_high, points[i, 0])
            y_low, y_high = min(y_low, points[i, 1]), max(y_high, points[i, 1])
        table[r, 0], table[r, 1], table[r, 2], table[r, 3] = x_low, y_low, x_high, y_high


@kernel
def _oriented(points: Array, first: int, last: int, outside: bool, ring: Array, start: int) -> int:
    """Write an open ring with the obstacle on its left, without repeated points, and return its end."""
    area = 0.0
    for i in range(first, last):
        k = i + 1 if i + 1 < last else first
        area += points[i, 0] * points[k, 1] - points[k, 0] * points[i, 1]
    forwards = (area > 0.0) == outside
    end = start
    before = last - 1 if forwards else first
    for step in range(last - first):
        i = first + step if forwards else last - 1 - step
        if math.hypot(points[i, 0] - points[before, 0], points[i, 1] - points[before, 1]) > SAME:
            ring[end, 0], ring[end, 1] = points[i, 0], points[i, 1]
            end += 1
        before = i
    return end


@kernel
def _trace(
    points: Array,
    ends: NDArray[np.int64],
    outside: NDArray[np.bool_],
    bounds: tuple[float, float, float, float],
    ring: Array,
    table: Array,
    wall: Array,
    corner: Array,
) -> tuple[int, int]:
    """Fill in the results of `grown_outlines`, except the boxes; returns the numbers of rings and corners."""
    rings, corners, start = 0, 0, 0
    for r in range(ends.shape[0]):
        end = _oriented(points, ends[r - 1] if r > 0 else 0, ends[r] - 1, outside[r], ring, start)
        if end - start < 3:
            continue
        for i in range(start, end):
            before, after = i - 1 if i > start else end - 1, i + 1 if i + 1 < end else start
            x, y = ring[i, 0], ring[i, 1]
            come_x, come_y = x - ring[before, 0], y - ring[before, 1]
            go_x, go_y = ring[after, 0] - x, ring[after, 1] - y
            length = math.hypot(come_x, come_y)
            come_x, come_y = come_x / length, come_y / length
            length = math.hypot(go_x, go_y)
            go_x, go_y = go_x / length, go_y / length
            inward_x, inward_y = -(come_y + go_y), come_x + go_x
            scale = math.hypot(inward_x, inward_y)
            if scale < 1e-6:  # a spike
                inward_x, inward_y = -come_x, -come_y
            else:
                inward_x, inward_y = inward_x / scale, inward_y / scale
            wall[i, 0], wall[i, 1] = x + SHRINK * inward_x, y + SHRINK * inward_y
            convex = come_x * go_y - come_y * go_x > 1e-6
            if convex and bounds[0] <= x <= bounds[2] and bounds[1] <= y <= bounds[3]:
                corner[corners, 0], corner[corners, 1] = x, y
                corner[corners, 2], corner[corners, 3] = ring[before, 0], ring[before, 1]
                corner[corners, 4], corner[corners, 5] = ring[after, 0], ring[after, 1]
                corners += 1
        table[rings, 4], table[rings, 5] = start, end
        rings, start = rings + 1, end
    return rings, corners
