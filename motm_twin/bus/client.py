"""Client of a twin: its newest state, never an older one, and commands with answers."""

import itertools
import secrets
import threading
import time
import traceback
from collections import defaultdict
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import msgspec
import numpy as np
import zenoh
from numpy.typing import NDArray

from motm_twin.bus import messages
from motm_twin.bus.commands import Answer, Command, Envelope, command_name
from motm_twin.bus.connection import Keys, answers, direct, open_client, spoken_on
from motm_twin.model.scene import Scene

STANDS = ("paused", "done")  # states in which no further tick comes
ON_ITS_WAY = 0.3  # [s] a tick may arrive this much later than the status of the same moment
SAME_TIME = 1e-5  # [s] tolerance between the times of a status, which may be rounded, and its tick
LOST_AFTER = 2.0  # [s] without a status message
GET_TIMEOUT = 1.0  # [s]
NEVER = -1e9  # [s]
SESSION_TIMEOUT = 5.0  # [s]

OnSample = Callable[[bytes], None]  # a message as JSON
OnGrid = Callable[[bytes, bytes], None]  # cells, and their GridInfo as JSON


class NoSession(Exception):
    """The server gave no session; the message says why."""


class OtherVersion(ValueError):
    """A message in a version that this program does not read."""


@dataclass(frozen=True)
class Grid:
    """A received grid; ``cells`` has shape (height, width), row 0 at y_min."""

    info: messages.GridInfo
    cells: NDArray[np.uint8]


@dataclass
class _Slot:
    """The newest payload of one key; older ones are overwritten."""

    payload: bytes | None = None
    attachment: bytes | None = None
    count: int = 0
    at: float = NEVER  # [s] monotonic


class _When(msgspec.Struct):
    """Run and time that a status or a tick reports."""

    run: int
    time: float  # [s]
    state: str = ""  # of the server; a tick has none


