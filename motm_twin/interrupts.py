"""Ctrl-C, and processes that must not hear it."""

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def deaf() -> Iterator[None]:
    """Processes that are started in the block never hear Ctrl-C: the one that waits for them ends them itself.

    It is deaf for that moment, too; blocking the signal instead would not do, as joblib unblocks it.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
