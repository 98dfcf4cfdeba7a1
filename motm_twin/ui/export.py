"""The last seconds as one HTML file that plays without a server: ``python -m motm_twin.ui.export INPUT OUTPUT``.

A separate process draws the periods of the history as the page does, into a private Viser server, and keeps what that
would have sent. The page is not disturbed.
"""

import html
import os
import secrets
import subprocess
import sys
import tempfile
import threading
import zlib
from collections.abc import Callable
from pathlib import Path

import msgspec
import numpy as np
import viser

from motm_twin.bus.client import Grid, NoSession
from motm_twin.bus.connection import LOOPBACK
from motm_twin.bus.messages import GridInfo, TickMessage
from motm_twin.model.scene import Scene
from motm_twin.ui.history import History, unpacked
from motm_twin.ui.hub import Hub, Shown
from motm_twin.ui.page_server import open_page
from motm_twin.ui.scene.scene_view import SceneView

RATE = 20.0  # [Hz] frames of the recording, at most one per period
TIMEOUT = 180.0  # [s] for the whole export
NICENESS = 10  # more than the viewer's: it is not interactive
LAST = 1.0  # [s] for which the last frame stays
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
    """There is no page; the message says why."""


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
        _draw_elsewhere(source, result, progress, timeout)
        return result.read_bytes()


def record(history: History, scene: Scene, seconds: float, rate: float) -> Recording:
    """The periods of the last seconds [s], thinned to a rate [Hz], with their grids."""
    frames: list[Frame] = []
    grids: list[tuple[GridInfo, bytes]] = []
    known: Grid | None = None  # the last of them
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


def _draw_elsewhere(source: Path, result: Path, progress: Callable[[float], None] | None, timeout: float) -> None:
    command = [sys.executable, "-m", "motm_twin.ui.export", str(source), str(result), str(timeout)]
    told: list[str] = []
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as process:  # noqa: S603
        try:
            assert process.stdout is not None
            for line in process.stdout:
                if line.startswith(_PROGRESS) and progress is not None:
                    progress(float(line[len(_PROGRESS) :]))
                elif line.strip() and not line.startswith((_PROGRESS, "(viser)")):
                    told.append(line.rstrip())
        finally:
            if process.poll() is None and sys.exc_info()[0] is not None:
                process.kill()
    if process.returncode:
        raise ExportFailed(f"the page could not be drawn: {told[-1] if told else f'exit code {process.returncode}'}")


class _NoTwin:
    """A client without a twin: a recording has no visitors and takes no commands."""

    sender, endpoint, alive = "export", "", False

    def status(self) -> None:
        """None."""

    def session(self) -> bytes:
        """Raises NoSession."""
        raise NoSession("this is a recording")


def draw(recording: Recording, server: viser.ViserServer, progress: Callable[[float], None]) -> str:
    """Draw all frames; the HTML that plays them in a browser."""
    scene = msgspec.json.decode(recording.scene, type=Scene)
    hub = Hub(_NoTwin())  # type: ignore[arg-type] - what the view asks of it
    view = SceneView(server, hub)
    read, grids = msgspec.json.Decoder(TickMessage).decode, [unpacked(*entry) for entry in recording.grids]
    serializer, before, first = None, 0.0, 0.0
    count = len(recording.frames)
    tick: TickMessage | None = None
    for number, frame in enumerate(recording.frames, 1):
        tick = read(zlib.decompress(frame.tick))
        grid = grids[frame.grid] if frame.grid >= 0 else None
        if serializer is not None:
            serializer.insert_sleep(max(0.0, tick.time - before))
        shown = Shown(
            state="done", status=None, scene=scene, tick=tick, newest=tick, live=False, view=hub.view, grid=grid
        )
        view.draw(shown, max(0.0, tick.time - before), slow=True)
        if serializer is None:
            serializer, first = server.get_scene_serializer(), tick.time
        before = tick.time
        progress(number / count)
    assert serializer is not None and tick is not None
    serializer.insert_sleep(LAST)
    view.stop()
    hub.stop()
    page = serializer.as_html()
    return _with_caption(page, f"{scene.title or scene.name}, {first:.1f} to {tick.time:.1f} s")


def _with_caption(page: str, caption: str) -> str:
    """The page with a title, and a line in its corner."""
    name = html.escape(caption)
    start, end = page.index("<title>"), page.index("</title>")
    page = page[:start] + f"<title>{name}" + page[end:]
    line = (
        '<div style="position:fixed;left:12px;top:10px;z-index:9;font:13px/1.4 sans-serif;color:#374151;'
        f'background:#ffffffcc;border-radius:6px;padding:3px 9px;pointer-events:none">{name}<br>'
        '<span style="color:#6b7280">recorded with motm-twin; drag to turn, wheel to zoom</span></div>'
    )
    end = page.rindex("</body>")
    return page[:end] + line + page[end:]


def main() -> None:
    """Draw the recording in one file into another."""
    source, result, timeout = Path(sys.argv[1]), Path(sys.argv[2]), float(sys.argv[3])
    os.nice(NICENESS)
    _end_after(timeout)
    recording = msgspec.msgpack.decode(source.read_bytes(), type=Recording)
    server = open_page(LOOPBACK, 0, secrets.token_hex(32))
    told = [-1]

    def progress(share: float) -> None:
        if int(100 * share) > told[0]:
            told[0] = int(100 * share)
            print(f"{_PROGRESS}{share:.2f}", flush=True)

    result.write_text(draw(recording, server, progress), encoding="utf-8")
    server.stop()


def _end_after(timeout: float) -> None:
    def end() -> None:
        print(f"it took more than {timeout:.0f} s", flush=True)
        os._exit(1)

    watch = threading.Timer(timeout, end)
    watch.daemon = True
    watch.start()


if __name__ == "__main__":
    main()
