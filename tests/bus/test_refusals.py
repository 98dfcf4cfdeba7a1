"""Commands that must change nothing do change nothing: checked by the hash of the whole state of the real twin."""

import json

import msgspec
import pytest
from waiting import until, until_paused

from motm_twin.bus.client import TwinClient
from motm_twin.bus.commands import MAX_COMMAND_BYTES, Load, SetParameter, Step
from motm_twin.bus.interfaces import TwinSetup
from motm_twin.bus.library import FileLibrary
from motm_twin.bus.server import TwinServer
from motm_twin.sessions.session import Session
from motm_twin.twin import Twin

STEADY = ("run", "state", "text", "scene", "variant", "seed", "time", "speed", "driver", "parameters", "recorded")


@pytest.fixture(scope="module")
def server(tmp_path_factory):
    folder = tmp_path_factory.mktemp("data")
    first = Load(scene="exp1")
    with TwinServer(
        TwinSetup(library=FileLibrary("exp1"), make_twin=Twin, first=first, playing=False), data=folder / "files"
    ) as running:
        until_paused(running)
        yield running
        assert not (folder / "files").exists(), "a refused command has written a file"


@pytest.fixture
def driver(server):
    with TwinClient(server.endpoint, sender=f"driver-{next(SEQ)}") as client:
        until(lambda: client.tick() and client.status(), "nothing was received")
        index = client.tick().index
        assert client.command(Step(), name="Dora").ok
        until(lambda: client.tick().index > index, "the step was not made")
        until(lambda: client.status().driver == client.sender, "nobody drives")
        yield client
        (answer,) = client.query("hand_over", payload(server, client, "hand_over"))
        assert json.loads(answer)["ok"]


def state(server, client):
    """Hash of the whole state, the log of edits, and what the status says of the server."""
    session = msgspec.json.decode(client.session(), type=Session)
    status = server.loop.status()
    return session.state_hash, session.edits, session.periods, [getattr(status, field) for field in STEADY]


COMMANDS = {
    "play": {},
    "step": {"count": 1},
    "reset": {},
    "speed": {"factor": 2.0},
    "load": {"scene": "exp2"},
    "seed": {"seed": 3},
    "branch": {"index": 0},
    "drive_to": {"x": 0.5, "y": 0.0},
    "add_obstacle": {"name": "crate", "x": 0.5, "y": -0.8},
    "push_robot": {"dx": 0.1, "dy": 0.0},
    "set_parameter": {"name": "xi", "value": 0.7},
    "remove_task": {"index": 11},
    "inject_fault": {"fault": "lidar_off"},
    "save": {"name": "mine"},
    "record": {"action": "start", "name": "mine"},
}
FIELDS = {**COMMANDS, "hand_over": {}}
SEQ = iter(range(1, 10_000))


def payload(server, driver, kind, /, *, sender=None, seq=None, lifetime=5.0, **fields):
    command = {"type": kind, **FIELDS[kind], **fields}
    expires = server.loop.status().server_time + lifetime
    seq = 2**62 + next(SEQ) if seq is None else seq
    return json.dumps({"sender": sender or driver.sender, "seq": seq, "expires": expires, "command": command}).encode()


def refused(client, name, data):
    (answer,) = client.query(name, data)
    answer = json.loads(answer)
    assert answer["ok"] is False, name
    assert answer["version"] == "motm.answer/1"
    return answer["reason"]


@pytest.mark.parametrize("name", COMMANDS)
def test_a_refused_command_changes_nothing(server, driver, name):
    before = state(server, driver)
    assert "stale" in refused(driver, name, payload(server, driver, name, lifetime=-0.1))
    assert "ahead" in refused(driver, name, payload(server, driver, name, lifetime=3600.0))
    assert "malformed" in refused(driver, name, payload(server, driver, name)[:-2])
    assert "malformed" in refused(driver, name, payload(server, driver, name, unknown=1))
    assert "malformed" in refused(driver, name, payload(server, driver, name).replace(driver.sender.encode(), b"x\\n"))
    assert "oversized" in refused(driver, name, payload(server, driver, name) + b" " * MAX_COMMAND_BYTES)
    assert "Dora is driving" in refused(driver, name, payload(server, driver, name, sender="stranger"))
    assert "was sent to the key of" in refused(driver, "pause", payload(server, driver, name))
    assert state(server, driver) == before


@pytest.mark.parametrize("name", COMMANDS)
def test_a_replayed_command_changes_nothing(server, driver, name):
    harmless = json.dumps(
        {
            "sender": driver.sender,
            "seq": (seq := 2**62 + next(SEQ)),
            "expires": server.loop.status().server_time + 5.0,
            "command": {"type": "pause"},
        }
    ).encode()
    (answer,) = driver.query("pause", harmless)
    assert json.loads(answer)["ok"]
    before = state(server, driver)
    assert "replayed" in refused(driver, name, payload(server, driver, name, seq=seq))
    assert "replayed" in refused(driver, name, payload(server, driver, name, seq=seq - 5))
    assert "replayed" in refused(driver, "pause", harmless)
    assert state(server, driver) == before


@pytest.mark.parametrize("name", ["../mine", "/tmp/mine", ".hidden", "", "a" * 65, "a b", "a\x00", "..", "mïne"])
def test_files_have_plain_names(server, driver, name):
    before = state(server, driver)
    assert "file name" in refused(driver, "save", payload(server, driver, "save", name=name))
    if name:
        assert "file name" in refused(driver, "record", payload(server, driver, "record", name=name))
    assert state(server, driver) == before


def test_the_twin_itself_refuses_what_is_not_possible_and_changes_nothing(server, driver):
    before = state(server, driver)
    assert "xii" in driver.command(SetParameter(name="xii", value=1.0)).reason
    assert "no scene is called" in driver.command(Load(scene="nowhere")).reason
    assert state(server, driver) == before
