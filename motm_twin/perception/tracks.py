"""Tracks of dynamic obstacles from single lidar scans: who is where, how fast, and how sure that is.

Each track is a disc with a constant-velocity Kalman filter. The points of a scan that neither mapped furniture nor what
is known to stand explains go to the track on whose rim they lie, point by point, so that two who stand side by side
stay two; a circle of the known radius is fitted to them. What is left over is cut into segments, each of which begins a
track. A track that is hidden behind something nearer lives on for a while, one that the beams pass through does not.
"""

import itertools
import math
from dataclasses import dataclass, field
from typing import Annotated, NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from motm_twin.model.compiler import njit
from motm_twin.model.geometry import Array, frozen
from motm_twin.model.known import KnownWorld
from motm_twin.model.number import OWN, Number
from motm_twin.model.state import Stateful
from motm_twin.perception.base_map import BaseMap, base_map
from motm_twin.perception.scan import CheckedScan
from motm_twin.perception.world_map import NO_TRACKS, WorldMap

X, Y, VX, VY, RADIUS, SD, IDENTITY = range(7)  # columns of `WorldMap.tracks`


BEAMS_LOST = 3  # between two points of one segment: a few say nothing


class TrackParameters(msgspec.Struct, frozen=True, kw_only=True):
    """Parameters of the tracks of dynamic obstacles: sizes and speeds are those of persons and Temis."""

    reach: Annotated[float, Number("m", OWN, "farther points are left out: too few beams meet a leg there")] = 8.0
    explained: Annotated[float, Number("m", OWN, "from mapped furniture, within which a point belongs to it")] = 0.10
    rim: Annotated[float, Number("m", OWN, "from the rim of a track, within which a point may belong to it")] = 0.15
    points: Annotated[int, Number("", OWN, "of a scan that make a measurement")] = 3
    gap: Annotated[float, Number("m", OWN, "between neighbouring points of one segment, and as much again in 8 m")] = (
        0.1
    )
    merges: Annotated[float, Number("m", OWN, "between the middles of two tracks: nearer ones are one")] = 0.25
    radius_min: Annotated[float, Number("m", OWN, "of a track")] = 0.10
    radius_max: Annotated[float, Number("m", OWN, "of a new track: what is wider is furniture")] = 0.40
    shares: Annotated[float, Number("", OWN, "by which the radius follows what is seen of one that stands alone")] = 0.1
    acceleration: Annotated[
        float, Number("m/s^2", OWN, "standard deviation, for 0.1 s: of a person who sets off, or turns")
    ] = 1.0
    noise: Annotated[float, Number("m", OWN, "of a fitted middle")] = 0.03
    first_speed: Annotated[float, Number("m/s", OWN, "standard deviation of the velocity of a new track")] = 0.7
    hits: Annotated[int, Number("", OWN, "scans in which a track must be seen to count")] = 4
    hidden: Annotated[float, Number("s", OWN, "that a track lives on behind something nearer")] = 2.0
    unseen: Annotated[float, Number("s", OWN, "the same where nothing hides it")] = 0.3
    moves: Annotated[float, Number("m/s", OWN, "from which a track moves")] = 0.10
    leaves: Annotated[float, Number("m", OWN, "from its place, beyond which it does")] = 0.15
    sure: Annotated[float, Number("", OWN, "standard deviations of the speed beyond which it does, too")] = 2.5
    rests: Annotated[float, Number("s", OWN, "slower than that after which it is furniture, and no track")] = 12.0


@dataclass
class Track:
    """One track."""

    identity: int
    state: Array  # x, y [m], velocity [m/s], shape (4,)
    covariance: Array  # shape (4, 4)
    radius: float  # [m] of the circle that is fitted
    place: Array  # where it was when it rested last [m], shape (2,)
    seen: float  # [s]
    covers: float = 0.0  # [m] from its middle to the farthest of the points that were last seen of it
    hits: int = 1
    moving: bool = False
    moved: float = -math.inf  # [s] last time that it was as fast as something that moves


@dataclass
class TrackState:
    """State between scans."""

    stamp: float | None = None
    tracks: list[Track] = field(default_factory=list)
    next_identity: int = 1


