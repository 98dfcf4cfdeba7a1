"""Numbered events, found by comparing each period and status with the one before."""

import math
import re
import threading
from collections import deque
from collections.abc import Callable

import msgspec
import zenoh
from msgspec.structs import replace

from motm_twin.bus import messages
from motm_twin.model.edits import Drive, Edit, MoveBody
from motm_twin.model.plant import PERIOD

HISTORY = 1000  # events that can be queried
SAME_DRAG = 1.0  # [s] simulated time within which repeated moves of a held body, or twists by hand, make one event

Emit = Callable[[messages.NumberedEvent], None]


class EventLog:
    """Numbers events and keeps the last `HISTORY` of them; readable from any thread."""

    def __init__(self, now: Callable[[], float], emit: Emit) -> None:
        """``now`` is the server's clock [s]; ``emit`` sends an event to the subscribers."""
        self._now, self._emit = now, emit
        self._since = now()
        self._lock = threading.Lock()
        self._kept: deque[messages.NumberedEvent] = deque(maxlen=HISTORY)
        self._seq = 0

    def add(self, *, run: int, index: int, time: float, kind: str, text: str, **about: object) -> None:
        """Number an event and send it."""
        with self._lock:
            self._seq += 1
            event = messages.NumberedEvent(
                version=messages.EVENT_VERSION,
                seq=self._seq,
                numbered_since=self._since,
                run=run,
                server_time=self._now(),
                index=index,
                time=time,
                kind=kind,
                text=text,
                **about,  # pyright: ignore[reportArgumentType] - body, other, caused_by_robot
            )
            self._kept.append(event)
            self._emit(event)

    def tell_again(self, event: messages.NumberedEvent) -> None:
        """Send an earlier event of another log again, numbered by this one."""
        with self._lock:
            self._seq += 1
            again = replace(event, seq=self._seq, numbered_since=self._since)
            self._kept.append(again)
            self._emit(again)

    def answer(self, parameters: zenoh.Parameters) -> bytes | None:
        """Answer to ``?from=SEQ``: all kept events from this number on; without it, the last one. Raises ValueError."""
        since = parameters.get("from")
        if since is not None and not (since.isdecimal() and len(since) < 20):
            raise ValueError(f"from={since[:40]!r}: give the number of an event, 0 for all that are kept")
        with self._lock:
            kept, newest = list(self._kept), self._seq
        if since is None:
            return msgspec.json.encode(kept[-1]) if kept else None
        events = [event for event in kept if event.seq >= int(since)]
        reply = messages.EventsMessage(
            version=messages.EVENTS_VERSION,
            numbered_since=self._since,
            oldest=newest - len(kept) + 1,
            newest=newest,
            events=events,
        )
        return msgspec.json.encode(reply)


