"""A run waits for its audience, and the next seed starts when one has ended and nobody drives."""

import time

import pytest
from fake_twin import FakeTwin
from running import Running
from waiting import until

from motm_twin.bus import loop
from motm_twin.bus.commands import Audience, Drive, Pause, Play, Reset, TakeWheel


@pytest.fixture(autouse=True)
def soon(monkeypatch):
    monkeypatch.setattr(loop, "AGAIN", 0.05)


def short(scene, *, method=None):
    return FakeTwin(scene, method=method, periods=3)


def state(running):
    return running.loop.status().state


def test_a_run_waits_at_its_start_until_a_page_shows_it_and_says_so():
    with Running(playing=True, hold=True) as running:
        assert state(running) == "paused" and "first page" in running.loop.status().text
        assert [tick.index for tick in running.sink.ticks] == [0]
        assert running.loop.status().pages == 0
        assert running.ask(Audience(pages=0)) == "" and state(running) == "paused"
        assert running.ask(Audience(pages=1)) == "" and state(running) == "playing"
        assert running.loop.status().driver == ""


def test_a_run_that_waits_for_a_page_starts_when_somebody_drives_without_one():
    command = Drive(v=0.1, w=0.0)
    with Running(playing=True, hold=True) as running:
        assert running.loop.status().held
        assert running.ask(command) == "" and state(running) == "playing"
        assert not running.loop.status().held
        running.ask(Pause())
        running.ask(command)
        assert state(running) == "paused", "a pause by a person is ended by nobody else"


def test_a_pause_by_a_person_is_not_ended_by_a_visitor():
    with Running(playing=True, hold=True) as running:
        running.ask(Audience(pages=1))
        running.ask(Pause())
        running.ask(Audience(pages=2))
        assert state(running) == "paused"


def test_play_needs_no_page_and_a_reset_after_it_neither():
    with Running(playing=True, hold=True) as running:
        running.ask(Play())
        assert state(running) == "playing"
        running.ask(Reset())
        until(lambda: state(running) == "playing", "it waits for a page again")


def test_a_page_is_told_by_somebody_who_does_not_drive():
    with Running(playing=True, hold=True) as running:
        assert running.ask(TakeWheel()) == ""
        assert running.ask(Audience(pages=1), sender="bob", name="Bob") == ""
        assert state(running) == "playing"


def test_the_next_seed_starts_when_nobody_drives_and_waits_for_a_page():
    with Running(make_twin=short, playing=True, hold=True, again=True) as running:
        running.ask(Audience(pages=1))
        until(lambda: len(running.twins) >= 3, "no further run begins")
        assert [twin.scene.seed for twin in running.twins[:3]] == [0, 1, 2]
        running.ask(Audience(pages=0))
        until(lambda: "first page" in running.loop.status().text, "it goes on with nobody there")


@pytest.mark.parametrize("again", [False, True])
def test_a_driver_keeps_what_has_ended(again):
    with Running(make_twin=short, playing=False, again=again) as running:
        running.ask(Play())  # now there is a driver
        until(lambda: state(running) == "done", "it does not end")
        later = time.monotonic() + 4.0 * loop.AGAIN
        until(lambda: time.monotonic() > later, "no time passes")
        assert len(running.twins) == 1


def test_a_twin_that_waits_for_nobody_does_not_ask():
    with Running(playing=False) as running:
        assert running.loop.status().pages == -1
