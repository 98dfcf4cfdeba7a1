"""The gate that every command passes before it can have an effect: size, form, freshness, order."""

import math
from collections.abc import Callable

import msgspec

from motm_twin.bus.commands import (
    COMMAND_NAMES,
    MAX_COMMAND_BYTES,
    SPEED_MAX,
    SPEED_MIN,
    AddObstacle,
    Command,
    Envelope,
    Load,
    MoveBody,
    Speed,
    Step,
    command_name,
)

MAX_SENDERS = 1000
MAX_LIFETIME = 60.0  # [s] an expiry further away does not bound a replay
MAX_STEPS = 1000
MAX_COORDINATE = 1000.0  # [m]
SIZE_RANGE = (0.02, 5.0)  # [m]
SHAPES = ("box", "cylinder", "temi")
MAX_NAME = 64


class Refused(Exception):
    """A command that must have no effect; the message says why."""


class CommandGate:
    """Checks envelopes; remembers the last sequence number of each sender. ``now`` is the server's clock [s]."""

    def __init__(self, now: Callable[[], float]) -> None:
        self._now = now
        self._decoder = msgspec.json.Decoder(Envelope, strict=True)
        self._last: dict[str, tuple[int, float]] = {}

    def admit(self, name: str, payload: bytes) -> Envelope:
        """The envelope of a command sent to ``cmd/<name>``. Raises Refused."""
        if name not in COMMAND_NAMES:
            raise Refused(f"unknown command {name[:MAX_NAME]!r}; there are: {', '.join(COMMAND_NAMES)}")
        if len(payload) > MAX_COMMAND_BYTES:
            raise Refused(f"oversized: {len(payload)} bytes, at most {MAX_COMMAND_BYTES}")
        try:
            envelope = self._decoder.decode(payload)
        except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
            raise Refused(f"malformed: {error}") from error
        if command_name(envelope.command) != name:
            raise Refused(f"malformed: a {command_name(envelope.command)!r} command was sent to the key of {name!r}")
        _check_command(envelope.command)
        self._check_order(envelope)
        return envelope

    def _check_order(self, envelope: Envelope) -> None:
        now = self._now()
        if not 1 <= len(envelope.sender) <= MAX_NAME:
            raise Refused(f"malformed: the sender needs 1 to {MAX_NAME} characters")
        if envelope.expires <= now:
            raise Refused(f"stale: expired {now - envelope.expires:.3f} s ago")
        if envelope.expires > now + MAX_LIFETIME:
            raise Refused(f"expires in {envelope.expires - now:.0f} s; at most {MAX_LIFETIME:.0f} s ahead is taken")
        last = self._last.get(envelope.sender)
        if last is not None and envelope.seq <= last[0]:
            raise Refused(f"replayed: seq {envelope.seq} of {envelope.sender!r}, {last[0]} was seen already")
        if last is None and len(self._last) >= MAX_SENDERS:
            self._last = {sender: seen for sender, seen in self._last.items() if seen[1] > now}
            if len(self._last) >= MAX_SENDERS:
                raise Refused(f"more than {MAX_SENDERS} senders within {MAX_LIFETIME:.0f} s")
        self._last[envelope.sender] = (envelope.seq, now + MAX_LIFETIME)


def _check_command(command: Command) -> None:
    """Ranges that types can not express."""
    match command:
        case Speed(factor=factor) if not SPEED_MIN <= factor <= SPEED_MAX:
            raise Refused(f"speed {factor:g}: allowed is {SPEED_MIN:g} to {SPEED_MAX:g}")
        case Step(count=count) if not 1 <= count <= MAX_STEPS:
            raise Refused(f"{count} steps: allowed is 1 to {MAX_STEPS}")
        case Load(seed=seed) if seed is not None and not 0 <= seed < 2**31:
            raise Refused(f"seed {seed}: allowed is 0 to {2**31 - 1}")
        case AddObstacle():
            _check_obstacle(command)
        case MoveBody(x=x, y=y, heading=heading):
            _check_place(x, y, heading or 0.0)


def _check_obstacle(command: AddObstacle) -> None:
    _check_place(command.x, command.y, command.heading)
    if not 1 <= len(command.name) <= MAX_NAME or not command.name.isprintable():
        raise Refused(f"name: needs 1 to {MAX_NAME} printable characters")
    if command.shape not in SHAPES:
        raise Refused(f"shape {command.shape[:MAX_NAME]!r}: there are {', '.join(SHAPES)}")
    if not all(SIZE_RANGE[0] <= extent <= SIZE_RANGE[1] for extent in command.size):
        raise Refused(f"size {command.size}: each must be {SIZE_RANGE[0]} to {SIZE_RANGE[1]} m")


def _check_place(x: float, y: float, heading: float) -> None:
    if not all(math.isfinite(value) and abs(value) <= MAX_COORDINATE for value in (x, y, heading)):
        raise Refused(f"place ({x:g}, {y:g}, {heading:g}): not within {MAX_COORDINATE:.0f} m")
