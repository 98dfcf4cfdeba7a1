"""Sensors of the robot: the 2D lidar, the gripper camera, and localisation with odometry.

The lidar sees only what exists at its own height, the arm excepted. The camera sits at the origin of ``panda_hand`` and
looks along its z axis. The localised pose has a slow error; odometry drifts.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from motm_twin.model.arm_kernels import HAND
from motm_twin.model.compiler import njit
from motm_twin.model.exact import dot, times
from motm_twin.model.geometry import Array, from_frame, to_frame, wrap_angle
from motm_twin.model.motion import drive
from motm_twin.model.plant import Detection, Scan
from motm_twin.model.profile import GripperCamera
from motm_twin.model.profile import Lidar as LidarSpec
from motm_twin.model.scene import Noise
from motm_twin.model.state import LATER
from motm_twin.sim.kernels import cast_rays, segment_distance, sight_blocked
from motm_twin.sim.objects import ObjectState
from motm_twin.sim.solids import Solids


def _arrived(late: list[tuple[int, Any]], now: int, newest: Any) -> tuple[Any, list[tuple[int, Any]]]:
    """The newest item that has arrived by substep ``now``, and those that are still on their way."""
    here = [item for arrival, item in late if arrival <= now]
    return here[-1] if here else newest, [entry for entry in late if entry[0] > now]


@dataclass
class LidarState:
    """Generator of the noise, the newest sweep, and sweeps that are on their way."""

    rng: np.random.Generator
    scan: Scan | None = None
    late: list[tuple[int, Scan]] = field(default_factory=list)  # substep of arrival, sweep

    def arrive(self, now: int) -> None:
        """Deliver the newest late sweep that has arrived by substep ``now``."""
        self.scan, self.late = _arrived(self.late, now, self.scan)


class Lidar:
    """Casts the beams of one sweep at one instant, from the true pose of the base."""

    def __init__(self, spec: LidarSpec, range_sd: float) -> None:
        """Sensor of the profile and sd of a range [m]."""
        self.spec = spec
        self.angle_min = -0.5 * spec.field_of_view
        self.angle_step = spec.field_of_view / max(1, spec.beams - 1)
        self._origin = np.array([spec.x, spec.y])
        self._range_sd = range_sd

    def sweep(
        self, state: LidarState, stamp: float, pose: Array, localised: Array, segments: Array, discs: Array
    ) -> None:
        """Replace the newest scan; segments (s, 4) and discs (d, 3) are what exists at the lidar's height."""
        spec, eye, first = self.spec, from_frame(pose, self._origin), float(pose[2]) + self.angle_min
        ranges = cast_rays(eye, first, self.angle_step, spec.beams, segments, discs, spec.range_max)
        if self._range_sd > 0.0:
            ranges = ranges + self._range_sd * state.rng.standard_normal(spec.beams)
            ranges[ranges > spec.range_max] = np.inf
        state.scan = Scan(
            stamp=stamp,
            ranges=np.maximum(ranges, spec.range_min),
            angle_min=self.angle_min,
            angle_step=self.angle_step,
            origin=self._origin,
            range_min=spec.range_min,
            range_max=spec.range_max,
            pose=localised.copy(),
        )


NEAR, FAR = 0.1, 1.0  # [m] distances between which the noise grows linearly
YAW_SD_NEAR, YAW_SD_FAR = math.radians(1.0), math.radians(5.0)
QUARTER_TURN = 0.5 * math.pi

# Arm links as capsules between frames of `fk_arm` (index, index, radius [m]), without the wrist behind the lens.
LINK_CAPSULES = ((0, 1, 0.09), (2, 3, 0.09), (4, 5, 0.075))


_NO_BIAS = np.zeros(3)
Frame = tuple[float, Array, Array]  # stamp [s], true pose and odometry of a frame of the camera


class Picture(NamedTuple):
    """Detections of one frame of the camera."""

    stamp: float = 0.0  # [s]
    detections: tuple[Detection, ...] = ()


@dataclass
class CameraState:
    """Generator of the noise, the newest picture, and pictures that are on their way."""

    rng: np.random.Generator
    picture: Picture = field(default_factory=Picture)
    late: list[tuple[int, Picture]] = field(default_factory=list)  # substep of arrival, picture

    def delay(self, arrival: int, previous: Picture) -> None:
        """Delay the picture just taken to a later substep; the previous one stays the newest."""
        self.late.append((arrival, self.picture))
        self.picture = previous

    def arrive(self, now: int) -> None:
        """Deliver the newest late picture that has arrived by substep ``now``."""
        self.picture, self.late = _arrived(self.late, now, self.picture)


