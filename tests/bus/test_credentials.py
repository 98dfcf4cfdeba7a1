"""Another user of the machine is not let in at the Zenoh port of a twin; programs of its user are, by themselves."""

import json
import os
import stat
import subprocess
import sys
import tempfile
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager

import pytest
import zenoh
from fake_twin import fake_server
from rich.console import Console
from waiting import until, until_paused

from motm_twin.bus import connection
from motm_twin.bus import private_folder as running
from motm_twin.bus.client import TwinClient
from motm_twin.bus.commands import Step
from motm_twin.bus.private_folder import FILE, announce, client_file, forget, known_at, own_credentials
from motm_twin.cli import serve as cli_serve
from motm_twin.client import connect
from motm_twin.client.discover import NoTwin, running_twins


@pytest.fixture(autouse=True)
def private(tmp_path, monkeypatch):
    """The private folder of a user who has none yet."""
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    return running.folder()


@contextmanager
def another_user(tmp_path, monkeypatch):
    """Programs that find the files of this user as little as somebody else's do."""
    other = tmp_path / "other"
    other.mkdir(exist_ok=True)
    with monkeypatch.context() as patch:
        patch.setattr(tempfile, "tempdir", str(other))
        yield


@contextmanager
def serving(**options):
    with fake_server(playing=False, **options) as server:
        until_paused(server)
        yield server


def plain(endpoint, *, mode="client", user=None, password=None):
    """A session of Zenoh alone."""
    config = zenoh.Config.from_file(str(connection.SHIPPED))
    config.insert_json5("mode", json.dumps(mode))
    config.insert_json5("connect/endpoints", json.dumps([endpoint]))
    if user is not None:
        config.insert_json5("transport/auth/usrpwd", json.dumps({"user": user, "password": password}))
    return zenoh.open(config)


def is_let_in(server, session):
    """Whether a session hears the twin, is answered by it, sees it, reaches its robot, or has it do something."""
    heard, arrived, began = [], [], server.loop.status().time
    hears = session.declare_subscriber(server.keys.status, heard.append)
    robot = server._session.declare_subscriber("motm/frankie/plant/state", arrived.append)
    now = server.loop.status().server_time
    envelope = {"sender": "stranger", "seq": 1, "expires": now + 30.0, "command": {"type": "step"}}

    def replies(key, asked=session.get, **payload):
        return any(reply.ok for reply in asked(key, timeout=0.3, **payload))

    checks = {
        "hears": lambda: bool(heard),
        "is answered": lambda: replies(server.keys.status),
        "sees it": lambda: replies(server.keys.alive, session.liveliness().get),
        "drives": lambda: replies("motm/frankie/cmd/step", payload=json.dumps(envelope)),
        "speaks": lambda: bool(arrived),
    }
    found, deadline = dict.fromkeys(checks, False), time.monotonic() + 2.0
    while not all(found.values()) and time.monotonic() < deadline:
        session.put("motm/frankie/plant/state", b"{}")
        found = {name: found[name] or check() for name, check in checks.items()}
        time.sleep(0.05)
    if found["drives"]:
        leaving = {**envelope, "seq": 2, "command": {"type": "hand_over"}}
        list(session.get("motm/frankie/cmd/hand_over", payload=json.dumps(leaving)))
    hears.undeclare()
    robot.undeclare()
    assert len(set(found.values())) == 1, found
    if not found["drives"]:
        assert server.loop.status().time == began
    return found["drives"]


STRANGERS = [(None, None), ("here", "guess"), ("here", ""), ("somebody", "guess")]


def test_who_does_not_have_the_password_neither_looks_nor_drives():
    with serving() as server, ExitStack() as stack:
        peers = []
        for user, password in STRANGERS:
            with pytest.raises(zenoh.ZError):
                plain(server.endpoint, mode="client", user=user, password=password)
            peers.append(stack.enter_context(plain(server.endpoint, mode="peer", user=user, password=password)))
        with ThreadPoolExecutor() as pool:  # each waits for a while
            assert list(pool.map(is_let_in, len(peers) * [server], peers)) == [False] * len(STRANGERS)


@pytest.mark.parametrize("mode", ["client", "peer"])
def test_who_has_it_looks_and_drives_with_zenoh_alone(mode):
    with serving() as server, plain(server.endpoint, mode=mode, **own_credentials()._asdict()) as session:
        assert is_let_in(server, session)


def test_the_file_of_the_port_is_the_whole_configuration_of_a_program():
    with serving() as server, zenoh.open(zenoh.Config.from_file(str(client_file(server.port)))) as session:
        assert is_let_in(server, session)


def test_own_programs_are_let_in_by_themselves_and_those_of_others_are_not(tmp_path, monkeypatch):
    with serving() as server:
        for opened in (connection.open_client, connection.open_member):
            with opened(server.endpoint) as session:
                assert is_let_in(server, session)
        with connect(server.endpoint, "frankie") as twin:
            twin.step()
            twin.hand_over()
        with another_user(tmp_path, monkeypatch):
            with connection.open_client(server.endpoint) as session:
                assert not is_let_in(server, session)
            with pytest.raises(TimeoutError):
                connection.open_member(server.endpoint, wait=0.0)
            with pytest.raises(NoTwin):
                connect(server.endpoint, "frankie", timeout=1.0)
            assert running_twins(server.endpoint) == []


def test_another_user_to_whom_the_file_was_given_is_let_in(tmp_path, monkeypatch):
    with serving() as server:
        given = tmp_path / "given.json5"
        given.write_bytes(client_file(server.port).read_bytes())
        with another_user(tmp_path, monkeypatch):
            monkeypatch.setenv(connection.VARIABLE, str(given))
            with connect() as twin:
                twin.step()


