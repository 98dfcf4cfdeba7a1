"""Participants of benchmarks, each role in a process of its own: senders, readers, a twin, attackers, a fleet.

A worker (`processes.Worker`) executes JSON lines from its standard input one by one:
``python -m motm_twin.perf.participants ROLE [ARGUMENT ...]``. It prints a greeting when ready, and ends with its input.
"""

import collections
import contextlib
import functools
import heapq
import itertools
import json
import random
import socket
import sys
import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import msgspec
import zenoh

from motm_twin.bus.client import TwinClient
from motm_twin.bus.commands import Answer, Load
from motm_twin.bus.connection import LOOPBACK, Keys, free_port, open_client, open_member, open_server, session_config
from motm_twin.bus.library import FileLibrary, TwinSetup
from motm_twin.bus.server import TwinServer
from motm_twin.perf.fuzz import Fuzzer, Message
from motm_twin.perf.report import percentiles
from motm_twin.planning.types import SearchBudget
from motm_twin.processes import leave
from motm_twin.program import share_arenas
from motm_twin.server_process import SEARCH_SECONDS, make_twin

Works = dict[str, Callable[..., Any]]
KEY = "motm-bench/bare"
_keep: list[Any] = []  # objects kept alive as long as this process


def bare() -> tuple[dict[str, str], Works]:
    """Role of a sender of given bytes with time stamps, to compare a twin with: its publisher is like that of ticks."""
    port = free_port()
    session = open_server(port)
    publisher = session.declare_publisher(
        KEY,
        encoding=zenoh.Encoding.APPLICATION_JSON,
        congestion_control=zenoh.CongestionControl.DROP,
        reliability=zenoh.Reliability.RELIABLE,
    )

    def send(payloads: list[str], period: float) -> None:
        """Send the payloads in turn, one every ``period`` [s], without end."""
        due = time.monotonic()
        for payload in itertools.cycle([text.encode() for text in payloads]):
            time.sleep(max(0.0, due - time.monotonic()))
            publisher.put(payload, attachment=repr(time.monotonic()).encode())
            due += period

    def begin(**given: Any) -> None:
        threading.Thread(target=send, kwargs=given, daemon=True).start()

    return {"endpoint": f"tcp/{LOOPBACK}:{port}"}, {"send": begin, "close": session.close}


class _Stamp(msgspec.Struct):
    """The part of a tick that readers decode."""

    server_time: float
    index: int


_stamp = msgspec.json.Decoder(_Stamp).decode


class Readers:
    """All readers of this process; times are monotonic [s]: server times less ``clock``."""

    def __init__(self) -> None:
        self._heard: dict[str, list[tuple[float, bytes, bytes]]] = {}
        self._counts: list[Any] = []

    def listen(self, name: str, endpoint: str, key: str) -> None:
        """Note the arrival time of each sample of a key under ``name``, in Zenoh's own thread."""
        heard = self._heard[name] = []

        def note(sample: zenoh.Sample) -> None:
            heard.append((time.monotonic(), sample.payload.to_bytes(), _attached(sample)))

        self._subscribe(endpoint, [key], zenoh.handlers.Callback(note, indirect=False))

    def delays(self, name: str, clock: float) -> list[float]:
        """Delay [s] of each sample since its stamp, which is its attachment or else its server time."""
        return [
            at - (float(attachment) if attachment else _stamp(payload).server_time - clock)
            for at, payload, attachment in list(self._heard[name])
        ]

    def payloads(self, name: str) -> list[str]:
        """The received payloads as text."""
        return [payload.decode() for _, payload, _ in list(self._heard[name])]

    def follow(self, endpoint: str, keys: list[str], sessions: int) -> None:
        """Open this many sessions that read everything as it arrives."""
        for _ in range(sessions):
            self._counts.append(itertools.count())
            count = functools.partial(lambda counter, _: next(counter), self._counts[-1])
            self._subscribe(endpoint, keys, zenoh.handlers.Callback(count, indirect=False))

    def jam(self, endpoint: str, keys: list[str], sessions: int) -> None:
        """Open this many sessions that never read: their queue is full after one message, and Zenoh waits."""
        for _ in range(sessions):
            self._subscribe(endpoint, keys, zenoh.handlers.FifoChannel(1))

    def received(self) -> list[int]:
        """Number of messages that each session of `follow` has received."""
        return [next(counter) for counter in self._counts]  # counts this call, too, which does not matter

    def ages(self, endpoint: str, twin: str, pauses: list[float], seconds: float, clock: float) -> dict[str, Any]:
        """Ages [s] of ticks for readers that look every ``pauses`` [s], with a ring of one sample and `TwinClient`."""
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
        """Open a session that listens to these keys for as long as this process lives."""
        session = open_client(endpoint)
        _keep.extend([session, *(session.declare_subscriber(key, handler) for key in keys)])


