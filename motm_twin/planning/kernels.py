"""Compiled building blocks of the searches: how kernels are compiled, lengths, and a binary heap."""

import math

import numpy as np
from numpy.typing import NDArray

from motm_twin.model.compiler import njit
from motm_twin.model.geometry import Array
from motm_twin.model.motion import kernel

# As `kernel`, for functions that take large tuples: passing those (by value) costs more than the work inside.
inlined = njit(cache=True, _nrt=False, error_model="numpy", forceinline=True)


@kernel
def length_of(x: float, y: float) -> float:
    """Length of a vector; math.hypot, which guards against overflow, takes five times as long."""
    return math.sqrt(x * x + y * y)


@kernel
def heap_push(key: Array, item: NDArray[np.int32], size: int, new_key: float, new_item: int) -> int:
    """Add an entry to the first `size` ones of a heap in two arrays; returns the new size.

    Equal keys leave in the order of their items.
    """
    i = size
    while i > 0:
        parent = (i - 1) >> 1
        if key[parent] < new_key or (key[parent] == new_key and item[parent] < new_item):
            break
        key[i], item[i] = key[parent], item[parent]
        i = parent
    key[i], item[i] = new_key, new_item
    return size + 1


@kernel
def heap_pop(key: Array, item: NDArray[np.int32], size: int) -> int:
    """Remove the first entry (read key[0], item[0] before); returns the new size."""
    size -= 1
    last_key, last_item = key[size], item[size]
    i = 0
    while True:
        child = 2 * i + 1
        if child >= size:
            break
        right = child + 1
        if right < size and (key[right] < key[child] or (key[right] == key[child] and item[right] < item[child])):
            child = right
        if last_key < key[child] or (last_key == key[child] and last_item < item[child]):
            break
        key[i], item[i] = key[child], item[child]
        i = child
    key[i], item[i] = last_key, last_item
    return size
