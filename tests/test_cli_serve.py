"""What `motm-twin serve` writes as it looks after its processes."""

import io

import pytest
from rich.console import Console

from motm_twin.cli_serve import _Supervisor


@pytest.mark.parametrize(
    ("state", "text", "line"),
    [
        ("paused", "", "paused"),
        ("paused", "the robot was lost", "paused: the robot was lost"),
        ("playing", "", "playing: the robot moves"),
    ],
)
def test_a_state_is_told_once(state, text, line):
    said = io.StringIO()
    supervisor = _Supervisor(Console(file=said, soft_wrap=True), "frankie", 7447, None)
    supervisor._tell("twin server", {"event": "state", "state": state, "text": text})
    assert said.getvalue().rstrip("\n").partition(" s  ")[2] == line
