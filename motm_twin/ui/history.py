"""The last two minutes: every period as it was sent, so that the page can look back while the robot goes on.

Payloads are kept compressed (about 3 kB each) and read again only when somebody looks at them; what the plots and the
list of events need is read once, when a period arrives. A branch keeps the past that it shares and sets aside what will
not come to pass, until the branch is undone; a reset or another scene (or server) begins anew.
"""

import bisect
import threading
import zlib
from dataclasses import dataclass
from typing import NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from motm_twin.bus.client import Grid
from motm_twin.bus.messages import GRID_VERSION, TICK_VERSION, EventMessage, GridInfo, TickMessage
from motm_twin.model.period import PERIOD
from motm_twin.ui.samples import Part, Sample, sample

PERIODS = 2400  # 120 s
MAX_BYTES = 32_000_000  # of compressed ticks; an ordinary two minutes need a quarter of it
MAX_GRID_BYTES = 8_000_000
LEVEL = 1  # of zlib: 2 % larger than the best level, five times as fast


class Span(NamedTuple):
    """What can be looked at: first and last period, and their times [s]."""

    first: int
    last: int
    first_time: float
    last_time: float


@dataclass(frozen=True)
class _Entry:
    index: int
    time: float
    payload: bytes
    events: tuple[EventMessage, ...]


@dataclass(frozen=True)
class _Map:
    stamp: float
    info: GridInfo
    cells: bytes


@dataclass(frozen=True)
class _Tail:
    """The end of a run that is set aside: where the branch left it, and all from there on."""

    run: int
    index: int
    time: float  # [s] of the last grid that both runs share
    entries: list[_Entry]
    rows: NDArray[np.float64]
    maps: list[_Map]


