"""The client side of a twin: the latest state, never an old one, and commands with answers."""

import itertools
import secrets
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import msgspec
import numpy as np
import zenoh
from numpy.typing import NDArray

from motm_twin.bus.commands import Answer, Command, Envelope, command_name
from motm_twin.bus.keys import Keys
from motm_twin.bus.messages import GRID_VERSION, STATUS_VERSION, TICK_VERSION, GridInfo, StatusMessage, TickMessage
from motm_twin.bus.session import open_client
from motm_twin.model.scene import Scene

LOST_AFTER = 2.0  # [s] without a status message
GET_TIMEOUT = 1.0  # [s]


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
        self.at = -1e9  # [s] monotonic

    def put(self, sample: zenoh.Sample) -> None:
        attachment = sample.attachment
        self.attachment = None if attachment is None else attachment.to_bytes()
        self.payload = sample.payload.to_bytes()
        self.at = time.monotonic()
        self.count += 1


class TwinClient:
    """Reads and commands one twin. State is latest-value: a slow reader skips, and is never served an old pose."""

    def __init__(self, endpoint: str, twin: str = "frankie", sender: str | None = None) -> None:
        self.keys, self.endpoint = Keys(twin), endpoint
        self.sender = sender or f"client-{secrets.token_hex(6)}"
        self._sequence = itertools.count(1)
        self._fetches: list[threading.Thread] = []
        self._closed = False
        self._session = open_client(endpoint)
        self._encode = msgspec.json.Encoder().encode
        self._tick_decoder = msgspec.json.Decoder(TickMessage)
        self._status_decoder = msgspec.json.Decoder(StatusMessage)
        self._changed = threading.Condition()
        self._slots = {key: _Slot() for key in (self.keys.tick, self.keys.grid, self.keys.scene, self.keys.status)}
        self._decoded: dict[str, tuple[int, Any]] = {}
        self._clock_offset: float | None = None
        self._declared = [self._session.declare_subscriber(key, _direct(self._on_sample)) for key in self._slots]
        self._liveliness = self._session.liveliness().declare_subscriber(
            self.keys.alive, _direct(self._on_alive), history=True
        )

    @property
    def alive(self) -> bool:
        """Whether the server showed a sign of life lately."""
        return time.monotonic() - self._slots[self.keys.status].at < LOST_AFTER

    def tick(self) -> TickMessage | None:
        """The newest tick; None before the first."""
        return self._newest(self.keys.tick, self._decode_tick)

    def status(self) -> StatusMessage | None:
        """The newest status; None before the first."""
        return self._newest(self.keys.status, self._decode_status)

    def scene(self) -> Scene | None:
        """The resolved scene that runs; None before the first."""
        return self._newest(self.keys.scene, _decode_scene)

    def grid(self) -> Grid | None:
        """The newest grid; None before the first."""
        return self._newest(self.keys.grid, _decode_grid)

    def wait_tick(self, after: int, timeout: float) -> int:
        """Wait until more than ``after`` ticks have arrived or ``timeout`` [s] has passed; how many have arrived."""
        slot = self._slots[self.keys.tick]
        with self._changed:
            self._changed.wait_for(lambda: slot.count > after, timeout)
        return slot.count

    def command(
        self, command: Command, timeout: float = 2.0, *, sender: str | None = None, name: str = ""
    ) -> Answer:
        """Send a command and wait for its answer; a silent server is an answer too (not ok).

        One client may speak for several persons: ``sender`` and the shown ``name`` say for whom.
        """
        kind = command_name(command)
        if self._clock_offset is None and not self._fetch_status(timeout):
            return Answer(ok=False, reason="the twin server does not answer")
        assert self._clock_offset is not None
        envelope = Envelope(
            sender=sender or self.sender,
            name=name,
            seq=next(self._sequence),
            expires=time.monotonic() + self._clock_offset + timeout,
            command=command,
        )
        for payload in self.query(kind, self._encode(envelope), timeout):
            return msgspec.json.decode(payload, type=Answer)
        return Answer(ok=False, reason="the twin server does not answer")

    def query(self, name: str, payload: bytes, timeout: float = 2.0) -> list[bytes]:
        """Send raw bytes to the command key of this name; the payloads of all answers."""
        replies = self._session.get(self.keys.command(name), payload=payload, timeout=timeout)
        return [reply.ok.payload.to_bytes() for reply in replies if reply.ok is not None]

    def close(self) -> None:
        """Leave; closing twice is fine."""
        if self._closed:
            return
        self._closed = True
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

    def _on_sample(self, sample: zenoh.Sample) -> None:
        with self._changed:
            self._slots[str(sample.key_expr)].put(sample)
            self._changed.notify_all()

    def _on_alive(self, sample: zenoh.Sample) -> None:
        if sample.kind == zenoh.SampleKind.PUT and not self._closed:
            thread = threading.Thread(target=self._fetch_all, name="late joiner", daemon=True)
            self._fetches = [old for old in self._fetches if old.is_alive()] + [thread]
            thread.start()

    def _fetch_all(self) -> None:
        """A late joiner asks for the last value of everything that it has not received by itself."""
        for key, slot in self._slots.items():
            if self._closed:
                return
            count = slot.count
            for reply in self._session.get(key, timeout=GET_TIMEOUT):
                if reply.ok is not None and (slot.count == count or key == self.keys.scene):
                    self._on_sample(reply.ok)

    def _fetch_status(self, timeout: float) -> bool:
        for reply in self._session.get(self.keys.status, timeout=timeout):
            if reply.ok is not None:
                self._on_sample(reply.ok)
        self.status()
        return self._clock_offset is not None

    def _newest(self, key: str, decode: Any) -> Any:
        slot = self._slots[key]
        count, value = self._decoded.get(key, (0, None))
        with self._changed:
            newest, payload, attachment, at = slot.count, slot.payload, slot.attachment, slot.at
        if newest == count:
            return value
        value = decode(payload, attachment, at)
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


def _direct(callback: Callable[[zenoh.Sample], None]) -> zenoh.handlers.Callback:
    """Called in Zenoh's own thread: with a thread in Python, a program that forgets to close would never end."""
    return zenoh.handlers.Callback(callback, indirect=False)


def _decode_scene(payload: bytes, _attachment: bytes | None, _at: float) -> Scene:
    return msgspec.json.decode(payload, type=Scene)


def _decode_grid(payload: bytes, attachment: bytes | None, _at: float) -> Grid:
    info = msgspec.json.decode(attachment or b"null", type=GridInfo)
    _require(info.version, GRID_VERSION)
    cells = np.frombuffer(payload, dtype=np.uint8).reshape(info.height, info.width)
    return Grid(info=info, cells=cells)


def _require(version: str, known: str) -> None:
    if version != known:
        raise ValueError(f"the server sends {version!r}, this client reads {known!r}: update the older of the two")
