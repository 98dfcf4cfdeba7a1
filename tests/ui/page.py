"""A person at the page, for tests: Chromium, a mouse that aims at points of the world, and a small room to play in."""

import http.client
import io
import math
import os
import shutil
import time
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from motm_twin.bus.commands import HandOver, Load, Pause, Play, Reset, Speed
from motm_twin.methods import DEFAULT_METHOD
from motm_twin.perf.processes import act, now, served
from motm_twin.ui.scene.cameras import FIELD_OF_VIEW, FROM_FAR, overview

VIEW = {"width": 800, "height": 560}  # small, because software draws it
FLAGS = ["--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--disable-gpu-rasterization", "--no-sandbox"]
LIGHTLY = Path(__file__).with_name("lightly.js")
CAMERA = Path(__file__).with_name("camera.js")
WORLD = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, 1.0], [-1.0, 0.0, 0.0]])  # axes of the page's scene, in the world's
NEAR = 0.02  # [m] from where it should be, the camera is there
STRAIGHT = 0.01  # [rad] from where it should look, the camera looks there
STILL = 1.0  # [px] that a point of the world may move on the screen while the camera is at rest
BETWEEN = 1000  # [ms] between two looks at whether the picture has changed: two gaps of lightly.js
AT_REST = 600  # [ms] after which a camera that moves was drawn elsewhere: more than the gap of lightly.js
MOMENT = 8000  # [ms] for something that does not last
SHOWN = 60.0  # [s] for something to appear: software rendering on a busy machine
ROW = "xpath=ancestor::div[contains(@class, 'mantine-Flex-root')][1]"  # of the panel, round a label


def chromium_path():
    """Path of Chromium, or a skip (a failure where a browser is required) that says why."""
    found = os.environ.get("MOTM_CHROMIUM") or shutil.which("chromium") or shutil.which("chromium-browser")
    if found:
        return found
    reason = "no Chromium: set MOTM_CHROMIUM to its path"
    if os.environ.get("MOTM_REQUIRE_BROWSER") == "1":
        pytest.fail(f"MOTM_REQUIRE_BROWSER=1, but {reason}")
    pytest.skip(reason)


def until(condition, timeout=SHOWN, what="it does not happen"):
    """Wait for something that must happen; how fast is not the test's business."""
    deadline = time.monotonic() + timeout
    while time.monotonic() < deadline:
        if value := condition():
            return value
        time.sleep(0.05)
    raise AssertionError(f"after {timeout:.0f} s: {what}")


def get(server, path="/", address="127.0.0.1", **headers):
    """The answer of a server of pages, with its body."""
    connection = http.client.HTTPConnection(address, server.get_port(), timeout=10)
    connection.request("GET", path, headers={name.replace("_", "-"): value for name, value in headers.items()})
    response = connection.getresponse()
    response.body = response.read()
    connection.close()
    return response


@contextmanager
def serving(scene, *options):
    """`motm-twin serve` as a user starts it, once it has run a period."""
    chromium_path()  # no browser, no need to start
    with served(str(scene), *options) as twin:
        yield twin


def pause(client):
    """Pause, and leave the wheel free, whoever has it."""
    client.command(HandOver(), sender=client.status().driver)
    act(client, Pause())


def begin(twin, scene, variant, *, play=True):
    """A run from its start at 1x, by the shipped method, with a free wheel."""
    client, run = twin.client, now(twin.client).run
    pause(client)
    for command in (Load(scene=scene, variant=variant, method=DEFAULT_METHOD), Speed(factor=1.0)):
        act(client, command)
    until(lambda: now(client).run > run and client.scene().name == scene, SHOWN, f"{scene} is not loaded")
    if not play:  # a run that follows one that had ended plays
        act(client, Pause())
        act(client, Reset())
        until(lambda: now(client).index == 0 and client.status().state == "paused", SHOWN, "it is not at its start")
        return
    act(client, Play())
    until(lambda: client.status().state != "paused" and client.status().driver == "", SHOWN, "it does not begin")


@contextmanager
def chromium():
    """A browser."""
    playwright = pytest.importorskip("playwright.sync_api")
    path = chromium_path()
    with playwright.sync_playwright() as engine:
        browser = engine.chromium.launch(executable_path=path, args=FLAGS)
        yield browser
        browser.close()


_stayed = {}  # by browser: the visitor of the last test, whose page goes on; to load one takes seconds


@contextmanager
def visiting(browser, twin, view=VIEW):
    """The page of a served twin, left from the last test unless that failed; yields its visitor, who can drive.

    Fails in the end for errors of scripts.
    """
    visitor = _stayed.pop(browser, None) or Visitor.enter(browser, twin, view)
    try:
        visitor.anew(view)
        yield visitor
        assert visitor.errors == []
    except BaseException:
        visitor.page.close()
        raise
    _stayed[browser] = visitor


