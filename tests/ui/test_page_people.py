"""The page in Chromium: two people and one wheel, a tablet, keys wherever the focus is, a lost connection."""

import math
import re

import numpy as np
import pytest
from page import EVIL, SHOWN, Visitor, changed, until, visiting

from motm_twin.bus.commands import HandOver
from motm_twin.bus.connection import free_port
from motm_twin.ui.page_server import open_page

pytestmark = [pytest.mark.browser, pytest.mark.timeout(600)]
TABLET = {"width": 1024, "height": 768}
NEAR = 45  # [px] round the middle of the robot
HEIGHT = 0.3  # [m] of a point of the robot


def test_a_cube_and_a_bin_are_clicked_and_two_people_share_one_wheel(browser, begun):
    twin = begun("room", "nothing_to_do")
    with visiting(browser, twin) as ann:
        client = twin.client
        ann.state("Finished")  # the room's own task takes no time
        ann.settled()

        bea = Visitor.enter(browser, twin)  # joins late
        sees_the_same(ann, bea)
        ann.write("Your name", f"Ann {EVIL}"[:40])
        bea.write("Your name", f"Bea {EVIL}"[:40])
        bea.tab("Why")  # out of the field, or keys would be typed
        bea.tab("Drive")
        take_the_wheel(ann)
        bea.says(f"Ann {EVIL[:10]}")
        bea.says("is driving, you are looking")

        take_the_wheel(ann)
        bea.page.keyboard.press("r")
        bea.says("Only looking")  # and who drives
        assert bea.page.get_by_role("button", name="Restart", exact=True).first.is_disabled()
        take_the_wheel(ann)
        bea.click(middle(client, "cube"))
        take_the_wheel(ann)
        bea.click(middle(client, "bin"))
        assert len(client.tick().tasks) == 1

        until(lambda: handed_over(ann, bea), 240.0, "the wheel is not handed over")
        bea.says("You are driving")
        ann.says(f"Bea {EVIL[:10]}")
        bea.close_notes()
        deliver(bea)
        client.command(HandOver(), sender=client.status().driver)  # that silence frees it is shown without a page
        ann.says("Nobody is driving")
        until(lambda: takes_the_free_wheel(ann), 120.0, "the free wheel is not taken")
        for page in (ann.page, bea.page):
            assert page.evaluate("window.hacked") is None
            assert page.locator("img[src=x]").count() == 0

        run = client.tick().run
        bea.page.close()
        ann.press("Reset")
        until(lambda: client.tick().run > run, 30.0, "a page that is gone takes something along")
        assert bea.errors == []


def sees_the_same(first, late):
    """Wait until the scene of a late joiner is that of who was there, whichever of the pages is the slower one."""
    for _ in range(30):
        for visitor in (first, late):
            visitor.close_notes()
        there, here = first.picture(), late.picture()
        if changed(there, here) < 0.02:
            return
        late.page.wait_for_timeout(2000)
    y, x = np.nonzero(np.abs(there - here).max(axis=2) > 24.0)
    share = changed(there, here)
    pytest.fail(f"{share:.1%} of the late joiner's scene differ, x {x.min()} to {x.max()}, y {y.min()} to {y.max()}")


def take_the_wheel(visitor):
    """Drive, from now on for 10 s: on a busy machine little happens in that time."""
    run = visitor.twin.client.tick().run
    visitor.press("Reset")
    until(lambda: visitor.twin.client.tick().run > run, 60.0, "no reset")
    visitor.says("You are driving")


def handed_over(ann, bea):
    """Ask for the wheel and hand it over before the 10 s are over; on a busy machine that takes several tries."""
    take_the_wheel(ann)
    return bea.presses("Ask for the wheel") and ann.presses("Hand over to Bea", exact=False)


def takes_the_free_wheel(visitor):
    """Press a key and read who drives within a moment; on a busy machine the 10 s may be over again by then."""
    visitor.page.keyboard.press("Space")
    return visitor.said("You are driving")


def middle(client, name):
    """Where the cube or the bin of this name is [m]."""
    for item in client.tick().objects:
        if item.name == name:
            return item.position
    box = next(box for box in client.scene().bins if box.name == name)
    return (*box.centre, box.floor_z + 0.02)