class Points(NamedTuple):
    """Points of a scan that nothing explains, in the order of the beams."""

    at: Array  # [m], shape (n, 2)
    beam: NDArray[np.int64]  # shape (n,)
    reach: Array  # [m] from the sensor, shape (n,)


class DynamicTracker(Stateful[TrackState]):
    """Follows dynamic obstacles from scan to scan."""

    def __init__(self, known: KnownWorld, parameters: TrackParameters | None = None) -> None:
        self.parameters, self._known = parameters or TrackParameters(), known
        self._base: BaseMap | None = None
        self._state = TrackState()

    def update(self, scan: CheckedScan | None, world: WorldMap) -> WorldMap:
        """The map with its tracks at its time. ``scan``: a new one that the map has taken in; None: there is none."""
        if scan is not None:
            self._take(scan, world)
        found = self._rows(world.stamp)
        return msgspec.structs.replace(world, tracks=frozen(np.array(found)) if found else NO_TRACKS)

    def _rows(self, now: float) -> list[tuple[float, ...]]:
        """Those that count and move, at a time [s]; none once no scan has come for so long that they would be over."""
        p, state = self.parameters, self._state
        if state.stamp is None or now - state.stamp > p.hidden:
            return []
        rows = []
        for track in state.tracks:
            if not track.moving or track.hits < p.hits:
                continue
            ahead = now - state.stamp
            x, y, vx, vy = track.state.tolist()
            c = track.covariance
            variance = c[0, 0] + c[1, 1] + 2.0 * ahead * (c[0, 2] + c[1, 3]) + ahead * ahead * (c[2, 2] + c[3, 3])
            sd = math.sqrt(max(0.5 * float(variance), 0.0))
            place = (x + ahead * vx, y + ahead * vy)
            rows.append((*place, vx, vy, max(track.radius, track.covers), sd, float(track.identity)))
        return rows

    def _take(self, scan: CheckedScan, world: WorldMap) -> None:
        """Predict, give the points to the tracks, correct these, begin new ones, and end what is gone."""
        p, state = self.parameters, self._state
        dt = 0.0 if state.stamp is None else scan.stamp - state.stamp
        if not 0.0 <= dt <= p.hidden:
            state.tracks, dt = [], 0.0
        state.stamp = scan.stamp
        for track in state.tracks:
            _predict(track.state, track.covariance, dt, p.acceleration**2 * 0.1)
        points = self._unexplained(scan, world)
        circles = np.array([(*track.state[:2].tolist(), track.radius) for track in state.tracks]).reshape(-1, 3)
        owner = owners(points.at, circles, p.rim)
        alone = np.ones(len(state.tracks), dtype=bool)  # no other track is seen in the same segment
        partly = np.zeros(len(state.tracks), dtype=bool)  # something nearer hides one side of it
        for start, end in segments(points, p.gap):
            self._share(points.at[start:end], owner[start:end], alone, scan)
            if goes_on_hidden(points.beam[start:end], points.reach[start:end], scan.ranges, p.gap):
                partly[owner[start:end][owner[start:end] >= 0]] = True
        for k, track in enumerate(state.tracks):
            self._correct(track, points.at[owner == k], scan, alone=bool(alone[k]), partly=bool(partly[k]))
        state.tracks = [track for track in state.tracks if self._lives(track, scan)]
        self._merge()
        self._begin(points, owner < 0, scan)

    def _unexplained(self, scan: CheckedScan, world: WorldMap) -> Points:
        """Points that are neither mapped furniture nor known to stand; those of who stands but has moved stay in."""
        p = self.parameters
        beam = np.flatnonzero(scan.ranges < min(p.reach, scan.range_max))
        reach = scan.ranges[beam]
        at = scan.origin + reach[:, None] * scan.directions[beam]
        known = self._base = self._base or base_map(self._known, world.resolution)
        cell = known.grid.cell_of(at)
        inside = ((cell >= 0) & (cell < np.array(known.grid.shape))).all(axis=1)
        at, beam, reach, cell = at[inside], beam[inside], reach[inside], cell[inside]
        free = known.visible_distance[cell[:, 0], cell[:, 1]] > p.explained
        free &= ~_known_to_stand(at, world) | self._near_tracks(at, world.resolution)
        return Points(np.ascontiguousarray(at[free]), beam[free], reach[free])

    def _near_tracks(self, at: Array, slack: float) -> NDArray[np.bool_]:
        """Which points (n, 2) are within ``slack`` [m] of a track that has moved: it may set off again; shape (n,)."""
        near = np.zeros(len(at), dtype=bool)
        for track in self._state.tracks:
            if track.moved > -math.inf:
                near |= np.hypot(*(at - track.state[:2]).T) <= track.radius + slack
        return near

    def _share(self, at: Array, owner: NDArray[np.int64], alone: NDArray[np.bool_], scan: CheckedScan) -> None:
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
        if len(own) < p.points:
            return
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
        self._judge(track, scan.stamp)

    def _judge(self, track: Track, now: float) -> None:
        """Say if it moves: it is fast enough, and has left its place or is surely fast; or it was just now."""
        p = self.parameters
        speed = math.hypot(track.state[2], track.state[3])
        sure = speed > p.sure * math.sqrt(max(track.covariance[2, 2], track.covariance[3, 3]))
        away = math.hypot(track.state[0] - track.place[0], track.state[1] - track.place[1]) > p.leaves
        if speed >= p.moves and (away or sure):
            track.moving, track.moved = True, now
        elif now - track.moved > p.rests:
            if track.moving or track.hits <= p.hits:
                track.place = track.state[:2].copy()
            track.moving = False

    def _lives(self, track: Track, scan: CheckedScan) -> bool:
        """It was seen lately, or something nearer hides it."""
        p, silent = self.parameters, scan.stamp - track.seen
        if silent <= 0.0:
            return True
        if track.hits < p.hits:
            return silent <= 0.1
        return silent <= (p.hidden if self._is_hidden(track, scan) else p.unseen)

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

    def _begin(self, points: Points, left: NDArray[np.bool_], scan: CheckedScan) -> None:
        """Begin a track with each segment of the points that are left, if it may be somebody."""
        p, state = self.parameters, self._state
        rest = Points(points.at[left], points.beam[left], points.reach[left])
        for start, end in segments(rest, p.gap):
            own = rest.at[start:end]
            width = seen_width(own, scan.origin)
            if len(own) < p.points or width > p.radius_max:
                continue
            radius = max(width, p.radius_min)
            middle = front_circle(own, scan.origin, radius)
            if any(math.dist(middle, other.state[:2]) < other.radius + p.radius_min for other in state.tracks):
                continue
            variance = p.noise**2
            covariance = np.diag([variance, variance, p.first_speed**2, p.first_speed**2])
            track = Track(state.next_identity, np.array([*middle, 0.0, 0.0]), covariance, radius, middle, scan.stamp)
            state.tracks.append(track)
            state.next_identity += 1


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
def owners(points: Array, circles: Array, rim: float) -> NDArray[np.int64]:
    """Index of the circle (k, 3) on whose rim each point (n, 2) lies nearest, within ``rim`` [m]; -1: on none; (n,)."""
    owner = np.full(points.shape[0], -1)
    for i in range(points.shape[0]):
        least = rim
        for k in range(circles.shape[0]):
            away = math.hypot(points[i, 0] - circles[k, 0], points[i, 1] - circles[k, 1]) - circles[k, 2]
            if abs(away) < least:
                least, owner[i] = abs(away), k
    return owner