def leave(browser):
    """Close the page of the last test: it would be another visitor, and takes half of a processor."""
    if stayed := _stayed.pop(browser, None):
        stayed.page.close()


def tidy(browser):
    """Close every page but the one that stays; a test that failed may have left some."""
    stays = _stayed[browser].page if browser in _stayed else None
    for page in [page for context in browser.contexts for page in context.pages]:
        if page is not stays:
            page.close()


def in_time(act, moment=MOMENT):
    """True when something could be done on a page within a moment [ms]."""
    from playwright.sync_api import TimeoutError as TooLate

    try:
        act(timeout=moment)
    except TooLate:
        return False
    return True


class Visitor:
    """A person with a browser page in the overview."""

    def __init__(self, page, twin):
        self.page, self.twin, self.errors = page, twin, []
        page.add_init_script(path=CAMERA)
        page.on("pageerror", lambda error: self.errors.append(str(error)))

    @classmethod
    def enter(cls, browser, twin, view=VIEW, *, fine=False, welcome=False, touch=False):
        """Open the page in a new window and put the introduction away.

        The scene is drawn as everybody sees it when ``fine``; else with rough edges, at most twice a second and
        always with one dot per pixel: smooth edges take half of what software needs for a picture. ``welcome``: the
        card of the first visit stays. ``touch``: its screen feels fingers.
        """
        leave(browser)
        page = browser.new_page(viewport=view, has_touch=touch)
        visitor = cls(page, twin)
        if not fine:
            page.add_init_script(path=LIGHTLY)
        page.goto(twin.url if fine else f"{twin.url}&fixedDpr=1")
        visitor.button("Play", "Pause", "Restart").wait_for(timeout=SHOWN * 1000)
        page.locator(".cover").wait_for(state="detached", timeout=SHOWN * 1000)
        if not welcome:
            visitor.close_notes()
        visitor.in_overview()
        return visitor

    def in_overview(self):
        """Wait until the camera is where a visitor's begins."""
        try:
            until(self.overlooks, SHOWN)
        except AssertionError as late:
            scene, box = self.twin.client.scene(), self._canvas()
            wanted = overview(scene, box["width"] / box["height"])[0]
            raise AssertionError(f"camera at {self.eye()}, not at {wanted} for {scene.name}, {box}") from late

    def anew(self, view):
        """In the overview and the first tab, with nothing chosen and nothing over the scene, once a run was begun."""
        self.page.set_viewport_size(view)
        self.tab("Drive")  # out of a field, or keys would be typed
        self.page.keyboard.press("1")
        self.close_notes()
        self.in_overview()

    # what is seen

    def says(self, text, exact=False):
        """Wait until a text is on the page."""
        self.page.get_by_text(text, exact=exact).first.wait_for(timeout=SHOWN * 1000)

    def said(self, text):
        """True when a text appears on the page within `MOMENT`; one that vanishes quickly may be missed."""
        return in_time(self.page.get_by_text(text).first.wait_for)

    def state(self, name):
        """Wait until the page shows this state of the twin, such as Running."""
        self.says(name, exact=True)

    def sees(self, text):
        """Whether a text is on the page now."""
        return self.page.get_by_text(text).first.is_visible()

    def picture(self):
        """The scene as it is shown, shape (height, width, 3), without what lies over it at its edges."""
        box, legend = self._canvas(), self.page.locator("#motm .chips").bounding_box()
        return self.shot(clip={**box, "height": legend["y"] - box["y"]})

    def shot(self, **part):
        """The page, or a part of it, shape (height, width, 3)."""
        shot = self.page.screenshot(**part, timeout=SHOWN * 1000)
        return np.asarray(Image.open(io.BytesIO(shot)).convert("RGB"), dtype=float)

    def settled(self, quiet=2, look=None):
        """The picture, or another look, once it has stayed the same for a while; the twin must be paused."""
        look = look or self.picture
        same, now = 0, look()
        deadline = time.monotonic() + SHOWN
        while same < quiet and time.monotonic() < deadline:
            self.page.wait_for_timeout(BETWEEN)
            last, now = now, look()
            same = same + 1 if changed(last, now) < 1e-4 else 0
        assert same >= quiet, "the picture goes on changing: pause the twin first"
        return now

    def _canvas(self):
        """Where the scene is on the screen."""
        return self.page.locator("canvas[data-engine]").bounding_box()

    # panel

    def button(self, *names):
        """The first visible button with one of these names."""
        found = self.page.get_by_role("button", name=names[0], exact=True)
        for name in names[1:]:
            found = found.or_(self.page.get_by_role("button", name=name, exact=True))
        return found.locator("visible=true").first

    def press(self, name):
        """Click a button of the panel."""
        self.button(name).click(timeout=SHOWN * 1000)

    def presses(self, name, *, exact=True):
        """Whether a button could be clicked within a moment; it may be gone again before."""
        return in_time(self.page.get_by_role("button", name=name, exact=exact).locator("visible=true").first.click)

    def tab(self, name):
        """Open a tab of the panel."""
        self.page.get_by_role("tab", name=name, exact=True).click(timeout=SHOWN * 1000)

    def unfold(self, folder, within):
        """Open a folder of the panel, unless the label within is seen."""
        if not self.page.get_by_label(within, exact=True).locator("visible=true").count():
            self.page.get_by_text(folder, exact=True).locator("visible=true").first.click()

    def look_back_to(self, share):
        """Drag the dot of the timeline to a share of what is kept."""
        track = self.page.get_by_role("slider", name="Time", exact=True)
        box, low, high, now = track.bounding_box(), *(
            float(track.get_attribute(f"aria-value{name}")) for name in ("min", "max", "now")
        )  # fmt: skip
        start = max(0.0, high - 120.0)
        x, end = (box["x"] + (time - start) / 120.0 * box["width"] for time in (now, low + share * (high - low)))
        y = box["y"] + box["height"] / 2
        self.page.mouse.move(x, y)
        self.page.mouse.down()
        self.page.mouse.move((x + end) / 2, y)
        self.page.mouse.move(end, y)
        self.page.mouse.up()

    def speed(self, name):
        """Choose a speed below the scene."""
        self.page.get_by_label("Speed of the twin").select_option(name)

    def choose(self, label, option):
        """Choose from a list of the panel."""
        self.page.get_by_label(label, exact=True).locator("visible=true").first.click(timeout=SHOWN * 1000)
        self.page.get_by_role("option", name=option, exact=True).click(timeout=SHOWN * 1000)

    def offered(self, label):
        """What a list of the panel offers; looked at and closed again."""
        options = self.page.get_by_role("option").locator("visible=true")

        def read():  # when the panel changes just then, the list closes before it can be read
            self.page.get_by_label(label, exact=True).locator("visible=true").first.click(timeout=SHOWN * 1000)
            options.first.wait_for(timeout=SHOWN * 1000)
            return options.all_inner_texts()

        found = until(read, SHOWN, f"{label} offers nothing")
        self.page.keyboard.press("Escape")
        options.first.wait_for(state="hidden", timeout=SHOWN * 1000)
        return found

    def write(self, label, text):
        """Type into a field of the panel; Viser's labels of text fields point nowhere."""
        field = self.page.get_by_text(label, exact=True).first.locator(ROW).locator("input")
        field.fill(text, timeout=SHOWN * 1000)
        field.press("Enter")

    def close_notes(self):
        """Close what lies over the scene."""
        if self.button("Got it").is_visible():
            self.press("Got it")
        note = self.page.locator(".mantine-Notification-closeButton").locator("visible=true")
        deadline = time.monotonic() + SHOWN
        while note.count():
            in_time(note.first.click, 5000)  # it may go by itself, as notes do: look again
            assert time.monotonic() < deadline, "a note can not be closed"

    # mouse in the scene

    def pixel(self, point):
        """Where a point of the world is on the screen, by the camera of the last picture."""
        view, projection = until(self._camera, SHOWN, "no picture was drawn")
        box = self._canvas()
        x, y, _, depth = projection @ view @ np.append(WORLD @ np.asarray(point, dtype=float), 1.0)
        across, down = (1.0 + x / depth) / 2.0, (1.0 - y / depth) / 2.0
        return float(box["x"] + box["width"] * across), float(box["y"] + box["height"] * down)

    def overlooks(self):
        """True when the camera is in the overview, where that of a visitor begins."""
        scene, box = self.twin.client.scene(), self._canvas()
        if scene is None or box is None:
            return False
        eye, ahead = self.eye()
        place, look_at = overview(scene, box["width"] / box["height"])
        off = np.linalg.norm(np.cross(ahead, (look_at - place) / np.linalg.norm(look_at - place)))
        return math.dist(eye, place) < NEAR and bool(off < STRAIGHT)

    def eye(self):
        """Place [m] of the camera of the last picture, and the direction in which it looks."""
        view = until(self._camera, SHOWN, "no picture was drawn")[0]
        return WORLD.T @ (-view[:3, :3].T @ view[:3, 3]), WORLD.T @ -view[2, :3]

    def rest(self):
        """`eye`, once it stands still."""

        def still():
            eye = self.eye()
            self.page.wait_for_timeout(AT_REST)
            return eye if np.allclose(eye, self.eye(), atol=STRAIGHT) else None

        return until(still, SHOWN, "the camera does not come to rest")

    def _camera(self):
        """View and projection of the visitor's own camera in the last picture, each (4, 4); None before the first."""
        found = None
        for matrices in self.page.evaluate("sceneCameras()"):
            view, projection = (np.array(matrix).reshape(4, 4).T for matrix in matrices)
            opening = 2.0 * math.atan(1.0 / projection[1, 1])
            if projection[3, 2] == -1.0 and 0.999 * FROM_FAR < opening < 1.001 * FIELD_OF_VIEW:
                found = view, projection
        return found

    def aim(self, point, act=lambda x, y: None):
        """Where a point of the world is on the screen, once ``act(x, y)`` was done there and the camera stood still."""

        def still():
            pixel = self.pixel(point)
            act(*pixel)
            self.page.wait_for_timeout(AT_REST)
            return pixel if math.dist(pixel, self.pixel(point)) < STILL else None

        return until(still, SHOWN, "the camera does not come to rest")

    def hover(self, point):
        """Move the mouse there and let the page notice."""
        self.aim(point, self.page.mouse.move)

    def click(self, point):
        """Click on a point of the world."""
        self.hover(point)
        self.page.mouse.down()
        self.page.wait_for_timeout(100)
        self.page.mouse.up()

    def drag(self, start, end, steps=12):
        """Drag from one point of the world to another, and hold still before letting go."""
        self.hover(start)
        self.page.mouse.down()
        for part in np.linspace(0.0, 1.0, steps + 1)[1:]:
            self.page.mouse.move(*self.pixel(np.asarray(start) + part * (np.asarray(end) - np.asarray(start))))
            self.page.wait_for_timeout(80)
        self.page.wait_for_timeout(600)
        self.page.mouse.up()


