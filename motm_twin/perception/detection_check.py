"""Checks of detections against the camera's view, each other, and the believed positions of the objects."""

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field
from typing import Annotated, NamedTuple

import msgspec
import numpy as np

from motm_twin.model.arm_kernels import HAND, fk_arm
from motm_twin.model.compiler import njit
from motm_twin.model.exact import hypot
from motm_twin.model.geometry import Array, compose, from_frame, inverse, to_frame
from motm_twin.model.known import KnownWorld, known_solids
from motm_twin.model.number import OWN, Number
from motm_twin.model.plant import Detection, Observation
from motm_twin.model.profile import RobotProfile
from motm_twin.model.reason import Kind, Reason
from motm_twin.model.scene import Bin
from motm_twin.perception import association
from motm_twin.perception.association import AssociationSettings, AssociationState, Places
from motm_twin.perception.finding import Finding
from motm_twin.perception.footprints import outline
from motm_twin.perception.objects import ObjectTracker


class DetectionSettings(msgspec.Struct, frozen=True, kw_only=True):
    """Limits of the checks of detections."""

    beyond: Annotated[float, Number("", OWN, "share of the camera's range beyond which nothing can be detected")] = 1.15
    hand_speed: Annotated[
        float, Number("m/s", OWN, "speed with which the hand may have moved the camera since the picture")
    ] = 1.5
    inside: Annotated[
        float,
        Number(
            "rad",
            OWN,
            "angle inside the camera's cone from which an object is seen; beyond the cone by twice this, none is",
        ),
    ] = math.radians(5.0)
    within: Annotated[
        float, Number("", OWN, "share of the camera's range within which an object in the cone is seen")
    ] = 0.92
    nearest: Annotated[float, Number("m", OWN, "distance from the lens below which the fingers may hide an object")] = (
        0.12
    )
    above: Annotated[
        float, Number("m", OWN, "height of the lens above an object from which it looks down on it freely")
    ] = 0.05
    twice: Annotated[
        float,
        Number(
            "m",
            OWN,
            "distance from another object's place at which a detection is of that one; from its own place, twice as "
            "far",
        ),
    ] = 0.05
    contested: Annotated[
        float,
        Number(
            "s",
            OWN,
            "time after another was detected at its place for which an object is doubted elsewhere; after twice "
            "this, they were swapped",
        ),
    ] = 5.0
    doubtful: Annotated[
        float, Number("m", OWN, "sd of an object's place from which neither a swap nor its absence is reported")
    ] = 0.05
    recent: Annotated[
        float, Number("s", OWN, "time since it was last seen within which a missing object is reported")
    ] = 2.0
    late: Annotated[
        float, Number("s", OWN, "age of the newest picture, or time in view without a detection, that is reported")
    ] = 0.3
    reported_for: Annotated[float, Number("s", OWN, "time for which a wrong detection is reported")] = 0.5
    association: AssociationSettings = AssociationSettings()


@dataclass
class DetectionState:
    """Memory of the checks of detections."""

    good: dict[str, float] = field(default_factory=dict)  # [s] stamp of the newest accepted report of each object
    swapped: dict[str, tuple[float, float]] = field(default_factory=dict)  # [s] first and last report elsewhere
    taken: dict[str, float] = field(default_factory=dict)  # [s] newest report of another object at its place
    wrong: Finding | None = None  # the newest about a wrong report
    until: float = 0.0  # [s] time until which it is reported
    missing: dict[str, float] = field(default_factory=dict)  # [s] since when an object has been in view, not reported
    picture: tuple[float, float] = (-math.inf, -math.inf)  # [s] stamp of the newest picture, and when it came
    association: AssociationState = field(default_factory=AssociationState)  # of detections without a name


class Screens(NamedTuple):
    """Sides of the mapped furniture that may hide an object from the camera."""

    edges: Array  # [m] x, y, x, y, world, shape (s, 4)
    z: Array  # [m] bottom and top, shape (s, 2)

    @classmethod
    def of(cls, known: KnownWorld) -> "Screens":
        """All sides of all mapped furniture and bins."""
        solids = known_solids(known)
        outlines = [outline(solid.shape) for solid in solids]
        edges = [np.hstack([corners, np.roll(corners, -1, axis=0)]) for corners in outlines]
        z = [np.tile((solid.z_min, solid.z_max), (len(side), 1)) for solid, side in zip(solids, edges, strict=True)]
        return cls(np.vstack([np.zeros((0, 4)), *edges]), np.vstack([np.zeros((0, 2)), *z]))


