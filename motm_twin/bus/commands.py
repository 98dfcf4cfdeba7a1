"""Commands that the twin server takes, their envelope, its answers, the gate that checks them, and who may give them.

A command is a query on ``motm/<twin>/cmd/<type>`` whose payload is an `Envelope` as JSON::

    {"sender": "page-1", "seq": 7, "expires": 1763683200.5, "command": {"type": "speed", "factor": 2.0}}

``expires`` is on the clock of the server (``server_time`` of every status and tick; on one machine with a steady clock
this is Unix time). The answer is an `Answer` as JSON.

One person or program at a time drives, for as long as its lease runs; bodies that it holds are released at the end.
"""

import math
import traceback
from collections.abc import Callable
from contextlib import suppress
from typing import Annotated, Any, Literal

import msgspec

from motm_twin.methods import UNNAMED_METHOD
from motm_twin.model import bounds
from motm_twin.model.bounds import Between, Listed, Text
from motm_twin.model.edits import (  # noqa: F401 - edits are commands, too: they are imported from here
    EDITS,
    INDEX,
    AddObstacle,
    Announce,
    Drive,
    Edit,
    FreezeBody,
    InjectFault,
    InsertTask,
    MoveBody,
    MoveObject,
    MoveTask,
    PushRobot,
    ReleaseBody,
    RemoveBody,
    RemoveTask,
    SendAgent,
    SetBehaviour,
    SetParameter,
)
from motm_twin.model.names import hint

COMMAND_VERSION = "motm.command/1"
ANSWER_VERSION = "motm.answer/1"
MAX_COMMAND_BYTES = 64 * 1024
MAX_NAME = 64  # characters of the name of a scene, body, sender, ...
NAME_MAX = 40  # characters of a person's name
STEPS = Between(1, 1000, called="number of steps")
SPEED = Between(0.125, 8.0, called="speed")
_SEED = Between(0, 2**31 - 1)
_COORDINATE = Between(-1000.0, 1000.0, unit="m")
_Person = Annotated[str, Text(0, NAME_MAX)]
_Method = Annotated[str, Listed("a name of `status.methods`")]


def _file_name(least: int) -> Text:
    """A file name without a folder."""
    words = "letters, digits, '.', '_' or '-', beginning with a letter or digit"
    return Text(least, MAX_NAME, pattern="[A-Za-z0-9][A-Za-z0-9._-]*", words=words, called="file name")


class Play(msgspec.Struct, frozen=True, kw_only=True, tag="play", forbid_unknown_fields=True):
    """Let time run; after the end of a run, start it again."""


class Pause(msgspec.Struct, frozen=True, kw_only=True, tag="pause", forbid_unknown_fields=True):
    """Stop time."""


class Step(msgspec.Struct, frozen=True, kw_only=True, tag="step", forbid_unknown_fields=True):
    """Stop time, then compute ``count`` periods."""

    count: Annotated[int, STEPS] = 1


class Reset(msgspec.Struct, frozen=True, kw_only=True, tag="reset", forbid_unknown_fields=True):
    """Back to the start of the loaded scene."""


class Speed(msgspec.Struct, frozen=True, kw_only=True, tag="speed", forbid_unknown_fields=True):
    """Requested real-time factor, 1/8 to 8."""

    factor: Annotated[float, SPEED]


class Load(msgspec.Struct, frozen=True, kw_only=True, tag="load", forbid_unknown_fields=True):
    """Load a scene, variant, seed or method; None keeps the scene file's own."""

    scene: Annotated[str, Listed("a name of `status.scenes`"), Text(1, MAX_NAME)]
    variant: Annotated[str, Text(0, MAX_NAME)] | None = None
    seed: Annotated[int, _SEED] | None = None
    method: _Method = UNNAMED_METHOD  # decides how the base drives and the arm reaches


class Seed(msgspec.Struct, frozen=True, kw_only=True, tag="seed", forbid_unknown_fields=True):
    """The loaded scene, variant and method again, with another seed."""

    seed: Annotated[int, _SEED]


class DriveToPoint(msgspec.Struct, frozen=True, kw_only=True, tag="drive_to", forbid_unknown_fields=True):
    """Drive the base to a point now, then resume the tasks: inserts a `drive_to` task before the active one."""

    x: Annotated[float, _COORDINATE]  # world
    y: Annotated[float, _COORDINATE]
    heading: Annotated[float, Between(-1000.0, 1000.0, unit="rad")] | None = None  # None: any


