"""Records one twin as an independent Zenoh subscriber, outside the loop: its failures never stop the robot.

As a program: ``python -m motm_twin.record.recorder --out run.mcap``.
"""

import argparse
import hashlib
import queue
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec
import zenoh

from motm_twin.bus import messages
from motm_twin.bus.connection import DEFAULT_PORT, DEFAULT_TWIN, LOOPBACK, Keys, direct, open_member
from motm_twin.client.discover import NoTwin, require_answer
from motm_twin.model.scene import Scene
from motm_twin.processes import Reporter, leave, stop_event
from motm_twin.program import BAD_INPUT, FAILED, OK
from motm_twin.record import channels as ch
from motm_twin.record.foxglove import Add, Drawer, furniture, grid
from motm_twin.record.mcap_file import McapFile, RecordingFailed
from motm_twin.sessions.session import Session, SessionError

SAVE_INTERVAL = 0.4  # [s] between two chunks on the disk: a crash loses at most this
WAIT = 0.05  # [s] between checks for other work
LAST_SESSION = 0.7  # [s] to wait for the session at the end
SESSION_INTERVAL = 30.0  # [s] between two sessions, whose state hashes a rerun compares
ASK_INTERVAL = 1.0  # [s] least time between two requests for a session
ASK_TIMEOUT = 5.0  # [s]
WAITING_MOST = 20_000  # payloads: half a minute at eight times real time; a longer backlog never shrinks
_Message = tuple[str, bytes, bytes | None, bool]  # key, payload, attachment; True: answer to a query
LISTENS = 1.0  # [s] limit to wait until the twin knows of the recorder; earlier messages are recorded too
Take = Callable[[bytes, bytes | None], None]  # payload, attachment
STATUS_INTERVAL = 1.0  # [s] between two recorded status messages with the same content


class _TickPart(msgspec.Struct, frozen=True):
    """The needed fields of every tick."""

    run: int
    server_time: float
    index: int
    began: float = 0.0
    preview: bool = False


class _Stamped(msgspec.Struct, frozen=True):
    server_time: float


class _OfRun(msgspec.Struct, frozen=True):
    run: int


