"""The footprint in the distance field: clearance of the base body, as circles that cover its rectangle."""

import functools
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from motm_twin.model.geometry import Array
from motm_twin.model.motion import kernel
from motm_twin.model.profile import Footprint
from motm_twin.perception.world_map import WorldMap

# Largest slope of the interpolated distance of a field along a line, and the rounding error on top of it [m].
SLOPE, ROUNDING = 1.4143, 1e-4
# [m] Largest cell. Between points d apart the interpolated distance changes by sqrt(d^2 + cell^2) at most: the mean
# distance of two points, each drawn from the corners of its cell with the weights of the interpolation, is not more.
COARSEST = 0.1
# [m] Most by which the circles of a footprint fall short of its sides; beside a corner it is a quarter of their radius.
DENT = 0.02
LARGEST = 0.125  # [m] largest radius of the smaller circles, which Frankie has; larger bases have more circles
BORDER = 0.1  # [m] a lower bound below this excludes no circle: at the border of the map the distance jumps


class Field(NamedTuple):
    """A distance field: values at cell centres [m] (ny, nx), corner of cell (0, 0) [m], cell size [m]."""

    value: NDArray[np.float32]
    x: float
    y: float
    inverse_cell: float


class Body(NamedTuple):
    """Footprint: covering circles (m, 4) x, y, radius in the base frame and reach; corners (4, 2); centre; radii [m].

    The clearance of a circle is at least the distance at the body's centre less the circle's reach.
    """

    circle: Array
    corner: Array
    centre_x: float
    outer: float  # circumscribed
    inner: float  # inscribed
    slack: float  # largest reach of a circle less `outer`
    reach: float  # furthest point from the base frame
    length: float  # along the heading


def field_of(world: WorldMap) -> Field:
    """The map's distance field with the border of the map as an obstacle, as a writable copy."""
    if world.resolution > COARSEST:
        raise ValueError(f"a map with cells of {world.resolution} m: planning needs {COARSEST} m or less")
    value = np.minimum(world.distance, _to_border(*world.distance.shape, world.resolution))
    return Field(value, float(world.origin[0]), float(world.origin[1]), 1.0 / world.resolution)


@functools.lru_cache(maxsize=2)
def _to_border(rows: int, columns: int, resolution: float) -> NDArray[np.float32]:
    """Distance [m] of the centre of each cell to the border of a map, shape (rows, columns)."""
    across = np.minimum(np.arange(columns), np.arange(columns)[::-1])
    along = np.minimum(np.arange(rows), np.arange(rows)[::-1])
    distance = (np.minimum(across, along[:, None]) + 0.5) * resolution
    return distance.astype(np.float32)


def body_of(footprint: Footprint) -> Body:
    """Covering circles of a rectangle: exact at the corners, at most `DENT` short of the sides between circles."""
    half_l, half_w = footprint.length / 2, footprint.width / 2
    half_l, half_w, upright = (half_l, half_w, False) if half_l >= half_w else (half_w, half_l, True)
    r = min(half_w / 2, LARGEST)
    apart = 2.0 * math.sqrt(2.0 * r * DENT - DENT * DENT) if r > DENT else r
    along = np.linspace(-(half_l - r), half_l - r, 1 + math.ceil(2 * (half_l - r) / min(0.95 * r, apart)))
    across = np.linspace(-(half_w - r), half_w - r, 1 + math.ceil(2 * (half_w - r) / min(r, apart)))
    inside = range(2, len(across) - 2) if r < half_w / 2 else ()
    circles = [(x, y, r) for x in along for y in across[[0, *inside, -1]].tolist()]
    circles += [(end * (half_l - r), y, r) for end in (-1, 1) for y in across[1:-1].tolist()]
    circles += [(x, 0.0, half_w) for x in {-(half_l - half_w), 0.0, half_l - half_w}]
    circles += [(end * half_l, side * half_w, 0.0) for end in (-1, 1) for side in (-1, 1)]
    table = np.array(sorted(circles))
    if upright:
        table[:, [0, 1]] = table[:, [1, 0]]
    reach = np.sqrt(table[:, 0] ** 2 + table[:, 1] ** 2 + COARSEST**2) + table[:, 2] + ROUNDING
    table = np.column_stack((table, reach))[np.argsort(-reach, kind="stable")]
    table[:, 0] += footprint.offset_x
    corner = np.array([(x, y) for x in (-1, 1) for y in (-1, 1)]) * (footprint.length / 2, footprint.width / 2)
    corner[:, 0] += footprint.offset_x
    outer = math.hypot(half_l, half_w)
    slack = float(reach.max()) - outer
    return Body(table, corner, footprint.offset_x, outer, half_w, slack, footprint.outer, footprint.length)


@kernel
def distance_at(px: float, py: float, field: Field) -> float:
    """Distance [m] at a point, bilinear; -1 outside the map."""
    u = (px - field.x) * field.inverse_cell - 0.5
    v = (py - field.y) * field.inverse_cell - 0.5
    ny, nx = field.value.shape
    if u < -0.5 or v < -0.5 or u >= nx - 0.5 or v >= ny - 0.5:
        return -1.0
    i, j = int(math.floor(u)), int(math.floor(v))
    i, j = min(max(i, 0), nx - 2), min(max(j, 0), ny - 2)
    s, t = u - i, v - j
    low = field.value[j, i] * (1.0 - s) + field.value[j, i + 1] * s
    high = field.value[j + 1, i] * (1.0 - s) + field.value[j + 1, i + 1] * s
    return low * (1.0 - t) + high * t


@kernel
def clearance(px: float, py: float, heading: float, enough: float, field: Field, body: Body) -> float:
    """Clearance [m] of the footprint at a pose, not more than `enough`; negative: that deep in an obstacle."""
    return clearance_from(px, py, math.cos(heading), math.sin(heading), enough, -math.inf, field, body)


@kernel
def clearance_from(
    px: float, py: float, c: float, s: float, enough: float, too_little: float, field: Field, body: Body
) -> float:
    """`clearance` for a heading whose cosine c and sine s are known; any number below `too_little` if it is below.

    A circle that cannot be nearer to an obstacle than the nearest so far is skipped.
    """
    middle = distance_at(px + c * body.centre_x, py + s * body.centre_x, field)
    if middle - body.outer >= enough:
        return enough
    least = min(enough, middle - body.inner)
    for i in range(body.circle.shape[0]):
        if least < too_little:
            return least
        if middle - body.circle[i, 3] >= max(least, BORDER):
            continue
        x, y, r = body.circle[i, 0], body.circle[i, 1], body.circle[i, 2]
        least = min(least, distance_at(px + c * x - s * y, py + s * x + c * y, field) - r)
    return least


@kernel
def _clearances(poses: Array, enough: float, field: Field, body: Body, result: Array) -> None:
    for i in range(poses.shape[0]):
        result[i] = clearance(poses[i, 0], poses[i, 1], poses[i, 2], enough, field, body)


def clearances(poses: Array, enough: float, field: Field, body: Body) -> Array:
    """`clearance` of poses, shape (n, 3) -> (n,)."""
    result = np.empty(len(poses))
    _clearances(np.ascontiguousarray(poses), enough, field, body, result)
    return result
