"""The last two minutes: every period as it was sent, so that the page can look back while the robot goes on.

Payloads are kept compressed (about 3 kB each) and decoded only when shown; the numbers of the plots
and the list of events are read once, when a period arrives. A branch keeps the shared past and sets aside the rest
until the branch is undone; a reset or another scene (or server) starts afresh. The events of the timeline are those of
the run that is shown, and of the runs whose past it shares.
"""

import bisect
import math
import threading
import time
import zlib
from collections import deque, namedtuple
from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache
from operator import attrgetter
from typing import NamedTuple, Protocol

import msgspec
import numpy as np
from numpy.typing import NDArray

from motm_twin.bus import messages as bus
from motm_twin.bus.client import Grid
from motm_twin.model.plant import PERIOD

PERIODS = 2400  # 120 s
MAX_BYTES = 32_000_000  # of compressed ticks; an ordinary two minutes need a quarter of it
MAX_GRID_BYTES = 8_000_000
_INDEX, _TIME, _STAMP = (attrgetter(name) for name in ("index", "time", "stamp"))  # sort keys of the entries and grids
LEVEL = 1  # of zlib: 2 % larger than the best level, five times as fast
STAGES = ("map", "place", "plan", "arm", "monitor")  # of a period, whose computing time is their sum


class _Robot(msgspec.Struct, frozen=True):
    twist: bus.Vector
    dq: bus.Vector


class _Arm(msgspec.Struct, frozen=True):
    slack: list[bus.MaybeNumber]
    obstacle_distance: bus.MaybeNumber


class Part(msgspec.Struct, frozen=True):
    """The fields of a TickMessage that are needed."""

    version: str
    run: int
    index: int
    time: float
    robot: _Robot
    arm: list[_Arm]
    events: list[bus.EventMessage]
    stage_ms: dict[str, float]
    preview: bool
    began: float = 0.0
    first: int = 0
    past: int = -1
    forces: bus.ForcesMessage | None = None


JOINTS = tuple(f"dq{k}" for k in range(1, 8))
Sample = namedtuple(
    "Sample",
    ("time", "speed", "yaw_rate", *JOINTS, "distance", "linear_slack", "angular_slack", *STAGES, "period",
     "left", "right", "torque", "wrist"),
)  # fmt: skip
Sample.__doc__ = """One period as numbers, nan where there is none.

Time [s], forward speed [m/s], yaw rate and rates of the arm's joints [rad/s]; distance of the gripper to the nearest
seen obstacle [m] and slack [m/s], [rad/s], the worst of the period; computing times [ms]. Under contact dynamics also
forces of the pads on the object between them [N], external torque of the joint that feels most [Nm], force at the
wrist [N].
"""


def sample(part: Part) -> Sample:
    """The numbers of one period."""
    dq = [*part.robot.dq, *[math.nan] * 7][:7]
    distances = [step.obstacle_distance for step in part.arm if step.obstacle_distance is not None]
    slacks = [step.slack for step in part.arm if len(step.slack) == 6 and None not in step.slack]
    ms, felt = part.stage_ms, part.forces
    torque = math.nan if felt is None else max(map(abs, felt.external_torque), default=math.nan)
    return Sample(
        part.time,
        *part.robot.twist,
        *dq,
        min(distances, default=math.nan),
        max((math.hypot(*slack[:3]) for slack in slacks), default=math.nan),  # type: ignore[arg-type]
        max((math.hypot(*slack[3:]) for slack in slacks), default=math.nan),  # type: ignore[arg-type]
        *(ms.get(stage, math.nan) for stage in STAGES),
        ms.get("period", math.nan),
        *((math.nan,) * 4 if felt is None else (*felt.fingers, torque, felt.wrist[0])),
    )


class Span(NamedTuple):
    """Range of available periods: the first and last, and their times [s]."""

    first: int
    last: int
    first_time: float
    last_time: float


@dataclass(frozen=True, eq=False)
class _Entry:
    index: int
    time: float
    payload: bytes
    events: tuple[bus.EventMessage, ...]
    sample: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class _Map:
    stamp: float
    info: bus.GridInfo
    cells: bytes


@dataclass(frozen=True)
class _Tail:
    """The part of a run that a branch has set aside: everything from the branching point on."""

    run: int
    index: int
    time: float  # [s] of the last grid that both runs share
    entries: list[_Entry]
    maps: list[_Map]


