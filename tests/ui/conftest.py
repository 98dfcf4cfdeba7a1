import sys
from contextlib import ExitStack
from pathlib import Path

import msgspec
import pytest
import viser

for folder in (Path(__file__).parent, Path(__file__).parent.parent / "bus"):
    sys.path.insert(0, str(folder))


_open = {}  # the browser of the tests in one that follow each other, and its end


@pytest.fixture
def browser():
    """Chromium, as long as tests with a browser follow each other."""
    from page import chromium, tidy

    if not _open:
        stack = ExitStack()
        _open.update(browser=stack.enter_context(chromium()), close=stack.close)
    yield _open["browser"]
    tidy(_open["browser"])


@pytest.hookimpl(trylast=True)
def pytest_runtest_teardown(nextitem):
    """While a browser is open, nothing else in this thread may have an event loop."""
    if _open and (nextitem is None or not nextitem.get_closest_marker("browser")):
        _open.pop("close")()
        _open.clear()


@pytest.fixture
def server():
    """Viser's, as it is, without visitors."""
    made = viser.ViserServer("127.0.0.1", 0, verbose=False)
    yield made
    made.stop()


@pytest.fixture(scope="session")
def served(tmp_path_factory):
    """The room, as a user serves it. Not for a test: it is as the last one left it."""
    from page import TEXT, serving

    path = tmp_path_factory.mktemp("served") / "room.yaml"
    path.write_text(TEXT, encoding="utf-8")
    with serving(path) as twin:
        yield twin


@pytest.fixture
def begun(served):
    """A run of a scene from its start, at 1x and by the shipped method, on the page of all tests; nobody drives."""
    from page import begin, pause

    def called(scene, variant="trial1", **how):
        begin(served, scene, variant, **how)
        return served

    yield called
    pause(served.client)  # the processor is the next test's


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
