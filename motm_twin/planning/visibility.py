"""Visibility graph over obstacle polygons grown by g, as arrays, and the tests made on it.

Rings keep the obstacle on their left. Vertices lie on the grown polygons; sight is tested against the same polygons
shrunk by 2 mm, so that a line along an edge or through a corner is free and any other crossing is not.
"""

import functools
import math
from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from motm_twin.model.geometry import Array
from motm_twin.planning.kernel import kernel, length_of

IntArray = NDArray[np.int32]
SHRINK = 0.002  # [m]
FAR = 1e9  # [m]
KEPT = 512  # polygons and outlines whose shape is remembered
TOUCH = 1e-9  # [m^2] cross products smaller than this count as collinear


class Rings(NamedTuple):
    """Closed polygon rings: points (n, 2); per ring (r, 6) x_low, y_low, x_high, y_high, first point, end of points."""

    point: Array
    ring: Array


class Graph(NamedTuple):
    """Directed tangential edges between the convex corners of the grown polygons. Few arrays: they compile faster."""

    vertex: Array  # (n, 6) x, y and the same of its neighbours before and after on the ring [m]
    outline: Rings  # grown polygons: what a point can be inside of
    walls: Rings  # grown polygons shrunk by 2 mm: what blocks sight
    solids: Rings  # polygons as they are
    out_start: IntArray  # (n + 1,) edges leaving vertex v are out_start[v] .. out_start[v + 1] - 1
    ends: IntArray  # (e, 2) vertices from, to
    edge: Array  # (e, 2) length [m], direction [rad]
    in_start: IntArray  # (n + 1,)
    in_edge: IntArray  # (e,) edges arriving at each vertex


@kernel
def segment_free(ax: float, ay: float, bx: float, by: float, walls: Rings) -> bool:
    """Whether the open segment a-b crosses no ring."""
    dx, dy = bx - ax, by - ay
    x_low, x_high = min(ax, bx), max(ax, bx)
    y_low, y_high = min(ay, by), max(ay, by)
    for r in range(walls.ring.shape[0]):
        ring = walls.ring
        if ring[r, 0] > x_high or ring[r, 2] < x_low or ring[r, 1] > y_high or ring[r, 3] < y_low:
            continue
        first, last = int(walls.ring[r, 4]), int(walls.ring[r, 5])
        cx, cy = walls.point[last - 1, 0], walls.point[last - 1, 1]
        side_c = dx * (cy - ay) - dy * (cx - ax) > 0.0
        for i in range(first, last):
            ex, ey = walls.point[i, 0], walls.point[i, 1]
            side_e = dx * (ey - ay) - dy * (ex - ax) > 0.0
            if side_c != side_e:
                fx, fy = ex - cx, ey - cy
                if (fx * (ay - cy) - fy * (ax - cx) > 0.0) != (fx * (by - cy) - fy * (bx - cx) > 0.0):
                    return False
            cx, cy, side_c = ex, ey, side_e
    return True


@kernel
def inside(px: float, py: float, rings: Rings) -> bool:
    """Whether a point is in the area of the rings (even-odd rule, so holes are outside)."""
    odd = False
    for r in range(rings.ring.shape[0]):
        ring = rings.ring
        if px < ring[r, 0] or px > ring[r, 2] or py < ring[r, 1] or py > ring[r, 3]:
            continue
        first, last = int(rings.ring[r, 4]), int(rings.ring[r, 5])
        cx, cy = rings.point[last - 1, 0], rings.point[last - 1, 1]
        for i in range(first, last):
            ex, ey = rings.point[i, 0], rings.point[i, 1]
            if (cy > py) != (ey > py) and px < (ex - cx) * (py - cy) / (ey - cy) + cx:
                odd = not odd
            cx, cy = ex, ey
    return odd