def _attached(sample: zenoh.Sample) -> bytes:
    return b"" if sample.attachment is None else sample.attachment.to_bytes()


def _newest(ring: Any) -> _Stamp | None:
    """Take the sample of a ring; None when nothing has arrived since the last call."""
    sample = ring.try_recv()
    return None if sample is None else _stamp(sample.payload.to_bytes())


def _look(look: Callable[[], Any], pause: float, seconds: float, clock: float, ages: list[float]) -> None:
    """Add the age of the newest tick after each pause; looks before the first tick do not count."""
    until = time.monotonic() + seconds
    while time.monotonic() < until:
        time.sleep(pause or 0.001)
        tick = look()
        if tick is not None:
            ages.append(time.monotonic() - (tick.server_time - clock))


def readers() -> tuple[dict[str, str], Works]:
    """Role of all kinds of readers."""
    them = Readers()
    return {}, {name: getattr(them, name) for name in vars(Readers) if not name.startswith("_")}


def timed_sink(server: TwinServer) -> Callable[[], list[tuple[float, float]]]:
    """Time the loop's calls of the publisher in the loop's own thread.

    The returned function gives the times [s] since its last call as pairs: wall time, and processor time of the thread.
    """
    call, took = server.tick, collections.deque[tuple[float, float]]()

    def timed(*arguments: Any, **named: Any) -> None:
        began, computed = time.perf_counter(), time.thread_time()
        call(*arguments, **named)
        took.append((time.perf_counter() - began, time.thread_time() - computed))

    server.tick = timed
    return lambda: [took.popleft() for _ in range(len(took))]


def clock_offset(server: TwinServer) -> float:
    """Server time minus monotonic time [s], which all processes of a machine share: the quickest of 20 readings."""
    readings = []
    for _ in range(20):
        before = time.monotonic()
        status = server.loop.status()
        after = time.monotonic()
        readings.append((after - before, status.server_time - (before + after) / 2))
    return min(readings)[1]


def twin(scene: str, data: str) -> tuple[dict[str, Any], Works]:
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


OPEN = 100  # largest number of queries that wait for an answer
TIMEOUT = 10.0  # [s] for an answer
FIRST_VALUE = 30.0  # [s] until a new client knows the state
PATTERNS = ("*", "$", "//")

_answer = msgspec.json.Decoder(Answer)


