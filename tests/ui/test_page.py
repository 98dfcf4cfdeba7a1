"""The page in real Chromium, with the real twin behind it, used by mouse and keyboard as a person would."""

import itertools
import math
import os
import signal
from pathlib import Path

import numpy as np
import pytest
from page import Visitor, serving, until, visiting

GRAB = 0.15  # [m] height at which the Temi is taken: its body
COMPILING = 240.0  # [s] the first start of the twin on a busy machine


def page_shows(page, text):
    page.get_by_text(text).first.wait_for(timeout=60_000)


def page_says(page, state):
    page.get_by_text(state, exact=True).first.wait_for(timeout=60_000)


def ahead(tick, distance):
    """A point of the robot's own path, ``distance`` [m] ahead."""
    path = np.array([tick.robot.pose[:2], *tick.plan.global_path])
    for start, end in itertools.pairwise(path):
        length = float(np.linalg.norm(end - start))
        if distance <= length:
            return start + (end - start) * (distance / length)
        distance -= length
    return path[-1]


def gap(tick, name):
    """Distance [m] from the robot's footprint to the disc of a Temi."""
    body = next(body for body in tick.obstacles if body.name == name)
    x, y, heading = tick.robot.true_pose
    dx, dy = body.position[0] - x, body.position[1] - y
    along = abs(math.cos(heading) * dx + math.sin(heading) * dy) - 0.35
    across = abs(-math.sin(heading) * dx + math.cos(heading) * dy) - 0.25
    return math.hypot(max(along, 0.0), max(across, 0.0)) - 0.25


@pytest.mark.browser
@pytest.mark.timeout(600)
def test_the_page_loads_the_robot_moves_and_avoids_a_temi_that_is_dragged_into_its_way():
    with serving("exp1", "--variant", "trial1") as (url, client), visiting(url) as page:
        errors = []
        page.on("pageerror", lambda error: errors.append(str(error)))
        visitor = Visitor(page, until(client.scene, COMPILING, "no scene"))
        page_shows(page, "motm-twin")
        first = until(client.tick, COMPILING, "the twin never ran")
        page_says(page, "Running")
        moved = until(lambda: math.dist(client.tick().robot.pose[:2], first.robot.pose[:2]) > 0.05, 60.0, "it stands")
        assert moved
        visitor.close_notes()

        page.keyboard.press("Space")
        page_says(page, "Paused")
        page.keyboard.press("r")
        until(lambda: client.tick().index == 0, 30.0, "reset by keyboard")
        page.keyboard.press("n")
        until(lambda: client.tick().index == 1, 30.0, "one step by keyboard")
        page.get_by_role("button", name="Add Temi").click()
        temi = until(lambda: client.tick().obstacles, 30.0, "the Temi was not added")[0]
        page.wait_for_timeout(2500)  # the page draws it

        placement = client.tick().placement
        x, y, _ = placement.poses[placement.chosen]
        visitor.click((x, y, 0.035))
        page_shows(page, "rank 1")

        target = ahead(client.tick(), 1.6)
        visitor.drag([*temi.position[:2], GRAB], [*target, GRAB])
        placed = until(
            lambda: next((b for b in client.tick().obstacles if math.dist(b.position[:2], target) < 0.1), None),
            30.0,
            f"dragged to {target}, but the Temi is at {client.tick().obstacles[0].position}",
        )
        page.get_by_role("button", name="Play").click()
        page_says(page, "Running")

        gaps, picks = [], 0

        def delivered():
            nonlocal picks
            tick = client.tick()
            gaps.append(gap(tick, placed.name))
            picks = tick.score.picks
            assert not [c for c in tick.score.contacts if c.caused_by_robot and c.other == placed.name]
            return tick.score.places >= 1

        until(delivered, 240.0, f"the robot did not deliver its first cube past the Temi; picks: {picks}")
        assert min(gaps) > 0.0
        assert errors == []


@pytest.mark.browser
@pytest.mark.timeout(600)
def test_another_variant_is_chosen_by_mouse_and_a_silent_server_is_told():
    with serving("exp1") as (url, client), visiting(url) as page:
        until(client.tick, COMPILING, "the twin never ran")
        page_says(page, "Running")
        page.get_by_label("Variant").click()
        page.get_by_role("option", name="trial4").click()
        page.get_by_role("button", name="Load").click()
        until(lambda: client.status().variant == "trial4" and client.scene().variant == "trial4", 60.0, "not loaded")
        page_shows(page, "exp1 / trial4")
        server = next(
            pid for pid in processes("motm_twin.bus.server_process") if client.endpoint.rsplit(":")[-1] in command(pid)
        )
        os.kill(server, signal.SIGSTOP)
        page_says(page, "Connection lost")
        os.kill(server, signal.SIGCONT)
        page_says(page, "Running")


def processes(module):
    """Numbers of the processes that run a module."""
    return [int(path.name) for path in Path("/proc").glob("[0-9]*") if module in command(int(path.name))]


def command(pid):
    try:
        return Path(f"/proc/{pid}/cmdline").read_text(encoding="utf-8").replace("\0", " ")
    except OSError:
        return ""
