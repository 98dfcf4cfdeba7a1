"""The published keys of a twin: each remembers its last value, and answers queries with it."""

import threading
from collections.abc import Callable
from contextlib import suppress

import zenoh

from motm_twin.bus.keys import Keys
from motm_twin.bus.queries import Quiet, QuietQueryable

MakeAnswer = Callable[[zenoh.Parameters], bytes | None]  # None: there is nothing yet. ValueError: why not


class LatestValues:
    """Publishes, and answers late joiners with the last value of each key."""

    def __init__(self, session: zenoh.Session, keys: Keys, quiet: Quiet) -> None:
        """``quiet``: when to answer."""
        self._lock = threading.Lock()
        self._last: dict[str, tuple[bytes, bytes | None]] = {}  # key: payload, attachment
        self._answers: dict[str, MakeAnswer] = {}
        self._publishers, self._encodings = {}, dict[str, zenoh.Encoding]()
        shown = (keys.tick, keys.robot, keys.scan, keys.grid, keys.scene, keys.status, keys.metrics, keys.event)
        for key in (*shown, keys.observations):
            # Not express: ticks that have to wait for a slow reader then share the batches of the send queue.
            self._encodings[key] = zenoh.Encoding.ZENOH_BYTES if key == keys.grid else zenoh.Encoding.APPLICATION_JSON
            self._publishers[key] = session.declare_publisher(
                key,
                encoding=self._encodings[key],
                congestion_control=_block_or_drop(key in (keys.scene, keys.event)),
                # Events have a send queue of their own, which the ticks of a slow reader do not fill.
                priority=zenoh.Priority.INTERACTIVE_LOW if key == keys.event else zenoh.Priority.DATA,
                reliability=zenoh.Reliability.RELIABLE,
            )
        self._asked = [(key, zenoh.KeyExpr(key)) for key in self._publishers]
        # One for all keys: who asks for several gets the answers in that order.
        self._queryable = QuietQueryable(session, list(self._publishers), self._answer, quiet)

    def put(self, key: str, payload: bytes, attachment: bytes | None = None) -> None:
        """Send a value of a key and keep it."""
        with self._lock:
            self._last[key] = (payload, attachment)
        self._publishers[key].put(payload, attachment=attachment)

    def answer(self, key: str, make: MakeAnswer) -> None:
        """Answer queries of this key with what ``make`` says instead of the last value."""
        self._answers[key] = make

    def close(self) -> None:
        """Withdraw everything."""
        self._queryable.undeclare()
        for publisher in self._publishers.values():
            publisher.undeclare()

    def _answer(self, query: zenoh.Query) -> None:
        """The last value of every key that the query asks for."""
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


def _block_or_drop(block: bool) -> zenoh.CongestionControl:
    return zenoh.CongestionControl.BLOCK if block else zenoh.CongestionControl.DROP
