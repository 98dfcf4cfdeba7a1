"""The page in Chromium: another method is chosen by mouse, drives, and is named wherever it is explained."""

import pytest
from page import SHOWN, serving, until, visiting

from motm_twin.methods.registry import METHODS

LITTLE = {"width": 720, "height": 440}  # less than the panel is high
POINTER = "([x, y]) => getComputedStyle(document.elementFromPoint(x, y)).cursor"


@pytest.mark.browser
@pytest.mark.timeout(600)
def test_a_method_is_chosen_by_mouse_and_named_and_the_next_click_on_the_floor_is_pointed_out():
    with serving("exp1", "--variant", "trial1", "--method", "paper_literal") as twin, visiting(twin, LITTLE) as visitor:
        client, page = twin.client, visitor.page
        driven_by(visitor, "paper_literal")
        visitor.unfold("Scene")
        assert visitor.offered("Method") == [method.title for method in METHODS.values()]
        visitor.choose("Method", METHODS["no_bezier"].title)
        visitor.says(METHODS["no_bezier"].summary)
        run = client.tick().run
        visitor.press("Load")
        until(lambda: client.tick().run > run and client.tick().index > 0, SHOWN, "not loaded")
        assert (client.status().method, client.status().variant) == ("no_bezier", "trial1")
        driven_by(visitor, "no_bezier")
        bar = page.locator(".motm-top").locator("xpath=..").bounding_box()
        assert bar["y"] >= 0.0, "the state of the twin is out of sight once the panel is scrolled"
        visitor.tab("Why")
        driven_by(visitor, "no_bezier")

        middle = [0.3 * LITTLE["width"], 0.5 * LITTLE["height"]]
        assert page.evaluate(POINTER, middle) != "crosshair"
        page.mouse.move(*middle)
        page.keyboard.press("t")
        until(lambda: page.evaluate(POINTER, middle) == "crosshair", SHOWN, "no hint that the floor is clicked next")
        page.keyboard.press("Escape")
        until(lambda: page.evaluate(POINTER, middle) != "crosshair", SHOWN, "the hint stays")
        page.keyboard.press("r")
        until(lambda: client.tick().run > run + 1, SHOWN, "no reset")
        assert client.status().method == "no_bezier"
        assert visitor.errors == []


def driven_by(visitor, name):
    """Wait until the open tab names the method."""
    visitor.page.get_by_text(f"method {METHODS[name].title}").locator("visible=true").first.wait_for(
        timeout=SHOWN * 1000
    )