class History:
    """A ring of periods and of the grids that go with them. All methods may be called from any thread."""

    def __init__(self, *, periods: int = PERIODS, max_bytes: int = MAX_BYTES) -> None:
        self._periods, self._max_bytes = periods, max_bytes
        self._lock = threading.Lock()
        self._read_part, read = msgspec.json.Decoder(Part).decode, msgspec.json.Decoder(bus.TickMessage).decode
        self._read = lru_cache(1)(lambda entry: read(zlib.decompress(entry.payload)))  # the shown period, decoded
        self._unpack = lru_cache(1)(lambda kept: unpacked(kept.info, kept.cells))
        self._entries: list[_Entry] = []
        self._bytes, self._map_bytes = 0, 0
        self._run, self._began = -1, 0.0
        self._maps: list[_Map] = []
        self._aside: _Tail | None = None

    def add(self, payload: bytes) -> None:
        """Take a raw tick. It replaces all kept periods with the same or a higher index.

        Previews are left out. Raises ValueError for a tick of another version.
        """
        part = self._read_part(payload)
        if part.version != bus.TICK_VERSION:
            raise ValueError(f"the history holds {bus.TICK_VERSION!r}, not {part.version!r}")
        if part.preview:
            return
        packed = zlib.compress(payload, LEVEL)
        entry = _Entry(part.index, part.time, packed, tuple(part.events), np.array(sample(part)))
        with self._lock:
            self._switch_run(part)
            self._cut(part.index, part.time + 1e-9)
            self._entries.append(entry)
            self._bytes += len(packed)
            self._shorten()

    def add_grid(self, cells: bytes, info: bytes) -> None:
        """Take a raw grid, unless it equals the last. Raises ValueError (other version)."""
        read = msgspec.json.decode(info, type=bus.GridInfo)
        if read.version != bus.GRID_VERSION:
            raise ValueError(f"the history holds {bus.GRID_VERSION!r}, not {read.version!r}")
        if len(cells) != read.width * read.height:
            raise ValueError(f"a grid of {read.width} x {read.height} cells came with {len(cells)} bytes")
        packed = _Map(read.stamp, read, zlib.compress(cells, LEVEL))
        with self._lock:
            if read.run < self._run:
                return  # a late grid of an earlier run
            any_run = read.run == self._run  # it may replace grids of a run whose past it shares
            while self._maps and self._maps[-1].stamp > read.stamp and (any_run or self._maps[-1].info.run == read.run):
                self._map_bytes -= len(self._maps.pop().cells)
            last = self._maps[-1] if self._maps else packed
            last_info = msgspec.structs.replace(last.info, stamp=read.stamp)
            if last is not packed and last.cells == packed.cells and last_info == read:
                return  # they differ in their times only
            self._maps.append(packed)
            self._map_bytes += len(packed.cells)
            while self._map_bytes > MAX_GRID_BYTES:
                self._map_bytes -= len(self._maps.pop(0).cells)

    def at(self, index: int) -> bus.TickMessage | None:
        """The period of this index, else the nearest kept one before it, else the oldest; None when there is none.

        Repeated calls return the same object.
        """
        with self._lock:
            entry = self._find(index)
            return None if entry is None else self._read(entry)

    def payload_at(self, index: int) -> bytes | None:
        """The raw tick of the period that `at` returns."""
        with self._lock:
            entry = self._find(index)
        return None if entry is None else zlib.decompress(entry.payload)

    def grid_at(self, index: int) -> Grid | None:
        """The grid in force in this period."""
        with self._lock:
            entry = self._find(index)
            number = -1 if entry is None else bisect.bisect_right(self._maps, entry.time + 1e-9, key=_STAMP) - 1
            return self._unpack(self._maps[max(number, 0)]) if self._maps else None

    @property
    def span(self) -> Span | None:
        """Range of available periods; None before the first one."""
        with self._lock:
            if not self._entries:
                return None
            first, last = self._entries[0], self._entries[-1]
            return Span(first.index, last.index, first.time, last.time)

    def indices(self, seconds: float) -> list[int]:
        """Periods of the last seconds [s], oldest first."""
        with self._lock:
            if not self._entries:
                return []
            start = bisect.bisect_left(self._entries, self._entries[-1].time - seconds - 1e-9, key=_TIME)
            return [entry.index for entry in self._entries[start:]]

    def samples(self, index: int | None, seconds: float) -> NDArray[np.float64]:
        """Numbers for the plots of the seconds [s] up to a period (None: the newest), shape (n, len(Sample))."""
        with self._lock:
            end = self._count(index)
            if end == 0:
                return np.zeros((0, len(Sample._fields)))
            start = bisect.bisect_left(self._entries, self._entries[end - 1].time - seconds - 1e-9, 0, end, key=_TIME)
            return np.array([entry.sample for entry in self._entries[start:end]])

    def events(self, index: int | None, count: int) -> list[bus.EventMessage]:
        """The last events up to a period (None: the newest), newest first."""
        found: list[bus.EventMessage] = []
        with self._lock:
            for k in range(self._count(index) - 1, -1, -1):
                found += reversed(self._entries[k].events)
                if len(found) >= count:
                    break
        return found[:count]

    def _count(self, index: int | None) -> int:
        """Number of kept periods up to this index (None: all)."""
        return len(self._entries) if index is None else bisect.bisect_right(self._entries, index, key=_INDEX)

    def _find(self, index: int) -> _Entry | None:
        if not self._entries:
            return None
        return self._entries[max(0, bisect.bisect_right(self._entries, index, key=_INDEX) - 1)]

    def _switch_run(self, part: Part) -> None:
        """Start another run: a branch or its undoing continues from the shared past; anything else starts empty."""
        if (part.run, part.began) == (self._run, self._began):
            return
        newer = part.run > self._run
        ahead = [kept for kept in self._maps if newer and kept.info.run == part.run]  # arrived before its first tick
        self._maps = [kept for kept in self._maps if kept.info.run < part.run]
        goes_on, aside = newer and 0 <= self._run and part.began == self._began, self._aside
        if goes_on and aside is not None and part.past == aside.run:
            self._aside = self._cut_tail(aside.index, aside.time)
            self._entries += aside.entries  # they follow on the same past as before
            self._bytes += sum(len(entry.payload) for entry in aside.entries)
            self._maps += aside.maps
        elif goes_on and part.past in (-1, self._run):
            self._aside = self._cut_tail(part.first, part.time - (part.index - part.first) * PERIOD - 1e-9)
        else:
            self._entries, self._bytes, self._maps, self._aside = [], 0, [], None
        self._run, self._began = part.run, part.began
        self._maps += ahead
        self._map_bytes = sum(len(kept.cells) for kept in self._maps)

    def _cut_tail(self, index: int, time: float) -> _Tail:
        """Cut off the periods from ``index`` on and the grids after ``time`` [s], and return them."""
        start = bisect.bisect_left(self._entries, index, key=_INDEX)
        later = self._maps[bisect.bisect_right(self._maps, time, key=_STAMP) :]
        tail = _Tail(self._run, index, time, self._entries[start:], later)
        self._cut(index, time)
        return tail

    def _cut(self, index: int, time: float) -> None:
        """Forget the periods from this one on, and the grids of later times [s]."""
        if not self._entries or self._entries[-1].index < index:
            return
        start = bisect.bisect_left(self._entries, index, key=_INDEX)
        self._bytes -= sum(len(entry.payload) for entry in self._entries[start:])
        del self._entries[start:]
        keep = bisect.bisect_right(self._maps, time, key=_STAMP)
        self._map_bytes -= sum(len(kept.cells) for kept in self._maps[keep:])
        del self._maps[keep:]

    def _shorten(self) -> None:
        entries, before = self._entries, len(self._entries)
        while len(entries) > 1 and (len(entries) > self._periods or self._bytes > self._max_bytes):
            self._bytes -= len(entries.pop(0).payload)
        if len(entries) == before:
            return
        old = bisect.bisect_right(self._maps, entries[0].time + 1e-9, key=_STAMP) - 1  # still in force
        if old > 0:
            self._map_bytes -= sum(len(kept.cells) for kept in self._maps[:old])
            del self._maps[:old]


