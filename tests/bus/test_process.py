"""How the processes of a served twin end."""

import signal
import threading

import pytest

from motm_twin.bus.processes import setter


@pytest.mark.timeout(60)
def test_a_signal_that_comes_while_its_event_is_waited_for_does_not_hang_the_program():
    before = signal.getsignal(signal.SIGALRM)
    try:
        for _ in range(50):
            stop = threading.Event()
            signal.signal(signal.SIGALRM, setter(stop))
            signal.setitimer(signal.ITIMER_REAL, 1e-4, 1e-4)  # into every step of the wait
            while not stop.wait(1e-5):
                continue
            signal.setitimer(signal.ITIMER_REAL, 0.0)
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)
