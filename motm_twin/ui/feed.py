"""Fills the history with what arrives, in a thread of its own: Zenoh's thread must not wait for compression."""

import queue
import threading
import traceback

from motm_twin.bus.client import TwinClient
from motm_twin.ui.history import History

ROOM = 4000  # payloads that may wait; then the oldest are lost, as they are for any slow reader
_END = None


class Feed:
    """Listens to one twin until `stop`."""

    def __init__(self, client: TwinClient, history: History) -> None:
        self._history = history
        self._waiting: queue.Queue[tuple[bytes, bytes | None] | None] = queue.Queue()
        self._leave = [
            client.on_tick(lambda payload: self._take(payload, None)),
            client.on_grid(self._take),
        ]
        self._worker = threading.Thread(target=self._work, name="history", daemon=True)
        self._worker.start()

    def stop(self) -> None:
        """Listen no more."""
        for leave in self._leave:
            leave()
        self._waiting.put(_END)
        self._worker.join(1.0)

    def _take(self, payload: bytes, info: bytes | None) -> None:
        if self._waiting.qsize() > ROOM:
            self._waiting.get_nowait()
        self._waiting.put((payload, info))

    def _work(self) -> None:
        while (item := self._waiting.get()) is not _END:
            payload, info = item
            try:
                if info is None:
                    self._history.add(payload)
                else:
                    self._history.add_grid(payload, info)
            except Exception:  # of another version, or broken: the page tells it when it draws the same message
                traceback.print_exc()
