"""Arithmetic that kernels share with Python to the last bit: `hypot`, `math.remainder` and `wrap_angle`.

Numba's ``math.hypot`` is the C library's: now and then it differs from Python's in the last bit. ``math.remainder`` it
does not have. A run must not depend on which of its parts are compiled.
"""

import math
from collections.abc import Callable

import numpy as np
from numba.extending import overload, register_jitable

from motm_twin.model.geometry import wrap_angle

__all__ = ["hypot", "wrap_angle"]

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
