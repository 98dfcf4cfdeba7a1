"""`connect`, and the client of a running twin; `connect_async` and `AsyncTwin` for programs with asyncio."""

import asyncio
import atexit
import sys
import threading
import time
import weakref
from collections import deque
from collections.abc import AsyncGenerator, Awaitable, Callable, Iterator
from contextlib import aclosing, asynccontextmanager, suppress
from functools import partial, wraps
from pathlib import Path
from typing import Any, TypeGuard, TypeVar

import msgspec
import zenoh

from motm_twin.bus import commands, messages
from motm_twin.bus.client import Grid, TwinClient
from motm_twin.bus.commands import Answer, Command
from motm_twin.bus.messages import NumberedEvent
from motm_twin.client.commanding import Commanding
from motm_twin.client.discover import find, silent
from motm_twin.model.scene import Scene

LIVE = 1000  # events kept for a slow reader; older ones are fetched from the history
LOOK = 2.0  # [s] without an event after which the history is checked for lost ones


class EventsLost(Exception):
    """Events are lost: the reader fell behind by more than the server's history. ``events(last + 1)`` goes on."""

    def __init__(self, first: int, last: int) -> None:
        self.first, self.last = first, last
        super().__init__(f"events {first} to {last} are no longer in the server's history: read events faster")


class EventReader:
    """One reader of the events of a twin; for one thread."""

    def __init__(self, client: TwinClient, since: int | None, changed: Callable[[], None] = lambda: None) -> None:
        """``since``: number of the first event wanted; None: only new ones. ``changed`` is called for every new one."""
        self._client, self._tell = client, changed
        self._live: deque[NumberedEvent] = deque(maxlen=LIVE)
        self._changed = threading.Condition()
        self._decode = msgspec.json.Decoder(NumberedEvent).decode
        client.follow(client.keys.event)  # subscribe first, then query: no event falls in between
        self._leave = client.on_sample(client.keys.event, self._heard)
        history = client.events(0 if since is None else since)
        newest = 0 if history is None else history.newest
        self._epoch = None if history is None else history.numbered_since
        self._expected = newest + 1 if since is None else max(1, since)
        self._ready: deque[NumberedEvent] = deque(
            event for event in (history.events if history else ()) if event.seq >= self._expected
        )

    def take(self) -> list[NumberedEvent]:
        """All available events, oldest first. Queries the server for missing ones. Raises EventsLost."""
        taken: list[NumberedEvent] = []
        while True:
            while self._ready:
                taken.append(self._ready.popleft())
                self._expected = taken[-1].seq + 1
            with self._changed:
                event = self._live.popleft() if self._live else None
            if event is None:
                return taken
            if event.numbered_since != self._epoch:  # the server was started again
                self._epoch, self._expected = event.numbered_since, 1
            if event.seq == self._expected:
                self._ready.append(event)
            elif event.seq > self._expected and (taken or not self._fetch()):
                self._live.appendleft(event)  # earlier events come first; without an answer, try later
                return taken

    def look(self) -> list[NumberedEvent]:
        """As `take`, but always queries the history: the newest event may have been lost."""
        taken = self.take()
        if not taken:
            self._fetch()
        return taken or self.take()

    def wait(self, timeout: float) -> bool:
        """Wait for an event, for `timeout` [s], or until `wake`; True when there may be one."""
        with self._changed:
            return self._changed.wait_for(lambda: bool(self._live or self._ready) or self._client.closed, timeout)

    def wake(self) -> None:
        """End a `wait`."""
        with self._changed:
            self._changed.notify_all()
        self._tell()

    def __iter__(self) -> Iterator[NumberedEvent]:
        """Every event, until the twin is closed."""
        try:
            while not self._client.closed:
                yield from self.take() if self.wait(LOOK) else self.look()
        finally:
            self.close()

    def close(self) -> None:
        """Unsubscribe."""
        self._leave()

    def _heard(self, payload: bytes) -> None:
        """Take an event; called in Zenoh's thread."""
        event = self._decode(payload)
        with self._changed:
            self._live.append(event)
            self._changed.notify_all()
        self._tell()

    def _fetch(self) -> bool:
        """Put missing events into `_ready`; False when the server does not answer. Raises EventsLost."""
        if self._client.closed or (history := self._client.events(self._expected)) is None:
            return False
        if history.numbered_since != self._epoch:
            self._epoch, self._expected = history.numbered_since, 1
            return self._fetch()
        self._ready.extend(history.events)
        if history.oldest > self._expected and history.newest >= self._expected:
            first, self._expected = self._expected, history.oldest
            raise EventsLost(first, history.oldest - 1)
        return True


LOADING = 120.0  # [s] for a load, which may compile the control loop
STEPPING = 60.0  # [s] for steps
FIRST_TICK = 1.0  # [s] after the start of a run with an external robot, which may be absent
_SLICE = 0.5  # [s] of one wait


