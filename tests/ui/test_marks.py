"""Events on the timeline: of the run that is shown, and of the past that it shares."""

from types import SimpleNamespace

import pytest

from motm_twin.bus.messages import NumberedEvent
from motm_twin.ui.history import EventMarks

NUMBERS = iter(range(1, 1000))


def event(run, index, kind="picked", since=0.0):
    return NumberedEvent(
        version="motm.event/1", seq=next(NUMBERS), run=run, server_time=0.0, index=index, time=index * 0.05,
        kind=kind, numbered_since=since,
        text=f"{kind} {run}.{index}",
    )  # fmt: skip


def period(run, first=0, past=-1):
    return SimpleNamespace(run=run, first=first, past=past)


@pytest.fixture
def marks():
    marks = EventMarks()
    marks.follow(period(1))
    marks.add([event(1, 10), event(1, 50)])
    return marks


def told(marks):
    return [found.text for found in marks.last(10)]


def test_a_branch_keeps_the_past_and_its_undoing_brings_back_what_it_cut_off(marks):
    marks.follow(period(2, first=30))
    marks.add([event(2, 40)])
    assert told(marks) == ["picked 1.10", "picked 2.40"]
    marks.follow(period(3, first=60, past=1))
    assert told(marks) == ["picked 1.10", "picked 1.50"]


def test_a_reset_has_no_past(marks):
    marks.follow(period(2))
    assert told(marks) == []


def test_an_event_that_comes_twice_is_one(marks):
    again = marks.last(1)
    marks.add(again)
    assert told(marks) == ["picked 1.10", "picked 1.50"]


def test_a_stop_that_soon_ends_is_no_mark(marks):
    marks.add(
        [event(1, 60, "stop"), event(1, 62, "go"), event(1, 70, "stop"), event(1, 90, "go"), event(1, 95, "stop")]
    )
    assert told(marks)[2:] == ["stop 1.70", "stop 1.95"]


def test_another_server_has_the_same_numbers_of_runs_and_other_events(marks):
    marks.add([event(1, 0, "loaded", since=9.0), event(1, 20, since=9.0)])
    assert told(marks) == ["picked 1.20"]
