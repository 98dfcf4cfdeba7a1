"""Arithmetic that is bit-identical in kernels, Python and NumPy, on every processor.

Numba's ``math.hypot`` is the C library's: sometimes it differs from Python's in the last bit. Numba has no
``math.remainder``. ``@``, ``np.dot`` and ``np.linalg`` call BLAS, in Numba too, and BLAS sums in an order that depends
on processor and threads. NumPy's ``arctan2``, ``exp``, ``log`` and others have special kernels for AVX-512. All of
these round differently from one machine to the next, so no state may depend on them; this module has replacements.
"""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numba import types, vectorize
from numba.extending import intrinsic, overload, register_jitable

from motm_twin.model.compiler import njit
from motm_twin.model.geometry import Array, wrap_angle

__all__ = ["angle_of", "dot", "hypot", "norm", "product", "times", "transposed_times", "turn_between", "wrap_angle"]

_SPLIT = 134217729.0  # 2^27 + 1: halves a number of 53 bits (Veltkamp and Dekker)
_TINY = 1e-300  # lengths below it equal the larger coordinate


def hypot(x: float, y: float) -> float:
    """Length of (x, y), both finite: `math.hypot`."""
    return math.hypot(x, y)


@overload(hypot)
def _hypot(x: float, y: float) -> Callable[[float, float], float]:
    """As CPython 3.11 (``vector_norm``): squares without rounding, compensated sum, one corrected root."""

    def length(x: float, y: float) -> float:
        largest = max(abs(x), abs(y))
        if largest < _TINY:
            return largest
        scale = math.ldexp(1.0, -math.frexp(largest)[1])
        total, first, second, third = 1.0, 0.0, 0.0, 0.0
        for value in (x, y):
            high, low = _halves(value * scale)
            total, first = _added(total, first, high * high)
            total, second = _added(total, second, 2.0 * high * low)
            third += low * low
        root = math.sqrt(total - 1.0 + (first + second + third))
        high, low = _halves(root)
        total, first = _added(total, first, -high * high)
        total, second = _added(total, second, -2.0 * high * low)
        total, third = _added(total, third, -low * low)
        rest = total - 1.0 + (first + second + third)
        return (root + rest / (2.0 * root)) / scale

    return length


@overload(math.remainder)
def _remainder(x: float, y: float) -> Callable[[float, float], float]:
    """x minus the nearest multiple of y > 0, the even one when x is half way; exact, because both steps are."""

    def nearest(x: float, y: float) -> float:
        rest, half = np.fmod(x, y), 0.5 * y
        if abs(rest) == half:
            odd = np.fmod(x, 2.0 * y) != rest
            return -rest if odd else rest
        if rest > half:
            return rest - y
        return rest + y if rest < -half else rest

    return nearest


register_jitable(wrap_angle)


def _fma(context: Any, a: Any, b: Any, c: Any) -> Any:
    """``a * b + c``, rounded once."""
    return types.float64(types.float64, types.float64, types.float64), lambda _, builder, __, given: builder.fma(*given)


fma: Any = intrinsic(_fma)  # in kernels only


_VECTOR = types.Array(types.float64, 1, "A", readonly=True)  # any layout: one kernel for slices and rows alike
_MATRIX = types.Array(types.float64, 2, "A", readonly=True)


@njit(cache=True)
def norm(vector: Array) -> float:
    """Length of a vector, shape (n,): ``np.linalg.norm``."""
    total = 0.0
    for value in vector:
        total = fma(value, value, total)
    return math.sqrt(total)


@njit(types.float64(_VECTOR, _VECTOR), cache=True)
def dot(a: Array, b: Array) -> float:
    """``a @ b`` of vectors, shapes (n,)."""
    total = 0.0
    for k in range(a.shape[0]):
        total = fma(a[k], b[k], total)
    return total


@njit(types.float64[::1](_MATRIX, _VECTOR), cache=True)
def times(A: Array, x: Array) -> Array:
    """``A @ x``, shapes (m, n), (n,) -> (m,)."""
    y = np.zeros(A.shape[0])
    for i in range(A.shape[0]):
        for k in range(A.shape[1]):
            y[i] = fma(A[i, k], x[k], y[i])
    return y


@njit(types.float64[::1](_MATRIX, _VECTOR), cache=True)
def transposed_times(A: Array, x: Array) -> Array:
    """``A.T @ x``, shapes (m, n), (m,) -> (n,)."""
    y = np.zeros(A.shape[1])
    for k in range(A.shape[0]):
        for i in range(A.shape[1]):
            y[i] = fma(A[k, i], x[k], y[i])
    return y


@njit(types.float64[:, ::1](_MATRIX, _MATRIX), cache=True)
def product(A: Array, B: Array) -> Array:
    """``A @ B`` of matrices, shapes (m, n), (n, p) -> (m, p)."""
    C = np.zeros((A.shape[0], B.shape[1]))
    for i in range(A.shape[0]):
        for j in range(B.shape[1]):
            for k in range(A.shape[1]):
                C[i, j] = fma(A[i, k], B[k, j], C[i, j])
    return C


@vectorize([types.float64(types.float64, types.float64)], cache=True)
def _angle(y: Any, x: Any) -> Any:
    return math.atan2(y, x)


def angle_of(y: Array, x: Array) -> Array:
    """``math.atan2(y, x)`` [rad] of arrays, for ``np.arctan2``."""
    return _angle(y, x)


def turn_between(a: Array, b: Array | float) -> Array:
    """Absolute difference [rad] of angles, in [0, pi], shape of ``a - b``."""
    turns = np.asarray(a - b) / (2.0 * math.pi)
    return 2.0 * math.pi * np.abs(turns - np.rint(turns))


@register_jitable
def _halves(value: float) -> tuple[float, float]:
    """Two numbers with half the bits each, whose sum is exactly the value."""
    shifted = value * _SPLIT
    high = shifted - (shifted - value)
    return high, value - high


@register_jitable
def _added(total: float, lost: float, value: float) -> tuple[float, float]:
    """The next partial sum (at least 1), and its accumulated rounding error."""
    after = total + value
    return after, lost + ((total - after) + value)
