"""The page in Chromium: a cube and a bin are clicked; two people, one wheel; names that are no names."""

import math

import pytest
from page import Visitor, changed, chromium, serving, until

EVIL = "<img src=x onerror=window.hacked=1>"
SCENE = f"""
format: motm-scene/1
title: "{EVIL}<script>window.hacked=1</script>"
start: {{x: 0.0, y: 0.0}}
furniture:
  table: {{shape: box, centre: [1.6, 1.0], size: [0.8, 0.8], z: [0.0, 0.75], style: desk}}
  desk: {{shape: box, centre: [1.6, -1.4], size: [0.8, 0.8], z: [0.0, 0.6], style: desk}}
objects:
  cube: {{surface: table, at: [1.45, 0.72]}}
bins:
  bin: {{at: [1.45, -1.2]}}
tasks:
  - drive_to: {{x: 0.0, y: 0.0}}
"""


@pytest.mark.browser
@pytest.mark.timeout(600)
def test_a_cube_and_a_bin_are_clicked_and_two_people_share_one_wheel(tmp_path):
    path = tmp_path / "room.yaml"
    path.write_text(SCENE, encoding="utf-8")
    with serving(path) as twin, chromium() as browser:
        client = twin.client
        ann = Visitor.enter(browser, twin)
        ann.state("Finished")  # the room's own task takes no time
        whole = ann.settled()

        bea = Visitor.enter(browser, twin)  # joins late
        until(lambda: changed(whole, bea.picture()) < 0.02, 60.0, "the late joiner does not see the whole scene")
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
        until(lambda: client.status().driver == "", 60.0, "the wheel is not free after silence")
        ann.says("Nobody is driving")
        until(lambda: takes_the_free_wheel(ann), 120.0, "the free wheel is not taken")
        for page in (ann.page, bea.page):
            assert page.evaluate("window.hacked") is None
            assert page.locator("img[src=x]").count() == 0

        run = client.tick().run
        bea.page.close()
        ann.press("Reset")
        until(lambda: client.tick().run > run, 30.0, "a page that is gone takes something along")
        assert ann.errors + bea.errors == []


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
    """Click the cube, then the bin, and see the cube in the bin."""
    client = visitor.twin.client
    visitor.click(middle(client, "cube"))
    visitor.tab("Disturb")
    until(lambda: visitor.page.get_by_label("Selected").first.input_value() == "cube", 30.0, "the cube is not selected")
    visitor.click(middle(client, "bin"))
    tasks = until(lambda: len(client.tick().tasks) == 3 and client.tick().tasks, 30.0, "no new tasks")
    assert [(task.kind, task.target) for task in tasks[1:]] == [("pick", "cube"), ("place", "bin")]
    visitor.state("Running")  # the twin goes on by itself
    visitor.tab("Drive")
    visitor.choose("Speed", "8x")
    until(lambda: client.tick().score.places == 1, 120.0, "the cube is not delivered")
    box = client.scene().bins[0]
    assert math.dist(middle(client, "cube")[:2], box.centre) < box.side / 2
