"""Dynamic obstacles: clusters of seen cells followed from map to map, as discs with a velocity."""

import math
from dataclasses import dataclass, field
from typing import Annotated

import msgspec
import numpy as np
from numpy.typing import NDArray

from motm_twin.model.exact import dot
from motm_twin.model.geometry import Array, from_frame
from motm_twin.model.number import OWN, Number
from motm_twin.model.plant import LONGEST_PERIOD
from motm_twin.model.profile import RobotProfile
from motm_twin.model.state import Stateful
from motm_twin.perception.cell_times import AROUND, CellTimes, Mask, Numbers, among, cell_numbers
from motm_twin.perception.clusters import cells_of, touching
from motm_twin.perception.discs import Disc, apart, at_ends, behind, disc_from_front, share_gone
from motm_twin.perception.mapper import MapSettings
from motm_twin.perception.world_map import NO_AGES, NO_MOVERS, NO_POINTS, WorldMap

_ASTRAY = MapSettings().explained_per_range  # [rad] by which the heading is off at most
_REMEMBERS = MapSettings().static_after  # [s] free of it after which a static cell is no longer one


class MoverParameters(msgspec.Struct, frozen=True, kw_only=True):
    """Parameters that tell moving obstacles from standing ones. Choices of this project.

    Sizes, speeds and times are those of persons and Temis, of the lidar and the map, whatever the robot is; only how
    near is near depends on it.
    """

    join_cells: Annotated[int, Number("", OWN, "cells at most this far apart belong to one thing")] = 2
    smallest: Annotated[int, Number("", OWN, "cells of a thing: less is noise")] = 3
    radius_min: Annotated[float, Number("m", OWN, "of a thing")] = 0.10
    radius_max: Annotated[
        float, Number("m", OWN, "what is wider is two things side by side, or furniture, and no mover")
    ] = 0.45
    end_radius: Annotated[
        float, Number("m", OWN, "at the ends of what is wide and may move, a Temi's: two side by side are one cluster")
    ] = 0.25
    gate: Annotated[float, Number("m", OWN, "between where a thing is expected and where it is seen")] = 0.35
    alpha: Annotated[float, Number("", OWN, "gain of the position per map of 50 ms")] = 0.5
    beta: Annotated[float, Number("", OWN, "gain of the velocity: its error halves in 0.2 s")] = 0.08
    creeps: Annotated[
        float, Number("m", OWN, "from its place, or of radius: it is not yet static; twice as far, it has moved")
    ] = 0.05
    strays: Annotated[
        float, Number("s", OWN, "that it must be elsewhere for: a single wrong hit stays in the map for 0.3 s")
    ] = 0.4
    settles: Annotated[
        float, Number("s", OWN, "without motion, after which it stands; its middle is taken over as long")
    ] = 2.0
    young: Annotated[float, Number("s", OWN, "that it must have been there for: what has just appeared flickers")] = 0.2
    gone: Annotated[
        float, Number("", OWN, "share of its place where nothing is seen any more, from which on it has")
    ] = 0.5
    rests: Annotated[
        float, Number("s", OWN, "that something must be static for, until what hangs together with it belongs to it")
    ] = 3.5
    waits: Annotated[
        float, Number("s", OWN, "in the same place after which what has moved is static: one that waits leaves sooner")
    ] = 12.0
    lost_after: Annotated[
        float, Number("s", OWN, "out of sight: a thing is forgotten, or no longer shows where its sides are")
    ] = 0.5
    trail: Annotated[float, Number("s", OWN, "of its way behind a mover that seen cells may still be on")] = 0.4
    beside: Annotated[
        float, Number("", OWN, "share of a thing that is static, or beside it, from which on all of it is")
    ] = 0.9
    near_time: Annotated[
        float,
        Number(
            "s",
            OWN,
            "of driving at full speed up to which a mover is in the way as it is: it may not have moved on by then",
        ),
    ] = 4.0
    parted: Annotated[float, Number("", OWN, "times as far, beyond which it no longer is")] = 1.3
    edge: Annotated[float, Number("m", OWN, "round a mover that seen cells belong to it")] = 0.12