class Save(msgspec.Struct, frozen=True, kw_only=True, tag="save", forbid_unknown_fields=True):
    """Write the session so far into the data folder of the server; the answer has the path. Nothing is overwritten."""

    name: Annotated[str, _file_name(1)]  # ".json" is added when it is missing


class Record(msgspec.Struct, frozen=True, kw_only=True, tag="record", forbid_unknown_fields=True):
    """Start or stop an MCAP recording in the data folder of the server; the answer has the path."""

    action: Literal["start", "stop"]
    name: Annotated[str, _file_name(0)] = ""  # start only; "": made from scene and time; ".mcap" is added


class Branch(msgspec.Struct, frozen=True, kw_only=True, tag="branch", forbid_unknown_fields=True):
    """Go back to the start of period ``index`` of this run and continue from there; the rest is set aside."""

    index: Annotated[int, Listed("`status.oldest` to the last period"), INDEX]


class UndoBranch(msgspec.Struct, frozen=True, kw_only=True, tag="undo_branch", forbid_unknown_fields=True):
    """Resume the run that the last branch set aside, at its end; the current run is set aside in its place.

    At most one run is set aside; a load or a reset forgets it.
    """


class Inspect(msgspec.Struct, frozen=True, kw_only=True, tag="inspect", forbid_unknown_fields=True):
    """Add explanations to the ticks, for all readers: the two paths of a candidate, the path of unmodified STAA*."""

    candidate: Annotated[int, Between(-1, 10_000)] = -1  # index into the candidates; -1: none
    staa_path: bool = False


class Audience(msgspec.Struct, frozen=True, kw_only=True, tag="audience", forbid_unknown_fields=True):
    """Tell the twin how many pages show it: a run that waits for the first one starts. Sent by the page's program."""

    pages: Annotated[int, Between(0, 10_000)]


class TakeWheel(msgspec.Struct, frozen=True, kw_only=True, tag="take_wheel", forbid_unknown_fields=True):
    """Become the driver when nobody drives; sent again, it renews the lease."""


class HandOver(msgspec.Struct, frozen=True, kw_only=True, tag="hand_over", forbid_unknown_fields=True):
    """Hand the right to drive to another sender; an empty one leaves it to whoever acts next."""

    to: Annotated[str, Text(0, MAX_NAME, called="receiver")] = ""
    name: _Person = ""  # displayed name of the new driver; "": its last known name


ServerCommand = (
    Play | Pause | Step | Reset | Speed | Load | Seed | DriveToPoint | Save | Record | Branch | UndoBranch
    | Inspect | Audience | TakeWheel | HandOver
)  # fmt: skip
Command = ServerCommand | Edit
SERVER_COMMANDS = ServerCommand.__args__
COMMAND_NAMES = tuple(str(kind.__struct_config__.tag) for kind in (*SERVER_COMMANDS, *EDITS))


