"""Kernels and Python agree to the last bit."""

import math

import numpy as np
from numba import njit

from motm_twin.control.arm_reference import norm
from motm_twin.model.exact import hypot, wrap_angle

SPECIAL = np.array([0.0, -0.0, 1.0, 3.0, 4.0, 1e-200, 1e200, *(k * math.pi for k in range(-6, 7))])


@njit
def compiled(x, y):
    return hypot(x, y), math.remainder(x, 2.0 * math.pi), wrap_angle(x)


def pairs():
    rng = np.random.default_rng(0)
    some = rng.normal(size=(20000, 2)) * 10.0 ** rng.integers(-8, 4, size=(20000, 2))
    return np.vstack([some, np.array(np.meshgrid(SPECIAL, SPECIAL)).reshape(2, -1).T]).tolist()


def test_lengths_remainders_and_angles_are_those_of_python_bit_for_bit():
    for x, y in pairs():
        expected = math.hypot(x, y), math.remainder(x, 2.0 * math.pi), wrap_angle(x)
        assert np.array(compiled(x, y)).tobytes() == np.array(expected).tobytes(), (x, y)


def test_the_length_of_a_vector_is_that_of_numpy_bit_for_bit():
    for vector in np.random.default_rng(1).normal(size=(2000, 3)):
        assert norm(vector) == np.linalg.norm(vector)
