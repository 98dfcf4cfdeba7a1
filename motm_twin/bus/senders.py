"""Sender threads, so that the loop waits neither for encoding nor for slow readers."""

import queue
import threading
import time
import traceback
from collections import deque
from collections.abc import Callable

from motm_twin.control.tick import Tick
from motm_twin.model.period import PERIOD
from motm_twin.model.plant import Observation

Work = Callable[[], None]
DRAIN = 1.0  # [s] to send the rest at closing
EVERY = 2  # of the samples, which come at 100 Hz
KEPT = 200  # samples that may wait while the sender is blocked
Send = Callable[[Observation, int], None]  # sample, run


class Outbox:
    """Does work in its own thread. Beyond ``size`` waiting pieces, further ones are dropped and counted."""

    def __init__(self, name: str, size: int) -> None:
        self.dropped = 0
        # A SimpleQueue keeps the interpreter: with a lock, the poster waited for the thread that it woke.
        self._queue: queue.SimpleQueue[Work | None] = queue.SimpleQueue()
        self._size, self._closed = size, False
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    def post(self, work: Work) -> bool:
        """Queue a piece of work; never waits. False when it was dropped."""
        if self._closed or self._queue.qsize() >= self._size:
            self.dropped += 1
            return False
        self._queue.put(work)
        return True

    def close(self) -> bool:
        """Finish queued work within `DRAIN`; False when something still blocks. Closing twice is fine."""
        if not self._closed:
            self._closed = True
            self._queue.put(None)
        self._thread.join(DRAIN)
        return not self._thread.is_alive()

    def _run(self) -> None:
        while (work := self._queue.get()) is not None:
            try:
                work()
            except Exception:
                traceback.print_exc()  # what can not be sent must not end what comes after it


class RobotStream:
    """Spreads the samples of a period over the wall time until the next, without blocking the caller."""

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
        """End the thread; waiting samples are dropped."""
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
        """Span [s] between the oldest and newest waiting sample beyond which the oldest is sent at once."""
        return PERIOD / self._speed()
