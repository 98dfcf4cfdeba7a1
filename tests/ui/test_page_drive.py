"""The page in Chromium: driving by mouse, every scene, and a server that is silent, killed and there again."""

import os
import signal

import pytest
from page import serving, until, visiting

from motm_twin.bus.library import FileLibrary
from motm_twin.perf.page_reader import PageReader


@pytest.mark.browser
@pytest.mark.timeout(600)
def test_play_pause_step_speed_and_another_scene_by_mouse_and_a_server_that_dies_comes_back():
    with serving("exp1") as twin, visiting(twin) as visitor:
        client, page = twin.client, visitor.page
        visitor.state("Running")
        visitor.press("Pause")
        visitor.state("Paused")
        until(lambda: client.status().state == "paused", 30.0, "not paused")
        before = client.tick().index
        for step in (1, 2):
            visitor.press("Step")
            until(lambda step=step: client.tick().index == before + step, 30.0, f"step {step}")
        visitor.press("Reset")
        until(lambda: client.tick().index == 0, 30.0, "reset")
        visitor.choose("Speed", "1/2")
        until(lambda: client.status().speed == 0.5, 30.0, "speed")
        visitor.press("Play")
        until(lambda: client.status().state == "playing", 30.0, "not playing")
        visitor.says("speed 0.5×, actual")

        visitor.unfold("Scene")
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
        visitor.says("exp1 / trial1")  # what `serve` was told
        assert twin.server != dead
        page.keyboard.press("Space")
        until(lambda: client.status().state == "paused", 30.0, "the page can not drive the new server")
        assert visitor.errors == []


@pytest.mark.timeout(600)
def test_every_variant_of_every_shipped_scene_can_be_chosen_and_stays_paused():
    with serving("exp1") as twin, PageReader(twin.port, token=twin.token) as page:
        client = twin.client
        assert page.wait(lambda page: page.find("Load") and page.find("Variant"), 60.0)
        assert page.wait(lambda page: page.find("Pause"), 60.0)
        page.set("Pause", True)
        until(lambda: client.status().state == "paused", 30.0, "not paused")
        for choice in FileLibrary("exp1").choices():
            for variant in choice.variants:
                run = client.tick().run
                page.set("Scene", choice.name, "Dropdown")
                assert page.wait(lambda page, v=variant: v in page.options("Variant"), 30.0)
                page.set("Variant", variant, "Dropdown")
                page.set("Load", True, "Button")
                ran = page.wait(lambda _, run=run: client.tick().run > run, 60.0)
                assert ran, f"{choice.name} / {variant} did not run: {page.notes}"
                assert (client.status().scene, client.status().variant) == (choice.name, variant)
                until(lambda: client.status().state == "paused", 30.0, "it did not stay paused")
