"""The helpers of the tests of the twin, twin_steps, are imported by name."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))
