"""The map of a period: the pre-made map, and obstacles seen by the lidar (Paper, Sec. III; grid of STAA*)."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import msgspec
import numpy as np

from motm_twin.model.geometry import Array
from motm_twin.model.known import KnownWorld
from motm_twin.model.number import OWN, STAA, Number, paper
from motm_twin.model.plant import PERIOD, Observation, Scan
from motm_twin.model.profile import RobotProfile
from motm_twin.model.reason import Reason
from motm_twin.model.state import Stateful
from motm_twin.perception.base_map import BaseMap, base_map, read_only
from motm_twin.perception.clusters import growth_of, seen_outlines, steadied
from motm_twin.perception.distance import proximity_cost, seen_distance, squared_cells
from motm_twin.perception.floor import floor_round, mark_seen, sight_radius
from motm_twin.perception.grid import AROUND, WHOLE, Window, occupied_cells, whole, window_of
from motm_twin.perception.occupancy import (
    Evidence,
    Fading,
    clear_footprint,
    clear_rays,
    mark_hits,
    no_evidence,
    settle,
)
from motm_twin.perception.scan import CheckedScan, RefusedScan, check_scan
from motm_twin.perception.world_map import WorldMap

NO_CELLS = np.zeros((0, 2), np.int32)


class MapSettings(msgspec.Struct, frozen=True, kw_only=True):
    """Parameters of the map. Choices of this project unless a source is named."""

    resolution: Annotated[float, Number("m", STAA, "side of a cell")] = 0.05
    lidar_reach: Annotated[
        float,
        Number("m", OWN, "range beyond which hits and free space are left for later, but not what the base stops for"),
    ] = 8.0
    explained_margin: Annotated[
        float, Number("m", OWN, "a hit this close to furniture in sight is that furniture: 3 sd of position and range")
    ] = 0.08
    explained_per_range: Annotated[
        float, Number("m/m", OWN, "added to explained_margin for every metre of range: 3 sd (1.5 deg) of heading noise")
    ] = 0.025
    hit: Annotated[
        int, Number("", OWN, "evidence of one hit: a cell seen once is cleared by 3 free scans, 0.15 s at 20 Hz")
    ] = 3
    evidence_most: Annotated[
        int, Number("", OWN, "largest evidence: 6 free scans to clear, 0.3 s at 20 Hz; a shorter break is noise")
    ] = 6
    static_after: Annotated[
        float,
        Number("s", paper("V"), "a cell occupied unbroken this long is static; else unseen this long, it is gone"),
    ] = 3.0
    hidden: Annotated[
        float,
        Number("s", OWN, "a cell not static that a newer hit hides this long is cleared: it came closer, or was noise"),
    ] = 1.0
    shadow: Annotated[
        float, Number("m", OWN, "depth behind a hit in which hidden cells are cleared: a little more than an agent")
    ] = 0.6
    proximity_width: Annotated[
        float,
        Number(
            "m", OWN, "distance at which the grid penalty falls to 0 (prototype: 0.3 over 0.12 m is best at the table)"
        ),
    ] = 0.12
    proximity_blur: Annotated[int, Number("cells", OWN, "blur of the grid penalty, each way")] = 1


def fading_of(p: MapSettings) -> Fading:
    """The rules by which evidence is added and removed, for kernels."""
    static_ms, grace_ms = round(1000.0 * p.static_after), round(1000.0 * PERIOD * p.evidence_most)
    return Fading(p.hit, p.evidence_most, static_ms, grace_ms, round(1000.0 * p.hidden), p.shadow, static_ms)


def reach_of(robot: RobotProfile) -> float:
    """Distance [m] that a base must see to stop, turn aside or reverse: three stopping distances and its own size."""
    return 3.0 * robot.base.stopping_way + 2.0 * robot.footprint.outer


@dataclass
class MapperState:
    """State of the mapper."""

    evidence: Evidence
    cells: np.ndarray  # seen cells (row, col) of the newest map, shape (m, 2)
    static: np.ndarray  # mask of the static ones, shape (m,)
    outlines: tuple[Array, ...]  # of the seen cells
    scan_stamp: float | None
    refusal: Reason | None  # reason why the newest scan was refused; None when it was not


class Mapper(Stateful[MapperState]):
    """Turns observations into the WorldMap, once per period."""

    def __init__(self, known: KnownWorld, settings: MapSettings | None = None) -> None:
        self._known = known
        self._settings = settings or MapSettings()
        self._fading = fading_of(self._settings)
        self._g = growth_of(known.robot.footprint)
        self._reach = max(self._settings.lidar_reach, reach_of(known.robot))
        self.base: BaseMap = base_map(known, self._settings.resolution)
        grid = self.base.grid
        self._origin = read_only(np.array(grid.origin))
        self._frame = np.array([*grid.origin, grid.resolution])
        self._inside = self.base.distance <= 0.0
        self._window, self._corner = whole(grid), self._origin  # part of the map that is returned, and its world corner
        self._polygons = self.base.polygons
        self._sight = sight_radius(known.robot)
        self._marks: np.ndarray | None = None  # buffer of `_blank`
        self._fields_of: np.ndarray | None = None  # the seen cells that the fields below belong to
        self._fields: tuple[np.ndarray, np.ndarray, np.ndarray] | None = None
        self.taken: CheckedScan | None = None  # the scan that the last update used; None: no new good one
        self._state = MapperState(no_evidence(grid.shape), NO_CELLS, np.zeros(0, bool), (), None, None)

    @property
    def refusal(self) -> Reason | None:
        """Reason why the newest scan was refused; None when it was not."""
        return self._state.refusal

    @property
    def scan_stamp(self) -> float | None:
        """Stamp [s] of the newest scan that was used; None before the first."""
        return self._state.scan_stamp

    @property
    def large(self) -> bool:
        """True when only a part of the map is returned at a time."""
        return self.base.occupied.size > WHOLE

    def adopt(self, state: MapperState) -> None:
        """Go on from the state of a mapper with another pre-made map; forget evidence that this map explains."""
        self.restore(state)
        settings, own = self._settings, self._state
        margin = settings.explained_margin + settings.explained_per_range * self._reach
        own.evidence.level[self._inside | (self.base.visible_distance < margin)] = 0
        keep = own.evidence.level[own.cells[:, 0], own.cells[:, 1]] > 0
        if not keep.all():
            own.cells, own.static = own.cells[keep], own.static[keep]
            outlines = seen_outlines(own.cells, self.base.grid.resolution, self._origin, self._g)
            own.outlines = tuple(read_only(corners) for corners in outlines)

    def update(self, observation: Observation, targets: Sequence[Array] = ()) -> WorldMap:
        """Take in the newest scan and return the map at the observation's time; a refused scan changes nothing.

        Of a large map it returns the part round the robot and the ``targets`` (2,) [m].
        """
        state, self.taken = self._state, None
        if observation.scan is not None and observation.scan.stamp != state.scan_stamp:
            self._take(observation.scan, observation.time)
        self._look_at(window_of(self.base.grid, [observation.pose[:2], *targets], max(AROUND, self._reach + 1.0)))
        rows, columns = self._window
        cells, static = state.cells, state.static
        if (rows.stop - rows.start, columns.stop - columns.start) != self.base.grid.shape:
            keep = (cells >= (rows.start, columns.start)).all(axis=1) & (cells < (rows.stop, columns.stop)).all(axis=1)
            cells, static = cells[keep], static[keep]
        occupied, distance, proximity = self._fields_for(cells)
        return WorldMap(
            stamp=observation.time,
            resolution=self.base.grid.resolution,
            origin=self._corner,
            occupied=occupied,
            distance=distance,
            proximity=proximity,
            polygons=self._polygons + state.outlines,
            seen_points=read_only(self.base.grid.centre_of(cells)),
            seen_static=read_only(static.copy()),
            floor=floor_round(
                state.evidence.seen, self.base.grid, observation.pose[:2], self._sight, round(observation.time * 1000.0)
            ),
        )

    def _look_at(self, window: Window) -> None:
        """Select the part of the map that is returned from now on."""
        if window == self._window:
            return
        rows, columns = self._window = window
        self._fields = None
        grid = self.base.grid
        low = np.array(grid.origin) + grid.resolution * np.array([columns.start, rows.start])
        high = np.array(grid.origin) + grid.resolution * np.array([columns.stop, rows.stop])
        self._corner = read_only(low)
        self._polygons = self.base.polygons_within(low, high)

    def _take(self, scan: Scan, now: float) -> None:
        """Check a scan and add it to the evidence."""
        checked = check_scan(scan, self._known.robot.lidar, now)
        state = self._state
        if isinstance(checked, RefusedScan):
            state.refusal = checked.reason
            return
        state.refusal, state.scan_stamp, self.taken = None, checked.stamp, checked
        cells, static = self._integrate(checked)
        if not np.array_equal(cells, state.cells):
            outlines = seen_outlines(cells, self.base.grid.resolution, self._origin, self._g)
            state.outlines = tuple(read_only(corners) for corners in steadied(outlines, state.outlines))
        state.cells, state.static = cells, static

    def _integrate(self, scan: CheckedScan) -> tuple[np.ndarray, np.ndarray]:
        """Add hits, clear free space and footprint, then forget; returns the seen cells and a mask of static ones."""
        evidence, settings, body = self._state.evidence, self._settings, self._known.robot.footprint
        now_ms = round(scan.stamp * 1000.0)
        reach = min(self._reach, scan.range_max)
        hit = scan.ranges < reach
        ends = scan.origin + np.minimum(scan.ranges, reach)[:, None] * scan.directions
        hit_now, passed_now = self._blank(scan.origin, reach)
        rectangle = np.array([0.5 * body.length, 0.5 * body.width, body.offset_x])
        mark_seen(
            evidence.seen, scan.pose, scan.mount, scan.ranges, scan.angle_min, scan.angle_step, self._sight, rectangle,
            now_ms, self._frame,
        )  # fmt: skip
        struck = np.where(hit, scan.ranges, -1.0)
        mark_hits(
            evidence.level,
            evidence.last_hit,
            evidence.outside,
            hit_now,
            self.base.visible_distance,
            self._inside,
            ends,
            struck,
            now_ms,
            self._frame,
            (settings.explained_margin, settings.explained_per_range),
            self._fading,
        )
        seen = (self._state.cells, self.base.grid.cell_of(ends[hit])) if self.large else ()
        occupied = occupied_cells(evidence.level, seen)
        clear_rays(
            evidence.level,
            hit_now,
            passed_now,
            evidence.last_hit,
            evidence.near_since,
            evidence.near_hit,
            occupied,
            scan.origin,
            ends,
            struck,
            now_ms,
            self._frame,
            self._fading,
        )
        inner = rectangle - np.array([settings.resolution, settings.resolution, 0.0])
        clear_footprint(evidence.level, evidence.outside, hit_now, occupied, scan.pose, inner, self._frame)
        return settle(
            occupied,
            evidence.level,
            evidence.last_hit,
            evidence.near_since,
            evidence.near_last,
            evidence.near_hit,
            now_ms,
            self._fading,
        )

    def _blank(self, sensor: Array, reach: float) -> np.ndarray:
        """Two grids that are 0 in all cells that a scan can reach, shape (2, rows, columns)."""
        grid = self.base.grid
        if not self.large:
            return np.zeros((2, *grid.shape), np.uint8)
        if self._marks is None:
            self._marks = np.zeros((2, *grid.shape), np.uint8)
        low = np.clip(grid.cell_of(sensor - reach - 1.0), 0, grid.shape)
        high = np.clip(grid.cell_of(sensor + reach + 1.0), 0, grid.shape)
        self._marks[:, low[0] : high[0], low[1] : high[1]] = 0
        return self._marks

    def _fields_for(self, cells: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Grids of occupancy, distance and proximity with these seen cells; reused while they do not change."""
        if self._fields is None or self._fields_of is None or not np.array_equal(cells, self._fields_of):
            occupied, known = self.base.occupied[self._window].copy(), self.base.distance[self._window]
            own = cells - np.array([self._window[0].start, self._window[1].start], cells.dtype)
            occupied[own[:, 0], own[:, 1]] = 1
            seen = seen_distance(squared_cells(own, *known.shape), self.base.grid.resolution)
            distance = np.minimum(known, seen)
            proximity = proximity_cost(distance, self._settings.proximity_width, self._settings.proximity_blur)
            self._fields = (read_only(occupied), read_only(distance), read_only(proximity))
            self._fields_of = cells.copy()
        return self._fields
