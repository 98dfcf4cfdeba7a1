"""The robot at 50 Hz: what the arm steps of a period saw, sent one after the other instead of in bursts."""

import threading
import time
import traceback
from collections import deque
from collections.abc import Callable

from motm_twin.control.tick import Tick
from motm_twin.model.period import PERIOD
from motm_twin.model.plant import Observation

EVERY = 2  # of the samples, which come at 100 Hz
KEPT = 200  # samples that may wait, if the sender is held up

Send = Callable[[Observation, int], None]  # sample, run


class RobotStream:
    """Spreads the samples of a period over the wall time until the next; it holds nobody up."""

    def __init__(self, send: Send, speed: Callable[[], float]) -> None:
        """``send`` is called in the thread of this stream, ``speed`` is the wanted real-time factor."""
        self._send, self._speed = send, speed
        self._waiting: deque[tuple[float, Observation, int]] = deque(maxlen=KEPT)  # due [s], sample, run
        self._changed, self._closed = threading.Condition(), False
        self._thread = threading.Thread(target=self._run, name="robot", daemon=True)
        self._thread.start()

    def follow(self, tick: Tick, run: int) -> None:
        """Take the samples of a period that was just computed."""
        now, samples = time.monotonic(), tick.samples or (tick.observation,)
        step = PERIOD / len(samples) / self._speed()
        first = tick.index * len(samples)
        chosen = [i for i in range(len(samples)) if (first + i) % EVERY == 0] if len(samples) > 1 else [0]
        with self._changed:
            self._waiting.extend((now + i * step, samples[i], run) for i in chosen)
            self._changed.notify()

    def close(self) -> None:
        """End the thread; what still waits is not sent."""
        with self._changed:
            self._closed = True
            self._changed.notify()
        self._thread.join(1.0)

    def _run(self) -> None:
        while (item := self._next()) is not None:
            try:
                self._send(*item)
            except Exception:
                traceback.print_exc()  # the next one may be sent again

    def _next(self) -> tuple[Observation, int] | None:
        with self._changed:
            while not self._closed:
                if not self._waiting:
                    self._changed.wait()
                    continue
                due, sample, run = self._waiting[0]
                left = due - time.monotonic()
                if left <= 0.0 or (len(self._waiting) > 1 and self._waiting[-1][0] - due > self._late()):
                    self._waiting.popleft()
                    return sample, run
                self._changed.wait(left)
        return None

    def _late(self) -> float:
        """[s] between the oldest and newest waiting sample after which the oldest is sent at once."""
        return PERIOD / self._speed()