def connect(endpoint: str | None = None, twin: str | None = None, *, name: str = "", timeout: float = 5.0) -> "Twin":
    """Connect to a running twin; by default to that of MOTM_ZENOH_CONFIG, or to the one this user runs here.

    Args:
        endpoint: Address of the twin server, "tcp/127.0.0.1:7447".
        twin: Name of the twin.
        name: Driver name shown to others; by default the name of the program.
        timeout: Time for the twin to answer [s].

    Raises:
        NoTwin: No twin answers, or several are running: give ``twin`` or ``endpoint``.
        ConfigError: The file of MOTM_ZENOH_CONFIG cannot be used; a ValueError.
    """
    return Twin(*find(endpoint, twin), name=name, timeout=timeout)


class Twin(Commanding[commands.Answer]):
    """A running twin: its newest state, all of its events, and commands. Usable from several threads."""

    def __init__(self, endpoint: str, twin: str, *, name: str = "", timeout: float = 5.0) -> None:
        """Connect to a known twin; `connect` also finds it. Raises NoTwin."""
        try:
            self.client = TwinClient(endpoint, twin)
        except zenoh.ZError as error:  # a configuration of mode "client" needs a server at once
            raise silent(twin, endpoint) from error
        self._name = (name or Path(sys.argv[0]).name.removeprefix("-c") or "program")[: commands.NAME_MAX]
        self._readers: weakref.WeakSet[EventReader] = weakref.WeakSet()
        atexit.register(self._close_at_exit, weakref.ref(self.client))
        if not self._within(timeout, lambda: self.client.status() is not None, self.client.keys.status):
            self.close()
            raise silent(twin, endpoint)

    @property
    def name(self) -> str:
        """Name of the twin."""
        return self.client.keys.twin

    def send(self, command: commands.Command, timeout: float = 2.0) -> commands.Answer:
        """Send a command; return when its new run has begun, or its steps are done or have ended the run.

        Raises Refused, also for a run that stops with an error meanwhile, and TimeoutError. Other commands take effect
        in the period after ``index`` of the answer. ``timeout`` [s] is for the answer. A run that waits for an external
        robot counts as begun, without a first period.
        """
        before, shown = self.client.status(), self.client.tick()
        answer = self.client.command(command, timeout, name=self._name)
        if not answer.ok:
            raise commands.Refused(answer.reason)
        run = max((each.run for each in (before, shown) if each is not None), default=-1)  # a status may be late
        if _leaps_ahead(command, before, shown):
            self._wait_steps(run, command.index, answer.server_time)
        elif begins_run(command, before):
            self._wait_run(run, answer.server_time)
        elif isinstance(command, commands.Step):
            self._wait_steps(run, answer.index + command.count, answer.server_time)
        return answer

    def latest_tick(self) -> messages.TickMessage | None:
        """The newest period; None before the first."""
        return self.client.tick()

    def status(self) -> messages.StatusMessage | None:
        """The newest state of the server."""
        return self.client.status()

    def robot(self) -> messages.RobotStateMessage | None:
        """The newest state of the robot, at 50 Hz; None before the first."""
        return self.client.robot()

    def scan(self) -> messages.ScanMessage | None:
        """The newest sweep of the lidar; None before the first."""
        return self.client.scan()

    def grid(self) -> Grid | None:
        """The newest occupancy grid."""
        return self.client.grid()

    def metrics(self) -> messages.MetricsMessage | None:
        """The newest metrics."""
        return self.client.metrics()

    def scene(self) -> Scene | None:
        """The scene that is loaded, resolved."""
        return self.client.scene()

    def session(self) -> bytes:
        """The run so far, as JSON for `motm-twin rerun`. Raises `motm_twin.bus.client.NoSession`."""
        return self.client.session()

    def ticks(self, timeout: float | None = None) -> Iterator[messages.TickMessage]:
        """Iterate over the newest ticks until closed; a slow reader skips some.

        Raises TimeoutError if none arrives for ``timeout`` [s].
        """
        return self._newest(self.client.keys.tick, self.client.tick, timeout)

    def robots(self, timeout: float | None = None) -> Iterator[messages.RobotStateMessage]:
        """Iterate over the state of the robot at 50 Hz, as `ticks` does."""
        self.client.follow(self.client.keys.robot)
        return self._newest(self.client.keys.robot, self.client.robot, timeout)

    def events(self, since: int | None = None) -> Iterator[messages.NumberedEvent]:
        """Iterate over all events, none lost, until closed.

        ``since``: number of the first event (0: all that the server keeps); None: new events, from this call on.
        Raises EventsLost when the reader has fallen behind the server's history.
        """
        reader = EventReader(self.client, since)
        self._readers.add(reader)
        return iter(reader)

    def wait_until(self, condition: Callable[[messages.TickMessage], bool], *, timeout: float) -> messages.TickMessage:
        """Wait for a tick that fulfils a condition, and return it. Raises TimeoutError after ``timeout`` [s].

        For the final score wait for ``tick.ended is not None``: when a tick is ``done``, the last cube may still be
        falling; it counts once it lies in its bin. If it never gets there, ``ended`` stays None; the ``state`` of the
        server becomes "done" in any case.
        """
        deadline = time.monotonic() + timeout
        tick, count = None, -1
        while not self.client.closed:
            tick = self.client.tick()
            if tick is not None and condition(tick):
                return tick
            left = deadline - time.monotonic()
            if left <= 0.0:
                break
            count = self.client.wait_tick(count, min(left, _SLICE))
        seen = "no tick was seen" if tick is None else f"the last tick is of {tick.time:.2f} s"
        raise TimeoutError(f"the condition did not come true within {timeout:g} s; {seen}")

    def close(self) -> None:
        """Disconnect; iterators end. Closing twice is allowed."""
        self.client.close()
        for reader in list(self._readers):
            reader.wake()

    def __enter__(self) -> "Twin":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _newest(self, key: str, read: Callable, timeout: float | None) -> Iterator:
        count = 0
        while not self.client.closed:
            began = time.monotonic()
            while (now := self.client.wait(key, count, _SLICE)) <= count and not self.client.closed:
                if timeout is not None and time.monotonic() - began > timeout:
                    raise TimeoutError(f"nothing came on {key} for {timeout:g} s")
            count = now
            if not self.client.closed and (message := read()) is not None:
                yield message

    def _wait_run(self, run: int, since: float) -> None:
        """Wait for a run after ``run``; ``since`` as for `_status_after`."""
        settled: list[float] = []  # [s] when the run of an external robot was seen to have begun

        def began() -> bool:
            status, tick = self._status_after(since), self.client.tick()
            if status is not None and status.run > run and status.state in ("playing", "paused"):
                settled.append(time.monotonic())
                if status.plant in ("zenoh", "mirror") and settled[-1] > settled[0] + FIRST_TICK:
                    return True
            return tick is not None and tick.run > run

        if not self._within(LOADING, began, self.client.keys.status):
            raise TimeoutError(f"the run did not begin within {LOADING:g} s")

    def _wait_steps(self, run: int, last: int, since: float) -> None:
        """Wait for period ``last``, or the end of ``run`` if that comes first; ``since`` as for `_status_after`."""

        def made() -> bool:
            status, tick = self._status_after(since), self.client.tick()
            if status is not None and status.state == "done":
                return True
            return tick is not None and (tick.index >= last or tick.run > run)

        if not self._within(STEPPING, made, self.client.keys.tick):
            raise TimeoutError(f"the steps were not made within {STEPPING:g} s")

    def _status_after(self, since: float) -> messages.StatusMessage | None:
        """The newest status, if sent after ``since`` [s] on the server's clock. Raises Refused for an error."""
        status = self.client.status()
        if status is None or status.server_time <= since:
            return None
        if status.state == "error":
            raise commands.Refused(status.text)
        return status

    def _within(self, timeout: float, condition: Callable[[], bool], key: str) -> bool:
        """True as soon as a condition holds, False after ``timeout`` [s]; tested whenever ``key`` has a new value."""
        deadline = time.monotonic() + timeout
        count = 0
        while not condition():
            left = deadline - time.monotonic()
            if left <= 0.0 or self.client.closed:
                return False
            count = self.client.wait(key, count, min(left, 0.05))
        return True

    @staticmethod
    def _close_at_exit(reference: "weakref.ref[TwinClient]") -> None:
        client = reference()
        if client is not None:
            client.close()


