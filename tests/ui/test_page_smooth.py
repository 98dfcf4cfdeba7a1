"""The script that shows pictures of one moment, with smooth motion between them; in Chromium, without a server."""

import itertools

import pytest

from motm_twin.model.data_dirs import web_assets_dir

# A worker that hands on what it is sent, as Viser's does with messages of the server, and a page that writes down
# what is shown: [ms, type of the message, its value].
PAGE = """
window.shown = [];
const echo = new Worker(URL.createObjectURL(new Blob(["onmessage = (event) => postMessage(event.data)"])));
echo.onmessage = ({ data }) => (data.messages ?? []).forEach((message) =>
  shown.push([performance.now(), message.name ?? message.type, message.position ?? message.points ?? message.look_at]));
const picture = (time, x, run = 1) => echo.postMessage({ type: "message_batch", messages: [
  { type: "SetPositionMessage", name: "/robot/link/base", position: [x, 0, 0] },
  { type: "SceneNodeUpdateMessage", name: "/plan/global_path", points: time },
  { type: "SetPositionMessage", name: "/clock", position: [time, run, 0] }] });
const wait = (ms) => new Promise((done) => setTimeout(done, ms));
echo.postMessage({ type: "connected" });
"""


@pytest.fixture
def page(browser):
    page = browser.new_page()
    page.goto("about:blank")
    page.add_script_tag(path=web_assets_dir() / "page" / "smooth.js")
    page.add_script_tag(content=PAGE)
    yield page
    page.close()


def shown(page, script):
    """Values that the page shows while a script runs, with their times, by name."""
    page.evaluate(f"(async () => {{ {script} }})()")
    found = {}
    for time, name, value in page.evaluate("shown"):
        found.setdefault(name, []).append((time, value))
    return found


@pytest.mark.browser
def test_a_body_glides_from_picture_to_picture_and_the_rest_stays_of_one(page):
    steps = "for (let k = 0; k <= 20; k++) { picture(0.05 * (k + 1), 0.1 * k); await wait(50); } await wait(300);"
    found = shown(page, steps)
    path = [value[0] for _, value in found["/robot/link/base"]]
    assert path == sorted(path) and (path[0], path[-1]) == (0.0, pytest.approx(2.0))
    assert len(set(path)) > 40  # more than twice the pictures
    assert max(b - a for a, b in itertools.pairwise(path)) < 0.1  # never a whole picture at once
    plans = found["/plan/global_path"]
    assert [time for _, time in plans] == pytest.approx([0.05 * (k + 1) for k in range(21)])
    for at, time in plans[2:-1]:  # when a plan is shown, the body is where it was then, or a little on
        x = next(value[0] for moment, value in found["/robot/link/base"] if moment >= at)
        assert 0.1 * (time / 0.05 - 1) - 0.06 <= x <= 0.1 * time / 0.05


@pytest.mark.browser
def test_what_was_put_elsewhere_and_another_run_or_an_earlier_time_are_shown_at_once(page):
    found = shown(
        page,
        "picture(1.0, 0); picture(1.05, 3); await wait(300); picture(0.5, 1); picture(0.55, 1, 2); await wait(50);",
    )
    assert [value[0] for _, value in found["/robot/link/base"]] == [0, 3, 1, 1]


@pytest.mark.browser
def test_the_camera_glides_but_its_first_move_is_at_once(page):
    message = "{type: 'SetCameraPositionMessage', position: [%s, 0, 0]}"
    move = "echo.postMessage({type: 'message_batch', messages: [" + message + "]});"
    found = shown(page, move % 5 + "await wait(40);" + move % 6 + "await wait(300);")
    path = [value[0] for _, value in found["SetCameraPositionMessage"]]
    assert path[0] == 5 and path[-1] == 6 and path == sorted(path) and any(5 < x < 6 for x in path)
