"""One served twin for a module, with a bridge in the form that a test asks for."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))

from ear import Served


@pytest.fixture(scope="module")
def served():
    with Served() as everything:
        yield everything
