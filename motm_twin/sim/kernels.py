"""Compiled geometry of sensors and bodies: distances, gaps, rays and lines of sight among prisms and discs."""

import math

import numpy as np
from numpy.typing import NDArray

from motm_twin.model.compiler import njit
from motm_twin.model.exact import dot, norm
from motm_twin.model.geometry import Array

Index = NDArray[np.int64]


@njit(cache=True)
def polygon_distance(x: float, y: float, corners: Array, begin: int, end: int) -> float:
    """Distance [m] from a point to a convex counter-clockwise polygon; 0 inside."""
    inside = True
    best = np.inf
    for i in range(begin, end):
        j = i + 1 if i + 1 < end else begin
        ax, ay = corners[i, 0], corners[i, 1]
        ex, ey = corners[j, 0] - ax, corners[j, 1] - ay
        px, py = x - ax, y - ay
        if ex * py - ey * px < 0.0:
            inside = False
        length2 = ex * ex + ey * ey
        t = 0.0 if length2 == 0.0 else min(1.0, max(0.0, (px * ex + py * ey) / length2))
        dx, dy = px - t * ex, py - t * ey
        best = min(best, dx * dx + dy * dy)
    return 0.0 if inside else math.sqrt(best)


@njit(cache=True)
def put_rectangle(corners: Array, first: int, x: float, y: float, heading: float, length: float, width: float) -> None:
    """Write the corners [m] of a rectangle about (x, y), counter-clockwise, to ``corners[first : first + 4]``."""
    c, s = math.cos(heading), math.sin(heading)
    for i in range(4):
        along = 0.5 * length if i in (1, 2) else -0.5 * length
        across = 0.5 * width if i >= 2 else -0.5 * width
        corners[first + i, 0] = x + c * along - s * across
        corners[first + i, 1] = y + s * along + c * across


@njit(cache=True)
def clearance(x: float, y: float, corners: Array, first: Index, discs: Array) -> float:
    """Plane distance [m] from a point to the nearest polygon or disc, whatever their heights; 0 inside, inf if none."""
    best = np.inf
    for i in range(first.shape[0] - 1):
        best = min(best, polygon_distance(x, y, corners, first[i], first[i + 1]))
    for i in range(discs.shape[0]):
        best = min(best, max(0.0, math.hypot(x - discs[i, 0], y - discs[i, 1]) - discs[i, 2]))
    return best


@njit(cache=True)
def cast_rays(origin: Array, angle: float, step: float, n: int, segments: Array, discs: Array, reach: float) -> Array:
    """Ranges [m] of n rays from origin at ``angle + i * step``; inf beyond reach; shape (n,)."""
    ranges = np.empty(n)
    ox, oy = origin[0], origin[1]
    edges = np.empty((segments.shape[0], 5))  # start relative to the origin, vector to the end, and their cross product
    for k in range(segments.shape[0]):
        ax, ay = segments[k, 0] - ox, segments[k, 1] - oy
        ex, ey = segments[k, 2] - segments[k, 0], segments[k, 3] - segments[k, 1]
        edges[k, 0], edges[k, 1], edges[k, 2], edges[k, 3], edges[k, 4] = ax, ay, ex, ey, ex * ay - ey * ax
    for i in range(n):
        dx, dy = math.cos(angle + i * step), math.sin(angle + i * step)
        best = np.inf
        for k in range(segments.shape[0]):
            det = edges[k, 2] * dy - edges[k, 3] * dx
            if det == 0.0:
                continue
            r = edges[k, 4] / det
            if 0.0 <= r < best and 0.0 <= (dx * edges[k, 1] - dy * edges[k, 0]) / det <= 1.0:
                best = r
        for k in range(discs.shape[0]):
            cx, cy = discs[k, 0] - ox, discs[k, 1] - oy
            along = cx * dx + cy * dy
            root = discs[k, 2] * discs[k, 2] - (cx * cx + cy * cy - along * along)
            if root < 0.0:
                continue
            near = along - math.sqrt(root)
            if near < 0.0:
                near = along + math.sqrt(root)
            if 0.0 <= near < best:
                best = near
        ranges[i] = best if best <= reach else np.inf
    return ranges


@njit(cache=True)
def _segments_cross(a: Array, b: Array, corners: Array, begin: int, end: int) -> bool:
    """True when the plane segment a-b touches a convex polygon (Cyrus-Beck)."""
    enter, leave = 0.0, 1.0
    dx, dy = b[0] - a[0], b[1] - a[1]
    for i in range(begin, end):
        j = i + 1 if i + 1 < end else begin
        ex, ey = corners[j, 0] - corners[i, 0], corners[j, 1] - corners[i, 1]
        side = ex * (a[1] - corners[i, 1]) - ey * (a[0] - corners[i, 0])
        change = ex * dy - ey * dx
        if change == 0.0:
            if side < 0.0:
                return False
        elif change > 0.0:
            enter = max(enter, -side / change)
        else:
            leave = min(leave, -side / change)
        if enter > leave:
            return False
    return True


