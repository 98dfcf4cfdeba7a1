"""The page in Chromium: driving by mouse, scenes and methods, a server that is killed, bodies in the robot's way."""

import json
import math
import os
import signal

import msgspec
import numpy as np
import pytest
from page import EVIL, SHELF, SHELF_TOP, SHOWN, changed, until, visiting

from motm_twin.bus.commands import AddObstacle, Announce
from motm_twin.bus.library import FileLibrary
from motm_twin.methods import DEFAULT_METHOD
from motm_twin.methods.registry import METHODS
from motm_twin.model.edits import MoveBody, ReleaseBody
from motm_twin.perf.page_reader import PageReader
from motm_twin.perf.processes import act
from motm_twin.sessions.session import Session
from motm_twin.sim.bodies import FRICTION
from motm_twin.ui.panel.panel import ASK
from motm_twin.ui.scene.scene_view import drive_points

pytestmark = [pytest.mark.browser, pytest.mark.timeout(600)]  # also the test without one, for its served twin
LITTLE = {"width": 720, "height": 440}  # less than the panel is high; drawing takes time
FLOOR = (2.6, -1.0, 0.0)  # [m] free
POINTER = "([x, y]) => getComputedStyle(document.elementFromPoint(x, y)).cursor"


def test_play_pause_step_speed_and_another_scene_by_mouse_and_a_server_that_dies_comes_back(browser, begun):
    twin = begun("exp1")
    with visiting(browser, twin) as visitor:
        client, page = twin.client, visitor.page
        visitor.state("Running")
        visitor.press("Pause")
        visitor.state("Paused")
        until(lambda: client.status().state == "paused", 30.0, "not paused")
        before = client.tick().index
        for step in (1, 2):
            visitor.press("On by one period")
            until(lambda step=step: client.tick().index == before + step, 30.0, f"step {step}")
        visitor.press("Reset")
        until(lambda: client.tick().index == 0, 30.0, "reset")
        visitor.speed("1/2")
        until(lambda: client.status().speed == 0.5, 30.0, "speed")
        visitor.press("Play")
        until(lambda: client.status().state == "playing", 30.0, "not playing")
        visitor.says("· 0.5×")

        visitor.unfold("Scene", "Method")
        visitor.choose("Scene", "exp2")
        visitor.choose("Variant", "one_temi")
        visitor.press("Load")
        until(lambda: client.scene().name == "exp2" and client.tick().index > 0, 60.0, "exp2 not loaded")
        visitor.says("exp2 / one_temi")
        assert client.status().variant == "one_temi"
        assert visitor.picture().std() > 10.0

        os.kill(twin.server, signal.SIGSTOP)
        visitor.state("Connection lost")
        os.kill(twin.server, signal.SIGCONT)
        visitor.state("Running")
        dead = twin.server
        os.kill(dead, signal.SIGKILL)
        visitor.state("Connection lost")
        visitor.says("reconnects by itself")
        visitor.state("Running")
        visitor.says("room / delivery")  # what `serve` was told
        assert twin.server != dead
        page.keyboard.press("Space")
        until(lambda: client.status().state == "paused", 30.0, "the page can not drive the new server")


def test_every_shipped_scene_is_offered_and_one_that_is_chosen_stays_paused(begun):
    """By the page's own messages; that every variant runs is shown without a page."""
    twin = begun("exp1")
    with PageReader(twin.port, token=twin.token) as page:
        client = twin.client
        choices = FileLibrary("exp1").choices()
        assert page.wait(lambda page: {choice.name for choice in choices} <= set(page.options("Scene")), 60.0)
        page.set(ASK, json.dumps([1, "toggle"]))
        until(lambda: client.status().state == "paused", 30.0, "not paused")
        for choice in choices[-3:]:
            run, variant = client.tick().run, choice.variants[-1]
            page.set("Scene", choice.name, "Dropdown")
            assert page.wait(lambda page, c=choice: list(page.options("Variant")) == c.variants, 30.0)
            page.set("Variant", variant, "Dropdown")
            page.set("Load", True, "Button")
            ran = page.wait(lambda _, run=run: client.tick().run > run, 60.0)
            assert ran, f"{choice.name} / {variant} did not run: {page.notes}"
            assert (client.status().scene, client.status().variant) == (choice.name, variant)
            until(lambda: client.status().state == "paused", 30.0, "it did not stay paused")


