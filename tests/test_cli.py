"""The command line, as a user calls it."""

import builtins
import io
import itertools
import json
import os
import re
import signal
import socket
import subprocess
import sys
import time
from dataclasses import dataclass, fields
from pathlib import Path
from subprocess import PIPE

import msgspec
import pytest
import tyro
from mcap.writer import Writer
from rich.console import Console

import motm_twin
from motm_twin.__main__ import main as start
from motm_twin.bus.connection import free_port
from motm_twin.cli.security import SecuritySettings
from motm_twin.cli.serve import BAD_INPUT, OK, _Supervisor, serve
from motm_twin.cli.settings import BenchSettings, PageSettings, PaperSettings, ServeSettings
from motm_twin.model.assets import scenes_dir
from motm_twin.sessions.session import load_session, save_session
from motm_twin.trial import run_scene

SECOND = Path(__file__).parent / "studies" / "half_a_metre.yaml"  # a trial of a second
TOKEN = "0123456789abcdefghijklmnopqrstuv"
RECORDED = Path(__file__).parent / "recorded" / "temi_dragged_before_the_robot.json"
SERVE = ("serve", "exp1", "--zenoh-port", "0", "--port", "0")
NOBODY = ("--twin", "nobody", "--endpoint", "tcp/127.0.0.1:9", "--wait", "0.1")


def process(*arguments):
    """The program, as a user starts it."""
    command = [sys.executable, "-m", "motm_twin", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=240, check=False)


def short_scene(folder, seconds=3):
    """Experiment 1 with a time limit [s]."""
    text = (scenes_dir() / "exp1.yaml").read_text(encoding="utf-8")
    path = folder / "short.yaml"
    path.write_text(re.sub(r"^time_limit: .*$", f"time_limit: {seconds}", text, flags=re.MULTILINE))
    return path


@dataclass(frozen=True)
class Ended:
    """A run that its time limit of 3 s has ended."""

    printed: str  # into a pipe
    report: dict
    session: Path


@pytest.fixture(scope="module")
def short(tmp_path_factory):
    folder = tmp_path_factory.mktemp("short")
    report, session = folder / "report.json", folder / "session.json"
    run = process("run", short_scene(folder), "--variant", "trial1", "--json", report, "--save", session)
    assert run.returncode == 1, run.stderr
    return Ended(run.stdout, json.loads(report.read_text()), session)


def test_run_prints_json_and_nothing_else_and_exits_with_success(call, tmp_path):
    result = call("run", SECOND, "--json", "-", cwd=tmp_path)
    report = json.loads(result.stdout)
    assert result.returncode == 0, report["reason"]
    wanted = {
        "scene", "variant", "seed", "success", "time_s", "reference_tour_s", "picks_done", "picks_attempted",
        "picks_total", "places_done", "contacts", "min_base_clearance_m", "min_arm_clearance_m", "min_ee_obstacle_m",
        "path_length_m", "mean_closing_base_speed_mps", "reason", "tick_ms", "realtime_factor", "state_hash",
    }  # fmt: skip
    assert wanted <= set(report)
    assert set(report["tick_ms"]) == {"p50", "p99", "max"}


def test_a_task_that_cannot_be_completed_exits_with_one_and_a_reason_in_whole_lines(short):
    assert not short.report["success"] and "time limit" in short.report["reason"]
    first, second, parts, path, last = short.printed.splitlines()
    assert "time limit 3 s reached" in first
    assert re.fullmatch(r"time 3\.00 s .* contacts 0 caused of 0", second)
    found = re.fullmatch(r"seconds by part: at the speed limit ([\d.]+), .*, standing [\d.]+", parts)
    assert found and sum(map(float, re.findall(r"[\d.]+", parts))) == pytest.approx(3.0, abs=0.3)
    assert re.fullmatch(r"path [\d.]+ m \(reference tour [\d.]+ m; .*\); acceleration at the arm's .* per metre", path)
    assert re.fullmatch(r"period p50 .*; state [0-9a-f]{12}", last)


def test_a_run_prints_what_touched_what_and_when(call, tmp_path):
    temi = "agents:\n  temi: {waypoints: [[1.2, 0.0], [-1.0, 0.0]], speed_mps: 0.5, behaviour: blind}\n"
    path = tmp_path / "run_into.yaml"
    path.write_text(SECOND.read_text(encoding="utf-8") + temi)
    printed = call("run", path).stdout
    assert re.search(r"contacts 1 caused of 1,.*\n  1\.\d+ s: base in temi, [\d.]+ mm deep\n", printed), printed


