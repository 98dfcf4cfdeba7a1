"""The pre-made map: furniture and bins known before the start. Rays never clear it: they pass under table tops."""

from weakref import WeakValueDictionary

import msgspec
import numpy as np
import shapely
from numpy.typing import NDArray

from motm_twin.model.geometry import Array
from motm_twin.model.known import KnownWorld, known_solids
from motm_twin.model.scene import Cylinder, Solid
from motm_twin.perception.footprints import distance_to_solids, merged_outlines, outline, signed_distance, uncovered
from motm_twin.perception.grid import WHOLE, Grid, grid_over

FAR = 3.0  # [m] cap of distances on a large map: planning asks for clearances of at most 1 m


class BaseMap(msgspec.Struct, frozen=True, kw_only=True, eq=False, weakref=True):
    """Mapped furniture on the grid; arrays are read-only."""

    grid: Grid
    occupied: NDArray[np.uint8]  # 1 where a mapped footprint covers part of the cell, shape (rows, columns)
    distance: NDArray[np.float32]  # [m] cell centre to the nearest mapped footprint, exact, negative inside
    visible_distance: NDArray[np.float32]  # [m] the same, to solids at the height of the lidar
    polygons: tuple[Array, ...]  # outlines, counter-clockwise, each shape (n, 2)
    extents: Array  # [m] of each polygon x_min, y_min, x_max, y_max, shape (polygons, 4)

    def polygons_within(self, low: Array, high: Array) -> tuple[Array, ...]:
        """Polygons whose extents overlap the rectangle with corners ``low`` and ``high``, shape (2,) [m]."""
        within = (self.extents[:, 2:] >= low).all(axis=1) & (self.extents[:, :2] <= high).all(axis=1)
        return tuple(self.polygons[k] for k in np.flatnonzero(within))


_in_use: WeakValueDictionary[bytes, BaseMap] = WeakValueDictionary()  # by their encoded inputs


def base_map(known: KnownWorld, resolution: float) -> BaseMap:
    """The pre-made map of the known world; resolution in [m]. Shared by equal requests, as it takes 20 ms or more."""
    robot = known.robot
    made_of = msgspec.msgpack.encode((known_solids(known), known.bounds, robot.top, robot.lidar.z, resolution))
    found = _in_use.get(made_of)
    if found is None:
        found = _in_use[made_of] = _build(known, resolution)
    return found


def _build(known: KnownWorld, resolution: float) -> BaseMap:
    grid = grid_over(known.bounds, resolution)
    solids = tuple(solid for solid in known_solids(known) if solid.z_min < known.robot.top)
    furniture = tuple(solid for solid in known.solids if solid.z_min < known.robot.top)
    polygons = merged_outlines((*furniture, *uncovered(solids[len(furniture) :], furniture)))
    corners = [(*polygon.min(axis=0), *polygon.max(axis=0)) for polygon in polygons]
    at_lidar = tuple(solid for solid in solids if solid.z_min <= known.robot.lidar.z <= solid.z_max)
    return BaseMap(
        grid=grid,
        occupied=read_only(_covered_cells(solids, grid)),
        distance=read_only(_distance(solids, grid)),
        visible_distance=read_only(_distance(at_lidar, grid)),
        polygons=tuple(read_only(polygon) for polygon in polygons),
        extents=read_only(np.array(corners).reshape(-1, 4)),
    )


def _distance(solids: tuple[Solid, ...], grid: Grid) -> NDArray[np.float32]:
    """Distance [m] of every cell centre to the nearest footprint, negative inside; at most `FAR` on a large map."""
    if grid.shape[0] * grid.shape[1] <= WHOLE:
        return distance_to_solids(solids, grid.centres()).astype(np.float32)
    distance = np.full(grid.shape, FAR, np.float32)
    for solid in solids:
        corners = outline(solid.shape)
        first = np.maximum(grid.cell_of(corners.min(axis=0) - FAR), 0)
        last = np.minimum(grid.cell_of(corners.max(axis=0) + FAR) + 1, grid.shape)
        if (last <= first).any():
            continue
        rows, columns = np.arange(first[0], last[0]), np.arange(first[1], last[1])
        centres = grid.centre_of(np.stack(np.meshgrid(rows, columns, indexing="ij"), axis=-1))
        near = distance[first[0] : last[0], first[1] : last[1]]
        np.minimum(near, signed_distance(solid.shape, centres).astype(np.float32), out=near)
    return distance


def read_only(array: np.ndarray) -> np.ndarray:
    """Make an array read-only in place, and return it."""
    array.setflags(write=False)
    return array


def _covered_cells(solids: tuple[Solid, ...], grid: Grid) -> NDArray[np.uint8]:
    """1 where the inside of a footprint meets the inside of the cell."""
    covered = np.zeros(grid.shape, dtype=np.uint8)
    half = grid.resolution / 2.0 - 1e-9
    for solid in solids:
        footprint = _footprint(solid)
        shapely.prepare(footprint)
        x_min, y_min, x_max, y_max = footprint.bounds
        low = np.clip(grid.cell_of(np.array([x_min, y_min])), 0, np.array(grid.shape))
        high = np.clip(grid.cell_of(np.array([x_max, y_max])) + 1, 0, np.array(grid.shape))
        rows, columns = np.arange(low[0], high[0]), np.arange(low[1], high[1])
        centres = grid.centre_of(np.stack(np.meshgrid(rows, columns, indexing="ij"), axis=-1))
        x, y = centres[..., 0], centres[..., 1]
        cells = shapely.box(x - half, y - half, x + half, y + half)
        covered[low[0] : high[0], low[1] : high[1]] |= shapely.intersects(footprint, cells).astype(np.uint8)
    return covered


def _footprint(solid: Solid) -> shapely.Polygon:
    if isinstance(solid.shape, Cylinder):
        return shapely.Point(solid.shape.centre).buffer(solid.shape.radius, quad_segs=64)
    return shapely.Polygon(outline(solid.shape))
