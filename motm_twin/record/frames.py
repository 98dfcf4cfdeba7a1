"""A recording as frames: one for each period, with all that was sent with it. Kept compressed, about 4 kB each."""

import base64
import zlib
from dataclasses import dataclass
from pathlib import Path

import msgspec

from motm_twin.bus.messages import GridInfo
from motm_twin.methods import UNNAMED_METHOD
from motm_twin.record import channels as ch
from motm_twin.record.reader import Entry, read
from motm_twin.record.recording import RunKey, TickPart
from motm_twin.sessions.session import SessionError

_LEVEL = 1  # of zlib
MOST_AT_ONCE = 64 * 1024 * 1024  # bytes that come within one period
_PLAYED = (ch.ROBOT.topic, ch.SCAN.topic, ch.EVENT.topic, ch.METRICS.topic)

Sent = tuple[str, bytes, bytes | None]  # topic, payload as on the bus, attachment


class _GridText(msgspec.Struct):
    info: GridInfo
    cells: str  # base64


class _SceneText(msgspec.Struct):
    scene: msgspec.Raw


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
        """Everything that was sent, the tick first."""
        return msgspec.msgpack.decode(zlib.decompress(self.packed), type=list[Sent])


class Frames(list[Frame]):
    """All frames of a file. Raises SessionError when there is none."""

    def __init__(self, path: str | Path) -> None:
        super().__init__()
        self._open: tuple[TickPart, list[Sent]] | None = None
        self._before: list[Sent] = []  # what came before the first tick
        self._held = 0  # bytes of what came since the last tick
        self._scene = self._grid = -1
        self._method, self._methods = UNNAMED_METHOD, dict[RunKey, str]()
        self._decode = msgspec.json.Decoder(TickPart).decode
        try:
            for entry in read(path):
                self._take(entry)
        except (msgspec.MsgspecError, ValueError, RecursionError) as error:
            problem = error.problem if isinstance(error, SessionError) else f"a message in it is broken: {error}"
            raise SessionError(problem, file=str(path)) from error
        self._close()
        if not self:
            raise SessionError("holds no period of a twin", file=str(path))

    def method(self, frame: Frame) -> str:
        """Name of the method that drove in a frame."""
        return self._methods.get(frame.run, UNNAMED_METHOD)

    def find(self, index: int, near: int) -> int | None:
        """Number of the frame of period ``index`` that is nearest to frame ``near``: of its run if there is one."""
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
        """The frame that is open is whole."""
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


def _sent(entry: Entry) -> Sent | None:
    """A message as it was on the bus; None for what is not played."""
    if entry.topic == ch.GRID.topic:
        grid = msgspec.json.decode(entry.data, type=_GridText)
        return entry.topic, base64.b64decode(grid.cells), msgspec.json.encode(grid.info)
    if entry.topic == ch.SCENE.topic:
        return entry.topic, bytes(msgspec.json.decode(entry.data, type=_SceneText).scene), None
    return (entry.topic, entry.data, None) if entry.topic in _PLAYED else None
