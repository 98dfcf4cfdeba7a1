"""Client of a twin: its latest state, never an old one, and commands with answers."""

import itertools
import secrets
import threading
import time
import traceback
from collections import defaultdict
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import msgspec
import numpy as np
import zenoh
from numpy.typing import NDArray

from motm_twin.bus.commands import Answer, Command, Envelope, command_name
from motm_twin.bus.connection import answers, direct, open_client
from motm_twin.bus.keys import Keys, spoken_on
from motm_twin.bus.messages import (
    EVENTS_VERSION,
    GRID_VERSION,
    METRICS_VERSION,
    ROBOT_VERSION,
    SCAN_VERSION,
    STATUS_VERSION,
    TICK_VERSION,
    EventsMessage,
    GridInfo,
    MetricsMessage,
    RobotStateMessage,
    ScanMessage,
    SceneInfo,
    StatusMessage,
    TickMessage,
)
from motm_twin.model.scene import Scene

LOST_AFTER = 2.0  # [s] without a status message
GET_TIMEOUT = 1.0  # [s]
NEVER = -1e9  # [s]
SESSION_TIMEOUT = 5.0  # [s]

OnTick = Callable[[bytes], None]  # a TickMessage as JSON
OnGrid = Callable[[bytes, bytes], None]  # cells, and their GridInfo as JSON
OnSample = Callable[[bytes], None]


class NoSession(Exception):
    """The server gave no session; the message says why."""


class OtherVersion(ValueError):
    """A message in a version that this program does not read."""


@dataclass(frozen=True)
class Grid:
    """A received grid; ``cells`` has shape (height, width), row 0 at y_min."""

    info: GridInfo
    cells: NDArray[np.uint8]


class _Slot:
    """The newest payload of one key; older ones are overwritten."""

    def __init__(self) -> None:
        self.payload: bytes | None = None
        self.attachment: bytes | None = None
        self.count = 0
        self.at = NEVER  # [s] monotonic

    def put(self, payload: bytes, attachment: bytes | None) -> None:
        self.payload, self.attachment = payload, attachment
        self.at = time.monotonic()
        self.count += 1


