"""Events for the timeline: those of the run that is shown, and of the runs whose past it shares."""

import threading
from collections import deque
from collections.abc import Iterable

from motm_twin.bus.messages import NumberedEvent, TickMessage

KEPT = 1000
BRIEF = 0.5  # [s] a shorter stop is no mark
TOLD = frozenset({"picked", "placed", "arrived", "missed", "lost", "failed", "postponed", "fault", "contact", "cut_in",
                  "stop", "go", "edit", "branch", "done", "error"})  # fmt: skip


class EventMarks:
    """A bounded list of events. All methods may be called from any thread."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._events: deque[NumberedEvent] = deque(maxlen=KEPT)
        self._known: set[int] = set()  # numbers
        self._shares: dict[int, tuple[int, int]] = {}  # run: the one whose past it shares, and its own first period
        self._run, self._since = -1, -1.0
        self.count = 0  # of changes

    def add(self, events: Iterable[NumberedEvent]) -> None:
        """Take events; those that are known already are left out."""
        with self._lock:
            for event in events:
                if event.numbered_since != self._since:  # another server: its runs have the same numbers
                    self._since = event.numbered_since
                    self._events.clear()
                    self._known.clear()
                    self.count += 1
                if event.kind in TOLD and event.seq not in self._known:
                    self._known.add(event.seq)
                    self._events.append(event)
                    self.count += 1
            if len(self._known) > 2 * KEPT:
                self._known = {event.seq for event in self._events}

    def follow(self, tick: TickMessage) -> None:
        """Follow the run of the newest period."""
        if tick.run == self._run:
            return
        with self._lock:
            self._run = tick.run
            past = tick.past if tick.past >= 0 else tick.run - 1
            self._shares[tick.run] = (past if tick.first > 0 else -1, tick.first)
            self.count += 1

    def last(self, count: int) -> list[NumberedEvent]:
        """The last of the present run and its past, oldest first."""
        with self._lock:
            found, run, before = [], self._run, 1 << 62
            while run >= 0:
                past, first = self._shares.get(run, (-1, 0))
                found += [event for event in self._events if event.run == run and first <= event.index < before]
                run, before = past, min(first, before)
        return without_brief_stops(sorted(found, key=lambda event: (event.time, event.seq)))[-count:]


def without_brief_stops(events: list[NumberedEvent]) -> list[NumberedEvent]:
    """The events in order of time, without goes, and without stops that soon end."""
    found: list[NumberedEvent] = []
    stop: NumberedEvent | None = None
    for event in events:
        if event.kind == "go" and stop is not None and event.time - stop.time < BRIEF:
            found.remove(stop)
        stop = event if event.kind == "stop" else None if event.kind == "go" else stop
        if event.kind != "go":
            found.append(event)
    return found
