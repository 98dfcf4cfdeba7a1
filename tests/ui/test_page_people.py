"""The page in Chromium: two people and one wheel, names that are no names, and a tablet."""

import math

import numpy as np
import pytest
from page import Visitor, changed, until, visiting
from room import EVIL

from motm_twin.bus.commands import HandOver

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
        bea.says("Ann <img src=x")
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
        ann.says("Bea <img src=x")
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
    visitor.click(middle(client, "cube"))
    visitor.tab("Disturb")
    until(lambda: visitor.page.get_by_label("Selected").first.input_value() == "cube", 30.0, "the cube is not selected")
    visitor.click(middle(client, "bin"))
    tasks = until(lambda: len(client.tick().tasks) == 3 and client.tick().tasks, 30.0, "no new tasks")
    assert [(task.kind, task.target) for task in tasks[1:]] == [("pick", "cube"), ("place", "bin")]
    visitor.state("Running")  # the twin goes on by itself
    until(lambda: client.tick().robot.twist[0] > 0.1, 60.0, "it does not begin")
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
