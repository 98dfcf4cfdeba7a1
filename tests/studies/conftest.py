"""Sweeps in the test's own process, and helpers by name."""

import sys
from pathlib import Path

from own_process import in_this_process

sys.path.insert(0, str(Path(__file__).parents[1] / "bus"))

__all__ = ["in_this_process"]