class Place(msgspec.Struct, frozen=True, eq=False):
    """Place of a thing when it was last seen to move or to grow."""

    time: float  # [s]
    middle: Array  # [m], shape (2,)
    radius: float  # [m]
    points: Array  # [m], shape (n, 2): where it was seen


@dataclass
class Track:
    """A thing that is followed."""

    position: Array  # of its middle [m], shape (2,)
    velocity: Array  # [m/s], shape (2,)
    radius: float  # [m]
    seen: float  # [s] last time
    moved: float | None = None  # [s] last time that it moved
    wide: bool = False  # two things side by side, or furniture: its middle is no point of it
    near: bool = False  # in the way
    place: Place | None = None  # where it is, as long as it does not move and no more of it is seen
    rest: Place | None = None  # where it is, as long as it does not even creep
    strayed: float | None = None  # [s] since when it has been elsewhere


@dataclass
class MoverState:
    """State between maps."""

    time: float | None = None
    tracks: list[Track] = field(default_factory=list)
    static: CellTimes = field(default_factory=CellTimes)  # cells that are known to be, and since when
    held: CellTimes = field(default_factory=CellTimes)  # cells that can not be yet, and till when
    came: Numbers = field(default_factory=lambda: np.zeros(0, dtype=np.int64))  # static ones whose thing has moved
    lately: CellTimes = field(default_factory=CellTimes)  # cells that are static when they are hit again, till when


class Seen(msgspec.Struct, frozen=True, eq=False):
    """One cluster: middle [m] (2,) and radius [m]."""

    middle: Array
    radius: float
    points: NDArray[np.int64]  # which of the seen points of the map it is made of


Pair = tuple[Track, Seen]
Cells = NDArray[np.int32]  # row and column, shape (m, 2)