class EventWatch:
    """Derives events from consecutive messages. Called by one thread at a time."""

    def __init__(self, log: EventLog) -> None:
        self._log = log
        self._run, self._index, self._began = -1, -1, -1.0
        self._loaded: str | None = None  # scene that was loaded and has not run yet
        self._state = ""
        self._stopped: tuple[str, ...] = ()  # reason of the last stop, without its numbers
        self._contacts: set[tuple[float, str, str]] = set()
        self._cut_ins: set[tuple[float, str]] = set()
        self._dragged: dict[str, float] = {}  # body, "" for the robot: [s] of the last move while held
        self._found: list[tuple[float, str, str, dict[str, object]]] = []  # of the current period
        self._last = -math.inf  # [s] time of the newest event of the run

    def scene(self, name: str) -> None:
        """Note a scene that is about to run."""
        self._loaded = name

    def status(self, status: messages.StatusMessage) -> None:
        """Add an event when the status says that the run ended, or failed."""
        before, self._state = self._state, status.state
        if status.state != before and status.state in ("done", "error"):
            self._last = max(self._last, status.time) if status.run == self._run else status.time
            self._log.add(run=status.run, index=self._index, time=self._last, kind=status.state, text=status.text)

    def tick(self, message: messages.TickMessage) -> None:
        """Add the events of a period; previews of a paused twin have none."""
        if message.run == self._run and message.index <= self._index:
            return
        if message.run != self._run:
            self._new_run(message)
        self._run, self._index, self._began = message.run, message.index, message.began
        self._tell(message)
        for edit in message.edits:
            self._edit(message, edit)
        for event in message.events:
            self._add(message, event.kind, event.text, time=event.time, other=_named(event.text, message))
        if message.score is not None:
            for contact in message.score.contacts:
                self._contact(message, contact)
            for cut_in in message.score.cut_ins:
                self._cut_in(message, cut_in)
        self._stop(message)
        self._tell(message)

    def _tell(self, message: messages.TickMessage) -> None:
        """Number the found events in order of time; a late one gets the time of the event before it."""
        for time, kind, text, about in sorted(self._found, key=lambda one: one[0]):
            self._last = max(self._last, time)
            self._log.add(run=message.run, index=message.index, time=self._last, kind=kind, text=text, **about)
        self._found = []

    def _new_run(self, message: messages.TickMessage) -> None:
        scene, self._last = self._loaded, -math.inf
        if scene is not None:
            self._add(message, "loaded", f"loaded {scene}")
        elif message.began == self._began:
            self._add(message, "branch", f"goes on from {message.first * PERIOD:.2f} s")
        else:
            self._add(message, "reset", "back to the start")
        self._loaded, self._stopped, self._dragged = None, (), {}
        contacts, cut_ins = ([], []) if message.score is None else (message.score.contacts, message.score.cut_ins)
        self._contacts = {_key(contact) for contact in contacts if contact.time < message.first * PERIOD}
        self._cut_ins = {(cut_in.time, cut_in.agent) for cut_in in cut_ins if cut_in.time < message.first * PERIOD}

    def _contact(self, message: messages.TickMessage, contact: messages.ContactMessage) -> None:
        if _key(contact) in self._contacts:
            return
        self._contacts.add(_key(contact))
        whose = "caused by the robot" if contact.caused_by_robot else "not caused by the robot"
        self._add(
            message,
            "contact",
            f"{contact.body} touched {contact.other}, {whose}",
            time=contact.time,
            body=contact.body,
            other=contact.other,
            caused_by_robot=contact.caused_by_robot,
        )

    def _cut_in(self, message: messages.TickMessage, cut_in: messages.CutInMessage) -> None:
        key = (cut_in.time, cut_in.agent)
        if key in self._cut_ins:
            return
        self._cut_ins.add(key)
        text = f"cut in on {cut_in.agent}, {cut_in.gap:.2f} m before it"
        self._add(message, "cut_in", text, time=cut_in.time, other=cut_in.agent)

    def _stop(self, message: messages.TickMessage) -> None:
        key = () if message.why is None else message.why.key  # a changing distance does not make a new reason
        if key == self._stopped:
            return
        self._stopped = key
        self._add(message, *(("stop", message.stop_reason) if key else ("go", "goes on")))

    def _edit(self, message: messages.TickMessage, edit: Edit) -> None:
        name = str(getattr(edit, "name", ""))
        if isinstance(edit, MoveBody | Drive):
            last, self._dragged[name] = self._dragged.get(name), message.time
            if (isinstance(edit, Drive) or edit.held) and last is not None and message.time - last <= SAME_DRAG:
                return
        else:
            self._dragged.pop(name, None)
        kind = str(edit.__struct_config__.tag).replace("_", " ")
        self._add(message, "edit", f"{kind} {name}".rstrip(), other=name)

    def _add(
        self, message: messages.TickMessage, kind: str, text: str, *, time: float | None = None, **about: object
    ) -> None:
        at = message.time if time is None else time
        self._found.append((round(at, 6), kind, text, about))


def _key(contact: messages.ContactMessage) -> tuple[float, str, str]:
    return contact.time, contact.body, contact.other


def _named(text: str, message: messages.TickMessage) -> str:
    """The first object, or else target, that a text names."""
    names = [belief.name for belief in message.beliefs] + [task.target for task in message.tasks]
    words = ((name, re.search(rf"(?<!\w){re.escape(name)}(?!\w)", text)) for name in names if name)
    found = [(match.start(), -len(name), name) for name, match in words if match]
    return min(found)[2] if found else ""
