"""The map without dynamic obstacles."""

from dataclasses import dataclass

import msgspec
import numpy as np

from motm_twin.model.geometry import Array
from motm_twin.model.known import KnownWorld
from motm_twin.model.state import Stateful
from motm_twin.perception.base_map import BaseMap, base_map, read_only
from motm_twin.perception.clusters import growth_of, seen_outlines, steadied
from motm_twin.perception.distance import proximity_cost, seen_distance, squared_cells
from motm_twin.perception.mapper import MapSettings
from motm_twin.perception.tracks import TrackParameters, stationary_points
from motm_twin.perception.world_map import WorldMap


@dataclass
class FilteredState:
    """State between maps."""

    outlines: tuple[Array, ...] = ()  # of the seen points kept last


class FilteredMap(Stateful[FilteredState]):
    """Builds the map of a period from some of its seen points only."""

    def __init__(self, known: KnownWorld) -> None:
        self._known, self._g = known, growth_of(known.robot.footprint)
        self._base: BaseMap | None = None
        self._state = FilteredState()

    def keep(self, world: WorldMap, standing: np.ndarray) -> WorldMap:
        """The map with only the seen points in the mask ``standing``, shape (m,)."""
        if standing.all():
            self._state.outlines = ()
            return world
        base = self._base_map(world.resolution)
        shape, extent = world.occupied.shape, world.resolution * np.array(world.occupied.shape[::-1])
        left, low = np.round((world.origin - np.array(base.grid.origin)) / world.resolution).astype(np.int32)
        window = (slice(low, low + shape[0]), slice(left, left + shape[1]))  # only a part of a large map
        points = world.seen_points[standing]
        column, row = np.floor((points - world.origin).T / world.resolution).astype(np.int32)
        cells = np.column_stack((row, column))
        occupied = base.occupied[window].copy()
        occupied[cells[:, 0], cells[:, 1]] = 1
        seen = seen_distance(squared_cells(cells, *shape), world.resolution)
        outlines = seen_outlines(cells, world.resolution, world.origin, self._g) if len(cells) else []
        self._state.outlines = tuple(read_only(corners) for corners in steadied(outlines, self._state.outlines))
        return msgspec.structs.replace(
            world,
            occupied=read_only(occupied),
            distance=read_only(np.minimum(base.distance[window], seen)),
            polygons=base.polygons_within(world.origin, world.origin + extent) + self._state.outlines,
            seen_points=read_only(points.copy()),
            seen_static=read_only(world.seen_static[standing].copy()),
        )

    def _base_map(self, resolution: float) -> BaseMap:
        if self._base is None:
            self._base = base_map(self._known, resolution)
        return self._base


class StaticMap(FilteredMap):
    """The map of a period without dynamic obstacles."""

    def __init__(self, known: KnownWorld, parameters: TrackParameters | None = None) -> None:
        super().__init__(known)
        self._parameters = parameters or TrackParameters()

    def of(self, world: WorldMap) -> WorldMap:
        """The map without the seen points of its movers; the same object when they have none."""
        return self.keep(world, stationary_points(world, world.movers, self._parameters))

    def proximity(self, world: WorldMap) -> np.ndarray:
        """STAA*'s proximity grid of such a map, shape (rows, columns): `keep` leaves that of the map unchanged."""
        settings = MapSettings()
        return proximity_cost(world.distance, settings.proximity_width, settings.proximity_blur)
