"""`connect`, and the client of a running twin."""

import atexit
import sys
import time
import weakref
from collections.abc import Callable, Iterator
from pathlib import Path

import zenoh

from motm_twin.bus import commands, messages
from motm_twin.bus.client import Grid, TwinClient
from motm_twin.client.commanding import Commanding
from motm_twin.client.discover import find, silent
from motm_twin.client.events import EventReader
from motm_twin.model.scene import Scene

LOADING = 120.0  # [s] for a load, which may compile the control loop
STEPPING = 60.0  # [s] for steps
FIRST_TICK = 1.0  # [s] after the begin of a run with an external robot, which may not be there
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
        except zenoh.ZError as error:  # a configuration of mode "client" wants somebody there at once
            raise silent(twin, endpoint) from error
        self._name = (name or Path(sys.argv[0]).name.removeprefix("-c") or "program")[: commands.NAME_MAX]
        self._readers: weakref.WeakSet[EventReader] = weakref.WeakSet()
        atexit.register(self._close_at_exit, weakref.ref(self.client))
        if not self._within(timeout, lambda: self.client.status() is not None):
            self.close()
            raise silent(twin, endpoint)

    @property
    def name(self) -> str:
        """Name of the twin."""
        return self.client.keys.twin

    def send(self, command: commands.Command, timeout: float = 2.0) -> commands.Answer:
        """Send a command; return when its new run has begun or its steps are done. Raises Refused and TimeoutError.

        Other commands hold from the period after ``index`` of the answer. ``timeout`` [s] is for the answer. A run that
        waits for an external robot counts as begun, without a first period.
        """
        before, shown = self.client.status(), self.client.tick()
        answer = self.client.command(command, timeout, name=self._name)
        if not answer.ok:
            raise commands.Refused(answer.reason)
        if begins_run(command, before):
            run = -1 if before is None else before.run
            self._wait_run(run, None if shown is None else shown.run, LOADING)
        elif isinstance(command, commands.Step):
            self.wait_until(lambda tick: tick.index >= answer.index + command.count, timeout=STEPPING)
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

    def _wait_run(self, run: int, shown: int | None, timeout: float) -> None:
        """Wait for a run after ``run`` other than ``shown``: a status that comes late names the run before that."""
        settled: list[float] = []  # [s] when the run of an external robot was seen to have begun

        def began() -> bool:
            status, tick = self.client.status(), self.client.tick()
            if status is not None and status.run > run and status.state in ("playing", "paused"):
                settled.append(time.monotonic())
                if status.plant in ("zenoh", "mirror") and settled[-1] > settled[0] + FIRST_TICK:
                    return True
            if status is not None and status.state == "error" and status.run >= run:
                raise commands.Refused(status.text)
            return tick is not None and tick.run > run and tick.run != shown

        if not self._within(timeout, began):
            raise TimeoutError(f"the run did not begin within {timeout:g} s")

    def _within(self, timeout: float, condition: Callable[[], bool]) -> bool:
        deadline = time.monotonic() + timeout
        count = 0
        while not condition():
            left = deadline - time.monotonic()
            if left <= 0.0 or self.client.closed:
                return False
            count = self.client.wait(self.client.keys.status, count, min(left, 0.05))
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
