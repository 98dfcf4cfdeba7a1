"""Two twins at a router with the files that `motm-twin security make --twin` writes: who may say what through it."""

import sys
from contextlib import ExitStack
from pathlib import Path

import pytest
import zenoh

sys.path.insert(0, str(Path(__file__).parents[1] / "bus"))

from fake_twin import fake_server
from waiting import until

from motm_twin.bus import connection as config
from motm_twin.bus.client import TwinClient
from motm_twin.bus.commands import Step
from motm_twin.bus.connection import free_port, open_member
from motm_twin.client.discover import running_twins
from motm_twin.security.folder import Folder, People, SecurityError

NAMES = {"viewer": ["ann"], "driver": ["bob"], "twin": ["one", "two"]}
WAIT = 60.0  # [s] for what must come: several handshakes on a machine that may be busy


@pytest.fixture(scope="module", params=[False, True], ids=["mutual", "passwords"])
def folder(request, tmp_path_factory):
    """The files, a router that runs with its own, and two twins that meet there."""
    made = Folder(tmp_path_factory.mktemp("router") / "files")
    made.create(People(hosts=["127.0.0.1"], port=free_port(), passwords=request.param, names=NAMES))
    router = zenoh.open(zenoh.Config.from_file(str(made.router)))
    with pytest.MonkeyPatch.context() as patch, ExitStack() as stack:
        for name in NAMES["twin"]:
            patch.setenv(config.VARIABLE, str(made.of("twin", name)))
            server = fake_server(playing=False, twin=name)
            stack.enter_context(server)
        yield made
    router.close()


def visit(folder, monkeypatch, role, name):
    """From now on, sessions are opened with the file of this person; where it leads."""
    monkeypatch.setenv(config.VARIABLE, str(folder.of(role, name)))
    return config.configured_endpoint()


def test_a_viewer_sees_both_twins_and_commands_none(folder, monkeypatch):
    endpoint = visit(folder, monkeypatch, "viewer", "ann")
    until(lambda: {found.twin for found in running_twins(endpoint)} == {"one", "two"}, "not both are found", WAIT)
    for name in NAMES["twin"]:
        with TwinClient(endpoint, name) as client:
            until(lambda client=client: client.tick() and client.status() and client.scene(), f"no {name}", WAIT)
            assert client.status().twin == name
            answer = client.command(Step())
            assert not answer.ok and "no right" in answer.reason


def test_a_driver_commands_the_twin_that_is_meant(folder, monkeypatch):
    endpoint = visit(folder, monkeypatch, "driver", "bob")
    with TwinClient(endpoint, "one") as one, TwinClient(endpoint, "two") as two:
        for client in (one, two):
            until(lambda client=client: client.tick() and client.status(), "no tick", WAIT)
        index, other = one.tick().index, two.tick().index
        assert one.command(Step(), WAIT).ok
        until(lambda: one.tick().index == index + 1, "it does not step", WAIT)
        assert two.tick().index == other


def test_a_twin_speaks_on_its_own_keys_only(folder, monkeypatch):
    heard = []
    viewer = open_member(visit(folder, monkeypatch, "viewer", "ann"), wait=WAIT)
    listening = viewer.declare_subscriber("motm/*/event", lambda sample: heard.append(str(sample.key_expr)))
    two = open_member(visit(folder, monkeypatch, "twin", "two"), wait=WAIT)

    def arrives():
        two.put("motm/one/event", b"forged")
        two.put("motm/two/event", b"mine")
        return "motm/two/event" in heard

    until(arrives, "its own keys are closed to it", WAIT)
    two.put("motm/one/event", b"forged")
    two.put("motm/two/event", b"last")
    count = heard.count("motm/two/event")
    until(lambda: two.put("motm/two/event", b"last") or heard.count("motm/two/event") > count, "nothing", WAIT)
    assert "motm/one/event" not in heard
    listening.undeclare()
    for session in (two, viewer):
        session.close()


def test_a_folder_of_a_twin_does_not_become_one_of_a_router(tmp_path):
    place = Folder(tmp_path / "files")
    place.create(People(hosts=["127.0.0.1"], port=7448, names={"viewer": ["ann"]}))
    assert not place.router.exists()
    with pytest.raises(SecurityError, match="of a twin, not of a router"):
        place.add("twin", "one")
