"""A short run with a bit of everything a person may do, recorded once for all tests of a process: fixtures."""

import functools
from dataclasses import dataclass

import pytest

from motm_twin.methods.registry import MOTM
from motm_twin.model.edits import (
    AddObstacle,
    Announce,
    InjectFault,
    InsertTask,
    MoveBody,
    PushRobot,
    ReleaseBody,
    RemoveBody,
    SendAgent,
    SetParameter,
)
from motm_twin.model.scene import DriveTo
from motm_twin.model.scene_file import load_scene
from motm_twin.planning.types import SearchBudget
from motm_twin.sessions.session import Session
from motm_twin.twin import Twin

PERIODS = 100
DISTURBANCES = {
    5: [AddObstacle(name="guest", shape="temi", x=2.4, y=0.3)],
    12: [MoveBody(name="guest", x=2.2, y=0.2), SetParameter(name="next_weight", value=0.5)],
    20: [ReleaseBody(name="guest", velocity=(0.4, 0.1)), PushRobot(dx=0.03, dy=0.0, turn=0.05)],
    33: [MoveBody(name="cabinet", x=0.4, y=-1.8, held=False), InjectFault(fault="lidar_off", seconds=0.3)],
    41: [Announce(name="cabinet"), SetParameter(name="next_weight")],
    55: [SendAgent(name="guest", x=1.0, y=-1.0), InsertTask(tasks=(DriveTo(point=(1.0, 0.0)),))],
    80: [RemoveBody(name="guest")],
}


@dataclass(frozen=True)
class Recorded:
    """The run: its session, and the hash of the state before each period and after the last one."""

    session: Session
    hashes: tuple[str, ...]


class Clock:
    """Runs 1 ms further with every look: searches end where this says, whatever the machine does."""

    def __init__(self) -> None:
        self.looks = 0

    def __call__(self) -> float:
        self.looks += 1
        return 1e-3 * self.looks


@pytest.fixture(scope="session")
def disturbances():
    return DISTURBANCES


@pytest.fixture(scope="session")
def clocked():
    return _clocked


def _clocked(scene, method=MOTM):
    """The twin of a scene as the server has it: the clock ends some of its searches."""
    return Twin(scene, method=method, budget=SearchBudget(seconds=0.004), clock=Clock())


@pytest.fixture
def clocked_twin(clocked):
    return clocked(load_scene("exp1", "trial2", 2))


@pytest.fixture(scope="session")
def recorded():
    return _recorded()


@functools.cache
def _recorded():
    twin = _clocked(load_scene("exp1", "trial2", 2))
    hashes = []
    for index in range(PERIODS):
        hashes.append(twin.state_hash())
        for edit in DISTURBANCES.get(index, []):
            twin.post(edit)
        twin.advance()
    session = twin.session("a bit of everything")
    return Recorded(session, (*hashes, session.state_hash))