class TwinClient:
    """Reads and commands one twin. It keeps the newest state: a slow reader skips some and never gets an old pose."""

    def __init__(self, endpoint: str, twin: str = "frankie", sender: str | None = None) -> None:
        self.keys, self.endpoint = Keys(twin), endpoint
        self.sender = sender or f"client-{secrets.token_hex(6)}"
        # Sequence numbers start at the time, so that they keep rising when a program restarts under the same name.
        self._sequences: dict[str, itertools.count[int]] = defaultdict(lambda: itertools.count(time.time_ns() // 1000))
        self._sending = threading.Lock()  # numbers must arrive in order
        self._listeners: dict[str, list[OnGrid]] = defaultdict(list)  # by key
        self._fetches: list[threading.Thread] = []
        self._fetched: _When | None = None  # status for which a lost tick was fetched; once is enough
        self.closed = False
        self._session = open_client(endpoint)
        self._encode = msgspec.json.Encoder().encode
        self._changed = threading.Condition()
        self._slots = {key: _Slot() for key in (self.keys.tick, self.keys.grid, self.keys.scene, self.keys.status)}
        self._decoded: dict[str, tuple[int, Any]] = {}
        self.malformed = 0  # samples that were not valid messages and were dropped
        self._clock_offset: float | None = None
        self._declared = [self._session.declare_subscriber(key, direct(self._on_sample)) for key in self._slots]
        self._liveliness = self._session.liveliness().declare_subscriber(
            self.keys.alive, direct(self._on_alive), history=True
        )

    @property
    def alive(self) -> bool:
        """True when a status came in the last `LOST_AFTER`, and the liveliness token has not gone since."""
        return time.monotonic() - self._slots[self.keys.status].at < LOST_AFTER

    def tick(self) -> messages.TickMessage | None:
        """The newest tick; None before the first."""
        return self._newest(self.keys.tick, decode_tick)

    def status(self) -> messages.StatusMessage | None:
        """The newest status; None before the first."""
        return self._newest(self.keys.status, self._decode_status)

    def scene(self) -> Scene | None:
        """The resolved scene that runs; None before the first."""
        return self._loaded()[0]

    def of_scene(self, tick: messages.TickMessage) -> bool:
        """False for a tick from before `scene` was loaded, such as the newest tick while a scene loads."""
        return tick.run >= self._loaded()[1]

    def grid(self) -> Grid | None:
        """The newest grid; None before the first."""
        return self._newest(self.keys.grid, _decode_grid)

    def robot(self) -> messages.RobotStateMessage | None:
        """The newest state of the robot; None before the first. It is received from the first call on."""
        return self._followed(self.keys.robot, decode_robot)

    def scan(self) -> messages.ScanMessage | None:
        """The newest sweep of the lidar, as `robot`."""
        return self._followed(self.keys.scan, decode_scan)

    def metrics(self) -> messages.MetricsMessage | None:
        """The newest metrics, as `robot`."""
        return self._followed(self.keys.metrics, _decode_metrics)

    def events(self, since: int, timeout: float = SESSION_TIMEOUT) -> messages.EventsMessage | None:
        """Events from number ``since`` on, as far as the server keeps them; None when the server does not answer."""
        replies = self._session.get(f"{self.keys.event}?from={since}", timeout=timeout)
        for answer in answers(replies, self.keys.event):
            return _decode_events(answer.payload.to_bytes())
        return None

    def wait_tick(self, after: int, timeout: float) -> int:
        """Wait until more than ``after`` ticks have arrived or ``timeout`` [s] has passed; return their number."""
        return self.wait(self.keys.tick, after, timeout)

    def wait(self, key: str, after: int, timeout: float) -> int:
        """As `wait_tick`, for any followed key; returns at once when the client is closed."""
        slot = self._slots[key]
        with self._changed:
            self._changed.wait_for(lambda: slot.count > after or self.closed, timeout)
        return slot.count

    def follow(self, key: str) -> None:
        """Receive this key from now on, its last value first."""
        with self._changed:
            if key in self._slots or self.closed:
                return
            slot = self._slots[key] = _Slot()
        self._declared.append(self._session.declare_subscriber(key, direct(self._on_sample)))
        self._fetch(key, slot.count)

    def raw(self, key: str) -> tuple[bytes, bytes | None]:
        """The newest payload and attachment of a key that is followed; empty before the first."""
        slot = self._slots[key]
        with self._changed:
            return slot.payload or b"", slot.attachment

    def on_sample(self, key: str, callback: OnSample) -> Callable[[], None]:
        """Call ``callback`` with every payload of a key that is followed, as `on_tick` does."""
        return self._listen(key, lambda payload, _: callback(payload))

    def on_tick(self, callback: OnSample) -> Callable[[], None]:
        """Call ``callback`` with the payload of every tick, in order; the returned function ends this.

        It is called in Zenoh's thread, which reads nothing else meanwhile: it must be quick (put the payload into a
        queue). A tick may repeat after a reconnection; previews repeat the index of the previous tick; an index
        that falls within one run comes from a restarted server.
        """
        return self.on_sample(self.keys.tick, callback)

    def on_grid(self, callback: OnGrid) -> Callable[[], None]:
        """Call ``callback`` with the payload and attachment of every grid that is sent, as `on_tick` does."""
        return self._listen(self.keys.grid, callback)

    def session(self, timeout: float = SESSION_TIMEOUT) -> bytes:
        """The run so far, a `sessions.session.Session` as JSON. Raises NoSession."""
        for reply in self._session.get(self.keys.session, timeout=timeout):
            if reply.err is not None:
                raise NoSession(reply.err.payload.to_string())
            if reply.ok is not None and spoken_on(reply.ok, self.keys.session):
                return reply.ok.payload.to_bytes()
        raise NoSession("the twin server does not answer")

    def command(self, command: Command, timeout: float = 2.0, *, sender: str | None = None, name: str = "") -> Answer:
        """Send a command and wait for its answer; a silent server is an answer too (not ok).

        One client may send for several persons: ``sender`` and the displayed ``name`` identify the person.
        """
        if self._clock_offset is None:
            self._fetch(self.keys.status, None, timeout)
            self.status()
        if self._clock_offset is None:
            return Answer(ok=False, reason="the twin server does not answer")
        with self._sending:
            envelope = Envelope(
                sender=sender or self.sender,
                name=name,
                seq=next(self._sequences[sender or self.sender]),
                expires=time.monotonic() + self._clock_offset + timeout,
                command=command,
            )
            key = self.keys.command(command_name(command))
            replies = self._session.get(key, payload=self._encode(envelope), timeout=timeout)
        for answer in answers(replies, key):
            return msgspec.json.decode(answer.payload.to_bytes(), type=Answer)
        return Answer(ok=False, reason="the twin server does not answer, or you have no right to command it")

    def query(self, name: str, payload: bytes, timeout: float = 2.0) -> list[bytes]:
        """Send raw bytes to the command key of this name; the payloads of all answers."""
        key = self.keys.command(name)
        replies = self._session.get(key, payload=payload, timeout=timeout)
        return [answer.payload.to_bytes() for answer in answers(replies, key)]

    def close(self) -> None:
        """Disconnect; closing twice is fine."""
        if self.closed:
            return
        with self._changed:
            self.closed = True
            self._changed.notify_all()
        self._liveliness.undeclare()
        for subscriber in self._declared:
            subscriber.undeclare()
        for thread in self._fetches:
            thread.join(GET_TIMEOUT)
        self._session.close()

    def __enter__(self) -> "TwinClient":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _listen(self, key: str, listener: OnGrid) -> Callable[[], None]:
        with self._changed:
            self._listeners[key].append(listener)

        def leave() -> None:
            with self._changed:
                self._listeners[key].remove(listener)

        return leave

    def _on_sample(self, sample: zenoh.Sample, unless_after: int | None = None) -> None:
        """Keep a sample, unless more than ``unless_after`` samples of its key have arrived before it."""
        key, attachment = str(sample.key_expr), sample.attachment
        if key not in self._slots:  # sent to a wildcard: not by the twin
            return
        payload, attached = sample.payload.to_bytes(), None if attachment is None else attachment.to_bytes()
        with self._changed:
            slot = self._slots[key]
            if unless_after is not None and slot.count > unless_after:
                return
            slot.payload, slot.attachment, slot.at = payload, attached, time.monotonic()
            slot.count += 1
            self._changed.notify_all()
            for listener in list(self._listeners.get(key, ())):
                try:
                    listener(payload, attached or b"null")
                except Exception:
                    traceback.print_exc()  # one callback fails: the others and this client go on
        if key == self.keys.status:
            self._catch_up(payload)

    def _catch_up(self, status: bytes) -> None:
        """Fetch the last tick of a paused or ended twin if it was lost: Zenoh drops messages when a queue is full."""
        tick = self._slots[self.keys.tick]
        with suppress(msgspec.DecodeError):
            now = msgspec.json.decode(status, type=_When)
            if now.state not in STANDS or now == self._fetched or not tick.payload:
                return
            newest, count = msgspec.json.decode(tick.payload, type=_When), tick.count
            if newest.run != now.run or abs(newest.time - now.time) > SAME_TIME:
                self._start(lambda: self._fetch_tick(now, count), "lost tick")

    def _fetch_tick(self, now: _When, after: int) -> None:
        """Fetch the newest tick unless another one arrives after the first ``after``: it may be on its way."""
        if self.wait_tick(after, ON_ITS_WAY) == after and not self.closed:
            self._fetch(self.keys.tick, after)
            self._fetched = now

    def _on_alive(self, sample: zenoh.Sample) -> None:
        if sample.kind == zenoh.SampleKind.DELETE:
            with self._changed:
                self._slots[self.keys.status].at = NEVER  # until the next status
            return
        self._start(self._fetch_all, "late joiner")

    def _start(self, fetch: Callable[[], None], name: str) -> None:
        """Fetch in a thread of its own: Zenoh's must not wait."""
        thread = threading.Thread(target=fetch, name=name, daemon=True)
        with self._changed:
            if not self.closed:
                thread.start()  # before `close` may join it
                self._fetches = [old for old in self._fetches if old.is_alive()] + [thread]

    def _fetch_all(self) -> None:
        """Fetch the last value of every followed key, for late joiners.

        A value that arrives in the meantime is not overwritten; only the scene is taken in any case.
        """
        for key, slot in list(self._slots.items()):
            if self.closed:
                return
            self._fetch(key, None if key == self.keys.scene else slot.count)

    def _fetch(self, key: str, unless_after: int | None, timeout: float = GET_TIMEOUT) -> None:
        for reply in self._session.get(key, timeout=timeout):
            if reply.ok is not None:
                self._on_sample(reply.ok, unless_after)

    def _loaded(self) -> tuple[Scene | None, int]:
        return self._newest(self.keys.scene, _decode_scene) or (None, -1)

    def _followed(self, key: str, decode: Any) -> Any:
        if key not in self._slots:
            self.follow(key)
        return self._newest(key, decode)

    def _newest(self, key: str, decode: Any) -> Any:
        slot = self._slots[key]
        count, value = self._decoded.get(key, (0, None))
        with self._changed:
            newest, payload, attachment, at = slot.count, slot.payload, slot.attachment, slot.at
        if newest == count:
            return value
        try:
            value = decode(payload, attachment, at)
        except OtherVersion:
            raise
        except (msgspec.DecodeError, ValueError):  # not sent by the twin: its last value stays valid
            self.malformed += 1
        self._decoded[key] = (newest, value)
        return value

    def _decode_status(self, payload: bytes, _attachment: bytes | None, at: float) -> messages.StatusMessage:
        status = _decode_any_status(payload)
        self._clock_offset = status.server_time - at
        return status


def _decoder(kind: Any, known: str) -> Callable[..., Any]:
    """Function that decodes a message of a known version; raises OtherVersion."""
    decode = msgspec.json.Decoder(kind).decode

    def decoded(payload: bytes, _attachment: bytes | None = None, _at: float = 0.0) -> Any:
        message = decode(payload)
        if message.version != known:
            sent = f"the server sends {message.version!r}, this client reads {known!r}"
            raise OtherVersion(f"{sent}: update the older of the two")
        return message

    return decoded


decode_tick = _decoder(messages.TickMessage, messages.TICK_VERSION)
_decode_any_status = _decoder(messages.StatusMessage, messages.STATUS_VERSION)
decode_robot = _decoder(messages.RobotStateMessage, messages.ROBOT_VERSION)
decode_scan = _decoder(messages.ScanMessage, messages.SCAN_VERSION)
_decode_metrics = _decoder(messages.MetricsMessage, messages.METRICS_VERSION)
decode_grid_info = _decoder(messages.GridInfo, messages.GRID_VERSION)
_decode_events = _decoder(messages.EventsMessage, messages.EVENTS_VERSION)


def _decode_scene(payload: bytes, attachment: bytes | None, _at: float) -> tuple[Scene, int]:
    """The scene and its first run, or -1 without attachment, as in a recording."""
    info = None if attachment is None else msgspec.json.decode(attachment, type=messages.SceneInfo)
    return msgspec.json.decode(payload, type=Scene), -1 if info is None else info.run


def _decode_grid(payload: bytes, attachment: bytes | None, _at: float) -> Grid:
    info = decode_grid_info(attachment or b"null")
    cells = np.frombuffer(payload, dtype=np.uint8).reshape(info.height, info.width)
    return Grid(info=info, cells=cells)
