"""Signals and processes of our programs: how each is interrupted, reports, and ends with its parent.

Ctrl-C and SIGTERM while a program starts, and in child processes; then the processes of `serve`.
"""

import functools
import json
import multiprocessing
import os
import queue
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, suppress
from multiprocessing import connection, resource_tracker
from types import FrameType
from typing import Any, ParamSpec, TypeVar

_STOPPED = b"motm-twin: stopped\n"
_SIGNALLED = 128  # plus the number of the signal: exit code of a program that was ended by one
_before: dict[int, Any] = {}  # handlers from before `starting`, by signal

P = ParamSpec("P")
R = TypeVar("R")


def starting() -> None:
    """Let Ctrl-C and SIGTERM end this program at once, with one line, until `loaded`.

    There is nothing to clean up yet, and an exception in the middle of an import would be caught by a library or end in
    a traceback. Ignored signals (in a background job) stay ignored.
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
    """Decorator of a command that cleans up after itself: from its start Ctrl-C interrupts it instead of ending it."""

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
def handled(handler: Any, *signals: int) -> Iterator[None]:
    """Context in which these signals have this handler; outside of the main thread it changes nothing."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {number: signal.signal(number, handler) for number in signals}
    try:
        yield
    finally:
        for number, old in before.items():
            signal.signal(number, old)


def deaf() -> AbstractContextManager[None]:
    """Context in which started processes ignore Ctrl-C: the parent ends them itself.

    The parent ignores it meanwhile, too. Blocking the signal would not suffice, as joblib unblocks it.
    """
    return handled(signal.SIG_IGN, signal.SIGINT)


def end_with_parent() -> None:
    """End this process of `multiprocessing` as soon as its parent has ended, whatever it computes."""
    parent = multiprocessing.parent_process()

    def watch() -> None:
        if parent is not None:
            connection.wait([parent.sentinel])
            os._exit(1)

    threading.Thread(target=watch, name="parent", daemon=True).start()


@contextmanager
def interrupt_deferred() -> Iterator[None]:
    """Context in which Ctrl-C waits until its end; `multiprocessing` processes started in it never receive Ctrl-C."""
    resource_tracker.ensure_running()  # starting it unblocks signals, so it starts before
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})


GRACE = 1.6  # [s] between asking a process to end and killing it
RESTARTS = 3  # largest number of restarts within RESTART_WINDOW
RESTART_WINDOW = 60.0  # [s]
Listener = Callable[[dict], None]  # event


class Reporter:
    """Writes events for the parent, one JSON object per line; without a parent they go to standard output."""

    def __init__(self, descriptor: int | None) -> None:
        self._file = sys.stdout if descriptor is None else os.fdopen(descriptor, "w", encoding="utf-8")
        self._lock = threading.Lock()

    def __call__(self, event: str, **details: Any) -> None:
        """Send one event; a missing parent is not an error."""
        with self._lock:
            try:
                print(json.dumps({"event": event, **details}), file=self._file, flush=True)
            except (OSError, ValueError):
                return


def setter(stop: threading.Event) -> Callable[..., None]:
    """A signal handler that sets an event from another thread.

    A handler interrupts the main thread anywhere. When that thread waits for the same event, it may hold the event's
    lock, and `Event.set` in the handler would wait for ever; `SimpleQueue.put` never does.
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
        at_end_of_input(stop.set)
    return stop


def await_stop(stop: threading.Event) -> None:
    """Wait for a `stop_event`, waking every second to handle a signal that another thread has received."""
    while not stop.wait(1.0):
        continue


def at_end_of_input(act: Callable[[], object]) -> None:
    """Call a function in another thread when standard input ends: the parent has closed it, or is gone."""

    def watch() -> None:
        while os.read(0, 1024):
            continue
        act()

    threading.Thread(target=watch, name="parent", daemon=True).start()


def leave(code: int) -> None:
    """Exit now, without waiting for threads that compile or compute."""
    for file in (sys.stdout, sys.stderr):
        with suppress(OSError, ValueError):  # the disk is full, or the file or pipe is closed
            file.flush()
    os._exit(code)


class Child:
    """One process that runs a module of this package and reports through a pipe."""

    def __init__(
        self,
        name: str,
        module: str,
        arguments: list[str],
        listener: Listener,
        env: dict[str, str],
        ended: Callable[[int], None] = lambda code: None,
    ) -> None:
        """``ended`` is called with the exit code of each process, after its last report."""
        self._ended = ended
        self.name, self._module, self._arguments = name, module, arguments
        self._listener, self._env = listener, env
        self._starts: list[float] = []
        self.process: subprocess.Popen | None = None

    def start(self) -> None:
        """Start the process. It ends by itself when this process is gone, because its standard input ends."""
        read, write = os.pipe()
        command = [sys.executable, "-m", self._module, *self._arguments, "--report", str(write)]
        self.process = subprocess.Popen(  # noqa: S603 - our own module with checked arguments
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            pass_fds=(write,),
            start_new_session=True,  # Ctrl-C reaches this process only, which then ends its children in order
            env=self._env,
        )
        os.close(write)
        self._starts.append(time.monotonic())
        listen = threading.Thread(
            target=self._listen, args=(read, self.process), name=f"{self.name} reports", daemon=True
        )
        listen.start()

    def exit_code(self) -> int | None:
        """Exit code of the process; None while it runs and before it starts."""
        return None if self.process is None else self.process.poll()

    def may_restart(self) -> bool:
        """True when there were at most `RESTARTS` starts within `RESTART_WINDOW`."""
        recent = [at for at in self._starts if time.monotonic() - at < RESTART_WINDOW]
        return len(recent) <= RESTARTS

    def _listen(self, descriptor: int, process: subprocess.Popen) -> None:
        with os.fdopen(descriptor, encoding="utf-8") as lines:
            for line in lines:
                self._listener(json.loads(line))
        self._ended(process.wait())


def end_all(children: list[Child]) -> None:
    """End all children, by request first and by force after `GRACE`; returns when none is left."""
    running = [child.process for child in children if child.process is not None and child.process.poll() is None]
    for process in running:
        process.send_signal(signal.SIGTERM)
    deadline = time.monotonic() + GRACE
    for process in running:
        try:
            process.wait(max(0.01, deadline - time.monotonic()))
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
    for child in children:
        if child.process is not None and child.process.stdin is not None:
            child.process.stdin.close()