def deliver(visitor):
    """Click the cube, then the bin: two tasks, and the robot begins."""
    client = visitor.twin.client
    start = client.tick().robot.true_pose
    visitor.click(middle(client, "cube"))
    visitor.tab("Disturb")
    until(lambda: visitor.page.get_by_label("Selected").first.input_value() == "cube", 30.0, "the cube is not selected")
    visitor.click(middle(client, "bin"))
    tasks = until(lambda: len(client.tick().tasks) == 3 and client.tick().tasks, 30.0, "no new tasks")
    assert [(task.kind, task.target) for task in tasks[1:]] == [("pick", "cube"), ("place", "bin")]
    visitor.state("Running")  # the twin goes on by itself
    until(lambda: math.dist(client.tick().robot.true_pose[:2], start[:2]) > 0.1, 60.0, "it does not begin")
    visitor.tab("Drive")


def test_on_a_tablet_the_robot_is_in_view_and_a_finger_plays_and_pauses(browser, begun):
    twin = begun("exp1", play=False)
    client = twin.client
    visitor = Visitor.enter(browser, twin, TABLET, touch=True)
    page = visitor.page
    start = client.tick().robot.true_pose
    x, y = visitor.aim((*start[:2], HEIGHT))
    at = page.evaluate("([x, y]) => document.elementFromPoint(x, y).tagName", [x, y])
    assert at == "CANVAS", "the robot is behind something"
    visitor.close_notes()
    here = visitor.settled()

    visitor.button("Play").tap()
    visitor.state("Running")
    until(lambda: math.dist(client.tick().robot.true_pose[:2], start[:2]) > 0.6, 120.0, "it stands")
    visitor.button("Pause").tap()
    visitor.state("Paused")
    assert changed(patch(visitor, here, x, y), patch(visitor, visitor.settled(), x, y)) > 0.2, "no robot was there"
    assert visitor.errors == []
    visitor.page.close()


def patch(visitor, picture, x, y):
    """The part of a picture round a place on the screen [px]."""
    box = visitor._canvas()
    left, top = int(x - box["x"]), int(y - box["y"])
    return picture[max(0, top - NEAR) : top + NEAR, max(0, left - NEAR) : left + NEAR]


NO_EFFECT = {"5", "W A S D Q E"}  # the camera stays as it is and may be moved by hand; keys of Viser's own
LOST = "Connection to the server lost"
REFUSED = """([address, count]) => Promise.all([...Array(count)].map(() => new Promise((done) => {
  const socket = new WebSocket(address);
  socket.onclose = done;
})))"""  # attempts that fail, as those of a page whose server is away
FAILED = 32  # from about here on Chromium waits for 1 to 5 s before another, where one has opened before


def test_every_key_that_is_listed_works_while_a_tab_has_the_focus(browser, begun):
    with visiting(browser, begun("exp1")) as visitor:
        client, page, pressed = visitor.twin.client, visitor.page, set()

        def key(name, condition, what):
            assert page.evaluate("document.activeElement.role ?? document.activeElement.getAttribute('role')") == "tab"
            pressed.add({"Delete": "Del", "Escape": "Esc", "Space": "space"}.get(name, name.upper()))
            page.keyboard.press(name)
            until(condition, 30.0, f"key {name}: {what}")

        def bodies():
            return {body.name: body.state for body in (*client.tick().obstacles, *client.tick().agents)}

        visitor.state("Running")
        visitor.tab("Drive")
        key("Space", lambda: client.status().state == "paused", "not paused")
        key("r", lambda: client.tick().index == 0, "no reset")
        for count in range(1, 5):
            key("n", lambda count=count: client.tick().index == count, "no step")
        key("x", lambda: client.status().speed == 2.0, "not faster")
        key("z", lambda: client.status().speed == 1.0, "not slower")
        for count, body in enumerate(("box 1", "cylinder 1", "person 1", "temi 1"), 1):
            key(body[0], lambda n=count, body=body: len(bodies()) == n and body in bodies(), f"no {body}")
        visitor.tab("Disturb")
        asked = re.compile("^Click the floor where")
        visitor.says(asked)
        key("Escape", lambda: not page.get_by_text(asked).count(), "the next click would still put it")
        key("f", lambda: bodies()["temi 1"] == "frozen", "not frozen")
        key("Delete", lambda: "temi 1" not in bodies(), "not deleted")

        visitor.tab("Replay")
        for name, words in (("j", "Looking back"), ("k", "(live)"), ("j", "Looking back"), ("l", "(live)")):
            key(name, lambda words=words: visitor.sees(words), f"not {words}")
        with page.expect_download() as download:
            key("v", lambda: True, "")
        assert download.value.suggested_filename.startswith("exp1-trial1-")
        for name in "2341":
            before = visitor.rest()
            key(name, lambda before=before: not np.allclose(before, visitor.eye(), atol=0.1), "the same view")
        for wanted in (True, False):
            key("g", lambda wanted=wanted: (page.locator(".mp").count() > 0) is wanted, "plots do not open and close")
        wrist = page.locator("canvas.wrist")
        for wanted in (True, False):
            key("i", lambda wanted=wanted: wrist.is_visible() is wanted, "the wrist camera does not come and go")
        key("h", lambda: page.locator("kbd").count() > 0, "no card")
        listed = set(page.locator("kbd").all_inner_texts())
        assert listed - NO_EFFECT == pressed
        _window_of_keys_opens_once_and_goes_away(visitor, client)


