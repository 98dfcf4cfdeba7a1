"""Both ends of every bound of a command pass the gate, and take effect; what lies just beyond is refused by both."""

import json
from pathlib import Path

import msgspec
import pytest

from motm_twin.bus.commands import EDITS, SERVER_COMMANDS, CommandGate, Refused, command_name
from motm_twin.model.bounds import Between, Count, Length, Listed, OneOf, Text, bounds_of
from motm_twin.model.edits import WORLD_EDITS, Edit
from motm_twin.model.profile import DQ_MAX, Q_MAX, Q_MIN
from motm_twin.model.scene import DriveTo, Pick, Place
from motm_twin.model.scene_file import load_scene
from motm_twin.perf.fuzz import EXAMPLES
from motm_twin.sim.world_edits import EditError
from motm_twin.twin import Twin

DOCUMENT = Path(__file__).parents[1] / "docs" / "zenoh.md"
AGENT, CUBE = "temi_1", "red_cube"  # of the scene below
WORLD = {kind.__struct_config__.tag for kind in WORLD_EDITS}
TASKS = {"pick": Pick, "place": Place, "drive_to": DriveTo}
DRIVE_TO = {"type": "drive_to", "point": [0.0, 0.0], "heading": 0.0, "tolerance": 0.1}
DEFAULTS = {  # of fields that the examples leave out
    "inject_fault": {"joint": 4},
    "push_robot": {"dx": 0.0, "dy": 0.0},
    "load": {"variant": "a", "seed": 1, "method": "motm"},
    "drive_to": {"heading": 0.0},
    "add_obstacle": {"x": 15.0, "y": 15.0, "heading": 0.0, "size": [0.5, 0.5, 0.6], "shape": "box"},
}


def example(name):
    """A whole command of this name, for the scene below."""
    fields = {"type": name, **EXAMPLES[name], **DEFAULTS.get(name, {})}
    if name in WORLD - {"add_obstacle"} and "name" in fields:
        fields["name"] = CUBE if name == "move_object" else AGENT
    return fields


def values(bound, given):
    """Values at the ends of a bound, and just beyond; shaped like the given one."""
    match bound:
        case Between(low=low, high=high):
            step = 1 if isinstance(given, int) and not isinstance(given, bool) else 0.01
            shaped = (lambda value: [value] * len(given)) if isinstance(given, list) else lambda value: value
            return [shaped(low), shaped(high)], [shaped(low - step), shaped(high + step)]
        case Length(most=most, other=""):
            return [[most, 0.0], [0.0, -most]], [[most + 0.01, 0.0], [0.8 * most, -0.8 * most]]
        case Length(most=most):
            return [most, -most], [most + 0.01, -most - 0.01]
        case Text(least=least, most=most):
            return ["n" * least, "n" * most], ["n" * (most + 1), "a\nb", *([""] if least else [])]
        case Count(least=least, most=most):
            return [given[:1] * least, given[:1] * most], [[], given[:1] * (most + 1)]
        case OneOf(choices=choices):
            return list(choices), ["nothing", ""]
        case Listed():
            return [given], []
    raise AssertionError(bound)


def cases():
    """Every bound of every command and task: the fields of the command, and whether it is within."""
    for kind in (*SERVER_COMMANDS, *EDITS):
        name = kind.__struct_config__.tag
        for field, bounds in bounds_of(kind).items():
            for bound in bounds:
                fields = example(name)
                for part, within in zip(values(bound, fields.get(field, 0.0)), (True, False), strict=True):
                    yield from ((fields | {field: value}, within) for value in part)
    for name, task in (
        ("pick", {"type": "pick", "object": "a"}),
        ("place", {"type": "place", "bin": "a"}),
        ("drive_to", DRIVE_TO),
    ):
        for field, bounds in bounds_of(TASKS[name]).items():
            for part, within in zip(values(bounds[0], task[field]), (True, False), strict=True):
                yield from (({"type": "insert_task", "tasks": [task | {field: value}]}, within) for value in part)


CASES = list(cases())
WITHIN = [fields for fields, within in CASES if within]
BEYOND = [fields for fields, within in CASES if not within]


def shown(fields):
    return json.dumps(fields)[:80]


def admitted(fields):
    """The command as the gate lets it pass."""
    message = {"sender": "a", "seq": 1, "expires": 1.0, "command": fields}
    return CommandGate(lambda: 0.0).admit(fields["type"], msgspec.json.encode(message)).command


@pytest.fixture(scope="module")
def at_start():
    twin = Twin(load_scene("playground"))
    twin.advance()
    start = twin.snapshot()

    def again():
        twin.restore(start)
        return twin

    return again


@pytest.mark.parametrize("fields", WITHIN, ids=shown)
def test_what_is_within_its_bounds_passes_the_gate(fields):
    assert command_name(admitted(fields)) == fields["type"]


@pytest.mark.parametrize("fields", BEYOND, ids=shown)
def test_what_is_beyond_a_bound_is_refused_by_the_gate(fields):
    with pytest.raises(Refused):
        admitted(fields)


def world_takes(fields):
    """An edit of the world that is not of a body that nobody has."""
    own = fields["type"] == "add_obstacle" or fields.get("name", AGENT) in (AGENT, CUBE)
    return fields["type"] in WORLD and own


@pytest.mark.parametrize("fields", [one for one in WITHIN if world_takes(one)], ids=shown)
def test_what_is_within_its_bounds_takes_effect(at_start, fields):
    twin = at_start()
    before = twin.plant.truth()
    command = admitted(fields)
    twin.post(command)
    tick = twin.advance()
    assert tick.edits == (command,)
    after = tick.truth
    match fields["type"]:
        case "add_obstacle":
            assert fields["name"] in [item.name for item in (*after.obstacles, *after.agents)]
        case "push_robot":
            wanted = [fields["dx"], fields["dy"], fields.get("turn", 0.0)]
            assert (after.pose - before.pose).tolist() == pytest.approx(wanted, abs=0.03)


@pytest.mark.parametrize("fields", [one for one in BEYOND if one["type"] in WORLD], ids=shown)
def test_what_is_beyond_a_bound_is_refused_by_the_twin(at_start, fields):
    with pytest.raises(EditError):
        at_start().post(msgspec.convert(fields, Edit))


@pytest.mark.parametrize("kind", [*SERVER_COMMANDS, *EDITS, *TASKS.values()])
def test_every_number_text_and_list_of_a_command_has_a_bound(kind):
    free = {field.name for field in msgspec.structs.fields(kind) if field.type is not bool} - bounds_of(kind).keys()
    assert free <= {"action", "amount", "dy"}  # one of two words; bounded by the kind of fault; together with dx


def test_the_joint_limits_in_the_document_are_those_of_the_arm():
    text = " ".join(DOCUMENT.read_text(encoding="utf-8").split())
    low, high = (", ".join(f"{value:g}" for value in limits.tolist()) for limits in (Q_MIN, Q_MAX))
    assert f"from {low} to {high} rad" in text
    assert f"{DQ_MAX[0]:g} (joints 1 to 4) and {DQ_MAX[4]:g} rad/s (5 to 7)" in text
    assert set(DQ_MAX[:4]) == {DQ_MAX[0]} and set(DQ_MAX[4:]) == {DQ_MAX[4]}
