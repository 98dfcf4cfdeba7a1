"""The page in Chromium on a tablet: the robot is in view, a finger presses Play and drags a Temi."""

import math

import numpy as np
import pytest
from page import Visitor, changed, chromium, serving, until

from motm_twin.bus.commands import AddObstacle, HandOver, Pause, Reset

TABLET = {"width": 1024, "height": 768}
NEAR = 45  # [px] round the middle of the robot
GRAB = 0.3  # [m] height at which the Temi is taken: its body
PLACE = (0.6, -0.9)  # [m] of the Temi, beside the way


class Finger:
    """One finger on the screen, as Chromium sees it."""

    def __init__(self, page):
        self._page, self._events = page, page.context.new_cdp_session(page)

    def drag(self, pixels):
        """Down at the first of these pixels, over all others, hold still, up."""
        self._touch("touchStart", pixels[0])
        for pixel in pixels[1:]:
            self._page.wait_for_timeout(80)
            self._touch("touchMove", pixel)
        self._page.wait_for_timeout(600)
        self._events.send("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})

    def _touch(self, kind, pixel):
        points = [{"x": float(pixel[0]), "y": float(pixel[1])}]
        self._events.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})


@pytest.mark.browser
@pytest.mark.timeout(600)
def test_on_a_tablet_the_robot_is_in_view_and_a_finger_plays_and_drags_a_temi():
    with serving("exp1", "--variant", "trial1") as twin, chromium() as browser:
        client = twin.client
        for command in (Pause(), Reset(), AddObstacle(name="Temi", shape="temi", x=PLACE[0], y=PLACE[1]), HandOver()):
            until(lambda command=command: client.command(command).ok, 60.0, f"not done: {command}")
        until(lambda: client.tick().index == 0 and client.tick().obstacles, 60.0, "not at the start")
        page = browser.new_context(viewport=TABLET, has_touch=True).new_page()
        visitor = Visitor(page, twin)
        page.goto(twin.url)
        visitor.button("Play").wait_for(timeout=60_000)
        visitor.button("Got it").tap(timeout=60_000)
        visitor.button("Got it").wait_for(state="hidden", timeout=60_000)
        start = client.tick().robot.true_pose
        x, y = visitor.aim((*start[:2], GRAB))
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

        temi = client.tick().obstacles[0].position[:2]
        target = (temi[0] - 0.4, temi[1] - 0.2)
        way = [
            visitor.pixel((*(np.add(temi, np.subtract(target, temi) * part)), GRAB)) for part in np.linspace(0, 1, 13)
        ]
        Finger(page).drag(way)
        until(
            lambda: math.dist(client.tick().obstacles[0].position[:2], target) < 0.1,
            30.0,
            f"dragged to {target}, but it is at {client.tick().obstacles[0].position}",
        )
        until(lambda: client.tick().obstacles[0].state != "held", 30.0, "it is held for ever")
        assert visitor.errors == []


def patch(visitor, picture, x, y):
    """The part of a picture round a place on the screen [px]."""
    box = visitor._canvas()
    left, top = int(x - box["x"]), int(y - box["y"])
    return picture[max(0, top - NEAR) : top + NEAR, max(0, left - NEAR) : left + NEAR]
