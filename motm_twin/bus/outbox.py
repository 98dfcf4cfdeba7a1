"""A thread that does what others hand it, in order, so that they need not wait for encoding or for slow readers."""

import queue
import threading
import traceback
from collections.abc import Callable

Work = Callable[[], None]

DRAIN = 1.0  # [s] for what still waits when it closes


class Outbox:
    """Does work in its own thread. What comes while ``size`` pieces wait is dropped and counted: nobody waits."""

    def __init__(self, name: str, size: int) -> None:
        self.dropped = 0
        # Putting into this one never gives the interpreter away: with a lock, the poster waited for the thread it woke.
        self._queue: queue.SimpleQueue[Work | None] = queue.SimpleQueue()
        self._size, self._closed = size, False
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    def post(self, work: Work) -> bool:
        """Have this done after what was posted before; never waits. False when it was dropped."""
        if self._closed or self._queue.qsize() >= self._size:
            self.dropped += 1
            return False
        self._queue.put(work)
        return True

    def close(self) -> bool:
        """Finish what waits, for `DRAIN` at most; False when something still blocks. Closing twice is fine."""
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