class MoverTracker(Stateful[MoverState]):
    """Follows what is not static from map to map."""

    def __init__(self, parameters: MoverParameters | None = None, robot: RobotProfile | None = None) -> None:
        robot, self.parameters = robot or RobotProfile(), parameters or MoverParameters()
        p = self.parameters
        stops = robot.footprint.outer + p.radius_max + robot.base.stopping_way + p.radius_max
        self.near = max(p.near_time * robot.base.full_speed, stops)  # [m] from the base; 2.0 m for Frankie
        self._lidar = np.array([robot.lidar.x, robot.lidar.y])  # [m] in the base frame
        self._state = MoverState()

    def sort(self, world: WorldMap, pose: Array) -> WorldMap:
        """The map with its movers. Static in it is what was hit for 3 s, unless it has moved and not rested since.

        The cells of a thing that comes to rest were hit while it was still coming. Noise at the edge of a box and its
        sides that come into sight belong to the box.

        ``pose`` of the base, shape (3,).
        """
        state, p, viewpoint = self._state, self.parameters, from_frame(pose, self._lidar)
        dt = 0.0 if state.time is None else world.stamp - state.time
        if dt < 0.0 or dt > p.lost_after:
            state.tracks, dt = [], 0.0
        state.time = world.stamp
        for track in state.tracks:
            track.position = track.position + dt * track.velocity
        cells = cell_numbers(world)
        since = state.static.of(cells, math.inf)  # [s] it has been static
        held = state.held.has(cells)
        grid = cells_of(world.seen_points, world.origin, world.resolution)
        furniture = self._furniture(world, cells, grid, since, held)
        seen = self._clusters(world, grid, np.flatnonzero(~furniture), viewpoint)
        pairs = self._correct(seen, world.stamp, dt)
        state.tracks = [track for track in state.tracks if world.stamp - track.seen <= p.lost_after]
        for track, one in pairs:
            self._judge(track, one, world, viewpoint, dt)
        self._release(pairs, cells, grid, since, world)
        self._mark_near(pose[:2])
        unsettled = [(track, one) for track, one in pairs if self._unsettled(track)]
        places = [(cells[one.points], track.rest.time) for track, one in unsettled if track.rest is not None]
        places += [(cells[one.points], world.stamp) for one in self._absorbing(pairs, world)]
        self._hold(places, world.stamp)
        static = self._static(world, cells, furniture, since)
        static.setflags(write=False)
        found = [
            (*track.position, *track.velocity, track.radius, track.near)
            for track in state.tracks
            if self._moving(track) and not track.wide
        ]
        movers = np.array(found) if found else NO_MOVERS
        return msgspec.structs.replace(
            world,
            seen_static=static,
            seen_age=NO_AGES,
            movers=movers,
            hidden=behind(self._hidden(pairs, unsettled, static, world, viewpoint), viewpoint),
        )

    def _hidden(
        self, pairs: list[Pair], unsettled: list[Pair], static: Mask, world: WorldMap, viewpoint: Array
    ) -> list[Disc]:
        """The discs of what may be moving, of which the far sides are not seen."""
        p = self.parameters
        loose = [pair for pair in pairs if _share(static, pair[1].points) < p.beside]
        young = [(track, one) for track, one in loose if not track.wide and track.moved is None]
        discs = [(*track.position.tolist(), track.radius) for track, _ in unsettled + young]
        for track, one in loose:
            if track.wide:
                discs += at_ends(world.seen_points[one.points], p.end_radius, viewpoint)
        return discs

    def _furniture(self, world: WorldMap, cells: Numbers, grid: Cells, since: Array, held: Mask) -> Mask:
        """Cells that have long been static, or are connected to such and never moved: not tracked; shape (m,) of bool.

        Sides of furniture that come into and out of sight look like something small that slides along it. Something
        that has really come nearer hides all of its former place.
        """
        state, p = self._state, self.parameters
        long = since <= world.stamp - p.rests
        anchors = long & (world.seen_age <= p.lost_after) & ~among(state.came, cells)
        return long | touching(grid, anchors, ~held, p.join_cells)

    def _static(self, world: WorldMap, cells: Numbers, furniture: Mask, since: Array) -> Mask:
        """Cells that are static, or were lately, shape (m,); but none that has moved and not rested since."""
        state, now = self._state, world.stamp
        held = state.held.has(cells)
        static = (world.seen_static | furniture | (since < math.inf)) & ~held
        static |= since <= now - self.parameters.rests
        state.static = CellTimes().also(cells[static], np.where(since < math.inf, since, now)[static])
        if len(state.came):
            state.came = state.came[state.static.has(state.came)]
        static |= state.lately.has(cells) & ~held
        lately = cells[static]
        until = np.full(len(lately), now + _REMEMBERS)
        state.lately = state.lately.also(lately, until).after(now)
        return static

    def _judge(self, track: Track, seen: Seen, world: WorldMap, viewpoint: Array, dt: float) -> None:
        """Decide if a thing has left its place: its middle is elsewhere, and most of it is no longer seen where it was.

        What comes into sight bit by bit, or goes out of it, shifts its middle too: to the side by half of what appears,
        and in depth by as much, since a thing is taken to be as deep as it is wide. But nothing of it is gone. A wrong
        heading shifts all of it, the farther away the more.
        """
        p, place = self.parameters, track.place
        moved, limit = False, 2.0 * p.creeps + _ASTRAY * math.dist(viewpoint, track.position)
        if place is not None and world.stamp - place.time >= p.young and _away(track, seen, place, limit):
            own, (x, y) = world.seen_points[seen.points], viewpoint.tolist()
            moved = share_gone(place.points, world.seen_points, own, x, y) > p.gone
        if moved and not track.wide:
            track.moved = world.stamp
        elsewhere = place is None or moved or track.wide or seen.radius > place.radius + p.creeps
        if place is None or elsewhere or self._has_settled(track, world.stamp):
            place = Place(world.stamp, track.position, seen.radius, world.seen_points[seen.points])
        track.place = place
        if track.rest is None or not _away(track, seen, track.rest, p.creeps):
            track.strayed = None
        elif track.strayed is None:
            track.strayed = world.stamp
        strayed = track.strayed is not None and world.stamp - track.strayed >= p.strays
        if track.rest is None or elsewhere or strayed:
            track.rest, track.strayed = Place(world.stamp, track.position, seen.radius, NO_POINTS), None
        elif world.stamp - track.rest.time >= p.settles:
            share = dt / p.settles
            middle = track.rest.middle + share * (track.position - track.rest.middle)
            radius = track.rest.radius + share * (seen.radius - track.rest.radius)
            track.rest = Place(track.rest.time, middle, radius, NO_POINTS)

    def _has_settled(self, track: Track, now: float) -> bool:
        """A thing that moved has been resting just long enough: where it is now is its place.

        Where it was when it was seen to move last is not: it still braked, and some of what was seen was behind it.
        """
        place, rest, settles = track.place, track.rest, self.parameters.settles
        if place is None or rest is None or not self._unsettled(track):
            return False
        return place.time < rest.time + settles <= now

    def _moving(self, track: Track) -> bool:
        now = self._state.time
        return track.moved is not None and now is not None and now - track.moved <= self.parameters.settles

    def _unsettled(self, track: Track) -> bool:
        """It has moved, and has not been in the same place for long since."""
        now = self._state.time
        if track.wide or track.moved is None or track.rest is None or now is None:
            return False
        return now - track.rest.time < self.parameters.waits

    def _release(self, pairs: list[Pair], cells: Numbers, grid: Cells, since: Array, world: WorldMap) -> None:
        """Release a thing seen to move that stands along something static: it is the side of that, the pose was off."""
        state, p, now = self._state, self.parameters, world.stamp
        anchors = grid[(since <= now - p.rests) & (world.seen_age <= p.lost_after)]
        for track, one in pairs:
            if track.moved is None or now - track.moved <= p.settles or track.moved >= now or not len(anchors):
                continue
            apart = np.abs(grid[one.points][:, None] - anchors[None]).max(axis=2).min(axis=1)
            if np.count_nonzero(apart <= p.join_cells) >= p.beside * len(apart):
                track.moved, track.rest, track.strayed = None, None, None
                around = np.unique((cells[one.points][:, None] + AROUND).ravel())
                state.held = state.held.without(around)

    def _absorbing(self, pairs: list[Pair], world: WorldMap) -> list[Seen]:
        """Clusters too wide for a mover that have just absorbed one, whose track is lost."""
        p = self.parameters
        lost = [track for track in self._state.tracks if track.seen < world.stamp and self._unsettled(track)]
        return [
            one
            for track, one in pairs
            if track.wide
            and any(np.any(np.hypot(*(world.seen_points[one.points] - ours.position).T) < p.gate) for ours in lost)
        ]

    def _hold(self, places: list[tuple[Numbers, float]], now: float) -> None:
        """Keep cells of unsettled obstacles from becoming static until they have rested for ``waits`` [s].

        ``places``: cells, and the time [s] since when they have rested at the earliest. An obstacle that passes close
        by merges with another into one cluster, which ends both tracks, but not this memory.
        """
        state, waits = self._state, self.parameters.waits
        if not places and not len(state.held.cells):
            return
        # the next map may have hits beside them
        around = [(cells[:, None] + AROUND).ravel() for cells, _ in places]
        until = [since + waits for _, since in places]
        held = state.held
        if places:
            held = held.also(np.concatenate(around), np.repeat(until, [len(cells) for cells in around]))
        state.held = held.after(now)
        if len(state.held.cells) < len(held.cells):
            state.came = np.union1d(state.came, held.cells[held.times <= now])

    def _mark_near(self, base: Array) -> None:
        """Say which are near, with a hysteresis."""
        for track in self._state.tracks:
            limit = self.parameters.parted * self.near if track.near else self.near
            track.near = math.dist(track.position, base) <= limit

    def _clusters(self, world: WorldMap, grid: Cells, young: NDArray[np.int64], viewpoint: Array) -> list[Seen]:
        """Clusters of those of the seen points, by index."""
        p = self.parameters
        recent = world.seen_age[young] <= LONGEST_PERIOD
        members, ends, front, front_ends = apart(grid[young], recent, p.join_cells, p.smallest)
        points, members = world.seen_points[young[front]], young[members]
        found, start, front_start = [], 0, 0
        for end, front_end in zip(ends.tolist(), front_ends.tolist(), strict=True):
            middle, radius = disc_from_front(points[front_start:front_end], viewpoint, world.resolution)
            found.append(Seen(middle, radius, members[start:end]))
            start, front_start = end, front_end
        return found

    def _correct(self, seen: list[Seen], now: float, dt: float) -> list[Pair]:
        """Give each cluster to the track that expects it nearest; begin tracks for the others. All pairs."""
        p, tracks = self.parameters, self._state.tracks
        expected, middles = [track.position.tolist() for track in tracks], [one.middle.tolist() for one in seen]
        pairs = [(math.dist(b, a), i, k) for i, a in enumerate(expected) for k, b in enumerate(middles)]
        of_track: set[int] = set()
        of_seen: set[int] = set()
        met: list[Pair] = []
        for distance, i, k in sorted(pairs):
            if distance > p.gate or i in of_track or k in of_seen:
                continue
            of_track.add(i)
            of_seen.add(k)
            _follow(tracks[i], seen[k], now, dt, p)
            met.append((tracks[i], seen[k]))
        for k, one in enumerate(seen):
            if k not in of_seen:
                tracks.append(_begun(one, now, p))
                met.append((tracks[-1], one))
        return met