def begins_run(command: commands.Command, status: messages.StatusMessage | None) -> bool:
    """True if a command, once accepted, begins a new run."""
    if isinstance(command, commands.Play):
        return status is not None and status.state == "done"
    return isinstance(command, commands.Load | commands.Seed | commands.Reset | commands.Branch | commands.UndoBranch)


def _leaps_ahead(
    command: commands.Command, status: messages.StatusMessage | None, tick: messages.TickMessage | None
) -> TypeGuard[commands.Branch]:
    """True for a branch to a later period of a recording, which stays in the present run."""
    recorded = status is not None and status.plant == "recording"
    return recorded and isinstance(command, commands.Branch) and tick is not None and tick.index <= command.index


T = TypeVar("T")


@asynccontextmanager
async def connect_async(
    endpoint: str | None = None, twin: str | None = None, *, name: str = "", timeout: float = 5.0
) -> AsyncGenerator["AsyncTwin", None]:
    """Connect for the duration of an ``async with`` block; arguments and errors as for `connect`."""
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
        """Wrap a connected twin."""
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
                found = await asyncio.to_thread(reader.look if quiet else reader.take)
                for event in found:
                    yield event
                quiet = not found and not await _woken(wake, LOOK)
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
        wake.set()  # first the messages that have arrived already
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
        """An event of this loop, and a function that sets it from any thread."""
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
