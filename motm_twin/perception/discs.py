"""Discs fitted to lidar points, and the far sides of discs, which the lidar does not see."""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from motm_twin.model.compiler import njit
from motm_twin.model.exact import angle_of
from motm_twin.model.geometry import Array
from motm_twin.perception.world_map import NO_POINTS

FAR_SIDE = np.linspace(-0.5, 0.5, 9) * math.pi  # [rad] bearings of its points from straight behind

Disc = tuple[float, float, float]  # centre x, y and radius [m]


@njit(cache=True)
def owners(points: Array, circles: Array, rim: float) -> NDArray[np.int64]:
    """Index of the circle (k, 3) whose rim is nearest to each point (n, 2), within ``rim`` [m]; -1: none; (n,)."""
    owner = np.full(points.shape[0], -1)
    for i in range(points.shape[0]):
        least = rim
        for k in range(circles.shape[0]):
            away = math.hypot(points[i, 0] - circles[k, 0], points[i, 1] - circles[k, 1]) - circles[k, 2]
            if abs(away) < least:
                least, owner[i] = abs(away), k
    return owner


@njit(cache=True)
def on_ways(points: Array, discs: Array, trail: float, edge: float) -> NDArray[np.bool_]:
    """Mask of points (n, 2) within ``edge`` [m] of discs (k, 5), or of their paths in the last ``trail`` [s]; (n,)."""
    found = np.zeros(points.shape[0], np.bool_)
    for k in range(discs.shape[0]):
        way_x, way_y = trail * discs[k, 2], trail * discs[k, 3]
        length, reach = max(way_x * way_x + way_y * way_y, 1e-9), discs[k, 4] + edge
        for i in range(points.shape[0]):
            x, y = points[i, 0] - discs[k, 0] + way_x, points[i, 1] - discs[k, 1] + way_y
            along = min(max((x * way_x + y * way_y) / length, 0.0), 1.0)
            x, y = x - along * way_x, y - along * way_y
            found[i] = found[i] or x * x + y * y <= reach * reach
    return found


@njit(cache=True)
def fitted_circle(points: Array, start: Array, radius: float) -> Array:
    """Centre (2,) of the circle of this radius [m] through the points (n, 2), by Gauss-Newton from a start (2,).

    In a direction that the points do not determine, along the arc, it stays at the start.
    """
    x, y = start[0], start[1]
    stay = 0.1 * points.shape[0]
    for _ in range(6):
        a, b, c, d, e = stay, 0.0, stay, stay * (x - start[0]), stay * (y - start[1])
        for i in range(points.shape[0]):
            dx, dy = x - points[i, 0], y - points[i, 1]
            away = max(math.hypot(dx, dy), 1e-6)
            dx, dy, off = dx / away, dy / away, away - radius
            a, b, c, d, e = a + dx * dx, b + dx * dy, c + dy * dy, d + dx * off, e + dy * off
        determinant = a * c - b * b
        x -= (c * d - b * e) / determinant
        y -= (a * e - b * d) / determinant
    return np.array([x, y])


@njit(cache=True)
def seen_width(points: Array, sensor: Array) -> float:
    """Half the width [m] of points (n, 2) across the line of sight."""
    x, y = 0.0, 0.0
    for i in range(points.shape[0]):
        x, y = x + points[i, 0] - sensor[0], y + points[i, 1] - sensor[1]
    away = max(math.hypot(x, y), 1e-9)
    x, y = x / away, y / away
    least, most = math.inf, -math.inf
    for i in range(points.shape[0]):
        across = (points[i, 1] - sensor[1]) * x - (points[i, 0] - sensor[0]) * y
        least, most = min(least, across), max(most, across)
    return 0.5 * (most - least)


@njit(cache=True)
def front_circle(points: Array, sensor: Array, radius: float) -> Array:
    """Centre (2,) of the circle of this radius [m] with the points (n, 2) on its side towards the sensor."""
    x, y, nearest = 0.0, 0.0, math.inf
    for i in range(points.shape[0]):
        x, y = x + points[i, 0] - sensor[0], y + points[i, 1] - sensor[1]
    away = max(math.hypot(x, y), 1e-9)
    ahead = np.array([x / away, y / away])
    for i in range(points.shape[0]):
        nearest = min(nearest, (points[i, 0] - sensor[0]) * ahead[0] + (points[i, 1] - sensor[1]) * ahead[1])
    return fitted_circle(points, sensor + (nearest + radius) * ahead, radius)


@njit(cache=True)
def is_behind(points: Array, middle: Array, sensor: Array, radius: float) -> bool:
    """True when the sensor is outside a fitted circle, and the points (n, 2) are on the far side, which it cannot see.

    This happens after an obstacle was at the sensor's own position: the fit is on the wrong side of the points.
    """
    dx, dy = middle[0] - sensor[0], middle[1] - sensor[1]
    away, total = math.hypot(dx, dy), 0.0
    for i in range(points.shape[0]):
        total += (points[i, 0] - middle[0]) * dx + (points[i, 1] - middle[1]) * dy
    return away > radius and total > 0.0


def behind(discs: Sequence[Disc], viewpoint: Array) -> Array:
    """Points on the halves of discs that face away from the viewpoint (2,) [m], shape (n, 2) [m]."""
    if not discs:
        return NO_POINTS
    x, y = viewpoint.tolist()
    disc = np.array(discs)
    away = np.array([math.atan2(middle_y - y, middle_x - x) for middle_x, middle_y, _ in discs])
    angle = away[:, None] + FAR_SIDE
    points = np.empty((len(disc), len(FAR_SIDE), 2))
    points[..., 0] = disc[:, :1] + disc[:, 2:] * np.cos(angle)
    points[..., 1] = disc[:, 1:2] + disc[:, 2:] * np.sin(angle)
    return points.reshape(-1, 2)


def at_ends(cluster: Array, radius: float, viewpoint: Array) -> list[Disc]:
    """Discs at the two ends of a wide cluster (n, 2) [m], inside it and tangent to the lines of sight to its ends."""
    sight = cluster - viewpoint
    mean = sight.mean(axis=0)
    across = mean[0] * sight[:, 1] - mean[1] * sight[:, 0]
    bearing = angle_of(across, sight[:, 0] * mean[0] + sight[:, 1] * mean[1])
    found = []
    for end, inwards in ((int(np.argmin(bearing)), 1.0), (int(np.argmax(bearing)), -1.0)):
        x, y = (inwards * sight[end] / max(math.hypot(*sight[end]), 1e-9)).tolist()
        end_x, end_y = cluster[end].tolist()
        found.append((end_x + radius * -y, end_y + radius * x, radius))
    return found
