"""Pacing of the loop, and the scheduling of its thread."""

import itertools
import os
import sys
import threading

import pytest
from fake_twin import FakeTwin
from running import Running
from waiting import until

from motm_twin.bus import pacing
from motm_twin.bus.commands import Load, Pause, Play, Speed
from motm_twin.bus.pacing import Pacer, RealTime, refusal
from motm_twin.model.plant import PERIOD


def run(pacer, seconds, cost):
    """Simulated clock: each period takes ``cost`` seconds to compute."""
    now, periods = 100.0, 0
    end = now + seconds
    while now < end:
        wait = pacer.wait(now)
        if wait > 0.0:
            now += wait
            continue
        pacer.started(now)
        periods += 1
        now += cost
    return now, periods


@pytest.mark.parametrize("speed", [0.125, 1.0, 4.0])
def test_time_runs_as_fast_as_wanted_when_the_machine_can(speed):
    pacer = Pacer()
    pacer.speed = speed
    now, periods = run(pacer, 16.0, 0.002)
    assert periods * PERIOD == pytest.approx(16.0 * speed, rel=0.02)
    assert pacer.actual_speed(now) == pytest.approx(speed, rel=0.15)
    assert not pacer.capped(now)


def test_a_machine_that_can_not_keep_up_is_told_as_capped():
    pacer = Pacer()
    pacer.speed = 8.0
    now, _ = run(pacer, 5.0, 0.02)
    assert pacer.actual_speed(now) == pytest.approx(2.5, rel=0.1)
    assert pacer.capped(now)


def test_a_long_stall_is_not_caught_up_with():
    pacer = Pacer()
    pacer.started(10.0)
    pacer.started(40.0)
    assert pacer.wait(40.0) == pytest.approx(PERIOD)


def test_a_short_delay_is_caught_up_with():
    pacer = Pacer()
    pacer.started(10.0)
    pacer.started(10.0 + PERIOD + 0.01)
    assert pacer.wait(10.0 + PERIOD + 0.01) == pytest.approx(PERIOD - 0.01)


def meanwhile(read, act, step):
    """Read, and act before so many instructions of it, as another thread may; False when it has fewer."""
    left = [step]

    def trace(frame, event, _):
        frame.f_trace_opcodes = True
        left[0] -= event == "opcode"
        if event == "opcode" and left[0] == 0:
            act()
        return trace

    before = sys.gettrace()
    sys.settrace(trace)
    try:
        read()
    finally:
        sys.settrace(before)
    return left[0] <= 0


@pytest.mark.parametrize("name", ["actual_speed", "capped"])
def test_the_loop_can_restart_at_any_moment_while_another_thread_reads(name):
    """The status of a loop that began to play was an error at times: what had just been counted was gone."""
    for step in itertools.count(1):
        pacer = Pacer()
        now, _ = run(pacer, 5.0, 0.02)
        if not meanwhile(lambda pacer=pacer, now=now: getattr(pacer, name)(now), pacer.restart, step):
            break
    assert step > 5


def test_only_real_time_that_the_machine_keeps_up_with_is_at_ease():
    pacer = Pacer()
    now, _ = run(pacer, 5.0, 0.02)
    assert pacer.at_ease(now)
    pacer.speed = 2.0
    assert not pacer.at_ease(now)
    slow = Pacer()
    now, _ = run(slow, 5.0, 0.08)
    assert not slow.at_ease(now)


def in_thread(work):
    """Result of ``work`` in a thread of its own, whose scheduling ends with it."""
    found = []
    thread = threading.Thread(target=lambda: found.append(work()))
    thread.start()
    thread.join(20.0)
    return found[0]


def policy():
    return os.sched_getscheduler(0) & ~os.SCHED_RESET_ON_FORK


def test_the_thread_gets_real_time_scheduling_where_it_is_allowed_and_gives_it_back():
    def work():
        allowed, chosen = refusal() == "", RealTime()
        usual = policy()
        chosen.want(True)
        wanted, inherited = policy(), in_thread(policy)
        chosen.want(False)
        return allowed, usual, wanted, inherited, policy()

    allowed, usual, wanted, inherited, after = in_thread(work)
    assert usual == inherited == after == os.SCHED_OTHER
    assert wanted == (os.SCHED_FIFO if allowed else os.SCHED_OTHER)


def test_without_permission_the_usual_scheduling_stays_and_it_is_said(monkeypatch):
    def forbidden(_):
        raise PermissionError(1, "Operation not permitted")

    monkeypatch.setattr(pacing, "schedule", forbidden)
    chosen = RealTime()
    chosen.want(True)
    assert not chosen.on
    assert refusal() == "Operation not permitted"


def test_an_operating_system_without_it_is_said(monkeypatch):
    monkeypatch.delattr(os, "SCHED_FIFO")
    chosen = RealTime()
    chosen.want(True)
    assert not chosen.on
    assert refusal() == "this operating system has none"


@pytest.mark.skipif(refusal() != "", reason=f"no real-time scheduling here: {refusal()}")
def test_the_loop_has_it_only_while_it_sleeps_between_periods(running):
    assert running.ask(Play()) == ""
    until(lambda: running.loop._real_time.on, "no real-time scheduling in real time")
    assert running.ask(Speed(factor=4.0)) == ""
    until(lambda: not running.loop._real_time.on, "real-time scheduling at four times the speed")
    assert running.ask(Speed(factor=1.0)) == ""
    until(lambda: running.loop._real_time.on, "no real-time scheduling in real time again")
    assert running.ask(Pause()) == ""
    assert not running.loop._real_time.on


@pytest.mark.skipif(refusal() != "", reason=f"no real-time scheduling here: {refusal()}")
def test_a_load_has_the_usual_scheduling():
    found = []

    class Slow(FakeTwin):
        def __init__(self, *about, **more):
            super().__init__(*about, **more)
            found.append(policy())

    with Running(Slow) as running:
        assert running.ask(Play()) == ""
        until(lambda: running.loop._real_time.on, "no real-time scheduling in real time")
        assert running.ask(Load(scene="fake")) == ""
        until(lambda: len(found) == 2, "nothing is loaded")
    assert found == [os.SCHED_OTHER] * 2
