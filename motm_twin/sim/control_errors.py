"""How far base, arm and camera are from doing what they are told or reporting what is."""

import numpy as np

from motm_twin.model.exact import norm
from motm_twin.model.geometry import Array
from motm_twin.model.scene import Mismatch, Noise

_RNG_BASE, _RNG_ARM, _RNG_HAND_EYE = 0xBA5E5C, 0xA53A4E, 0xE7E0FF


class ControlErrors:
    """Errors of one seed. They are no state: each is drawn from the seed, and from the substep that it is for."""

    def __init__(self, noise: Noise, mismatch: Mismatch, seed: int) -> None:
        """Noise of the scene, and what else the robot is not told."""
        drawn = np.random.default_rng([seed, _RNG_BASE]).standard_normal(2)
        scale = 1.0 + noise.base_speed_scale_sd * drawn
        self.base_scale = scale * (1.0 + mismatch.base_scale)  # of forward speed and yaw rate, shape (2,)
        self.camera_bias = hand_eye(mismatch, seed)  # [m] in the hand's frame, shape (3,)
        self._rate_sd, self._seed = noise.arm_rate_sd, seed

    def rates(self, told: Array, substep: int) -> Array:
        """Joint rates [rad/s] that the arm goes for in a substep when it is told these, shape (7,).

        A joint that is told to stand holds its position.
        """
        if self._rate_sd == 0.0:
            return told
        off = self._rate_sd * np.random.default_rng([self._seed, _RNG_ARM, substep]).standard_normal(7)
        return np.where(told == 0.0, told, told + off)


def hand_eye(mismatch: Mismatch, seed: int) -> Array:
    """Where the camera reports a thing beside where it is [m], in the hand's frame, shape (3,); any direction."""
    if mismatch.hand_eye == 0.0:
        return np.zeros(3)
    drawn = np.random.default_rng([seed, _RNG_HAND_EYE]).standard_normal(3)
    return mismatch.hand_eye / norm(drawn) * drawn
