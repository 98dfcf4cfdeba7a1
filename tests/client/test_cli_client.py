"""`motm-twin watch | send | twins`, as a user calls them, and a program that finds what `serve` runs by its name."""

import json
import os
import secrets
import signal
import subprocess
import sys
import tempfile
import threading

import pytest
from fake_twin import fake_server
from waiting import until, until_paused

from motm_twin.bus.commands import AddObstacle, InsertTask, Load, Pause, SetParameter, Step
from motm_twin.bus.connection import free_port
from motm_twin.bus.private_folder import Running, note, own_credentials
from motm_twin.cli.client import _chosen, parse
from motm_twin.client import NoTwin, connect, running_twins
from motm_twin.methods import DEFAULT_METHOD
from motm_twin.model.scene import DriveTo


@pytest.fixture(scope="module")
def server(tmp_path_factory):
    data = tmp_path_factory.mktemp("data")
    with fake_server(playing=False, data=data) as running:
        until_paused(running)
        yield running


@pytest.fixture
def there(server, call):
    """A command that is told where the server is."""
    return lambda *words: call(*words, "--endpoint", server.endpoint)


@pytest.fixture(scope="module")
def known(server):
    """User and password that the server asks for."""
    return own_credentials()._asdict()


@pytest.fixture
def elsewhere(tmp_path, monkeypatch):
    """A machine on which two twins seem to run, where nobody answers."""
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr(tempfile, "tempdir", None)
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    for name, pid in (("one", os.getpid()), ("two", os.getppid())):
        note(Running(pid=pid, twin=name, endpoint=endpoint, page_port=None))
    return tmp_path


@pytest.mark.parametrize(
    ("words", "command"),
    [
        (["pause"], Pause()),
        (["step", "count=3"], Step(count=3)),
        (["add_obstacle", "name=7", "x=1", "y=-0.5"], AddObstacle(name="7", x=1.0, y=-0.5)),
        (
            ["add_obstacle", "name=a", "x=1", "y=0", "size=0.3,0.3,0.4"],
            AddObstacle(name="a", x=1, y=0, size=(0.3, 0.3, 0.4)),
        ),
        (["set_parameter", "name=xi", "value=0.7"], SetParameter(name="xi", value=0.7)),
        (["set_parameter", "name=bezier", "value=false"], SetParameter(name="bezier", value=False)),
        (["set_parameter", "name=xi", "value=null"], SetParameter(name="xi")),
        (
            ["insert_task", 'tasks={"type": "drive_to", "point": [0, 1]}'],
            InsertTask(tasks=(DriveTo(point=(0.0, 1.0)),)),
        ),
    ],
)
def test_words_become_a_command(words, command):
    assert parse(words[0], words[1:]) == command


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["plya"], "did you mean play"),
        (["step", "3"], "name=value"),
        (["step", "counts=3"], "it has: count"),
        (["step", "count=much"], "count"),
        (["speed"], "factor"),
        (["add_obstacle", "name=a b", "x=1e0", "y=0", "size=.3,0.3,0.4"], "size"),
    ],
)
def test_words_that_are_no_command_are_refused_with_what_is_allowed(words, said):
    with pytest.raises(ValueError, match=said):
        parse(words[0], words[1:])


@pytest.mark.parametrize("given", [None, "motm"])
def test_a_load_from_the_shell_means_the_method_of_serve_unless_another_is_named(given):
    """The message alone would mean the paper's: what a version says never changes."""
    words = ["scene=exp1"] + ([] if given is None else [f"method={given}"])
    assert parse("load", words) == Load(scene="exp1", method=given or DEFAULT_METHOD)
    assert DEFAULT_METHOD != Load(scene="exp1").method


def test_fields_come_as_json_too():
    assert parse("step", [], '{"count": 4}') == Step(count=4)
    with pytest.raises(ValueError, match="--json"):
        parse("step", [], "[1]")