class Stream:
    """Passes payloads of one twin to ``add`` (channel, server time, JSON): unchanged, and as drawings for Foxglove.

    Knows no transport and no clock. ``wants_session``: the session should be queried.
    """

    def __init__(self, keys: Keys, add: Add) -> None:
        self._write, self._drawer = add, Drawer(self._add)
        self._part = msgspec.json.Decoder(_TickPart).decode
        self._tick = msgspec.json.Decoder(messages.TickMessage).decode
        self._take: dict[str, Take] = {
            keys.tick: self._on_tick,
            keys.grid: self._on_grid,
            keys.scene: self._on_scene,
            keys.status: self._on_status,
            keys.robot: self._kept(ch.ROBOT, messages.RobotStateMessage, self._drawer.robot),
            keys.scan: self._kept(ch.SCAN, messages.ScanMessage, self._drawer.scan),
            keys.event: self._kept(ch.EVENT, messages.NumberedEvent, self._drawer.event),
            keys.metrics: self._kept(ch.METRICS, _Stamped),
            keys.observations: self._kept(ch.OBSERVATIONS, _Stamped),
        }
        self._grid_key, self._of_a_run = keys.grid, (keys.tick, keys.grid, keys.robot, keys.observations)
        self._told_run: int | None = None  # run in the newest status
        self.wants_session = False
        self.lost = 0  # periods that did not arrive
        self.now = 0.0  # [s] newest server time
        self._earliest = 0.0  # [s] earliest time to log: a last value may be older than the recording
        self.run: tuple[float, int] | None = None  # of the newest tick: began, number
        self.index = -1
        self._grid, self._said, self._said_at = b"", (), 0.0

    @property
    def keys(self) -> tuple[str, ...]:
        """Keys whose payloads it takes."""
        return tuple(self._take)

    def take(self, key: str, payload: bytes, attachment: bytes | None, *, asked: bool = False) -> None:
        """Take one payload. Raises msgspec.MsgspecError for a payload that does not fit its key.

        A last value that was queried (``asked``) may be hours old if the twin is paused. It is logged at the time of
        its arrival; otherwise the recording would seem to begin hours too early.
        """
        self._earliest = self.now if asked else 0.0
        self._take[key](payload, attachment)

    def is_past(self, key: str, payload: bytes, attachment: bytes | None) -> bool:
        """True when a last value belongs to a run before the one in the status. Raises msgspec.MsgspecError.

        Until an external robot has begun its run, its twin still has the last period of the run before. That may be
        hours old and of another scene: it does not belong in the recording.
        """
        if self._told_run is None or key not in self._of_a_run:
            return False
        about = attachment if key == self._grid_key else payload
        return msgspec.json.decode(about or b"null", type=_OfRun).run < self._told_run

    def session(self, payload: bytes, attachment: bytes | None) -> None:
        """Take the session of the run that its attachment names. Raises msgspec.MsgspecError."""
        info = msgspec.json.decode(attachment or b"null", type=messages.SessionInfo)
        session = msgspec.json.decode(payload, type=Session)
        recorded = ch.RecordedSession(run=info.run, began=info.began, session=session)
        self._add(ch.SESSION, self.now, msgspec.json.encode(recorded))

    def _kept(self, channel: ch.Channel, kind: Any, draw: Callable[[Any], None] = lambda message: None) -> Take:
        """A function that records messages of this kind unchanged, and draws them."""
        decode = msgspec.json.Decoder(kind).decode

        def take(payload: bytes, _: bytes | None) -> None:
            message = decode(payload)
            self._add(channel, message.server_time, payload)
            draw(message)

        return take

    def _add(self, channel: ch.Channel, log_time: float, data: bytes) -> None:
        self._write(channel, max(log_time, self._earliest), data)

    def _on_tick(self, payload: bytes, _: bytes | None) -> None:
        part = self._part(payload)
        self.now = max(part.server_time, self._earliest)
        if not part.preview:
            self._follow(part)
        self._add(ch.TICK, part.server_time, payload)
        if not part.preview and self._drawer.wants_tick(part.server_time):
            self._drawer.tick(self._tick(payload))

    def _follow(self, part: _TickPart) -> None:
        """Detect another run, and missing periods."""
        run, missing = (part.began, part.run), part.index - self.index - 1
        if run != self.run or missing > 0:
            self.wants_session = True
            self.lost += missing if run == self.run else 0
        self.run, self.index = run, part.index

    def _on_grid(self, payload: bytes, attachment: bytes | None) -> None:
        info = msgspec.json.decode(attachment or b"null", type=messages.GridInfo)
        same = hashlib.sha256(payload + f"{info.run} {info.origin} {info.width}".encode()).digest()
        if same == self._grid:
            return  # sent again for late joiners
        self._grid = same
        self._add(ch.GRID, self.now, msgspec.json.encode(ch.RecordedGrid(info=info, cells=payload)))
        self._drawer.put(ch.DRAWN_GRID, self.now, grid(info, payload, self.now))

    def _on_scene(self, payload: bytes, _: bytes | None) -> None:
        scene = msgspec.json.decode(payload, type=Scene)
        self._add(ch.SCENE, self.now, msgspec.json.encode(ch.RecordedScene(scene=scene)))
        self._drawer.put(ch.DRAWN_FURNITURE, self.now, furniture(scene, self.now))

    def _on_status(self, payload: bytes, _: bytes | None) -> None:
        status = msgspec.json.decode(payload, type=messages.StatusMessage)
        self._told_run = status.run
        self.now = max(self.now, status.server_time)
        current = (
            status.run,
            status.state,
            status.text,
            status.speed,
            status.driver,
            status.plant_text,
            status.method,
        )
        if current != self._said or abs(status.server_time - self._said_at) >= STATUS_INTERVAL:
            self._said, self._said_at = current, status.server_time
            self._add(ch.STATUS, status.server_time, payload)


