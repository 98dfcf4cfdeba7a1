"""Letting a twin run until something happens, and reading its Ticks."""

import re

import msgspec
import pytest

from motm_twin.model.scene_file import load_scene
from motm_twin.twin import Twin

SCENE = load_scene("exp1", "trial1", 0)
SHORT = msgspec.structs.replace(SCENE, tasks=SCENE.tasks[:2])
FOUR = msgspec.structs.replace(SCENE, tasks=SCENE.tasks[:4])
CUBE, BIN = SCENE.tasks[0].object, SCENE.tasks[1].bin


_runs = {}  # by tasks: a run as far as a test has asked, and its first Tick and state in each phase


def short(phase, scene=SHORT):
    """A run of SHORT, or of FOUR, that has just come into a phase of the arm, and its Tick."""
    if scene.tasks not in _runs:
        _runs[scene.tasks] = Twin(scene), {}
    run, moments = _runs[scene.tasks]
    while phase not in moments:
        tick = run.advance()
        if tick.arm[-1].phase not in moments:
            moments[tick.arm[-1].phase] = tick, run.snapshot()
    tick, state = moments[phase]
    twin = Twin(scene)
    twin.restore(state)
    return twin, tick


def holding(scene=SHORT):
    """Such a run that has just picked its first cube."""
    twin, _ = short("lift", scene)
    advance_until(twin, lambda tick: tick.tasks[0].status == "done")
    return twin


def advance(twin, periods):
    """The Tick after so many periods."""
    for _ in range(periods):
        tick = twin.advance()
    return tick


def advance_until(twin, test, limit=600):
    """The first Tick that passes a test."""
    for _ in range(limit):
        tick = twin.advance()
        if test(tick):
            return tick
    pytest.fail(f"not within {limit} periods; last reason: {tick.stop_reason!r}")


def says(words):
    """A test for `advance_until`: the reason to stand matches a regular expression."""
    return lambda tick: re.search(words, tick.stop_reason) is not None


def caused(tick):
    """Contacts that the robot has caused."""
    return [contact for contact in tick.truth.contacts if contact.caused_by_robot]
