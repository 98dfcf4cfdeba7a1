"""Plays a recording: sends its messages again on the bus, with new run numbers, as if a twin were running.

It acts like a twin that refuses changes. A jump in time is a branch: readers keep the shared past.
"""

import math
import queue
import time
import zlib
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec

from motm_twin.bus import commands
from motm_twin.bus.commands import Wheel
from motm_twin.bus.library import MethodLibrary
from motm_twin.bus.messages import STATUS_VERSION, MethodChoice, NumberedEvent, SceneChoice, StatusMessage
from motm_twin.methods import UNNAMED_METHOD
from motm_twin.model.plant import PERIOD
from motm_twin.model.scene import Scene
from motm_twin.record import channels as ch
from motm_twin.record.mcap_file import Entry, read
from motm_twin.record.recording import RunKey, TickPart
from motm_twin.sessions.session import SessionError

_LEVEL = 1  # of zlib
MOST_AT_ONCE = 64 * 1024 * 1024  # bytes of the messages within one period

Sent = tuple[str, bytes, bytes | None]  # topic, payload as on the bus, attachment


class _SceneText(msgspec.Struct):
    scene: msgspec.Raw


class _Timed(msgspec.Struct):
    time: float


# Messages that are stamped anew when played, with the fields that the player and its event log read.
_STAMPED: dict[str, Any] = {
    ch.TICK.topic: TickPart, ch.ROBOT.topic: _Timed, ch.SCAN.topic: Any, ch.METRICS.topic: Any,
    ch.EVENT.topic: NumberedEvent,
}  # fmt: skip


class _Driven(msgspec.Struct):
    """The method in a status or a session."""

    method: str = UNNAMED_METHOD


class _SessionText(msgspec.Struct):
    run: int
    began: float
    session: _Driven


@dataclass(frozen=True, slots=True)
class Frame:
    """One period, with the numbers of the frames that hold its scene and map."""

    run: RunKey
    first: int
    past: int
    index: int
    time: float  # [s] simulated
    scene: int
    grid: int
    packed: bytes

    def sent(self) -> list[Sent]:
        """All messages of the period, the tick first."""
        return msgspec.msgpack.decode(zlib.decompress(self.packed), type=list[Sent])


class Frames(list[Frame]):
    """All frames of a file. Raises SessionError when there is none."""

    def __init__(self, path: str | Path) -> None:
        super().__init__()
        self._open: tuple[TickPart, list[Sent]] | None = None
        self._before: list[Sent] = []  # messages before the first tick
        self._held = 0  # bytes of the messages since the last tick
        self._scene = self._grid = -1
        self._method, self._methods = UNNAMED_METHOD, dict[RunKey, str]()
        self._decode = msgspec.json.Decoder(TickPart).decode
        topic = ""
        try:
            for entry in read(path):
                topic = entry.topic
                self._take(entry)
        except SessionError as error:
            raise SessionError(error.problem, file=str(path)) from error
        except (msgspec.MsgspecError, ValueError, RecursionError) as error:
            problem = f"a message in it is broken or of another version ({topic}): {error}"
            raise SessionError(problem, file=str(path)) from error
        self._close()
        if not self:
            raise SessionError("holds no period of a twin", file=str(path))

    def method(self, frame: Frame) -> str:
        """Name of the method that drove in a frame."""
        return self._methods.get(frame.run, UNNAMED_METHOD)

    def find(self, index: int, near: int) -> int | None:
        """Number of the frame of period ``index`` nearest to frame ``near``, preferably of a run with equal start."""
        began = self[near].run[0]
        found = [number for number, frame in enumerate(self) if frame.index == index]
        return min(found, key=lambda number: (self[number].run[0] != began, abs(number - near)), default=None)

    def _take(self, entry: Entry) -> None:
        if entry.topic == ch.TICK.topic:
            part = self._decode(entry.data)
            last = self._open[0] if self._open else None
            if part.preview or (last is not None and part.key == last.key and part.index <= last.index):
                return  # a preview, or a repeated period
            self._close()
            self._methods.setdefault(part.key, self._method)
            stamped(entry.data, {})
            self._open = part, [(ch.TICK.topic, entry.data, None), *self._before]
            self._before, self._held = [], 0
        elif entry.topic == ch.STATUS.topic:
            self._method = msgspec.json.decode(entry.data, type=_Driven).method
        elif entry.topic == ch.SESSION.topic:
            kept = msgspec.json.decode(entry.data, type=_SessionText)
            self._methods[kept.began, kept.run] = kept.session.method
        elif (sent := _sent(entry)) is not None:
            self._held += len(sent[1])
            if self._held > MOST_AT_ONCE:
                raise SessionError(f"more than {MOST_AT_ONCE / 1e6:.0f} MB came within one period")
            (self._before if self._open is None else self._open[1]).append(sent)

    def _close(self) -> None:
        """Append the open frame, which has all of its messages now."""
        if self._open is None:
            return
        part, sent = self._open
        topics = [topic for topic, *_ in sent]
        number = len(self)
        self._scene = number if ch.SCENE.topic in topics else self._scene
        self._grid = number if ch.GRID.topic in topics else self._grid
        packed = zlib.compress(msgspec.msgpack.encode(sent), _LEVEL)
        self.append(Frame(part.key, part.first, part.past, part.index, part.time, self._scene, self._grid, packed))
        self._open = None


