"""The last two minutes and their events: what is kept, what is cut off, and that it does not grow."""

import os
import threading
from types import SimpleNamespace

import msgspec
import numpy as np
import pytest
from fake_twin import FakeTwin, fake_scene
from hypothesis import example, given, settings
from hypothesis import strategies as st

from motm_twin.bus.encode import tick_message
from motm_twin.bus.messages import GRID_VERSION, EventMessage, GridInfo, NumberedEvent
from motm_twin.ui.history import EventMarks, History, Sample

encode = msgspec.json.encode
MESSAGE = tick_message(FakeTwin(fake_scene()).advance(), 1, 0.0)


def payload(index, *, run=1, **changes):
    changed = msgspec.structs.replace(MESSAGE, index=index, time=0.05 * index, run=run, **changes)
    return encode(changed)


def grid_info(width, height, *, run=1, stamp=0.0):
    return GridInfo(
        version=GRID_VERSION, run=run, encoding="", resolution=0.05, origin=[0, 0], width=width, height=height,
        stamp=stamp,
    )  # fmt: skip


def add_grid(history, stamp, fill, *, run=1):
    history.add_grid(np.full(600, fill, dtype=np.uint8).tobytes(), encode(grid_info(30, 20, run=run, stamp=stamp)))


def filled(count, **options):
    history = History(**options)
    for index in range(count):
        history.add(payload(index))
    return history


def test_a_period_comes_back_as_it_was_sent():
    history = filled(30)
    assert encode(history.at(7)) == history.payload_at(7) == payload(7)
    assert history.at(7) is history.at(7)
    assert history.span == (0, 29, 0.0, pytest.approx(1.45))


def test_before_the_first_period_there_is_nothing():
    history = History()
    assert history.at(0) is history.grid_at(0) is history.span is None
    assert history.samples(None, 60.0).shape == (0, len(Sample._fields))
    assert history.events(None, 8) == []


def test_a_period_that_was_missed_shows_the_one_before_and_a_forgotten_one_the_oldest():
    history = filled(20, periods=10)
    history.add(payload(25))
    assert history.at(22).index == 19
    assert history.at(0).index == history.span.first == 11
    assert history.at(999).index == 25


def test_a_branch_cuts_off_what_comes_no_more():
    history = filled(30)
    add_grid(history, 0.0, 1)
    add_grid(history, 1.2, 2)
    history.add(payload(10))
    assert history.span[:2] == (0, 10)
    assert history.grid_at(10).cells[0, 0] == 1
    history.add(payload(11))
    assert history.span[:2] == (0, 11)


def test_a_preview_is_no_period_that_was():
    history = filled(5)
    history.add(payload(4, preview=True))
    assert history.indices(10.0) == [0, 1, 2, 3, 4]
    assert not history.at(4).preview


def test_an_undone_branch_brings_back_what_it_had_cut_off():
    history = filled(60)
    for stamp, fill in ((0.0, 1), (1.0, 2), (2.5, 3)):
        add_grid(history, stamp, fill)
    before, rows = history._bytes, history.samples(None, 60.0)
    for index in range(30, 40):
        history.add(payload(index, run=2, first=30, past=1))
    add_grid(history, 1.8, 9, run=2)
    assert history.span[:2] == (0, 39)
    history.add(payload(60, run=3, first=60, past=1))
    assert history.indices(60.0) == list(range(61))
    assert [history.at(index).run for index in (29, 30, 59, 60)] == [1, 1, 1, 3]
    assert [history.grid_at(index).cells[0, 0] for index in (10, 37, 59)] == [1, 2, 3]
    np.testing.assert_array_equal(history.samples(59, 60.0), rows)
    assert history._bytes > before
    history.add(payload(40, run=4, first=40, past=2))  # and the other way round
    assert history.indices(60.0) == list(range(41))
    assert [history.at(index).run for index in (29, 30, 39, 40)] == [1, 2, 2, 4]
    assert history.grid_at(40).cells[0, 0] == 9
    history.add(payload(8, run=9, first=8, past=7))  # of a run that never was seen
    assert history.indices(60.0) == [8]


def test_a_run_that_fills_the_history_comes_back_after_a_branch_that_does_too():
    history = filled(40, periods=20)
    for index in range(25, 70):
        history.add(payload(index, run=2, first=25, past=1))
    assert history.span[:2] == (50, 69)
    history.add(payload(40, run=3, first=40, past=1))
    assert history.span[:2] == (25, 40)
    assert history.samples(None, 60.0).shape[0] == 16


def test_a_branch_keeps_the_past_that_it_shares_and_a_reset_or_another_server_does_not():
    history = filled(30)
    for stamp, fill in ((0.0, 1), (0.3, 2), (1.2, 3)):
        add_grid(history, stamp, fill)
    add_grid(history, 0.5, 4, run=2)
    history.add(payload(12, run=2, first=10))  # two of them were lost
    assert history.indices(10.0) == [*range(10), 12]
    assert [history.at(index).run for index in (9, 12)] == [1, 2]
    assert [history.grid_at(index).cells[0, 0] for index in (0, 9, 12)] == [1, 2, 4]
    history.add(payload(13, run=2, first=10))
    assert history.span[:2] == (0, 13)
    history.add(payload(3, run=3, began=7.0))  # a reset
    assert history.indices(10.0) == [3]
    history.add(payload(4, run=3, began=7.0))
    history.add(payload(5, run=3, began=9.0))  # another server
    assert history.indices(10.0) == [5]
    assert history.grid_at(5) is None