class Recorder:
    """Subscribes, and writes in the thread that calls `run`."""

    def __init__(self, session: zenoh.Session, twin: str, path: str | Path) -> None:
        """Raises SessionError when the file can not be made."""
        for channel in ch.CHANNELS.values():
            _ = channel.json_schema  # made now, because making them later would delay the first chunk
        self._zenoh, self._keys = session, Keys(twin)
        self._file = McapFile(path)
        self._stream = Stream(self._keys, self._file.add)
        self._waiting: queue.Queue[_Message | None] = queue.Queue()  # None: all first queries are answered
        self._early: list[_Message] | None = []  # other messages before that, written after the answers
        self._declared = [session.declare_subscriber(key, direct(self._on_sample)) for key in self._stream.keys]
        self._live: set[str] = set()  # keys with a message that was not an answer
        keys, self._listened = self._keys, threading.Event()
        # Last values for a late joiner; the status comes first, as it tells the run to which the others must belong.
        first = (keys.status, keys.scene, keys.tick, keys.grid, keys.robot, keys.observations)
        self._unanswered = set(first)
        for key in first:
            self._ask(key, lambda key=key: self._answered(key))
        self._asked_at, self._session_at = -1e9, -1e9
        self._refused: set[str] = set()

    @property
    def summary(self) -> dict[str, object]:
        """File, bytes and lost periods so far."""
        return {"file": str(self._file.path), "bytes": self._file.size, "lost_periods": self._stream.lost}

    def listens(self, timeout: float) -> bool:
        """Wait until the twin knows the subscriptions: all later messages are recorded. False after ``timeout`` [s].

        It knows them once it has answered queries that were sent after them on the same link.
        """
        return self._listened.wait(timeout)

    def run(self, stop: threading.Event, *, seconds: float | None = None) -> None:
        """Record until ``stop`` or for ``seconds``. Raises RecordingFailed; the file is closed in any case."""
        began = saved = time.monotonic()
        try:
            while not stop.is_set() and (seconds is None or time.monotonic() < began + seconds):
                self._take(saved + SAVE_INTERVAL)
                now = time.monotonic()
                self._ask_for_session(now)
                if now >= saved + SAVE_INTERVAL:
                    self._file.save()
                    saved = now
            self._write_rest()
        finally:
            for subscriber in self._declared:
                subscriber.undeclare()
            self._file.close()

    def _write_rest(self) -> None:
        """Write the waiting messages, and the final session."""
        self._file.save()
        deadline = time.monotonic() + LAST_SESSION
        while not self._waiting.empty() and time.monotonic() < deadline:
            self._take(time.monotonic() + WAIT, ending=True)
        self._release()
        before = self._session_at
        self._ask(self._keys.session)
        deadline = time.monotonic() + LAST_SESSION
        while self._session_at == before and time.monotonic() < deadline:
            self._take(time.monotonic() + WAIT, ending=True)

    def _take(self, until: float, *, ending: bool = False) -> None:
        """Write arriving messages until a time [s], even in a flood: chunks must be closed and sessions queried."""
        while (left := min(WAIT, until - time.monotonic())) > 0.0:
            if not ending and self._stream.wants_session and time.monotonic() >= self._asked_at + ASK_INTERVAL:
                return
            try:
                message = self._waiting.get(timeout=left)
            except queue.Empty:
                return
            if message is None:
                self._release()
                continue
            key, *_, asked = message
            if not asked:
                self._live.add(key)
            elif key in self._live and key not in (self._keys.status, self._keys.scene):
                continue  # a newer message has arrived
            if self._early is None or asked:
                self._write(*message)
            else:
                self._early.append(message)

    def _release(self) -> None:
        """Write the early messages: the run of a tick is known only after its scene and status."""
        early, self._early = self._early or (), None
        for message in early:
            self._write(*message)

    def _write(self, key: str, payload: bytes, attachment: bytes | None, asked: bool) -> None:
        try:
            if asked and self._stream.is_past(key, payload, attachment):
                return
            if key == self._keys.session:
                self._session_at = time.monotonic()
                self._stream.session(payload, attachment)
            else:
                self._stream.take(key, payload, attachment, asked=asked)
        except (msgspec.MsgspecError, UnicodeDecodeError, ValueError) as error:
            if key not in self._refused:  # reported once: another version may send twenty a second
                self._refused.add(key)
                print(f"record: what came on {key} is not recorded: {error}", file=sys.stderr)

    def _ask_for_session(self, now: float) -> None:
        due = self._stream.run is not None and now >= max(self._session_at, self._asked_at) + SESSION_INTERVAL
        if (self._stream.wants_session or due) and now >= self._asked_at + ASK_INTERVAL:
            self._stream.wants_session, self._asked_at = False, now
            self._ask(self._keys.session)

    def _ask(self, key: str, ended: Callable[[], None] = lambda: None) -> None:
        """Query a key; ``ended`` is called after the last answer, in Zenoh's thread."""

        def on_reply(reply: zenoh.Reply) -> None:
            if reply.ok is not None:
                self._on_sample(reply.ok, asked=True)

        self._zenoh.get(key, zenoh.handlers.Callback(on_reply, ended, indirect=False), timeout=ASK_TIMEOUT)

    def _answered(self, key: str) -> None:
        """Note that a first query is answered; called in Zenoh's thread."""
        self._unanswered.discard(key)
        if not self._unanswered:
            self._waiting.put(None)
            self._listened.set()

    def _on_sample(self, sample: zenoh.Sample, asked: bool = False) -> None:
        """Take a message; called in Zenoh's thread. One that was sent to a wildcard does not come from the twin."""
        if self._waiting.qsize() < WAITING_MOST and "*" not in str(sample.key_expr):
            attached = None if sample.attachment is None else sample.attachment.to_bytes()
            self._waiting.put((str(sample.key_expr), sample.payload.to_bytes(), attached, asked))


