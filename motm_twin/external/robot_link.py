"""The twin's end of a robot's keys: its newest messages, commands and requests to it, and estimates of its clock.

Zenoh's threads only read, check and store messages. Unusable ones are dropped and counted; the last reason is kept and
reported by the twin.

As long as a robot is heard, only its own messages count. Messages of another life on its keys (the robot restarted,
another robot of the same name, a forgery) are kept aside and reported. Once the robot is silent, the other life is its
successor. That one counts as soon as the reader of this link switches to it with `live`, between two periods.
"""

import math
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from typing import Any

import msgspec
import zenoh

from motm_twin.bus.connection import PlantKeys, answers, direct, spoken_on
from motm_twin.bus.plant_messages import (
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

MAX_BYTES = 1024 * 1024
MAX_AHEAD = 1.0  # [s] by which a scan or a frame of the camera may be stamped later than the newest state
LARGEST = 1e11  # size of any measure: 3,000 years in s; sums and products of larger ones overflow
MOST = 2**53  # size of any count: JSON has no larger whole numbers
FARTHEST = 1e5  # [m] from the origin of the world, or of the odometry
FASTEST = 20.0  # [m/s], [rad/s] of base and joints
TURNED = 10.0  # [rad] of a joint: more than a turn and a half must be degrees
WIDEST = 1.0  # [m] between finger pads
SHUT = -0.01  # [m] least of the same, for a badly calibrated gripper

Message = RobotState | ScanData | DetectionList | ClockReached | TruthData
_KINDS: dict[str, type[Message]] = {
    "state": RobotState,
    "scan": ScanData,
    "detections": DetectionList,
    "truth": TruthData,
    "clock": ClockReached,
}
_DECODERS = {name: msgspec.json.Decoder(kind) for name, kind in _KINDS.items()}
NAMES = tuple(_KINDS)


class RefusedMessage(ValueError):
    """A message that is ignored; the text says why."""


def read(name: str, payload: bytes) -> Message:
    """Decode and check a message of the key ``name``; raises `RefusedMessage`."""
    if len(payload) > MAX_BYTES:
        raise RefusedMessage(f"{len(payload)} bytes: at most {MAX_BYTES} are taken")
    try:
        message = _DECODERS[name].decode(payload)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise RefusedMessage(str(error)) from None
    if message.version != VERSION:
        raise RefusedMessage(f"version {message.version!r}: this twin reads {VERSION!r}")
    _require_bounded(message)
    if isinstance(message, RobotState):
        _check_state(message)
    elif isinstance(message, ScanData):
        _vector("origin", message.origin, 2)
        _pose("pose", message.pose)
    elif isinstance(message, DetectionList):
        for one in message.detections:
            if one.stamp > message.stamp + MAX_AHEAD:
                raise RefusedMessage(f"stamp of {one.name!r} is {one.stamp - message.stamp:.1f} s after its picture")
            _vector(f"p_base of {one.name!r}", one.p_base, 3)
            _pose(f"odometry of {one.name!r}", one.odometry)
            if one.position_sd < 0.0:
                raise RefusedMessage(f"position_sd of {one.name!r} is {one.position_sd:g} m: it can not be negative")
    elif isinstance(message, TruthData):
        _pose("pose", message.pose)
    return message


def _require_bounded(value: Any, name: str = "") -> None:
    """Raise `RefusedMessage` for numbers too large to compute with, however deep; a scan's ranges are checked later."""
    if isinstance(value, float | int):
        most = LARGEST if isinstance(value, float) else MOST
        if not abs(value) <= most:
            shown = f"{value:g}" if isinstance(value, float) else f"a whole number of {value.bit_length()} bits"
            raise RefusedMessage(f"{name} has {shown}: {most:g} at most can be")
    elif isinstance(value, msgspec.Struct):
        for field in value.__struct_fields__:
            if field != "ranges":
                _require_bounded(getattr(value, field), field)
    elif isinstance(value, list | tuple):
        for part in value:
            _require_bounded(part, name)


def _check_state(state: RobotState) -> None:
    _pose("pose", state.pose)
    _pose("odometry", state.odometry)
    _within("twist", _vector("twist", state.twist, 2), -FASTEST, FASTEST, "m/s, rad/s")
    _within("q", _vector("q", state.q, 7), -TURNED, TURNED, "rad")
    _within("dq", _vector("dq", state.dq, 7), -FASTEST, FASTEST, "rad/s")
    _within("gripper_width", [state.gripper_width], SHUT, WIDEST, "m")


def _pose(name: str, values: Sequence[float]) -> None:
    _within(name, _vector(name, values, 3)[:2], -FARTHEST, FARTHEST, "m")


def _vector(name: str, values: Sequence[float], length: int) -> Sequence[float]:
    if len(values) != length or not all(map(math.isfinite, values)):
        has = str(list(values)) if len(values) <= 8 else f"{len(values)}"
        raise RefusedMessage(f"{name} needs {length} finite numbers, and has {has}")
    return values


def _within(name: str, values: Iterable[float], low: float, high: float, unit: str) -> None:
    for value in values:
        if not low <= value <= high:
            raise RefusedMessage(f"{name} has {value:g}: {low:g} to {high:g} {unit} can be")


ANSWER = 2.0  # [s] to wait for an answer
RESET_ANSWER = 60.0  # [s] to wait for a reset: a simulated robot may have to compile
REFUSED_FOR = 1.0  # [s] for which a refused message is reported
SILENCE = 1.0  # [s] without an accepted state, after which a set clock or another robot is believed
OTHERS = 4  # largest number of lives whose messages are kept aside
_SENSED = ("scan", "detections")  # stamped before the state that comes after them
TOLD_FOR = 3.0  # [s] for which a refused command is reported
_LONGEST = 200  # characters of a robot's reason


class RobotLink:
    """One robot on a session. ``listen_only``: commands and grants are never sent, not even declared."""

    def __init__(self, session: zenoh.Session, twin: str, *, listen_only: bool = False) -> None:
        self.keys, self.listen_only, self.session = PlantKeys(twin), listen_only, session
        self.changed = threading.Condition()
        self._newest: dict[str, Any] = {}
        self.life = ""  # of the robot whose messages count
        self._since = -1e9  # [s] monotonic, when this life began to count
        self._aside: dict[str, dict[str, tuple[Message, float]]] = {}  # by life and key: newest message, received when
        self._other: tuple[str, float] = ("", -1e9)  # life that was heard beside this one, and when [s] monotonic
        self.last_sign = -1e9  # [s] monotonic, of the newest state
        self.unreadable = 0
        self._refusals: dict[str, tuple[str, float]] = {}  # by key: why, and when [s] monotonic
        self._jumped: float | None = None  # [s] stamp of a state that was refused because it was far off
        self.clock_sets = 0  # number of times that the robot's clock was set
        self.on_state: Callable[[RobotState, float], None] = lambda state, received: None
        self._encode = msgspec.json.Encoder().encode
        self._declared: list[Any] = [
            session.declare_subscriber(getattr(self.keys, name), direct(self._reader(name))) for name in NAMES
        ]
        if not listen_only:
            block = zenoh.CongestionControl.BLOCK
            self._commands = session.declare_publisher(
                self.keys.command, congestion_control=zenoh.CongestionControl.DROP, express=True
            )
            self._grants = session.declare_publisher(self.keys.grant, congestion_control=block, express=True)
            self._declared += [self._commands, self._grants]

    def newest(self, name: str) -> Any:
        """The newest message of a key (state, scan, ...) from the life that counts; None without one."""
        with self.changed:
            return self._newest.get(name)

    def refusal(self, name: str) -> str:
        """Reason why a recent message on a key (state, ...) was refused; "" when none was, or a newer one counts."""
        why, at = self._refusals.get(name, ("", -1e9))
        return why if time.monotonic() - at < REFUSED_FOR else ""

    @property
    def successor(self) -> str:
        """Life of another robot that has come after this one fell silent; "" without one."""
        with self.changed:
            silent = max(self.last_sign, self._since) + SILENCE
            lives = self._aside.items()
            return next((life for life, messages in lives if any(at >= silent for _, at in messages.values())), "")

    @property
    def intruder(self) -> str:
        """Life of another robot that was heard lately while this one is there; "" when this one is alone."""
        life, at = self._other
        return life if time.monotonic() - at < REFUSED_FOR else ""

    def command(self, command: RobotCommand) -> None:
        """Send a command."""
        with suppress(zenoh.ZError):
            self._commands.put(self._encode(command))

    def grant(self, until: float, after: int = -1) -> None:
        """Shared clock: let time pass up to ``until`` [s], once the command with number ``after`` has arrived."""
        with suppress(zenoh.ZError):
            self._grants.put(self._encode(ClockGrant(version=VERSION, life=self.life, until=until, after=after)))

    def info(self) -> Info | None:
        """The robot's answer about itself; None without one."""
        for payload in self._ask(self.keys.info, b"", ANSWER):
            with suppress(msgspec.DecodeError, UnicodeDecodeError):
                info = msgspec.json.decode(payload, type=Info)
                if info.version == VERSION:
                    return info
        return None

    def ask(self, key: str, request: msgspec.Struct, timeout: float = ANSWER) -> PlantAnswer:
        """Send a request; the answer is not ok when there is none within ``timeout`` [s]."""
        for payload in self._ask(key, self._encode(request), timeout):
            with suppress(msgspec.DecodeError, UnicodeDecodeError):
                return msgspec.json.decode(payload, type=PlantAnswer)
        return PlantAnswer(version=VERSION, ok=False, reason="the robot does not answer")

    def live(self, life: str) -> None:
        """Let only messages of this life count from now on. Call it between periods."""
        with self.changed:
            if life != self.life:
                self._begin(life)
            self._aside = {}

    def close(self) -> None:
        """Undeclare everything; the session stays open."""
        for declared in self._declared:
            declared.undeclare()
        self._declared = []

    def _ask(self, key: str, payload: bytes, timeout: float) -> list[bytes]:
        try:
            replies = self.session.get(key, payload=payload, timeout=timeout)
            return [answer.payload.to_bytes() for answer in answers(replies, key)]
        except zenoh.ZError:
            return []

    def _begin(self, life: str) -> None:
        self.life, self._jumped, self._since = life, None, time.monotonic()
        own = self._aside.pop(life, {})
        self._newest = {name: message for name, (message, _) in own.items()}
        self.last_sign = own["state"][1] if "state" in own else -1e9

    def _reader(self, name: str) -> Callable[[zenoh.Sample], None]:
        key = getattr(self.keys, name)

        def on_sample(sample: zenoh.Sample) -> None:
            if not spoken_on(sample, key):
                return
            received = time.monotonic()
            try:
                self._keep(name, read(name, sample.payload.to_bytes()), received)
            except RefusedMessage as refusal:
                self.unreadable += 1
                self._refusals[name] = str(refusal), received

        return on_sample

    def _keep(self, name: str, message: Message, received: float) -> None:
        with self.changed:
            if not self.life:
                self._begin(message.life)
            if message.life != self.life:
                self._keep_aside(name, message, received)
                return
            before, state = self._newest.get(name), self._newest.get("state")
            if name in _SENSED and state is not None:
                self._require_on_time(message, state, received)
                if before is not None and before.stamp > state.stamp + MAX_AHEAD:
                    before = None  # came before the first state, which is much earlier
            if isinstance(message, RobotState):
                if self._clock_was_set(message, state, received):
                    before = None
                self.last_sign = received
                self.on_state(message, received)
            if before is not None and message.stamp < before.stamp:
                return  # overtaken
            self._newest[name] = message
            self._refusals.pop(name, None)
            self.changed.notify_all()

    def _keep_aside(self, name: str, message: Message, received: float) -> None:
        """Keep a message of another life, which intrudes while this life is heard."""
        if received - max(self.last_sign, self._since) < SILENCE:
            self._other = message.life, received
        messages = self._aside.pop(message.life, {})
        self._aside[message.life] = messages | {name: (message, received)}  # the newest at the end
        if len(self._aside) > OTHERS:
            del self._aside[next(iter(self._aside))]
        self.changed.notify_all()

    def _clock_was_set(self, message: RobotState, before: RobotState | None, received: float) -> bool:
        """True when the clock was set: two jumped stamps, after a silence. Raises `RefusedMessage` for other jumps."""
        if before is None:
            return False
        silent = received - self.last_sign
        off = message.stamp - self._now(before, received)
        if off <= MAX_AHEAD and message.stamp >= before.stamp - MAX_AHEAD:
            self._jumped = None
            return False
        jumped, self._jumped = self._jumped, message.stamp
        if silent < SILENCE or jumped is None or abs(message.stamp - jumped) > MAX_AHEAD:
            raise RefusedMessage(f"its stamp jumps by {off:+.1f} s: its clock must be steady")
        self._jumped, self.clock_sets = None, self.clock_sets + 1
        self._newest.clear()
        return True

    def _now(self, state: RobotState, received: float) -> float:
        """The robot's clock [s]: its newest state and the time since, or a later message of a shared clock."""
        clock = self._newest.get("clock")
        since = state.stamp + received - self.last_sign
        return since if clock is None else max(since, clock.stamp)

    def _require_on_time(self, message: Message, state: RobotState, received: float) -> None:
        ahead = message.stamp - self._now(state, received)
        if ahead > MAX_AHEAD:
            raise RefusedMessage(
                f"its stamp is {ahead:.1f} s later than it can be by the newest state: one clock for all"
            )


class Obedience:
    """Detects refused and forged commands from a robot's states; times [s] are monotonic and come in as arguments."""

    def __init__(self) -> None:
        self._count, self._reason = -1, ""
        self._refused_at = self._forged_at = -1e9

    def state(self, state: RobotState, received: float, newest: int) -> None:
        """Take in a state; ``newest``: the highest number of a command of the twin."""
        if state.refused > self._count >= 0:
            self._refused_at, self._reason = received, state.refusal
        self._count = state.refused
        if any(seq > newest for seq, _ in state.heard):
            self._forged_at = received

    def text(self, now: float) -> str:
        """Clause about refused or forged commands; "" when there are none."""
        clause = ""
        if now - self._refused_at < TOLD_FOR:
            clause = f"; it refuses commands, {self._count} so far: {self._reason[:_LONGEST]}"
        return clause + ("; somebody else commands in this twin's name" if now - self._forged_at < TOLD_FOR else "")


BUCKET = 0.5  # [s] over which the best bound is kept
BUCKETS = 20  # 10 s: a drift of 100 ppm is 1 ms in that time
JUMP = 0.05  # [s] by which bounds contradict each other when a clock has jumped; less is rounding to steps
ARRIVALS = 200  # commands whose delays count: the last 2 s
SENT_KEPT = 500  # commands without a reported arrival that are remembered
IN_TIME = 0.98  # share of the commands that must be there in time; a late one acts when it arrives
MAX_LEAD = 0.3  # [s]
LOWER_AFTER = 2.0  # [s] between two reductions of the lead


class _Bound:
    """The largest value of the last `BUCKETS` buckets."""

    def __init__(self) -> None:
        self._best: deque[tuple[float, float]] = deque(maxlen=BUCKETS)  # begin of the bucket, largest value

    def note(self, now: float, value: float) -> None:
        if not self._best or now - self._best[-1][0] >= BUCKET:
            self._best.append((now, value))
        else:
            begin, largest = self._best[-1]
            self._best[-1] = (begin, max(largest, value))

    def largest(self) -> float | None:
        return max((value for _, value in self._best), default=None)


class ClockOffset:
    """Time by which the robot's clock is ahead of the twin's.

    A message that the robot stamps s and that arrives at t on the twin's clock proves that the offset is at least
    s - t; a command sent at t that arrives at r on the robot's clock proves that it is at most r - t. The estimate is
    the middle of the bounds, or the lower one before the first arrival of a command is reported.
    """

    def __init__(self) -> None:
        self._least, self._most = _Bound(), _Bound()  # lower bounds: of the offset, and of minus the offset

    def state(self, stamp: float, received: float) -> None:
        """A state arrived: stamp on the robot's clock, received on the twin's [s]."""
        self._least.note(received, stamp - received)
        if self._contradicted():
            self._least, self._most = _Bound(), _Bound()
            self._least.note(received, stamp - received)

    def command(self, sent: float, heard: float, now: float) -> None:
        """A command arrived: sent on the twin's clock, heard on the robot's [s]; ``now`` on the twin's."""
        self._most.note(now, sent - heard)
        if self._contradicted():
            self._least, self._most = _Bound(), _Bound()
            self._most.note(now, sent - heard)

    def _contradicted(self) -> bool:
        """True when the bounds exclude each other: the robot's clock has jumped, so they are void."""
        least, most = self._least.largest(), self._most.largest()
        return least is not None and most is not None and least > -most + JUMP

    @property
    def offset(self) -> float | None:
        """Robot's clock minus the twin's [s]; None before the first state."""
        least, most = self._least.largest(), self._most.largest()
        if least is None:
            return None
        return least if most is None or -most < least else 0.5 * (least - most)


class Lead:
    """Estimates the lead: the time before it acts at which a command must be computed to arrive in time."""

    def __init__(self, step: float) -> None:
        """``step`` [s] of the robot: the lead is a multiple of it."""
        self._step = step
        self._observed: dict[int, float] = {}  # by command: time of the observation that it was computed from
        self._delays: deque[float] = deque(maxlen=ARRIVALS)  # [s] from observation to arrival of a command
        self._lead, self._lowered = 0.0, -math.inf

    def sent(self, seq: int, observed: float) -> None:
        """Remember a command computed from an observation made at ``observed`` [s], robot's clock."""
        self._observed[seq] = observed
        while len(self._observed) > SENT_KEPT:
            del self._observed[next(iter(self._observed))]

    def heard(self, seq: int, at: float) -> None:
        """Take note that a command arrived at ``at`` [s], robot's clock."""
        observed = self._observed.pop(seq, None)
        if observed is not None:
            self._delays.append(min(max(0.0, at - observed), MAX_LEAD))

    def now(self, time: float) -> float:
        """The lead [s] to use at ``time`` [s]: it rises at once, and falls by one step in two seconds."""
        delays = sorted(self._delays)
        longest = delays[int(IN_TIME * (len(delays) - 1))] if delays else 0.0
        needed = math.ceil(longest / self._step - 1e-6) * self._step
        if needed > self._lead:
            self._lead, self._lowered = needed, time
        elif needed < self._lead - 0.5 * self._step and time - self._lowered >= LOWER_AFTER:
            self._lead, self._lowered = max(0.0, self._lead - self._step), time
        return self._lead