def test_a_bus_can_be_open_to_all(tmp_path, monkeypatch):
    with serving(open_bus=True) as server:
        with plain(server.endpoint) as session:
            assert is_let_in(server, session)
        with zenoh.open(zenoh.Config.from_file(str(client_file(server.port)))) as session:
            assert is_let_in(server, session)
        with connect(server.endpoint, "frankie") as twin:
            twin.step()
            twin.hand_over()
        with another_user(tmp_path, monkeypatch), connect(server.endpoint, "frankie") as twin:
            twin.step()


def test_a_client_that_came_first_meets_the_twin_and_again_when_that_was_started_anew():
    port = connection.free_port()
    with TwinClient(f"tcp/127.0.0.1:{port}", "frankie") as client:
        assert client.command(Step(), timeout=0.3).reason.startswith("the twin server does not answer")
        assert not client.alive
        for _ in range(2):
            with serving(port=port) as server:
                until(lambda: client.alive and client.status(), "they never met")
                until(lambda: client.command(Step(), timeout=0.5).ok, "no command got through")
                until(lambda s=server: client.tick() and client.tick().time == s.loop.status().time, "old state")
            until(lambda: not client.alive, "it is still heard")


def test_a_router_without_a_password_is_met_as_before():
    port = connection.free_port()
    config = zenoh.Config.from_file(str(connection.SHIPPED))
    config.insert_json5("mode", '"router"')
    config.insert_json5("listen/endpoints", json.dumps([f"tcp/127.0.0.1:{port}"]))
    with zenoh.open(config), connection.open_member(f"tcp/127.0.0.1:{port}", wait=5.0):
        pass


def test_a_port_is_forgotten_with_its_process(private):
    port = connection.free_port()
    endpoint = f"tcp/127.0.0.1:{port}"
    code = f"from motm_twin.bus.private_folder import guard; guard({port}, {endpoint!r})"
    subprocess.run([sys.executable, "-c", code], env={**os.environ, "TMPDIR": str(private.parent)}, check=True)
    assert client_file(port).exists()
    assert known_at(endpoint) is None
    with connection.open_server(other := connection.free_port()):
        assert not client_file(port).exists()
        with connection.open_server(port):
            assert known_at(endpoint) == known_at(f"tcp/127.0.0.1:{other}") == own_credentials()._asdict()
    forget(port)
    forget(other)
    assert [path.name for path in private.iterdir()] == [FILE]


@pytest.mark.parametrize(
    ("name", "text"),
    [("zenoh-7447-backup.json5", "{}"), ("zenoh-.json5", "{}"), ("zenoh-x.json5", ""), ("zenoh-7446.json5", "{}"),
     ("zenoh-7446.json5", "[1]"), ("zenoh-7446.json5", '{"metadata": {"pid": "x"}}'), ("x.json", "{}")],
)  # fmt: skip
def test_a_file_of_somebody_else_in_the_folder_is_passed_over(private, name, text):
    """A copy beside the files of the ports stopped every program that listens, with a traceback."""
    (private / name).write_text(text)
    announce(7447, "tcp/127.0.0.1:7447", own_credentials())
    assert known_at("tcp/127.0.0.1:7447") is not None
    assert known_at("tcp/127.0.0.1:7446") is None
    assert running.all_running() == []
    assert (private / name).exists() == (name != "zenoh-7446.json5")


def test_a_port_is_forgotten_with_its_server(private):
    with serving() as server:
        assert client_file(server.port).exists()
    assert [path.name for path in private.iterdir()] == [FILE]


def test_a_port_that_another_living_program_announced_is_not_free(private, monkeypatch):
    program = [sys.executable, "-c", "import sys; sys.stdin.read()"]
    with subprocess.Popen(program, stdin=subprocess.PIPE) as other, monkeypatch.context() as as_other:
        as_other.setattr(os, "getpid", lambda: other.pid)
        announce(taken := connection.free_port(), f"tcp/127.0.0.1:{taken}", own_credentials())
        as_other.undo()
        monkeypatch.setattr(connection, "FREE", (taken, taken + connection.TRIES))
        found = {connection.free_port() for _ in range(5 * connection.TRIES)}
        assert taken not in found
        assert len(found) > 5
        other.communicate(b"")
    assert forget(taken)


def test_nobody_else_reads_the_files(private):
    private.chmod(0o755)
    with serving():
        assert stat.S_IMODE(private.stat().st_mode) == 0o700
        modes = {path.suffix: stat.S_IMODE(path.stat().st_mode) for path in private.iterdir()}
        assert modes == {"": 0o600, ".json5": 0o600, ".users": 0o600}


def test_a_folder_of_somebody_else_is_a_sentence(monkeypatch):
    def somebody_elses():
        raise PermissionError("it belongs to somebody else")

    monkeypatch.setattr(running, "folder", somebody_elses)
    with pytest.raises(
        connection.ConfigError, match="the password for Zenoh cannot be kept: it belongs to somebody else"
    ):
        connection.open_server(connection.free_port())


def test_private_files_do_not_grow_old_while_a_twin_is_served(private, monkeypatch):
    own_credentials()
    os.utime(private / FILE, (0, 0))
    monkeypatch.setattr(cli_serve, "TOUCH_INTERVAL", 0.0)
    supervisor = cli_serve._Supervisor(Console(), "frankie", connection.free_port())
    threading.Timer(0.3, supervisor._stop.set).start()
    assert supervisor._watch() == cli_serve.OK
    assert time.time() - (private / FILE).stat().st_mtime < 60.0
