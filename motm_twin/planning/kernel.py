"""How the kernels of this room are compiled."""

from numba import njit

# Without reference counts: numba counts every array of a tuple at every call, which made a search node 30 times
# slower. Such a kernel cannot allocate; its arrays belong to the caller.
kernel = njit(cache=True, _nrt=False)
