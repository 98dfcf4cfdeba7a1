"""Who gets in, and who may do what: real sessions over TLS, with the files that `motm-twin security` makes."""

import json
import tempfile
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

import pytest
import zenoh
import zenoh.ext
from fake_twin import fake_server
from waiting import until, until_paused

from motm_twin.bus import connection as config
from motm_twin.bus.client import TwinClient
from motm_twin.bus.commands import Step
from motm_twin.bus.connection import free_port, open_member, open_server
from motm_twin.bus.security import Folder, People, SecurityError
from motm_twin.client.discover import running_twins
from motm_twin.ros2.forms import ACCEPTED, PUBLISHED, BridgeForm, Outlets, RmwForm

NAMES = {"viewer": ["ann"], "driver": ["bob"], "robot": ["mine"]}


class Place:
    """A server with its folder, and what arrives there."""

    def __init__(self, path: Path, *, passwords: bool) -> None:
        self.port, self.passwords = free_port(), passwords
        self.folder = Folder(path)
        self.folder.create(People(hosts=["127.0.0.1"], port=self.port, passwords=passwords, names=NAMES))
        self.commands: list[str] = []
        self.arrived: list[tuple[str, bytes]] = []  # key and payload

    @contextmanager
    def serving(self, monkeypatch):
        monkeypatch.setenv(config.VARIABLE, str(self.folder.server))
        port = free_port()
        self.local, session = f"tcp/127.0.0.1:{port}", open_server(port)
        declared = [
            session.declare_queryable("motm/mine/cmd/**", self._command),
            session.declare_queryable("motm/mine/status", lambda query: query.reply(query.key_expr, b"status")),
            session.declare_queryable("private/**", lambda query: query.reply(query.key_expr, b"private")),
            session.declare_subscriber(
                "**", lambda sample: self.arrived.append((str(sample.key_expr), sample.payload.to_bytes()))
            ),
        ]
        self.publishers = {key: session.declare_publisher(key) for key in (TICK, ORDERS, PRIVATE)}
        try:
            yield self
        finally:
            for item in (*declared, *self.publishers.values()):
                item.undeclare()
            session.close()

    def _command(self, query):
        self.commands.append(str(query.key_expr))
        query.reply(query.key_expr, b"done")

    @contextmanager
    def visitor(self, monkeypatch, file: Path):
        monkeypatch.setenv(config.VARIABLE, str(file))
        with open_member(config.configured_endpoint() or "", wait=3.0) as session:
            yield session


@pytest.fixture(scope="module", params=[False, True], ids=["mutual", "passwords"])
def place(request, tmp_path_factory):
    with pytest.MonkeyPatch.context() as patch:
        found = Place(tmp_path_factory.mktemp("security") / "here", passwords=request.param)
        with found.serving(patch):
            yield found


TICK, ORDERS, PRIVATE = "motm/mine/tick", "motm/mine/plant/command", "private/thing"


def comes(condition, wait):
    """True when it comes true within this time [s]."""
    with suppress(AssertionError):
        return bool(until(condition, timeout=wait))
    return False


def heard(place, session, *keys):
    """Of the keys that the server sends on, those that a subscriber hears, within the time that others need to."""
    got = set()
    subscribers = [session.declare_subscriber(key, lambda sample: got.add(str(sample.key_expr))) for key in keys]

    def all_come():
        for key in keys:
            place.publishers[key].put(b"news")
        return len(got) == len(keys)

    comes(all_come, 2.0)
    for subscriber in subscribers:
        subscriber.undeclare()
    return got


def answers(session, key):
    return [reply.ok.payload.to_bytes() for reply in session.get(key, timeout=0.5) if reply.ok is not None]


def arrives(place, session, *keys):
    """Of these keys, those on which the server receives what is put."""
    put = b"from outside"
    place.arrived.clear()

    def arrived():
        return {key for key in keys if (key, put) in place.arrived}

    def all_arrive():
        for key in keys:
            session.put(key, put)
        return arrived() == set(keys)

    comes(all_arrive, 0.5)
    return arrived()


def test_a_late_viewer_is_told_the_last_of_everything_by_a_real_twin(place, monkeypatch):
    """As a peer, as programs connect by themselves: a question is sent only where an answer was announced."""
    folder = place.folder.path.parent / "twin"
    made = Folder(folder)
    port = free_port()
    made.create(People(hosts=["127.0.0.1"], port=port, passwords=place.passwords, names=NAMES))
    monkeypatch.setenv(config.VARIABLE, str(made.server))
    with fake_server(playing=False) as server:
        until_paused(server)
        monkeypatch.setenv(config.VARIABLE, str(made.of("viewer", "ann")))
        with TwinClient(config.configured_endpoint() or "") as client:
            until(lambda: client.tick() and client.grid() and client.scene() and client.status(), "not told")
            assert client.events(0) is not None


