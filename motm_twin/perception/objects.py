"""Beliefs about the objects: a rough prior at first, then detections of the gripper camera.

Estimates are in the odometry frame: it is smooth, so the arm does not jump when localisation does. But the scale error
of odometry grows with the way that the base drives and turns, so objects not seen for a while follow the world frame,
averaged over localisation. Each object has a Kalman filter with one variance for its three axes. Detections far from
the belief move it only when three of them agree: then the object has been moved.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Annotated

import msgspec
import numpy as np

from motm_twin.model.compiler import njit
from motm_twin.model.exact import wrap_angle
from motm_twin.model.geometry import Array, compose, from_frame, inverse, to_frame
from motm_twin.model.known import KnownWorld
from motm_twin.model.number import OWN, Number
from motm_twin.model.plant import PERIOD, Detection, Observation
from motm_twin.model.state import Stateful
from motm_twin.perception.association import Places

QUARTER = 0.5 * math.pi  # a cube looks the same after a turn of 90 deg


class TrackerSettings(msgspec.Struct, frozen=True, kw_only=True):
    """Parameters of the filter; choices of this project."""

    drift: Annotated[
        float,
        Number(
            "m/sqrt(s)", OWN, "random walk of an object's place in the odometry frame: odometry drift, small pushes"
        ),
    ] = 0.005
    gate: Annotated[
        float, Number("", OWN, "gate for associating a detection with its object, in sd; beyond it, it is an outlier")
    ] = 4.0
    gate_floor: Annotated[float, Number("m", OWN, "added to the gate for associating a detection with its object")] = (
        0.01
    )
    localisation_sd: Annotated[
        float, Number("m", OWN, "sd of localisation when an object is first seen, added to that of its prior")
    ] = 0.03
    agreeing: Annotated[
        int,
        Number("", OWN, "detections at one place that are believed; twice as many while the old place is out of view"),
    ] = 3
    yaw_gain: Annotated[float, Number("", OWN, "share of the yaw error that a detection corrects")] = 0.3
    unseen: Annotated[float, Number("", OWN, "an object never seen is within this many sd of its prior")] = 2.5
    jump: Annotated[
        float,
        Number("m", OWN, "difference, also in [rad], of the motions by localisation and odometry that shows a push"),
    ] = 0.1
    memory: Annotated[
        float,
        Number(
            "s",
            OWN,
            "time without a detection for which odometry keeps an object's place; then localisation, averaged over "
            "as long, does",
        ),
    ] = 3.0
    bin_sd: Annotated[
        float,
        Number("m", OWN, "sd of a placed object from the centre of its bin; twice for one that the hand has lost"),
    ] = 0.05


@dataclass
class Track:
    """Estimate of one object, odometry frame."""

    position: Array  # [m], shape (3,)
    yaw: float  # [rad]
    variance: float  # [m^2] per axis
    last_seen: float  # [s]
    elsewhere: list[Array] = field(default_factory=list)  # outliers since the last accepted detection, newest last


@dataclass
class TrackerState:
    """State of the tracker."""

    tracks: dict[str, Track]  # only objects that have been seen
    stamps: dict[str, float]  # [s] of the newest detection used per object
    pose: Array | None = None  # localised and odometry pose of the last update, shape (3,) each
    odometry: Array | None = None
    anchor: Array | None = None  # averaged pose of the world in the odometry frame, shape (3,)
    anchored: float = 0.0  # [s] time of its last update
    fresh: list[str] = field(default_factory=list)  # objects first detected since the last `reconsider`
    moved: set[str] = field(default_factory=set)  # objects that have left their first positions


class ObjectTracker(Stateful[TrackerState]):
    """Belief about every object, from the prior and the detections."""

    def __init__(self, known: KnownWorld, settings: TrackerSettings | None = None) -> None:
        self._settings = settings or TrackerSettings()
        self._priors = {item.name: (np.array(item.position), item.yaw) for item in known.objects}
        self._prior_places = np.array([item.position[:2] for item in known.objects]).reshape(-1, 2)
        self._prior_sd = known.object_sd
        self._frame: tuple[Observation, Array] | None = None  # an observation, and the world in its odometry frame
        self._state = TrackerState({}, {})

    def update(self, observation: Observation, held: str | None = None) -> None:
        """Take in the detections of a period, but not those of a held object: it moves with the hand."""
        state = self._state
        self._notice_push(observation)
        self._follow_world(observation)
        for detection in observation.detections:
            new = detection.stamp > state.stamps.get(detection.name, -math.inf)
            if new and detection.name != held and detection.name in self._priors and _usable(detection):
                state.stamps[detection.name] = detection.stamp
                self._take(detection, observation)

    def as_believed(self, reported: Observation) -> Observation:
        """The present report with the pose and odometry that were believed last: the reported ones may be wrong."""
        pose, odometry = self._state.pose, self._state.odometry
        if pose is None or odometry is None:
            return reported
        return msgspec.structs.replace(reported, pose=pose, odometry=odometry)

    def belief(self, name: str, observation: Observation) -> tuple[Array, float, float, float | None]:
        """Position (3,) [m] and yaw [rad] in the odometry frame, sd per axis [m], and when last seen [s] (None: never).

        An object never seen is at its prior, transformed with the localisation of this observation.
        """
        track = self._state.tracks.get(name)
        if track is not None:
            return track.position.copy(), track.yaw, math.sqrt(track.variance), track.last_seen
        position, yaw = self._prior_in_odometry(name, observation)
        return position, yaw, self._prior_sd, None

    def places(self, observation: Observation) -> Places:
        """Believed positions of all objects, odometry frame, and the gates for detections."""
        settings, tracks = self._settings, self._state.tracks
        positions, variances = [], []
        for name in self._priors:
            track = tracks.get(name)
            if track is None:
                positions.append(self._prior_in_odometry(name, observation)[0])
                variances.append(self._prior_sd**2 + settings.localisation_sd**2)
            else:
                positions.append(track.position)
                variances.append(track.variance + settings.drift**2 * max(0.0, observation.time - track.last_seen))
        return Places(
            names=tuple(self._priors),
            positions=np.array(positions).reshape(-1, 3),
            variances=np.array(variances),
            seen=np.array([name in tracks for name in self._priors], dtype=bool),
            gate=settings.gate,
            gate_floor=settings.gate_floor,
            agreeing=settings.agreeing,
        )

    def seen_places(self) -> Iterator[tuple[str, Array, float]]:
        """Objects seen (again, if the hand has released them): name, position (3,) [m], yaw [rad]; odometry frame."""
        sure = (0.5 * self._settings.bin_sd) ** 2
        tracks = self._state.tracks.items()
        return ((name, track.position, track.yaw) for name, track in tracks if track.variance <= sure)

    def knows(self, name: str) -> bool:
        """True for the name of an object of the scene."""
        return name in self._priors

    def other_at(self, name: str, point: Array, within: float, observation: Observation) -> str:
        """Another object than ``name`` that is believed within a distance [m] of a point (3,); "" for none.

        The point is in the odometry frame. The distance is larger for an object that was never seen.
        """
        wide = within + self._settings.unseen * self._prior_sd
        tracks = self._state.tracks
        here = point.tolist()
        for other, track in tracks.items():
            if other != name and math.dist(here, track.position.tolist()) < within:
                return other
        in_world = from_frame(compose(observation.pose, inverse(observation.odometry)), point).tolist()
        for other, (place, _) in self._priors.items():
            near = other != name and other not in tracks and abs(place[0] - in_world[0]) < wide
            if near and math.dist(in_world, place.tolist()) < wide:
                return other
        return ""

    def world_position(self, name: str, observation: Observation) -> Array:
        """Believed position [m] in the world, with the localisation of this observation; shape (3,)."""
        track = self._state.tracks.get(name)
        if track is None:
            return self._prior(name)[0].copy()
        return from_frame(compose(observation.pose, inverse(observation.odometry)), track.position)

    def beside(
        self, name: str, reach: float, observation: Observation
    ) -> tuple[tuple[str, ...], list[tuple[float, ...]]]:
        """Other objects believed within reach [m] of one: names; x, y, z, yaw (odometry frame), 1 if seen or else 0."""
        x, y, _ = self.belief(name, observation)[0].tolist()
        T_odom_world = self._world_in_odometry(observation)
        apart = self._prior_places - to_frame(T_odom_world, np.array([x, y]))
        far = np.abs(apart).max(axis=1) > math.sqrt(2.0) * reach  # the square below is turned against the world
        names, found = [], []
        for k, other in enumerate(self._priors):
            track = self._state.tracks.get(other)
            if other == name or (track is None and far[k]):
                continue
            if track is None:
                (at_x, at_y, at_z), yaw = self._prior_in_odometry(other, observation)
            else:
                (at_x, at_y, at_z), yaw = track.position.tolist(), track.yaw
            if max(abs(at_x - x), abs(at_y - y)) <= reach:
                names.append(other)
                found.append((float(at_x), float(at_y), float(at_z), yaw, float(track is not None)))
        return tuple(names), found

    def move_belief(self, name: str, position: Array, observation: Observation, sd: float) -> None:
        """Set the belief of an object to a position [m], odometry frame, shape (3,); ``sd`` [m] per axis."""
        yaw = self.belief(name, observation)[1]
        self._state.moved.add(name)
        self._state.tracks[name] = Track(np.array(position, dtype=float), yaw, sd**2, observation.time)

    def forget(self, name: str) -> bool:
        """Reset to its prior an object that is not where it was seen; False when it has no estimate."""
        return self._state.tracks.pop(name, None) is not None

    def exchange(self, one: str, other: str) -> None:
        """Swap the estimates of two objects that were taken for each other."""
        tracks = self._state.tracks
        swapped = {one: tracks.pop(other, None), other: tracks.pop(one, None)}
        tracks.update({name: track for name, track in swapped.items() if track is not None})

    def reconsider(self, observation: Observation, held: str | None) -> None:
        """Exchange an object that was just named for the first time with another, if that fits their priors better.

        Of two side by side, the first in view gets the name of the nearer prior, which may be that of the second.
        """
        state = self._state
        fresh, state.fresh = state.fresh, []
        standing = [name for name in state.tracks if name not in state.moved and name != held]
        for name in fresh:
            if name not in standing:
                continue
            gains = {other: self._gain(name, other, observation) for other in standing if other != name}
            best = max(gains, key=gains.__getitem__, default=name)
            if gains.get(best, 0.0) > self._prior_sd**2:
                self.exchange(name, best)

    def _gain(self, one: str, other: str, observation: Observation) -> float:
        """Decrease [m^2] of the squared distances of two objects from their priors when they are exchanged."""
        a, b = (self._state.tracks[name].position for name in (one, other))
        p, q = (self._prior_in_odometry(name, observation)[0] for name in (one, other))
        return float(((a - p) ** 2 + (b - q) ** 2 - (a - q) ** 2 - (b - p) ** 2).sum())

    def carry(
        self, stands: Callable[[Array], bool], transform: Array, observation: Observation, *, held: str, before: float
    ) -> None:
        """Move the beliefs of objects on a piece of furniture with it; ``stands``: test of a position (world [m]).

        ``transform``: planar motion (x, y, turn) in the world, shape (3,). A held object, and one that was seen after
        ``before`` [s], when the piece had been moved already, keep their positions.
        """
        T_world_odom = compose(observation.pose, inverse(observation.odometry))
        for name, track in self._state.tracks.items():
            at = from_frame(T_world_odom, track.position)
            if name == held or track.last_seen > before or not stands(at):
                continue
            self._state.moved.add(name)
            track.position = from_frame(inverse(T_world_odom), from_frame(transform, at))
            track.yaw = wrap_angle(track.yaw + float(transform[2]))
            track.elsewhere = []

    def _notice_push(self, observation: Observation) -> None:
        """When localisation jumps and odometry does not, keep the beliefs where they are in the world."""
        state, settings = self._state, self._settings
        pose, odometry = state.pose, state.odometry
        state.pose, state.odometry = np.array(observation.pose), np.array(observation.odometry)
        if pose is None or odometry is None or not _jump(pose, odometry, state.pose, state.odometry) >= settings.jump:
            return
        T_world_odom = compose(pose, inverse(odometry))
        T_odom_world = compose(observation.odometry, inverse(observation.pose))
        for track in state.tracks.values():
            track.position = from_frame(T_odom_world, from_frame(T_world_odom, track.position))
            track.yaw = wrap_angle(track.yaw + float(T_odom_world[2] + T_world_odom[2]))
            track.variance += 2.0 * settings.localisation_sd**2
            track.elsewhere = []
        state.anchor = None

    def _follow_world(self, observation: Observation) -> None:
        """Move the estimates of objects not seen lately with the world frame, once per period."""
        state, now, memory = self._state, observation.time, self._settings.memory
        if state.anchor is not None and now - state.anchored < PERIOD - 1e-6:
            return
        before, new = state.anchor, self._world_in_odometry(observation)
        if not np.isfinite(new).all():
            return
        if before is not None:
            share = 1.0 - math.exp(-(now - state.anchored) / memory)
            turn = wrap_angle(float(new[2] - before[2]))
            x, y = (before[:2] + share * (new[:2] - before[:2])).tolist()
            new = np.array([x, y, wrap_angle(float(before[2]) + share * turn)])
            for track in state.tracks.values():
                if now - track.last_seen > memory:
                    track.position = from_frame(new, to_frame(before, track.position))
                    track.yaw = wrap_angle(track.yaw + share * turn)
        state.anchor, state.anchored = new, now

    def _prior(self, name: str) -> tuple[Array, float]:
        if name not in self._priors:
            raise KeyError(f"no object {name!r}; there are {', '.join(sorted(self._priors)) or 'none'}")
        return self._priors[name]

    def _prior_in_odometry(self, name: str, observation: Observation) -> tuple[Array, float]:
        position, yaw = self._prior(name)
        T_odom_world = self._world_in_odometry(observation)
        return from_frame(T_odom_world, position), wrap_angle(yaw + T_odom_world[2])

    def _world_in_odometry(self, observation: Observation) -> Array:
        """Planar pose of the world frame in the odometry frame of an observation, shape (3,)."""
        if self._frame is None or self._frame[0] is not observation:
            self._frame = observation, compose(observation.odometry, inverse(observation.pose))
        return self._frame[1]

    def _take(self, detection: Detection, observation: Observation) -> None:
        """Update the filter of an object with one detection."""
        state, settings = self._state, self._settings
        seen_at = from_frame(detection.odometry, detection.p_base)
        yaw_seen = detection.yaw_base + detection.odometry[2]
        track = state.tracks.get(detection.name)
        if track is None:
            position, yaw = self._prior_in_odometry(detection.name, observation)
            variance = self._prior_sd**2 + settings.localisation_sd**2
            track = state.tracks[detection.name] = Track(position, yaw, variance, detection.stamp)
            track.yaw = _towards(yaw, yaw_seen, 1.0)
            state.fresh.append(detection.name)
        variance = track.variance + settings.drift**2 * max(0.0, detection.stamp - track.last_seen)
        innovation = seen_at - track.position
        noise = detection.position_sd**2
        reach = settings.gate_floor + settings.gate * math.sqrt(variance + noise)
        if float(np.abs(innovation).max()) > reach:
            if self._elsewhere(track, detection, seen_at, yaw_seen):
                state.moved.add(detection.name)
            return
        gain = variance / (variance + noise) if variance + noise > 0.0 else 1.0
        track.position = track.position + gain * innovation
        track.variance = (1.0 - gain) * variance
        track.yaw = _towards(track.yaw, yaw_seen, settings.yaw_gain)
        track.last_seen = detection.stamp
        track.elsewhere = []

    def _elsewhere(self, track: Track, detection: Detection, seen_at: Array, yaw_seen: float) -> bool:
        """Count outliers that agree; if there are enough, move the belief to them and return True."""
        settings = self._settings
        reach = settings.gate_floor + settings.gate * math.sqrt(2.0) * detection.position_sd
        agreeing = [p for p in track.elsewhere if float(np.abs(p - seen_at).max()) <= reach]
        track.elsewhere = [*agreeing, seen_at]
        count = len(track.elsewhere)
        if count < settings.agreeing:
            return False
        track.position = np.mean(track.elsewhere, axis=0)
        track.variance = detection.position_sd**2 / count
        track.yaw = _towards(track.yaw, yaw_seen, 1.0)
        track.last_seen = detection.stamp
        track.elsewhere = []
        return True


def _usable(detection: Detection) -> bool:
    """True when all numbers of a detection are finite, and its sd is not negative."""
    numbers = (detection.stamp, detection.yaw_base, detection.position_sd)
    arrays_finite = np.isfinite(detection.p_base).all() and np.isfinite(detection.odometry).all()
    return bool(arrays_finite) and all(math.isfinite(value) for value in numbers) and detection.position_sd >= 0.0


def _towards(yaw: float, seen: float, gain: float) -> float:
    """The yaw, moved by a share of the way to the nearest of the four equivalent readings of the seen one."""
    return wrap_angle(yaw + gain * math.remainder(seen - yaw, QUARTER))


@njit(cache=True)
def _jump(pose: Array, odometry: Array, pose_now: Array, odometry_now: Array) -> float:
    """Difference between the motions of localisation and odometry, the larger of [m] and [rad]; nan: not finite."""
    x, y = odometry_now[0] - odometry[0], odometry_now[1] - odometry[1]
    c, s = math.cos(pose[2] - odometry[2]), math.sin(pose[2] - odometry[2])
    off_x, off_y = pose_now[0] - pose[0] - (c * x - s * y), pose_now[1] - pose[1] - (s * x + c * y)
    off, turn = math.sqrt(off_x * off_x + off_y * off_y), pose_now[2] - pose[2] - (odometry_now[2] - odometry[2])
    return max(off, abs(wrap_angle(turn))) if math.isfinite(off + turn) else math.nan
