"""What the robot is told about its own motion: a localised pose with slow error, drifting odometry, measured twist."""

import math
from dataclasses import dataclass

import numpy as np

from motm_twin.model.geometry import Array, drive, wrap_angle
from motm_twin.model.scene import Noise

ODOMETRY_SCALE_SD = 0.003  # of distance and of angle, fixed for one seed
TWIST_SD = 0.002  # [m/s] and [rad/s] of the measured twist
_NO_DRAWS = np.zeros(5)


@dataclass
class LocalisationState:
    """Errors and outputs of localisation and odometry."""

    rng: np.random.Generator
    error: Array  # of the localised pose [m, m, rad], shape (3,)
    scale: Array  # of odometry, forward and yaw, shape (2,)
    odometry: Array  # shape (3,); starts at zero
    pose: Array  # localised, shape (3,)
    twist: Array  # measured, shape (2,)


class Localisation:
    """Ornstein-Uhlenbeck error on the pose; odometry with a scale error; both off when the scene's sds are 0."""

    def __init__(self, noise: Noise, dt: float) -> None:
        """Noise of the scene, for substeps of dt [s]."""
        self.dt = dt
        self._sd = np.array(
            [noise.localisation_position_sd, noise.localisation_position_sd, noise.localisation_heading_sd]
        )
        self._noisy = bool(self._sd.any())
        correlation = noise.localisation_correlation_time
        self._keep = math.exp(-dt / correlation) if correlation > 0.0 else 0.0
        self._fresh = self._sd * math.sqrt(1.0 - self._keep**2)

    def start(self, pose: Array, rng: np.random.Generator) -> LocalisationState:
        """State at rest at the true pose, with errors drawn from their long-run distribution."""
        error = self._sd * rng.standard_normal(3)
        scale = 1.0 + ODOMETRY_SCALE_SD * rng.standard_normal(2) * self._noisy
        return LocalisationState(
            rng=rng, error=error, scale=scale, odometry=np.zeros(3), pose=_moved(pose, error), twist=np.zeros(2)
        )

    @staticmethod
    def relocate(state: LocalisationState, pose: Array) -> None:
        """The base was put elsewhere: localisation measures where it is, odometry has not noticed."""
        state.pose = _moved(pose, state.error)

    def step(self, state: LocalisationState, pose: Array, mean_twist: Array, twist: Array) -> None:
        """One substep; mean twist over it and twist at its end [m/s, rad/s], shapes (2,)."""
        draws = state.rng.standard_normal(5) if self._noisy else _NO_DRAWS
        state.error = self._keep * state.error + self._fresh * draws[:3]
        state.pose = _moved(pose, state.error)
        v, w = (mean_twist * state.scale).tolist()
        state.odometry = drive(state.odometry, v, w, self.dt)
        state.twist = twist + TWIST_SD * draws[3:]


def _moved(pose: Array, error: Array) -> Array:
    x, y, heading = (pose + error).tolist()
    return np.array([x, y, wrap_angle(heading)])
