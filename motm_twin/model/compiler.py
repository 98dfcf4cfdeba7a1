"""Numba's options for all kernels, and rules for kernels that compile quickly.

The first start compiles all of them, so everybody who installs the package waits for their number and size.

- Nothing calls kernels from C. Numba's wrapper for such calls takes a tenth of the compile time.
- Numba compiles a kernel again for every combination of argument types, and a literal or a read-only array is a type of
  its own. So kernels pass ``np.bool_(True)``, ``np.int64(3)`` and writable arrays to each other.
- Assigning an array to a slice (``a[:3] = b``) can fail for a wrong shape. The code for the text of that error alone
  takes 2 s to compile, in every process that meets it first. A loop has no such error.
"""

from functools import partial
from typing import Any

import numba

_OPTIONS: Any = {"no_cfunc_wrapper": True}
njit: Any = partial(numba.njit, **_OPTIONS)