class History:
    """A ring of periods and of the grids that go with them. All methods may be called from any thread."""

    def __init__(self, *, periods: int = PERIODS, max_bytes: int = MAX_BYTES) -> None:
        self._periods, self._max_bytes = periods, max_bytes
        self._lock = threading.Lock()
        self._read_part = msgspec.json.Decoder(Part).decode
        self._read = msgspec.json.Decoder(TickMessage).decode
        self._entries: list[_Entry] = []
        self._rows = np.empty((2 * periods + 2, len(Sample._fields)))  # of the entries, from the first on
        self._first = 0
        self._bytes, self._map_bytes = 0, 0
        self._run, self._began = -1, 0.0
        self._maps: list[_Map] = []
        self._aside: _Tail | None = None
        self._shown: tuple[_Entry, TickMessage] | None = None
        self._shown_map: tuple[_Map, Grid] | None = None

    def add(self, payload: bytes) -> None:
        """Take a tick as it came. A lower or equal period takes the place of what is there from it on.

        A preview is left out: it is no period that was. Raises ValueError when the tick is of another version.
        """
        part = self._read_part(payload)
        if part.version != TICK_VERSION:
            raise ValueError(f"the history holds {TICK_VERSION!r}, not {part.version!r}")
        if part.preview:
            return
        packed = zlib.compress(payload, LEVEL)
        entry, row = _Entry(part.index, part.time, packed, tuple(part.events)), sample(part)
        with self._lock:
            self._turn(part)
            self._cut(part.index, part.time + 1e-9)
            self._append(entry, row)
            self._bytes += len(packed)
            self._shorten()

    def add_grid(self, cells: bytes, info: bytes) -> None:
        """Take a grid as it came; one that equals the last is not kept twice. Raises ValueError (other version)."""
        read = msgspec.json.decode(info, type=GridInfo)
        if read.version != GRID_VERSION:
            raise ValueError(f"the history holds {GRID_VERSION!r}, not {read.version!r}")
        if len(cells) != read.width * read.height:
            raise ValueError(f"a grid of {read.width} x {read.height} cells came with {len(cells)} bytes")
        packed = _Map(read.stamp, read, zlib.compress(cells, LEVEL))
        with self._lock:
            if read.run < self._run:
                return  # a straggler
            goes_on = (
                read.run == self._run
            )  # so what it takes the place of may be of a run that it shares its past with
            while self._maps and self._maps[-1].stamp > read.stamp and (goes_on or self._maps[-1].info.run == read.run):
                self._map_bytes -= len(self._maps.pop().cells)
            last = self._maps[-1] if self._maps else None
            if last is not None and _same(last, packed):
                return
            self._maps.append(packed)
            self._map_bytes += len(packed.cells)
            while self._map_bytes > MAX_GRID_BYTES:
                self._map_bytes -= len(self._maps.pop(0).cells)

    def at(self, index: int) -> TickMessage | None:
        """The period of this index, or the nearest before it that is kept, or the oldest; None when there is none.

        Asked for the same period again, it gives the same object.
        """
        with self._lock:
            entry = self._find(index)
            if entry is None:
                return None
            if self._shown is None or self._shown[0] is not entry:
                self._shown = entry, self._read(zlib.decompress(entry.payload))
            return self._shown[1]

    def payload_at(self, index: int) -> bytes | None:
        """The bytes of `at`."""
        with self._lock:
            entry = self._find(index)
        return None if entry is None else zlib.decompress(entry.payload)

    def grid_at(self, index: int) -> Grid | None:
        """The grid that was in force in this period."""
        with self._lock:
            entry = self._find(index)
            number = -1 if entry is None else bisect.bisect_right(self._maps, entry.time + 1e-9, key=_stamp) - 1
            if number < 0 and not self._maps:
                return None
            found = self._maps[max(number, 0)]
            if self._shown_map is None or self._shown_map[0] is not found:
                cells = np.frombuffer(zlib.decompress(found.cells), dtype=np.uint8)
                grid = Grid(info=found.info, cells=cells.reshape(found.info.height, found.info.width))
                self._shown_map = found, grid
            return self._shown_map[1]

    @property
    def newest(self) -> int | None:
        """Index of the last period."""
        with self._lock:
            return self._entries[-1].index if self._entries else None

    @property
    def span(self) -> Span | None:
        """What can be looked at; None before the first period."""
        with self._lock:
            if not self._entries:
                return None
            first, last = self._entries[0], self._entries[-1]
            return Span(first.index, last.index, first.time, last.time)

    @property
    def size(self) -> int:
        """Bytes that are kept, without a run that is set aside."""
        with self._lock:
            return self._bytes + self._map_bytes

    def indices(self, seconds: float) -> list[int]:
        """Periods of the last seconds [s], oldest first."""
        with self._lock:
            if not self._entries:
                return []
            start = bisect.bisect_left(self._entries, self._entries[-1].time - seconds - 1e-9, key=_time)
            return [entry.index for entry in self._entries[start:]]

    def samples(self, index: int | None, seconds: float) -> NDArray[np.float64]:
        """What the plots need of the seconds [s] up to a period (None: the newest), shape (n, len(Sample))."""
        with self._lock:
            end = self._count(index)
            if end == 0:
                return np.zeros((0, len(Sample._fields)))
            start = bisect.bisect_left(self._entries, self._entries[end - 1].time - seconds - 1e-9, 0, end, key=_time)
            return self._rows[self._first + start : self._first + end].copy()

    def events(self, index: int | None, count: int) -> list[EventMessage]:
        """The last events up to a period (None: the newest), newest first."""
        found: list[EventMessage] = []
        with self._lock:
            for k in range(self._count(index) - 1, -1, -1):
                found += reversed(self._entries[k].events)
                if len(found) >= count:
                    break
        return found[:count]

    def _count(self, index: int | None) -> int:
        """How many periods there are up to one."""
        return len(self._entries) if index is None else bisect.bisect_right(self._entries, index, key=_index)

    def _append(self, entry: _Entry, row: Sample | NDArray[np.float64]) -> None:
        count = len(self._entries)
        if self._first + count == len(self._rows):
            self._rows[:count] = self._rows[self._first :]
            self._first = 0
        self._rows[self._first + count] = row
        self._entries.append(entry)

    def _find(self, index: int) -> _Entry | None:
        if not self._entries:
            return None
        return self._entries[max(0, bisect.bisect_right(self._entries, index, key=_index) - 1)]

    def _turn(self, part: Part) -> None:
        """Another run: a branch, or its undoing, goes on from the past it shares; anything else has none."""
        if (part.run, part.began) == (self._run, self._began):
            return
        newer = part.run > self._run
        ahead = [kept for kept in self._maps if newer and kept.info.run == part.run]  # came before its tick
        self._maps = [kept for kept in self._maps if kept.info.run < part.run]
        goes_on, aside = newer and 0 <= self._run and part.began == self._began, self._aside
        if goes_on and aside is not None and part.past == aside.run:
            self._aside = self._take_off(aside.index, aside.time)
            self._put_back(aside)
        elif goes_on and part.past in (-1, self._run):
            self._aside = self._take_off(part.first, part.time - (part.index - part.first) * PERIOD - 1e-9)
        else:
            self._entries, self._bytes, self._maps, self._aside = [], 0, [], None
        self._run, self._began = part.run, part.began
        self._maps += ahead
        self._map_bytes = sum(len(kept.cells) for kept in self._maps)

    def _take_off(self, index: int, time: float) -> _Tail:
        """Cut, and give what was cut off."""
        start = bisect.bisect_left(self._entries, index, key=_index)
        rows = self._rows[self._first + start : self._first + len(self._entries)].copy()
        later = self._maps[bisect.bisect_right(self._maps, time, key=_stamp) :]
        tail = _Tail(self._run, index, time, self._entries[start:], rows, later)
        self._cut(index, time)
        return tail

    def _put_back(self, tail: _Tail) -> None:
        """Append what was cut off; what lies before it is the past that it had."""
        for entry, row in zip(tail.entries, tail.rows, strict=True):
            self._append(entry, row)
            self._bytes += len(entry.payload)
        self._maps += tail.maps

    def _cut(self, index: int, time: float) -> None:
        """Forget the periods from this one on, and the grids of later times [s]."""
        if not self._entries or self._entries[-1].index < index:
            return
        start = bisect.bisect_left(self._entries, index, key=_index)
        self._bytes -= sum(len(entry.payload) for entry in self._entries[start:])
        del self._entries[start:]
        keep = bisect.bisect_right(self._maps, time, key=_stamp)
        self._map_bytes -= sum(len(kept.cells) for kept in self._maps[keep:])
        del self._maps[keep:]

    def _shorten(self) -> None:
        gone = 0
        while len(self._entries) - gone > 1 and (
            len(self._entries) - gone > self._periods or self._bytes > self._max_bytes
        ):
            self._bytes -= len(self._entries[gone].payload)
            gone += 1
        if gone == 0:
            return
        del self._entries[:gone]
        self._first += gone
        old = bisect.bisect_right(self._maps, self._entries[0].time + 1e-9, key=_stamp) - 1  # still in force
        if old > 0:
            self._map_bytes -= sum(len(kept.cells) for kept in self._maps[:old])
            del self._maps[:old]


def _index(entry: _Entry) -> int:
    return entry.index


def _time(entry: _Entry) -> float:
    return entry.time


def _stamp(kept: _Map) -> float:
    return kept.stamp


def _same(a: _Map, b: _Map) -> bool:
    """Whether two grids are alike but for their times."""
    return a.cells == b.cells and msgspec.structs.replace(a.info, stamp=b.info.stamp) == b.info