def test_another_run_begins_anew_and_stragglers_of_the_old_one_are_dropped():
    history = filled(5)
    add_grid(history, 0.0, 1)
    add_grid(history, 0.0, 3, run=2)  # the grid may come first
    history.add(payload(0, run=2))
    add_grid(history, 0.2, 1)
    assert history.span[:2] == (0, 0)
    assert history.grid_at(0).cells[0, 0] == 3


def test_the_grid_is_the_one_that_was_in_force():
    history = filled(50)
    for stamp, fill in ((0.0, 1), (0.5, 2), (1.0, 2), (1.5, 3)):
        add_grid(history, stamp, fill)
    assert [int(history.grid_at(index).cells[0, 0]) for index in (0, 9, 10, 29, 30, 49)] == [1, 1, 2, 2, 3, 3]
    assert history.grid_at(12) is history.grid_at(25)


def test_samples_end_at_the_period_that_is_looked_at():
    history = filled(200)
    rows = history.samples(100, 2.0)
    assert rows[[0, -1], 0] == pytest.approx([3.0, 5.0])
    assert len(history.samples(None, 1e9)) == 200
    assert rows[-1, Sample._fields.index("speed")] == pytest.approx(MESSAGE.robot.twist[0])


def test_events_come_newest_first_and_only_those_that_have_happened():
    history = History()
    for index in range(10):
        history.add(payload(index, events=[EventMessage(time=0.05 * index, kind="picked", text=str(index))]))
    assert [event.text for event in history.events(None, 3)] == ["9", "8", "7"]
    assert [event.text for event in history.events(4, 3)] == ["4", "3", "2"]


def test_other_versions_and_broken_grids_are_refused():
    history = History()
    with pytest.raises(ValueError, match=r"not 'motm\.tick/9'"):
        history.add(payload(0, version="motm.tick/9"))
    with pytest.raises(ValueError, match="3 x 3 cells came with 4 bytes"):
        history.add_grid(b"1234", encode(grid_info(3, 3)))


# index, run, with a grid, bytes more, first period of its run
ARRIVAL = (st.integers(0, 40), st.integers(1, 3), st.booleans(), st.integers(0, 3000), st.integers(0, 40))


@settings(max_examples=60, deadline=None)
@given(st.lists(st.tuples(*ARRIVAL), min_size=1, max_size=120))
@example([(0, 1, False, 0, 0)] * 3 + [(1, 1, True, 0, 0), (2, 2, False, 0, 2), (0, 2, True, 0, 0)])  # back, on a branch
def test_whatever_comes_the_history_stays_in_order_and_bounded(arrivals):
    """Any order of runs, jumps back and sizes: indices rise, the newest is the last that came, bounds hold."""
    history = History(periods=16, max_bytes=20_000)
    for index, run, grid, size, first in arrivals:
        if grid:
            add_grid(history, 0.05 * index, index, run=run)
        text = os.urandom(size // 2).hex()
        history.add(payload(index, run=run, first=min(first, index), stop_reason=text))
        indices = history.indices(1e9)
        assert indices == sorted(set(indices)) and len(indices) <= 16
        assert history.span.last == index == history.at(index).index and history.at(index).run == run
        assert [round(time / 0.05) for time in history.samples(None, 1e9)[:, 0]] == indices
        assert history._bytes == sum(len(entry.payload) for entry in history._entries)
        assert history._bytes <= 20_000 or len(indices) == 1
        assert history._map_bytes == sum(len(kept.cells) for kept in history._maps)
        grids = [kept.stamp for kept in history._maps]
        assert grids == sorted(grids)


def test_it_can_be_read_while_ticks_arrive():
    history = History(periods=50)

    def write():
        for index in range(400):
            history.add(payload(index))
            if index % 5 == 0:
                add_grid(history, 0.05 * index, index % 200)

    writer = threading.Thread(target=write)
    writer.start()
    while writer.is_alive():
        if span := history.span:
            tick = history.at((span.first + span.last) // 2)
            history.grid_at(tick.index)
            history.samples(tick.index, 60.0)
            assert tick.index <= span.last + 400
    writer.join()
    assert history.span.last == 399


NUMBERS = iter(range(1, 1000))


def event(run, index, kind="picked", since=0.0):
    return NumberedEvent(
        version="motm.event/1", seq=next(NUMBERS), run=run, server_time=0.0, index=index, time=index * 0.05,
        kind=kind, numbered_since=since, text=f"{kind} {run}.{index}",
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


def test_an_event_that_comes_twice_is_one_and_a_reset_has_no_past(marks):
    marks.add(marks.last(1))
    assert told(marks) == ["picked 1.10", "picked 1.50"]
    marks.follow(period(2))
    assert told(marks) == []


def test_a_stop_that_soon_ends_is_no_mark(marks):
    times = ((60, "stop"), (62, "go"), (70, "stop"), (90, "go"), (95, "stop"))
    marks.add([event(1, index, kind) for index, kind in times])
    assert told(marks)[2:] == ["stop 1.70", "stop 1.95"]


def test_another_server_has_the_same_numbers_of_runs_and_other_events(marks):
    marks.add([event(1, 0, "loaded", since=9.0), event(1, 20, since=9.0)])
    assert told(marks) == ["picked 1.20"]