def test_a_run_prints_the_doubts_about_its_variant_on_standard_error(call, tmp_path):
    floating = "bins:\n  tray: {at: [0.0, -2.0], floor_z: 0.7}\nvariants:\n  one: {}\n  two: {bins: {tray: null}}\n"
    path = tmp_path / "floating.yaml"
    path.write_text(SECOND.read_text(encoding="utf-8") + floating)
    doubted, good = (call("run", path, "--variant", name, "--json", "-") for name in ("one", "two"))
    assert re.match(r"doubt: .*floating.yaml:\d+: bins.tray: it floats: ", doubted.stderr), doubted.stderr
    assert "doubt" not in good.stderr
    assert json.loads(doubted.stdout)["success"] and json.loads(good.stdout)["success"]


def test_a_saved_run_reruns_to_the_same_state_until_something_is_changed(call, short, tmp_path):
    equal = call("rerun", short.session, "--json", "-")
    assert equal.returncode == 0, equal.stderr
    assert json.loads(equal.stdout)["state_hash"] == short.report["state_hash"]

    moved = msgspec.structs.replace(load_session(short.session), parameters={"bezier": False, "next_weight": 0.2})
    save_session(moved, path := tmp_path / "run.json")
    different = call("rerun", path)
    assert different.returncode == 1, different.stderr
    assert "different" in different.stdout
    assert load_session(path) == moved
    updated = call("rerun", path, "--update")
    assert updated.returncode == 0
    assert "different" in updated.stdout
    again = call("rerun", path)
    assert again.returncode == 0
    assert "time 3.00 s, 61 periods (3.05 s of recording)" in again.stdout
    assert load_session(path).parameters == moved.parameters


def test_what_if_prints_both_runs_and_their_difference(call, short, tmp_path):
    changes, out = ("--set", "next_weight=0.5", "--set", "bezier=off"), tmp_path / "out.json"
    result = call("what-if", short.session, *changes, "--from", "1", "--json", out)
    assert result.returncode == 0, result.stderr
    said = result.stdout.splitlines()
    assert said[0] == "  running both: 3.05 s are recorded"
    assert {"  as it was: ended at 3.00 s", "  changed: ended at 3.00 s"} <= set(said)
    assert "as it was" in result.stdout
    assert "time [s]" in result.stdout
    assert "time limit" in result.stdout
    report = json.loads(out.read_text())
    assert report["parameters"] == {"next_weight": 0.5, "bezier": False}
    assert report["difference_s"] == report["changed"]["time_s"] - report["as_it_was"]["time_s"]
    stream = process("what-if", "no/such/session.json", "--set", "bezier=off", "--stream")
    assert stream.returncode == 2
    assert "no such file" in json.loads(stream.stdout)["error"]


def test_a_run_draws_its_speed_along_the_path(call, tmp_path):
    file, report = tmp_path / "run.svg", tmp_path / "run.json"
    given = ("run", short_scene(tmp_path, 6.4), "--variant", "trial1", "--plot", file, "--json", report)
    assert call(*given).returncode == 1  # the time limit
    text = file.read_text(encoding="utf-8")
    for words in ("distance driven [m]", "speed [m/s]", "reference tour, at the limit", "slower, turning"):
        assert words in text
    (leg,) = json.loads(report.read_text())["measures"]["legs"]
    assert leg["reference_m"] > leg["path_m"] > 0.0  # the leg is not over
    assert sum(leg["parts_s"].values()) == pytest.approx(leg["time_s"])


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("run", "exp11"), "exp1"),
        (("run", "exp1", "--variant", "trial11"), "trial1"),
        (("run", "no/such/file.yaml"), "no/such/file.yaml"),
        (("scene", "check", "nothing"), "nothing"),
        (("scene", "check"), "check"),
        (("scene", "generate"), "--seed"),
        (("run", "generated:x"), "generated:17@0.6"),
        (("run", "exp1", "--seed", "x"), "no whole number: give one from 0"),
        (("fly",), "fly"),
        (("rerun", "no/such/session.json"), "no such file"),
        (("rerun", str(RECORDED), "--json", "no/such/folder/out.json"), "no/such/folder"),
        (("what-if", str(RECORDED)), "--set"),
        (("what-if", str(RECORDED), "--set", "next_wait=1"), "next_weight"),
        (("what-if", str(RECORDED), "--set", "nosuch=0"), "docs/zenoh.md, Parameters"),
        (("what-if", str(RECORDED), "--set", "bezier=off", "--from", "1000"), "1000"),
        (("run", "exp1", "--save", "no/such/folder/run.json"), "folder"),
        (("run", "exp1", "--json", "no/such/folder/run.json"), "folder"),
        (("run", "exp1", "--plot", "no/such/folder/run.png"), "folder"),
        (("run", "exp1", "--plot", "run.txt"), ".svg"),
        (("serve", "exp1", "--port", "99999"), "port 99999: use 1 to 65535"),
        (("serve", "exp1", "--headless", "--zenoh-port", "99999"), "port 99999: use 1 to 65535"),
        (("serve", "exp1", "--host", "192.0.2.1", "--token", TOKEN), "192.0.2.1 is no IPv4 address of this machine"),
        (("serve", "exp1", "--headless", "--plant", "zenoh", "--connect", "foo"), "tcp/127.0.0.1:7447"),
        (("send", "pause", "--endpoint", "foo"), "tcp/127.0.0.1:7447"),
        (("run", "exp1", "--save", str(RECORDED)), "exists already: choose another name, or remove it"),
        (("rerun", __file__), "is neither a session nor a recording"),
        (("bench", "exp9"), "motm-twin bench: unknown group 'exp9'"),
        (("watch", "--endpoint", "foo", "--twin", "frankie"), "tcp/127.0.0.1:7447"),
        (("record", "foo.txt", *NOBODY), "foo.txt: a recording ends in .mcap"),
        (("record", "b.mcap", "--seconds", "-5", *NOBODY), "--seconds -5: give a time above 0"),
        (("record", "b.mcap", "--seconds", "nan", *NOBODY), "--seconds nan: give a time above 0"),
        ((*SERVE, "--host", "0.0.0.0", "--no-token"), "--no-token is for this machine only"),
        ((*SERVE, "--host", "0.0.0.0", "--token", "short"), "too weak"),
        ((*SERVE, "--host", "0.0.0.0", "--token", "a" * 64), "too weak"),
        ((*SERVE, "--twin", "no/slash"), "twin name"),
        ((*SERVE, "--variant", "trial99"), "trial9"),
    ],
)
def test_bad_input_exits_with_two_and_says_what_is_wrong(arguments, words, call, monkeypatch):
    monkeypatch.delenv("MOTM_TOKEN", raising=False)
    result = call(*arguments)
    assert result.returncode == 2, result.stdout
    assert words in result.stderr + result.stdout