def stamped(payload: bytes, about: dict[str, object]) -> bytes:
    """A message with the fields ``about`` replaced. Raises ValidationError or ValueError if it is no JSON object."""
    return msgspec.json.encode(msgspec.json.decode(payload, type=dict[str, Any]) | about)


def _sent(entry: Entry) -> Sent | None:
    """A message as it was on the bus; None for one that is not played. Raises for one that cannot be decoded."""
    if entry.topic == ch.GRID.topic:
        grid = msgspec.json.decode(entry.data, type=ch.RecordedGrid)
        return entry.topic, grid.cells, msgspec.json.encode(grid.info)
    if entry.topic == ch.SCENE.topic:
        scene = msgspec.json.decode(entry.data, type=_SceneText).scene
        msgspec.json.decode(scene, type=Scene)
        return entry.topic, bytes(scene), None
    if entry.topic not in _STAMPED:
        return None
    msgspec.json.decode(entry.data, type=_STAMPED[entry.topic])
    stamped(entry.data, {})
    return entry.topic, entry.data, None


IDLE = 0.1  # [s] between checks of the clock while time stands
LATE = 0.5  # [s] beyond this lag it does not catch up
FILLED = 600  # last periods of a forward jump that are sent, so that readers can look back 30 s
_ALLOWED = "this is a recording: it takes play, pause, step, speed, reset (to its start) and branch (to a period)"

Put = Callable[[str, bytes, bytes | None], None]  # topic of the recording, payload, attachment
Work = Callable[[], None]


@dataclass(frozen=True, kw_only=True)
class Playback:
    """Initial speed and state of the playback."""

    speed: float = 1.0
    loop: bool = False  # begin again at the end
    playing: bool = True


AS_IT_WAS = Playback()


