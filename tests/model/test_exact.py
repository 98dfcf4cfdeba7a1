"""Kernels and Python agree, to the last bit where Python says what that is."""

import math

import numpy as np
from numba import njit

from motm_twin.model.exact import (
    angle_of,
    dot,
    hypot,
    norm,
    product,
    times,
    transposed_times,
    turn_between,
    wrap_angle,
)

SPECIAL = np.array([0.0, -0.0, 1.0, 3.0, 4.0, 1e-200, 1e200, *(k * math.pi for k in range(-6, 7))])


@njit
def compiled(x, y):
    return hypot(x, y), math.remainder(x, 2.0 * math.pi), wrap_angle(x)


def pairs():
    rng = np.random.default_rng(0)
    some = rng.normal(size=(20000, 2)) * 10.0 ** rng.integers(-8, 4, size=(20000, 2))
    return np.vstack([some, np.array(np.meshgrid(SPECIAL, SPECIAL)).reshape(2, -1).T]).tolist()


def test_lengths_remainders_and_angles_are_those_of_python_bit_for_bit():
    given = pairs()
    found = np.array([compiled(x, y) for x, y in given])
    expected = np.array([(math.hypot(x, y), math.remainder(x, 2.0 * math.pi), wrap_angle(x)) for x, y in given])
    wrong = (found.view(np.uint64) != expected.view(np.uint64)).any(axis=1)
    assert not wrong.any(), np.array(given)[wrong][0]


def test_lengths_and_products_are_those_of_numpy():
    given = np.random.default_rng(1).normal(size=(2000, 2, 3, 3))

    def near(ours, theirs, rtol=0.0, atol=1e-14):  # the order of sums is the BLAS's own
        found, expected = ([call(A, B) for A, B in given] for call in (ours, theirs))
        np.testing.assert_allclose(found, expected, rtol=rtol, atol=atol)

    near(lambda A, _: norm(A[0]), lambda A, _: np.linalg.norm(A[0]), rtol=1e-15, atol=0.0)
    near(lambda A, _: norm(A[0, :2]), lambda A, _: np.linalg.norm(A[0, :2]), rtol=1e-15, atol=0.0)
    near(product, lambda A, B: A @ B)
    near(lambda A, B: times(A, B[0]), lambda A, B: A @ B[0])
    near(lambda A, B: transposed_times(A, B[0]), lambda A, B: A.T @ B[0])
    near(lambda A, B: dot(A[:, 1], B[0]), lambda A, B: A[:, 1] @ B[0])


def test_a_product_is_the_same_for_every_layout_of_its_matrices():
    for A, B in np.random.default_rng(2).normal(size=(200, 2, 3, 3)):
        expected = product(A, B)
        wide = np.zeros((6, 6))
        wide[::2, ::2] = A
        for same in (np.asfortranarray(A), wide[::2, ::2], A.T.copy().T):
            assert product(same, B).tobytes() == expected.tobytes()
            assert times(same, B[:, 0]).tobytes() == expected[:, 0].tobytes()


def test_angles_of_arrays_are_those_of_python_bit_for_bit():
    x, y = np.array(pairs()).T
    expected = [math.atan2(b, a) for a, b in zip(x.tolist(), y.tolist(), strict=True)]
    assert angle_of(y, x).tobytes() == np.array(expected).tobytes()


def test_a_turn_between_angles_is_the_shorter_way_round():
    a = np.array([0.0, 3.0, -3.0, 7.0, 1.0])
    np.testing.assert_allclose(turn_between(a, np.array([0.5, -3.0, 3.0, 7.0 - 4.0 * math.pi, 1.0])), [
        0.5, 2.0 * math.pi - 6.0, 2.0 * math.pi - 6.0, 0.0, 0.0,
    ], atol=1e-12)  # fmt: skip
    np.testing.assert_allclose(turn_between(a, 0.0), np.abs(np.angle(np.exp(1j * a))), atol=1e-12)