@pytest.mark.parametrize("option", ["--port", "--zenoh-port"])
def test_a_taken_port_is_bad_input_with_advice(option, call):
    with socket.socket() as holder:
        holder.bind(("127.0.0.1", 0))
        holder.listen()
        taken = holder.getsockname()[1]
        ports = {"--port": free_port(), "--zenoh-port": free_port(), option: taken}
        ended = call("serve", "exp1", *itertools.chain(*ports.items()))
    assert ended.returncode == 2
    assert f"port {taken} on 127.0.0.1 is taken" in ended.stdout + ended.stderr
    assert option in ended.stdout + ended.stderr


def test_bad_input_is_the_exit_code_of_the_process_and_no_traceback():
    result = process("run", "no/such/file.yaml")
    assert result.returncode == 2, result.stdout
    assert "no/such/file.yaml" in result.stderr
    assert "Traceback" not in result.stderr


def test_a_file_that_cannot_be_written_is_refused_before_anything_is_computed(call, monkeypatch, tmp_path):
    reports = {
        str(tmp_path / "no" / "folder" / "out.json"): "give a file in a folder that exists",
        "/proc/out.json": "/proc cannot be written to: give another folder",  # even root cannot
    }
    computed = []
    for module in ("cli.run.run_scene", "cli.run.rerun", "cli.run.compare"):
        monkeypatch.setattr(f"motm_twin.{module}", lambda *given, **named: computed.append(given))
    commands = (("run", "exp1"), ("rerun", str(RECORDED)), ("what-if", str(RECORDED), "--set", "bezier=off"))
    for arguments, (report, said) in itertools.product(commands, reports.items()):
        refused = call(*arguments, "--json", report)
        assert refused.returncode == 2
        assert said in refused.stderr
    assert computed == []


def test_what_if_says_that_a_recording_is_no_session_and_what_makes_one(call, tmp_path):
    recording = tmp_path / "run.mcap"
    with recording.open("wb") as file:
        Writer(file).start("", "")
    refused = call("what-if", recording, "--set", "bezier=off")
    assert refused.returncode == 2
    assert "is a recording: give a session, which `run --save`, `send save` or the page make" in refused.stderr


def test_ctrl_c_is_one_line_and_exit_code_130_and_the_session_so_far_is_kept(call, monkeypatch, tmp_path):
    path = tmp_path / "run.json"

    def interrupted(scene, *, on_tick, method, parameters):
        def until_then(tick):
            on_tick(tick)
            if tick.index == 29:
                raise KeyboardInterrupt

        return run_scene(scene, on_tick=until_then, method=method, parameters=parameters)

    monkeypatch.setattr("motm_twin.cli.run.run_scene", interrupted)
    for options, said in (((), ""), (("--save", str(path)), f"; the 1.50 s before are in {path}")):
        stopped = call("run", "exp1", *options)
        assert (stopped.returncode, stopped.stderr) == (130, f"motm-twin: stopped{said}\n")
    kept = load_session(path)
    assert (kept.periods, kept.state_hash, len(kept.track)) == (30, "", 1)