class Player:
    """Owns the position in a recording; everything that moves it happens in the thread that calls `run`."""

    def __init__(
        self,
        frames: Frames,
        *,
        name: str,
        twin: str,
        put: Put,
        now: Callable[[], float],
        changed: Work,
        playback: Playback = AS_IT_WAS,
    ) -> None:
        """``name`` of the file, for the status; ``now``: server time [s]; ``changed``: called when the status does."""
        self._frames, self._name, self._twin, self._put, self._now = frames, name, twin, put, now
        self._changed, self._loop = changed, playback.loop
        self._requests: queue.Queue[Work] = queue.Queue(maxsize=1000)
        self._wheel = Wheel(lambda _: None, changed)
        self._stopped, self._error = False, ""
        self._state, self._speed = "playing" if playback.playing else "paused", playback.speed
        self._at = -1  # frame that was sent last
        self._of: RunKey | None = None  # its run in the file
        self._due = time.monotonic()
        self._later: deque[tuple[float, Sent]] = deque()  # due [s], message to send between two frames
        self._run, self._began, self._first, self._past = 0, 0.0, 0, -1
        self._scene: Scene | None = None
        self._choices = MethodLibrary().choices()

    def request(self, envelope: commands.Envelope, reply: Callable[[str, int], None]) -> None:
        """Hand a checked command over; ``reply`` is called once, with a reason or "". Raises Refused when full."""
        arrived = time.monotonic()
        try:
            self._requests.put_nowait(lambda: self._answer(envelope, arrived, reply))
        except queue.Full:
            raise commands.Refused("too many commands are waiting") from None

    def stop(self) -> None:
        """Make `run` return."""
        self._stopped = True

    def run(self) -> None:
        """Play until `stop`; any error stops the playback where it is, and is shown to everybody."""
        work: Work = self._start
        while not self._stopped:
            try:
                work()
            except Exception as error:
                self._later.clear()
                self._state, self._error = "error", commands.reason_of(error)
                self._changed()
            work = self._turn

    def _start(self) -> None:
        self._show(0)
        self._due = time.monotonic() + PERIOD / self._speed

    def _turn(self) -> None:
        due = min(self._due, self._later[0][0]) if self._later else self._due  # [s] next time to send something
        wait = min(IDLE, due - time.monotonic()) if self._state == "playing" else IDLE
        with suppress(queue.Empty):
            work = self._requests.get(timeout=max(0.0, wait))
            work()
        self._wheel.look_after(time.monotonic())
        self._send_due(time.monotonic())
        if self._state == "playing" and time.monotonic() >= self._due:
            self._advance()

    @property
    def state(self) -> str:
        """State as in `status`, which takes longer."""
        return self._state

    def status(self) -> StatusMessage:
        """The status, as of a twin; from any thread."""
        frame, scene, last = self._frames[max(self._at, 0)], self._scene, self._frames[len(self._frames) - 1]
        chosen = "" if scene is None else scene.name
        variant = "" if scene is None else scene.variant
        about = f"a recording: {self._name}, {frame.time:.1f} of {last.time:.1f} s"
        method = self._frames.method(frame)
        unknown = MethodChoice(name=method, title=method, summary="")  # the file is untrusted
        # Times [s] to which `branch` can go: in all runs that share their start with this frame's run.
        times = [other.time for other in self._frames if other.run[0] == frame.run[0]]
        return StatusMessage(
            version=STATUS_VERSION,
            twin=self._twin,
            run=self._run,
            server_time=self._now(),
            state=self._state,
            text={"done": "the recording has ended", "error": self._error}.get(self._state, about),
            scene=chosen,
            variant=variant,
            seed=0 if scene is None else scene.seed,
            time=round(frame.time, 6),
            speed=self._speed,
            actual_speed=self._speed if self._state == "playing" else 0.0,
            capped=False,
            scenes=[SceneChoice(name=chosen, title=self._name, variants=[variant])],
            **self._wheel.shown(time.monotonic()),
            oldest=min(frame.index for frame in (self._frames[0], frame)),
            plant="recording",
            plant_text=about,
            span=[times[0], max(times)],
            method=method,
            methods=[next((choice for choice in self._choices if choice.name == method), unknown)],
        )

    def _answer(self, envelope: commands.Envelope, arrived: float, reply: Callable[[str, int], None]) -> None:
        index = self._frames[max(self._at, 0)].index
        try:
            self._wheel.require(envelope, arrived)
            work = self._apply(envelope.command)
        except commands.Refused as refusal:
            reply(str(refusal), index)
            return
        self._wheel.turn(envelope, arrived)
        reply("", index)
        work()
        self._changed()

    def _apply(self, command: commands.Command) -> Work:
        """The work that follows the answer. Raises Refused."""
        match command:
            case commands.Play():
                return self._play
            case commands.Pause():
                return lambda: self._set("paused")
            case commands.Step(count=count):
                return lambda: self._step(count)
            case commands.Speed(factor=factor):
                return lambda: self._set_speed(factor)
            case commands.Reset():
                return lambda: self._seek(0)
            case commands.Branch(index=index):
                number = self._frames.find(index, max(self._at, 0))
                if number is None:
                    indices = [frame.index for frame in self._frames]
                    known = f"it has {min(indices)} to {max(indices)}"
                    raise commands.Refused(f"period {index} is not in the recording: {known}")
                return lambda: self._seek(number)
            case commands.TakeWheel() | commands.HandOver():
                return lambda: None
            case _:
                raise commands.Refused(_ALLOWED)

    def _play(self) -> None:
        if self._state == "done":
            self._seek(0)
        self._due = time.monotonic()
        self._set("playing")

    def _set(self, state: str) -> None:
        if state != self._state:
            self._send_due(math.inf)
            self._state = state
            self._changed()

    def _set_speed(self, factor: float) -> None:
        self._speed, self._due = factor, time.monotonic()

    def _step(self, count: int) -> None:
        self._set("paused")
        for _ in range(count):
            if self._at + 1 == len(self._frames):
                self._set("done")
                return
            self._show(self._at + 1)

    def _advance(self) -> None:
        now = time.monotonic()
        self._due = max(self._due, now - LATE) + PERIOD / self._speed
        if self._at + 1 < len(self._frames):
            self._show(self._at + 1)
        elif self._loop:
            self._seek(0)
        else:
            self._set("done")

    def _send_due(self, until: float) -> None:
        """Send the waiting messages that are due at ``until`` [s], monotonic."""
        while self._later and self._later[0][0] <= until:
            self._send(self._later.popleft()[1])

    def _spread(self, robot: list[Sent]) -> None:
        """Schedule the states of the robot in one period with their recorded spacing, divided by the speed."""
        now, times = time.monotonic(), [msgspec.json.decode(payload, type=_Timed).time for _, payload, _ in robot]
        for item, at in zip(robot, times, strict=True):
            self._later.append((now + min(PERIOD, max(0.0, at - times[0])) / self._speed, item))
        self._send_due(now)

    def _seek(self, number: int) -> None:
        """Show another frame. Forward, the frames between are sent at once; backward, the past is kept."""
        self._send_due(math.inf)  # still under the old run number
        if self._state in ("done", "error"):
            self._set("paused")
        first = number if number <= self._at else max(self._at + 1, number - FILLED)
        frame, leap = self._frames[first], first != self._at + 1
        if number > self._at:
            self._follow(first)
        elif number == 0:
            self._begin_run(frame, self._now(), 0, -1)
        else:
            same = frame.run[0] == self._frames[self._at].run[0]
            self._begin_run(frame, self._began if same else self._now(), frame.index, self._run)
        if leap and frame.grid >= 0:  # the map in force, which this frame does not contain
            grids = [item for item in self._frames[frame.grid].sent() if item[0] == ch.GRID.topic]
            self._send(grids[-1])
        for between in range(first, number + 1):
            self._show(between)

    def _follow(self, number: int) -> None:
        """Begin a run when a frame belongs to another run than the frame sent last."""
        frame, of = self._frames[number], self._of
        if of is None:
            self._begin_run(frame, self._now(), 0, -1)
        elif frame.run != of:
            same = frame.run[0] == of[0]
            past = self._run if same and number == self._at + 1 else -1  # after a jump the past may be another run's
            self._begin_run(frame, self._began if same else self._now(), frame.first, past)

    def _begin_run(self, frame: Frame, began: float, first: int, past: int) -> None:
        """Begin a new run with this frame."""
        self._of = frame.run
        self._run, self._began, self._first, self._past = self._run + 1, began, first, past
        if frame.scene >= 0:
            payload = next(payload for topic, payload, _ in self._frames[frame.scene].sent() if topic == ch.SCENE.topic)
            scene = msgspec.json.decode(payload, type=Scene)
            if scene != self._scene:
                self._scene = scene
                self._put(ch.SCENE.topic, payload, None)
                self._changed()

    def _show(self, number: int) -> None:
        self._send_due(math.inf)
        self._follow(number)
        frame, self._at = self._frames[number], number
        playing, sent = self._state == "playing", frame.sent()
        later = (ch.SCENE.topic, ch.ROBOT.topic) if playing else (ch.SCENE.topic,)  # sent with its run; spread
        for item in sent:
            if item[0] not in later:
                self._send(item)
        if playing:
            self._spread([item for item in sent if item[0] == ch.ROBOT.topic])

    def _send(self, item: Sent) -> None:
        topic, payload, attachment = item
        about = {"run": self._run, "server_time": self._now()}
        if topic == ch.TICK.topic:
            about |= {"began": self._began, "first": self._first, "past": self._past}
        if topic in _STAMPED:
            payload = stamped(payload, about)
        elif attachment is not None:
            attachment = stamped(attachment, {"run": self._run})
        self._put(topic, payload, attachment)
