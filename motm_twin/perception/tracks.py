"""Tracks of dynamic obstacles from lidar scans: positions, velocities and their uncertainty; and static cells.

Each track is a disc with a constant-velocity Kalman filter. Scan points that neither mapped furniture nor standing
cells (`static_cells`) explain are assigned to the track on whose rim they lie, point by point, so that two obstacles
side by side stay two; a circle of the known radius is fitted to them. The others are cut into segments, each of which
begins a track. A track that is hidden by something nearer lives on for a while, one that beams pass through does not.

A new track has not moved yet. It moves once it is fast enough and has left its place: beams pass where it was, or it is
where beams passed. A box that comes into sight bit by bit does neither, however the base drives.
"""

import itertools
import math
from dataclasses import dataclass, field
from enum import IntEnum
from typing import Annotated, NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from motm_twin.model.geometry import Array, from_frame, frozen
from motm_twin.model.known import KnownWorld
from motm_twin.model.number import OWN, Number
from motm_twin.model.state import Stateful
from motm_twin.perception.base_map import BaseMap, base_map, read_only
from motm_twin.perception.discs import Disc, at_ends, behind, front_circle, on_ways, owners, seen_width
from motm_twin.perception.mapper import MapSettings
from motm_twin.perception.scan import CheckedScan
from motm_twin.perception.static_cells import Mask, StandingCells, beside, static_cells
from motm_twin.perception.track_kernels import (
    correct,
    ends_off_furniture,
    is_hidden,
    keep_one_body,
    passed,
    predict,
    segments,
    share_out,
)
from motm_twin.perception.world_map import NO_MOVERS, NO_TRACKS, WorldMap

X, Y, VX, VY, RADIUS, SD, IDENTITY = range(7)  # columns of `WorldMap.tracks`


_MAP = MapSettings()
_REACH = _MAP.lidar_reach  # [m] farther points are left out: too few beams meet a leg there
_POSITION_ERROR = _MAP.explained_margin  # [m] largest error of position and range
_HEADING_ERROR = _MAP.explained_per_range  # [rad] largest error of heading


class TrackParameters(msgspec.Struct, frozen=True, kw_only=True):
    """Parameters of the tracks of dynamic obstacles: sizes and speeds are those of persons and Temis."""

    explained: Annotated[
        float, Number("m", OWN, "distance from mapped furniture within which a scan point belongs to it")
    ] = 0.10
    rim: Annotated[
        float, Number("m", OWN, "distance from the rim of a track within which a scan point may belong to it")
    ] = 0.15
    points: Annotated[
        int, Number("", OWN, "least points of a scan that measure a track, or show that it has moved")
    ] = 3
    gap: Annotated[
        float, Number("m", OWN, "largest gap between neighbouring points of a segment; twice as much at 8 m")
    ] = 0.1
    merges: Annotated[
        float, Number("m", OWN, "distance between the centres of two tracks below which they are one")
    ] = 0.25
    radius_min: Annotated[float, Number("m", OWN, "least radius of a track")] = 0.10
    radius_max: Annotated[float, Number("m", OWN, "largest radius of a track: what is wider is furniture")] = 0.40
    end_radius: Annotated[
        float,
        Number(
            "m",
            OWN,
            "radius, a Temi's, of bodies at both ends of a segment too wide for a track: it may be two side by side",
        ),
    ] = 0.25
    shares: Annotated[
        float, Number("", OWN, "share by which the radius of a track alone in its segment shrinks per scan")
    ] = 0.1
    acceleration: Annotated[
        float, Number("m/s^2", OWN, "sd of a track's acceleration, for 0.1 s: of a person who sets off, or turns")
    ] = 1.0
    noise: Annotated[float, Number("m", OWN, "sd of the fitted centre of a track")] = 0.03
    first_speed: Annotated[float, Number("m/s", OWN, "sd of the velocity of a new track")] = 0.7
    hits: Annotated[int, Number("", OWN, "scans in which a track must be seen to count")] = 4
    hidden: Annotated[
        float,
        Number(
            "s", OWN, "time after which a track that something nearer hides is deleted; a waiting one after `rests`"
        ),
    ] = 2.0
    unseen: Annotated[float, Number("s", OWN, "time after which an unseen track that nothing hides is deleted")] = 0.3
    sets_off: Annotated[
        float, Number("m/s", OWN, "speed from which a track that has left its place counts as moving")
    ] = 0.06
    moves: Annotated[float, Number("m/s", OWN, "speed from which a moving track goes on moving")] = 0.10
    settles: Annotated[float, Number("s", OWN, "time since it last moved after which a track counts as waiting")] = 2.0
    rests: Annotated[
        float,
        Number(
            "s", OWN, "time since it last moved after which a track counts as standing: one that waits leaves sooner"
        ),
    ] = 12.0
    trail: Annotated[
        float, Number("s", OWN, "duration of the trail behind a moving track on which seen cells may be its own")
    ] = 0.4
    near_time: Annotated[
        float,
        Number(
            "s",
            OWN,
            "driving time at full speed to a moving track, up to which that is an obstacle: it may not have moved on "
            "by then",
        ),
    ] = 4.0
    parted: Annotated[
        float, Number("", OWN, "factor on near_time beyond which a near track is no longer an obstacle (hysteresis)")
    ] = 1.3


