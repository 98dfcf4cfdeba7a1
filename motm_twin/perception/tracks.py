"""Tracks of dynamic obstacles from lidar scans: who is where, how fast, how sure that is, and what stands.

Each track is a disc with a constant-velocity Kalman filter. The points of a scan that neither mapped furniture nor what
is known to stand explains go to the track on whose rim they lie, point by point, so that two who stand side by side
stay two; a circle of the known radius is fitted to them. What is left over is cut into segments, each of which begins a
track. A track that is hidden behind something nearer lives on for a while, one that the beams pass through does not.

A new track has not moved yet. It does when it is fast enough and has left its place: beams pass where it was, or it is
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

from motm_twin.model.compiler import njit
from motm_twin.model.geometry import Array, from_frame, frozen
from motm_twin.model.known import KnownWorld
from motm_twin.model.number import OWN, Number
from motm_twin.model.state import Stateful
from motm_twin.perception.base_map import BaseMap, base_map, read_only
from motm_twin.perception.discs import (
    Disc,
    at_ends,
    behind,
    fitted_circle,
    front_circle,
    is_behind,
    on_ways,
    owners,
    seen_width,
)
from motm_twin.perception.mapper import MapSettings
from motm_twin.perception.scan import CheckedScan
from motm_twin.perception.static_cells import Mask, Stood, beside, static_cells
from motm_twin.perception.world_map import NO_MOVERS, NO_TRACKS, WorldMap

X, Y, VX, VY, RADIUS, SD, IDENTITY = range(7)  # columns of `WorldMap.tracks`


BEAMS_LOST = 3  # between two points of one segment: a few say nothing
_MAP = MapSettings()
_OFF = _MAP.explained_margin  # [m] by which position and range are off at most
_ASTRAY = _MAP.explained_per_range  # [rad] by which the heading is


class TrackParameters(msgspec.Struct, frozen=True, kw_only=True):
    """Parameters of the tracks of dynamic obstacles: sizes and speeds are those of persons and Temis."""

    reach: Annotated[float, Number("m", OWN, "farther points are left out: too few beams meet a leg there")] = 8.0
    explained: Annotated[float, Number("m", OWN, "from mapped furniture, within which a point belongs to it")] = 0.10
    rim: Annotated[float, Number("m", OWN, "from the rim of a track, within which a point may belong to it")] = 0.15
    points: Annotated[int, Number("", OWN, "of a scan that make a measurement, or show that a track has moved")] = 3
    gap: Annotated[float, Number("m", OWN, "between neighbouring points of one segment, and as much again in 8 m")] = (
        0.1
    )
    merges: Annotated[float, Number("m", OWN, "between the middles of two tracks: nearer ones are one")] = 0.25
    radius_min: Annotated[float, Number("m", OWN, "of a track")] = 0.10
    radius_max: Annotated[float, Number("m", OWN, "of a new track: what is wider is furniture")] = 0.40
    end_radius: Annotated[
        float, Number("m", OWN, "at the ends of what is wider and may move, a Temi's: it may be two side by side")
    ] = 0.25
    shares: Annotated[float, Number("", OWN, "by which the radius follows what is seen of one that stands alone")] = 0.1
    acceleration: Annotated[
        float, Number("m/s^2", OWN, "standard deviation, for 0.1 s: of a person who sets off, or turns")
    ] = 1.0
    noise: Annotated[float, Number("m", OWN, "of a fitted middle")] = 0.03
    first_speed: Annotated[float, Number("m/s", OWN, "standard deviation of the velocity of a new track")] = 0.7
    hits: Annotated[int, Number("", OWN, "scans in which a track must be seen to count")] = 4
    hidden: Annotated[float, Number("s", OWN, "that a track lives on behind something nearer")] = 2.0
    unseen: Annotated[float, Number("s", OWN, "the same where nothing hides it")] = 0.3
    moves: Annotated[float, Number("m/s", OWN, "from which a track moves")] = 0.06
    settles: Annotated[float, Number("s", OWN, "slower than that after which it waits")] = 2.0
    rests: Annotated[
        float, Number("s", OWN, "slower than that after which it stands: one that waits leaves sooner")
    ] = 12.0
    trail: Annotated[float, Number("s", OWN, "of its way behind a track that seen cells may still be on")] = 0.4
    near_time: Annotated[
        float,
        Number(
            "s",
            OWN,
            "of driving at full speed up to which a mover is in the way as it is: it may not have moved on by then",
        ),
    ] = 4.0
    parted: Annotated[float, Number("", OWN, "times as far, beyond which it no longer is")] = 1.3


class Look(NamedTuple):
    """Ranges of a scan in the world frame, kept to see where its beams passed."""

    origin: Array  # of the beams [m], shape (2,)
    first: float  # [rad] bearing of the first
    step: float  # [rad] from one to the next
    ranges: Array  # [m], nan where a beam says nothing, shape (n,)


class Place(NamedTuple):
    """Points where a track was seen, and all of that scan."""

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
    place: Place  # where it was when it was seen first, or seen to move last
    seen: float  # [s]
    covers: float = 0.0  # [m] from its middle to the farthest of the points that were last seen of it
    hits: int = 1
    moved: float = -math.inf  # [s] last time that it moved
    static: bool = False  # most of what is seen of it is static
    near: bool = False  # in the way


@dataclass
class TrackState:
    """State between scans."""

    stamp: float | None = None
    tracks: list[Track] = field(default_factory=list)
    ends: tuple[Disc, ...] = ()  # at the ends of what is too wide for a track, and not static
    next_identity: int = 1
    stood: Stood = field(default_factory=Stood)


class Points(NamedTuple):
    """Points of a scan that nothing explains, in the order of the beams."""

    at: Array  # [m], shape (n, 2)
    beam: NDArray[np.int64]  # shape (n,)
    reach: Array  # [m] from the sensor, shape (n,)
    static: Mask  # in or beside a static cell, shape (n,)


class DynamicTracker(Stateful[TrackState]):
    """Follows dynamic obstacles from scan to scan, and tells static cells from theirs."""

    def __init__(self, known: KnownWorld, parameters: TrackParameters | None = None) -> None:
        p = self.parameters = parameters or TrackParameters()
        self._known, robot = known, known.robot
        stops = robot.footprint.outer + robot.base.stopping_way + 2.0 * p.radius_max
        self.near = max(p.near_time * robot.base.full_speed, stops)  # [m] from the base; 2.0 m for Frankie
        self._lidar = np.array([robot.lidar.x, robot.lidar.y])  # [m] in the base frame
        self._base: BaseMap | None = None
        self._state = TrackState()

    def update(self, scan: CheckedScan | None, world: WorldMap, pose: Array) -> WorldMap:
        """The map with its tracks, movers and static cells, at its time.

        ``scan``: a new one that the map has taken in; None: there is none. ``pose`` of the base, shape (3,).
        """
        now, state, p = world.stamp, self._state, self.parameters
        ways = np.array([self._row(track, now)[:5] for track in self._unsettled(now)]).reshape(-1, 5)
        theirs = on_ways(world.seen_points, ways, p.trail, p.rim)
        stood, static = static_cells(state.stood, world, self._base_map(world).grid, theirs)
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
        """Tracks that count at a time [s]; none once no scan has come for so long that they would be over."""
        p = self.parameters
        return [] if now - self._stamp > p.hidden else [one for one in self._state.tracks if one.hits >= p.hits]

    def _unsettled(self, now: float) -> list[Track]:
        """Those that have moved lately."""
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
        """Say which are near the base (2,) [m], with a hysteresis."""
        for track in self._state.tracks:
            limit = self.parameters.parted * self.near if track.near else self.near
            track.near = math.dist(_expected(track, now - self._stamp), base) <= limit

    def _base_map(self, world: WorldMap) -> BaseMap:
        if self._base is None:
            self._base = base_map(self._known, world.resolution)
        return self._base

    def _take(self, scan: CheckedScan, world: WorldMap, stood: Mask, static: Mask) -> None:
        """Predict, give the points to the tracks, correct these, begin new ones, and end what is gone."""
        p, state = self.parameters, self._state
        dt = 0.0 if state.stamp is None else scan.stamp - state.stamp
        if not 0.0 <= dt <= p.hidden:
            state.tracks, dt = [], 0.0
        for track in state.tracks:
            if not self._waits_unseen(track, self._stamp):
                _predict(track.state, track.covariance, dt, p.acceleration**2 * 0.1)
        state.stamp = scan.stamp
        points = self._unexplained(scan, world, stood, static)
        look = Look(scan.origin, scan.pose[2] + scan.angle_min, scan.angle_step, scan.ranges)
        circles = np.array([(*track.state[:2].tolist(), track.radius) for track in state.tracks]).reshape(-1, 3)
        owner = owners(points.at, circles, p.rim)
        alone = np.ones(len(state.tracks), dtype=bool)  # no other track is seen in the same segment
        partly = np.zeros(len(state.tracks), dtype=bool)  # something nearer hides one side of it
        for start, end in segments(points, p.gap):
            self._share(points.at[start:end], owner[start:end], alone, scan)
            if goes_on_hidden(points.beam[start:end], points.reach[start:end], scan.ranges, p.gap):
                partly[owner[start:end][owner[start:end] >= 0]] = True
        for k, track in enumerate(state.tracks):
            own = owner == k
            if np.count_nonzero(own) >= p.points:
                self._correct(track, points.at[own], scan, alone=bool(alone[k]), partly=bool(partly[k]))
                track.static = _most(points.static[own])
                self._judge(track, Place(points.at[own], look), scan.stamp)
        state.tracks = [track for track in state.tracks if self._lives(track, scan)]
        self._merge()
        self._begin(points, owner < 0, scan, look)

    def _unexplained(self, scan: CheckedScan, world: WorldMap, stood: Mask, static: Mask) -> Points:
        """Points that are neither mapped furniture nor known to stand; those of who stands but has moved stay in."""
        p = self.parameters
        beam = np.flatnonzero(scan.ranges < min(p.reach, scan.range_max))
        reach = scan.ranges[beam]
        at = scan.origin + reach[:, None] * scan.directions[beam]
        known = self._base_map(world)
        cell = known.grid.cell_of(at)
        inside = ((cell >= 0) & (cell < np.array(known.grid.shape))).all(axis=1)
        at, beam, reach, cell = at[inside], beam[inside], reach[inside], cell[inside]
        by_stood, by_static = beside(
            at, world.seen_points, stood, static, world.origin, world.resolution, world.occupied.shape
        )
        free = known.visible_distance[cell[:, 0], cell[:, 1]] > p.explained
        free &= ~by_stood | self._near_tracks(at, world.resolution)
        return Points(np.ascontiguousarray(at[free]), beam[free], reach[free], by_static[free])

    def _near_tracks(self, at: Array, slack: float) -> Mask:
        """Which points (n, 2) are within ``slack`` [m] of a track that has moved: it may set off again; shape (n,)."""
        near = np.zeros(len(at), dtype=bool)
        for track in self._state.tracks:
            if track.moved > -math.inf:
                near |= np.hypot(*(at - track.state[:2]).T) <= track.radius + slack
        return near

    def _share(self, at: Array, owner: NDArray[np.int64], alone: Mask, scan: CheckedScan) -> None:
        """Give all of a segment (n, 2) to the only track that has points in it, if it may be one thing."""
        p = self.parameters
        tracks = np.unique(owner[owner >= 0])
        if len(tracks) > 1:
            alone[tracks] = False
        elif len(tracks) == 1:
            if seen_width(at, scan.origin) <= p.radius_max:
                owner[:] = tracks[0]
            else:
                alone[tracks] = False

    def _merge(self) -> None:
        """Of two tracks whose middles are as near as no two of anything can be, keep the older."""
        kept: list[Track] = []
        for track in self._state.tracks:
            if all(math.dist(track.state[:2], other.state[:2]) > self.parameters.merges for other in kept):
                kept.append(track)
        self._state.tracks = kept

    def _correct(self, track: Track, own: Array, scan: CheckedScan, *, alone: bool, partly: bool) -> None:
        """Correct a track with its points (n, 2).

        ``alone``: its segment shows nothing else; ``partly``: something nearer hides one side of it.
        """
        p = self.parameters
        middle = fitted_circle(own, track.state[:2], track.radius)
        if alone:
            least = track.radius if partly else p.radius_min
            wanted = min(max(seen_width(own, scan.origin), least), p.radius_max)
            track.radius += (0.5 if wanted > track.radius else p.shares) * (wanted - track.radius)
            before, middle = middle, fitted_circle(own, track.state[:2], track.radius)
            track.state[:2] += middle - before  # more of it is seen: that is no motion
        if is_behind(own, middle, scan.origin, track.radius):
            before, middle = middle, front_circle(own, scan.origin, track.radius)
            track.state[:2] += middle - before
        _update(track.state, track.covariance, middle, p.noise**2)
        track.covers = float(np.hypot(own[:, 0] - track.state[0], own[:, 1] - track.state[1]).max()) - p.noise
        track.seen = scan.stamp
        track.hits += 1

    def _judge(self, track: Track, here: Place, now: float) -> None:
        """Say if a track moves: it is fast enough, has left its place, or moved lately; two of these three.

        One that has stopped among what is static never moved: it is a side of that, and the pose was off.
        """
        p, before = self.parameters, track.place
        fast = math.hypot(track.state[2], track.state[3]) >= p.moves
        unsettled = self._phase(track, now) in (Phase.MOVING, Phase.WAITING)
        if not fast and not unsettled:
            return
        left = (
            passed(before.points, *here.look, _OFF, _ASTRAY) >= p.points
            or passed(here.points, *before.look, _OFF, _ASTRAY) >= p.points
        )
        if left or (fast and unsettled):
            track.moved, track.place = now, here
        elif unsettled and now - track.moved > p.settles and track.static:
            track.moved, track.place = -math.inf, here

    def _lives(self, track: Track, scan: CheckedScan) -> bool:
        """It was seen lately, or something nearer hides it."""
        p, silent = self.parameters, scan.stamp - track.seen
        if silent <= 0.0:
            return True
        if track.hits < p.hits:
            return silent <= 0.1
        if not self._is_hidden(track, scan):
            return silent <= p.unseen
        return silent <= (p.rests if self._waits_unseen(track, scan.stamp) else p.hidden)

    def _waits_unseen(self, track: Track, stamp: float) -> bool:
        """It was not seen in the scan of this time [s], and waited when it was seen last: it is still there."""
        return track.seen < stamp and self._phase(track, track.seen) == Phase.WAITING

    @staticmethod
    def _is_hidden(track: Track, scan: CheckedScan) -> bool:
        """Most beams that would meet it end before it."""
        x, y = (track.state[:2] - scan.origin).tolist()
        away = math.hypot(x, y)
        if away <= track.radius:
            return False
        ahead, across = scan.directions[:, 0], scan.directions[:, 1]
        towards = (np.abs(ahead * y - across * x) < track.radius) & (ahead * x + across * y > 0.0)
        return bool(np.count_nonzero(scan.ranges[towards] < away - track.radius) >= 0.5 * np.count_nonzero(towards))

    def _begin(self, points: Points, left: Mask, scan: CheckedScan, look: Look) -> None:
        """Begin a track with each segment of the points that are left, if it may be somebody."""
        p, state = self.parameters, self._state
        rest = Points(points.at[left], points.beam[left], points.reach[left], points.static[left])
        ends: list[Disc] = []
        for start, end in segments(rest, p.gap):
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
            variance = p.noise**2
            covariance = np.diag([variance, variance, p.first_speed**2, p.first_speed**2])
            first, place = np.array([*middle, 0.0, 0.0]), Place(own, look)
            track = Track(state.next_identity, first, covariance, radius, place, scan.stamp)
            track.static = _most(rest.static[start:end])
            state.tracks.append(track)
            state.next_identity += 1
        state.ends = tuple(ends)


@njit(cache=True)
def _predict(state: Array, covariance: Array, dt: float, density: float) -> None:
    """Move a track on by dt [s], with white acceleration of this density [m^2/s^3]."""
    for axis in range(2):
        state[axis] += dt * state[2 + axis]
    for axis in range(2):
        i, k = axis, 2 + axis
        pp, pv, vv = covariance[i, i], covariance[i, k], covariance[k, k]
        covariance[i, i] = pp + 2.0 * dt * pv + dt * dt * vv + density * dt**3 / 3.0
        covariance[i, k] = pv + dt * vv + density * dt * dt / 2.0
        covariance[k, i] = covariance[i, k]
        covariance[k, k] = vv + density * dt


@njit(cache=True)
def _update(state: Array, covariance: Array, middle: Array, variance: float) -> None:
    """Correct a track with a measured middle (2,); both axes are independent."""
    for axis in range(2):
        i, k = axis, 2 + axis
        pp, pv = covariance[i, i], covariance[i, k]
        gain_p, gain_v = pp / (pp + variance), pv / (pp + variance)
        off = middle[axis] - state[i]
        state[i] += gain_p * off
        state[k] += gain_v * off
        covariance[k, k] -= gain_v * pv
        covariance[i, k] = pv * (1.0 - gain_p)
        covariance[k, i] = covariance[i, k]
        covariance[i, i] = pp * (1.0 - gain_p)


@njit(cache=True)
def goes_on_hidden(beam: NDArray[np.int64], reach: Array, ranges: Array, gap: float) -> bool:
    """Something nearer by ``gap`` [m] ends a segment, in the order of the beams, on one of its sides."""
    for end, step in ((0, -1), (beam.shape[0] - 1, 1)):
        for k in range(1, BEAMS_LOST + 1):
            other = beam[end] + k * step
            if 0 <= other < ranges.shape[0] and ranges[other] < reach[end] - gap:
                return True
    return False


def standing(world: WorldMap, movers: Array, parameters: TrackParameters) -> Mask:
    """Which seen points of the map do not belong to one of these movers (k, 5 or more), shape (m,)."""
    rows = movers[:, :5].copy()  # neither a slice nor read-only: one kernel for all
    return world.seen_static | ~on_ways(world.seen_points, rows, parameters.trail, parameters.rim)


@njit(cache=True)
def passed(points, origin, first, step, ranges, margin, turn):
    """Number of points (n, 2) [m] that all beams of a scan near them went past, by ``margin`` [m] at least.

    ``turn`` [rad]: the points' bearings may be off by this, and by the margin. ``first``, ``step`` [rad]: the beams'
    bearings; a beam of nan says nothing.
    """
    count, beams = 0, ranges.shape[0]
    for i in range(points.shape[0]):
        x, y = points[i, 0] - origin[0], points[i, 1] - origin[1]
        away = max(math.sqrt(x * x + y * y), margin)
        ahead = (math.atan2(y, x) - first) / step
        half = (turn + margin / away) / step
        free = True
        for k in range(math.floor(ahead - half), math.ceil(ahead + half) + 1):
            beam = k % round(2.0 * math.pi / step)
            free = free and beam < beams and ranges[beam] > away + margin
        count += free
    return count


def _expected(track: Track, ahead: float) -> tuple[float, float]:
    """Place [m] of a track ``ahead`` [s] of the newest scan."""
    x, y, vx, vy = track.state.tolist()
    return x + ahead * vx, y + ahead * vy


def _most(mask: Mask) -> bool:
    """More than half of them are set."""
    return bool(2 * np.count_nonzero(mask) > len(mask))


def segments(points: Points, gap: float) -> list[tuple[int, int]]:
    """First and last + 1 of each segment's points: neighbours are no farther apart than ``gap`` [m], 8 m away twice."""
    if not len(points.at):
        return []
    apart = np.hypot(*np.diff(points.at, axis=0).T) > gap * (1.0 + points.reach[1:] / 8.0)
    cuts = np.flatnonzero(apart | (np.diff(points.beam) > BEAMS_LOST)) + 1
    return list(itertools.pairwise([0, *cuts.tolist(), len(points.at)]))
