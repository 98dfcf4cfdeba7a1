"""The page in Chromium, by mouse and keyboard as a person would: bodies and furniture in the robot's way."""

import math

import msgspec
import numpy as np
import pytest
from page import SHOWN, changed, until, visiting
from room import EVIL, SHELF, SHELF_TOP

from motm_twin.bus.commands import AddObstacle, Announce
from motm_twin.model.edits import MoveBody, ReleaseBody
from motm_twin.perf.processes import act
from motm_twin.sessions.session import Session
from motm_twin.sim.slides import FRICTION

pytestmark = [pytest.mark.browser, pytest.mark.timeout(600)]
FLOOR = (1.8, -0.5)  # [m] free
GRAB = 0.15  # [m] height at which the Temi is taken: its body
OCCUPIED = 255  # of a cell of the grid
OLD, NEW = SHELF, (-1.5, -0.4)  # [m] where the shelf stands, and is dragged to
HERE, THERE = (-1.4, 1.2), (-0.5, 1.2)  # [m] free floor, which a box is thrown over; 1.7 m from the table
HEIGHT = 0.3  # [m] at which a box is taken
NEAR = 0.1  # [m] from where the hand has let go
DRAWN = 1e-3  # share of the pixels that a Temi changes at least
TRIES = 6  # to throw: a page that draws slowly sees no speed at times


def test_the_page_loads_the_robot_moves_and_a_temi_is_dragged_to_where_it_should_stand(browser, begun):
    with visiting(browser, begun("exp1")) as visitor:
        client, page = visitor.twin.client, visitor.page
        visitor.says("motm-twin")
        visitor.state("Running")
        first = client.tick()
        until(lambda: math.dist(client.tick().robot.pose[:2], first.robot.pose[:2]) > 0.05, 60.0, "it stands")

        page.keyboard.press("Space")
        visitor.state("Paused")
        page.keyboard.press("r")
        until(lambda: client.tick().index == 0, 30.0, "reset by keyboard")
        visitor.tab("Disturb")
        before = visitor.picture()
        visitor.press("Temi")
        temi = until(lambda: client.tick().obstacles, 30.0, "the Temi was not added")[0]
        until(lambda: changed(before, visitor.picture()) > DRAWN, 30.0, "the page does not draw it")
        visitor.drag([*temi.position[:2], GRAB], [*FLOOR, GRAB])
        until(
            lambda: math.dist(client.tick().obstacles[0].position[:2], FLOOR) < 0.1,
            30.0,
            f"dragged to {FLOOR}, but the Temi is at {client.tick().obstacles[0].position}",
        )


def test_furniture_is_dragged_and_announced_a_box_is_thrown_and_a_hostile_name_is_only_text(browser, begun):
    with visiting(browser, begun("room", "long", play=False)) as visitor:
        client, dialogs = visitor.twin.client, []
        visitor.page.on("dialog", lambda dialog: (dialogs.append(dialog.message), dialog.dismiss()))
        evil = AddObstacle(name=EVIL, shape="temi", x=-0.6, y=-1.2)
        act(client, evil)  # of another program: the page drives from here on
        visitor.tab("Disturb")
        visitor.page.keyboard.press("Space")
        until(lambda: client.status().state == "playing", 30.0, "not playing")
        furniture_is_moved_and_announced(visitor)
        a_hostile_name_is_only_text(visitor)
        a_box_is_thrown(visitor)
        assert client.status().state == "playing"
        assert dialogs == []


def furniture_is_moved_and_announced(visitor):
    """The map has the shelf where it was until the robot is told."""
    client = visitor.twin.client
    assert occupied(client, OLD) and not occupied(client, NEW)
    visitor.drag((*OLD, SHELF_TOP), (*NEW, SHELF_TOP))
    moved = until(lambda: client.tick().furniture, 30.0, "the shelf is not moved")[0]
    until(lambda: client.tick().furniture[0].state != "held", 30.0, "it is held for ever")
    place = client.tick().furniture[0].position
    assert moved.name == "shelf" and math.dist(place[:2], NEW) < 0.1
    assert not occupied(client, NEW)
    assert done(visitor, Announce) == []
    visitor.click((*NEW, SHELF_TOP))
    selected = visitor.page.get_by_label("Selected").first
    until(lambda: selected.input_value() == "shelf", 30.0, "the shelf is not selected")
    visitor.press("Tell the robot")
    until(lambda: done(visitor, Announce), 30.0, "nothing is announced")
    until(lambda: "shelf" in client.tick().announced, 30.0, "the tick does not tell")
    until(lambda: occupied(client, NEW) and not occupied(client, OLD), 60.0, "the map does not follow")


