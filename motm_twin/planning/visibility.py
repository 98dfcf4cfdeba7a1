"""Visibility graph over obstacle polygons grown by g, as arrays, and the tests made on it.

Rings keep the obstacle on their left. Vertices lie on the grown polygons; sight is tested against the same polygons
shrunk by 2 mm, so that a line along an edge or through a corner is free and any other crossing is not.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from motm_twin.model.exact import angle_of
from motm_twin.model.geometry import Array
from motm_twin.model.motion import kernel
from motm_twin.planning.kernels import length_of
from motm_twin.planning.outlines import SHRINK, Rings, grown_outlines, rings_of

IntArray = NDArray[np.int32]
FAR = 1e9  # [m], and [s] where there is no path
TOUCH = 1e-9  # [m^2] cross products smaller than this count as collinear


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
    """Test that the open segment a-b crosses no ring."""
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
    """Test that a point is in the area of the rings (even-odd rule, so holes are outside)."""
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
    """Nearest point outside all grown polygons, and the distance [m] to it: 0 for a point that is outside.

    A way out that would lead through a solid is taken only when there is no other. If no side of a polygon has a
    point outside behind it, the point itself is returned with a distance of inf.
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
                ux, uy = (nx - px) / max(distance, 1e-9), (ny - py) / max(distance, 1e-9)
                if distance < 1e-9 and squared > 0.0:  # on the side itself: straight out
                    ux, uy = fy / math.sqrt(squared), -fx / math.sqrt(squared)
                ox, oy = nx + SHRINK * ux, ny + SHRINK * uy
                if not inside(ox, oy, outline):  # two polygons may be less than `SHRINK` apart
                    qx, qy, nearest = ox, oy, distance
        if nearest < math.inf:
            break
    return qx, qy, nearest


@kernel
def tangential(v: int, dx: float, dy: float, vertex: Array) -> bool:
    """Test that a line of direction (dx, dy) through vertex v leaves both its neighbours on one side."""
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


@kernel
def _fill_edges(
    vertex: Array, free: NDArray[np.bool_], start: IntArray, ends: IntArray, line: Array, in_edge: IntArray
) -> None:
    """List the edges between vertices that see each other: both vertices and the vector, sorted by first, then second.

    Visibility is mutual: as many edges arrive at a vertex as leave it. The arriving ones are listed by number.
    """
    count = 0
    for u in range(vertex.shape[0]):
        start[u] = count
        for v in range(vertex.shape[0]):
            if free[u, v]:
                ends[count, 0], ends[count, 1] = u, v
                line[count, 0], line[count, 1] = vertex[v, 0] - vertex[u, 0], vertex[v, 1] - vertex[u, 1]
                count += 1
    start[vertex.shape[0]] = count
    count = 0
    for v in range(vertex.shape[0]):
        for e in range(start[v], start[v + 1]):
            u = ends[e, 1]
            back = start[u]
            while ends[back, 1] != v:
                back += 1
            in_edge[count] = back
            count += 1


def build_graph(
    polygons: tuple[Array, ...], g: float, bounds: tuple[float, float, float, float] = (-FAR, -FAR, FAR, FAR)
) -> Graph:
    """The visibility graph of obstacle polygons, each (n, 2) [m], grown by g [m].

    Corners outside the bounds (x_min, y_min, x_max, y_max) are left out, so that no path leaves the map.
    """
    outline, walls, vertex = grown_outlines(polygons, g, bounds)
    free = np.zeros((len(vertex), len(vertex)), dtype=bool)
    _see_each_other(vertex, walls, free)
    edges = np.count_nonzero(free)
    start, in_edge = np.empty(len(vertex) + 1, np.int32), np.empty(edges, np.int32)
    ends, line = np.empty((edges, 2), np.int32), np.empty((edges, 2))
    _fill_edges(vertex, free, start, ends, line, in_edge)
    return Graph(
        vertex=vertex,
        outline=outline,
        walls=walls,
        solids=rings_of(polygons),
        out_start=start,
        ends=ends,
        edge=np.column_stack((np.hypot(line[:, 0], line[:, 1]), angle_of(line[:, 1], line[:, 0]))),
        in_start=start,
        in_edge=in_edge,
    )