def test_a_method_is_chosen_by_mouse_and_named_and_the_next_click_on_the_floor_is_pointed_out(browser, begun):
    with visiting(browser, begun("exp1"), LITTLE) as visitor:
        client, page = visitor.twin.client, visitor.page
        driven_by(visitor, DEFAULT_METHOD)
        visitor.unfold("Scene", "Method")
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


def test_a_click_on_the_floor_asks_first_and_the_drive_can_be_undone(browser, begun):
    with visiting(browser, begun("exp1", play=False)) as visitor:
        client, page = visitor.twin.client, visitor.page
        asked, kinds = page.get_by_text("Drive here?"), lambda: [task.kind for task in client.tick().tasks]
        for answer in ("Escape", "Cancel", "Drive"):
            visitor.click(FLOOR)
            asked.wait_for(timeout=SHOWN * 1000)
            assert "drive_to" not in kinds()
            page.keyboard.press(answer) if answer == "Escape" else visitor.press(answer)
            asked.wait_for(state="hidden", timeout=SHOWN * 1000)
        until(lambda: "drive_to" in kinds(), SHOWN, "no drive")
        x, y = drive_points(client.tick())[0]
        assert math.dist((x, y), FLOOR[:2]) < 0.05
        visitor.says("Drive to (")
        visitor.press("Undo")
        until(lambda: "drive_to" not in kinds(), SHOWN, "not undone")
        visitor.button("Undo").wait_for(state="hidden", timeout=SHOWN * 1000)
        page.mouse.dblclick(*visitor.pixel(FLOOR))
        until(lambda: "drive_to" in kinds(), SHOWN, "no drive after a double click")


def driven_by(visitor, name):
    """Wait until the open tab names the method."""
    title = visitor.page.get_by_text(f"method {METHODS[name].title}").locator("visible=true").first
    title.wait_for(timeout=SHOWN * 1000)


ASIDE = (1.8, -0.5)  # [m] free
GRAB = 0.15  # [m] height at which the Temi is taken: its body
OCCUPIED = 255  # of a cell of the grid
OLD, NEW = SHELF, (-1.5, -0.4)  # [m] where the shelf stands, and is dragged to
HERE, THERE = (-1.4, 1.2), (-0.5, 1.2)  # [m] free floor, which a box is thrown over; 1.7 m from the table
STANDS = (-0.6, -1.2)  # [m] who has a hostile name
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
        visitor.drag([*temi.position[:2], GRAB], [*ASIDE, GRAB])
        until(lambda: math.dist(client.tick().obstacles[0].position[:2], ASIDE) < 0.1, 30.0, "it is not dragged there")


def test_furniture_is_dragged_and_announced_a_box_is_thrown_and_a_hostile_name_is_only_text(browser, begun):
    with visiting(browser, begun("room", "long", play=False)) as visitor:
        client, dialogs = visitor.twin.client, []
        visitor.page.on("dialog", lambda dialog: (dialogs.append(dialog.message), dialog.dismiss()))
        evil = AddObstacle(name=EVIL, shape="temi", x=STANDS[0], y=STANDS[1])
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
    visitor.hover((*STANDS, 0.5))
    until(lambda: page.locator("#motm .tip").text_content() == EVIL, 30.0, "the name is not shown under the mouse")
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
    start = (last.x, last.y)
    until(lambda: math.dist(body(visitor, "box 1").position[:2], start) > 0.8 * way, 30.0, f"no {way:.2f} m: {thrown}")
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
    """Edits of one or more kinds of this run, as its session tells."""
    session = msgspec.json.decode(visitor.twin.client.session(), type=Session)
    return [entry.edit for entry in session.edits if isinstance(entry.edit, kinds)]


def body(visitor, name):
    """A body that was added; None when it is not there."""
    tick = visitor.twin.client.tick()
    return next((found for found in (*tick.obstacles, *tick.agents) if found.name == name), None)


def occupied(client, place):
    """True where the robot's map has something."""
    grid = client.grid()
    column, row = (int((place[i] - grid.info.origin[i]) / grid.info.resolution) for i in (0, 1))
    return bool(grid.cells[row, column] == OCCUPIED)