class Envelope(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A command with its sender, sequence number and expiry time."""

    sender: str
    seq: int
    expires: float
    command: Command
    name: str = ""  # displayed name of the person


class Answer(msgspec.Struct, frozen=True, kw_only=True):
    """The outcome of a command. A refused one had no effect."""

    version: str = ANSWER_VERSION
    ok: bool  # whether it was done
    reason: str = ""  # why it was refused
    server_time: float = 0.0  # [s] now, on the clock of the server
    index: int = -1  # last period before the command takes effect
    text: str = ""  # details of the effect
    path: str = ""  # of the file on the server, for save and record


class Refused(Exception):
    """A command that must have no effect; the message says why."""


def check_command(command: Command) -> None:
    """Raise Refused, saying what is allowed, unless every number, text and list is within its bounds."""
    if problem := bounds.problem(command):
        raise Refused(problem)


def reason_of(error: Exception) -> str:
    """Reason for the sender; an error other than a refusal is our own fault, and its traceback is printed."""
    if isinstance(error, Refused):
        return str(error)
    traceback.print_exception(error)
    return f"{type(error).__name__}: {error}"


def command_name(command: Command) -> str:
    """The type tag of a command, which is also the last part of its key."""
    return str(command.__struct_config__.tag)


MAX_SENDERS = 1000
MAX_LIFETIME = 60.0  # [s] a later expiry would not bound replay attacks
ORDER = 16  # a number that trails the sender's last one by less than this comes too late, even if it is new
MAX_SEEN = 4096  # numbers of one sender that have not expired


class _Sender:
    """Sequence numbers admitted from one sender. An outlier, perhaps forged, blocks no others."""

    def __init__(self) -> None:
        self.last, self._seen = -1, dict[int, float]()  # expiry [s] of each number
        self.forget_at = 0.0  # [s]

    def admit(self, envelope: Envelope, now: float) -> None:
        """Record the number of a command; raise Refused if it was seen before or overtaken by a later one."""
        seq, name = envelope.seq, envelope.sender
        if seq in self._seen or self.last - ORDER < seq <= self.last:
            raise Refused(f"replayed: seq {seq} of {name!r}, {self.last} was seen already")
        if len(self._seen) >= MAX_SEEN:
            self._seen = {number: until for number, until in self._seen.items() if until > now}
            if len(self._seen) >= MAX_SEEN:
                raise Refused(f"more than {MAX_SEEN} commands of {name!r} within {MAX_LIFETIME:.0f} s")
        self.last, self._seen[seq], self.forget_at = seq, envelope.expires, now + MAX_LIFETIME


class CommandGate:
    """Checks envelopes; remembers the sequence numbers of each sender. ``now`` is the server's clock [s]."""

    def __init__(self, now: Callable[[], float]) -> None:
        self._now = now
        self._decoder = msgspec.json.Decoder(Envelope, strict=True)
        self._senders: dict[str, _Sender] = {}

    def admit(self, name: str, payload: bytes) -> Envelope:
        """The envelope of a command sent to ``cmd/<name>``. Raises Refused."""
        if name not in COMMAND_NAMES:
            raise Refused(f"unknown command {name[:MAX_NAME]!r}; {hint(name, COMMAND_NAMES)}")
        if len(payload) > MAX_COMMAND_BYTES:
            raise Refused(f"oversized: {len(payload)} bytes, at most {MAX_COMMAND_BYTES}")
        try:
            envelope = self._decoder.decode(payload)
        except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
            raise Refused(f"malformed: {error}") from error
        if command_name(envelope.command) != name:
            raise Refused(f"malformed: a {command_name(envelope.command)!r} command was sent to the key of {name!r}")
        check_command(envelope.command)
        self._check_order(envelope)
        return envelope

    def _check_order(self, envelope: Envelope) -> None:
        now = self._now()
        if not 1 <= len(envelope.sender) <= MAX_NAME or not envelope.sender.isprintable():
            raise Refused(f"malformed: the sender needs 1 to {MAX_NAME} printable characters")
        if not 0 <= envelope.seq < 2**63:
            raise Refused("malformed: seq must be 0 to 2^63 - 1")
        if len(envelope.name) > NAME_MAX or not envelope.name.isprintable():
            raise Refused(f"malformed: the name of a person has at most {NAME_MAX} printable characters")
        if envelope.expires <= now:
            raise Refused(f"stale: expired {now - envelope.expires:.3f} s ago")
        if envelope.expires > now + MAX_LIFETIME:
            raise Refused(f"expires in {envelope.expires - now:.0f} s; at most {MAX_LIFETIME:.0f} s ahead is taken")
        sender = self._senders.get(envelope.sender)
        if sender is None:
            if len(self._senders) >= MAX_SENDERS:
                self._senders = {name: known for name, known in self._senders.items() if known.forget_at > now}
                if len(self._senders) >= MAX_SENDERS:
                    raise Refused(f"more than {MAX_SENDERS} senders within {MAX_LIFETIME:.0f} s")
            sender = self._senders[envelope.sender] = _Sender()
        sender.admit(envelope, now)


SILENCE = 10.0  # [s] after the last command of the driver


class Lease:
    """Exclusive right to drive. The first sender to act holds it until it hands over or falls silent."""

    def __init__(self) -> None:
        self.driver, self.name = "", ""
        self._until = 0.0  # [s]

    def left(self, now: float) -> float:
        """Seconds of silence until the lease ends; 0 without a driver."""
        return max(0.0, self._until - now) if self.driver else 0.0

    def require(self, sender: str, now: float) -> None:
        """Raise Refused when another sender drives; call `expire` first. Any command of the driver renews the lease."""
        if self.driver not in ("", sender):
            raise Refused(
                f"{self.name} is driving: it can hand over to you, or you wait for {SILENCE:.0f} s of silence "
                f"({self.left(now):.0f} s left)"
            )
        self.renew(sender, now)

    def renew(self, sender: str, now: float) -> None:
        """Renew the lease if this sender drives."""
        if sender == self.driver:
            self._until = max(self._until, now + SILENCE)

    def give(self, to: str, name: str, now: float) -> None:
        """Make a sender the driver ("": nobody), after `require`: it has acted, or was handed the lease."""
        until = now + SILENCE if to else 0.0
        self._until = max(self._until, until) if to and to == self.driver else until
        self.driver, self.name = to, (name.strip() or to)[:NAME_MAX] if to else ""

    def expire(self, now: float) -> None:
        """End the lease when the driver has been silent for too long."""
        if self.driver and now >= self._until:
            self.give("", "", now)


NAMES_KEPT = 1000  # senders
HELD_FOR = 1.5  # [s] after the last move of a held body


class Wheel:
    """Lets one person at a time change things, under a `Lease`; all times [s] are on one monotonic clock."""

    def __init__(self, release: Callable[[ReleaseBody], None], changed: Callable[[], None]) -> None:
        """``release`` releases a body, ``changed`` announces a new driver."""
        self._release, self._changed = release, changed
        self.lease, self.holds = Lease(), Holds()
        self._names: dict[str, str] = {}  # displayed name by sender, the latest last

    def shown(self, now: float) -> dict[str, Any]:
        """Fields of the status about the driver."""
        lease = self.lease
        return {"driver": lease.driver, "driver_name": lease.name, "driver_left": round(lease.left(now), 2)}

    def require(self, envelope: Envelope, arrived: float) -> None:
        """Raise Refused when a command needs the right to drive and another sender has it."""
        self._remember(envelope)
        if not isinstance(envelope.command, Inspect | Audience):
            self._expire(arrived)
            self.lease.require(envelope.sender, arrived)

    def turn(self, envelope: Envelope, arrived: float) -> None:
        """Update the driver after an accepted command: its sender drives, or has handed over."""
        before = (self.lease.driver, self.lease.name)
        match envelope.command:
            case Inspect() | Audience():
                return
            case HandOver(to=to, name=name):
                self.lease.give(to, name.strip() or self._names.get(to, ""), arrived)
            case _:
                self.lease.give(envelope.sender, envelope.name, arrived)
        self._tell(before)

    def turn_if_free(self, envelope: Envelope, now: float) -> None:
        """Make the sender of a slow command the driver once it is done, unless another drives by now."""
        with suppress(Refused):
            self.require(envelope, now)
            self.turn(envelope, now)

    def look_after(self, now: float) -> None:
        """Release bodies that were not moved for `HELD_FOR`, and end the lease of a silent driver."""
        for release in self.holds.expired(now):
            self._release(release)
        self._expire(now)

    def _remember(self, envelope: Envelope) -> None:
        """Remember the displayed name of a sender, who may be handed the right to drive later."""
        if name := envelope.name.strip():
            self._names.pop(envelope.sender, None)
            self._names[envelope.sender] = name
            if len(self._names) > NAMES_KEPT:
                del self._names[next(iter(self._names))]

    def _expire(self, now: float) -> None:
        before = (self.lease.driver, self.lease.name)
        self.lease.expire(now)
        self._tell(before)

    def _tell(self, before: tuple[str, str]) -> None:
        after = (self.lease.driver, self.lease.name)
        if before == after:
            return
        if before[0] not in ("", after[0]):
            for release in self.holds.expired():
                self._release(release)
        self._changed()


class Holds(dict[str, float]):
    """Bodies that are being dragged, with the time [s] when the grip expires."""

    def note(self, edit: Edit, now: float) -> None:
        """Update the grips after an edit that was accepted at ``now`` [s]."""
        if isinstance(edit, MoveBody) and edit.held:
            self[edit.name] = now + HELD_FOR
        elif isinstance(edit, MoveBody | ReleaseBody | RemoveBody):
            self.pop(edit.name, None)

    def expired(self, now: float = math.inf) -> list[ReleaseBody]:
        """Commands that release the expired grips, by default all; these grips are forgotten."""
        silent = [name for name, until in self.items() if until <= now]
        for name in silent:
            del self[name]
        return [ReleaseBody(name=name) for name in silent]
