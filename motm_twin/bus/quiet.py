"""Answers between two periods: while one is computed, queries wait in Zenoh's own queue.

Zenoh would call back at any time, and every call takes the interpreter from the control loop: 1,000 refused commands a
second made the 99th percentile of the period up to half as long again.
"""

import contextlib
import queue
import threading
import time
import traceback
from collections.abc import Callable, Iterator, Sequence

import zenoh

WAITING = 1024  # queries of a key; more of them hold up the link that they come by
PATIENCE = 0.05  # [s] queries wait for the end of a period: as long as a period may take
TOGETHER = 32  # queries that share this patience


class Quiet:
    """Whether the interpreter is free for answers: no period is computed now."""

    def __init__(self) -> None:
        self._event = threading.Event()
        self._event.set()

    @property
    def now(self) -> bool:
        """Whether it is quiet."""
        return self._event.is_set()

    def wait(self, timeout: float) -> None:
        """Until it is quiet, or for ``timeout`` [s]."""
        self._event.wait(timeout)

    @contextlib.contextmanager
    def broken(self, really: bool = True) -> Iterator[None]:
        """It is not quiet in this block, if ``really`` so."""
        if really:
            self._event.clear()
        try:
            yield
        finally:
            self._event.set()


class _Waiting:
    """Queries of one key, in Zenoh's own queue: they do not need the interpreter until they are taken."""

    def __init__(self, session: zenoh.Session, key: str) -> None:
        self._queryable = session.declare_queryable(key, zenoh.handlers.FifoChannel(WAITING))
        self._queries = self._queryable.handler

    def first(self) -> zenoh.Query | None:
        """Wait for one; None after the end."""
        try:
            return self._queries.recv()
        except zenoh.ZError:
            return None

    def more(self) -> zenoh.Query | None:
        """One that is there; None when there is none."""
        try:
            return self._queries.try_recv()
        except zenoh.ZError:
            return None

    def end(self) -> None:
        self._queryable.undeclare()


class _WaitingTogether:
    """Queries of several keys, in the order in which they came."""

    def __init__(self, session: zenoh.Session, keys: Sequence[str]) -> None:
        self._queries: queue.Queue[zenoh.Query | None] = queue.Queue(WAITING)
        take = zenoh.handlers.Callback(self._queries.put, indirect=False)
        self._queryables = [session.declare_queryable(key, take) for key in keys]

    def first(self) -> zenoh.Query | None:
        """Wait for one; None after the end."""
        return self._queries.get()

    def more(self) -> zenoh.Query | None:
        """One that is there; None when there is none."""
        try:
            query = self._queries.get_nowait()
        except queue.Empty:
            return None
        if query is None:
            self._queries.put(None)  # the end: for `first`
        return query

    def end(self) -> None:
        for queryable in self._queryables:
            queryable.undeclare()
        self._queries.put(None)


class QuietQueryable:
    """Has the queries of some keys answered in an own thread, as they came, when it is quiet or after `PATIENCE`."""

    def __init__(
        self, session: zenoh.Session, keys: Sequence[str], answer: Callable[[zenoh.Query], None], quiet: Quiet
    ) -> None:
        self._answer, self._quiet = answer, quiet
        self._waiting = _Waiting(session, keys[0]) if len(keys) == 1 else _WaitingTogether(session, keys)
        self._thread = threading.Thread(target=self._run, name=f"answers {keys[0]}", daemon=True)
        self._thread.start()

    def undeclare(self) -> None:
        """Answer what has come, and no more."""
        self._waiting.end()
        if threading.current_thread() is not self._thread:
            self._thread.join(1.0)

    def _run(self) -> None:
        while (query := self._waiting.first()) is not None:
            patient = time.monotonic() + PATIENCE
            for left in reversed(range(TOGETHER)):
                self._quiet.wait(max(0.0, patient - time.monotonic()))  # another period may have begun meanwhile
                self._reply(query)
                if not left or (query := self._waiting.more()) is None:
                    break

    def _reply(self, query: zenoh.Query) -> None:
        try:
            self._answer(query)
        except Exception:
            traceback.print_exc()
            with contextlib.suppress(zenoh.ZError):
                query.drop()  # the asker need not wait for it
