"""The page in Chromium: driving by mouse, every scene and method, and a server that is killed and there again."""

import json
import math
import os
import signal

import pytest
from page import SHOWN, until, visiting

from motm_twin.bus.library import FileLibrary
from motm_twin.methods import DEFAULT_METHOD
from motm_twin.methods.registry import METHODS
from motm_twin.perf.page_reader import PageReader
from motm_twin.ui.panel.panel import ASK
from motm_twin.ui.scene.plan_view import drive_points

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
    visitor.page.get_by_text(f"method {METHODS[name].title}").locator("visible=true").first.wait_for(
        timeout=SHOWN * 1000
    )