class Beliefs:
    """Positions of the objects that the tracker believes at one observation, computed on request."""

    def __init__(
        self, tracker: ObjectTracker, now: Observation, profile: RobotProfile, settings: "DetectionSettings",
        bins: tuple[Bin, ...], screens: Screens,
    ) -> None:  # fmt: skip
        self._tracker, self._now, self._bins, self._screens = tracker, now, bins, screens
        self._profile, self._settings = profile, settings
        self._eye: tuple[Array, Array] | None = None

    def places(self) -> Places:
        """Believed positions of all objects, odometry frame."""
        return self._tracker.places(self._now)

    def in_view(self, point: Array) -> bool:
        """True when a point (3,) [m], odometry frame, is surely in view, unless an unknown obstacle hides it."""
        in_cone = in_view(self._lens(), to_frame(self._now.odometry, point), self._profile, self._settings)
        return in_cone and not self.screened(point)

    def screened(self, point: Array) -> bool:
        """True when mapped furniture may hide a point (3,) [m], odometry frame, from the camera."""
        eye = from_frame(self._now.pose, self._lens()[0])
        return bool(_screened(eye, self._in_world(point), self._settings.above, *self._screens))

    def _lens(self) -> tuple[Array, Array]:
        if self._eye is None:
            self._eye = lens(self._now.q, self._profile)
        return self._eye

    def _in_world(self, point: Array) -> Array:
        return from_frame(compose(self._now.pose, inverse(self._now.odometry)), point)

    def in_bin(self, point: Array) -> bool:
        """True when a point (3,) [m], odometry frame, is in a bin: an object dropped there may lie anywhere in it."""
        x, y, _ = self._in_world(point).tolist()
        return any(math.hypot(x - box.centre[0], y - box.centre[1]) < 0.75 * box.side for box in self._bins)

    def get(self, name: str) -> tuple[Array, float] | None:
        """Believed position (3,) [m] in the odometry frame, and sd [m]; None for a name that is no object."""
        if not self._tracker.knows(name):
            return None
        place, _, sd, _ = self._tracker.belief(name, self._now)
        return place, sd

    def other_at(self, name: str, point: Array, within: float) -> str:
        """Another object that is believed ``within`` [m] of a point (3,) [m], odometry frame; "" for none."""
        return self._tracker.other_at(name, point, within, self._now)


def checked(
    state: DetectionState, now: Observation, beliefs: Beliefs, held: str | None, profile: RobotProfile,
    settings: DetectionSettings,
) -> tuple[Detection, ...]:  # fmt: skip
    """The plausible detections, each with the name of its object."""
    if _blind(state, now, settings):
        state.association.absent.clear()  # without pictures, nothing is known to be missing
        state.missing.clear()
    elif not now.detections:
        if state.association.stamp > -math.inf:  # a camera that gives no names
            _named(state, (), now, beliefs, held, settings)
    if not now.detections:
        return now.detections
    eye = lens(now.q, profile)
    kept: list[Detection] = []
    left_out = False
    for one in now.detections:
        if not (math.isfinite(one.stamp) and math.isfinite(float(one.p_base.sum() + one.odometry.sum()))):
            kept.append(one)  # the tracker ignores it
            continue
        found = _ghost(one, now, eye, profile, settings)
        if one.name:
            found = found or _twice(one, now, beliefs, settings)
            if found is None and one.name != held:
                found = _swapped(state, one, now, beliefs, settings)
        if found is None:
            kept.append(one)
        else:
            left_out, state.wrong, state.until = True, found, now.time + settings.reported_for
    nameless = [one for one in kept if not one.name]
    if nameless:
        names = iter(_named(state, nameless, now, beliefs, held, settings))
        kept = [one if one.name else msgspec.structs.replace(one, name=next(names)) for one in kept]
        kept = [one for one in kept if one.name]
    for one in kept:
        state.good[one.name] = max(one.stamp, state.good.get(one.name, one.stamp))
    return tuple(kept) if left_out or nameless else now.detections


def _named(
    state: DetectionState, found: Sequence[Detection], now: Observation, beliefs: Beliefs, held: str | None,
    settings: DetectionSettings,
) -> tuple[str, ...]:  # fmt: skip
    """Names for anonymous detections; sets a finding when an unknown object is detected repeatedly."""
    camera = now.time - now.ahead
    names = association.names_of(state.association, found, camera, held, beliefs, settings.association)
    if found and association.unexplained(state.association, beliefs):
        state.wrong, state.until = _STRANGE, now.time + settings.reported_for
    return names


