"""Client of a running twin for programs with asyncio."""

import asyncio
from collections.abc import AsyncGenerator, Awaitable, Callable
from contextlib import aclosing, asynccontextmanager, suppress
from functools import partial, wraps
from typing import Any, TypeVar

from motm_twin.bus import messages
from motm_twin.bus.commands import Answer, Command
from motm_twin.client.commanding import Commanding
from motm_twin.client.twin import LOOK, EventReader, Twin, connect

T = TypeVar("T")


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


def _at_once(method: Callable[[Twin], T]) -> Callable[["AsyncTwin"], T]:
    """A method of a twin that does not wait."""
    return wraps(method)(lambda self: method(self.twin))


def _in_thread(method: Callable[[Twin], T]) -> Callable[["AsyncTwin"], Awaitable[T]]:
    """A method of a twin that is awaited, as it may wait for an answer."""
    return wraps(method)(lambda self: asyncio.to_thread(method, self.twin))


class AsyncTwin(Commanding[Awaitable[Answer]]):
    """As `Twin`; commands, iterators and waits are awaited, the newest state needs no await."""

    def __init__(self, twin: Twin) -> None:
        """For a connected twin."""
        self.twin = twin
        self._wakes: set[asyncio.Event] = set()

    async def send(self, command: Command, timeout: float = 2.0) -> Answer:
        """As `Twin.send`."""
        return await asyncio.to_thread(self.twin.send, command, timeout)

    latest_tick, status = _at_once(Twin.latest_tick), _at_once(Twin.status)
    grid, scene = _at_once(Twin.grid), _at_once(Twin.scene)
    robot, scan, metrics = _in_thread(Twin.robot), _in_thread(Twin.scan), _in_thread(Twin.metrics)  # they subscribe
    session = _in_thread(Twin.session)

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