def test_a_viewer_reads_and_can_do_nothing_else(place, monkeypatch):
    with place.visitor(monkeypatch, place.folder.of("viewer", "ann")) as session:
        assert heard(place, session, TICK, ORDERS, PRIVATE) == {TICK}
        assert answers(session, "motm/mine/status") == [b"status"]
        place.commands.clear()
        assert answers(session, "motm/mine/cmd/play") == []
        assert place.commands == []
        assert answers(session, PRIVATE) == []
        assert not arrives(place, session, TICK, "motm/mine/plant/state", ORDERS, "motm/mine/cmd/play")


def test_a_driver_commands_too(place, monkeypatch):
    with place.visitor(monkeypatch, place.folder.of("driver", "bob")) as session:
        assert heard(place, session, TICK)
        assert answers(session, "motm/mine/cmd/play") == [b"done"]
        assert not arrives(place, session, TICK, "motm/mine/plant/state")


def test_a_robot_speaks_for_its_twin_only(place, monkeypatch):
    with place.visitor(monkeypatch, place.folder.of("robot", "mine")) as session:
        state = "motm/mine/plant/state"
        assert arrives(place, session, state, "motm/other/plant/state", TICK) == {state}
        assert heard(place, session, ORDERS, TICK) == {ORDERS}
        assert answers(session, "motm/mine/cmd/play") == []


def changed(file: Path, target: Path, change) -> Path:
    settings = json.loads(file.read_text())
    change(settings)
    target.write_text(json.dumps(settings))
    return target


def refused(place, monkeypatch, file):
    monkeypatch.setenv(config.VARIABLE, str(file))
    return refused_at(config.configured_endpoint() or "", monkeypatch, file)


def refused_at(endpoint, monkeypatch, file):
    monkeypatch.setenv(config.VARIABLE, str(file))
    try:
        session = open_member(endpoint, wait=0.0)
    except TimeoutError:
        return True
    session.close()
    return False


def test_the_certificates_or_passwords_of_others_do_not_open(place, monkeypatch, tmp_path):
    other = Folder(tmp_path / "other")
    other.create(People(hosts=["127.0.0.1"], port=place.port, passwords=place.passwords, names=NAMES))
    assert refused(place, monkeypatch, other.of("driver", "bob"))  # the same names, another authority
    mine = place.folder.of("driver", "bob")
    assert not refused(place, monkeypatch, mine)
    if place.passwords:
        wrong = changed(mine, tmp_path / "a.json5", lambda s: s["transport"]["auth"]["usrpwd"].update(password="guess"))
        unknown = changed(
            mine, tmp_path / "b.json5", lambda s: s["transport"]["auth"]["usrpwd"].update(user="driver-eve")
        )
        nobody = changed(mine, tmp_path / "c.json5", lambda s: s["transport"].pop("auth"))
        assert all(refused(place, monkeypatch, file) for file in (wrong, unknown, nobody))
    else:

        def forget(settings):
            tls = settings["transport"]["link"]["tls"]
            del tls["connect_certificate_base64"], tls["connect_private_key_base64"]
            tls["enable_mtls"] = False

        assert refused(place, monkeypatch, changed(mine, tmp_path / "d.json5", forget))


def test_a_server_with_the_wrong_certificate_is_not_believed(place, monkeypatch, tmp_path):
    rogue = Place(tmp_path / "rogue", passwords=place.passwords)
    with rogue.serving(monkeypatch):
        at = f"tls/127.0.0.1:{rogue.port}"
        mine = place.folder.of("driver", "bob")
        led_astray = changed(mine, tmp_path / "e.json5", lambda s: s["connect"].update(endpoints=[at]))
        assert refused(rogue, monkeypatch, led_astray)


def test_plain_tcp_does_not_get_in_where_tls_listens(place, monkeypatch, tmp_path):
    plain = tmp_path / "plain.json5"
    plain.write_text(json.dumps({"connect": {"endpoints": [f"tcp/127.0.0.1:{place.port}"]}}))
    assert refused(place, monkeypatch, plain)


def test_who_was_removed_connects_in_vain(tmp_path, monkeypatch):
    found = Place(tmp_path / "x", passwords=False)
    file = tmp_path / "kept.json5"
    file.write_bytes(found.folder.of("driver", "bob").read_bytes())
    found.folder.remove({"driver": ["bob"]})
    with found.serving(monkeypatch):
        assert refused(found, monkeypatch, file)


