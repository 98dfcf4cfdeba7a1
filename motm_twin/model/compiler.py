"""Numba's options for all kernels, and how a kernel is made that compiles quickly.

The first start compiles all of them, so that their number and size is a wait for everybody who installs.

- Nothing calls kernels from C. The wrapper for that, which Numba makes of each, is a tenth of the time.
- A literal is a type of its own when one kernel gives it to another, and so is a read-only array: the kernel that gets
  it is compiled once more. So ``np.bool_(True)`` and ``np.int64(3)`` are given, and arrays that are all writable.
- An array that is assigned to a slice (``a[:3] = b``) may have another shape. The text of that error alone compiles for
  2 s, in every process that meets it first. A loop has no such error.
"""

from functools import partial
from typing import Any

import numba

_OPTIONS: Any = {"no_cfunc_wrapper": True}
njit: Any = partial(numba.njit, **_OPTIONS)
