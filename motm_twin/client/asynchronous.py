"""Client of a running twin for programs with asyncio."""

import asyncio
from collections.abc import AsyncGenerator, Awaitable, Callable
from contextlib import aclosing, asynccontextmanager, suppress
from functools import partial
from typing import Any

from motm_twin.bus import messages
from motm_twin.bus.client import Grid
from motm_twin.bus.commands import Answer, Command
from motm_twin.client.commanding import Commanding
from motm_twin.client.twin import LOOK, EventReader, Twin, connect
from motm_twin.model.scene import Scene


@asynccontextmanager
async def connect_async(
    endpoint: str | None = None, twin: str | None = None, *, name: str = "", timeout: float = 5.0
) -> AsyncGenerator["AsyncTwin", None]:
    """Connect for the time of an ``async with`` block; arguments and errors as of `connect`."""
    handle = AsyncTwin(await asyncio.to_thread(partial(connect, endpoint, twin, name=name, timeout=timeout)))
    try:
        yield handle
    finally:
        await handle.close()


class AsyncTwin(Commanding[Awaitable[Answer]]):
    """As `Twin`; commands, iterators and waits are awaited, the newest state needs no await."""

    def __init__(self, twin: Twin) -> None:
        """For a connected twin."""
        self.twin = twin
        self._wakes: set[asyncio.Event] = set()

    async def send(self, command: Command, timeout: float = 2.0) -> Answer:
        """As `Twin.send`."""
        return await asyncio.to_thread(self.twin.send, command, timeout)

    def latest_tick(self) -> messages.TickMessage | None:
        """As `Twin.latest_tick`."""
        return self.twin.latest_tick()

    def status(self) -> messages.StatusMessage | None:
        """As `Twin.status`."""
        return self.twin.status()

    async def robot(self) -> messages.RobotStateMessage | None:
        """As `Twin.robot`; the first call subscribes."""
        return await asyncio.to_thread(self.twin.robot)

    async def scan(self) -> messages.ScanMessage | None:
        """As `Twin.scan`; the first call subscribes."""
        return await asyncio.to_thread(self.twin.scan)

    async def metrics(self) -> messages.MetricsMessage | None:
        """As `Twin.metrics`; the first call subscribes."""
        return await asyncio.to_thread(self.twin.metrics)

    def grid(self) -> Grid | None:
        """As `Twin.grid`."""
        return self.twin.grid()

    def scene(self) -> Scene | None:
        """As `Twin.scene`."""
        return self.twin.scene()

    async def session(self) -> bytes:
        """As `Twin.session`."""
        return await asyncio.to_thread(self.twin.session)

    def ticks(self) -> AsyncGenerator[messages.TickMessage, None]:
        """As `Twin.ticks`."""
        return self._newest(self.twin.client.keys.tick, self.twin.latest_tick)

    def robots(self) -> AsyncGenerator[messages.RobotStateMessage, None]:
        """As `Twin.robots`."""
        return self._newest(self.twin.client.keys.robot, self.twin.robot)

    async def events(self, since: int | None = None) -> AsyncGenerator[messages.NumberedEvent, None]:
        """As `Twin.events`; listening begins when the first one is awaited."""
        wake, notify = self._wake()
        reader = await asyncio.to_thread(EventReader, self.twin.client, since, notify)
        try:
            quiet = False
            while not self.twin.client.closed:
                for event in await asyncio.to_thread(reader.look if quiet else reader.take):
                    yield event
                quiet = not await _woken(wake, LOOK)
        finally:
            self._wakes.discard(wake)
            reader.close()

    async def wait_until(
        self, condition: Callable[[messages.TickMessage], bool], *, timeout: float
    ) -> messages.TickMessage:
        """As `Twin.wait_until`."""
        async with asyncio.timeout(timeout), aclosing(self.ticks()) as ticks:
            async for tick in ticks:
                if condition(tick):
                    return tick
        raise TimeoutError("the twin was closed before the condition came true")

    async def close(self) -> None:
        """As `Twin.close`."""
        await asyncio.to_thread(self.twin.close)
        for wake in self._wakes:
            wake.set()

    async def _newest(self, key: str, read: Callable) -> AsyncGenerator[Any, None]:
        await asyncio.to_thread(self.twin.client.follow, key)
        wake, notify = self._wake()
        wake.set()  # what is there already comes first
        leave = self.twin.client.on_sample(key, lambda _payload: notify())
        last = None
        try:
            while not self.twin.client.closed:
                await wake.wait()
                wake.clear()
                message = read()
                if message is not None and message is not last and not self.twin.client.closed:
                    last = message
                    yield message
        finally:
            self._wakes.discard(wake)
            leave()

    def _wake(self) -> tuple[asyncio.Event, Callable[[], None]]:
        """An event of this loop, and what sets it from any thread."""
        loop, wake = asyncio.get_running_loop(), asyncio.Event()
        self._wakes.add(wake)

        def notify() -> None:
            with suppress(RuntimeError):  # the loop has ended
                loop.call_soon_threadsafe(wake.set)

        return wake, notify


async def _woken(wake: asyncio.Event, timeout: float) -> bool:
    try:
        async with asyncio.timeout(timeout):
            await wake.wait()
    except TimeoutError:
        return False
    wake.clear()
    return True
