"""The helpers of these tests, sim_scenes and sim_hands, are imported by name."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))
