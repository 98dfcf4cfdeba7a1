"""What was published about the messages stays true: the files in docs/schemas, and what really travels."""

import copy
import json
from pathlib import Path

import jsonschema
import pytest
from fake_twin import fake_server
from waiting import asked, until, until_paused

from motm_twin.bus.commands import AddObstacle, Envelope, Step
from motm_twin.bus.schemas import COMMANDS, MESSAGES, PLANT_MESSAGES, file_name, names, schema

ROOT = Path(__file__).resolve().parents[2]
FOLDER = ROOT / "docs" / "schemas"
PUBLISHED = [*MESSAGES, *PLANT_MESSAGES]


def published(name):
    return json.loads((FOLDER / file_name(name)).read_text(encoding="utf-8"))


TOOL = "schemas"  # of the fixture `tool`


@pytest.mark.parametrize("name", PUBLISHED)
def test_a_schema_is_valid_and_fits_what_was_published_under_its_version(name, tool):
    jsonschema.Draft202012Validator.check_schema(schema(name))
    version = schema(name)["$id"]
    assert (FOLDER / file_name(name)).exists(), f"{version} is not published: run tools/schemas.py"
    breaks = tool.breaking_changes(published(name), schema(name))
    assert not breaks, f"bump the version of {name!r}, {version}: {'; '.join(breaks)}"
    assert published(name) == schema(name), f"{name!r} has grown or is described anew: run tools/schemas.py"


def test_the_published_files_are_those_of_now(tool):
    for path, text in tool.wanted().items():
        assert path.read_text(encoding="utf-8") == text, f"{path.name}: run tools/schemas.py"


def test_the_tool_does_not_publish_what_breaks_a_version(tool, tmp_path):
    (tmp_path / "plant").mkdir()
    for name in PUBLISHED:
        (tmp_path / file_name(name)).write_text(json.dumps(published(name)))
    assert tool.problems(tmp_path) == []
    changed = published("robot")
    changed["$defs"]["RobotStateMessage"]["properties"]["battery"] = {"type": "number"}
    (tmp_path / file_name("robot")).write_text(json.dumps(changed))
    (problem,) = tool.problems(tmp_path)
    assert "battery: was removed: bump the version of 'robot'" in problem


def changes(tool, name, edit):
    """What the rule says when the published schema of a message is edited."""
    new = copy.deepcopy(schema(name))
    edit(new["$defs"])
    return tool.breaking_changes(schema(name), new)


@pytest.mark.parametrize(
    ("name", "edit"),
    [
        ("robot", lambda defs: defs["RobotStateMessage"]["properties"].update(battery={"type": "number"})),
        ("robot", lambda defs: defs["RobotStateMessage"]["properties"]["pose"].update(description="other words")),
        ("tick", lambda defs: defs.update(More={"type": "object"})),
        ("command", lambda defs: defs["Envelope"]["properties"]["command"]["anyOf"].append({"$ref": "#/$defs/New"})),
        ("command", lambda defs: defs["Step"]["properties"].update(slow={"type": "boolean", "default": False})),
        ("command", lambda defs: defs["Record"]["properties"]["action"]["enum"].append("pause")),
        ("scene", lambda defs: defs["Scene"]["properties"]["mismatch"]["default"].update(more=0.0)),
    ],
)
def test_adding_is_allowed_within_a_version(name, edit, tool):
    assert changes(tool, name, edit) == []


def require(defs, kind, field):
    defs[kind]["properties"][field] = {"type": "number"}
    defs[kind]["required"].append(field)


