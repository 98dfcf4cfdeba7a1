"""Numba's options for all kernels, and how a kernel is made that compiles quickly.

The first start compiles all of them, so that their number and size is a wait for everybody who installs.

- Nothing calls kernels from C. The wrapper for that, which Numba makes of each, is a tenth of the time.
- Numba compiles a kernel once more for every type of its arguments, and a literal or a read-only array is a type of its
  own. So kernels pass ``np.bool_(True)``, ``np.int64(3)`` and writable arrays to each other.
- Assigning an array to a slice (``a[:3] = b``) can fail for a wrong shape. The code for the text of that error alone
  compiles for 2 s, in every process that meets it first. A loop has no such error.
"""

from functools import partial
from typing import Any

import numba

_OPTIONS: Any = {"no_cfunc_wrapper": True}
njit: Any = partial(numba.njit, **_OPTIONS)
