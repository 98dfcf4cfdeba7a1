"""Readers of the page: a websocket client with Viser's protocol, and Chromium with software rendering."""

import base64
import io
import os
import shutil
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, field
from typing import Any

import msgspec
import numpy as np
import viser
import zstandard
from PIL import Image
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from motm_twin.model.geometry import Array
from motm_twin.perf.processes import wait_for
from motm_twin.ui.page_server import COOKIE

MAX_FRAME = 64 * 1024 * 1024  # bytes
POSES = ("SetPositionMessage", "SetOrientationMessage")
CAMERA = {  # looks straight down from 12 m
    "type": "ViewerCameraMessage", "wxyz": [0.0, 1.0, 0.0, 0.0], "position": [0.0, 0.0, 12.0], "fov": 0.8, "near": 0.01,
    "far": 1000.0, "image_height": 800, "image_width": 1280, "look_at": [0.0, 0.0, 0.0],
    "up_direction": [0.0, 1.0, 0.0],
}  # fmt: skip

COUNT = """async (seconds) => {
  const found = { drawn: 0, changed: 0 }, base = "/robot/link/base_link";
  let part = null, start = null, before = "", over = false;
  const from = performance.now() + 4000;
  motm.frames.push((scene) => {
    if (over) return;
    const place = motm.place(base);
    start ??= place;
    if (!part && place && Math.hypot(place[0] - start[0], place[1] - start[1]) > 0.1) scene.traverse((node) => {
      const [x, y, z] = node.matrixWorld.elements.slice(12);
      if (node.isMesh && Math.hypot(x + place[1], y - place[2], z + place[0]) < 1e-3) part ??= node;
    });
    if (part) scene.traverse((node) => node.isMesh && node !== part && node.layers.set(31));
    if (performance.now() < from) return;
    const pose = part?.matrixWorld.elements.join() ?? "";
    found.drawn += 1;
    if (pose !== before) found.changed += 1;
    before = pose;
  });
  await new Promise((done) => setTimeout(done, 4000 + 1000 * seconds));
  over = true;
  return [found.drawn / seconds, found.changed / seconds];
}"""  # pictures per second, and pictures per second in which the base has moved; only the base is drawn
DISPLAY = """(seconds) => new Promise((done) => {
  const began = performance.now();
  let count = 0;
  const next = (now) => {
    if (now - began > 1000 * seconds) return done((1000 * count) / (now - began));
    count += 1;
    requestAnimationFrame(next);
  };
  requestAnimationFrame(next);
})"""  # frames per second of an empty page
LITTLE = {"width": 320, "height": 200}  # [px] a window that is fast to draw in software
Message = dict[str, Any]