def test_send_prints_the_answer_and_leaves_the_wheel(call, there):
    done = there("send", "step", "count=2")
    assert done.returncode == 0, done.stderr
    answer = json.loads(done.stdout)
    assert (answer["ok"], answer["version"]) == (True, "motm.answer/1")
    again = there("send", "add_obstacle", "--json", '{"name": "crate", "x": 1, "y": 1}')
    assert again.returncode == 0, again.stdout + again.stderr
    refused = there("send", "move_body", "name=ghost", "x=0", "y=0")
    assert refused.returncode == 1
    assert "ghost" in json.loads(refused.stdout)["reason"]
    assert there("send", "explode").returncode == 2
    nobody = ("--endpoint", f"tcp/127.0.0.1:{free_port()}", "--twin", "x", "--timeout", "0.2")
    assert call("send", "play", *nobody).returncode == 1


def test_watch_prints_the_newest_value_of_every_key(server, there):
    with connect(server.endpoint) as twin:
        twin.step(2)
        index = twin.latest_tick().index
        twin.hand_over()
    for key in ("tick", "robot", "grid", "metrics", "status", "scene", "event"):
        line = there("watch", key, "--once")
        assert line.returncode == 0, line.stderr
        assert len(line.stdout.splitlines()) == 1, key
    assert json.loads(there("watch", "tick", "--once", "--field", "index").stdout) == index
    assert json.loads(there("watch", "status", "--once", "--json").stdout)["twin"] == "frankie"
    wrong = there("watch", "tick", "--once", "--field", "robot.wings")
    assert wrong.returncode == 2
    assert "there is no 'wings' here; there are: pose" in wrong.stderr
    assert there("watch", "thoughts").returncode == 2


@pytest.mark.parametrize(
    ("path", "wrong", "known"),
    [
        ("time.x", "x", "none"),
        ("name.0", "0", "none"),
        ("goal.x", "x", "none"),
        ("tasks.0", "0", "none"),
        ("pose.3", "3", "0 to 2"),
        ("wings", "wings", "time, name, goal, tasks, pose"),
    ],
)
def test_a_field_that_is_not_there_is_told_with_those_that_are(path, wrong, known):
    """A part of a number was a TypeError with its traceback; of a name, the numbers of its letters were offered."""
    message = {"time": 1.0, "name": "fake", "goal": None, "tasks": [], "pose": [0.0, 1.0, 2.0]}
    with pytest.raises(LookupError, match=f"--field {path}: there is no '{wrong}' here; there are: {known}$"):
        _chosen(message, path)


def test_watch_prints_every_event_until_it_is_ended(server):
    command = [sys.executable, "-m", "motm_twin", "watch", "event", "--json", "--endpoint", server.endpoint]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process, connect(server.endpoint) as twin:
        lines = []
        reader = threading.Thread(target=lambda: lines.extend(process.stdout))
        reader.start()
        count = 0
        while not lines:  # it listens from some moment on
            count += 1
            twin.add_obstacle(f"box{count}", 0.1 * (count % 9), 0.0)
            twin.step()
            if count % 20 == 0:
                twin.reset()
        process.terminate()
        reader.join(10.0)
        twin.hand_over()
    assert json.loads(lines[0])["version"] == "motm.event/1"


def test_twins_lists_who_is_alive(call, there):
    found = there("twins", "--json")
    assert found.returncode == 0, found.stderr
    assert json.loads(found.stdout)["twin"] == "frankie"
    assert "frankie" in there("twins").stdout
    nobody = call("twins", "--endpoint", f"tcp/127.0.0.1:{free_port()}")
    assert (nobody.returncode, nobody.stdout) == (1, "")