def main() -> None:
    """Record until a signal, the end of the parent, or the time that was given."""
    options = _options()
    report, stop = Reporter(options.report), stop_event(options.report is not None)
    try:
        session = open_member(options.endpoint, wait=options.wait, stop=stop)
        if options.answer is not None:
            require_answer(session, options.twin, options.endpoint, within=options.answer)
        recorder = Recorder(session, options.twin, options.out)
    except (SessionError, NoTwin, TimeoutError, ValueError) as error:
        report("refused", text=str(error))
        leave(BAD_INPUT)
        return
    recorder.listens(LISTENS)
    report("recording", **recorder.summary)
    try:
        recorder.run(stop, seconds=options.seconds)
    except RecordingFailed as error:
        print(f"record: the recording has stopped: {error}; the robot goes on", file=sys.stderr)
        report("failed", text=str(error), **recorder.summary)
        leave(FAILED)
        return
    report("recorded", **recorder.summary)
    session.close()
    leave(OK)


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m motm_twin.record.recorder", description=__doc__)
    parser.add_argument("--endpoint", default=f"tcp/{LOOPBACK}:{DEFAULT_PORT}", help="where the twin server listens")
    parser.add_argument("--twin", default=DEFAULT_TWIN, help="name in the keys")
    parser.add_argument("--out", required=True, help="file to be written; it must not exist")
    parser.add_argument("--seconds", type=float, help="time to record; without it until a signal")
    parser.add_argument("--wait", type=float, default=30.0, help="time to wait for the server")
    parser.add_argument("--answer", type=float, help="refuse when the twin does not answer within this time")
    parser.add_argument("--report", type=int, help=argparse.SUPPRESS)
    return parser.parse_args(sys.argv[1:])


if __name__ == "__main__":
    main()