@njit(cache=True)
def _hidden(eye: Array, point: Array, frames: Array) -> bool:
    """True when the arm is between the eye and a point; ``frames`` of the arm (n, 4, 4)."""
    for i, j, radius in LINK_CAPSULES:
        begin, end = np.ascontiguousarray(frames[i, :3, 3]), np.ascontiguousarray(frames[j, :3, 3])
        if segment_distance(eye, point, begin, end) < radius:
            return True
    return False


class _Seen(NamedTuple):
    """Ground truth of one object in a frame."""

    name: str
    position: Array  # [m] world, shape (3,)
    yaw: float  # [rad] world
    distance: float  # [m] from the lens


class Camera:
    """Reports objects in the view cone, in range, in sight and not held; with misses and false detections."""

    def __init__(self, spec: GripperCamera, noise: Noise, *, named: bool = True, bias: Array = _NO_BIAS) -> None:
        """Sensor of the profile and noise of the scene; ``bias`` (3,) [m] of its reports, in the hand's frame.

        ``named``: it reads markers, so there are no false detections.
        """
        self.spec, self._bias = spec, bias
        self._miss = noise.camera_miss_probability
        self._false = 0.0 if named else noise.camera_false_probability
        self._sd_near, self._sd_far = noise.camera_position_sd_at_01m, noise.camera_position_sd_at_1m
        self._noisy = max(self._sd_near, self._sd_far) > 0.0
        self._cos_half_cone = math.cos(spec.half_cone)
        ends = np.zeros((4, 3))
        _hidden(ends[0], ends[1], np.zeros((6, 4, 4)))  # compile now, not when the first object comes into view
        none = np.zeros((0, 2))
        sight_blocked(ends[0], ends[1], none, np.zeros(1, dtype=np.int64), none, np.zeros((0, 3)), none)

    def sees(self, T_hand: Array, frames: Array, point: Array, solids: Solids, agents: Array) -> float | None:
        """Distance [m] to a visible point, else None.

        ``T_hand`` (4, 4) and the arm's ``frames`` (11, 4, 4) are in the world; agents are x, y, radius, height (n, 4).
        """
        eye = np.ascontiguousarray(T_hand[:3, 3])
        ray = point - eye
        distance = math.sqrt(dot(ray, ray))
        if not 0.0 < distance <= self.spec.range or dot(ray, T_hand[:3, 2]) < self._cos_half_cone * distance:
            return None
        discs = np.vstack([solids.discs, agents[:, :3]])
        disc_z = np.vstack([solids.disc_z, np.column_stack([np.zeros(len(agents)), agents[:, 3]])])
        if sight_blocked(eye, point, solids.corners, solids.first, solids.z, discs, disc_z):
            return None
        return None if _hidden(eye, point, frames) else distance

    def take(
        self, state: CameraState, frame: Frame, arm: Array, cubes: Iterable[ObjectState], solids: Solids, agents: Array
    ) -> None:
        """Replace the newest picture; ``arm``: its frames (11, 4, 4)."""
        found, T_hand = [], arm[HAND]
        for item in cubes:
            if item.state == "held":
                continue
            distance = self.sees(T_hand, arm, item.position, solids, agents)
            if distance is not None and not (self._miss and state.rng.random() < self._miss):
                at = _Seen(item.name, item.position, item.yaw, distance)
                found.append(self._detect(state.rng, frame, T_hand, at))
        if self._false and state.rng.random() < self._false:
            found.append(self._detect(state.rng, frame, T_hand, self._false_detection(state.rng, T_hand)))
        state.picture = Picture(frame[0], tuple(found))

    def _false_detection(self, rng: np.random.Generator, T_hand: Array) -> _Seen:
        """A false detection, uniform over distance and solid angle in the view cone."""
        distance = rng.uniform(NEAR, self.spec.range)
        along, turn = rng.uniform(self._cos_half_cone, 1.0), rng.uniform(-math.pi, math.pi)
        across = math.sqrt(1.0 - along * along)
        ray = np.array([across * math.cos(turn), across * math.sin(turn), along])
        place = T_hand[:3, 3] + distance * times(np.ascontiguousarray(T_hand[:3, :3]), ray)
        return _Seen("", place, rng.uniform(-math.pi, math.pi), distance)

    def _detect(self, rng: np.random.Generator, frame: Frame, T_hand: Array, seen: _Seen) -> Detection:
        stamp, pose, odometry = frame
        share = max(0.0, (seen.distance - NEAR) / (FAR - NEAR))
        sd = self._sd_near + share * (self._sd_far - self._sd_near)
        p_base = to_frame(pose, seen.position + times(np.ascontiguousarray(T_hand[:3, :3]), self._bias))
        yaw = seen.yaw - float(pose[2])
        if self._noisy:
            draws = rng.standard_normal(4)
            p_base = p_base + sd * draws[:3]
            yaw += (YAW_SD_NEAR + share * (YAW_SD_FAR - YAW_SD_NEAR)) * draws[3]
        return Detection(
            stamp=stamp,
            name=seen.name,
            p_base=p_base,
            yaw_base=float(math.remainder(yaw, QUARTER_TURN)),
            position_sd=sd,
            odometry=odometry.copy(),
        )


