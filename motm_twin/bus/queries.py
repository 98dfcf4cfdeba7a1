"""Queries and their answers: commands, schemas, and the last value of every published key.

While a period is computed, queries wait in Zenoh's own queue. Callbacks would come at any time, and each takes
the interpreter from the control loop: 1,000 refused commands a second made the 99th percentile of the period up to half
as long again.
"""

import contextlib
import functools
import queue
import threading
import time
import traceback
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from typing import Protocol

import msgspec
import zenoh

from motm_twin.bus.commands import COMMAND_NAMES, Answer, CommandGate, Envelope, Refused
from motm_twin.bus.connection import Keys, direct
from motm_twin.bus.schemas import names, schema

WAITING = 1024  # queries that may wait per key; more would block their link
PATIENCE = 0.05  # [s] that queries wait at most for the end of a period: as long as a period
TOGETHER = 32  # queries that share this patience


class Idle(threading.Event):
    """Set while the interpreter is free for answers: no period is computed now."""

    def __init__(self) -> None:
        super().__init__()
        self.set()

    @contextlib.contextmanager
    def suspended(self, really: bool = True) -> Iterator[None]:
        """Mark the interpreter as busy within this block, if ``really``."""
        if really:
            self.clear()
        try:
            yield
        finally:
            self.set()


class _Waiting:
    """Queries of one key in Zenoh's own queue, which does not need the interpreter."""

    def __init__(self, session: zenoh.Session, key: str) -> None:
        self._queryable = session.declare_queryable(key, zenoh.handlers.FifoChannel(WAITING))
        self._queries = self._queryable.handler

    def first(self) -> zenoh.Query | None:
        """Wait for a query; None after the end."""
        try:
            return self._queries.recv()
        except zenoh.ZError:
            return None

    def more(self) -> zenoh.Query | None:
        """A waiting query; None when there is none."""
        try:
            return self._queries.try_recv()
        except zenoh.ZError:
            return None

    def end(self) -> None:
        self._queryable.undeclare()


class _WaitingTogether:
    """Queries of several keys, in order of arrival."""

    def __init__(self, session: zenoh.Session, keys: Sequence[str]) -> None:
        self._queries: queue.Queue[zenoh.Query | None] = queue.Queue(WAITING)
        take = direct(self._queries.put)
        self._queryables = [session.declare_queryable(key, take) for key in keys]

    def first(self) -> zenoh.Query | None:
        return self._queries.get()

    def more(self) -> zenoh.Query | None:
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


class DeferredQueryable:
    """Answers the queries of some keys in its own thread, in order, while `Idle` is set or after `PATIENCE`."""

    def __init__(
        self, session: zenoh.Session, keys: Sequence[str], answer: Callable[[zenoh.Query], None], idle: Idle
    ) -> None:
        self._answer, self._idle = answer, idle
        self._waiting = _Waiting(session, keys[0]) if len(keys) == 1 else _WaitingTogether(session, keys)
        self._thread = threading.Thread(target=self._run, name=f"answers {keys[0]}", daemon=True)
        self._thread.start()

    def undeclare(self) -> None:
        """Answer queries that have arrived, then stop."""
        self._waiting.end()
        if threading.current_thread() is not self._thread:
            self._thread.join(1.0)

    def _run(self) -> None:
        while (query := self._waiting.first()) is not None:
            patient = time.monotonic() + PATIENCE
            for left in reversed(range(TOGETHER)):
                self._idle.wait(max(0.0, patient - time.monotonic()))  # another period may have begun since
                self._reply(query)
                if not left or (query := self._waiting.more()) is None:
                    break

    def _reply(self, query: zenoh.Query) -> None:
        try:
            self._answer(query)
        except Exception:
            traceback.print_exc()
            with contextlib.suppress(zenoh.ZError):
                query.drop()  # ends the asker's wait


@functools.cache
def schemas() -> dict[str, bytes]:
    """All schemas as JSON, cached: 0.02 s of the interpreter, 0.3 s the first time."""
    return {name: msgspec.json.encode(schema(name)) for name in names()}


class Reply(Protocol):
    """Callback for the outcome of a command, called once."""

    def __call__(self, reason: str, index: int, path: str = "", /) -> None:
        """Take the refusal ("": done), the last period before the command, and the written file."""
        ...


