"""Participants of a measurement of scale: a router, many simulated twins, or many viewers."""

import collections
import heapq
import random
import threading
import time
from typing import Any

import zenoh

from motm_twin.bus.connection import LOOPBACK, free_port, open_client, open_member
from motm_twin.bus.keys import Keys
from motm_twin.bus.zenoh_config import session_config
from motm_twin.perf.report import percentiles
from motm_twin.perf.worker import Works

Sizes = dict[str, dict[str, Any]]  # by the last part of a key: rate [1/s], and sizes [bytes] of payloads

_keep: list[Any] = []  # what lives as long as this process


def router(connect: list[str]) -> str:
    """Become a Zenoh router, linked with others; where it listens."""
    endpoint = f"tcp/{LOOPBACK}:{free_port()}"
    _keep.append(zenoh.open(session_config(listen=[endpoint], connect=connect, mode="router")))
    return endpoint


class Observed:
    """Sizes of the messages of one real twin, by key."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._sizes: dict[str, list[int]] = collections.defaultdict(list)

    def note(self, sample: zenoh.Sample) -> None:
        """One message."""
        attachment = sample.attachment
        size = len(sample.payload.to_bytes()) + (0 if attachment is None else len(attachment.to_bytes()))
        with self._lock:
            self._sizes[str(sample.key_expr).rsplit("/", 1)[-1]].append(size)

    def found(self, seconds: float) -> Sizes:
        """Rates and sizes by key."""
        with self._lock:
            return {key: {"rate": len(sizes) / seconds, "sizes": sizes[:500]} for key, sizes in self._sizes.items()}


def observe(endpoint: str, twin: str, seconds: float) -> Sizes:
    """Rates and sizes of everything that a twin sends within some seconds."""
    observed = Observed()
    with open_client(endpoint) as session:
        handler = zenoh.handlers.Callback(observed.note, indirect=False)
        subscriber = session.declare_subscriber(f"{Keys(twin).tick.rsplit('/', 1)[0]}/*", handler)
        time.sleep(1.0)  # until all links know of it
        observed._sizes.clear()
        time.sleep(seconds)
        found = observed.found(seconds)
        subscriber.undeclare()
    return found


class Twins:
    """Simulated twins: each a session that sends what a real one sends, at its times and of its sizes."""

    def __init__(self) -> None:
        self._stop, self._thread = threading.Event(), threading.Thread(target=self._run, daemon=True)
        self._due: list[tuple[float, int]] = []
        self._streams: list[tuple[Any, list[bytes], float, list[int]]] = []
        self._late: list[float] = []
        self._sent = [0, 0]  # messages, bytes

    def begin(self, endpoint: str, names: list[str], sizes: Sizes) -> int:
        """Connect these and let them send."""
        draw, now = random.Random(0), time.monotonic() + 0.5
        for name in names:
            session = open_member(endpoint, wait=30.0)
            _keep.append(session)
            self._token(session, name)
            for key, about in sizes.items():
                publisher = session.declare_publisher(
                    f"motm/{name}/{key}", congestion_control=zenoh.CongestionControl.DROP
                )
                period = 1.0 / max(about["rate"], 0.1)
                payloads = [bytes(size) for size in about["sizes"]]
                heapq.heappush(self._due, (now + draw.random() * period, len(self._streams)))
                self._streams.append((publisher, payloads, period, [0]))
        self._thread.start()
        return len(names)

    def take(self) -> dict[str, Any]:
        """Number of messages and bytes sent since the last call, and their lateness [ms]."""
        sent, self._sent = self._sent, [0, 0]
        late, self._late = self._late, []
        return {"messages": sent[0], "bytes": sent[1], "late_ms": percentiles([1000.0 * value for value in late])}

    def _token(self, session: zenoh.Session, name: str) -> None:
        _keep.append(session.liveliness().declare_token(Keys(name).alive))

    def _run(self) -> None:
        while not self._stop.is_set():
            due, index = self._due[0]
            wait = due - time.monotonic()
            if wait > 0.0:
                time.sleep(wait)
            publisher, payloads, period, count = self._streams[index]
            payload, now = payloads[count[0] % len(payloads)], time.monotonic()
            publisher.put(payload, attachment=f"{now!r} {count[0]}".encode())
            count[0] += 1
            self._late.append(now - due)
            self._sent[0] += 1
            self._sent[1] += len(payload)
            heapq.heapreplace(self._due, (due + period, index))


class Viewers:
    """Viewers: each a session that reads everything of one twin, or one key of all twins."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._messages = self._bytes = self._lost = 0
        self._delays: list[float] = []
        self._last: dict[tuple[int, str], int] = {}

    def begin(self, endpoint: str, names: list[str], key: str, timed: str) -> int:
        """Connect one viewer for each of these twins ("*": all), for ``key``; delays are those of the key ``timed``."""
        for number, name in enumerate(names):
            session = open_member(endpoint, wait=30.0)
            handler = zenoh.handlers.Callback(self._noted(number, f"/{timed}"), indirect=False)
            _keep.extend((session, session.declare_subscriber(f"motm/{name}/{key}", handler)))
        return len(names)

    def take(self) -> dict[str, Any]:
        """Messages and bytes received since the last call; of timed ones those missed, and their delays [s]."""
        with self._lock:
            taken = {"messages": self._messages, "bytes": self._bytes, "lost": self._lost, "delays": self._delays}
            self._messages = self._bytes = self._lost = 0
            self._delays = []
        return taken

    def _noted(self, number: int, timed: str) -> Any:
        def note(sample: zenoh.Sample) -> None:
            now, key, size = time.monotonic(), str(sample.key_expr), len(sample.payload)
            assert sample.attachment is not None
            stamp, count = sample.attachment.to_string().split()
            with self._lock:
                self._messages += 1
                self._bytes += size
                if key.endswith(timed):
                    self._delays.append(now - float(stamp))
                    self._lost += max(0, int(count) - self._last.get((number, key), int(count) - 1) - 1)
                    self._last[number, key] = int(count)

        return note


def fleet() -> tuple[dict[str, str], Works]:
    """Role of a router, simulated twins, viewers, or the observer of a real twin."""
    twins, viewers = Twins(), Viewers()
    works: Works = {"router": router, "observe": observe, "twins": twins.begin, "sent": twins.take}
    return {}, works | {"viewers": viewers.begin, "received": viewers.take}
