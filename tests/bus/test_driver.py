"""The lease of the wheel; a run waits for its audience, and the next seed starts when nobody drives."""

import time

import pytest
from fake_twin import FakeTwin
from hypothesis import given
from hypothesis import strategies as st
from running import Running
from waiting import until

from motm_twin.bus import loop
from motm_twin.bus.commands import SILENCE, Audience, Drive, Lease, Pause, Play, Refused, Reset, TakeWheel

SENDERS = ("ann", "bob", "cid")


def test_who_acts_first_drives_and_others_are_told_who():
    lease = Lease()
    lease.require("ann", 0.0)
    lease.give("ann", "Ann <3", 0.0)
    with pytest.raises(
        Refused, match=r"Ann <3 is driving: it can hand over to you, or you wait for 10 s of silence \(7 s left\)"
    ):
        lease.require("bob", 3.0)
    lease.require("ann", 9.0)
    assert lease.left(10.0) == SILENCE - 1.0


def test_silence_frees_the_wheel_and_no_earlier():
    lease = Lease()
    lease.give("ann", "", 0.0)
    assert lease.name == "ann"
    lease.expire(SILENCE - 0.001)
    assert lease.driver == "ann"
    lease.expire(SILENCE)
    assert (lease.driver, lease.name, lease.left(SILENCE)) == ("", "", 0.0)


def test_a_wheel_that_is_handed_over_belongs_to_the_other_for_the_full_time():
    lease = Lease()
    lease.give("ann", "Ann", 0.0)
    lease.give("bob", "Bob", 5.0)
    assert (lease.driver, lease.name, lease.left(5.0)) == ("bob", "Bob", SILENCE)
    with pytest.raises(Refused):
        lease.require("ann", 6.0)
    lease.give("", "", 7.0)
    assert (lease.driver, lease.left(7.0)) == ("", 0.0)


steps = st.lists(
    st.tuples(
        st.floats(0.0, 1.5 * SILENCE),
        st.sampled_from(SENDERS),
        st.sampled_from(["act", "fail", "pass", "free"]),
        st.sampled_from(SENDERS),
    ),
    max_size=40,
)


@given(steps)
def test_only_one_drives_and_nobody_loses_the_wheel_without_silence(history):
    lease, now, driver, heard = Lease(), 0.0, "", 0.0
    for wait, sender, kind, to in history:
        now += wait
        if driver and now >= heard + SILENCE:
            driver = ""
        lease.expire(now)
        assert lease.driver == driver
        allowed = driver in ("", sender)
        try:
            lease.require(sender, now)
        except Refused:
            assert not allowed
            continue
        assert allowed
        if kind == "act":
            lease.give(sender, sender.title(), now)
        elif kind in ("pass", "free"):
            lease.give(to if kind == "pass" else "", to.title(), now)
        driver, heard = {"act": sender, "pass": to, "free": "", "fail": driver}[kind], now
        assert lease.driver == driver
        assert lease.left(now) == (pytest.approx(SILENCE) if driver else 0.0)


@given(st.text(max_size=80), st.text(min_size=1, max_size=64))
def test_names_are_kept_raw_and_bounded(name, sender):
    lease = Lease()
    lease.give(sender, name, 0.0)
    assert 1 <= len(lease.name) <= 40 or not sender.strip()
    assert lease.name in (name.strip()[:40], sender[:40])


@pytest.fixture(autouse=True)
def soon(monkeypatch):
    monkeypatch.setattr(loop, "AGAIN", 0.05)


@pytest.fixture
def running():
    """A run that waits for its first page."""
    with Running(playing=True, hold=True) as loop:
        yield loop


def short(scene, *, method=None):
    return FakeTwin(scene, method=method, periods=3)


def state(running):
    return running.loop.status().state


def test_a_run_waits_at_its_start_until_a_page_shows_it_and_says_so(running):
    assert state(running) == "paused" and "first page" in running.loop.status().text
    assert [tick.index for tick in running.sink.ticks] == [0]
    assert running.loop.status().pages == 0
    assert running.ask(Audience(pages=0)) == "" and state(running) == "paused"
    assert running.ask(Audience(pages=1)) == "" and state(running) == "playing"
    assert running.loop.status().driver == ""


def test_a_run_that_waits_for_a_page_starts_when_somebody_drives_without_one(running):
    command = Drive(v=0.1, w=0.0)
    assert running.loop.status().held
    assert running.ask(command) == "" and state(running) == "playing"
    assert not running.loop.status().held
    running.ask(Pause())
    running.ask(command)
    assert state(running) == "paused", "a pause by a person is ended by nobody else"


def test_a_pause_by_a_person_is_not_ended_by_a_visitor(running):
    running.ask(Audience(pages=1))
    running.ask(Pause())
    running.ask(Audience(pages=2))
    assert state(running) == "paused"


def test_play_needs_no_page_and_a_reset_after_it_neither(running):
    running.ask(Play())
    assert state(running) == "playing"
    running.ask(Reset())
    until(lambda: state(running) == "playing", "it waits for a page again")


def test_a_page_is_told_by_somebody_who_does_not_drive(running):
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
