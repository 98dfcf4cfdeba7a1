"""The recorded run, and helpers by name."""

import sys
from pathlib import Path

from recorded_run import clocked, clocked_twin, disturbances, recorded

sys.path[:0] = [str(Path(__file__).parent), str(Path(__file__).parents[1] / "bus")]  # its stand-in for a twin

__all__ = ["clocked", "clocked_twin", "disturbances", "recorded"]
