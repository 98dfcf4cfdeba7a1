"""motm_twin: a web-served digital twin of reactive manipulation on the move."""

import sys
from pathlib import Path

from motm_twin.interrupts import starting
from motm_twin.stale_kernels import drop_stale_kernels

__version__ = "0.1.0"

if Path(sys.argv[0]).name == "motm-twin" or sys.orig_argv[1:3] == ["-m", "motm_twin"]:
    starting()  # here at the earliest: our command line is being loaded

drop_stale_kernels(Path(__file__).parent)
