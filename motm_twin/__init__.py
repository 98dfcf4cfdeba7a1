"""motm_twin: a web-served digital twin of reactive manipulation on the move."""

import sys
from pathlib import Path

from motm_twin.interrupts import starting

__version__ = "0.1.0"


def drop_stale_kernels(package: Path) -> int:
    """Delete compiled kernels below a folder that are older than the newest source with kernels; returns their number.

    Numba recompiles a kernel when its own file has changed, but not when a kernel that it calls has: after a `git pull`
    or an edit a run would mix old and new parts. Called when the package is imported, before any kernel is loaded. A
    read-only installation is left as it is: its sources do not change either.
    """
    indices = list(package.glob("**/__pycache__/*.nbi"))
    sources = {index.parent.parent / f"{index.name.partition('.')[0]}.py" for index in indices}
    newest = max((source.stat().st_mtime_ns for source in sources if source.exists()), default=0)
    dropped = 0
    for index in indices:
        try:
            if index.stat().st_mtime_ns < newest:
                index.unlink()
                dropped += 1
        except OSError:  # somebody else was faster, or the installation cannot be written to
            continue
    return dropped


if Path(sys.argv[0]).name == "motm-twin" or sys.orig_argv[1:3] == ["-m", "motm_twin"]:
    starting()  # here at the earliest: our command line is being loaded

drop_stale_kernels(Path(__file__).parent)