ODOMETRY_SCALE_SD = 0.003  # of distance and of angle, fixed for one seed
TWIST_SD = 0.002  # [m/s] and [rad/s] of the measured twist
_NO_DRAWS = (0.0,) * 5

Twist = tuple[float, float]  # forward speed [m/s], yaw rate [rad/s]


@dataclass
class LocalisationState:
    """Errors and outputs of localisation and odometry."""

    rng: np.random.Generator
    error: Array  # of the localised pose [m, m, rad], shape (3,)
    scale: Array  # of odometry, forward and yaw, shape (2,)
    odometry: Array  # shape (3,); starts at zero
    pose: Array  # localised, shape (3,)
    twist: Array  # measured, shape (2,)
    drift: tuple[float, ...] = field(default=(), metadata=LATER)  # [m] slow part of the error, x and y; (): none


class Localisation:
    """Ornstein-Uhlenbeck errors on the pose, one fast and one slow; odometry with a scale error; off for sds of 0."""

    def __init__(self, noise: Noise, dt: float) -> None:
        """Noise of the scene, for substeps of dt [s]."""
        self.dt = dt
        sd = noise.localisation_position_sd
        self._sd = np.array([sd, sd, noise.localisation_heading_sd])
        self._noisy = bool(self._sd.any())
        self._keep = _kept(dt, noise.localisation_correlation_time)
        self._fresh = (self._sd * math.sqrt(1.0 - self._keep**2)).tolist()
        self._drift_sd = noise.localisation_drift_sd
        self._drift_keep = _kept(dt, noise.localisation_drift_time)
        self._drift_fresh = self._drift_sd * math.sqrt(1.0 - self._drift_keep**2)

    def start(self, pose: Array, rng: np.random.Generator) -> LocalisationState:
        """State at rest at the true pose, with errors drawn from their long-run distribution."""
        error = self._sd * rng.standard_normal(3)
        scale = 1.0 + ODOMETRY_SCALE_SD * rng.standard_normal(2) * self._noisy
        drift = tuple((self._drift_sd * rng.standard_normal(2)).tolist()) if self._drift_sd else ()
        at = _moved(pose, error, drift)
        return LocalisationState(
            rng=rng, error=error, scale=scale, odometry=np.zeros(3), pose=at, twist=np.zeros(2), drift=drift
        )

    @staticmethod
    def relocate(state: LocalisationState, pose: Array) -> None:
        """Account for a displacement of the base: localisation follows, odometry does not notice."""
        state.pose = _moved(pose, state.error, state.drift)

    def step(self, state: LocalisationState, pose: Array, mean_twist: Twist, twist: Twist) -> None:
        """One substep; mean twist over it and twist at its end [m/s, rad/s]."""
        *draws, draw_v, draw_w = state.rng.standard_normal(5).tolist() if self._noisy else _NO_DRAWS
        errors = zip(state.error.tolist(), self._fresh, draws, strict=True)
        state.error = np.array([self._keep * error + fresh * draw for error, fresh, draw in errors])
        if state.drift:
            fresh = state.rng.standard_normal(2).tolist()
            state.drift = tuple(
                self._drift_keep * off + self._drift_fresh * draw for off, draw in zip(state.drift, fresh, strict=True)
            )
        state.pose = _moved(pose, state.error, state.drift)
        (v, w), (scale_v, scale_w) = mean_twist, state.scale.tolist()
        state.odometry = drive(state.odometry, v * scale_v, w * scale_w, self.dt)
        state.twist = np.array([twist[0] + TWIST_SD * draw_v, twist[1] + TWIST_SD * draw_w])


def _kept(dt: float, correlation: float) -> float:
    """Share of an error that remains after dt [s]; 0 without a correlation time."""
    return math.exp(-dt / correlation) if correlation > 0.0 else 0.0


def _moved(pose: Array, error: Array, drift: tuple[float, ...]) -> Array:
    (x, y, heading), (off_x, off_y, off) = pose.tolist(), error.tolist()
    drift_x, drift_y = drift or (0.0, 0.0)
    return np.array([x + off_x + drift_x, y + off_y + drift_y, wrap_angle(heading + off)])
