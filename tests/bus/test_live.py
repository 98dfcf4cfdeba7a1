"""Previews of edits that wait for the next period of a standing twin; the session, written for whoever asks."""

import time

import pytest

from motm_twin.bus import live
from motm_twin.bus.commands import AddObstacle, Announce, FreezeBody, MoveBody, Refused, SendAgent, SetParameter
from motm_twin.bus.live import SESSION_INTERVAL, LiveTwin, SessionDesk
from motm_twin.control.tuning import parameter
from motm_twin.methods.registry import FAST, MOTM
from motm_twin.model.scene_file import load_scene
from motm_twin.model.scene_shapes import pieces
from motm_twin.twin import Twin


class Writer:
    """Counts what it writes."""

    def __init__(self):
        self.count, self.problem = 0, None

    def __call__(self):
        if self.problem is not None:
            raise self.problem
        self.count += 1
        return b"session %d" % self.count, b"info"


@pytest.fixture
def desk():
    writer = Writer()
    made = SessionDesk(writer, lambda error: f"no: {error}")
    made.writer, made.answers = writer, []
    return made


def ask(desk):
    return desk.ask(lambda *answer: desk.answers.append(answer))


def test_all_who_wait_get_the_same_session(desk):
    assert [ask(desk) for _ in range(3)] == [True, False, False]  # the loop is told once
    desk.serve(10.0, True)
    assert desk.answers == [(b"session 1", b"info", "")] * 3
    desk.serve(20.0, True)
    assert desk.writer.count == 1


def test_while_time_passes_it_is_not_written_more_often_however_often_it_is_asked_for(desk):
    times = [10.0 + 0.01 * step for step in range(101)]
    for now in times:
        ask(desk)
        desk.serve(now, True)
    assert desk.writer.count == pytest.approx(1.0 / SESSION_INTERVAL, abs=1)
    desk.serve(times[-1] + SESSION_INTERVAL, True)
    assert len(desk.answers) == len(times)  # nobody is forgotten


def test_who_waits_gets_a_session_from_after_the_question(desk):
    ask(desk)
    desk.serve(10.0, True)
    ask(desk)
    desk.serve(10.0 + 0.5 * SESSION_INTERVAL, True)
    assert len(desk.answers) == 1
    desk.serve(10.0 + SESSION_INTERVAL, True)
    assert desk.answers[1][0] == b"session 2"


def test_while_time_stands_every_question_is_answered_at_once(desk):
    for _ in range(3):
        ask(desk)
        desk.serve(10.0, False)
    assert len(desk.answers) == 3


def test_a_reason_instead_of_a_session_goes_to_everybody(desk):
    desk.writer.problem = ValueError("nothing runs")
    ask(desk), ask(desk)
    desk.serve(10.0, True)
    assert desk.answers == [(b"", b"", "no: nothing runs")] * 2


def test_more_than_a_limit_are_refused_and_the_others_answered(desk, monkeypatch):
    monkeypatch.setattr(live, "MOST_ASKERS", 2)
    ask(desk), ask(desk)
    with pytest.raises(Refused, match="too many"):
        ask(desk)
    desk.serve(10.0, True)
    assert len(desk.answers) == 2


@pytest.fixture(scope="module")
def standing():
    scene = load_scene("exp1", "trial1", 0)
    twin = LiveTwin(Twin, time.time)
    twin.clear(scene)
    twin.build(scene, MOTM)
    twin.advance(by_the_clock=False)
    return twin


def state(standing, name):
    """Of an added body, as a standing twin shows it."""
    message, _ = standing.shown()
    return next(body.state for body in message.obstacles if body.name == name)


def test_a_body_that_was_added_while_time_stands_is_shown_frozen_and_going_on_before_the_next_period(standing):
    for frozen in (True, False):
        name = f"temi {frozen}"
        standing.post(AddObstacle(name=name, shape="temi", x=-1.0, y=-1.2 + frozen))
        assert state(standing, name) == "standing"
        standing.post(FreezeBody(name=name, frozen=True))
        assert state(standing, name) == "frozen"
        standing.post(SendAgent(name=name, x=-0.2, y=-1.2) if frozen else FreezeBody(name=name, frozen=False))
        assert state(standing, name) == "standing"
        standing.post(FreezeBody(name=name, frozen=True))
        assert state(standing, name) == "frozen"
        message, _ = standing.advance(by_the_clock=False)
        assert [body.state for body in message.obstacles if body.name == name] == ["frozen"]
        standing.post(FreezeBody(name=name, frozen=False))
        assert state(standing, name) == "standing"
        standing.advance(by_the_clock=False)


def test_parameters_that_wait_are_shown_as_the_next_period_will_have_them():
    """One that was set back to its start was shown as the shipped one until the next period."""
    twin = LiveTwin(Twin, time.time)
    twin.clear(load_scene("exp1", "trial1", 0))
    twin.build(twin.scene, FAST)
    twin.advance(by_the_clock=False)
    start = twin.status()["parameters"]
    name, other = "bezier_offset", parameter("bezier_offset").default
    assert name in start and start[name] != other
    for value, shown in ((other, {**start, name: None}), (None, start), (0.4, {**start, name: 0.4}), (None, start)):
        twin.post(SetParameter(name=name, value=value))
        waiting = twin.status()["parameters"]
        assert waiting == {key: each for key, each in shown.items() if each is not None}
    twin.post(SetParameter(name="notches", value=7))
    twin.post(SetParameter(name="xi", value=0.7))
    waiting = twin.status()["parameters"]
    twin.advance(by_the_clock=False)
    assert twin.status()["parameters"] == waiting != start


def test_a_tick_says_where_the_robot_was_told_that_furniture_stands(standing):
    name, piece = next(
        (name, piece) for name, piece in pieces(standing.scene).items() if piece.mapped and not piece.bins
    )
    x, y = piece.centre
    standing.post(MoveBody(name=name, x=x + 0.05, y=y, heading=0.1, held=False))
    assert standing.advance(by_the_clock=False)[0].announced == {}
    standing.post(Announce(name=name))
    message, _ = standing.advance(by_the_clock=False)
    assert message.announced == {name: [pytest.approx(x + 0.05, abs=1e-4), pytest.approx(y, abs=1e-4), 0.1]}
    standing.reset()
    assert standing.advance(by_the_clock=False)[0].announced == {}
