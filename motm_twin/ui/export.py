"""The last seconds as one HTML file that plays without a server: ``python -m motm_twin.ui.export INPUT OUTPUT``.

A separate process draws the periods of the history into a private Viser server, as the viewer does, and records the
messages that this server would send. In the file, web_assets/page/player.js replays them, and the page looks like the
live one, with timeline and legend. The live page is not disturbed.
"""

import base64
import gzip
import hashlib
import html
import io
import itertools
import os
import secrets
import subprocess
import sys
import tempfile
import threading
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import viser
from PIL import Image
from viser.infra import StateSerializer

from motm_twin.bus.client import Grid, NoSession
from motm_twin.bus.connection import LOOPBACK
from motm_twin.bus.messages import GridInfo, TickMessage
from motm_twin.model.geometry import Array
from motm_twin.model.scene import Scene
from motm_twin.ui.colours import ground_table
from motm_twin.ui.history import History, unpacked
from motm_twin.ui.hub import LAYERS, Hub, Shown, names_of
from motm_twin.ui.page_server import open_page, scripts
from motm_twin.ui.panel.why_tab import says
from motm_twin.ui.scene.cameras import ASPECT
from motm_twin.ui.scene.scene_view import MAP, SceneView

RATE = 10.0  # [Hz] frames of the recording: the page glides between them
TIMEOUT = 180.0  # [s] for the whole export
NICENESS = 10  # more than the viewer's: it is not interactive
LONGEST_GAP = 60_000  # cells
FINEST, LARGE = 2.0**-13, 16384  # rounding step of numbers; [bytes] larger arrays (meshes) stay exact
PLAYED = ("smooth.js", "view.js", "overlay.js", "player.js")  # scripts of a page without a server, in this order
_PROGRESS = "progress "


class Frame(msgspec.Struct, frozen=True):
    """One period to be drawn."""

    tick: bytes  # TickMessage as JSON, zlib
    grid: int  # number of its grid, -1 without one


class Recording(msgspec.Struct, frozen=True):
    """Input of the drawing process."""

    scene: bytes  # Scene as JSON
    frames: list[Frame]
    grids: list[tuple[GridInfo, bytes]]  # cells, zlib


class ExportFailed(Exception):
    """The page could not be made; the message says why."""


def export_html(
    history: History,
    scene: Scene,
    seconds: float,
    progress: Callable[[float], None] | None = None,
    *,
    rate: float = RATE,
    timeout: float = TIMEOUT,
) -> bytes:
    """The page of the last seconds [s]. Blocks; ``progress`` is called with 0 to 1, from this thread.

    Raises ExportFailed.
    """
    recording = record(history, scene, seconds, rate)
    if not recording.frames:
        raise ExportFailed("there is nothing to export yet: let the robot move first")
    with tempfile.TemporaryDirectory(prefix="motm-export-") as folder:
        source, result = Path(folder) / "recording", Path(folder) / "page.html"
        source.write_bytes(msgspec.msgpack.encode(recording))
        _draw_in_subprocess(source, result, progress, timeout)
        return result.read_bytes()


def record(history: History, scene: Scene, seconds: float, rate: float) -> Recording:
    """The periods of the last seconds [s], thinned to a rate [Hz], with their grids."""
    frames: list[Frame] = []
    grids: list[tuple[GridInfo, bytes]] = []
    known: Grid | None = None  # the newest of ``grids``
    last = -np.inf
    for index in history.indices(seconds):
        tick, grid = history.at(index), history.grid_at(index)
        payload = history.payload_at(index)
        if tick is None or payload is None or tick.index != index or tick.time - last < 1.0 / rate - 1e-6:
            continue
        last = tick.time
        if grid is not None and grid is not known:
            known = grid
            grids.append((grid.info, zlib.compress(grid.cells.tobytes(), 1)))
        frames.append(Frame(zlib.compress(payload, 1), -1 if grid is None else len(grids) - 1))
    return Recording(msgspec.json.encode(scene), frames, grids)


