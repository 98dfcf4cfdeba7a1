"""A person at the page, for tests: Chromium, a mouse that aims at points of the world, a client to check the twin."""

import os
import shutil
import subprocess
import sys
import time
from contextlib import contextmanager

import numpy as np
import pytest

from motm_twin.bus.client import TwinClient
from motm_twin.bus.health import page_answers
from motm_twin.bus.session import free_port
from motm_twin.ui.camera import FIELD_OF_VIEW, overview

VIEW = {"width": 1280, "height": 800}
FLAGS = ["--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--no-sandbox"]


def chromium_path():
    """Path of Chromium, or a skip (a failure where a browser is required) that says why."""
    found = os.environ.get("MOTM_CHROMIUM") or shutil.which("chromium") or shutil.which("chromium-browser")
    if found:
        return found
    reason = "no Chromium: set MOTM_CHROMIUM to its path"
    if os.environ.get("MOTM_REQUIRE_BROWSER") == "1":
        pytest.fail(f"MOTM_REQUIRE_BROWSER=1, but {reason}")
    pytest.skip(reason)


def until(condition, timeout, what):
    """Wait for something that must happen; how fast is not the test's business."""
    deadline = time.monotonic() + timeout
    while time.monotonic() < deadline:
        value = condition()
        if value:
            return value
        time.sleep(0.05)
    raise AssertionError(f"after {timeout:.0f} s: {what}")


@contextmanager
def serving(scene, *options):
    """`motm-twin serve` as a user starts it; yields address of the page and a client of the twin."""
    page_port, zenoh_port = free_port(), free_port()
    command = [sys.executable, "-m", "motm_twin.cli", "serve", scene, "--port", str(page_port)]
    process = subprocess.Popen([*command, "--zenoh-port", str(zenoh_port), *options])
    try:
        with TwinClient(f"tcp/127.0.0.1:{zenoh_port}") as client:
            until(lambda: page_answers(page_port), 60.0, "the page did not come up")
            yield f"http://127.0.0.1:{page_port}/", client
    finally:
        process.terminate()
        process.wait(10.0)


class Visitor:
    """A browser page in the overview, and its mouse."""

    def __init__(self, page, scene):
        self.page = page
        self._eye, self._look_at = overview(scene)

    def pixel(self, point):
        """Where a point of the world is on the screen."""
        box = self.page.locator("canvas").first.bounding_box()
        forward = (self._look_at - self._eye) / np.linalg.norm(self._look_at - self._eye)
        right = np.cross(forward, [0.0, 0.0, 1.0])
        right /= np.linalg.norm(right)
        up = np.cross(right, forward)
        ray = np.asarray(point) - self._eye
        depth, focal = ray @ forward, 0.5 * box["height"] / np.tan(FIELD_OF_VIEW / 2)
        x = box["x"] + box["width"] / 2 + focal * (ray @ right) / depth
        y = box["y"] + box["height"] / 2 - focal * (ray @ up) / depth
        return float(x), float(y)

    def hover(self, point):
        """Move the mouse there and let the page notice."""
        self.page.mouse.move(*self.pixel(point))
        self.page.wait_for_timeout(500)

    def click(self, point):
        """Click on a point of the world."""
        self.hover(point)
        self.page.mouse.down()
        self.page.wait_for_timeout(100)
        self.page.mouse.up()

    def drag(self, start, end, steps=12):
        """Drag from one point of the world to another."""
        self.hover(start)
        self.page.mouse.down()
        for part in np.linspace(0.0, 1.0, steps + 1)[1:]:
            self.page.mouse.move(*self.pixel(np.asarray(start) + part * (np.asarray(end) - np.asarray(start))))
            self.page.wait_for_timeout(80)
        self.page.wait_for_timeout(300)
        self.page.mouse.up()

    def close_notes(self):
        """Close what lies over the scene."""
        for button in self.page.locator(".mantine-Notification-closeButton").all():
            button.click()


@contextmanager
def visiting(url):
    """Chromium with the page open; yields the Playwright page."""
    playwright = pytest.importorskip("playwright.sync_api")
    path = chromium_path()
    with playwright.sync_playwright() as engine:
        browser = engine.chromium.launch(executable_path=path, args=FLAGS)
        page = browser.new_page(viewport=VIEW)
        page.goto(url)
        yield page
        browser.close()
