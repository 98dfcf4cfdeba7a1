"""A router and a scene for tests of external robots."""

import sys
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))  # helpers are imported by name

from meeting import Router

from motm_twin.model.scene import Scene
from motm_twin.model.scene_file import load_scene


@pytest.fixture
def router() -> Iterator[Router]:
    """A router of its own."""
    middle = Router()
    with ExitStack() as stack:
        stack.callback(middle.session.close)
        yield middle


@pytest.fixture(scope="session")
def scene() -> Scene:
    """Experiment 1, trial 1."""
    return load_scene("exp1", "trial1")
