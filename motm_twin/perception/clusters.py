"""Outlines of seen obstacles: each cluster of cells becomes one convex polygon, or several where one blocks free space.

A hull is too coarse when, grown by g as in planning, it blocks a passage beside the cells, or when the base fits inside
it, as between the walls of a room. Such a cluster is split until it narrows passages by at most `NARROWED`. Testing
only the side in sight of the lidar was tried and rejected: posts that the robot had passed then blocked the way between
them, and it stood still.

The polygons feed the visibility graph only; collision is decided by the distance field, which keeps every cell.
"""

import math

import numpy as np

from motm_twin.model.compiler import njit
from motm_twin.model.geometry import Array
from motm_twin.model.profile import Footprint

MERGE_CELLS = 6  # 0.3 m: grazing beams leave such gaps on one face; where a base fits through, the cluster is split
NARROWED = 0.05  # [m] by which a hull may narrow a passage beside it
MARGIN = 0.08  # [m] beyond half the width of the base by which planning grows outlines
SAMPLING = 2.0  # cells between two sample points beside or inside a hull
MAX_CORNERS = 8
FLAT = 0.02  # [m] corners that stand out less than this are left out
STEADY = 0.075  # [m] an outline is kept while no corner of the new one is further than this from it (1.5 cells)


@njit(cache=True)
def label_cells(cells, reach):
    """Cluster number of every cell (row, column), shape (m,), and the number of clusters.

    Cells at most ``reach`` apart in row and column belong to one cluster.
    """
    label = np.full(cells.shape[0], -1, np.int32)
    if cells.shape[0] == 0:
        return label, 0
    low_row, low_column = cells[:, 0].min(), cells[:, 1].min()
    rows, columns = cells[:, 0].max() - low_row + 1, cells[:, 1].max() - low_column + 1
    index = np.full((rows, columns), -1, np.int32)
    for i in range(cells.shape[0]):
        index[cells[i, 0] - low_row, cells[i, 1] - low_column] = i
    stack = np.empty(cells.shape[0], np.int32)
    count = 0
    for first in range(cells.shape[0]):
        if label[first] >= 0:
            continue
        label[first] = count
        index[cells[first, 0] - low_row, cells[first, 1] - low_column] = -1
        stack[0] = first
        size = 1
        while size > 0:
            size -= 1
            row, column = cells[stack[size], 0] - low_row, cells[stack[size], 1] - low_column
            for r in range(max(0, row - reach), min(rows, row + reach + 1)):
                for c in range(max(0, column - reach), min(columns, column + reach + 1)):
                    other = index[r, c]
                    if other >= 0:
                        index[r, c] = -1
                        label[other] = count
                        stack[size] = other
                        size += 1
        count += 1
    return label, count


@njit(cache=True)
def hull_of_cells(cells):
    """Convex hull of the squares of cells sorted by row and column: corners (x, y) in cells, counter-clockwise."""
    count = cells.shape[0]
    points = np.empty((2 * (2 + 2 * count), 2), np.int64)  # only the outermost corners of each row matter
    n = 0
    i = 0
    while i < count:
        j = i
        while j + 1 < count and cells[j + 1, 0] == cells[i, 0]:
            j += 1
        for side in range(2):
            points[n, 0], points[n, 1] = cells[i, 1], cells[i, 0] + side
            points[n + 1, 0], points[n + 1, 1] = cells[j, 1] + 1, cells[i, 0] + side
            n += 2
        i = j + 1
    order = np.argsort(points[:n, 1] * 1_000_000 + points[:n, 0])
    hull = np.empty((n + 1, 2), np.int64)
    size = 0
    for turn in range(2):
        base = size + 1 if turn == 0 else size
        floor = 0 if turn == 0 else base
        for step in range(n):
            p = points[order[step if turn == 0 else n - 1 - step]]
            if turn == 1 and step == 0:
                continue
            while size - floor >= (2 if turn == 0 else 1):
                a, b = hull[size - 2], hull[size - 1]
                if (b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0]) > 0:
                    break
                size -= 1
            hull[size, 0], hull[size, 1] = p[0], p[1]
            size += 1
    return hull[: size - 1].astype(np.float64)


