"""Threads write to the page while its event loop sends: only the loop wakes the senders, and it wakes all of them."""

import asyncio
import threading

from viser._messages import RemoveNotificationMessage
from viser.infra._async_message_buffer import AsyncMessageBuffer

from motm_twin.ui.page_server import LOOPBACK, LoopEvent, open_page, write_through_the_loop

WRITERS, MESSAGES = 4, 300
WAITERS = 20  # as many pages


def test_another_thread_does_not_set_the_event_past_the_loop():
    event, waiting = LoopEvent(), []

    async def wait() -> None:
        waiting.append(asyncio.ensure_future(event.wait()))
        await asyncio.sleep(0)
        await asyncio.to_thread(event.set)
        assert not event.is_set() and not waiting[0].done()
        event.set()
        await waiting[0]

    asyncio.run(wait())


def test_what_threads_write_wakes_every_page_that_waits():
    write_through_the_loop()
    loop = asyncio.new_event_loop()

    async def page(buffer: AsyncMessageBuffer, seen: list[int]) -> None:
        while seen[0] < WRITERS * MESSAGES:
            await buffer.message_event.wait()
            buffer.message_event.clear()
            seen[0] = buffer.message_counter

    async def everything() -> None:
        buffer = AsyncMessageBuffer(loop, persistent_messages=False)
        pages = [asyncio.ensure_future(page(buffer, [0])) for _ in range(WAITERS)]

        def write() -> None:
            for _ in range(MESSAGES):
                buffer.push(RemoveNotificationMessage("note"))

        threads = [threading.Thread(target=write) for _ in range(WRITERS)]
        for thread in threads:
            thread.start()
        await asyncio.wait_for(asyncio.gather(*pages), 60.0)
        for thread in threads:
            thread.join()

    loop.run_until_complete(everything())
    loop.close()


def test_the_page_is_opened_with_such_events():
    server = open_page(LOOPBACK, 0)
    try:
        buffer = server._websock_server.get_message_buffer()
        assert isinstance(buffer.message_event, LoopEvent)
    finally:
        server.stop()