def _draw_in_subprocess(source: Path, result: Path, progress: Callable[[float], None] | None, timeout: float) -> None:
    command = [sys.executable, "-m", "motm_twin.ui.export", str(source), str(result), str(timeout)]
    printed: list[str] = []
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as process:  # noqa: S603
        try:
            assert process.stdout is not None
            for line in process.stdout:
                if line.startswith(_PROGRESS) and progress is not None:
                    progress(float(line[len(_PROGRESS) :]))
                elif line.strip() and not line.startswith((_PROGRESS, "(viser)")):
                    printed.append(line.rstrip())
        finally:
            if process.poll() is None and sys.exc_info()[0] is not None:
                process.kill()
    if process.returncode:
        reason = printed[-1] if printed else f"exit code {process.returncode}"
        raise ExportFailed(f"the page could not be drawn: {reason}")


class _NoTwin:
    """A client without a twin: a recording has no visitors and takes no commands."""

    sender, endpoint, alive = "export", "", False

    def status(self) -> None:
        """Always None."""

    def session(self) -> bytes:
        """Raises NoSession."""
        raise NoSession("this is a recording")


def draw(recording: Recording, server: viser.ViserServer, progress: Callable[[float], None]) -> str:
    """Draw all frames; the HTML that plays them in a browser."""
    scene = msgspec.json.decode(recording.scene, type=Scene)
    hub = Hub(_NoTwin())  # type: ignore[arg-type] - it has all that the view calls
    view = SceneView(server, hub)
    read, grids = msgspec.json.Decoder(TickMessage).decode, [unpacked(*entry) for entry in recording.grids]
    ticks = [read(zlib.decompress(frame.tick)) for frame in recording.frames]
    serializer = None
    for number, (tick, frame) in enumerate(zip(ticks, recording.frames, strict=True)):
        gap = max(0.0, tick.time - (ticks[number - 1].time if number else 0.0))
        grid = grids[frame.grid] if frame.grid >= 0 else None
        if serializer is not None:
            serializer.insert_sleep(gap)
        shown = Shown(
            state="done", status=None, scene=scene, tick=tick, newest=tick, live=False, view=hub.view, grid=grid
        )
        view.draw(shown, gap, slow=True)
        serializer = serializer or server.get_scene_serializer()
        progress((number + 1) / len(ticks))
    assert serializer is not None
    view.stop()
    hub.stop()
    return page(serializer, scene, ticks)


def page(serializer: StateSerializer, scene: Scene, ticks: list[TickMessage]) -> str:
    """The HTML that plays what was sent while these periods were drawn."""
    first, last = ticks[0].time, ticks[-1].time
    packer = Packer(serializer)
    recorded = [(round(first + time, 3), packer.message(message)) for time, message in serializer._messages]
    ground, buffers = packer.ground, packer.buffers
    height, width = ground.size
    sentences = itertools.groupby(ticks, lambda tick: says(tick, scene))  # each with the time of its first period
    content = {
        "first": first,
        "last": last,
        "step": (last - first) / max(1, len(ticks) - 1),
        "messages": recorded,
        "ground": packer.plain({"height": height, "width": width, "palette": ground.palette, "steps": ground.steps}),
        "lengths": [len(buffer) for buffer in buffers],
        "says": [(round(next(same).time, 2), sentence) for sentence, same in sentences],
        "aspect": ASPECT,
        "legend": [layer for layer in LAYERS if layer.on],
        "names": names_of(scene),
        "events": [(round(event.time, 2), event.kind, event.text) for tick in ticks for event in tick.events],
    }
    text = msgspec.json.encode(content)
    parts = [len(text).to_bytes(4, "little") + text, *buffers]  # each is padded to a multiple of 8 bytes
    whole = b"".join(part + bytes(-len(part) % 8) for part in parts)
    packed = base64.b64encode(gzip.compress(whole, 9, mtime=0)).decode()
    title = html.escape(f"{scene.title or scene.name}, {first:.1f} to {last:.1f} s")
    client = (Path(viser.__file__).parent / "client" / "build" / "index.html").read_text(encoding="utf-8")
    before, head, after = client.partition("<head>")
    start, end = after.index("<title>"), after.index("</title>")
    after = f"{after[:start]}<title>{title}{after[end:]}"
    data = f'<script id="motm-recording" type="application/octet-stream">{packed}</script>'
    return before + head + scripts(PLAYED) + data + after


