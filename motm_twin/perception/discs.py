"""Discs of things that stand apart, from the front that the lidar sees of each.

The lidar sees the front of a thing that is about as deep as it is wide. Its middle is therefore half its width behind
the nearest point: it stays the same point of the thing while robot and thing pass each other.
"""

import math
from collections.abc import Sequence

import numpy as np

from motm_twin.model.compiler import njit
from motm_twin.model.exact import angle_of
from motm_twin.model.geometry import Array
from motm_twin.perception.clusters import label_cells
from motm_twin.perception.world_map import NO_POINTS

FAR_SIDE = np.linspace(-0.5, 0.5, 9) * math.pi  # [rad] from straight behind
SAME_POINT = 0.08  # [m] between the middles of cells that may show the same point

Disc = tuple[float, float, float]  # middle x, y and radius [m]


@njit(cache=True)
def apart(cells, recent, reach, smallest):
    """Clusters of at least ``smallest`` cells (row, column), shape (m, 2), and the front of each, as cell indices.

    Cells at most ``reach`` apart in row and column belong together; the front are the ``recent`` (m,) ones, or all
    when these are too few. Returns the members of all clusters and where each ends, (c,), and the same of the fronts.
    """
    label, count = label_cells(cells, reach)
    size, lately = np.zeros(count, np.int64), np.zeros(count, np.int64)
    for i in range(label.shape[0]):
        size[label[i]] += 1
        lately[label[i]] += recent[i]
    first, first_front = np.full(count, -1), np.full(count, -1)  # where its next member goes
    ends, front_ends = np.empty(count, np.int64), np.empty(count, np.int64)
    found, total, total_front = 0, 0, 0
    for k in range(count):
        if size[k] >= smallest:
            first[k], first_front[k] = total, total_front
            total += size[k]
            total_front += lately[k] if lately[k] >= smallest else size[k]
            ends[found], front_ends[found] = total, total_front
            found += 1
    members, front = np.empty(total, np.int64), np.empty(total_front, np.int64)
    for i in range(label.shape[0]):
        k = label[i]
        if first[k] < 0:
            continue
        members[first[k]] = i
        first[k] += 1
        if recent[i] or lately[k] < smallest:
            front[first_front[k]] = i
            first_front[k] += 1
    return members, ends[:found].copy(), front, front_ends[:found].copy()


@njit(cache=True)
def _mean(points):
    """Of points (n, 2)."""
    x, y = 0.0, 0.0
    for i in range(points.shape[0]):
        x += points[i, 0]
        y += points[i, 1]
    return x / points.shape[0], y / points.shape[0]


@njit(cache=True)
def _extent(values):
    """Least and largest of (n,)."""
    least, most = math.inf, -math.inf
    for value in values:
        least, most = min(least, value), max(most, value)
    return least, most


def disc_from_front(points: Array, viewpoint: Array, resolution: float) -> tuple[Array, float]:
    """Centre (2,) and radius [m] of a round obstacle whose visible front consists of points (n, 2) [m]."""
    (x, y), (mean_x, mean_y) = viewpoint.tolist(), _mean(points)
    ahead_x, ahead_y = mean_x - x, mean_y - y
    length = max(math.hypot(ahead_x, ahead_y), 1e-9)
    ahead_x, ahead_y = ahead_x / length, ahead_y / length
    sight = points - viewpoint
    right, left = _extent(sight[:, 1] * ahead_x - sight[:, 0] * ahead_y)
    nearest, _ = _extent(sight[:, 0] * ahead_x + sight[:, 1] * ahead_y)
    radius = 0.5 * (left - right + resolution)
    depth, side = nearest - 0.5 * resolution + radius, 0.5 * (left + right)
    return np.array([x + depth * ahead_x + side * -ahead_y, y + depth * ahead_y + side * ahead_x]), radius


def behind(discs: Sequence[Disc], viewpoint: Array) -> Array:
    """Points of the halves of discs that are turned away from the viewpoint (2,) [m], shape (n, 2) [m]."""
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
    """Discs that begin at the two ends of something wide (n, 2) [m], of which the lines of sight are tangents."""
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


@njit(cache=True)
def share_gone(before, seen, own, view_x, view_y):
    """Share of these points (m, 2) [m] near which nothing is seen now (n, 2), or that are behind its own (k, 2).

    ``view_x``, ``view_y``: the viewpoint [m].
    """
    gone = 0
    for i in range(before.shape[0]):
        near = False
        for k in range(seen.shape[0]):
            near = near or math.hypot(before[i, 0] - seen[k, 0], before[i, 1] - seen[k, 1]) <= SAME_POINT
        sight_x, sight_y = before[i, 0] - view_x, before[i, 1] - view_y
        length = max(math.hypot(sight_x, sight_y), SAME_POINT)
        sight_x, sight_y = sight_x / length, sight_y / length
        hidden = False
        for k in range(own.shape[0]):
            x, y = before[i, 0] - own[k, 0], before[i, 1] - own[k, 1]
            ahead, across = x * sight_x + y * sight_y, x * sight_y - y * sight_x
            hidden = hidden or (ahead > SAME_POINT and abs(across) <= 0.5 * SAME_POINT)
        gone += not near or hidden
    return gone / before.shape[0]