class Attack:
    """Sends malformed messages and counts their outcomes.

    Answers arrive by callbacks: threads that wait for them would take half a core and thereby slow the attacked twin.
    """

    def __init__(self, endpoint: str, twin: str, clock: float) -> None:
        self._port = int(endpoint.rsplit(":", 1)[1])
        self._sessions = [open_member(endpoint, wait=10.0), open_client(endpoint)]  # a member, and a mere client
        self._fuzzer = lambda seed: Fuzzer(twin, seed, lambda: time.monotonic() + clock)
        self._room = threading.BoundedSemaphore(OPEN)
        self._sent = collections.Counter[str]()
        self.accepted: list[str] = []  # malformed commands that were accepted, for the report
        self.unanswered: list[str] = []
        self._failed: Exception | None = None

    def run(self, count: int, rate: float, seed: int) -> dict[str, Any]:
        """Send ``count`` messages at ``rate`` [1/s]; returns counts, and accepted or unanswered ones."""
        began = time.monotonic()
        for number, message in enumerate(self._fuzzer(seed).messages(count)):
            if (early := began + number / rate - time.monotonic()) > 0.0:
                time.sleep(early)
            self._send(message, self._sessions[number % len(self._sessions)])
            self._sent[message.how] += 1
        for _ in range(OPEN):
            self._room.acquire()  # every query has been answered or has timed out
        for _ in range(OPEN):
            self._room.release()
        if self._failed is not None:
            raise self._failed
        return {
            "sent": dict(self._sent),
            "seconds": time.monotonic() - began,
            "accepted": self.accepted[:10],
            "unanswered": self.unanswered[:10],
            "counts": {"accepted": len(self.accepted), "unanswered": len(self.unanswered)},
        }

    def close(self) -> None:
        """Close the sessions."""
        for session in self._sessions:
            session.close()

    def _send(self, message: Message, session: zenoh.Session) -> None:
        if message.kind == "raw":
            self._raw(message.payload)
            return
        try:
            key = zenoh.KeyExpr(message.key)
            selector = zenoh.Selector(key, message.parameters) if message.parameters else key
        except zenoh.ZError:
            return  # Zenoh cannot even send it
        if message.kind == "put":
            session.put(key, message.payload, attachment=message.payload[:20])
        elif message.kind == "delete":
            session.delete(key)
        else:
            self._query(session, selector, message)

    def _query(self, session: zenoh.Session, selector: Any, message: Message) -> None:
        self._room.acquire()
        answers: list[zenoh.Reply] = []

        def ended() -> None:
            try:
                self._judge(message, answers)
            except Exception as error:  # in a thread of Zenoh's, which would only print it
                self._failed = error
            finally:
                self._room.release()

        handler = zenoh.handlers.Callback(answers.append, ended, indirect=False)
        session.get(selector, handler, payload=message.payload, timeout=TIMEOUT)

    def _judge(self, message: Message, answers: list[zenoh.Reply]) -> None:
        if message.kind != "command":
            return
        good = [reply.ok.payload.to_bytes() for reply in answers if reply.ok is not None]
        if not good and not any(sign in message.key for sign in PATTERNS):
            self.unanswered.append(_shown(message))
        self.accepted += [_shown(message) for payload in good if _answer.decode(payload).ok]

    def _raw(self, payload: bytes) -> None:
        with contextlib.suppress(OSError), socket.create_connection((LOOPBACK, self._port), timeout=5.0) as link:
            link.sendall(payload)


def _shown(message: Message) -> str:
    return f"{message.how}: {message.key} {message.payload[:300]!r}"


def attack(endpoint: str, twin: str, clock: float, count: int, rate: float, seed: int) -> dict[str, Any]:
    """Send malformed messages on all keys, as `Attack.run`."""
    with contextlib.closing(Attack(endpoint, twin, clock)) as attacker:
        return attacker.run(count, rate, seed)


def visit(endpoint: str, twin: str, count: int, parallel: int) -> dict[str, int]:
    """Let ``count`` clients connect, wait until they know the state, and leave, ``parallel`` at a time."""

    def knew(_: int) -> bool:
        with TwinClient(endpoint, twin) as client:
            return _knows(client)

    with ThreadPoolExecutor(parallel) as pool:
        known = sum(pool.map(knew, range(count)))
    return {"left": count, "knew nothing": count - known}


def stay(endpoint: str, twin: str, count: int) -> int:
    """Connect clients that stay, to be killed with this process; returns the number that know the state."""
    clients = [TwinClient(endpoint, twin) for _ in range(count)]
    _keep.extend(clients)
    return sum(map(_knows, clients))


def _knows(client: TwinClient) -> bool:
    known = lambda: None not in (client.tick(), client.status(), client.scene())  # noqa: E731
    deadline = time.monotonic() + FIRST_VALUE
    while not known() and time.monotonic() < deadline:
        time.sleep(0.01)
    return known()


def attackers() -> tuple[dict[str, str], Works]:
    """Role of a sender of malformed messages, and of clients that come and go."""
    return {}, {"attack": attack, "visit": visit, "stay": stay}


Sizes = dict[str, dict[str, Any]]  # by the last part of a key: "rate" [1/s] and "sizes" [bytes] of payloads


def router(connect: list[str]) -> str:
    """Become a Zenoh router linked with others; returns its endpoint."""
    endpoint = f"tcp/{LOOPBACK}:{free_port()}"
    _keep.append(zenoh.open(session_config(listen=[endpoint], connect=connect, mode="router")))
    return endpoint


