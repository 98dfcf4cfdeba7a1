"""The twin server: runs the twin in real time, publishes its state on Zenoh, takes commands only as checked queries.

`server_process` is its program.
"""

import functools
import threading
import time
from abc import abstractmethod
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Self

import zenoh

from motm_twin.bus.commands import Refused
from motm_twin.bus.connection import LOOPBACK, Keys, PlantKeys, free_port, open_server
from motm_twin.bus.data_folder import DEFAULT_FOLDER, DataFolder
from motm_twin.bus.library import TwinSetup
from motm_twin.bus.loop import TwinLoop
from motm_twin.bus.private_folder import forget
from motm_twin.bus.publisher import Publisher
from motm_twin.bus.queries import Answering, DeferredQueryable

HEARTBEAT = 0.5  # [s] between two status messages
METRICS_EVERY = 2  # status messages
LAST_WAIT = 1.0  # [s] for the current period to end when the server stops


@dataclass(frozen=True, kw_only=True)
class RobotChoice:
    """A robot in another program."""

    meet: Callable[..., Any]  # (session, twin, *, listen_only) -> link to the robot, closed with the server
    make_twin: Callable[..., Any]  # a Twin: (link, scene, *, method)
    mirror: bool = False  # the robot is shown, never commanded
    session: zenoh.Session | None = None  # session to which the robot connects; None: the server's own


def server_clock() -> Callable[[], float]:
    """Unix time at the start plus monotonic time since [s], so that steps of the wall clock do not affect commands."""
    offset = time.time() - time.monotonic()
    return lambda: offset + time.monotonic()


class Server:
    """A server on Zenoh. ``with TwinServer(...) as server:`` runs it in threads until the block ends."""

    def __init__(self, port: int, host: str = LOOPBACK) -> None:
        self.port = port or free_port(host)
        self._stop = threading.Event()
        self._threads: list[threading.Thread] = []

    @property
    def endpoint(self) -> str:
        """Address for clients on this machine."""
        return f"tcp/{LOOPBACK}:{self.port}"

    def start(self) -> None:
        """Start the threads that run or play."""
        for thread in self._threads:
            thread.start()

    @abstractmethod
    def close(self) -> bool:
        """Stop and withdraw all keys; False when something had to be abandoned."""

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class TwinServer(Server):
    """A twin on Zenoh."""

    def __init__(
        self,
        setup: TwinSetup,
        *,
        port: int = 0,
        host: str = LOOPBACK,
        twin: str = "frankie",
        data: Path = DEFAULT_FOLDER,
        robot: RobotChoice | None = None,
        open_bus: bool = False,
    ) -> None:
        """``robot``: an external robot instead of the simulated one; ``setup.make_twin`` is then unused.

        ``open_bus``: let in every program of this machine, not only those of this user.
        """
        super().__init__(port, host)
        self.keys, plant = Keys(twin), PlantKeys(twin)
        own = (*self.keys.own, *plant.from_twin)
        self._session = open_server(self.port, host, own, plant.queried_by_twin, open_bus=open_bus)
        clock = server_clock()
        self._data = DataFolder(
            data,
            self.endpoint,
            twin,
            changed=lambda: self._publisher.status(),  # noqa: PLW0108 - created below
            failed=self._recording_failed,
        )
        self._robot = None
        if robot is not None:
            self._robot = robot.meet(robot.session or self._session, twin, listen_only=robot.mirror)
            make_twin = functools.partial(robot.make_twin, self._robot)
            setup = replace(setup, make_twin=make_twin, plant="mirror" if robot.mirror else "zenoh")
        self.loop = TwinLoop(setup, twin_name=twin, sink=self, server_time=clock, data=self._data)
        self._library = setup.library
        self._publisher = Publisher(
            self._session,
            self.keys,
            status=self.loop.status,
            now=clock,
            took=lambda: self.loop.took,
            idle=self.loop.idle,
        )
        self.tick, self.scene, self.status = self._publisher.tick, self._publisher.scene, self._publisher.status
        self.event = self._publisher.event_log.add
        self._answering = Answering(self._session, self.keys, now=clock, request=self.loop.request, idle=self.loop.idle)
        self._queryable = DeferredQueryable(self._session, [self.keys.session], self._on_session, self.loop.idle)
        self._token = self._session.liveliness().declare_token(self.keys.alive)
        self._threads = [
            threading.Thread(target=self.loop.run, name="twin", daemon=True),
            threading.Thread(target=self._heartbeat, name="heartbeat", daemon=True),
        ]

    def record(self, path: Path, done: Callable[[str, str], None]) -> None:
        """Record to this file; ``done`` gets the refusal ("": begun) and the path, from another thread."""
        self._data.record(path, done)

    def close(self) -> bool:
        """Stop within a second and a half; False when the current period had to be abandoned."""
        self._stop.set()
        self._data.close()  # while the loop can still give it the session
        self.loop.stop()
        self._token.undeclare()
        self._answering.close()
        self._queryable.undeclare()
        for thread in self._threads:
            thread.join(LAST_WAIT)
        ended = not any(thread.is_alive() for thread in self._threads)
        if ended:
            if self._robot is not None:
                self._robot.close()
            self._publisher.close()
            self._session.close()
            forget(self.port)
        return ended

    def _recording_failed(self, text: str) -> None:
        status = self.loop.status()
        self._publisher.event_log.add(run=status.run, index=-1, time=status.time, kind="recording", text=text)

    def _heartbeat(self) -> None:
        beats = 0
        while not self._stop.wait(HEARTBEAT):
            beats += 1
            self._publisher.status()
            if beats % METRICS_EVERY == 0:
                self._publisher.metrics()
            if self._library.changed():
                self.loop.reload()

    def _on_session(self, query: zenoh.Query) -> None:
        def reply(session: bytes, info: bytes, problem: str) -> None:
            with suppress(zenoh.ZError), query:
                if problem:
                    query.reply_err(problem)
                else:
                    query.reply(self.keys.session, session, attachment=info, encoding=zenoh.Encoding.APPLICATION_JSON)

        try:
            self.loop.session(reply)
        except Refused as refusal:
            reply(b"", b"", str(refusal))