@pytest.mark.parametrize(
    ("name", "edit", "word"),
    [
        ("robot", lambda defs: defs["RobotStateMessage"]["properties"].pop("q"), "removed"),
        ("robot", lambda defs: defs["RobotStateMessage"]["properties"].update(q={"type": "string"}), "'type'"),
        ("robot", lambda defs: defs["RobotStateMessage"]["properties"]["q"].update(items={"type": "integer"}), "type"),
        ("robot", lambda defs: defs["RobotStateMessage"]["required"].remove("q"), "no more"),
        ("robot", lambda defs: defs["RobotStateMessage"]["required"].append("extra"), ""),
        ("scan", lambda defs: defs["ScanMessage"]["properties"].update(stamp={"anyOf": [{"type": "null"}]}), "types"),
        ("score", lambda defs: defs["ContactMessage"].update(type="array"), "type"),
        ("tick", lambda defs: defs.pop("ArmMessage"), "removed"),
        ("command", lambda defs: defs.pop("Step"), "removed"),
        ("command", lambda defs: defs["Envelope"]["properties"]["command"]["anyOf"].pop(), "no longer"),
        ("command", lambda defs: require(defs, "Step", "slow"), "required field of what programs send"),
        ("command", lambda defs: defs["Step"]["properties"]["count"].update(default=2), "default"),
        ("command", lambda defs: defs["Record"]["properties"]["action"]["enum"].remove("stop"), "no longer 'stop'"),
        ("scene", lambda defs: defs["Scene"]["properties"]["mismatch"]["default"].update(base_lag=1.0), "base_lag"),
        ("scene", lambda defs: defs["Scene"]["properties"]["mismatch"]["default"].pop("base_lag"), "base_lag"),
        ("command", lambda defs: defs["Speed"]["properties"]["factor"].update(maximum=1.0), "maximum"),
        ("command", lambda defs: defs["DriveTo"]["properties"]["point"]["prefixItems"].pop(), "items"),
    ],
)
def test_removing_retyping_and_requiring_need_a_new_version(name, edit, word, tool):
    found = changes(tool, "tick" if name == "score" else name, edit)
    if word:
        assert any(word in line for line in found), found
    else:
        assert found == []  # a new field that is always there is no loss for readers


@pytest.fixture(scope="module")
def server(tmp_path_factory):
    with fake_server(playing=False, data=tmp_path_factory.mktemp("data")) as running:
        until_paused(running)
        yield running


def test_schemas_are_answered_to_queries(server, session):
    (reply,) = asked(session, server.keys.schema("tick"))
    assert json.loads(reply.ok.payload.to_bytes()) == schema("tick")
    found = {str(reply.ok.key_expr) for reply in session.get(server.keys.schemas)}
    assert found == {server.keys.schema(name) for name in names()}
    (reply,) = session.get(server.keys.schema("plant/state"))
    assert json.loads(reply.ok.payload.to_bytes()) == schema("plant/state")
    assert len(list(session.get(server.keys.schema("cmd/*")))) == len(COMMANDS)
    assert list(session.get(server.keys.schema("nothing"))) == []


def test_what_travels_is_what_the_schemas_say(server, session, client):
    until(client.status, "no status")
    assert client.command(AddObstacle(name="crate", x=0.5, y=0.5)).ok
    assert client.command(Step(count=2)).ok
    until(lambda: client.tick() and client.tick().index >= 2, "no steps")
    keys = server.keys
    for name in ("tick", "robot", "event", "metrics", "status", "scene", "session", "events"):
        (reply,) = asked(session, f"{keys.event}?from=0" if name == "events" else getattr(keys, name))
        jsonschema.validate(json.loads(reply.ok.payload.to_bytes()), schema(name))
    (grid,) = asked(session, keys.grid)
    jsonschema.validate(json.loads(grid.ok.attachment.to_bytes()), schema("grid"))
    envelope = {"sender": "me", "seq": 1, "expires": 1.0, "command": {"type": "step", "count": 2}}
    jsonschema.validate(envelope, schema("command"))
    (answer,) = client.query("step", json.dumps(envelope).encode())
    jsonschema.validate(json.loads(answer), schema("answer"))
    assert Envelope.__name__ in schema("command")["$defs"]