def _window_of_keys_opens_once_and_goes_away(visitor, client):
    page, state, index = visitor.page, client.status().state, client.tick().index
    assert (state, index > 0) == ("paused", True)

    def windows(count, way=""):
        until(lambda: page.locator("[role=dialog]").count() == count, 10.0, f"not {count} windows after {way}")

    windows(1)
    ways = {
        "H": lambda: page.keyboard.press("h"),
        "Escape": lambda: page.keyboard.press("Escape"),
        "a click beside it": lambda: page.mouse.click(3, 300),
    }
    for way, away in ways.items():
        page.keyboard.press("n")  # nothing else is meant under a window
        page.keyboard.press("r")
        away()
        windows(0, way)
        page.keyboard.press("h")
        windows(1)
    page.get_by_role("button", name="Close").click()
    windows(0)
    assert (client.status().state, client.tick().index) == (state, index)


def test_space_plays_and_pauses_from_tabs_buttons_lists_sliders_and_checkboxes_but_not_from_a_field(browser, begun):
    with visiting(browser, begun("exp1")) as visitor:
        client, page = visitor.twin.client, visitor.page
        visitor.state("Running")

        def space(state, where):
            page.keyboard.press("Space")
            until(lambda: client.status().state == state, 30.0, f"Space at {where}: not {state}")
            index = client.tick().index
            page.wait_for_timeout(700)  # a button that was pressed as well would turn it back
            assert client.status().state == state, where
            assert state == "playing" or client.tick().index == index, where

        space("paused", "the page")
        visitor.tab("Why")
        space("playing", "a tab")
        visitor.tab("Drive")
        space("paused", "a tab")
        visitor.press("On by one period")
        until(lambda: client.tick().time > 0.0, 30.0, "no step")
        space("playing", "a button")
        visitor.speed("1/2")
        until(lambda: client.status().speed == 0.5, 30.0, "speed")
        space("paused", "a closed list")
        chip = page.get_by_role("button", name="People and Temis")
        chip.click()
        space("playing", "a chip of the legend")
        assert chip.get_attribute("aria-pressed") == "false"
        visitor.tab("Tune")
        box = page.get_by_label("Try in what-if only")
        box.check()  # fails here when the click does nothing
        space("paused", "a checkbox")
        assert box.is_checked()
        space("playing", "a checkbox once more")
        page.locator("[role=slider]").locator("visible=true").first.focus()
        space("paused", "a slider")
        page.locator("input.mantine-NumberInput-input").locator("visible=true").first.focus()
        page.keyboard.press("Space")
        page.wait_for_timeout(700)
        assert client.status().state == "paused", "Space belongs to the field"
        box.uncheck()
        chip.click()


@pytest.mark.timeout(300)
def test_a_page_says_that_its_server_is_away_and_comes_back_however_often_it_has_tried_in_vain(browser):
    port = free_port()
    server = open_page("127.0.0.1", port)
    page = browser.new_page()
    try:
        page.goto(f"http://127.0.0.1:{port}")
        until(lambda: len(server.get_clients()) == 1, SHOWN, "the page does not connect")
        assert not page.get_by_text(LOST).count()

        server.stop()
        page.get_by_text(LOST).wait_for(timeout=SHOWN * 1000)
        page.evaluate(REFUSED, [f"ws://127.0.0.1:{port}", FAILED])
        server = open_page("127.0.0.1", port)
        until(lambda: len(server.get_clients()) == 1, SHOWN, "the page does not come back")
        until(lambda: not page.get_by_text(LOST).count(), SHOWN, "the line stays")
    finally:
        page.close()
        server.stop()
