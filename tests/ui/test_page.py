"""The page in real Chromium, with the real twin behind it, used by mouse and keyboard as a person would: disturbing."""

import itertools
import math

import numpy as np
import pytest
from page import serving, until, visiting

GRAB = 0.15  # [m] height at which the Temi is taken: its body


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
    with serving("exp1", "--variant", "trial1") as twin, visiting(twin) as visitor:
        client, page = twin.client, visitor.page
        visitor.says("motm-twin")
        visitor.state("Running")
        first = client.tick()
        until(lambda: math.dist(client.tick().robot.pose[:2], first.robot.pose[:2]) > 0.05, 60.0, "it stands")

        page.keyboard.press("Space")
        visitor.state("Paused")
        page.keyboard.press("r")
        until(lambda: client.tick().index == 0, 30.0, "reset by keyboard")
        page.keyboard.press("n")
        until(lambda: client.tick().index == 1, 30.0, "one step by keyboard")
        visitor.tab("Disturb")
        visitor.press("Temi")
        temi = until(lambda: client.tick().obstacles, 30.0, "the Temi was not added")[0]
        visitor.settled()  # the page draws it

        target = ahead(client.tick(), 1.6)
        visitor.drag([*temi.position[:2], GRAB], [*target, GRAB])
        placed = until(
            lambda: next((b for b in client.tick().obstacles if math.dist(b.position[:2], target) < 0.1), None),
            30.0,
            f"dragged to {target}, but the Temi is at {client.tick().obstacles[0].position}",
        )
        visitor.tab("Drive")
        visitor.choose("Speed", "4x")
        visitor.press("Play")
        visitor.state("Running")

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
        assert visitor.errors == []