class PageReader(AbstractContextManager["PageReader"]):
    """One connected visitor that reads everything. ``decode=False`` only counts bytes, which costs next to nothing."""

    def __init__(self, port: int, *, token: str = "", decode: bool = True) -> None:
        """Connect. ``token``: of the page, if it requires one."""
        self.started = time.monotonic()
        self.bytes = 0
        self.replayed: float | None = None  # [s] from the start until the existing scene had arrived
        self.moving: dict[str, set[str]] = {kind: set() for kind in ("pose", "update")}
        self.widgets: dict[str, Message] = {}  # their creating messages, by uuid
        self.draggable: set[str] = set()
        self.notes: list[str] = []
        self._values: dict[str, Any] = {}
        self._decode, self._changed = decode, threading.Condition()
        self._socket = connect(
            f"ws://127.0.0.1:{port}",
            subprotocols=[f"viser-v{viser.__version__}"],  # type: ignore[list-item]
            max_size=MAX_FRAME,
            compression=None,
            open_timeout=10.0,
            additional_headers={"Cookie": f"{COOKIE}_{port}={token}"} if token else None,
        )
        self.send(CAMERA)  # Viser's sign that a page has loaded
        self._thread = threading.Thread(target=self._read, name="page reader", daemon=True)
        self._thread.start()

    def send(self, message: Message) -> None:
        """Send one message as the page would."""
        self._socket.send(msgspec.msgpack.encode(message))

    def close(self) -> None:
        """Close the connection."""
        self._socket.close()
        self._thread.join(2.0)

    def abort(self) -> None:
        """Drop the connection without closing it."""
        self._socket.socket.shutdown(socket.SHUT_RDWR)
        self.close()

    def __exit__(self, *_: object) -> None:
        self.close()

    def wait(self, condition: Any, timeout: float) -> bool:
        """Wait until a message makes ``condition(self)`` true; False after ``timeout`` [s]."""
        with self._changed:
            return bool(self._changed.wait_for(lambda: condition(self), timeout))

    def moved(self) -> int:
        """Number of scene nodes moved or redrawn since the last call."""
        with self._changed:
            count = len(self.moving["pose"] | self.moving["update"])
            for names in self.moving.values():
                names.clear()
        return count

    def find(self, label: str, kind: str = "") -> str | None:
        """The uuid of the widget with this label (and message type), or None."""
        for uuid, message in list(self.widgets.items()):
            if message["props"].get("label") == label and kind in message["type"]:
                return uuid
        return None

    def options(self, label: str) -> tuple[str, ...]:
        """Entries of a dropdown; none when there is no such list."""
        uuid = self.find(label, "Dropdown")
        return () if uuid is None else tuple(self.widgets[uuid]["props"]["options"])

    def set(self, label: str, value: Any, kind: str = "") -> bool:
        """Click a button or change a widget by its label; False when there is no such widget."""
        uuid = self.find(label, kind)
        if uuid is not None:
            self.send({"type": "GuiUpdateMessage", "uuid": uuid, "updates": {"value": value}})
        return uuid is not None

    def drag(self, node: str, grip: np.ndarray, path: np.ndarray, interval: float) -> float:
        """Drag a scene node from ``grip`` (3,) over points ``path`` (n, 3); returns the time [s] of the last point."""
        self._drag("start", node, grip, grip)
        sent = time.monotonic()
        for point in path:
            time.sleep(interval)
            sent = time.monotonic()
            self._drag("update", node, grip, point)
        self._drag("end", node, grip, path[-1])
        return sent

    def _drag(self, phase: str, node: str, grip: np.ndarray, point: np.ndarray) -> None:
        self.send(
            {
                "type": "SceneNodeDragMessage", "phase": phase, "name": node, "instance_index": None,
                "start_position": [float(value) for value in grip], "start_screen_pos": [0.5, 0.5],
                "end_position": [float(value) for value in point], "end_screen_pos": [0.5, 0.5], "button": "left",
                "modifier": None, "owner": "",
            }
        )  # fmt: skip

    def _read(self) -> None:
        try:
            for frame in self._socket:
                assert isinstance(frame, bytes)
                with self._changed:
                    self.bytes += len(frame)
                    if self._decode:
                        for message in unpack(frame):
                            self._take(message)
                    self._changed.notify_all()
        except ConnectionClosed:
            return

    def _take(self, message: Message) -> None:
        kind = message["type"]
        if kind in POSES:
            self.moving["pose"].add(message["name"])
        elif kind == "SceneNodeUpdateMessage":
            self.moving["update"].add(message["name"])
        elif kind == "ReplayDoneMessage":
            self.replayed = time.monotonic() - self.started
        elif kind == "SetSceneNodeDragBindingsMessage" and message["bindings"]:
            self.draggable.add(message["name"])
        elif kind == "NotificationShowMessage":
            self.notes.append(str(message["props"].get("body", "")))
        elif kind.startswith("Gui") and "uuid" in message and "props" in message:
            self.widgets[message["uuid"]] = message
        elif kind == "GuiUpdateMessage" and message["uuid"] in self.widgets:
            self.widgets[message["uuid"]]["props"].update(message["updates"])


def unpack(frame: bytes) -> list[Message]:
    """The messages of one frame: two sizes, the packed part (MessagePack in zstd), then arrays, which are not read."""
    size, packed = int.from_bytes(frame[:8], "little"), int.from_bytes(frame[8:16], "little")
    inner = zstandard.ZstdDecompressor().decompress(frame[16 : 16 + packed], max_output_size=size)
    return list(msgspec.msgpack.decode(inner)["messages"])


VIEW = {"width": 1280, "height": 800}
FLAGS = ["--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--no-sandbox"]
SMALL = (160, 100)  # [px] to which pictures are reduced before comparison
SETTLED = 6.0  # [s] without a change until a picture counts as complete; parts of it come up to 3 s apart
BLANK = 5.0  # standard deviation in grey levels; an empty page has less
CHANGED, SHARE = 12.0, 0.01  # grey levels, and share of pixels of alike pictures that may differ by more
LOAD = 90.0  # [s] for the picture to settle