class Hand:
    """Fingers on the screen, as Chromium sees them."""

    def __init__(self, page):
        self._page, self._devtools = page, page.context.new_cdp_session(page)
        self._devtools.send("Emulation.setTouchEmulationEnabled", {"enabled": True, "maxTouchPoints": 5})

    def drags(self, ways):
        """Each finger down at the first of its pixels, over all others, hold still, up; one pixel is a tap."""
        fingers = list(zip(*ways, strict=True))
        self._touch("touchStart", fingers[0])
        for moved in fingers[1:]:
            self._page.wait_for_timeout(80)
            self._touch("touchMove", moved)
        self._page.wait_for_timeout(600 if len(fingers) > 1 else 80)
        self._touch("touchEnd", [])

    def _touch(self, kind, pixels):
        points = [{"x": float(x), "y": float(y), "id": number} for number, (x, y) in enumerate(pixels)]
        self._devtools.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})


def changed(before, after, by=24.0):
    """Share of the pixels of two pictures that differ clearly."""
    return float((np.abs(before - after).max(axis=2) > by).mean())


EVIL = "<img/src=x onerror=window.hacked=1>"
SHELF, SHELF_TOP = (-1.5, 0.5), 0.5  # [m]
DRIVES = "".join(f"\n      - drive_to: {{x: {x}, y: -0.3}}" for x in 40 * (0.9, 0.3))  # 3 min: outlasts a test
TEXT = f"""
format: motm-scene/1
title: "{EVIL}<script>window.hacked=1</script>"
start: {{x: 0.0, y: 0.0}}
furniture:
  table: {{shape: box, centre: [1.6, 1.0], size: [0.8, 0.8], z: [0.0, 0.75], style: desk}}
  desk: {{shape: box, centre: [1.6, -1.4], size: [0.8, 0.8], z: [0.0, 0.6], style: desk}}
  shelf: {{shape: box, centre: [{SHELF[0]}, {SHELF[1]}], size: [0.6, 0.6], z: [0.0, {SHELF_TOP}], style: desk}}
objects:
  cube: {{surface: table, at: [1.45, 0.72]}}
bins:
  bin: {{at: [1.45, -1.2]}}
tasks:
  - pick: cube
  - place: bin
variants:
  delivery:
    furniture:
      table: {{shape: box, centre: [2.2, 1.0], size: [0.8, 0.8], z: [0.0, 0.75], style: desk}}
      desk: {{shape: box, centre: [2.2, -1.4], size: [0.8, 0.8], z: [0.0, 0.6], style: desk}}
      shelf: null
    objects: {{cube: {{surface: table, at: [2.05, 0.72]}}}}
    bins: {{bin: {{at: [2.05, -1.2]}}}}
  nothing_to_do:
    tasks:
      - drive_to: {{x: 0.0, y: 0.0}}
  long:
    tasks:
      - pick: cube
      - place: bin{DRIVES}
"""