class TwinClient:
    """Reads and commands one twin. State is latest-value: a slow reader skips, and is never served an old pose."""

    def __init__(self, endpoint: str, twin: str = "frankie", sender: str | None = None) -> None:
        self.keys, self.endpoint = Keys(twin), endpoint
        self.sender = sender or f"client-{secrets.token_hex(6)}"
        # Sequence numbers start at the time, so that they keep rising when a program restarts under the same name.
        self._sequences: dict[str, itertools.count[int]] = defaultdict(lambda: itertools.count(time.time_ns() // 1000))
        self._sending = threading.Lock()  # numbers must arrive in order
        self._on_tick: list[OnTick] = []
        self._on_grid: list[OnGrid] = []
        self._on_key: dict[str, list[OnSample]] = defaultdict(list)
        self._fetches: list[threading.Thread] = []
        self._closed = False
        self._session = open_client(endpoint)
        self._encode = msgspec.json.Encoder().encode
        self._tick_decoder = msgspec.json.Decoder(TickMessage)
        self._status_decoder = msgspec.json.Decoder(StatusMessage)
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
    def closed(self) -> bool:
        """True when `close` was called."""
        return self._closed

    @property
    def alive(self) -> bool:
        """True when the server showed a sign of life lately."""
        return time.monotonic() - self._slots[self.keys.status].at < LOST_AFTER

    def tick(self) -> TickMessage | None:
        """The newest tick; None before the first."""
        return self._newest(self.keys.tick, self._decode_tick)

    def status(self) -> StatusMessage | None:
        """The newest status; None before the first."""
        return self._newest(self.keys.status, self._decode_status)

    def scene(self) -> Scene | None:
        """The resolved scene that runs; None before the first."""
        return self._loaded()[0]

    def of_scene(self, tick: TickMessage) -> bool:
        """True unless a tick is of a run before `scene` was loaded, as the newest is while that loads."""
        return tick.run >= self._loaded()[1]

    def grid(self) -> Grid | None:
        """The newest grid; None before the first."""
        return self._newest(self.keys.grid, _decode_grid)

    def robot(self) -> RobotStateMessage | None:
        """The newest state of the robot; None before the first. It is received from the first call on."""
        return self._followed(self.keys.robot, RobotStateMessage, ROBOT_VERSION)

    def scan(self) -> ScanMessage | None:
        """The newest sweep of the lidar, as `robot`."""
        return self._followed(self.keys.scan, ScanMessage, SCAN_VERSION)

    def metrics(self) -> MetricsMessage | None:
        """The newest metrics, as `robot`."""
        return self._followed(self.keys.metrics, MetricsMessage, METRICS_VERSION)

    def events(self, since: int, timeout: float = SESSION_TIMEOUT) -> EventsMessage | None:
        """Events from number ``since`` on, as far as the server keeps them; None when it does not answer."""
        replies = self._session.get(f"{self.keys.event}?from={since}", timeout=timeout)
        for answer in answers(replies, self.keys.event):
            events = msgspec.json.decode(answer.payload.to_bytes(), type=EventsMessage)
            _require(events.version, EVENTS_VERSION)
            return events
        return None

    def wait_tick(self, after: int, timeout: float) -> int:
        """Wait until more than ``after`` ticks have arrived or ``timeout`` [s] has passed; how many have arrived."""
        return self.wait(self.keys.tick, after, timeout)

    def wait(self, key: str, after: int, timeout: float) -> int:
        """As `wait_tick`, for any followed key; returns at once when the client is closed."""
        slot = self._slots[key]
        with self._changed:
            self._changed.wait_for(lambda: slot.count > after or self._closed, timeout)
        return slot.count

    def follow(self, key: str) -> None:
        """Receive this key from now on, its last value first."""
        with self._changed:
            if key in self._slots or self._closed:
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
        return self._listen(self._on_key[key], callback)

    def on_tick(self, callback: OnTick) -> Callable[[], None]:
        """Call ``callback`` with the payload of every tick, in order; the returned function ends this.

        It is called in Zenoh's thread, which reads nothing else meanwhile: it must be quick (put the payload into a
        queue). A tick may repeat after a reconnection; previews repeat the index of the previous tick; an index
        that falls within one run comes from a restarted server.
        """
        return self._listen(self._on_tick, callback)

    def on_grid(self, callback: OnGrid) -> Callable[[], None]:
        """Call ``callback`` with the payload and attachment of every grid that is sent, as `on_tick` does."""
        return self._listen(self._on_grid, callback)

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

        One client may speak for several persons: ``sender`` and the shown ``name`` say for whom.
        """
        if self._clock_offset is None and not self._fetch_status(timeout):
            return Answer(ok=False, reason="the twin server does not answer")
        assert self._clock_offset is not None
        with self._sending:
            envelope = Envelope(
                sender=sender or self.sender,
                name=name,
                seq=next(self._sequences[sender or self.sender]),
                expires=time.monotonic() + self._clock_offset + timeout,
                command=command,
            )
            replies = self._get(command_name(command), self._encode(envelope), timeout)
        for answer in answers(replies, self.keys.command(command_name(command))):
            return msgspec.json.decode(answer.payload.to_bytes(), type=Answer)
        return Answer(ok=False, reason="the twin server does not answer, or you have no right to command it")

    def query(self, name: str, payload: bytes, timeout: float = 2.0) -> list[bytes]:
        """Send raw bytes to the command key of this name; the payloads of all answers."""
        replies = self._get(name, payload, timeout)
        return [answer.payload.to_bytes() for answer in answers(replies, self.keys.command(name))]

    def close(self) -> None:
        """Leave; closing twice is fine."""
        if self._closed:
            return
        with self._changed:
            self._closed = True
            self._changed.notify_all()
        self._liveliness.undeclare()
        for subscriber in self._declared:
            subscriber.undeclare()
        for thread in self._fetches:
            thread.join(GET_TIMEOUT)
        self._session.close()

    def __enter__(self) -> "TwinClient":
        """Connected from the start."""
        return self

    def __exit__(self, *_: object) -> None:
        """Leave."""
        self.close()

    def _get(self, name: str, payload: bytes, timeout: float) -> Iterable[zenoh.Reply]:
        return self._session.get(self.keys.command(name), payload=payload, timeout=timeout)

    def _listen(self, listeners: list, callback: Callable[..., None]) -> Callable[[], None]:
        with self._changed:
            listeners.append(callback)

        def leave() -> None:
            with self._changed:
                listeners.remove(callback)

        return leave

    def _on_sample(self, sample: zenoh.Sample, unless_after: int | None = None) -> None:
        """Keep a sample, unless more than ``unless_after`` of its key came before."""
        key, attachment = str(sample.key_expr), sample.attachment
        if key not in self._slots:  # sent to a wildcard: not by the twin
            return
        payload, attached = sample.payload.to_bytes(), None if attachment is None else attachment.to_bytes()
        with self._changed:
            slot = self._slots[key]
            if unless_after is not None and slot.count > unless_after:
                return
            slot.put(payload, attached)
            self._changed.notify_all()
            if key == self.keys.tick:
                _tell(self._on_tick, payload)
            elif key == self.keys.grid:
                _tell(self._on_grid, payload, attached or b"null")
            if key in self._on_key:
                _tell(self._on_key[key], payload)

    def _on_alive(self, sample: zenoh.Sample) -> None:
        if sample.kind == zenoh.SampleKind.DELETE:
            with self._changed:
                self._slots[self.keys.status].at = NEVER  # until the next one
            return
        thread = threading.Thread(target=self._fetch_all, name="late joiner", daemon=True)
        with self._changed:
            if not self._closed:
                thread.start()  # before `close` may join it
                self._fetches = [old for old in self._fetches if old.is_alive()] + [thread]

    def _fetch_all(self) -> None:
        """Fetch the last value of every key that has not been received yet: for late joiners."""
        for key, slot in list(self._slots.items()):
            if self._closed:
                return
            self._fetch(key, None if key == self.keys.scene else slot.count)

    def _fetch(self, key: str, unless_after: int | None) -> None:
        for reply in self._session.get(key, timeout=GET_TIMEOUT):
            if reply.ok is not None:
                self._on_sample(reply.ok, unless_after)

    def _fetch_status(self, timeout: float) -> bool:
        for reply in self._session.get(self.keys.status, timeout=timeout):
            if reply.ok is not None:
                self._on_sample(reply.ok)
        self.status()
        return self._clock_offset is not None

    def _loaded(self) -> tuple[Scene | None, int]:
        return self._newest(self.keys.scene, _decode_scene) or (None, -1)

    def _followed(self, key: str, kind: Any, version: str) -> Any:
        if key not in self._slots:
            self.follow(key)

        def decode(payload: bytes, _attachment: bytes | None, _at: float) -> Any:
            message = msgspec.json.decode(payload, type=kind)
            _require(message.version, version)
            return message

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

    def _decode_tick(self, payload: bytes, _attachment: bytes | None, _at: float) -> TickMessage:
        tick = self._tick_decoder.decode(payload)
        _require(tick.version, TICK_VERSION)
        return tick

    def _decode_status(self, payload: bytes, _attachment: bytes | None, at: float) -> StatusMessage:
        status = self._status_decoder.decode(payload)
        _require(status.version, STATUS_VERSION)
        self._clock_offset = status.server_time - at
        return status


def _tell(listeners: list, *payloads: bytes) -> None:
    for listener in list(listeners):
        try:
            listener(*payloads)
        except Exception:
            traceback.print_exc()  # one callback fails: the others and this client go on


def _decode_scene(payload: bytes, attachment: bytes | None, _at: float) -> tuple[Scene, int]:
    """The scene and its first run, -1 when nobody says it, as in a recording."""
    info = None if attachment is None else msgspec.json.decode(attachment, type=SceneInfo)
    return msgspec.json.decode(payload, type=Scene), -1 if info is None else info.run


def _decode_grid(payload: bytes, attachment: bytes | None, _at: float) -> Grid:
    info = msgspec.json.decode(attachment or b"null", type=GridInfo)
    _require(info.version, GRID_VERSION)
    cells = np.frombuffer(payload, dtype=np.uint8).reshape(info.height, info.width)
    return Grid(info=info, cells=cells)


def _require(version: str, known: str) -> None:
    if version != known:
        raise OtherVersion(f"the server sends {version!r}, this client reads {known!r}: update the older of the two")
