"""The page in Chromium: keys work wherever the focus is, and a lost connection comes back."""

import re

import numpy as np
import pytest
from page import SHOWN, until, visiting

from motm_twin.bus.connection import free_port
from motm_twin.ui.page_server import open_page

pytestmark = [pytest.mark.browser, pytest.mark.timeout(600)]
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
        for number, (name, body) in enumerate(
            (("b", "box 1"), ("c", "cylinder 1"), ("p", "person 1"), ("t", "temi 1"))
        ):
            key(name, lambda n=number, body=body: len(bodies()) == n + 1 and body in bodies(), f"no {body}")
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