class Look(NamedTuple):
    """Ranges of a scan in the world frame, kept to see where its beams passed."""

    origin: Array  # of the beams [m], shape (2,)
    first: float  # [rad] bearing of the first beam
    step: float  # [rad] from one to the next
    ranges: Array  # [m], nan where not known, shape (n,)


class Place(NamedTuple):
    """Points at which a track was seen, and the whole scan."""

    points: Array  # [m], shape (n, 2)
    look: Look


class Phase(IntEnum):
    """Phase of a track."""

    NEW = 0  # never seen to move
    MOVING = 1  # moved just now
    WAITING = 2  # moved lately, and may at any time
    STANDING = 3  # has not moved for long


@dataclass
class Track:
    """One track."""

    identity: int
    state: Array  # x, y [m], velocity [m/s], shape (4,)
    covariance: Array  # shape (4, 4)
    radius: float  # [m] of the circle that is fitted
    place: Place  # where it was first seen, or last seen to move
    seen: float  # [s]
    covers: float = 0.0  # [m] from its centre to the farthest of the points that were last seen of it
    hits: int = 1
    moved: float = -math.inf  # [s] last time that it moved
    static: bool = False  # most of its points are at static cells
    near: bool = False  # near the base


@dataclass
class TrackState:
    """State between scans."""

    stamp: float | None = None
    tracks: list[Track] = field(default_factory=list)
    ends: tuple[Disc, ...] = ()  # at the ends of segments that are too wide for a track, and not static
    next_identity: int = 1
    stood: StandingCells = field(default_factory=StandingCells)


class Points(NamedTuple):
    """Points of a scan that neither furniture nor standing cells explain, in the order of the beams."""

    at: Array  # [m], shape (n, 2)
    beam: NDArray[np.int64]  # shape (n,)
    reach: Array  # [m] from the sensor, shape (n,)
    static: Mask  # in or beside a static cell, shape (n,)


