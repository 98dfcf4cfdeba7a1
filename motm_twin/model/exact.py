"""Arithmetic that kernels share with Python and NumPy to the last bit: a run must not depend on what is compiled.

Numba's ``math.hypot`` is the C library's: now and then it differs from Python's in the last bit. ``math.remainder`` it
does not have. Its ``np.dot`` and ``@`` call BLAS, as NumPy does, which takes longer than three products, and which sums
them as here.
"""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numba import njit, types
from numba.extending import intrinsic, overload, register_jitable

from motm_twin.model.geometry import Array, wrap_angle

__all__ = ["hypot", "norm", "product", "wrap_angle"]

_SPLIT = 134217729.0  # 2^27 + 1: halves a number of 53 bits (Veltkamp and Dekker)
_TINY = 1e-300  # lengths below it are not told from the larger coordinate


def hypot(x: float, y: float) -> float:
    """Length of (x, y), both finite: `math.hypot`."""
    return math.hypot(x, y)


@overload(hypot)
def _hypot(x: float, y: float) -> Callable[[float, float], float]:
    """As CPython 3.11 has it (``vector_norm``): squares without rounding, compensated sum, one corrected root."""

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
    """x less the nearest multiple of y > 0: exact, as both steps are; half way, the even multiple."""

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


@njit(cache=True)
def norm(vector: Array) -> float:
    """Length of a vector of two or three: ``np.linalg.norm``."""
    total = 0.0
    for value in vector:
        total = fma(value, value, total)
    return math.sqrt(total)


@njit(cache=True)
def product(A: Array, B: Array) -> Array:
    """``A @ B`` of matrices (3, 3)."""
    C = np.zeros((3, 3))
    for i in range(3):
        for j in range(3):
            for k in range(3):
                C[i, j] = fma(A[i, k], B[k, j], C[i, j])
    return C


@register_jitable
def _halves(value: float) -> tuple[float, float]:
    """Two numbers of half the bits, whose sum the value is."""
    shifted = value * _SPLIT
    high = shifted - (shifted - value)
    return high, value - high


@register_jitable
def _added(total: float, lost: float, value: float) -> tuple[float, float]:
    """A sum that is 1 or more, and what its rounding has lost so far."""
    after = total + value
    return after, lost + ((total - after) + value)
