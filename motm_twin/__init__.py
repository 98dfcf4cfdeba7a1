"""motm_twin: a web-served digital twin of reactive manipulation on the move."""

from pathlib import Path

from motm_twin.stale_kernels import drop_stale_kernels

__version__ = "0.1.0"

drop_stale_kernels(Path(__file__).parent)