def observe(endpoint: str, twin: str, seconds: float) -> Sizes:
    """Rates and sizes of all messages that a twin sends within ``seconds``."""
    noted: collections.defaultdict[str, list[int]] = collections.defaultdict(list)

    def note(sample: zenoh.Sample) -> None:
        noted[str(sample.key_expr).rsplit("/", 1)[-1]].append(len(sample.payload.to_bytes()) + len(_attached(sample)))

    with open_client(endpoint) as session:
        handler = zenoh.handlers.Callback(note, indirect=False)
        subscriber = session.declare_subscriber(f"{Keys(twin).tick.rsplit('/', 1)[0]}/*", handler)
        time.sleep(1.0)  # until all links know of the subscriber
        noted.clear()
        time.sleep(seconds)
        found = {key: {"rate": len(sizes) / seconds, "sizes": sizes[:500]} for key, sizes in list(noted.items())}
        subscriber.undeclare()
    return found


class Twins:
    """Simulated twins: each is a session that sends messages at the rates and sizes of a real one."""

    def __init__(self) -> None:
        self._due: list[tuple[float, int]] = []
        self._streams: list[tuple[Any, list[bytes], float, list[int]]] = []
        self._late: list[float] = []
        self._sent = [0, 0]  # messages, bytes

    def begin(self, endpoint: str, names: list[str], sizes: Sizes) -> None:
        """Connect twins of these names and let them send."""
        draw, now = random.Random(0), time.monotonic() + 0.5
        for name in names:
            session = open_member(endpoint, wait=30.0)
            _keep.extend((session, session.liveliness().declare_token(Keys(name).alive)))
            for key, about in sizes.items():
                drop = zenoh.CongestionControl.DROP
                publisher = session.declare_publisher(f"motm/{name}/{key}", congestion_control=drop)
                period = 1.0 / max(about["rate"], 0.1)
                payloads = [bytes(size) for size in about["sizes"]]
                heapq.heappush(self._due, (now + draw.random() * period, len(self._streams)))
                self._streams.append((publisher, payloads, period, [0]))
        threading.Thread(target=self._run, daemon=True).start()

    def take(self) -> dict[str, Any]:
        """Number of messages and bytes sent since the last call, and their lateness [ms]."""
        (messages, size), self._sent = self._sent, [0, 0]
        late, self._late = self._late, []
        return {"messages": messages, "bytes": size, "late_ms": percentiles([1000.0 * value for value in late])}

    def _run(self) -> None:
        while True:
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
    """Viewers: each is a session that reads everything of one twin, or one key of all twins."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._messages = self._bytes = self._lost = 0
        self._delays: list[float] = []
        self._last: dict[tuple[int, str], int] = {}

    def begin(self, endpoint: str, names: list[str], key: str, timed: str) -> None:
        """Connect one viewer for each of these twins ("*": all), for ``key``; delays are those of the key ``timed``."""
        for number, name in enumerate(names):
            session = open_member(endpoint, wait=30.0)
            handler = zenoh.handlers.Callback(self._noted(number, f"/{timed}"), indirect=False)
            _keep.extend((session, session.declare_subscriber(f"motm/{name}/{key}", handler)))

    def take(self) -> dict[str, Any]:
        """Messages and bytes received since the last call; of timed messages the number lost and the delays [s]."""
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
    """Role of a router, of simulated twins, of viewers, or of the observer of a real twin."""
    twins, viewers = Twins(), Viewers()
    works: Works = {"router": router, "observe": observe, "twins": twins.begin, "sent": twins.take}
    return {}, works | {"viewers": viewers.begin, "received": viewers.take}


def main() -> None:
    """Play the role named on the command line until standard input ends."""
    role, *arguments = sys.argv[1:]
    hello, works = {each.__name__: each for each in (bare, readers, twin, attackers, fleet)}[role](*arguments)
    _say(hello)
    for line in sys.stdin:
        wish = json.loads(line)
        try:
            _say({"ok": works[wish.pop("do")](**wish)})
        except Exception as error:
            _say({"error": f"{type(error).__name__}: {error}"})
    leave(0)


def _say(answer: Any) -> None:
    print(json.dumps(answer), flush=True)


if __name__ == "__main__":
    main()
