"""The page in Chromium: the robot, its sensors and furniture are disturbed by mouse."""

import math
import re

import msgspec
import pytest
from page import serving, until, visiting

from motm_twin.bus.commands import AddObstacle, Announce, HandOver, Pause, Reset
from motm_twin.model.edits import InjectFault, MoveObject, PushRobot
from motm_twin.record.session import Session

EVIL = "<img src=x onerror=window.hacked=1>"
OCCUPIED = 255  # of a cell of the grid
TOP = 0.5  # [m] of the shelf
OLD, NEW = (-1.5, 0.5), (-1.5, -0.4)  # [m] where the shelf stands, and is dragged to
SCENE = (
    f"""
format: motm-scene/1
start: {{x: 0.0, y: 0.0}}
furniture:
  table: {{shape: box, centre: [1.6, 1.0], size: [0.8, 0.8], z: [0.0, 0.75], style: desk}}
  desk: {{shape: box, centre: [1.6, -1.4], size: [0.8, 0.8], z: [0.0, 0.6], style: desk}}
  shelf: {{shape: box, centre: [{OLD[0]}, {OLD[1]}], size: [0.6, 0.6], z: [0.0, {TOP}], style: desk}}
objects:
  cube: {{surface: table, at: [1.45, 0.72]}}
bins:
  bin: {{at: [1.45, -1.2]}}
tasks:
  - pick: cube
  - place: bin
"""
    + 60 * "  - drive_to: {x: 0.9, y: -0.3}\n  - drive_to: {x: 0.3, y: -0.3}\n"
)


@pytest.mark.browser
@pytest.mark.timeout(600)
def test_the_robot_its_sensors_and_bodies_are_disturbed_by_mouse_and_a_hostile_name_is_only_text(tmp_path):
    path = tmp_path / "room.yaml"
    path.write_text(SCENE, encoding="utf-8")
    with serving(path) as twin, visiting(twin) as visitor:
        client, dialogs = twin.client, []
        visitor.page.on("dialog", lambda dialog: (dialogs.append(dialog.message), dialog.dismiss()))
        evil = AddObstacle(name=EVIL, shape="temi", x=-0.6, y=-1.2)
        for command in (Pause(), Reset(), evil, HandOver()):  # of another program: the page drives from here on
            until(lambda command=command: client.command(command).ok, 60.0, f"not done: {command}")
        visitor.choose("Speed", "1/2")
        visitor.tab("Disturb")
        visitor.page.keyboard.press("Space")
        until(lambda: client.status().state == "playing", 30.0, "not playing")
        the_cube_is_taken_away(visitor)
        the_robot_is_pushed_and_blinded(visitor)
        until(lambda: client.tick().score.places == 1, 120.0, "the robot does not get over it")
        furniture_is_moved_and_announced(visitor)
        a_hostile_name_is_only_text(visitor)
        assert client.status().state == "playing"
        assert dialogs == []
        assert visitor.errors == []


def the_cube_is_taken_away(visitor):
    client, take = visitor.twin.client, "Take the cube from the gripper"
    visitor.button(take).wait_for(timeout=120_000)  # only while it holds one
    visitor.press(take)
    (edit,) = until(lambda: done(visitor, MoveObject), 30.0, "no cube is taken")
    assert (edit.name, edit.x, edit.y) == ("cube", 1.45, 0.72)
    until(lambda: client.tick().objects[0].state != "held", 30.0, "it still holds the cube")
    visitor.button(take).wait_for(state="hidden", timeout=60_000)


def the_robot_is_pushed_and_blinded(visitor):
    client = visitor.twin.client
    for count, (press, moved) in enumerate((("◀ Left", 0.1), ("▼ Back", 0.1)), 1):
        visitor.press(press)
        pushes = until(
            lambda count=count: len(done(visitor, PushRobot)) == count and done(visitor, PushRobot), 30.0, press
        )
        assert math.hypot(pushes[-1].dx, pushes[-1].dy) == pytest.approx(moved)
    visitor.press("Lidar off 1 s")
    until(lambda: done(visitor, InjectFault), 30.0, "the lidar is not off")
    words = until(lambda: client.tick().faults, 30.0, "no fault is shown")[0]
    until(lambda: client.tick().faults == [], 60.0, f"for ever: {words}")
    visitor.press("Camera off 2 s")
    shown = visitor.page.get_by_text(re.compile("^camera off ")).locator("visible=true").first
    shown.wait_for(timeout=60_000)
    shown.wait_for(state="hidden", timeout=60_000)
    assert [edit.fault for edit in done(visitor, InjectFault)] == ["lidar_off", "camera_off"]


def furniture_is_moved_and_announced(visitor):
    """The map has the shelf where it was until the robot is told."""
    client = visitor.twin.client
    assert occupied(client, OLD) and not occupied(client, NEW)
    visitor.click((*OLD, TOP))  # what is not selected needs Shift
    selected = visitor.page.get_by_label("Selected").first
    until(lambda: selected.input_value() == "shelf", 30.0, "the shelf is not selected")
    visitor.drag((*OLD, TOP), (*NEW, TOP))
    moved = until(lambda: client.tick().furniture, 30.0, "the shelf is not moved")[0]
    until(lambda: client.tick().furniture[0].state != "held", 30.0, "it is held for ever")
    place = client.tick().furniture[0].position
    assert moved.name == "shelf" and math.dist(place[:2], NEW) < 0.1
    assert not occupied(client, NEW)
    assert done(visitor, Announce) == []
    visitor.press("Tell the robot")
    until(lambda: done(visitor, Announce), 30.0, "nothing is announced")
    until(lambda: occupied(client, NEW) and not occupied(client, OLD), 60.0, "the map does not follow")


def a_hostile_name_is_only_text(visitor):
    page = visitor.page
    visitor.choose("Selected", EVIL)
    visitor.press("Send to…")
    visitor.says(f"Click the floor where {EVIL} should go.")
    visitor.press("Do not send")
    visitor.press("Delete")
    until(lambda: body(visitor, EVIL) is None, 30.0, "it is still there")
    assert page.evaluate("window.hacked") is None
    assert page.locator("img[src=x]").count() == 0


def done(visitor, kind):
    """What was done of one kind to this run, as its session tells."""
    session = msgspec.json.decode(visitor.twin.client.session(), type=Session)
    return [entry.edit for entry in session.edits if isinstance(entry.edit, kind)]


def body(visitor, name):
    """A body that was added; None when it is not there."""
    tick = visitor.twin.client.tick()
    return next((found for found in (*tick.obstacles, *tick.agents) if found.name == name), None)


def occupied(client, place):
    """Whether the robot's map has something here."""
    grid = client.grid()
    column, row = (int((place[i] - grid.info.origin[i]) / grid.info.resolution) for i in (0, 1))
    return bool(grid.cells[row, column] == OCCUPIED)
