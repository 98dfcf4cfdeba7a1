"""What docs/zenoh.md says is allowed is what the gate takes."""

import contextlib
import re
from pathlib import Path

import pytest

from motm_twin.bus.commands import Refused
from motm_twin.bus.ranges import ALLOWED, check_command
from motm_twin.bus.schemas import COMMANDS
from motm_twin.model.joint_limits import DQ_MAX, Q_MAX, Q_MIN
from motm_twin.model.scene import DriveTo

DOCUMENT = Path(__file__).parents[2] / "docs" / "zenoh.md"
SOME = {"name": "a", "x": 0.0, "y": 0.0, "dx": 0.0, "dy": 0.0, "v": 0.0, "factor": 1.0, "scene": "a", "index": 1}
SOME |= {"seed": 1, "fault": "lidar_off", "tasks": (DriveTo(point=(0.0, 0.0)),)}


def refused(kind, field, value):
    needed = {name: SOME[name] for name in kind.__struct_fields__ if name in SOME and name not in ("index",)}
    with contextlib.suppress(Refused):
        check_command(kind(**{**needed, field: value}))
        return False
    return True


def rows(form):
    return [(*key, *map(float, found.groups())) for key, text in ALLOWED.items() if (found := re.fullmatch(form, text))]


@pytest.mark.parametrize(("command", "field"), ALLOWED)
def test_what_is_told_is_told_of_a_field(command, field):
    assert field in COMMANDS[f"cmd/{command}"].__struct_fields__


@pytest.mark.parametrize(("command", "field", "low", "high"), rows(r"(?:each )?(-?[\d.]+) to (-?[\d.]+)"))
def test_the_ends_of_a_range_are_taken_and_what_is_beyond_is_refused(command, field, low, high):
    kind = COMMANDS[f"cmd/{command}"]
    whole = high == int(high) and low == int(low) and field not in ("v", "w", "delay")
    form = int if whole else float
    if field == "tasks":
        assert [refused(kind, field, SOME["tasks"] * int(count)) for count in (low, high, high + 1)] == [0, 0, 1]
        return
    made = (lambda value: (form(value),) * 3) if field == "size" else form
    step = 1 if whole else 0.01
    values = [made(value) for value in (low, high, low - step, high + step)]
    assert [refused(kind, field, value) for value in values] == [False, False, True, True]


@pytest.mark.parametrize(("command", "field", "most"), rows(r"(?:1 to|at most) (\d+) characters"))
def test_texts_have_at_most_as_many_characters(command, field, most):
    kind = COMMANDS[f"cmd/{command}"]
    assert [refused(kind, field, "x" * int(count)) for count in (most, most + 1)] == [False, True]


def test_the_joint_limits_in_the_document_are_those_of_the_arm():
    text = " ".join(DOCUMENT.read_text(encoding="utf-8").split())
    low, high = (", ".join(f"{value:g}" for value in limits.tolist()) for limits in (Q_MIN, Q_MAX))
    assert f"from {low} to {high} rad" in text
    assert f"{DQ_MAX[0]:g} (joints 1 to 4) and {DQ_MAX[4]:g} rad/s (5 to 7)" in text
    assert set(DQ_MAX[:4]) == {DQ_MAX[0]} and set(DQ_MAX[4:]) == {DQ_MAX[4]}
