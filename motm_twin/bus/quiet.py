"""Answers between two periods: while one is computed, queries wait in Zenoh's own queue.

Zenoh would call back at any time, and every call takes the interpreter from the control loop: 1,000 refused commands a
second made the 99th percentile of the period up to half as long again.
"""

import contextlib
import threading
import traceback
from collections.abc import Callable, Iterator

import zenoh

WAITING = 1024  # queries of a key; more of them hold up the link that they come by
PATIENCE = 0.05  # [s] queries wait for the end of a period: as long as a period may take
TOGETHER = 32  # queries that are answered before the next look at whether it is quiet


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


class QuietQueryable:
    """Has each query of a key answered in an own thread, when it is quiet or after `PATIENCE`, until `undeclare`."""

    def __init__(self, session: zenoh.Session, key: str, answer: Callable[[zenoh.Query], None], quiet: Quiet) -> None:
        self._answer, self._quiet = answer, quiet
        self._queryable = session.declare_queryable(key, zenoh.handlers.FifoChannel(WAITING))
        self._queries = self._queryable.handler
        self._thread = threading.Thread(target=self._run, name=f"answers {key}", daemon=True)
        self._thread.start()

    def undeclare(self) -> None:
        """Answer no more."""
        self._queryable.undeclare()
        if threading.current_thread() is not self._thread:
            self._thread.join(1.0)

    def _run(self) -> None:
        while True:
            try:
                queries = [self._queries.recv()]
            except zenoh.ZError:  # undeclared
                return
            self._quiet.wait(PATIENCE)
            with contextlib.suppress(zenoh.ZError):  # undeclared meanwhile: what came before is answered
                while len(queries) < TOGETHER and (query := self._queries.try_recv()) is not None:
                    queries.append(query)
            for query in queries:
                try:
                    self._answer(query)
                except Exception:
                    traceback.print_exc()
                    with contextlib.suppress(zenoh.ZError):
                        query.drop()  # the asker need not wait for it
