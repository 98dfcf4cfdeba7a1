"""Both ends of every bound of a world edit pass the gate and take effect; what lies just beyond is refused by both."""

import msgspec
import pytest

from motm_twin.bus.commands import Refused
from motm_twin.bus.gate import CommandGate
from motm_twin.model.edits import (
    FARTHEST,
    FARTHEST_PUSH,
    LARGEST,
    LARGEST_TURN,
    LONGEST_NAME,
    SMALLEST,
    Edit,
)
from motm_twin.model.scene_file import load_scene
from motm_twin.sim.world_edits import EditError
from motm_twin.twin import Twin

AT = {"x": 5.0, "y": 5.0}
WITHIN = [
    {"type": "add_obstacle", "name": "n" * LONGEST_NAME, **AT},
    {"type": "add_obstacle", "name": "a", "x": FARTHEST, "y": -FARTHEST},
    {"type": "add_obstacle", "name": "a", **AT, "size": [SMALLEST] * 3},
    {"type": "add_obstacle", "name": "a", "x": 15.0, "y": 15.0, "size": [LARGEST] * 3},
    {"type": "push_robot", "dx": -FARTHEST_PUSH, "dy": 0.0},
    {"type": "push_robot", "dx": 0.0, "dy": 0.0, "turn": LARGEST_TURN},
    {"type": "push_robot", "dx": 0.0, "dy": 0.0, "turn": -LARGEST_TURN},
]
BEYOND = [
    {"type": "add_obstacle", "name": "n" * (LONGEST_NAME + 1), **AT},
    {"type": "add_obstacle", "name": "a", "x": FARTHEST + 0.1, "y": 0.0},
    {"type": "add_obstacle", "name": "a", **AT, "size": [SMALLEST - 0.001] * 3},
    {"type": "add_obstacle", "name": "a", "x": 15.0, "y": 15.0, "size": [LARGEST + 0.01] * 3},
    {"type": "push_robot", "dx": -FARTHEST_PUSH - 0.01, "dy": 0.0},
    {"type": "push_robot", "dx": 0.0, "dy": 0.0, "turn": LARGEST_TURN + 0.01},
]


def admitted(fields):
    """The command as the gate lets it pass."""
    message = {"sender": "a", "seq": 1, "expires": 1.0, "command": fields}
    return CommandGate(lambda: 0.0).admit(fields["type"], msgspec.json.encode(message)).command


@pytest.fixture(scope="module")
def twin():
    twin = Twin(load_scene("playground"))
    twin.advance()
    return twin, twin.snapshot()


@pytest.mark.parametrize("fields", WITHIN, ids=str)
def test_what_is_within_its_bounds_takes_effect(twin, fields):
    twin, start = twin
    twin.restore(start)
    before = twin.plant.truth()
    twin.post(admitted(fields))
    after = twin.advance().truth
    if fields["type"] == "add_obstacle":
        assert fields["name"] in [item.name for item in after.obstacles]
        return
    wanted = [fields["dx"], fields["dy"], fields.get("turn", 0.0)]
    assert (after.pose - before.pose).tolist() == pytest.approx(wanted, abs=0.03)


@pytest.mark.parametrize("fields", BEYOND, ids=str)
def test_what_is_beyond_a_bound_is_refused_by_gate_and_twin(twin, fields):
    twin, start = twin
    twin.restore(start)
    with pytest.raises(Refused):
        admitted(fields)
    with pytest.raises(EditError):
        twin.post(msgspec.convert(fields, Edit))
