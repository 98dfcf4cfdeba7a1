import sys
from pathlib import Path

import msgspec
import pytest

for folder in (Path(__file__).parent, Path(__file__).parent.parent / "bus"):
    sys.path.insert(0, str(folder))


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