_STRANGE = Finding(reason=Reason(kind=Kind.CAMERA_UNKNOWN, subject="camera", value=1.0, unit="objects"))


def findings(
    state: DetectionState, now: Observation, beliefs: Beliefs, held: str | None, profile: RobotProfile,
    settings: DetectionSettings, kept: Sequence[Detection] = (),
) -> list[Finding]:  # fmt: skip
    """Present findings about the camera; ``now`` has all reported detections, ``kept`` are the accepted, named ones."""
    found = []
    if state.wrong is not None and now.time < state.until:
        found.append(state.wrong)
    age = _age(now)
    if age > settings.late:
        late = Reason(kind=Kind.CAMERA_LATE, subject="camera", value=age, limit=settings.late, unit="s")
        found.append(Finding(reason=late))
    reported = {one.name for one in (*now.detections, *kept)}
    missing = _missing(state, now, beliefs, held, profile, settings, reported)
    if missing and age <= settings.late:
        long = now.time - state.missing[missing[0]]
        lost = Reason(kind=Kind.CAMERA_LOST, subject=missing[0], value=long, limit=settings.late, unit="s")
        found.append(Finding(reason=lost))
    return found


def _blind(state: DetectionState, now: Observation, settings: DetectionSettings) -> bool:
    """True when no new picture has come for a while; never for a robot that does not report picture stamps."""
    time = now.time - now.ahead
    if now.camera_stamp is None or now.camera_stamp != state.picture[0]:
        state.picture = (-math.inf if now.camera_stamp is None else now.camera_stamp), time
    return time - state.picture[1] > settings.late


def _age(now: Observation) -> float:
    """Age [s] of the newest picture or that of the newest detection, the larger one; 0 when neither is known."""
    newest = max((one.stamp for one in now.detections), default=now.camera_stamp)
    oldest = newest if now.camera_stamp is None or newest is None else min(newest, now.camera_stamp)
    return 0.0 if oldest is None else now.time - now.ahead - oldest


def lens(q: Array, profile: RobotProfile) -> tuple[Array, Array]:
    """Position (3,) [m] and viewing direction (3,) of the camera in the base frame."""
    arm, hand = profile.arm, fk_arm(q)[HAND]
    return hand[:3, 3] + np.array([arm.mount_x, arm.mount_y, arm.mount_z]), hand[:3, 2]


def _seen(eye: tuple[Array, Array], point: Array) -> tuple[float, float]:
    """Distance [m] of a point from the lens, and its angle [rad] from the axis."""
    (x, y, z), (ax, ay, az) = (point - eye[0]).tolist(), eye[1].tolist()
    distance = math.sqrt(x * x + y * y + z * z)
    along = x * ax + y * ay + z * az
    return distance, math.acos(min(1.0, max(-1.0, along / max(distance, 1e-6))))


def _ghost(
    one: Detection, now: Observation, eye: tuple[Array, Array], profile: RobotProfile, settings: DetectionSettings
) -> Finding | None:
    """Finding for a detection clearly outside the camera's cone or range; None for any other."""
    distance, angle = _seen(eye, one.p_base)
    moved = settings.hand_speed * max(0.0, now.time - one.stamp)
    slack = math.atan2(moved, max(distance, 1e-6))
    widest, farthest = (
        profile.camera.half_cone + 2.0 * settings.inside + slack,
        settings.beyond * profile.camera.range + moved,
    )
    if angle <= widest and distance <= farthest:
        return None
    cone = math.degrees(profile.camera.half_cone)
    why = Reason(kind=Kind.CAMERA_GHOST, subject=one.name, value=math.degrees(angle), limit=cone, unit="deg")
    return Finding(reason=why)


def _twice(one: Detection, now: Observation, beliefs: Beliefs, settings: DetectionSettings) -> Finding | None:
    """Finding for a detection, if the same picture reports the object at another place, nearer to its belief."""
    here = from_frame(one.odometry, one.p_base)
    for other in now.detections:
        if other is one or other.name != one.name or abs(other.stamp - one.stamp) > 1e-6:
            continue
        there = from_frame(other.odometry, other.p_base)
        apart = math.dist(here.tolist(), there.tolist())
        belief = beliefs.get(one.name)
        if apart > settings.twice and belief is not None:
            place = belief[0].tolist()
            if math.dist(here.tolist(), place) > math.dist(there.tolist(), place):
                why = Reason(kind=Kind.CAMERA_TWICE, subject=one.name, value=apart, limit=settings.twice, unit="m")
                return Finding(reason=why)
    return None