class Packer:
    """Converts messages of Viser to JSON, and collects the arrays that they refer to, each once, in `buffers`.

    Floating-point numbers are rounded to `FINEST`: the difference is invisible, and the page is a third smaller.
    """

    def __init__(self, serializer: StateSerializer) -> None:
        self._given = serializer._binary_buffers
        self._numbers: dict[bytes, int] = {}
        self.buffers: list[bytes] = []
        self.ground = Ground()

    def message(self, message: dict[str, Any]) -> Any:
        """One message; a picture of the ground becomes its number in `ground`."""
        data = message.get("updates", {}).get("_data")
        if message.get("name") == MAP and data is not None:
            step = self.ground.add(bytes(self._given[data["__binary_index"]] if isinstance(data, dict) else data))
            if step is not None:
                return {**message, "updates": {"_data": {"ground": step}}}
        return self.plain(message)

    def plain(self, value: Any) -> Any:
        """A value of a message in a form for JSON: arrays and bytes become numbers of entries in `buffers`."""
        if isinstance(value, np.ndarray):
            return {"__binary_index": self._number(value.tobytes()), "dtype": value.dtype.str}
        if isinstance(value, bytes | memoryview):
            return {"__binary_index": self._number(value), "dtype": "|u1"}
        if isinstance(value, dict):
            if "__binary_index" in value:
                data = self._given[value["__binary_index"]]
                if value["dtype"] == "<f4" and len(data) < LARGE:
                    data = memoryview(np.round(np.frombuffer(data, "<f4") / FINEST) * np.float32(FINEST)).cast("B")
                return {**value, "__binary_index": self._number(data)}
            return {key: self.plain(entry) for key, entry in value.items()}
        if isinstance(value, float):
            return round(value / FINEST) * FINEST
        return [self.plain(entry) for entry in value] if isinstance(value, list | tuple) else value

    def _number(self, data: bytes | memoryview) -> int:
        key = hashlib.sha256(data).digest()
        if key not in self._numbers:
            self._numbers[key] = len(self.buffers)
            self.buffers.append(bytes(data))
        return self._numbers[key]


class Ground:
    """Pictures of the ground, each stored as the cells that differ from the picture before.

    Stored as whole pictures they would be two thirds of the page.
    """

    def __init__(self) -> None:
        self.steps: list[tuple[Array, Array]] = []  # per picture: gaps between changed cells, XOR of old and new value
        self.palette = ground_table()
        self._codes = self.palette.view("<u4")[:, 0]
        self._order = np.argsort(self._codes, kind="stable")
        self._cells = np.zeros((0, 0), dtype=np.uint8)

    @property
    def size(self) -> tuple[int, int]:
        """Height and width [cells]."""
        return self._cells.shape  # type: ignore[return-value]

    def add(self, png: bytes) -> int | None:
        """Number of this picture; None when its size differs from the first one's, or it has unknown colours."""
        picture = np.ascontiguousarray(Image.open(io.BytesIO(png)).convert("RGBA")).view("<u4")[..., 0]
        found = np.searchsorted(self._codes, picture, sorter=self._order).clip(max=len(self._order) - 1)
        cells = self._order[found].astype(np.uint8)
        before = self._cells if self.steps else np.zeros_like(cells)
        if cells.shape != before.shape or (self._codes[cells] != picture).any():
            return None
        change = (cells ^ before).ravel()
        fill = np.arange(LONGEST_GAP, len(change), LONGEST_GAP)  # unchanged cells that keep every gap short enough
        at = np.union1d(np.flatnonzero(change), fill)
        self.steps.append((np.diff(at, prepend=0).astype(np.uint16), change[at]))
        self._cells = cells
        return len(self.steps) - 1


def main() -> None:
    """Draw the recording in one file into another."""
    source, result, timeout = Path(sys.argv[1]), Path(sys.argv[2]), float(sys.argv[3])
    os.nice(NICENESS)
    shown = -1

    def end() -> None:
        print(f"it took more than {timeout:.0f} s", flush=True)
        os._exit(1)

    def progress(share: float) -> None:
        nonlocal shown
        if int(100 * share) > shown:
            shown = int(100 * share)
            print(f"{_PROGRESS}{share:.2f}", flush=True)

    watch = threading.Timer(timeout, end)
    watch.daemon = True
    watch.start()
    recording = msgspec.msgpack.decode(source.read_bytes(), type=Recording)
    server = open_page(LOOPBACK, 0, secrets.token_hex(32))
    result.write_text(draw(recording, server, progress), encoding="utf-8")
    server.stop()


if __name__ == "__main__":
    main()
