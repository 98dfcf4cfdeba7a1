import pytest

from motm_twin.bus.pacing import Pacer
from motm_twin.model.period import PERIOD


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


def test_only_real_time_that_the_machine_keeps_up_with_is_at_ease():
    pacer = Pacer()
    now, _ = run(pacer, 5.0, 0.02)
    assert pacer.at_ease(now)
    pacer.speed = 2.0
    assert not pacer.at_ease(now)
    slow = Pacer()
    now, _ = run(slow, 5.0, 0.08)
    assert not slow.at_ease(now)
