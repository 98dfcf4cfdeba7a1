"""The page in Chromium on a phone: two fingers zoom, one turns the view or takes a body along, a tap asks first."""

import math

import numpy as np
import pytest
from page import SHOWN, Hand, Visitor, until

from motm_twin.bus.commands import AddObstacle
from motm_twin.perf.processes import act

PHONE = {"width": 390, "height": 844}
BOX, FLOOR = (1.6, 0.4), (2.6, -0.9, 0.0)  # [m] free floor
STEPS = 10  # of a gesture


@pytest.mark.browser
@pytest.mark.timeout(600)
def test_fingers_zoom_turn_drag_and_tap_at_the_size_of_a_phone(browser, begun):
    twin = begun("exp1", play=False)
    visitor = Visitor.enter(browser, twin, PHONE)
    hand = Hand(visitor.page)

    middle, view = visitor.pixel(FLOOR), visitor.eye()
    hand.drags([way(middle, (-20, 0), (-90, 0)), way(middle, (20, 0), (90, 0))])
    until(lambda: nearer(view, visitor.eye()) > 0.3, SHOWN, "two fingers that part do not go nearer")
    view = visitor.eye()
    hand.drags([way(middle, (-90, 0), (-30, 0)), way(middle, (90, 0), (30, 0))])
    until(lambda: nearer(view, visitor.eye()) < -0.3, SHOWN, "two fingers that meet do not go back")

    view = visitor.eye()
    hand.drags([way(visitor.pixel(FLOOR), (0, 0), (70, 0))])
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
    hand.drags([[visitor.pixel(FLOOR)]])
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