def unpacked(info: bus.GridInfo, cells: bytes) -> Grid:
    """A grid whose cells were compressed."""
    flat = np.frombuffer(zlib.decompress(cells), dtype=np.uint8)
    return Grid(info=info, cells=flat.reshape(info.height, info.width))


class ShownPeriod(Protocol):
    """Holds the period shown; None is the newest."""

    at: int | None


class Playback:
    """Moves ``view.at`` through the history, for all visitors."""

    def __init__(self, view: ShownPeriod) -> None:
        self._view = view
        self._speed, self._place, self._last = 0.0, 0.0, 0.0

    @property
    def playing(self) -> bool:
        """True while the shown period advances by itself."""
        return self._speed > 0.0 and self._view.at is not None

    def play(self, speed: float, span: Span | None) -> None:
        """Go on from the shown period (from the oldest one when the newest is shown), ``speed`` times real time."""
        if span is None:
            return
        if self._view.at is None or self._view.at >= span.last:
            self._view.at = span.first
        self._speed, self._place, self._last = speed, float(self._view.at), time.monotonic()

    def pause(self) -> None:
        """Stay at the shown period."""
        self._speed = 0.0

    def live(self) -> None:
        """Return to the newest period."""
        self._speed = 0.0
        self._view.at = None

    def look(self, seconds: float, span: Span | None) -> None:
        """Show the period that lies ``seconds`` [s] before the newest one; 0 is the newest."""
        self._speed = 0.0
        if span is None or seconds < PERIOD / 2:
            self._view.at = None
            return
        self._view.at = max(span.first, span.last - round(seconds / PERIOD))

    def step(self, periods: int, span: Span | None) -> None:
        """Show a later or earlier period."""
        self._speed = 0.0
        if span is None:
            return
        at = span.last if self._view.at is None else self._view.at
        at = max(span.first, at + periods)
        self._view.at = None if at >= span.last and periods > 0 else min(at, span.last)

    def advance(self, span: Span | None, now: float | None = None) -> None:
        """Advance the playback; call it often. It ends at the newest period."""
        now = time.monotonic() if now is None else now
        if not self.playing or span is None or self._view.at is None:
            self._speed = 0.0 if self._view.at is None else self._speed
            return
        self._place = max(self._place, float(span.first)) + self._speed * (now - self._last) / PERIOD
        self._last = now
        if self._place >= span.last:
            self.live()
        else:
            self._view.at = int(self._place)


