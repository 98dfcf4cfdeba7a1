"""What the stage keeps in the page: few moving nodes, nothing sent twice, nothing left behind."""

import math

import msgspec
import pytest
import viser
from fake_twin import FakeTwin, fake_scene

from motm_twin.bus.client import TwinClient
from motm_twin.bus.connection import free_port
from motm_twin.bus.encode import tick_message
from motm_twin.bus.messages import BodyMessage, TickMessage
from motm_twin.ui.hub import Hub, Shown
from motm_twin.ui.stage import Stage
from motm_twin.ui.what_if import Other

FIXED = ("/scene/", "/light/", "/furniture/")


@pytest.fixture
def tick():
    """A tick as a client receives it."""
    sent = msgspec.json.encode(tick_message(FakeTwin(fake_scene()).advance(), 1, 0.0))
    return msgspec.json.decode(sent, type=TickMessage)


@pytest.fixture
def stage():
    """A stage on a page that nobody looks at, with no twin behind it."""
    server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
    with TwinClient(f"tcp/127.0.0.1:{free_port()}") as client:
        hub = Hub(server, client)
        drawn = Stage(server, hub)
        yield drawn
        drawn.stop()
        hub.stop()
    server.stop()


def show(stage, tick, scene):
    shown = Shown(
        state="playing", status=None, scene=scene, tick=tick, newest=tick, live=True, view=stage._hub.view, grid=None
    )
    stage.draw(shown, 0.03, slow=True)


def nodes(stage):
    """Names of all nodes that are drawn."""
    table = stage._server.scene._handle_from_node_name
    return {name for name, handle in table.items() if type(handle).__name__ != "FrameHandle"}


def person(name, **fields):
    return BodyMessage(
        name=name, kind="person", position=[0.5, 0.5, 0.0], yaw=0.3, state="standing", size=[0.5, 0.5, 1.75], **fields
    )


def test_a_trail_is_left_by_what_goes_and_not_by_what_is_put_elsewhere_or_seen_earlier(stage, tick):
    def at(x, time):
        walker = msgspec.structs.replace(person("Ann"), position=[x, 0.5, 0.0])
        show(stage, msgspec.structs.replace(tick, agents=[walker], time=time), scene)
        return len(stage._bodies._bodies["body/Ann"].trail)

    scene = fake_scene()
    assert [at(0.5 + 0.1 * k, 1.0 + 0.1 * k) for k in range(4)] == [1, 2, 3, 4]
    assert at(3.0, 1.3) == 1  # while time stands
    assert [at(3.1, 1.4), at(3.2, 1.5), at(6.0, 1.6)] == [2, 3, 1]  # while it runs
    assert [at(6.1, 1.7), at(3.1, 1.4)] == [2, 1]  # looking back
    assert not stage._bodies._trails.visible


def test_fewer_than_a_hundred_nodes_move(stage, tick):
    show(stage, tick, fake_scene())
    stage._others.update([Other(label="changed: 7.1 s", pose=(0.0, 0.0, 0.0), q=(0.0,) * 7, gripper=0.08)])
    moving = [name for name in nodes(stage) if not name.startswith(FIXED)]
    assert 20 < len(moving) <= 100


def test_the_same_tick_again_sends_nothing(stage, tick):
    scene = fake_scene()
    show(stage, tick, scene)
    sent = []
    stage._server.scene._queue_scene_message = sent.append
    show(stage, tick, scene)
    assert sent == []


def test_a_body_comes_moves_is_marked_frozen_and_goes_without_a_trace(stage, tick):
    scene = fake_scene()
    show(stage, tick, scene)
    before = nodes(stage)
    show(stage, msgspec.structs.replace(tick, obstacles=[person("ann")]), scene)
    frozen = msgspec.structs.replace(person("ann"), state="frozen")
    show(stage, msgspec.structs.replace(tick, obstacles=[frozen]), scene)
    assert any(name.endswith("sign") for name in nodes(stage) - before)
    show(stage, msgspec.structs.replace(tick, obstacles=[]), scene)
    assert nodes(stage) == before


def test_furniture_stands_where_the_tick_has_it_and_is_hidden_when_gone(stage, tick):
    scene = fake_scene()
    show(stage, tick, scene)
    name = next(iter(stage._surroundings.pieces))
    frame = stage._server.scene._handle_from_node_name[f"/furniture/{name}"]
    body = BodyMessage(
        name=name, kind="furniture", position=[1.0, -2.0, 0.0], yaw=math.pi / 2, state="", size=[1.0, 1.0, 1.0]
    )
    show(stage, msgspec.structs.replace(tick, furniture=[body]), scene)
    assert tuple(frame.position[:2]) == (1.0, -2.0)
    assert frame.wxyz[3] == pytest.approx(math.sin(math.pi / 4))
    show(stage, msgspec.structs.replace(tick, removed=[name]), scene)
    assert not frame.visible
    show(stage, tick, scene)
    assert frame.visible


def test_another_scene_replaces_everything_of_the_last_one(stage, tick):
    show(stage, tick, fake_scene())
    before = nodes(stage)
    show(stage, tick, msgspec.structs.replace(fake_scene(), seed=5))
    assert nodes(stage) == before