@njit(cache=True)
def drop_flat_corners(hull, flat, most):
    """Drop the flattest corners of a hull, until at most ``most`` are left, all higher than ``flat``; 4 always stay."""
    corners = hull.copy()
    n = corners.shape[0]
    while n > 4:
        best, least = -1, math.inf
        for i in range(n):
            a, b, c = corners[i - 1 if i > 0 else n - 1], corners[i], corners[i + 1 if i + 1 < n else 0]
            cross = abs((c[0] - a[0]) * (b[1] - a[1]) - (c[1] - a[1]) * (b[0] - a[0]))
            height = cross / math.hypot(c[0] - a[0], c[1] - a[1])
            if height < least:
                best, least = i, height
        if n <= most and least > flat:
            break
        for i in range(best, n - 1):
            corners[i, 0], corners[i, 1] = corners[i + 1, 0], corners[i + 1, 1]
        n -= 1
    return corners[:n].copy()


@njit(cache=True)
def area_of(corners):
    """Area of a polygon, positive when counter-clockwise; corners shape (n, 2)."""
    n = corners.shape[0]
    total = 0.0
    for i in range(n):
        j = i + 1 if i + 1 < n else 0
        total += corners[i, 0] * corners[j, 1] - corners[j, 0] * corners[i, 1]
    return 0.5 * total


@njit(cache=True)
def _by_label(labels, count):
    """Indices of cells sorted by label, in their order within a label, (m,), and the end of each label, (count,)."""
    ends = np.zeros(count, np.int64)
    for label in labels:
        ends[label] += 1
    ends = np.cumsum(ends)
    order, place = np.empty(labels.shape[0], np.int64), ends.copy()
    for i in range(labels.shape[0] - 1, -1, -1):
        place[labels[i]] -= 1
        order[place[labels[i]]] = i
    return order, ends


@njit(cache=True)
def _blocks_way(hull, cells, g, lost):
    """True when a point at distance g from the hull (n, 2) is beyond g + ``lost`` of every cell (m, 2); in cells."""
    far = (g + lost) ** 2
    for i in range(hull.shape[0]):
        j = i + 1 if i + 1 < hull.shape[0] else 0
        dx, dy = hull[j, 0] - hull[i, 0], hull[j, 1] - hull[i, 1]
        length = math.hypot(dx, dy)
        if math.hypot(g, 0.5 * length) <= g + lost:  # both ends are corners of cells
            continue
        steps = math.ceil(length / SAMPLING)
        for k in range(1, steps):
            x, y = hull[i, 0] + k / steps * dx + g * dy / length, hull[i, 1] + k / steps * dy - g * dx / length
            near = False
            for c in range(cells.shape[0]):
                away_x = max(0.0, cells[c, 1] - x, x - cells[c, 1] - 1)
                away_y = max(0.0, cells[c, 0] - y, y - cells[c, 0] - 1)
                if away_x * away_x + away_y * away_y <= far:
                    near = True
                    break
            if not near:
                return True
    return False