def standing(world: WorldMap, movers: Array, parameters: MoverParameters) -> NDArray[np.bool_]:
    """Which seen points of the map do not belong to one of these movers, shape (m,)."""
    points = world.seen_points
    keep = np.ones(len(points), dtype=bool)
    for x, y, vx, vy, radius in movers[:, :5]:
        way = parameters.trail * np.array([vx, vy])
        offset = points - (np.array([x, y]) - way)
        along = np.clip((offset * way).sum(axis=1) / max(dot(way, way), 1e-9), 0.0, 1.0)
        keep &= np.hypot(*(offset - along[:, None] * way).T) > radius + parameters.edge
    return keep | world.seen_static


def _share(mask: Mask, which: NDArray[np.int64]) -> float:
    """Share of those by index (k,) that are set in the mask (m,)."""
    return np.count_nonzero(mask[which]) / len(which)


def _away(track: Track, seen: Seen, place: Place, limit: float) -> bool:
    """It is farther than this [m] from its place, and not just seen in another way."""
    sight = math.sqrt(2.0) * abs(place.radius - seen.radius)
    return math.dist(track.position, place.middle) > limit + sight


def _begun(seen: Seen, now: float, p: MoverParameters) -> Track:
    """The track of something that is seen for the first time."""
    radius = max(seen.radius, p.radius_min)
    return Track(seen.middle, np.zeros(2), radius, now, wide=radius > p.radius_max)


def _follow(track: Track, seen: Seen, now: float, dt: float, p: MoverParameters) -> None:
    """Correct a track that was moved on already."""
    off = seen.middle - track.position
    track.position = track.position + p.alpha * off
    if dt > 0.0:
        track.velocity = track.velocity + p.beta / dt * off
    track.radius = max(seen.radius, p.radius_min, track.radius + 0.02 * (seen.radius - track.radius))
    track.wide = track.radius > p.radius_max
    track.seen = now
