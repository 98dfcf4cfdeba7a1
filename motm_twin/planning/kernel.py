"""How the kernels of this room are compiled."""

import math

from numba import njit

# Without reference counts: numba counts every array of a tuple at every call, which made a search node 30 times
# slower. Such a kernel cannot allocate; its arrays belong to the caller.
kernel = njit(cache=True, _nrt=False, error_model="numpy")

# The same for functions that take large tuples: passing those (by value) costs more than the work inside.
inlined = njit(cache=True, _nrt=False, error_model="numpy", forceinline=True)


@kernel
def length_of(x: float, y: float) -> float:
    """Length of a vector; math.hypot, which guards against overflow, takes five times as long."""
    return math.sqrt(x * x + y * y)