@pytest.mark.parametrize("mode", ["peer", "client"])
def test_a_configuration_that_leads_somewhere_counts_before_the_twins_of_this_machine(
    server, known, elsewhere, mode, call
):
    file, recording = elsewhere / "there.json5", elsewhere / "x.mcap"
    settings = {
        "mode": mode,
        "connect": {"endpoints": [server.endpoint]},
        "scouting": {"multicast": {"enabled": False}},
        "transport": {"auth": {"usrpwd": known}},
    }
    file.write_text(json.dumps(settings))
    led = {"MOTM_ZENOH_CONFIG": str(file)}
    assert json.loads(call("watch", "status", "--once", "--json", **led).stdout)["twin"] == "frankie"
    assert json.loads(call("twins", "--json", **led).stdout)["endpoint"] == server.endpoint
    assert call("send", "pause", **led).returncode == 0
    recorded = call("record", str(recording), "--seconds", "0.5", **led)
    assert recorded.returncode == 0, recorded.stderr
    assert recording.exists()


@pytest.mark.parametrize("words", [["watch"], ["twins"], ["send", "play"], ["record", "never.mcap"]])
@pytest.mark.parametrize("content", [None, "{ mode: [[\n"])
def test_a_configuration_that_can_not_be_used_is_one_line(elsewhere, words, content, call):
    file = elsewhere / "wrong.json5"
    if content is not None:
        file.write_text(content)
    wrong = call(*words, MOTM_ZENOH_CONFIG=str(file))
    assert wrong.returncode == 2
    assert len(wrong.stderr.splitlines()) == 1
    assert "is no Zenoh configuration" in wrong.stderr


@pytest.mark.parametrize(("words", "code"), [(["watch"], 1), (["send", "play"], 1), (["record", "never.mcap"], 2)])
def test_which_twin_is_meant_must_be_said(elsewhere, words, code, call):
    several = call(*words)
    assert several.returncode == code
    assert "2 twins are running on this machine" in several.stderr
    assert "with --twin or --endpoint" in several.stderr
    assert "no twin called 'three' is running" in call(*words, "--twin", "three").stderr


def test_a_twin_that_does_not_answer_is_not_recorded(there, tmp_path):
    file = tmp_path / "x.mcap"
    nobody = there("record", str(file), "--twin", "ghost", "--seconds", "1", "--wait", "0.2")
    assert nobody.returncode == 2
    assert "no twin 'ghost' answers at" in nobody.stderr
    assert not file.exists()
    found = there("record", str(file), "--seconds", "0.5")  # the only one there
    assert found.returncode == 0, found.stderr


SERVE = [sys.executable, "-m", "motm_twin", "serve", "exp1", "--headless", "--zenoh-port", "0"]


def found(name):
    return [twin for twin in running_twins() if twin.twin == name and twin.alive]


@pytest.mark.slow
def test_a_served_twin_is_found_by_its_name_driven_and_gone_after_the_end(tmp_path):
    name = f"client-{secrets.token_hex(4)}"
    process = subprocess.Popen([*SERVE, "--twin", name, "--data", str(tmp_path / "kept")], stdout=subprocess.DEVNULL)
    try:
        until(lambda: found(name), "it is not found", 60.0)
        with connect(twin=name, timeout=30.0) as twin:
            twin.wait_until(lambda tick: tick.index > 3, timeout=120.0)
            twin.drive_to(0.5, 0.2)
            saved = twin.save("mine")
            assert json.loads((tmp_path / "kept" / "mine.json").read_bytes())["version"] == "motm.session/1"
            assert saved.path.endswith("kept/mine.json")
            kinds = set()
            for event in twin.events(since=0):
                kinds.add(event.kind)
                if {"loaded", "edit"} <= kinds:
                    break
            twin.hand_over()
        listed = subprocess.run(
            [sys.executable, "-m", "motm_twin", "twins", "--json"], capture_output=True, text=True, check=False
        )
        assert name in [json.loads(line)["twin"] for line in listed.stdout.splitlines()]
    finally:
        process.send_signal(signal.SIGINT)
        assert process.wait(20.0) == 0
    with pytest.raises(NoTwin, match="start one with"):
        connect(twin=name)
