"""Kernels and Python agree, to the last bit where Python says what that is."""

import math

import numpy as np
from numba import njit

from motm_twin.model.exact import hypot, norm, product, wrap_angle

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


def test_lengths_and_products_are_those_of_numpy():
    for A, B in np.random.default_rng(1).normal(size=(2000, 2, 3, 3)):
        np.testing.assert_allclose(norm(A[0]), np.linalg.norm(A[0]), rtol=1e-15)
        np.testing.assert_allclose(norm(A[0, :2]), np.linalg.norm(A[0, :2]), rtol=1e-15)
        np.testing.assert_allclose(product(A, B), A @ B, rtol=0.0, atol=1e-14)  # the order of sums is the BLAS's own
