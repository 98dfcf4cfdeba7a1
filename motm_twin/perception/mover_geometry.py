"""Cells and points round what moves: which are beside, behind or before others."""

import math

import numpy as np
from numpy.typing import NDArray

from motm_twin.model.geometry import Array
from motm_twin.perception.base_map import read_only
from motm_twin.perception.world_map import WorldMap

ROWS_APART = 1 << 32  # between the numbers of two cells in the same column
_NEXT = np.arange(-1, 2)
AROUND = (ROWS_APART * _NEXT[:, None] + _NEXT).ravel()  # added to a cell: it and its neighbours
FAR_SIDE = np.linspace(-0.5, 0.5, 9) * math.pi  # [rad] from straight behind
HIDES = 0.5  # [m] behind something, up to which static cells are those that it was seen in before
WIDTH = 0.12  # [m] of what hides the place that it was in: less is an edge
SAME_POINT = 0.08  # [m] between the middles of cells that may show the same point


def cells_of(world: WorldMap) -> NDArray[np.int64]:
    """One number per cell of the seen points, the same in every map."""
    column, row = np.floor(world.seen_points.T / world.resolution).astype(np.int64)
    return row * ROWS_APART + column


def latest(
    cells: list[NDArray[np.int64]], until: list[NDArray[np.float64]], now: float
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Each of these cells once, with its latest time [s], without those that are over."""
    each, times = np.concatenate(cells), np.concatenate(until)
    order = np.lexsort((times, each))  # of each cell the last entry is the latest
    last = np.append(each[order][1:] != each[order][:-1], True) if len(order) else np.zeros(0, dtype=bool)
    kept = order[last]
    kept = kept[times[kept] > now]
    return read_only(each[kept]), read_only(times[kept])


def within(cells: NDArray[np.int64], reach: int) -> NDArray[np.int64]:
    """These cells and all up to so many cells away, some more than once."""
    offset = np.arange(-reach, reach + 1)
    return (cells[:, None] + (ROWS_APART * offset[:, None] + offset).ravel()).ravel()


def around(cells: NDArray[np.int64]) -> NDArray[np.int64]:
    """These cells and all beside them, some more than once."""
    return (cells[:, None] + AROUND).ravel()


def front(cluster: Array, viewpoint: Array, resolution: float) -> tuple[Array, float]:
    """Middle and radius of something round of which the front is seen."""
    ahead = cluster.mean(axis=0) - viewpoint
    ahead = ahead / max(math.hypot(*ahead), 1e-9)
    across = (cluster - viewpoint) @ np.array([-ahead[1], ahead[0]])
    radius = 0.5 * (float(across.max() - across.min()) + resolution)
    depth = float(((cluster - viewpoint) @ ahead).min()) - 0.5 * resolution + radius
    side = 0.5 * float(across.max() + across.min())
    return viewpoint + depth * ahead + side * np.array([-ahead[1], ahead[0]]), radius


def far_side(middle: Array, radius: float, viewpoint: Array) -> Array:
    """Points of the half of a disc that is turned away from the viewpoint [m], shape (n, 2)."""
    away = middle - viewpoint
    angle = math.atan2(away[1], away[0]) + FAR_SIDE
    return middle + radius * np.column_stack((np.cos(angle), np.sin(angle)))


def hides(own: Array, static: Array, viewpoint: Array) -> bool:
    """Whether these points (k, 2) [m] hide some of those (n, 2): more than a cell behind, and over a width.

    At its edge, where it is seen along its surface, a thing hides itself; but that is narrow.
    """
    away = own - viewpoint
    distance = np.maximum(np.hypot(*away.T), SAME_POINT)
    sight = away / distance[:, None]
    apart = static[None] - own[:, None]
    ahead = apart[..., 0] * sight[:, None, 0] + apart[..., 1] * sight[:, None, 1]
    across = apart[..., 0] * sight[:, None, 1] - apart[..., 1] * sight[:, None, 0]
    hiding = ((ahead > SAME_POINT) & (ahead < HIDES) & (np.abs(across) <= 0.5 * SAME_POINT)).any(axis=1)
    if not hiding.any():
        return False
    middle = sight.mean(axis=0)
    side = away[hiding] @ np.array([-middle[1], middle[0]])
    return bool(side.max() - side.min() >= WIDTH)


def share_gone(before: Array, seen: Array, own: Array, viewpoint: Array) -> float:
    """Share of these points (m, 2) [m] near which nothing is seen now (n, 2), or that are behind its own (k, 2)."""
    near = np.hypot(*(before[:, None] - seen[None]).transpose(2, 0, 1)) <= SAME_POINT
    sight = before - viewpoint
    sight = sight / np.maximum(np.hypot(*sight.T), SAME_POINT)[:, None]
    apart = before[:, None] - own[None]
    ahead = apart[..., 0] * sight[:, None, 0] + apart[..., 1] * sight[:, None, 1]
    across = apart[..., 0] * sight[:, None, 1] - apart[..., 1] * sight[:, None, 0]
    behind = (ahead > SAME_POINT) & (np.abs(across) <= 0.5 * SAME_POINT)
    return float(np.mean(~near.any(axis=1) | behind.any(axis=1)))
