"""Participants of the bus benchmark: a bare Zenoh sender; fast, slow and stuck readers; a server with a clock in it."""

import collections
import contextlib
import functools
import itertools
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec
import zenoh

from motm_twin.bus.client import TwinClient
from motm_twin.bus.commands import Load
from motm_twin.bus.connection import LOOPBACK, free_port, open_client, open_server
from motm_twin.bus.library import FileLibrary, TwinSetup
from motm_twin.bus.server import TwinServer
from motm_twin.perf.processes import Works
from motm_twin.planning.types import SearchBudget
from motm_twin.program import share_arenas
from motm_twin.server_process import SEARCH_SECONDS, make_twin

KEY = "motm-bench/bare"


def bare() -> tuple[dict[str, str], Works]:
    """Role of a sender of given bytes, stamped, for comparison with a twin: a publisher like that of the ticks."""
    port = free_port()
    session = open_server(port)
    publisher = session.declare_publisher(
        KEY,
        encoding=zenoh.Encoding.APPLICATION_JSON,
        congestion_control=zenoh.CongestionControl.DROP,
        reliability=zenoh.Reliability.RELIABLE,
    )

    def send(payloads: list[str], period: float) -> None:
        """Send these in turn, one every ``period`` [s], until the end."""
        due = time.monotonic()
        for payload in itertools.cycle([text.encode() for text in payloads]):
            time.sleep(max(0.0, due - time.monotonic()))
            publisher.put(payload, attachment=repr(time.monotonic()).encode())
            due += period

    def begin(**given: Any) -> None:
        threading.Thread(target=send, kwargs=given, daemon=True).start()

    return {"endpoint": f"tcp/{LOOPBACK}:{port}"}, {"send": begin, "close": session.close}


class _Stamp(msgspec.Struct):
    """The part of a tick that is looked at."""

    server_time: float
    index: int


_stamp = msgspec.json.Decoder(_Stamp).decode


class Readers:
    """All readers of this process; times are monotonic [s], those of the server less ``clock``."""

    def __init__(self) -> None:
        self._kept: list[Any] = []  # sessions and subscribers: one ends when it is forgotten
        self._heard: dict[str, list[tuple[float, bytes, bytes]]] = {}
        self._counts: list[Any] = []

    def listen(self, name: str, endpoint: str, key: str) -> None:
        """Note under ``name`` when each sample of a key comes, in Zenoh's own thread."""
        heard = self._heard[name] = []

        def note(sample: zenoh.Sample) -> None:
            now, attachment = time.monotonic(), sample.attachment
            heard.append((now, sample.payload.to_bytes(), b"" if attachment is None else attachment.to_bytes()))

        self._subscribe(endpoint, [key], zenoh.handlers.Callback(note, indirect=False))

    def delays(self, name: str, clock: float) -> list[float]:
        """Delay [s] of each sample since its stamp: its attachment, else its server time."""
        found = []
        for at, payload, attachment in list(self._heard[name]):
            sent = float(attachment) if attachment else _stamp(payload).server_time - clock
            found.append(at - sent)
        return found

    def payloads(self, name: str) -> list[str]:
        """The texts that came."""
        return [payload.decode() for _, payload, _ in list(self._heard[name])]

    def follow(self, endpoint: str, keys: list[str], sessions: int) -> None:
        """So many sessions that read everything as it comes."""
        for _ in range(sessions):
            counter = itertools.count()
            count = lambda _, counter=counter: next(counter)  # noqa: E731
            self._subscribe(endpoint, keys, zenoh.handlers.Callback(count, indirect=False))
            self._counts.append(counter)

    def jam(self, endpoint: str, keys: list[str], sessions: int) -> None:
        """So many sessions that stay alive but never read: their queue is full after one message, and Zenoh waits."""
        for _ in range(sessions):
            self._subscribe(endpoint, keys, zenoh.handlers.FifoChannel(1))

    def received(self) -> list[int]:
        """Number of messages that each session of `follow` has received."""
        return [next(counter) for counter in self._counts]  # counts the question too, which does not matter

    def ages(self, endpoint: str, twin: str, pauses: list[float], seconds: float, clock: float) -> dict[str, Any]:
        """Ages [s] of what readers get that look every so often [s], by a ring of one sample and by `TwinClient`."""
        found: dict[str, list[float]] = {}
        threads = []
        with TwinClient(endpoint, twin) as client, contextlib.ExitStack() as stack:
            key = client.keys.tick
            while client.tick() is None:
                time.sleep(0.01)
            for pause in pauses:
                session = stack.enter_context(open_client(endpoint))
                ring: Any = session.declare_subscriber(key, zenoh.handlers.RingChannel(1))
                for name, look in (("ring", functools.partial(_newest, ring)), ("client", client.tick)):
                    ages = found[f"{name}, {pause:g} s"] = []
                    work = threading.Thread(target=_look, args=(look, pause, seconds, clock, ages))
                    threads.append(work)
                    work.start()
            for thread in threads:
                thread.join()
        return found

    def _subscribe(self, endpoint: str, keys: list[str], handler: Any) -> None:
        """A session that listens to some keys for as long as this process lives."""
        session = open_client(endpoint)
        self._kept += [session, *(session.declare_subscriber(key, handler) for key in keys)]


