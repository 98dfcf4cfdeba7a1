"""How far base and arm are from doing what they are told: a base that is too fast or slow, and joints that shake."""

import numpy as np

from motm_twin.model.geometry import Array
from motm_twin.model.scene import Noise

_RNG_BASE, _RNG_ARM = 0xBA5E5C, 0xA53A4E


class ControlErrors:
    """Errors of one seed. They are no state: each is drawn from the seed, and from the substep that it is for."""

    def __init__(self, noise: Noise, seed: int) -> None:
        """Noise of the scene; its defaults are no errors at all."""
        drawn = np.random.default_rng([seed, _RNG_BASE]).standard_normal(2)
        self.base_scale = 1.0 + noise.base_speed_scale_sd * drawn  # of forward speed and yaw rate, shape (2,)
        self._rate_sd, self._seed = noise.arm_rate_sd, seed

    def rates(self, told: Array, substep: int) -> Array:
        """Joint rates [rad/s] that the arm goes for in a substep when it is told these, shape (7,)."""
        if self._rate_sd == 0.0:
            return told
        return told + self._rate_sd * np.random.default_rng([self._seed, _RNG_ARM, substep]).standard_normal(7)