@njit(cache=True)
def _encloses(hull, cells, far):
    """True when a point inside the hull (n, 2) is farther than ``far`` from all cells (m, 2); all in cells."""
    low_x, high_x, low_y, high_y = hull[:, 0].min(), hull[:, 0].max(), hull[:, 1].min(), hull[:, 1].max()
    if min(high_x - low_x, high_y - low_y) <= 2.0 * far:
        return False
    across, up = math.ceil((high_x - low_x) / SAMPLING), math.ceil((high_y - low_y) / SAMPLING)
    for n in range(across * up):  # from the middle on: it is free in most hulls that enclose free space
        at = (n + across * up // 2 + across // 2) % (across * up)
        x, y = low_x + (at % across + 0.5) * SAMPLING, low_y + (at // across + 0.5) * SAMPLING
        within = True
        for i in range(hull.shape[0]):
            j = i + 1 if i + 1 < hull.shape[0] else 0
            if (hull[j, 0] - hull[i, 0]) * (y - hull[i, 1]) - (hull[j, 1] - hull[i, 1]) * (x - hull[i, 0]) < 0.0:
                within = False
                break
        for c in range(cells.shape[0] if within else 0):
            away_x = max(0.0, cells[c, 1] - x, x - cells[c, 1] - 1)
            away_y = max(0.0, cells[c, 0] - y, y - cells[c, 0] - 1)
            if away_x * away_x + away_y * away_y <= far * far:
                within = False
                break
        if within:
            return True
    return False


@njit(cache=True)
def _outline_of(cells, resolution, g, origin):
    """Convex outline [m], counter-clockwise, (n, 2), of cells sorted by row and column; n = 0 if it is too coarse."""
    hull = hull_of_cells(cells)
    if _blocks_way(hull, cells, g / resolution, NARROWED / resolution) or _encloses(
        hull, cells, (g + NARROWED) / resolution
    ):
        return hull[:0]
    corners = drop_flat_corners(hull, FLAT / resolution, MAX_CORNERS)
    for i in range(corners.shape[0]):
        corners[i, 0] = origin[0] + resolution * corners[i, 0]
        corners[i, 1] = origin[1] + resolution * corners[i, 1]
    return corners


def growth_of(footprint: Footprint) -> float:
    """g [m], the default growth of outlines in planning: half the width of the base, plus `MARGIN`."""
    return 0.5 * footprint.width + MARGIN


def seen_outlines(cells: np.ndarray, resolution: float, origin: Array, g: float) -> list[Array]:
    """Convex outlines [m], counter-clockwise, each shape (n, 2), of seen cells (row, col) sorted by row and column.

    ``g`` [m]: growth of outlines in planning.
    """
    order, ends = _by_label(*label_cells(cells, MERGE_CELLS))
    by_label, start = cells[order], 0
    outlines: list[Array] = []
    for end in ends.tolist():
        pending = [by_label[start:end]]
        while pending:
            part = pending.pop()
            outline = _outline_of(part, resolution, g, origin)
            if len(outline):
                outlines.append(outline)
            else:
                pending.extend(_halves(part))
        start = end
    return outlines


def _halves(cells: np.ndarray) -> list[np.ndarray]:
    """Split cells at their centre into two halves, along the direction in which they spread most."""
    offset = cells - cells.mean(axis=0)
    xx, xy, yy = (offset[:, 1] ** 2).mean(), (offset[:, 0] * offset[:, 1]).mean(), (offset[:, 0] ** 2).mean()
    angle = 0.5 * math.atan2(2.0 * xy, xx - yy)
    ahead = offset[:, 1] * math.cos(angle) + offset[:, 0] * math.sin(angle) > 0.0
    return [cells[~ahead], cells[ahead]]


def steadied(outlines: list[Array], before: tuple[Array, ...]) -> tuple[Array, ...]:
    """The new outlines, each replaced by one of the previous period that agrees with it within `STEADY` both ways."""
    kept: list[Array] = []
    for new in outlines:
        kept.append(next((old for old in before if outlines_agree(new, old, STEADY)), new))
    return tuple(kept)


@njit(cache=True)
def outlines_agree(one, two, tolerance):
    """Test that every corner of each convex outline is within the tolerance [m] of the other's border."""
    for turn in range(2):
        corners, border = (one, two) if turn == 0 else (two, one)
        n = border.shape[0]
        for i in range(corners.shape[0]):
            least = math.inf
            for j in range(n):
                k = j + 1 if j + 1 < n else 0
                ex, ey = border[k, 0] - border[j, 0], border[k, 1] - border[j, 1]
                px, py = corners[i, 0] - border[j, 0], corners[i, 1] - border[j, 1]
                t = min(1.0, max(0.0, (px * ex + py * ey) / (ex * ex + ey * ey)))
                dx, dy = px - t * ex, py - t * ey
                least = min(least, dx * dx + dy * dy)
            if least > tolerance * tolerance:
                return False
    return True


@njit(cache=True)
def touching(cells, anchors, others, reach):
    """Mask of cells that are connected to one of the ``anchors``, through ``others`` up to ``reach`` cells apart.

    ``cells``: row and column, shape (m, 2); ``anchors``, ``others`` and the result: masks, shape (m,) each.

    A cell is static once it was hit for 3 s without a break (Paper, Sec. V). A side that beams only graze may be hit
    for two seconds and then missed for one, when the pose is 2 cm off; a side that comes into sight is new. Neither
    moves: both belong to a static obstacle.
    """
    found = np.zeros(cells.shape[0], np.bool_)
    if not anchors.any() or not others.any():
        return found
    which = np.flatnonzero(anchors | others)
    label, count = label_cells(cells[which], reach)
    anchored = np.zeros(count, np.bool_)
    for i in range(which.shape[0]):
        if anchors[which[i]]:
            anchored[label[i]] = True
    for i in range(which.shape[0]):
        found[which[i]] = anchored[label[i]]
    return found