def a_hostile_name_is_only_text(visitor):
    page = visitor.page
    visitor.choose("Selected", EVIL)
    visitor.press("Send to…")
    visitor.says(f"Click the floor where {EVIL} should go")
    visitor.press("Do not send")
    visitor.button("Send to…").wait_for(timeout=SHOWN * 1000)  # the panel has its buttons where they were
    visitor.press("Delete")
    until(lambda: body(visitor, EVIL) is None, 30.0, "it is still there")
    assert page.evaluate("window.hacked") is None
    assert page.locator("img[src=x]").count() == 0


def a_box_is_thrown(visitor):
    place_new(visitor, "Box", "box 1", (HERE, THERE))
    for _ in range(TRIES):
        start = body(visitor, "box 1").position[:2]
        end = max(HERE, THERE, key=lambda place: math.dist(place, start))
        throw(visitor, start, end)
        last, thrown = until(lambda end=end: let_go(visitor, end), 30.0, f"it is not let go at {end}")
        if thrown.velocity != (0.0, 0.0):
            break
    assert 0.4 <= math.hypot(*thrown.velocity) <= 2.5 + 1e-9, "put down, not thrown"
    way = math.hypot(*thrown.velocity) ** 2 / (2.0 * FRICTION)  # nothing is in it
    until(
        lambda: math.dist(body(visitor, "box 1").position[:2], (last.x, last.y)) > 0.8 * way,
        30.0,
        f"it does not slide {way:.2f} m: {last}, {thrown}",
    )
    visitor.press("Delete")
    until(lambda: body(visitor, "box 1") is None, 30.0, "the box is still there")


def place_new(visitor, button, name, places):
    """Add a body, and click the floor where it should stand: at the one of the places that it hides least."""
    visitor.press(button)
    added = until(lambda: body(visitor, name), 30.0, f"no {name}").position
    centre = visitor.pixel((*added[:2], HEIGHT))
    place = max(places, key=lambda spot: math.dist(visitor.pixel((*spot, 0.0)), centre))
    visitor.says(f"Click the floor where {name} should stand")
    visitor.close_notes()  # they lie over the floor
    visitor.click((*place, 0.0))
    until(lambda: math.dist(body(visitor, name).position[:2], place) < 0.05, 30.0, f"{name} does not stand there")
    visitor.page.wait_for_timeout(1000)  # until the page draws it
    return place


def throw(visitor, start, end):
    """Take a body there, move, and let go while moving: the last of the way belongs to the release."""
    mouse, events = visitor.page.mouse, visitor.page.context.new_cdp_session(visitor.page)
    way = [np.asarray(start) + part * np.subtract(end, start) for part in np.linspace(0.0, 1.0, 6)]
    visitor.hover((*start, HEIGHT))
    mouse.down()
    for x, y in way[1:-1]:
        mouse.move(*visitor.pixel((x, y, HEIGHT)))
    x, y = visitor.pixel((*end, HEIGHT))
    release = {"type": "mouseReleased", "x": x, "y": y, "button": "left", "clickCount": 1}
    events.send("Input.dispatchMouseEvent", release)
    mouse.up()  # Playwright has not seen it


def let_go(visitor, end):
    """The last move of the box, and its release; None unless the hand has come to the end and let go of it.

    The twin lets go, too, of what it hears nothing of for a while: then there are more moves.
    """
    gesture = [edit for edit in done(visitor, (MoveBody, ReleaseBody)) if edit.name == "box 1"][-2:]
    if [type(edit) for edit in gesture] != [MoveBody, ReleaseBody]:
        return None
    return gesture if math.dist((gesture[0].x, gesture[0].y), end) < NEAR else None


def done(visitor, kinds):
    """What was done of one or more kinds to this run, as its session tells."""
    session = msgspec.json.decode(visitor.twin.client.session(), type=Session)
    return [entry.edit for entry in session.edits if isinstance(entry.edit, kinds)]


def body(visitor, name):
    """A body that was added; None when it is not there."""
    tick = visitor.twin.client.tick()
    return next((found for found in (*tick.obstacles, *tick.agents) if found.name == name), None)


def occupied(client, place):
    """Whether the robot's map has something here."""
    grid = client.grid()
    column, row = (int((place[i] - grid.info.origin[i]) / grid.info.resolution) for i in (0, 1))
    return bool(grid.cells[row, column] == OCCUPIED)