@njit(cache=True)
def fitted_circle(points: Array, start: Array, radius: float) -> Array:
    """Middle (2,) of the circle of this radius [m] through the points (n, 2), by Gauss-Newton from a start (2,).

    Where the points leave it open, along the arc, it stays at the start.
    """
    x, y = start[0], start[1]
    stay = 0.1 * points.shape[0]
    for _ in range(6):
        a, b, c, d, e = stay, 0.0, stay, stay * (x - start[0]), stay * (y - start[1])
        for i in range(points.shape[0]):
            dx, dy = x - points[i, 0], y - points[i, 1]
            away = max(math.hypot(dx, dy), 1e-6)
            dx, dy, off = dx / away, dy / away, away - radius
            a, b, c, d, e = a + dx * dx, b + dx * dy, c + dy * dy, d + dx * off, e + dy * off
        determinant = a * c - b * b
        x -= (c * d - b * e) / determinant
        y -= (a * e - b * d) / determinant
    return np.array([x, y])


@njit(cache=True)
def seen_width(points: Array, sensor: Array) -> float:
    """Half the width [m] of points (n, 2) across the line of sight."""
    x, y = 0.0, 0.0
    for i in range(points.shape[0]):
        x, y = x + points[i, 0] - sensor[0], y + points[i, 1] - sensor[1]
    away = max(math.hypot(x, y), 1e-9)
    x, y = x / away, y / away
    least, most = math.inf, -math.inf
    for i in range(points.shape[0]):
        across = (points[i, 1] - sensor[1]) * x - (points[i, 0] - sensor[0]) * y
        least, most = min(least, across), max(most, across)
    return 0.5 * (most - least)


