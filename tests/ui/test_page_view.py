"""The page in Chromium: what the camera sees, light and dark, fingers on a phone, and motion between two pictures."""

import itertools
import math

import numpy as np
import pytest
from page import AT_REST, SHOWN, Hand, Visitor, leave, until, visiting

from motm_twin.bus.commands import AddObstacle
from motm_twin.model.assets import web_assets_dir
from motm_twin.perf.processes import act

pytestmark = [pytest.mark.browser, pytest.mark.timeout(600)]
TABLE, FLOOR = (4.9, 1.9, 0.78), (2.0, 0.4, 0.0)  # [m] on the table, where no cube is; free floor
PATCH = 8  # [px]
HOLES, GREY = 0.15, 12.0  # share of neighbouring pixels that differ by so many levels


def test_the_plan_view_looks_through_furniture_and_the_wrist_camera_is_shown_by_a_key(browser, begun):
    with visiting(browser, begun("exp1", play=False)) as visitor:
        assert not pierced(visitor, TABLE)
        visitor.page.keyboard.press("2")
        until(lambda: pierced(visitor, TABLE), SHOWN, "the table hides what is below it")
        assert not pierced(visitor, FLOOR)

        wrist = visitor.page.locator("canvas.wrist")
        assert not wrist.is_visible()
        visitor.page.keyboard.press("i")
        read = "() => [...document.querySelector('.wrist').getContext('2d').getImageData(0, 0, 256, 192).data]"
        until(lambda: np.std(visitor.page.evaluate(read)[::4]) > 10.0, SHOWN, "the wrist camera shows nothing")
        visitor.press("Wrist camera")
        wrist.wait_for(state="hidden", timeout=SHOWN * 1000)


def test_the_page_is_as_dark_as_the_browser_prefers_until_somebody_chooses(browser, begun):
    with visiting(browser, begun("exp1", play=False)) as visitor:
        page = visitor.page

        def shades(name):
            """Red of the ground of timeline, panel and headline, and whether the panel knows of it."""
            read = "(mark) => getComputedStyle(document.querySelector(mark)).backgroundColor.match(/[0-9]+/)[0]"
            grounds = [int(page.evaluate(read, mark)) for mark in ("#motm .bar", "div:has(> .motm-top)")]
            return page.locator(f"html[data-mantine-color-scheme={name}]").count() == 1, grounds

        assert shades("light") == (True, [255, 255])
        page.emulate_media(color_scheme="dark")
        until(lambda: shades("dark")[0] and max(shades("dark")[1]) < 64, SHOWN, "not dark")
        visitor.press("Light or dark")
        until(lambda: shades("light") == (True, [255, 255]), SHOWN, "not light again")
        page.reload()
        page.locator(".cover").wait_for(state="detached", timeout=SHOWN * 1000)
        until(lambda: shades("light") == (True, [255, 255]), SHOWN, "the choice is forgotten")
        page.emulate_media(color_scheme="light")


def test_the_view_never_goes_below_the_floor_however_far_down_it_is_dragged(browser, begun):
    with visiting(browser, begun("exp1", play=False)) as visitor:
        mouse = visitor.page.mouse
        for key in ("1", "3"):
            visitor.page.keyboard.press(key)
            visitor.page.wait_for_timeout(AT_REST)
            visitor.rest()
            for _ in range(3):
                mouse.move(60, 440)
                mouse.down()
                for y in range(440, 20, -60):
                    mouse.move(60, y)
                    visitor.page.wait_for_timeout(50)
                mouse.up()
                place = visitor.eye()[0]
                assert place[2] > 0.1, f"key {key}: the eye is at {place}"
            place, ahead = visitor.rest()
            assert place[2] > 0.1, f"key {key}: the eye comes to rest at {place}"
            assert abs(ahead[2]) < 0.9, f"key {key}: it looks along {ahead}"


def pierced(visitor, place):
    """True when the picture has holes round a point of the world [m]."""
    picture = visitor.picture()
    canvas = visitor.page.locator("canvas[data-engine]").bounding_box()
    x, y = visitor.page.evaluate("(place) => motm.pixel(place)", list(place))
    row, column = int(y - canvas["y"]), int(x - canvas["x"])
    patch = picture[row - PATCH : row + PATCH, column - PATCH : column + PATCH].mean(axis=2)
    return patch.size > 0 and bool((np.abs(np.diff(patch, axis=1)) > GREY).mean() > HOLES)


PHONE = {"width": 390, "height": 844}
BOX, ASIDE = (1.6, 0.4), (2.6, -0.9, 0.0)  # [m] free floor
STEPS = 10  # of a gesture


def test_fingers_zoom_turn_drag_and_tap_at_the_size_of_a_phone(browser, begun):
    twin = begun("exp1", play=False)
    visitor = Visitor.enter(browser, twin, PHONE)
    hand = Hand(visitor.page)

    middle, view = visitor.pixel(ASIDE), visitor.eye()
    hand.drags([way(middle, (-20, 0), (-90, 0)), way(middle, (20, 0), (90, 0))])
    until(lambda: nearer(view, visitor.eye()) > 0.3, SHOWN, "two fingers that part do not go nearer")
    view = visitor.eye()
    hand.drags([way(middle, (-90, 0), (-30, 0)), way(middle, (90, 0), (30, 0))])
    until(lambda: nearer(view, visitor.eye()) < -0.3, SHOWN, "two fingers that meet do not go back")

    view = visitor.eye()
    hand.drags([way(visitor.pixel(ASIDE), (0, 0), (70, 0))])
    until(lambda: turned(view, visitor.eye()) > 0.1, SHOWN, "a finger on the floor does not turn the view")
    until(lambda: visitor.page.evaluate("motm.data.now.camera") == "Free", SHOWN, "the view is not the visitor's")

    size = (0.4, 0.4, 0.6)
    act(twin.client, AddObstacle(name="box", shape="box", x=BOX[0], y=BOX[1], heading=0.0, size=size))
    until(lambda: box(twin) == BOX, SHOWN, "no box")
    view = visitor.eye()
    visitor.page.wait_for_timeout(2000)  # until it is drawn
    hand.drags([way(visitor.pixel((*BOX, 0.3)), (0, 0), (40, 20))])
    until(lambda: math.dist(box(twin), BOX) > 0.2, SHOWN, "a finger does not take the box along")
    assert turned(view, visitor.eye()) < 0.02, "the view turns while a body is dragged"

    visitor.page.wait_for_timeout(1000)
    hand.drags([[visitor.pixel(ASIDE)]])
    visitor.says("Drive here?")
    visitor.press("Drive")
    until(lambda: any(task.kind == "drive_to" for task in twin.client.tick().tasks), SHOWN, "a tap does not drive")
    assert visitor.errors == []
    visitor.page.close()