def _newest(ring: Any) -> _Stamp | None:
    """Take what a ring holds; None when nothing came since."""
    sample = ring.try_recv()
    return None if sample is None else _stamp(sample.payload.to_bytes())


def _look(look: Callable[[], Any], pause: float, seconds: float, clock: float, ages: list[float]) -> None:
    """Look again and again; the first looks, before the first sample, do not count."""
    until = time.monotonic() + seconds
    while time.monotonic() < until:
        time.sleep(pause or 0.001)
        tick = look()
        if tick is not None:
            ages.append(time.monotonic() - (tick.server_time - clock))


def readers() -> tuple[dict[str, str], Works]:
    """Role of all kinds of readers."""
    them = Readers()
    works = ("listen", "delays", "payloads", "follow", "jam", "received", "ages")
    return {}, {name: getattr(them, name) for name in works}


def timed_sink(server: TwinServer) -> Callable[[], list[tuple[float, float]]]:
    """Time the loop's calls of the publisher, in the loop's own thread.

    What comes back gives the times [s] since it was last asked: what passed, and what the thread computed, not waiting
    for its turn.
    """
    call, took = server.tick, collections.deque[tuple[float, float]]()

    def timed(*arguments: Any, **named: Any) -> None:
        began, computed = time.perf_counter(), time.thread_time()
        call(*arguments, **named)
        took.append((time.perf_counter() - began, time.thread_time() - computed))

    server.tick = timed
    return lambda: [took.popleft() for _ in range(len(took))]


def clock_offset(server: TwinServer) -> float:
    """Server time minus monotonic time [s], which all processes of a machine share; the best of some readings."""
    readings = []
    for _ in range(20):
        before = time.monotonic()
        status = server.loop.status()
        after = time.monotonic()
        readings.append((after - before, status.server_time - (before + after) / 2))
    return min(readings)[1]


def timed_twin(scene: str, data: str) -> tuple[dict[str, Any], Works]:
    """Role of a paused twin server; ``data``: folder of recordings."""
    share_arenas()
    library = FileLibrary(scene)
    server = TwinServer(
        TwinSetup(
            library=library,
            make_twin=functools.partial(make_twin, budget=SearchBudget(seconds=SEARCH_SECONDS), plant="simulated"),
            first=Load(scene=library.own_name),
            playing=False,
        ),
        data=Path(data),
    )
    taken = timed_sink(server)
    server.start()
    while server.loop.status().state == "loading":
        time.sleep(0.05)
    hello = {"endpoint": server.endpoint, "clock": clock_offset(server), "state": server.loop.status().text}
    return hello, {"sink": taken, "close": server.close}
