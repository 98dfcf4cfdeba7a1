"""Participants that treat a twin badly: malformed messages at a given rate, and clients that come and go."""

import collections
import contextlib
import socket
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import msgspec
import zenoh

from motm_twin.bus.client import TwinClient
from motm_twin.bus.commands import Answer
from motm_twin.bus.connection import LOOPBACK, open_client, open_member
from motm_twin.bus.keys import Keys
from motm_twin.perf.fuzz import Fuzzer, Message
from motm_twin.perf.processes import Works

OPEN = 100  # queries that wait for an answer at most
TIMEOUT = 10.0  # [s] for an answer
FIRST_VALUE = 30.0  # [s] for a new client to know the state
PATTERNS = ("*", "$", "//")

_answer = msgspec.json.Decoder(Answer)


class Attack:
    """Sends malformed messages and counts what becomes of them.

    Answers come by callbacks: threads that wait for them would take half a core, and slow whatever is attacked by that.
    """

    def __init__(self, endpoint: str, twin: str, clock: float) -> None:
        self._port, self._keys = int(endpoint.rsplit(":", 1)[1]), Keys(twin)
        self._sessions = [open_member(endpoint, wait=10.0), open_client(endpoint)]  # seen by others, and not
        self._fuzzer = lambda seed: Fuzzer(twin, seed, lambda: time.monotonic() + clock)
        self._room = threading.BoundedSemaphore(OPEN)
        self._sent: collections.Counter[str] = collections.Counter()
        self.accepted: list[str] = []  # commands that were, to be looked at
        self.unanswered: list[str] = []
        self._failed: Exception | None = None

    def run(self, count: int, rate: float, seed: int) -> dict[str, Any]:
        """Send so many, ``rate`` [1/s] of them; how many of each sort, and what was accepted or not answered."""
        began = time.monotonic()
        for number, message in enumerate(self._fuzzer(seed).messages(count)):
            if (early := began + number / rate - time.monotonic()) > 0.0:
                time.sleep(early)
            self._send(message, self._sessions[number % len(self._sessions)])
            self._sent[message.how] += 1
        for _ in range(OPEN):
            self._room.acquire()  # every answer is there, or will not come
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
        """Leave."""
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
            return  # it can not even be sent
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
    """Malformed messages on every key."""
    attacker = Attack(endpoint, twin, clock)
    try:
        return attacker.run(count, rate, seed)
    finally:
        attacker.close()


def visit(endpoint: str, twin: str, count: int, parallel: int) -> dict[str, int]:
    """So many clients that connect, wait until they know the state, and leave, ``parallel`` at a time."""

    def knew(_: int) -> bool:
        with TwinClient(endpoint, twin) as client:
            return _knows(client)

    with ThreadPoolExecutor(parallel) as pool:
        known = sum(pool.map(knew, range(count)))
    return {"left": count, "knew nothing": count - known}


_staying: list[TwinClient] = []


def stay(endpoint: str, twin: str, count: int) -> int:
    """So many clients that stay, to be killed with this process; how many of them know the state."""
    _staying.extend(TwinClient(endpoint, twin) for _ in range(count))
    return sum(_knows(client) for client in _staying)


def _knows(client: TwinClient) -> bool:
    deadline = time.monotonic() + FIRST_VALUE
    while time.monotonic() < deadline:
        if client.tick() is not None and client.status() is not None and client.scene() is not None:
            return True
        time.sleep(0.01)
    return False


def attackers() -> tuple[dict[str, str], Works]:
    """Role of malformed messages, and of clients that come and go."""
    return {}, {"attack": attack, "visit": visit, "stay": stay}
