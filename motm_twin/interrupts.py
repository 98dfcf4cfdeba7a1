"""Ctrl-C and SIGTERM while a program starts, and in child processes."""

import functools
import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from multiprocessing import connection, resource_tracker
from types import FrameType
from typing import Any, ParamSpec, TypeVar

_STOPPED = b"motm-twin: stopped\n"
_SIGNALLED = 128  # plus the number of the signal: exit code of a program that one ended
_before: dict[int, Any] = {}  # handlers that were there before a start

P = ParamSpec("P")
R = TypeVar("R")


def starting() -> None:
    """Let Ctrl-C and SIGTERM end this program at once, with one line, until `loaded`.

    There is nothing to clean up yet, and an exception would come in the middle of an import: libraries catch it
    there, or it ends in a traceback. Ignored signals (in a background job) stay ignored.
    """
    if threading.current_thread() is threading.main_thread() and not _before:
        for number in (signal.SIGINT, signal.SIGTERM):
            if signal.getsignal(number) != signal.SIG_IGN:
                _before[number] = signal.signal(number, _end)


def loaded() -> None:
    """Restore the handlers from before `starting`."""
    while _before:
        number, handler = _before.popitem()
        if signal.getsignal(number) is _end:
            signal.signal(number, handler)


def interruptible(command: Callable[P, R]) -> Callable[P, R]:
    """A command that Ctrl-C interrupts from its start on, and that cleans up after itself."""

    @functools.wraps(command)
    def called(*given: P.args, **named: P.kwargs) -> R:
        loaded()
        return command(*given, **named)

    return called


def _end(number: int, _: FrameType | None) -> None:
    try:
        os.write(2, _STOPPED)
    finally:
        os._exit(_SIGNALLED + number)


@contextmanager
def deaf() -> Iterator[None]:
    """Processes started in the block ignore Ctrl-C: the parent ends them itself.

    The parent ignores it for that moment, too; blocking the signal would not do, as joblib unblocks it.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def end_with_parent() -> None:
    """End this process of `multiprocessing` as soon as its parent has ended, whatever it computes."""
    parent = multiprocessing.parent_process()

    def watch() -> None:
        if parent is not None:
            connection.wait([parent.sentinel])
            os._exit(1)

    threading.Thread(target=watch, name="parent", daemon=True).start()


@contextmanager
def put_off() -> Iterator[None]:
    """Ctrl-C waits until the end of the block; processes of `multiprocessing` started in it never hear it."""
    resource_tracker.ensure_running()  # where it begins, it lets signals through
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