def way(place, *ends):
    """Pixels from and to places beside a pixel."""
    start, end = (np.add(place, offset) for offset in (ends[0], ends[-1]))
    return [start + part * (end - start) for part in np.linspace(0.0, 1.0, STEPS + 1)]


def box(twin):
    """Place of the box [m]."""
    return next((tuple(body.position[:2]) for body in twin.client.tick().obstacles if body.name == "box"), None)


def nearer(before, after):
    """Way [m] of the camera ahead."""
    return float((after[0] - before[0]) @ before[1])


def turned(before, after):
    """By which angle [rad] the camera turned."""
    return math.acos(min(1.0, float(before[1] @ after[1])))


FRAME = 16  # [ms] between two frames of the clock that the test moves on
# A worker that hands on what it is sent, as Viser's does with messages of the server, and a page that writes down
# what is shown: [ms, type of the message, its value].
PAGE = """
window.shown = [];
const echo = new Worker(URL.createObjectURL(new Blob(["onmessage = (event) => postMessage(event.data)"])));
echo.onmessage = ({ data }) => (data.messages ?? []).forEach((message) =>
  shown.push([performance.now(), message.name ?? message.type, message.position ?? message.points ?? message.look_at]));
let arrived = () => {};
motm.taps.push(() => arrived());
window.arrives = (messages) => new Promise((done) => {
  arrived = done;
  echo.postMessage({ type: "message_batch", messages });
});
echo.postMessage({ type: "connected" });
"""


class Film:
    """A page whose clock stands until a frame is asked for: a busy machine shows what a quick one shows."""

    def __init__(self, page):
        self._page = page

    def picture(self, time, x, run=1):
        """The picture of a time [s] arrives, with the base at x [m]."""
        self.arrives(
            {"type": "SetPositionMessage", "name": "/robot/link/base", "position": [x, 0, 0]},
            {"type": "SceneNodeUpdateMessage", "name": "/plan/global_path", "points": time},
            {"type": "SetPositionMessage", "name": "/clock", "position": [time, run, 0]},
        )

    def arrives(self, *messages):
        """A batch of messages arrives."""
        self._page.evaluate("(messages) => arrives(messages)", messages)

    def wait(self, ms):
        """Frames are drawn for so long."""
        for _ in range(round(ms / FRAME)):
            self._page.clock.run_for(FRAME)

    def shown(self):
        """Values that the page has shown, with their times [ms], by name."""
        found = {}
        for time, name, value in self._page.evaluate("shown"):
            found.setdefault(name, []).append((time, value))
        return found


@pytest.fixture
def film(browser):
    leave(browser)
    page = browser.new_page()
    page.clock.install(time=0)
    page.goto("about:blank")
    page.clock.pause_at(1000)
    page.add_script_tag(path=web_assets_dir() / "page" / "smooth.js")
    page.add_script_tag(content=PAGE)
    return Film(page)


def test_a_body_glides_from_picture_to_picture_and_the_rest_stays_of_one(film):
    for k in range(21):
        film.picture(0.05 * (k + 1), 0.1 * k)
        film.wait(3 * FRAME)
    film.wait(300)
    shown = film.shown()
    path = [value[0] for _, value in shown["/robot/link/base"]]
    assert path == sorted(path) and (path[0], path[-1]) == (0.0, pytest.approx(2.0))
    assert len(set(path)) > 40  # more than twice the pictures
    assert max(b - a for a, b in itertools.pairwise(path)) < 0.1  # never a whole picture at once
    plans = shown["/plan/global_path"]
    assert [time for _, time in plans] == pytest.approx([0.05 * (k + 1) for k in range(21)])
    for at, time in plans[2:-1]:  # when a plan is shown, the body is where it was then, or a little on
        x = next(value[0] for moment, value in shown["/robot/link/base"] if moment >= at)
        assert 0.1 * (time / 0.05 - 1) - 0.06 <= x <= 0.1 * time / 0.05


def test_what_was_put_elsewhere_and_another_run_or_an_earlier_time_are_shown_at_once(film):
    film.picture(1.0, 0)
    film.picture(1.05, 3)
    film.wait(300)
    film.picture(0.5, 1)
    film.picture(0.55, 1, run=2)
    assert [value[0] for _, value in film.shown()["/robot/link/base"]] == [0, 3, 1, 1]


def test_the_camera_glides_but_its_first_move_is_at_once(film):
    for x in (5, 6):
        film.arrives({"type": "SetCameraPositionMessage", "position": [x, 0, 0]})
        film.wait(40)
    film.wait(300)
    path = [value[0] for _, value in film.shown()["SetCameraPositionMessage"]]
    assert path[0] == 5 and path[-1] == 6 and path == sorted(path) and any(5 < x < 6 for x in path)
