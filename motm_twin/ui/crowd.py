"""Number of pages at once, and data that each may send: one page must not cost the others theirs.

A page sends its camera sixty times a second at most, and a picture of some megabytes when it is asked for one. What
comes faster waits in the browser: it is read later, by TCP's own control of the flow.
"""

import asyncio
import time
from collections.abc import Awaitable, Callable
from typing import Any

from motm_twin.memory import give_back

VISITORS = 50  # pages at once, unless another number is wished for
MESSAGES, BURST = 300.0, 600.0  # [1/s] of one page, and at once
BYTES, BYTES_BURST = 2e6, 16e6  # [1/s] of one page, and at once
LARGEST = 8 * 1024 * 1024  # bytes of a message
QUEUED = 4  # messages of one page that wait to be read
TIDY = 0.5  # [s] after a page has left, memory is given back for it and for those that have left since
TRY_LATER = 1013  # code with which a websocket is closed


class Allowance:
    """A bucket that fills steadily: what is taken beyond it must wait."""

    def __init__(self, rate: float, most: float, now: float) -> None:
        """``rate`` [1/s], up to ``most``; ``now`` [s] monotonic."""
        self._rate, self._most, self._left, self._at = rate, most, most, now

    def take(self, amount: float, now: float) -> float:
        """Take so much at ``now`` [s]; how long [s] to wait before the next."""
        self._left = min(self._most, self._left + self._rate * (now - self._at)) - amount
        self._at = now
        return max(0.0, -self._left / self._rate)


class Crowd:
    """The open pages."""

    def __init__(self, most: int = VISITORS) -> None:
        """``most``: pages at once."""
        self.most, self.here, self._untidy = most, 0, False

    @property
    def full(self) -> bool:
        """Nobody else may come now."""
        return self.here >= self.most

    def text(self) -> str:
        """Why."""
        return f"{self.most} pages of this twin are open already: close one, or start it with --visitors"

    def bounded(self, handler: Callable[[Any], Awaitable[None]]) -> Callable[[Any], Awaitable[None]]:
        """A handler of websockets that lets `most` in, and reads from each no faster than it may send."""

        async def handle(connection: Any) -> None:
            if self.full:
                await connection.close(TRY_LATER, self.text())
                return
            self.here += 1
            connection.recv = _throttled(connection.recv)
            try:
                await handler(connection)
            finally:
                self.here -= 1
                self._tidy_soon()

        return handle

    def _tidy_soon(self) -> None:
        """Also of pages that broke off before they had a panel: what was made ready for them is most of it."""
        if not self._untidy:
            self._untidy = True
            asyncio.get_running_loop().call_later(TIDY, self._tidy)

    def _tidy(self) -> None:
        self._untidy = False
        asyncio.get_running_loop().run_in_executor(None, give_back)  # it takes some ten milliseconds


def _throttled(recv: Callable[[], Awaitable[Any]]) -> Callable[[], Awaitable[Any]]:
    began = time.monotonic()
    messages, size = Allowance(MESSAGES, BURST, began), Allowance(BYTES, BYTES_BURST, began)

    async def receive() -> Any:
        found = await recv()
        now = time.monotonic()
        wait = max(messages.take(1.0, now), size.take(len(found), now))
        if wait > 0.0:
            await asyncio.sleep(wait)
        return found

    return receive
