"""The script that shows pictures of one moment, with smooth motion between them; in Chromium, without a server."""

import itertools

import pytest
from page import leave

from motm_twin.model.data_dirs import web_assets_dir

pytestmark = pytest.mark.browser
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
