"""The twin's end of the keys of a robot: the newest of everything it says, commands, questions with answers.

Zenoh's threads only decode and store. What can not be read is dropped and counted.
"""

import threading
import time
from collections.abc import Callable
from contextlib import suppress
from typing import Any, TypeVar

import msgspec
import zenoh

from motm_twin.external.keys import PlantKeys
from motm_twin.external.messages import (
    VERSION,
    ClockGrant,
    ClockReached,
    DetectionList,
    Info,
    PlantAnswer,
    RobotCommand,
    RobotState,
    ScanData,
    TruthData,
)

ANSWER = 2.0  # [s] for an answer
RESET_ANSWER = 60.0  # [s] a simulated robot may compile for so long
MAX_BYTES = 1024 * 1024
T = TypeVar("T")
_STAMPED = {
    "state": RobotState,
    "scan": ScanData,
    "detections": DetectionList,
    "truth": TruthData,
    "clock": ClockReached,
}


class RobotLink:
    """One robot on a session. ``listen_only``: nothing is ever sent, not even declared."""

    def __init__(self, session: zenoh.Session, twin: str, *, listen_only: bool = False) -> None:
        self.keys, self.listen_only, self._session = PlantKeys(twin), listen_only, session
        self.changed = threading.Condition()
        self._newest: dict[str, Any] = {}
        self._life, self._past_lives = "", set[str]()
        self.last_sign = -1e9  # [s] monotonic, of the newest state
        self.unreadable = 0
        self.on_state: Callable[[RobotState, float], None] = lambda state, received: None
        self._encode = msgspec.json.Encoder().encode
        self._declared: list[Any] = [
            session.declare_subscriber(getattr(self.keys, name), _direct(self._reader(name, kind)))
            for name, kind in _STAMPED.items()
        ]
        if not listen_only:
            block = zenoh.CongestionControl.BLOCK
            self._commands = session.declare_publisher(
                self.keys.command, congestion_control=zenoh.CongestionControl.DROP, express=True
            )
            self._grants = session.declare_publisher(self.keys.grant, congestion_control=block, express=True)
            self._declared += [self._commands, self._grants]

    def newest(self, name: str) -> Any:
        """The newest message of a key (state, scan, ...) of the robot that lives now; None without one."""
        with self.changed:
            return self._newest.get(name)

    @property
    def life(self) -> str:
        """Of the robot that sends now."""
        return self._life

    def command(self, command: RobotCommand) -> None:
        """Send a command."""
        with suppress(zenoh.ZError):
            self._commands.put(self._encode(command))

    def grant(self, until: float) -> None:
        """Shared clock: let time pass until then [s]."""
        with suppress(zenoh.ZError):
            self._grants.put(self._encode(ClockGrant(version=VERSION, life=self._life, until=until)))

    def info(self) -> Info | None:
        """What the robot says that it is; None without an answer."""
        for payload in self._ask(self.keys.info, b"", ANSWER):
            with suppress(msgspec.DecodeError):
                info = msgspec.json.decode(payload, type=Info)
                if info.version == VERSION:
                    return info
        return None

    def ask(self, key: str, request: msgspec.Struct, timeout: float = ANSWER) -> PlantAnswer:
        """Send a request; no answer is an answer that is not ok."""
        for payload in self._ask(key, self._encode(request), timeout):
            with suppress(msgspec.DecodeError):
                return msgspec.json.decode(payload, type=PlantAnswer)
        return PlantAnswer(version=VERSION, ok=False, reason="the robot does not answer")

    def live(self, life: str) -> None:
        """From now on only what this life of the robot says counts."""
        with self.changed:
            if life != self._life:
                self._begin(life)

    def close(self) -> None:
        """Leave; the session stays open."""
        for declared in self._declared:
            declared.undeclare()
        self._declared = []

    def _ask(self, key: str, payload: bytes, timeout: float) -> list[bytes]:
        try:
            replies = self._session.get(key, payload=payload, timeout=timeout)
            return [reply.ok.payload.to_bytes() for reply in replies if reply.ok is not None]
        except zenoh.ZError:
            return []

    def _begin(self, life: str) -> None:
        if self._life:
            self._past_lives.add(self._life)
        self._life = life
        self._newest = {name: message for name, message in self._newest.items() if message.life == life}

    def _reader(self, name: str, kind: type[T]) -> Callable[[zenoh.Sample], None]:
        decode = msgspec.json.Decoder(kind).decode

        def on_sample(sample: zenoh.Sample) -> None:
            received = time.monotonic()
            try:
                payload = sample.payload.to_bytes()
                message: Any = decode(payload) if len(payload) <= MAX_BYTES else None
            except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
                message = None
            if message is None or message.version != VERSION:
                self.unreadable += 1
                return
            self._keep(name, message, received)

        return on_sample

    def _keep(self, name: str, message: Any, received: float) -> None:
        with self.changed:
            if message.life in self._past_lives:
                return
            if message.life != self._life:
                self._begin(message.life)
            before = self._newest.get(name)
            if name == "state":
                self.last_sign = received
                self.on_state(message, received)
            if before is not None and message.stamp < before.stamp:
                return  # overtaken
            self._newest[name] = message
            self.changed.notify_all()


def _direct(callback: Callable[[zenoh.Sample], None]) -> zenoh.handlers.Callback:
    return zenoh.handlers.Callback(callback, indirect=False)
