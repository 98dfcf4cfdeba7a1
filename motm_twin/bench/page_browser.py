"""The page in Chromium with software rendering: how much it loads, how soon the picture is complete, its memory."""

import base64
import io
import os
import shutil
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from PIL import Image

from motm_twin.bench.page_serve import wait_for
from motm_twin.model.geometry import Array

VIEW = {"width": 1280, "height": 800}
FLAGS = ["--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--no-sandbox"]
SMALL = (160, 100)  # pixels to which pictures are reduced before they are compared
SETTLED = 6.0  # [s] without a change: the picture is complete; pieces of it come up to 3 s apart
BLANK = 5.0  # grey levels of standard deviation; an empty page has less
CHANGED, SHARE = 12.0, 0.01  # grey levels, and share of the reduced picture's pixels that may differ by more
LOAD = 90.0  # [s]


@dataclass
class Load:
    """What a first load took. Pictures as the browser showed them: (time [s] since the start, reduced picture)."""

    http_bytes: int = 0
    pictures: list[tuple[float, Array]] = field(default_factory=list)

    @property
    def complete_at(self) -> float:
        """When [s] the picture was first the one that stayed; nan when it never settled or stayed blank."""
        if not self.pictures or np.std(self.pictures[-1][1]) < BLANK:
            return float("nan")
        last = self.pictures[-1][1]
        different = max((at for at, picture in self.pictures if not alike(picture, last)), default=-1.0)
        return min(at for at, _ in self.pictures if at > different)


class Page:
    """The open page, and Chromium's own view of it."""

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

    def heap_mb(self) -> float:
        """What the page's scripts hold [MB], after garbage was collected."""
        self._devtools.send("HeapProfiler.collectGarbage")
        return float(self._devtools.send("Runtime.getHeapUsage")["usedSize"]) / 1e6


def alike(picture: Array, other: Array) -> bool:
    """Whether two reduced pictures show the same, apart from little things."""
    changed = np.abs(picture - other).max(axis=2) > CHANGED
    return bool(changed.mean() <= SHARE)


@contextmanager
def browser() -> Iterator[Page]:
    """Chromium with an empty page. Raises RuntimeError when there is none."""
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
    """A first load in a fresh browser."""
    with browser() as page:
        load = page.load(url)
        wait_for(lambda: load.pictures, 1.0, "picture")
        return load


def _settled(load: Load, now: float) -> bool:
    """Whether the picture has not changed for a while, and is one."""
    return load.pictures != [] and now > SETTLED and now - load.complete_at > SETTLED
