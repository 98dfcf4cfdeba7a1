"""Letting a twin run until something happens, and reading its Ticks."""

import re

import msgspec
import pytest

from motm_twin.model.scene_file import load_scene
from motm_twin.twin import Twin

SCENE = load_scene("exp1", "trial1", 0)
SHORT = msgspec.structs.replace(SCENE, tasks=SCENE.tasks[:2])
CUBE, BIN = SCENE.tasks[0].object, SCENE.tasks[1].bin


_run, _moments = [], {}  # a run of SHORT as far as a test has asked, and its first Tick and state in each phase


def short(phase):
    """A run of SHORT that has just come into a phase of the arm, and its Tick."""
    while phase not in _moments:
        if not _run:
            _run.append(Twin(SHORT))
        tick = _run[0].advance()
        if tick.arm[-1].phase not in _moments:
            _moments[tick.arm[-1].phase] = tick, _run[0].snapshot()
    tick, state = _moments[phase]
    twin = Twin(SHORT)
    twin.restore(state)
    return twin, tick


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
    """Whether the reason to stand contains a pattern."""
    return lambda tick: re.search(words, tick.stop_reason) is not None


def in_phase(*phases):
    """Whether the arm is in one of these phases."""
    return lambda tick: tick.arm[-1].phase in phases


def caused(tick):
    """Contacts that the robot has caused."""
    return [contact for contact in tick.truth.contacts if contact.caused_by_robot]
