"""The tour of the page in Chromium, as a new visitor takes it."""

import pytest
from page import Visitor, until

from motm_twin.bus.commands import Pause
from motm_twin.perf.processes import act
from motm_twin.ui.scene.picking import CANDIDATE_HEIGHT


@pytest.mark.browser
@pytest.mark.timeout(600)
def test_the_tour_shows_a_place_and_its_costs_a_temi_in_the_way_and_why_it_plans_ahead(browser, begun):
    visitor = Visitor.enter(browser, begun("exp1"), welcome=True)
    client, page = visitor.twin.client, visitor.page
    visitor.press("Tour of one minute")
    visitor.says("1 of 4")
    until(lambda: client.status().state == "paused", 30.0, "it does not wait")
    visitor.press("Reset")
    until(lambda: client.tick().index == 0, 30.0, "not at the start")
    placement = client.tick().placement
    visitor.click((*placement.poses[placement.chosen][:2], CANDIDATE_HEIGHT))
    visitor.says("2 of 4")  # by itself
    visitor.says("and on to the next target")
    visitor.press("Next")
    visitor.press("Drop a Temi")
    until(lambda: len(client.tick().obstacles) == 1, 30.0, "no Temi")
    until(lambda: client.status().state == "playing", 30.0, "it does not go on")
    visitor.press("Next")
    visitor.press("Why plan for the next target?")
    visitor.says("as it was")
    visitor.press("Stop")
    visitor.press("Done")
    assert page.locator("#motm-tour").count() == 0
    page.goto("about:blank")
    act(client, Pause())
    until(lambda: client.status().state == "paused", 30.0, "it does not pause")
    page.goto(f"{visitor.twin.url}&fixedDpr=1#cam=Top")  # a link, of a twin that tells nothing new
    page.locator(".cover").wait_for(state="detached", timeout=60_000)
    assert page.locator("#motm-tour").count() == 0  # once is enough
    until(lambda: looks_down(visitor), 60.0, "the link does not choose the camera")
    assert visitor.errors == []
    page.close()


def looks_down(visitor):
    """True while the camera is above the scene."""
    camera = visitor._camera()
    return camera is not None and camera[0][2, 1] > 0.95
