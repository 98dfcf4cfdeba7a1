"""What the two processes of `serve` have in common: they report as JSON lines, and end with their parent."""

import json
import os
import queue
import signal
import sys
import threading
from collections.abc import Callable
from contextlib import suppress
from typing import Any


class Reporter:
    """Writes events for the parent, one JSON object per line; without a parent they go to standard output."""

    def __init__(self, descriptor: int | None) -> None:
        self._file = sys.stdout if descriptor is None else os.fdopen(descriptor, "w", encoding="utf-8")
        self._lock = threading.Lock()

    def __call__(self, event: str, **details: Any) -> None:
        """Send one event; a parent that is gone is no error."""
        with self._lock:
            try:
                print(json.dumps({"event": event, **details}), file=self._file, flush=True)
            except (OSError, ValueError):
                return


def setter(stop: threading.Event) -> Callable[..., None]:
    """A signal handler that sets an event, from another thread.

    A handler runs in the main thread between any two of its steps. Where that one waits for the same event, it may
    hold the event's lock just then, and `Event.set` would wait for it for ever; `SimpleQueue.put` never does.
    """
    heard: queue.SimpleQueue[None] = queue.SimpleQueue()

    def pass_on() -> None:
        heard.get()
        stop.set()

    threading.Thread(target=pass_on, name="signals", daemon=True).start()
    return lambda *_: heard.put(None)


def stop_event(with_parent: bool) -> threading.Event:
    """An event that is set by SIGTERM, by SIGINT, and (``with_parent``) when standard input ends."""
    stop = threading.Event()
    handler = setter(stop)
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, handler)
    if with_parent:

        def watch() -> None:
            while os.read(0, 1024):
                continue
            stop.set()

        threading.Thread(target=watch, name="parent", daemon=True).start()
    return stop


def leave(code: int) -> None:
    """End now, without waiting for threads that compile or compute."""
    for file in (sys.stdout, sys.stderr):
        with suppress(OSError, ValueError):  # full, closed, or nobody reads it
            file.flush()
    os._exit(code)
