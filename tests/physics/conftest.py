"""Without the extra there is nothing to test here. Helpers of the tests of the simulation are imported by name."""

import sys
from pathlib import Path

import pytest

pytest.importorskip("mujoco")
sys.path.insert(0, str(Path(__file__).parents[1] / "sim"))
sys.path.insert(0, str(Path(__file__).parent))