@njit(cache=True)
def _clip_heights(a: Array, b: Array, low: float, high: float) -> tuple[float, float]:
    """Part of the segment a-b between two heights as parameters; first > second when there is none."""
    dz = b[2] - a[2]
    if dz == 0.0:
        return (0.0, 1.0) if low <= a[2] <= high else (1.0, 0.0)
    t0, t1 = (low - a[2]) / dz, (high - a[2]) / dz
    return max(0.0, min(t0, t1)), min(1.0, max(t0, t1))


@njit(cache=True)
def sight_blocked(a: Array, b: Array, corners: Array, first: Index, z: Array, discs: Array, disc_z: Array) -> bool:
    """True when a prism or cylinder stands between the points a and b, shapes (3,)."""
    for i in range(first.shape[0] - 1):
        t0, t1 = _clip_heights(a, b, z[i, 0], z[i, 1])
        if t0 <= t1 and _segments_cross(a + t0 * (b - a), a + t1 * (b - a), corners, first[i], first[i + 1]):
            return True
    for i in range(discs.shape[0]):
        t0, t1 = _clip_heights(a, b, disc_z[i, 0], disc_z[i, 1])
        if t0 > t1:
            continue
        px, py = a[0] + t0 * (b[0] - a[0]) - discs[i, 0], a[1] + t0 * (b[1] - a[1]) - discs[i, 1]
        dx, dy = (t1 - t0) * (b[0] - a[0]), (t1 - t0) * (b[1] - a[1])
        length2 = dx * dx + dy * dy
        t = 0.0 if length2 == 0.0 else min(1.0, max(0.0, -(px * dx + py * dy) / length2))
        if math.hypot(px + t * dx, py + t * dy) <= discs[i, 2]:
            return True
    return False


@njit(cache=True)
def segment_distance(a: Array, b: Array, c: Array, d: Array) -> float:
    """Distance [m] between the segments a-b and c-d in space, shapes (3,)."""
    u, v, w = b - a, d - c, a - c
    uu, uv, vv = dot(u, u), dot(u, v), dot(v, v)
    uw, vw = dot(u, w), dot(v, w)
    best = np.inf
    det = uu * vv - uv * uv
    if det > 1e-12 * uu * vv:
        s, t = (uv * vw - vv * uw) / det, (uu * vw - uv * uw) / det
        if 0.0 <= s <= 1.0 and 0.0 <= t <= 1.0:
            best = norm(w + s * u - t * v)
    for k in range(2):
        end = w if k == 0 else w + u
        t = 0.0 if vv == 0.0 else min(1.0, max(0.0, dot(v, end) / vv))
        best = min(best, norm(end - t * v))
        end = -w if k == 0 else v - w
        s = 0.0 if uu == 0.0 else min(1.0, max(0.0, dot(u, end) / uu))
        best = min(best, norm(end - s * u))
    return best


_GRAZE = 1e-9  # [m] overlap due to rounding


@njit(cache=True)
def _between(a: Array, b: Array) -> float:
    """Largest gap [m] along an edge normal of convex polygon a; negative if they overlap along all normals."""
    best = -np.inf
    for i in range(a.shape[0]):
        j = (i + 1) % a.shape[0]
        nx, ny = a[j, 1] - a[i, 1], a[i, 0] - a[j, 0]
        length = math.hypot(nx, ny)
        if length == 0.0:
            continue
        nearest = np.inf
        for k in range(b.shape[0]):
            nearest = min(nearest, ((b[k, 0] - a[i, 0]) * nx + (b[k, 1] - a[i, 1]) * ny) / length)
        best = max(best, nearest)
    return best


@njit(cache=True)
def gaps(body: Array, radius: float, corners: Array, first: Index, discs: Array) -> Array:
    """Gap [m] between a body and each polygon, then each disc; negative where they overlap, shape (p + d,).

    The body is a convex counter-clockwise polygon (k, 2), or with one corner a disc of ``radius`` [m] about it. A
    positive gap between two polygons may be less than their distance.
    """
    polygons = first.shape[0] - 1
    found = np.empty(polygons + discs.shape[0])
    for i in range(polygons):
        if body.shape[0] == 1:
            found[i] = polygon_distance(body[0, 0], body[0, 1], corners, first[i], first[i + 1]) - radius
        else:
            other = corners[first[i] : first[i + 1]]
            found[i] = max(_between(body, other), _between(other, body))
    for k in range(discs.shape[0]):
        if body.shape[0] == 1:
            away = math.hypot(body[0, 0] - discs[k, 0], body[0, 1] - discs[k, 1]) - radius
        else:
            away = polygon_distance(discs[k, 0], discs[k, 1], body, 0, body.shape[0])
        found[polygons + k] = away - discs[k, 2]
    return found


def entered(before: Array, after: Array) -> NDArray[np.int64]:
    """Indices of obstacles that a body overlaps after a motion, and overlapped less or not before; shape (k,)."""
    return np.flatnonzero((after < -_GRAZE) & (after < before - _GRAZE))


def compile_gaps() -> None:
    """Compile `gaps` at start-up instead of at the first throw."""
    square = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    gaps(square, 0.0, square, np.array([0, 4], dtype=np.int64), np.zeros((1, 3)))
