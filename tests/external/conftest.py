"""A router and a scene for tests of external robots."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))  # helpers are imported by name

from meeting import Router, driven, running_robot

from motm_twin.model.scene_file import load_scene


@pytest.fixture
def router():
    """A router of its own."""
    middle = Router()
    yield middle
    middle.session.close()


@pytest.fixture(scope="session")
def scene():
    """Experiment 1, trial 1."""
    return load_scene("exp1", "trial1")


@pytest.fixture
def robot(router, scene):
    """A robot with a shared clock."""
    with running_robot(router, scene) as server:
        yield server


@pytest.fixture
def twin(router, scene, robot):
    """The twin that drives it."""
    with driven(router, scene) as met:
        yield met