def test_a_certificate_without_the_password_beside_it_does_not_open(place, monkeypatch, tmp_path):
    file = changed(place.folder.of("driver", "bob"), tmp_path / "f.json5", lambda s: s["transport"].pop("auth"))
    assert refused(place, monkeypatch, file)


def test_another_user_of_the_machine_is_not_let_in_on_loopback(place, monkeypatch, tmp_path):
    monkeypatch.delenv(config.VARIABLE)
    with open_member(place.local, wait=3.0) as session:
        assert answers(session, "motm/mine/status") == [b"status"]
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))  # where somebody else's files would be
    assert refused_at(place.local, monkeypatch, place.folder.here)


def test_the_shipped_configuration_is_closed():
    shipped = zenoh.Config.from_file(str(config.SHIPPED))

    def value(key):
        return json.loads(shipped.get_json(key))

    assert value("listen/endpoints") == []
    assert value("connect/endpoints") == []
    assert value("scouting/multicast/enabled") is False
    assert value("scouting/gossip/enabled") is False
    assert value("adminspace/enabled") is False
    assert value("transport/shared_memory/enabled") is False
    assert value("transport/link/rx/max_message_size") == 16 * 1024 * 1024


def test_programs_on_the_machine_itself_command_but_cannot_speak_for_the_twin(tmp_path, monkeypatch):
    found = Place(tmp_path / "x", passwords=False)
    with found.serving(monkeypatch) as place:
        monkeypatch.setenv(config.VARIABLE, str(place.folder.here))
        with open_member(place.local, wait=3.0) as session:
            assert heard(place, session, TICK)
            assert answers(session, "motm/mine/cmd/play") == [b"done"]
            assert arrives(place, session, "motm/mine/plant/state", TICK) == {"motm/mine/plant/state"}
            false = session.declare_queryable("motm/mine/cmd/play", lambda query: query.reply(query.key_expr, b"false"))
            assert answers(session, "motm/mine/cmd/stop") == [b"done"]
            with open_member(place.local, wait=3.0) as other:
                assert answers(other, "motm/mine/cmd/play") == [b"done"]
            false.undeclare()


FORMS = {"bridge": BridgeForm, "rmw": lambda zid: RmwForm(zid, node="motm_twin")}
TOKENS = {"bridge": "@/*/@ros2_lv/**", "rmw": "@ros2_lv/**"}


def tokens(session, form):
    return {str(reply.ok.key_expr) for reply in session.liveliness().get(TOKENS[form], timeout=0.5) if reply.ok}


@pytest.mark.parametrize("form", FORMS)
def test_ros_2_is_for_programs_on_the_machine_itself_only(place, monkeypatch, form):
    with ExitStack() as stack:
        monkeypatch.setenv(config.VARIABLE, str(place.folder.here))
        bridge, other = (stack.enter_context(open_member(place.local, wait=3.0)) for _ in range(2))
        named = FORMS[form](str(bridge.info.zid()))
        outlets = Outlets(bridge, named, lambda topic, payload: None)
        stack.callback(outlets.close)
        latched = next(topic for topic in PUBLISHED if topic.name == "robot_description")
        outlets.put(latched, {"data": "<robot/>"})
        expected = len(PUBLISHED) + len(ACCEPTED) + 1
        assert comes(lambda: len(tokens(other, form)) == expected, 5.0)
        assert late(other, named.key(latched))
        driver = stack.enter_context(place.visitor(monkeypatch, place.folder.of("driver", "bob")))
        assert tokens(driver, form) == set()
        assert not late(driver, named.key(latched), 1.0)


def late(session, key, wait=5.0):
    """Whether one who comes late gets the last value of a latched topic."""
    got = []
    subscriber = zenoh.ext.declare_advanced_subscriber(
        session, key, got.append, history=zenoh.ext.HistoryConfig(detect_late_publishers=True)
    )
    comes(lambda: got, wait)
    subscriber.undeclare()
    return bool(got)


AT_ROUTER = {"viewer": ["ann"], "driver": ["bob"], "twin": ["one", "two"]}
WAIT = 60.0  # [s] for what must come: several handshakes on a machine that may be busy


@pytest.fixture(scope="module", params=[False, True], ids=["mutual", "passwords"])
def folder(request, tmp_path_factory):
    """The files, a router that runs with its own, and two twins that meet there."""
    made = Folder(tmp_path_factory.mktemp("router") / "files")
    made.create(People(hosts=["127.0.0.1"], port=free_port(), passwords=request.param, names=AT_ROUTER))
    router = zenoh.open(zenoh.Config.from_file(str(made.router)))
    with pytest.MonkeyPatch.context() as patch, ExitStack() as stack:
        for name in AT_ROUTER["twin"]:
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
    for name in AT_ROUTER["twin"]:
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
        place.add({"twin": ["one"]})