def _swapped(
    state: DetectionState, one: Detection, now: Observation, beliefs: Beliefs, settings: DetectionSettings
) -> Finding | None:
    """Finding for an object reported at another's place; None once it lasts too long for a fault: they were swapped."""
    own = beliefs.get(one.name)
    if own is None or own[1] > settings.doubtful:
        return None
    here = from_frame(one.odometry, one.p_base)
    away = _apart(here, own[0])
    if away < 2.0 * settings.twice:
        state.swapped.pop(one.name, None)
        return None
    if beliefs.in_bin(here):
        other = "" if beliefs.in_bin(own[0]) else "what was dropped into a bin"
    else:
        other = beliefs.other_at(one.name, here, settings.twice)
        its = next((each for each in now.detections if each.name == other), None)
        if its is not None and _at_no_object(other, from_frame(its.odometry, its.p_base), own[0], beliefs, settings):
            return None  # both are elsewhere, and at no other's place: the robot's pose is wrong
    if other:
        state.taken[other] = one.stamp
    elif one.stamp - state.taken.get(one.name, -math.inf) < settings.contested:
        other = "another object"
    since, last = state.swapped.get(one.name, (one.stamp, one.stamp))
    since = one.stamp if one.stamp - last > settings.contested else since
    state.swapped[one.name] = since, one.stamp
    if not other or one.stamp - since > 2.0 * settings.contested:
        return None
    why = Reason(kind=Kind.CAMERA_SWAP, subject=one.name, other=other, value=away, limit=2.0 * settings.twice, unit="m")
    return Finding(reason=why)


def _at_no_object(name: str, here: Array, place: Array, beliefs: Beliefs, settings: DetectionSettings) -> bool:
    """True when a report (3,) [m] of an object is neither at this place (3,) [m] nor at that of a third object."""
    return _apart(here, place) > 2.0 * settings.twice and not beliefs.other_at(name, here, settings.twice)


def _apart(a: Array, b: Array) -> float:
    return math.dist(a.tolist(), b.tolist())


def in_view(eye: tuple[Array, Array], point: Array, profile: RobotProfile, settings: DetectionSettings) -> bool:
    """True when a point (3,) [m], base frame, is well inside the cone, below the lens, and not too near or far."""
    distance, angle = _seen(eye, point)
    free = eye[0][2] > point[2] + settings.above and distance >= settings.nearest
    cone = angle < profile.camera.half_cone - settings.inside and distance < settings.within * profile.camera.range
    return bool(free and cone)


@njit(cache=True)
def _screened(eye: Array, point: Array, beside: float, edges: Array, z: Array) -> bool:
    """True when a side (s, 4) with heights (s, 2) crosses a line from an eye (3,) to a point (3,) or ``beside`` [m] it.

    A side no higher than the point does not count: the point may be on top of it.
    """
    dx, dy, dz = point[0] - eye[0], point[1] - eye[1], point[2] - eye[2]
    length = max(hypot(dx, dy), 1e-9)
    for aside in (0.0, beside, -beside):
        ex, ey = dx - aside * dy / length, dy + aside * dx / length
        for k in range(edges.shape[0]):
            if z[k, 1] <= point[2]:
                continue
            ax, ay = edges[k, 0] - eye[0], edges[k, 1] - eye[1]
            bx, by = edges[k, 2] - edges[k, 0], edges[k, 3] - edges[k, 1]
            det = ex * by - ey * bx
            if det == 0.0:
                continue
            share, along = (ax * by - ay * bx) / det, (ax * ey - ay * ex) / det
            if 0.0 <= share <= 1.0 and 0.0 <= along <= 1.0 and z[k, 0] <= eye[2] + share * dz <= z[k, 1]:
                return True
    return False


def _missing(
    state: DetectionState, now: Observation, beliefs: Beliefs, held: str | None, profile: RobotProfile,
    settings: DetectionSettings, reported: Collection[str],
) -> list[str]:  # fmt: skip
    """Objects that the camera saw recently, and that have been in view without a report for a while."""
    eye = lens(now.q, profile)
    for name, stamp in state.good.items():
        belief = beliefs.get(name)
        since = state.missing.get(name)
        recent = since is not None or now.time - stamp <= settings.recent
        if belief is None or name == held or name in reported or not recent or belief[1] > settings.doubtful:
            state.missing.pop(name, None)
            continue
        seen = in_view(eye, to_frame(now.odometry, belief[0]), profile, settings)
        if seen and not beliefs.screened(belief[0]):
            state.missing.setdefault(name, now.time)
        else:
            state.missing.pop(name, None)
    return [name for name, since in state.missing.items() if now.time - since > settings.late]