KEPT = 1000
BRIEF = 0.5  # [s] shorter stops get no mark
TOLD = frozenset({"picked", "placed", "arrived", "missed", "lost", "failed", "postponed", "fault", "contact", "cut_in",
                  "stop", "go", "edit", "branch", "done", "error"})  # fmt: skip


class EventMarks:
    """A bounded list of events. All methods may be called from any thread."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._events: deque[bus.NumberedEvent] = deque(maxlen=KEPT)
        self._known: set[int] = set()  # numbers of the events taken
        self._shares: dict[int, tuple[int, int]] = {}  # run: (run whose past it shares, own first period)
        self._run, self._since = -1, -1.0
        self.count = 0  # number of changes so far

    def add(self, events: Iterable[bus.NumberedEvent]) -> None:
        """Take events; those that are known already are left out."""
        with self._lock:
            for event in events:
                if event.numbered_since != self._since:  # another server counts its runs from the same number
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

    def follow(self, tick: bus.TickMessage) -> None:
        """Follow the run of the newest period."""
        if tick.run == self._run:
            return
        with self._lock:
            self._run = tick.run
            past = tick.past if tick.past >= 0 else tick.run - 1
            self._shares[tick.run] = (past if tick.first > 0 else -1, tick.first)
            self.count += 1

    def last(self, count: int) -> list[bus.NumberedEvent]:
        """The last ``count`` events of the present run and its past, oldest first."""
        with self._lock:
            found, run, before = [], self._run, 1 << 62
            while run >= 0:
                past, first = self._shares.get(run, (-1, 0))
                found += [event for event in self._events if event.run == run and first <= event.index < before]
                run, before = past, min(first, before)
        return without_brief_stops(sorted(found, key=lambda event: (event.time, event.seq)))[-count:]


def without_brief_stops(events: list[bus.NumberedEvent]) -> list[bus.NumberedEvent]:
    """Events without those of kind "go", and without stops shorter than `BRIEF`; ``events`` are in order of time."""
    found: list[bus.NumberedEvent] = []
    stop: bus.NumberedEvent | None = None
    for event in events:
        if event.kind == "go" and stop is not None and event.time - stop.time < BRIEF:
            found.remove(stop)
        stop = event if event.kind == "stop" else None if event.kind == "go" else stop
        if event.kind != "go":
            found.append(event)
    return found
