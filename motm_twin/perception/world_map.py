"""The map of one period, as planning and arm avoidance read it."""

import msgspec
import numpy as np
from numpy.typing import NDArray

from motm_twin.model.geometry import Array
from motm_twin.perception.floor import Floor

NO_MOVERS = np.zeros((0, 6))
NO_MOVERS.setflags(write=False)
NO_TRACKS = np.zeros((0, 7))
NO_TRACKS.setflags(write=False)
NO_POINTS = np.zeros((0, 2))
NO_POINTS.setflags(write=False)


class WorldMap(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Occupancy, distance, proximity cost and polygons; row index = y, column index = x; arrays are read-only.

    Cell (row, col) covers ``origin + resolution * (col, row)`` to ``+ resolution``.
    """

    stamp: float  # [s]
    resolution: float  # [m]
    origin: Array  # world corner of cell (0, 0) [m], shape (2,)
    occupied: NDArray[np.uint8]  # 1 occupied (mapped or seen), shape (ny, nx)
    distance: NDArray[
        np.float32
    ]  # [m] to the nearest obstacle; exact, and negative inside, for mapped furniture; 0 in seen cells
    proximity: NDArray[np.float32]  # blurred, inflated occupancy 0..1 (STAA*'s grid penalty)
    polygons: tuple[Array, ...]  # obstacle outlines, counter-clockwise, not inflated, each shape (n, 2)
    seen_points: Array  # centres of cells occupied by lidar outside the mapped furniture [m], shape (m, 2)
    seen_static: NDArray[np.bool_]  # occupied for 3 s, at rest for 12 s if seen to move, or connected to such, (m,)
    movers: Array = NO_MOVERS  # moving tracks: x, y [m], velocity [m/s], radius [m], near the base (0, 1), (k, 6)
    tracks: Array = NO_TRACKS  # moving and waiting tracks, with the columns of `perception/tracks.py`, (k, 7)
    floor: Floor | None = None  # seen floor round the robot; None: all floor is free
    hidden: Array = NO_POINTS  # far sides of obstacles that may move, hidden from the lidar [m], shape (n, 2)
