"""The command line, as a user calls it."""

import builtins
import itertools
import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path
from subprocess import PIPE

import msgspec
import pytest
from mcap.writer import Writer

import motm_twin
from motm_twin.__main__ import main as start
from motm_twin.cli import main
from motm_twin.model.data_dirs import scenes_dir
from motm_twin.sessions.session import load_session, save_session
from motm_twin.trial import run_scene

SECOND = Path(__file__).parent / "studies" / "half_a_metre.yaml"  # a trial of a second
TOKEN = "0123456789abcdefghijklmnopqrstuv"
RECORDED = Path(__file__).parent / "recorded" / "temi_dragged_before_the_robot.json"
NOBODY = ("--twin", "nobody", "--endpoint", "tcp/127.0.0.1:9", "--wait", "0.1")


def call(*arguments, cwd=None):
    return subprocess.run(
        [sys.executable, "-m", "motm_twin", *arguments],
        capture_output=True,
        text=True,
        timeout=240,
        cwd=cwd,
        check=False,
    )


def test_run_prints_json_and_nothing_else_and_exits_with_success(tmp_path):
    result = call("run", str(SECOND), "--json", "-", cwd=tmp_path)
    report = json.loads(result.stdout)
    assert result.returncode == 0, report["reason"]
    wanted = {
        "scene", "variant", "seed", "success", "time_s", "reference_tour_s", "picks_done", "picks_attempted",
        "picks_total", "places_done", "contacts", "min_base_clearance_m", "min_arm_clearance_m", "min_ee_obstacle_m",
        "path_length_m", "mean_closing_base_speed_mps", "reason", "tick_ms", "realtime_factor", "state_hash",
    }  # fmt: skip
    assert wanted <= set(report)
    assert set(report["tick_ms"]) == {"p50", "p99", "max"}


def test_a_task_that_cannot_be_completed_exits_with_one_and_a_reason(tmp_path):
    text = (scenes_dir() / "exp1.yaml").read_text(encoding="utf-8")
    path = tmp_path / "short.yaml"
    path.write_text(re.sub(r"^time_limit: .*$", "time_limit: 5", text, flags=re.MULTILINE))
    result = call("run", str(path), "--variant", "trial1", "--json", str(tmp_path / "out.json"))
    assert result.returncode == 1, result.stderr
    report = json.loads((tmp_path / "out.json").read_text())
    assert not report["success"]
    assert "time limit" in report["reason"]


def short_scene(folder, seconds=3):
    """Experiment 1 with a time limit [s]."""
    text = (scenes_dir() / "exp1.yaml").read_text(encoding="utf-8")
    path = folder / "short.yaml"
    path.write_text(re.sub(r"^time_limit: .*$", f"time_limit: {seconds}", text, flags=re.MULTILINE))
    return path


def test_a_saved_run_reruns_to_the_same_state_until_something_is_changed(tmp_path):
    path = tmp_path / "run.json"
    run = call("run", str(short_scene(tmp_path)), "--variant", "trial1", "--json", "-", "--save", str(path))
    assert run.returncode == 1, run.stderr  # not completed in 3 s
    equal = call("rerun", str(path), "--json", "-")
    assert equal.returncode == 0, equal.stderr
    assert json.loads(equal.stdout)["state_hash"] == json.loads(run.stdout)["state_hash"]

    moved = msgspec.structs.replace(load_session(path), parameters={"bezier": False, "next_weight": 0.2})
    save_session(moved, path)
    different = call("rerun", str(path))
    assert different.returncode == 1, different.stderr
    assert "different" in different.stdout
    assert load_session(path) == moved
    updated = call("rerun", str(path), "--update")
    assert updated.returncode == 0
    assert "different" in updated.stdout
    assert call("rerun", str(path)).returncode == 0
    assert load_session(path).parameters == moved.parameters


def test_what_if_prints_both_runs_and_their_difference(tmp_path):
    path, out = tmp_path / "run.json", tmp_path / "out.json"
    call("run", str(short_scene(tmp_path)), "--variant", "trial1", "--save", str(path))
    result = call(
        "what-if", str(path), "--set", "next_weight=0.5", "--set", "bezier=off", "--from", "1", "--json", str(out)
    )
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
    stream = call("what-if", "no/such/session.json", "--set", "bezier=off", "--stream")
    assert stream.returncode == 2
    assert "no such file" in json.loads(stream.stdout)["error"]


def test_a_rerun_tells_the_time_of_the_run_and_calls_the_length_of_the_recording_so(tmp_path):
    path = tmp_path / "run.json"
    run = call("run", str(short_scene(tmp_path)), "--variant", "trial1", "--save", str(path))
    assert "time 3.00 s " in run.stdout
    assert "time 3.00 s, 61 periods (3.05 s of recording)" in call("rerun", str(path)).stdout


