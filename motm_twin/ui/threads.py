"""Writing to the page from several threads.

Viser 1.0 wakes its senders twice for every message: at once in the thread that writes, and once more in its event loop.
The first goes past the loop: when the loop runs at that moment, it ends with "deque mutated during iteration" in the
writer, whose update of the page then breaks off. Here only the second one counts.
"""

import asyncio
from typing import Any

from viser.infra._async_message_buffer import AsyncMessageBuffer


class LoopEvent(asyncio.Event):
    """An event that is set in its event loop only; elsewhere nothing happens."""

    def set(self) -> None:
        """Set it, when this is the thread of the loop."""
        try:
            asyncio.get_running_loop()
        except RuntimeError:
            return
        super().set()


def write_through_the_loop() -> None:
    """Have all message buffers that Viser makes from now on wake their senders in the event loop."""
    original = AsyncMessageBuffer.__init__
    if getattr(original, "wakes_in_the_loop", False):
        return

    def init(self: AsyncMessageBuffer, *arguments: Any, **named: Any) -> None:
        original(self, *arguments, **named)
        self.message_event = LoopEvent()

    init.wakes_in_the_loop = True  # pyright: ignore[reportFunctionMemberAccess]
    AsyncMessageBuffer.__init__ = init
