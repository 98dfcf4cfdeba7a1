import sys
from pathlib import Path

import msgspec
import pytest

for folder in (Path(__file__).parent, Path(__file__).parent.parent / "bus"):
    sys.path.insert(0, str(folder))


@pytest.fixture(scope="module")
def browser():
    """For a file only: while one is open, nothing else in this thread may have an event loop."""
    from page import chromium

    with chromium() as opened:
        yield opened


@pytest.fixture(scope="session")
def served(tmp_path_factory):
    """The room, as a user serves it. Not for a test: it is as the last one left it."""
    from page import serving
    from room import TEXT

    path = tmp_path_factory.mktemp("served") / "room.yaml"
    path.write_text(TEXT, encoding="utf-8")
    with serving(path) as twin:
        yield twin


@pytest.fixture
def begun(served):
    """A run of a scene from its start, at 1x and by the shipped method, on the page of all tests; nobody drives."""
    from page import begin

    from motm_twin.bus.commands import Pause
    from motm_twin.perf.processes import act

    def called(scene, variant="trial1"):
        begin(served, scene, variant)
        return served

    yield called
    act(served.client, Pause())  # the processor is the next test's


@pytest.fixture
def tick():
    """A tick as a client receives it."""
    from fake_twin import FakeTwin, fake_scene

    from motm_twin.bus.encode import tick_message
    from motm_twin.bus.messages import TickMessage

    sent = msgspec.json.encode(tick_message(FakeTwin(fake_scene()).advance(), 1, 0.0))
    return msgspec.json.decode(sent, type=TickMessage)


@pytest.fixture
def driving(tick):
    """Such a tick, of a robot that drives."""
    robot = msgspec.structs.replace(tick.robot, twist=[0.4, 0.1])
    return msgspec.structs.replace(tick, robot=robot, stop_reason="", done=False)