@kernel
def push_out(px: float, py: float, outline: Rings, solids: Rings) -> tuple[float, float, float]:
    """Nearest point outside the grown polygons, and how far it is [m]: 0 for a point that is outside.

    A way out that would lead through a solid is taken only when there is no other.
    """
    if not inside(px, py, outline):
        return px, py, 0.0
    qx, qy, nearest = px, py, math.inf
    for direct in range(2):
        for r in range(outline.ring.shape[0]):
            first, last = int(outline.ring[r, 4]), int(outline.ring[r, 5])
            cx, cy = outline.point[last - 1, 0], outline.point[last - 1, 1]
            for i in range(first, last):
                ex, ey = outline.point[i, 0], outline.point[i, 1]
                fx, fy = ex - cx, ey - cy
                squared = fx * fx + fy * fy
                t = 0.0
                if squared > 0.0:
                    t = min(1.0, max(0.0, ((px - cx) * fx + (py - cy) * fy) / squared))
                nx, ny = cx + t * fx, cy + t * fy
                cx, cy = ex, ey
                distance = length_of(nx - px, ny - py)
                if distance >= nearest or (direct == 0 and not segment_free(px, py, nx, ny, solids)):
                    continue
                nearest = distance
                ux, uy = (nx - px) / max(distance, 1e-9), (ny - py) / max(distance, 1e-9)
                qx, qy = nx + SHRINK * ux, ny + SHRINK * uy
        if nearest < math.inf:
            break
    return qx, qy, nearest


@kernel
def tangential(v: int, dx: float, dy: float, vertex: Array) -> bool:
    """Whether a line of direction (dx, dy) through vertex v leaves both its neighbours on one side."""
    one = dx * (vertex[v, 3] - vertex[v, 1]) - dy * (vertex[v, 2] - vertex[v, 0])
    two = dx * (vertex[v, 5] - vertex[v, 1]) - dy * (vertex[v, 4] - vertex[v, 0])
    return (one >= -TOUCH and two >= -TOUCH) or (one <= TOUCH and two <= TOUCH)


@kernel
def visible_vertices(px: float, py: float, graph: Graph, found: IntArray) -> int:
    """Write the vertices that can be reached from p by a tangential free line into `found`; returns how many."""
    count = 0
    for v in range(graph.vertex.shape[0]):
        vx, vy = graph.vertex[v, 0], graph.vertex[v, 1]
        if tangential(v, vx - px, vy - py, graph.vertex) and segment_free(px, py, vx, vy, graph.walls):
            found[count] = v
            count += 1
    return count


@kernel
def _see_each_other(vertex: Array, walls: Rings, free: NDArray[np.bool_]) -> None:
    for u in range(vertex.shape[0]):
        for v in range(u + 1, vertex.shape[0]):
            dx, dy = vertex[v, 0] - vertex[u, 0], vertex[v, 1] - vertex[u, 1]
            if (
                tangential(u, dx, dy, vertex)
                and tangential(v, dx, dy, vertex)
                and segment_free(vertex[u, 0], vertex[u, 1], vertex[v, 0], vertex[v, 1], walls)
            ):
                free[u, v] = free[v, u] = True


def _neighbours(ring: Array) -> tuple[Array, Array]:
    """The point before and the one after each of a ring, shape (n, 2) each."""
    return np.concatenate((ring[-1:], ring[:-1])), np.concatenate((ring[1:], ring[:1]))


def _corners(ring: Array) -> tuple[Array, IntArray]:
    """The ring shrunk by SHRINK, and the indices of its convex corners."""
    before, after = _neighbours(ring)
    come, go = ring - before, after - ring
    come /= np.hypot(come[:, 0], come[:, 1])[:, None]
    go /= np.hypot(go[:, 0], go[:, 1])[:, None]
    inward = np.column_stack((-(come[:, 1] + go[:, 1]), come[:, 0] + go[:, 0]))
    scale = np.hypot(inward[:, 0], inward[:, 1])
    spike = scale < 1e-6
    inward = np.where(spike[:, None], -come, inward / np.where(spike, 1.0, scale)[:, None])
    convex = np.flatnonzero(come[:, 0] * go[:, 1] - come[:, 1] * go[:, 0] > 1e-6).astype(np.int32)
    return ring + SHRINK * inward, convex


def _rings(rings: list[Array], bounds: list[tuple[float, ...]]) -> Rings:
    """Rings (n, 2) and of each x_low, y_low, x_high, y_high as one table."""
    end = np.cumsum([len(ring) for ring in rings])
    table = [(*box, last - len(ring), last) for box, ring, last in zip(bounds, rings, end, strict=True)]
    return Rings(np.concatenate(rings) if rings else np.zeros((0, 2)), np.array(table, dtype=np.float64).reshape(-1, 6))


def _box(ring: Array) -> tuple[float, ...]:
    return (*ring.min(axis=0).tolist(), *ring.max(axis=0).tolist())