@dataclass
class Load:
    """Bytes and pictures of a first load. A picture: (time [s] since the start, reduced picture)."""

    http_bytes: int = 0
    pictures: list[tuple[float, Array]] = field(default_factory=list)

    @property
    def complete_at(self) -> float:
        """Time [s] at which the final picture was first shown; nan when it never settled or stayed blank."""
        if not self.pictures or np.std(self.pictures[-1][1]) < BLANK:
            return float("nan")
        last = self.pictures[-1][1]
        different = max((at for at, picture in self.pictures if not alike(picture, last)), default=-1.0)
        return min(at for at, _ in self.pictures if at > different)


class Page:
    """An open page in Chromium, with its developer tools."""

    def __init__(self, page: Any) -> None:
        self.page = page
        self._devtools = page.context.new_cdp_session(page)

    def load(self, url: str) -> Load:
        """Open the page and watch until its picture has settled. The twin should be paused."""
        load, devtools = Load(), self._devtools
        began = time.monotonic()

        def count(event: dict) -> None:
            load.http_bytes += int(event["encodedDataLength"])

        def picture(event: dict) -> None:
            devtools.send("Page.screencastFrameAck", {"sessionId": event["sessionId"]})
            image = Image.open(io.BytesIO(base64.b64decode(event["data"]))).convert("RGB").resize(SMALL)
            load.pictures.append((time.monotonic() - began, np.asarray(image, dtype=float)))

        devtools.send("Network.enable")
        devtools.on("Network.loadingFinished", count)
        devtools.on("Page.screencastFrame", picture)
        devtools.send("Page.startScreencast", {"format": "jpeg", "quality": 80, "everyNthFrame": 1})
        self.page.goto(url)
        deadline = began + LOAD
        while time.monotonic() < deadline and not _settled(load, time.monotonic() - began):
            self.page.wait_for_timeout(100)
        devtools.send("Page.stopScreencast")
        return load

    def motion(self, url: str, seconds: float, begin: Callable[[], None]) -> tuple[float, float, float]:
        """Rates [1/s] in a small window: of the display, of pictures of the scene, of those in which the robot moved.

        ``begin`` makes the robot drive. Only its base is drawn: software draws a whole scene a few times per second.
        """
        self.page.set_viewport_size(LITTLE)
        display = self.page.evaluate(DISPLAY, 2.0)
        self.page.goto(f"{url}{'&' if '?' in url else '?'}fixedDpr=1")
        self.page.locator(".cover").wait_for(state="detached", timeout=1000.0 * LOAD)
        begin()
        return (display, *self.page.evaluate(COUNT, seconds))

    def heap_mb(self) -> float:
        """Memory of the page's scripts [MB] after a garbage collection."""
        self._devtools.send("HeapProfiler.collectGarbage")
        return float(self._devtools.send("Runtime.getHeapUsage")["usedSize"]) / 1e6


def alike(picture: Array, other: Array) -> bool:
    """True when two reduced pictures are equal except for small differences."""
    changed = np.abs(picture - other).max(axis=2) > CHANGED
    return bool(changed.mean() <= SHARE)


@contextmanager
def browser() -> Iterator[Page]:
    """Chromium with an empty page. Raises RuntimeError without Chromium or Playwright."""
    path = os.environ.get("MOTM_CHROMIUM") or shutil.which("chromium") or shutil.which("chromium-browser")
    if not path:
        raise RuntimeError("no Chromium: set MOTM_CHROMIUM to its path")
    try:
        from playwright.sync_api import sync_playwright
    except ImportError as error:
        raise RuntimeError("no Playwright: install the dev extra") from error
    with sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=path, args=FLAGS)
        try:
            yield Page(chromium.new_page(viewport=VIEW))  # type: ignore[arg-type]
        finally:
            chromium.close()


def first_load(url: str) -> Load:
    """Load a page for the first time in a fresh browser."""
    with browser() as page:
        load = page.load(url)
        wait_for(lambda: load.pictures, 1.0, "picture")
        return load


def _settled(load: Load, now: float) -> bool:
    """True when the picture is not blank and has not changed for `SETTLED`."""
    return load.pictures != [] and now > SETTLED and now - load.complete_at > SETTLED