@njit(cache=True)
def front_circle(points: Array, sensor: Array, radius: float) -> Array:
    """Middle (2,) of the circle of this radius [m] of which the points (n, 2) are the side that the sensor sees."""
    x, y, nearest = 0.0, 0.0, math.inf
    for i in range(points.shape[0]):
        x, y = x + points[i, 0] - sensor[0], y + points[i, 1] - sensor[1]
    away = max(math.hypot(x, y), 1e-9)
    ahead = np.array([x / away, y / away])
    for i in range(points.shape[0]):
        nearest = min(nearest, (points[i, 0] - sensor[0]) * ahead[0] + (points[i, 1] - sensor[1]) * ahead[1])
    return fitted_circle(points, sensor + (nearest + radius) * ahead, radius)


@njit(cache=True)
def is_behind(points: Array, middle: Array, sensor: Array, radius: float) -> bool:
    """The sensor is outside a fitted circle, and the points (n, 2) are on its far side, which cannot be seen.

    The fit is then on the wrong side of the points, after somebody was at the sensor's own position.
    """
    dx, dy = middle[0] - sensor[0], middle[1] - sensor[1]
    away, total = math.hypot(dx, dy), 0.0
    for i in range(points.shape[0]):
        total += (points[i, 0] - middle[0]) * dx + (points[i, 1] - middle[1]) * dy
    return away > radius and total > 0.0


@njit(cache=True)
def goes_on_hidden(beam: NDArray[np.int64], reach: Array, ranges: Array, gap: float) -> bool:
    """Something nearer by ``gap`` [m] ends a segment, in the order of the beams, on one of its sides."""
    for end, step in ((0, -1), (beam.shape[0] - 1, 1)):
        for k in range(1, BEAMS_LOST + 1):
            other = beam[end] + k * step
            if 0 <= other < ranges.shape[0] and ranges[other] < reach[end] - gap:
                return True
    return False


def _known_to_stand(at: Array, world: WorldMap) -> NDArray[np.bool_]:
    """Which points (n, 2) are in or beside a cell of the map that is known to stand; shape (n,)."""
    stands = np.zeros((world.occupied.shape[0] + 2, world.occupied.shape[1] + 2), dtype=bool)
    row, column = _cells(world.seen_points[world.seen_static], world)
    for down in range(3):
        for right in range(3):
            stands[row + down, column + right] = True
    row, column = _cells(at, world) + 1
    within = (row >= 0) & (column >= 0) & (row < stands.shape[0]) & (column < stands.shape[1])
    found = np.zeros(len(at), dtype=bool)
    found[within] = stands[row[within], column[within]]
    return found


def _cells(points: Array, world: WorldMap) -> NDArray[np.int64]:
    """Rows and columns of points (n, 2) in the map, shape (2, n)."""
    return np.floor((points - world.origin).T[::-1] / world.resolution).astype(np.int64)


def segments(points: Points, gap: float) -> list[tuple[int, int]]:
    """First and last + 1 of each segment's points: neighbours are no farther apart than ``gap`` [m], 8 m away twice."""
    if not len(points.at):
        return []
    apart = np.hypot(*np.diff(points.at, axis=0).T) > gap * (1.0 + points.reach[1:] / 8.0)
    cuts = np.flatnonzero(apart | (np.diff(points.beam) > BEAMS_LOST)) + 1
    return list(itertools.pairwise([0, *cuts.tolist(), len(points.at)]))