def _oriented(coordinates: Array, *, counter_clockwise: bool) -> Array:
    ring = np.ascontiguousarray(coordinates[:-1])
    _, after = _neighbours(ring)
    area = float(np.sum(ring[:, 0] * after[:, 1] - after[:, 0] * ring[:, 1]))
    ring = ring if (area > 0.0) == counter_clockwise else ring[::-1].copy()
    keep = np.hypot(*(ring - _neighbours(ring)[0]).T) > 1e-6
    return np.ascontiguousarray(ring[keep])


class Outline(NamedTuple):
    """A grown ring, shrunk to what blocks sight, with the bounds of both and the convex corners (c, 6) of `Graph`."""

    ring: Array
    wall: Array
    ring_box: tuple[float, ...]
    wall_box: tuple[float, ...]
    corner: Array


# From one map to the next few polygons change. Both are pure functions of bytes of float64, shape (n, 2).
@functools.lru_cache(maxsize=KEPT)
def _grown(polygon: bytes, g: float) -> shapely.Geometry:
    corners = np.frombuffer(polygon).reshape(-1, 2)
    return shapely.buffer(shapely.Polygon(corners), g, quad_segs=2)


@functools.lru_cache(maxsize=KEPT)
def _outline(coordinates: bytes, counter_clockwise: bool) -> Outline | None:
    ring = _oriented(np.frombuffer(coordinates).reshape(-1, 2), counter_clockwise=counter_clockwise)
    if len(ring) < 3:
        return None
    wall, convex = _corners(ring)
    corner = np.hstack((ring[convex], ring[convex - 1], ring[(convex + 1) % len(ring)]))
    return Outline(ring, wall, _box(ring), _box(wall), corner)


def outlines(polygons: tuple[Array, ...], g: float) -> list[Outline]:
    """Outlines of the union of the polygons grown by g [m], two chamfers per right angle; obstacle on the left."""
    if not polygons:
        return []
    area = shapely.union_all([_grown(np.asarray(p, dtype=np.float64).tobytes(), g) for p in polygons])
    area = shapely.simplify(area, 0.005)
    found = []
    for part in shapely.get_parts(area):
        found.append(_outline(shapely.get_coordinates(part.exterior).tobytes(), True))
        found += [_outline(shapely.get_coordinates(hole).tobytes(), False) for hole in part.interiors]
    return [outline for outline in found if outline is not None]


def build_graph(
    polygons: tuple[Array, ...], g: float, bounds: tuple[float, float, float, float] = (-FAR, -FAR, FAR, FAR)
) -> Graph:
    """The visibility graph of obstacle polygons, each (n, 2) [m], grown by g [m].

    Corners outside the bounds (x_min, y_min, x_max, y_max) are left out, so that no path leaves the map.
    """
    outline = outlines(polygons, g)
    vertex = np.concatenate([np.zeros((0, 6)), *(one.corner for one in outline)])
    at = vertex[:, :2]
    vertex = vertex[(at >= bounds[:2]).all(axis=1) & (at <= bounds[2:]).all(axis=1)]
    walls = _rings([one.wall for one in outline], [one.wall_box for one in outline])
    solid = [np.asarray(p, dtype=np.float64) for p in polygons]
    solids = _rings(solid, [_box(corners) for corners in solid])
    free = np.zeros((len(vertex), len(vertex)), dtype=bool)
    _see_each_other(vertex, walls, free)
    edge_from, edge_to = (part.astype(np.int32) for part in np.nonzero(free))
    out_start = np.zeros(len(vertex) + 1, np.int32)
    out_start[1:] = np.cumsum(free.sum(axis=1))
    line = vertex[edge_to, :2] - vertex[edge_from, :2]
    in_edge = np.argsort(edge_to, kind="stable").astype(np.int32)
    in_start = np.zeros(len(vertex) + 1, np.int32)
    in_start[1:] = np.cumsum(np.bincount(edge_to, minlength=len(vertex)))
    return Graph(
        vertex=vertex,
        outline=_rings([one.ring for one in outline], [one.ring_box for one in outline]),
        walls=walls,
        solids=solids,
        out_start=out_start,
        ends=np.column_stack((edge_from, edge_to)),
        edge=np.column_stack((np.hypot(line[:, 0], line[:, 1]), np.arctan2(line[:, 1], line[:, 0]))),
        in_start=in_start,
        in_edge=in_edge,
    )