def test_ctrl_c_while_the_command_line_is_loaded_is_one_line(monkeypatch, capfd):
    def interrupted(name, *others):
        if others[2:3] == (("cli",),):
            raise KeyboardInterrupt
        return loaded(name, *others)

    loaded = builtins.__import__
    monkeypatch.setattr(builtins, "__import__", interrupted)
    with pytest.raises(SystemExit) as end:
        start()
    assert (end.value.code, capfd.readouterr().err) == (130, "motm-twin: stopped\n")


def test_ctrl_c_during_a_what_if_ends_its_processes_without_a_word_of_theirs():
    code = (
        "import signal; signal.signal(signal.SIGINT, signal.default_int_handler);"  # ignored in a background job
        "from motm_twin.__main__ import main; main()"
    )
    command = [sys.executable, "-c", code, "what-if", str(RECORDED), "--set", "bezier=off"]
    with subprocess.Popen(command, stdout=PIPE, stderr=PIPE, text=True, start_new_session=True) as process:
        try:
            assert process.stdout is not None
            assert "running both" in process.stdout.readline()
            until = time.monotonic() + 60.0
            children = Path(f"/proc/{process.pid}/task/{process.pid}/children")
            while len(children.read_text().split()) < 2 and time.monotonic() < until:
                time.sleep(0.05)
            os.killpg(process.pid, signal.SIGINT)  # as a terminal does
            _, err = process.communicate(timeout=60)
        finally:
            process.kill()
    assert (process.returncode, err) == (130, "motm-twin: stopped\n")


def test_a_pipe_that_nobody_reads_any_more_is_no_traceback():
    read, write = os.pipe()
    os.close(read)
    command = [sys.executable, "-m", "motm_twin", "scene", "list"]
    with os.fdopen(write, "wb") as gone:
        done = subprocess.run(command, stdout=gone, stderr=PIPE, text=True, timeout=240, check=False)
    assert (done.returncode, done.stderr) == (1, "")


def test_a_shipped_scene_checks_and_the_schema_is_json(call):
    assert call("scene", "check", "exp1").returncode == 0
    assert json.loads(call("scene", "schema").stdout)


@pytest.mark.parametrize("kind", [BenchSettings, PageSettings, PaperSettings, SecuritySettings])
def test_every_option_of_several_words_adds_up_when_it_is_repeated(kind):
    """The second one replaced the first without a word: --twin a1 --twin a2 made a folder that knew a2 only."""
    given = ["make", "folder"] if kind is SecuritySettings else []
    several = [each.name for each in fields(kind) if each.default == ()]
    assert several
    for name in several:
        option = f"--{'name' if name == 'names' else name}"
        found = tyro.cli(kind, args=[*given, option, "a", "b", option, "c"])
        assert getattr(found, name) == ("a", "b", "c")


def test_version_is_that_of_the_package(call):
    result = call("--version")
    assert (result.returncode, result.stdout) == (0, f"motm-twin {motm_twin.__version__}\n")


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
    supervisor._tell({"event": "state", "state": state, "text": text})
    assert said.getvalue().rstrip("\n").partition(" s  ")[2] == line


@pytest.mark.parametrize(
    ("option", "place", "words"),
    [
        ("record", "/proc/x.mcap", "--record /proc/x.mcap: /proc cannot be written to: give another folder"),
        ("record", "no/folder/x.mcap", "in a folder that exists"),
        ("record", "file/x.mcap", "file is a file: give a folder"),
        ("data", "/proc/1/x", "--data /proc/1/x: /proc/1 cannot be written to: give another folder"),
        ("data", "file", "file is a file: give a folder"),
        ("data", "file/x", "file is a file: give a folder"),
    ],
)
def test_where_nothing_can_be_written_is_refused_before_anything_begins(
    option, place, words, tmp_path, monkeypatch, capsys
):
    (tmp_path / "file").write_text("a file where the folder should be")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(_Supervisor, "run", lambda _: pytest.fail("it began"))
    assert serve(ServeSettings(headless=True, zenoh_port=0, **{option: Path(place)})) == BAD_INPUT
    assert words in capsys.readouterr().out


def test_folders_that_can_be_written_need_not_exist_and_are_left_as_they_are(tmp_path, monkeypatch):
    monkeypatch.setattr(_Supervisor, "run", lambda _: OK)
    assert (
        serve(ServeSettings(headless=True, zenoh_port=0, data=tmp_path / "new" / "data", record=tmp_path / "x.mcap"))
        == OK
    )
    assert list(tmp_path.iterdir()) == []
