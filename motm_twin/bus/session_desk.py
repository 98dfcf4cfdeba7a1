"""Writes the run so far for whoever asks, however many and however often they do."""

from collections import deque
from collections.abc import Callable

from motm_twin.bus.commands import Refused
from motm_twin.bus.ports import SessionReply

INTERVAL = 0.25  # [s] between two that are written while time passes: each takes the loop 2 ms, most of it for the hash
MOST = 1000  # that may wait


class SessionDesk:
    """Takes questions from any thread; the loop answers them, all that wait with the same session."""

    def __init__(self, write: Callable[[], tuple[bytes, bytes]], why_not: Callable[[Exception], str]) -> None:
        """``write`` gives the session and its SessionInfo as JSON, or raises what ``why_not`` words."""
        self._write, self._why_not = write, why_not
        self._askers: deque[SessionReply] = deque()
        self._written = -1e9  # [s]

    def ask(self, reply: SessionReply) -> bool:
        """Have it written; ``reply`` is called once, from the loop's thread. Raises Refused when too many wait.

        Whether the loop is to be told: nobody else was waiting.
        """
        if len(self._askers) >= MOST:
            raise Refused("too many are waiting for the session")
        first = not self._askers
        self._askers.append(reply)
        return first

    def serve(self, now: float, passing: bool) -> None:
        """Answer who waits, if the last one was not written just now; ``passing``: time passes, each is another."""
        if not self._askers or (passing and now < self._written + INTERVAL):
            return
        self._written = now
        waiting = [self._askers.popleft() for _ in range(len(self._askers))]
        try:
            answer = (*self._write(), "")
        except Exception as error:
            answer = b"", b"", self._why_not(error)
        for reply in waiting:
            reply(*answer)
