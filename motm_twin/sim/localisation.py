"""What the robot is told about its own motion: a localised pose with slow error, drifting odometry, measured twist."""

import math
from dataclasses import dataclass, field

import numpy as np

from motm_twin.model.geometry import Array, wrap_angle
from motm_twin.model.motion import drive
from motm_twin.model.scene import Noise
from motm_twin.model.state import LATER

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
    """Ornstein-Uhlenbeck errors on the pose, a quick and a slow one; odometry with a scale error; off for sds of 0."""

    def __init__(self, noise: Noise, dt: float) -> None:
        """Noise of the scene, for substeps of dt [s]."""
        self.dt = dt
        self._sd = np.array(
            [noise.localisation_position_sd, noise.localisation_position_sd, noise.localisation_heading_sd]
        )
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
        """The base was put elsewhere: localisation measures where it is, odometry has not noticed."""
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
    """Share of an error that is left after dt [s]; none without a time over which it is correlated."""
    return math.exp(-dt / correlation) if correlation > 0.0 else 0.0


def _moved(pose: Array, error: Array, drift: tuple[float, ...]) -> Array:
    (x, y, heading), (off_x, off_y, off) = pose.tolist(), error.tolist()
    drift_x, drift_y = drift or (0.0, 0.0)
    return np.array([x + off_x + drift_x, y + off_y + drift_y, wrap_angle(heading + off)])