class Answering:
    """Queryables of one twin, or of a played recording, until `close`."""

    def __init__(
        self,
        session: zenoh.Session,
        keys: Keys,
        *,
        now: Callable[[], float],
        request: Callable[[Envelope, Reply], None],
        idle: Idle,
    ) -> None:
        """``now``: server time [s]; ``request`` takes a checked command, or raises Refused."""
        self._keys, self._now, self._request = keys, now, request
        self._gate, self._encode = CommandGate(now), msgspec.json.Encoder().encode
        self._commands = [zenoh.KeyExpr(keys.command(name)) for name in COMMAND_NAMES]
        self._schemas = [(zenoh.KeyExpr(keys.schema(name)), text) for name, text in schemas().items()]
        self._queryables = [
            DeferredQueryable(session, [keys.commands], self._on_command, idle),
            DeferredQueryable(session, [keys.schemas], self._on_schema, idle),
        ]

    def close(self) -> None:
        """Stop answering."""
        for queryable in self._queryables:
            queryable.undeclare()

    def _on_command(self, query: zenoh.Query) -> None:
        key = str(query.key_expr)
        if "*" in key:
            self._refuse_unaddressed(query)
            return
        payload = b"" if query.payload is None else query.payload.to_bytes()

        def reply(reason: str, index: int, path: str = "", /) -> None:
            with suppress(zenoh.ZError), query:  # the asker may be gone
                self._reply(query, key, reason, index, path)

        try:
            self._request(self._gate.admit(self._keys.command_in(key), payload), reply)
        except Refused as refusal:
            reply(str(refusal), -1)

    def _refuse_unaddressed(self, query: zenoh.Query) -> None:
        """Refuse a command that may reach several twins: its expiry and answer would hold for only one of them."""
        with suppress(zenoh.ZError), query:
            for key in self._commands:
                if query.key_expr.intersects(key):
                    self._reply(query, key, f"a command is for one twin: send it to {key}, without a wildcard", -1)

    def _reply(self, query: zenoh.Query, key: zenoh.KeyExpr | str, reason: str, index: int, path: str = "") -> None:
        """Reply on a key of this twin, never on a wildcard: Zenoh drops one of two answers on the same key."""
        answer = Answer(ok=not reason, reason=reason, server_time=self._now(), index=index, path=path)
        query.reply(key, self._encode(answer), encoding=zenoh.Encoding.APPLICATION_JSON)

    def _on_schema(self, query: zenoh.Query) -> None:
        """Reply with every schema that the query asks for, each on its own key."""
        with suppress(zenoh.ZError), query:
            for key, text in self._schemas:
                if query.key_expr.intersects(key):
                    query.reply(key, text, encoding=zenoh.Encoding.APPLICATION_JSON)


MakeAnswer = Callable[[zenoh.Parameters], bytes | None]  # None: nothing yet; ValueError: a refusal


class LatestValues:
    """Publishes, and answers late joiners with the last value of each key."""

    def __init__(self, session: zenoh.Session, keys: Keys, idle: Idle) -> None:
        """``idle`` is set while queries may be answered."""
        self._lock = threading.Lock()
        self._last: dict[str, tuple[bytes, bytes | None]] = {}  # key: payload, attachment
        self._answers: dict[str, MakeAnswer] = {}
        self._publishers, self._encodings = {}, dict[str, zenoh.Encoding]()
        shown = (keys.tick, keys.robot, keys.scan, keys.grid, keys.scene, keys.status, keys.metrics, keys.event)
        block, drop = zenoh.CongestionControl.BLOCK, zenoh.CongestionControl.DROP
        for key in (*shown, keys.observations):
            # Not express, so that ticks waiting for a slow reader share batches of the send queue.
            self._encodings[key] = zenoh.Encoding.ZENOH_BYTES if key == keys.grid else zenoh.Encoding.APPLICATION_JSON
            self._publishers[key] = session.declare_publisher(
                key,
                encoding=self._encodings[key],
                congestion_control=block if key in (keys.scene, keys.event) else drop,
                # Events have a send queue of their own, which the ticks of a slow reader do not fill.
                priority=zenoh.Priority.INTERACTIVE_LOW if key == keys.event else zenoh.Priority.DATA,
                reliability=zenoh.Reliability.RELIABLE,
            )
        self._asked = [(key, zenoh.KeyExpr(key)) for key in self._publishers]
        # One queryable for all keys, so that a query for several keys is answered in this order.
        self._queryable = DeferredQueryable(session, list(self._publishers), self._answer, idle)

    def put(self, key: str, payload: bytes, attachment: bytes | None = None) -> None:
        """Send a value of a key and keep it."""
        with self._lock:
            self._last[key] = (payload, attachment)
        self._publishers[key].put(payload, attachment=attachment)

    def answer(self, key: str, make: MakeAnswer) -> None:
        """Answer queries of this key with ``make`` instead of the last value."""
        self._answers[key] = make

    def close(self) -> None:
        """Withdraw all keys."""
        self._queryable.undeclare()
        for publisher in self._publishers.values():
            publisher.undeclare()

    def _answer(self, query: zenoh.Query) -> None:
        """Reply with the last value of every key that the query asks for."""
        with suppress(zenoh.ZError), query:  # the asker may be gone
            for key, expression in self._asked:
                if not query.key_expr.intersects(expression):
                    continue
                try:
                    found = self._found(key, query.parameters)
                except ValueError as error:
                    query.reply_err(str(error))
                    continue
                if found is not None:
                    query.reply(key, found[0], attachment=found[1], encoding=self._encodings[key])

    def _found(self, key: str, parameters: zenoh.Parameters) -> tuple[bytes, bytes | None] | None:
        if (make := self._answers.get(key)) is not None:
            payload = make(parameters)
            return None if payload is None else (payload, None)
        with self._lock:
            return self._last.get(key)
