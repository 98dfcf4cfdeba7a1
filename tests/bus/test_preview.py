"""What a standing twin shows of edits that wait for its next period."""

import time

import pytest

from motm_twin.bus.commands import AddObstacle, Announce, FreezeBody, MoveBody, SendAgent
from motm_twin.bus.live import LiveTwin
from motm_twin.methods.registry import MOTM
from motm_twin.model.furniture import pieces
from motm_twin.model.scene_file import load_scene
from motm_twin.twin import Twin


@pytest.fixture(scope="module")
def live():
    scene = load_scene("exp1", "trial1", 0)
    live = LiveTwin(Twin, time.time)
    live.clear(scene)
    live.build(scene, MOTM)
    live.advance(by_the_clock=False)
    return live


def state(live, name):
    """Of an added body, as a standing twin shows it."""
    message, _ = live.shown()
    return next(body.state for body in message.obstacles if body.name == name)


def test_a_body_that_was_added_while_time_stands_is_shown_frozen_and_going_on_before_the_next_period(live):
    for frozen in (True, False):
        name = f"temi {frozen}"
        live.post(AddObstacle(name=name, shape="temi", x=-1.0, y=-1.2 + frozen))
        assert state(live, name) == "standing"
        live.post(FreezeBody(name=name, frozen=True))
        assert state(live, name) == "frozen"
        live.post(SendAgent(name=name, x=-0.2, y=-1.2) if frozen else FreezeBody(name=name, frozen=False))
        assert state(live, name) == "standing"
        live.post(FreezeBody(name=name, frozen=True))
        assert state(live, name) == "frozen"
        message, _ = live.advance(by_the_clock=False)
        assert [body.state for body in message.obstacles if body.name == name] == ["frozen"]
        live.post(FreezeBody(name=name, frozen=False))
        assert state(live, name) == "standing"
        live.advance(by_the_clock=False)


def test_a_tick_says_where_the_robot_was_told_that_furniture_stands(live):
    name, piece = next((name, piece) for name, piece in pieces(live.scene).items() if piece.mapped and not piece.bins)
    x, y = piece.centre
    live.post(MoveBody(name=name, x=x + 0.05, y=y, heading=0.1, held=False))
    assert live.advance(by_the_clock=False)[0].announced == {}
    live.post(Announce(name=name))
    message, _ = live.advance(by_the_clock=False)
    assert message.announced == {name: [pytest.approx(x + 0.05, abs=1e-4), pytest.approx(y, abs=1e-4), 0.1]}
    live.reset()
    assert live.advance(by_the_clock=False)[0].announced == {}