class DynamicTracker(Stateful[TrackState]):
    """Tracks dynamic obstacles from scan to scan, and finds the static cells of the map."""

    def __init__(self, known: KnownWorld, parameters: TrackParameters | None = None) -> None:
        p = self.parameters = parameters or TrackParameters()
        self._known, robot = known, known.robot
        stops = robot.footprint.outer + robot.base.stopping_way + 2.0 * p.radius_max
        self.near = max(p.near_time * robot.base.full_speed, stops)  # [m] from the base; 2.0 m for Frankie
        self._lidar = np.array([robot.lidar.x, robot.lidar.y])  # [m] in the base frame
        self._base: BaseMap | None = None
        self._state = TrackState()

    def update(self, scan: CheckedScan | None, world: WorldMap, pose: Array) -> WorldMap:
        """Update the tracks, and return the map with tracks, movers and static cells, at its time.

        ``scan``: a new one that the map has taken in; None: there is none. ``pose`` of the base, shape (3,).
        """
        now, state, p = world.stamp, self._state, self.parameters
        ways = np.array([self._row(track, now)[:5] for track in self._unsettled(now)]).reshape(-1, 5)
        on_tracks = on_ways(world.seen_points, ways, p.trail, p.rim)
        stood, static = static_cells(state.stood, world, self._base_map(world).grid, on_tracks)
        if scan is not None:
            self._take(scan, world, stood, static)
        self._mark_near(pose[:2], now)
        unsettled = self._unsettled(now)
        tracks = [track for track in unsettled if now - track.seen <= p.hidden]
        movers = [track for track in tracks if self._phase(track, now) == Phase.MOVING]
        young = [track for track in self._counting(now) if self._phase(track, now) == Phase.NEW and not track.static]
        discs = [(*_expected(track, now - self._stamp), track.radius) for track in unsettled + young]
        rows = [(*self._row(track, now)[:5], track.near) for track in movers]
        return msgspec.structs.replace(
            world,
            seen_static=read_only(static),
            tracks=frozen(np.array([self._row(track, now) for track in tracks])) if tracks else NO_TRACKS,
            movers=frozen(np.array(rows)) if rows else NO_MOVERS,
            hidden=behind([*discs, *state.ends], from_frame(pose, self._lidar)),
        )

    @property
    def _stamp(self) -> float:
        return -math.inf if self._state.stamp is None else self._state.stamp

    def _counting(self, now: float) -> list[Track]:
        """Tracks seen often enough to count, at a time [s]; none if the newest scan is too old."""
        p = self.parameters
        return [] if now - self._stamp > p.hidden else [one for one in self._state.tracks if one.hits >= p.hits]

    def _unsettled(self, now: float) -> list[Track]:
        """Counting tracks that move or wait at a time [s]."""
        return [one for one in self._counting(now) if self._phase(one, now) in (Phase.MOVING, Phase.WAITING)]

    def _phase(self, track: Track, now: float) -> Phase:
        """Phase of a track at a time [s]."""
        p, rests = self.parameters, now - track.moved
        if rests == math.inf:
            return Phase.NEW
        return Phase.MOVING if rests <= p.settles else Phase.WAITING if rests <= p.rests else Phase.STANDING

    def _row(self, track: Track, now: float) -> tuple[float, ...]:
        """A row of `WorldMap.tracks` at a time [s]."""
        ahead, c = now - self._stamp, track.covariance
        variance = c[0, 0] + c[1, 1] + 2.0 * ahead * (c[0, 2] + c[1, 3]) + ahead * ahead * (c[2, 2] + c[3, 3])
        sd = math.sqrt(max(0.5 * float(variance), 0.0))
        x, y = _expected(track, ahead)
        vx, vy = track.state[2:].tolist()
        return (x, y, vx, vy, max(track.radius, track.covers), sd, float(track.identity))

    def _mark_near(self, base: Array, now: float) -> None:
        """Update which tracks are near the base (2,) [m], with hysteresis."""
        for track in self._state.tracks:
            limit = self.parameters.parted * self.near if track.near else self.near
            track.near = math.dist(_expected(track, now - self._stamp), base) <= limit

    def _base_map(self, world: WorldMap) -> BaseMap:
        if self._base is None:
            self._base = base_map(self._known, world.resolution)
        return self._base

    def _take(self, scan: CheckedScan, world: WorldMap, stood: Mask, static: Mask) -> None:
        """Predict the tracks, assign points to them, correct them, end lost tracks, and begin new ones."""
        p, state = self.parameters, self._state
        dt = 0.0 if state.stamp is None else scan.stamp - state.stamp
        if not 0.0 <= dt <= p.hidden:
            state.tracks, dt = [], 0.0
        for track in state.tracks:
            if not self._waits_unseen(track, self._stamp):
                predict(track.state, track.covariance, dt, p.acceleration**2 * 0.1)
        state.stamp = scan.stamp
        points = self._unexplained(scan, world, stood, static)
        look = Look(scan.origin, scan.pose[2] + scan.angle_min, scan.angle_step, scan.ranges)
        circles = np.array([(*track.state[:2].tolist(), track.radius) for track in state.tracks]).reshape(-1, 3)
        owner = owners(points.at, circles, p.rim)
        cuts = segments(points.at, points.beam, points.reach, p.gap)
        limits = (p.gap, p.radius_max)
        alone, partly = share_out(
            points.at, points.beam, scan.ranges, scan.origin, owner, cuts, len(state.tracks), limits
        )
        lost = keep_one_body(points.at, scan.origin, owner, cuts, len(state.tracks), p.radius_max)
        for k, track in enumerate(state.tracks):
            own = owner == k
            if np.count_nonzero(own) >= p.points:
                if lost[k]:
                    self._begin_anew(track, points.at[own], scan.origin)
                self._correct(track, points.at[own], scan, alone[k], partly[k])
                track.static = _most(points.static[own])
                self._judge(track, Place(points.at[own], look), scan.stamp)
        state.tracks = [track for track in state.tracks if self._lives(track, scan)]
        self._merge()
        self._begin(points, owner < 0, scan, look)

    def _unexplained(self, scan: CheckedScan, world: WorldMap, stood: Mask, static: Mask) -> Points:
        """Points that neither furniture nor standing cells explain; those on tracks that have moved are kept, too."""
        p = self.parameters
        known = self._base_map(world)
        at, beam = ends_off_furniture(
            scan.ranges, scan.directions, scan.origin, min(_REACH, scan.range_max), known.visible_distance,
            known.grid.origin, known.grid.resolution, p.explained,
        )  # fmt: skip
        by_stood, by_static = beside(
            at, world.seen_points, stood, static, world.origin, world.resolution, world.occupied.shape
        )
        moved = [track for track in self._state.tracks if track.moved > -math.inf]  # they may set off again
        discs = np.array([(*track.state.tolist(), track.radius) for track in moved]).reshape(-1, 5)
        free = ~by_stood | on_ways(at, discs, 0.0, world.resolution)
        return Points(at[free], beam[free], scan.ranges[beam[free]], by_static[free])

    def _merge(self) -> None:
        """Keep the older of two tracks whose centres are nearer than those of two bodies can be."""
        kept: list[Track] = []
        for track in self._state.tracks:
            if all(math.dist(track.state[:2], other.state[:2]) > self.parameters.merges for other in kept):
                kept.append(track)
        self._state.tracks = kept

    def _begin_anew(self, track: Track, own: Array, sensor: Array) -> None:
        """Move a track that held several bodies onto the one with these points (n, 2); its velocity is uncertain."""
        p = self.parameters
        track.radius = min(max(seen_width(own, sensor), p.radius_min), p.radius_max)
        track.state = np.array([*front_circle(own, sensor, track.radius), *track.state[2:].tolist()])
        track.covariance = self._first_covariance()

    def _first_covariance(self) -> Array:
        """Covariance of a track after one sighting, shape (4, 4)."""
        p = self.parameters
        return np.diag([p.noise**2, p.noise**2, p.first_speed**2, p.first_speed**2])

    def _correct(self, track: Track, own: Array, scan: CheckedScan, alone: np.bool_, partly: np.bool_) -> None:
        """Correct a track with its points (n, 2); see `correct`."""
        p = self.parameters
        sizes = (p.radius_min, p.radius_max, p.shares, p.noise)
        track.radius, track.covers = correct(
            track.state, track.covariance, own, scan.origin, track.radius, alone, partly, sizes
        )
        track.seen = scan.stamp
        track.hits += 1

    def _judge(self, track: Track, here: Place, now: float) -> None:
        """Decide if a track moves: it has left its place and is fast enough, or it goes on moving.

        One that has stopped among static cells never moved: it is a side of a static obstacle, and the pose was off.
        """
        p, before, speed = self.parameters, track.place, math.hypot(track.state[2], track.state[3])
        unsettled = self._phase(track, now) in (Phase.MOVING, Phase.WAITING)
        goes_on = unsettled and speed >= p.moves
        if not unsettled and speed < p.sets_off:
            return
        left = (
            passed(before.points, *here.look, _POSITION_ERROR, _HEADING_ERROR) >= p.points
            or passed(here.points, *before.look, _POSITION_ERROR, _HEADING_ERROR) >= p.points
        )
        if left or goes_on:
            track.moved, track.place = now, here
        elif unsettled and now - track.moved > p.settles and track.static:
            track.moved, track.place = -math.inf, here

    def _lives(self, track: Track, scan: CheckedScan) -> bool:
        """True when a track was seen lately, or something nearer hides it."""
        p, silent = self.parameters, scan.stamp - track.seen
        if silent <= 0.0:
            return True
        if track.hits < p.hits:
            return silent <= 0.1
        if not is_hidden(scan.ranges, scan.directions, track.state[:2] - scan.origin, track.radius):
            return silent <= p.unseen
        return silent <= (p.rests if self._waits_unseen(track, scan.stamp) else p.hidden)

    def _waits_unseen(self, track: Track, stamp: float) -> bool:
        """True when a track is not in the scan of this time [s], but waited when last seen: it is still there."""
        return track.seen < stamp and self._phase(track, track.seen) == Phase.WAITING

    def _begin(self, points: Points, left: Mask, scan: CheckedScan, look: Look) -> None:
        """Begin a track with each segment of the points left, if it may be a dynamic obstacle."""
        p, state = self.parameters, self._state
        rest = Points(points.at[left], points.beam[left], points.reach[left], points.static[left])
        ends: list[Disc] = []
        cuts = segments(rest.at, rest.beam, rest.reach, p.gap).tolist()
        for start, end in itertools.pairwise(cuts):
            own = rest.at[start:end]
            width = seen_width(own, scan.origin)
            if len(own) < p.points:
                continue
            if width > p.radius_max:
                if not _most(rest.static[start:end]):
                    ends += at_ends(own, p.end_radius, scan.origin)
                continue
            radius = max(width, p.radius_min)
            middle = front_circle(own, scan.origin, radius)
            if any(math.dist(middle, other.state[:2]) < other.radius + p.radius_min for other in state.tracks):
                continue
            first, place = np.array([*middle, 0.0, 0.0]), Place(own, look)
            track = Track(state.next_identity, first, self._first_covariance(), radius, place, scan.stamp)
            track.static = _most(rest.static[start:end])
            state.tracks.append(track)
            state.next_identity += 1
        state.ends = tuple(ends)


def stationary_points(world: WorldMap, movers: Array, parameters: TrackParameters) -> Mask:
    """Mask of seen points of the map that belong to none of these movers (k, 5 or more), shape (m,)."""
    rows = movers[:, :5].copy()  # neither a slice nor read-only, so that one compiled kernel serves all
    return world.seen_static | ~on_ways(world.seen_points, rows, parameters.trail, parameters.rim)


def _expected(track: Track, ahead: float) -> tuple[float, float]:
    """Predicted position [m] of a track ``ahead`` [s] of the newest scan."""
    x, y, vx, vy = track.state.tolist()
    return x + ahead * vx, y + ahead * vy


def _most(mask: Mask) -> bool:
    """True when more than half of a mask is set."""
    return bool(2 * np.count_nonzero(mask) > len(mask))