def test_a_run_that_is_piped_prints_whole_lines_however_long_they_are(tmp_path):
    result = call("run", str(short_scene(tmp_path)), "--variant", "trial1")
    first, second, parts, path, last = result.stdout.splitlines()
    assert "time limit 3 s reached" in first
    assert re.fullmatch(r"time 3\.00 s .* contacts 0 caused of 0", second)
    found = re.fullmatch(r"seconds by part: at limit ([\d.]+), .*, standing [\d.]+", parts)
    assert found and sum(map(float, re.findall(r"[\d.]+", parts))) == pytest.approx(3.0, abs=0.3)
    assert re.fullmatch(r"path [\d.]+ m \(reference tour [\d.]+ m; .*\); the arm's foot .* per metre", path)
    assert re.fullmatch(r"period p50 .*; state [0-9a-f]{12}", last)


def test_a_run_draws_its_speed_along_the_path(tmp_path):
    file, report = tmp_path / "run.svg", tmp_path / "run.json"
    given = ("run", str(short_scene(tmp_path, 6.4)), "--variant", "trial1", "--plot", str(file), "--json", str(report))
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
        (("run", "exp1", "--seed", "x"), "seed"),
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
    ],
)
def test_bad_input_exits_with_two_and_says_what_is_wrong(arguments, words, monkeypatch, capfd):
    monkeypatch.setattr(sys, "argv", ["motm-twin", *arguments])
    with pytest.raises(SystemExit) as end:
        main()
    out, err = capfd.readouterr()
    assert end.value.code == 2, out
    assert words in err + out


def test_bad_input_is_the_exit_code_of_the_process_and_no_traceback():
    result = call("run", "no/such/file.yaml")
    assert result.returncode == 2, result.stdout
    assert "no/such/file.yaml" in result.stderr
    assert "Traceback" not in result.stderr


def test_a_file_that_cannot_be_written_is_refused_before_anything_is_computed(monkeypatch, capfd, tmp_path):
    reports = {
        str(tmp_path / "no" / "folder" / "out.json"): "give a file in a folder that exists",
        "/proc/out.json": "/proc cannot be written to: give another folder",  # even root cannot
    }
    computed = []
    for module in ("cli.run.run_scene", "cli.rerun.rerun", "cli.what_if.compare"):
        monkeypatch.setattr(f"motm_twin.{module}", lambda *given, **named: computed.append(given))
    commands = (("run", "exp1"), ("rerun", str(RECORDED)), ("what-if", str(RECORDED), "--set", "bezier=off"))
    for arguments, (report, said) in itertools.product(commands, reports.items()):
        monkeypatch.setattr(sys, "argv", ["motm-twin", *arguments, "--json", report])
        with pytest.raises(SystemExit) as end:
            main()
        assert end.value.code == 2
        assert said in capfd.readouterr().err
    assert computed == []


def test_what_if_says_that_a_recording_is_no_session_and_what_makes_one(monkeypatch, capfd, tmp_path):
    recording = tmp_path / "run.mcap"
    with recording.open("wb") as file:
        Writer(file).start("", "")
    monkeypatch.setattr(sys, "argv", ["motm-twin", "what-if", str(recording), "--set", "bezier=off"])
    with pytest.raises(SystemExit) as end:
        main()
    assert end.value.code == 2
    assert "is a recording: give a session, which `run --save`, `send save` or the page make" in capfd.readouterr().err


def test_ctrl_c_is_one_line_and_exit_code_130_and_the_session_so_far_is_kept(monkeypatch, capfd, tmp_path):
    path = tmp_path / "run.json"

    def interrupted(scene, *, on_tick, method):
        def until_then(tick):
            on_tick(tick)
            if tick.index == 29:
                raise KeyboardInterrupt

        return run_scene(scene, on_tick=until_then, method=method)

    monkeypatch.setattr("motm_twin.cli.run.run_scene", interrupted)
    for options, said in (((), ""), (("--save", str(path)), f"; the 1.50 s before are in {path}")):
        monkeypatch.setattr(sys, "argv", ["motm-twin", "run", "exp1", *options])
        with pytest.raises(SystemExit) as end:
            main()
        assert (end.value.code, capfd.readouterr().err) == (130, f"motm-twin: stopped{said}\n")
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


def test_shipped_scenes_are_listed_from_any_directory(tmp_path):
    result = call("scene", "list", cwd=tmp_path)
    assert result.returncode == 0
    for name in ("exp1", "exp1a", "exp2", "playground"):
        assert name in result.stdout


def test_a_shipped_scene_checks_and_the_schema_is_json():
    assert call("scene", "check", "exp1").returncode == 0
    assert json.loads(call("scene", "schema").stdout)


def test_version_is_that_of_the_package():
    result = call("--version")
    assert (result.returncode, result.stdout) == (0, f"motm-twin {motm_twin.__version__}\n")
