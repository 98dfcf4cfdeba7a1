"""Small commands of the shell: doctor, version, hints, lists, and the parameters of a run."""

import io
import json
import os
import socket
import subprocess
import sys

import pytest

from motm_twin import __version__, cli
from motm_twin.bus.connection import LOOPBACK
from motm_twin.cli import doctor
from motm_twin.program import BAD_INPUT, OK
from motm_twin.sessions.session import load_session


@pytest.fixture
def call(monkeypatch, capsys):
    def called(*words, given=None):
        monkeypatch.setattr(sys, "argv", ["motm-twin", *words])
        if given is not None:
            monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(given)))
        code = cli._called()
        seen = capsys.readouterr()
        return code, seen.out, seen.err

    return called


def test_version_is_a_command(call):
    assert call("version") == (OK, f"motm-twin {__version__}\n", "")


@pytest.mark.parametrize(("wrong", "meant"), [("srve", "serve"), ("what_if", "what-if"), ("benhc", "bench")])
def test_a_wrong_command_says_what_was_probably_meant(call, wrong, meant):
    code, out, error = call(wrong)
    assert code == BAD_INPUT and out == ""
    assert f"did you mean {meant}" in error


def test_bench_without_a_group_lists_them_and_runs_nothing(call):
    code, out, _ = call("bench")
    assert code == BAD_INPUT
    assert all(name in out for name in ("exp1a", "faults", "barn", "sweep_radius_max"))
    assert "bench all" in out and "120 min" in out


def test_a_terminal_that_knows_ascii_only_sees_all_with_question_marks():
    done = subprocess.run(
        [sys.executable, "-m", "motm_twin", "--help"], capture_output=True, check=False,
        env={**os.environ, "PYTHONIOENCODING": "ascii"},
    )  # fmt: skip
    assert done.returncode == 0 and done.stderr == b""
    assert b"doctor" in done.stdout and done.stdout.isascii()


def test_scene_check_reads_standard_input(call):
    code, out, _ = call("scene", "check", "-", given=b"format: motm-scene/1\nextends: line\ntitle: mine\n")
    assert code == OK and "standard input: good. mine" in out
    code, _, error = call("scene", "check", "-", given=b"format: motm-scene/1\nrobt: {}\n")
    assert code == BAD_INPUT and "standard input:2" in error and "robot" in error


def test_scene_check_goes_on_after_a_scene_that_is_wrong(call):
    code, out, error = call("scene", "check", "line", "no_such_scene", "turn")
    assert code == BAD_INPUT
    assert "line: good." in out and "turn: good." in out
    assert "no scene is called 'no_such_scene'" in error


def test_scene_check_prints_doubts_and_finds_the_scene_good(call):
    code, out, error = call("scene", "check", "strangers/cluttered_workbench")
    assert (code, error) == (OK, "")
    assert out.splitlines()[-1].startswith(
        "doubt: scenes/strangers/cluttered_workbench.yaml:52: objects.cork.at: no room"
    )


def test_a_run_takes_parameters_and_its_session_keeps_them(call, tmp_path):
    file = tmp_path / "turn.json"
    scene = tmp_path / "short.yaml"
    scene.write_text("format: motm-scene/1\nextends: line\ntime_limit: 1\n", encoding="utf-8")
    words = ("run", str(scene), "--set", "next_weight=0.5", "--set", "bezier=false", "--save", str(file), "--json", "-")
    _, out, _ = call(*words)
    assert json.loads(out)["time_s"] == 1.0
    session = load_session(str(file))
    assert session.parameters["next_weight"] == 0.5 and session.parameters["bezier"] is False
    code, _, error = call("run", str(scene), "--set", "next_wait=1")
    assert code == BAD_INPUT and "next_weight" in error


def test_the_doctor_finds_this_machine_good(call, capsys):
    code, out, _ = call("doctor")
    assert code == OK
    assert "Zenoh works on loopback" in out and "packages: numpy" in out and "wrong" not in out


def test_the_doctor_names_the_cure_of_what_is_missing(call, monkeypatch):
    monkeypatch.setitem(doctor.NEEDED, "no_such_module", "no-such-package")
    monkeypatch.setattr(doctor, "CHROMIUMS", ())
    monkeypatch.delenv("MOTM_CHROMIUM", raising=False)
    with socket.create_server((LOOPBACK, 0)) as taken:
        monkeypatch.setattr(doctor, "PAGE_PORT", taken.getsockname()[1])
        code, out, _ = call("doctor")
    assert code == 1
    lines = {line[:5].strip(): line for line in out.splitlines()}
    assert "no-such-package cannot be imported" in lines["wrong"] and "make run" in lines["wrong"]
    assert "--port" in out and "no Chromium found" in out


def test_without_a_folder_for_kernels_commands_and_the_doctor_say_what_to_set(call, monkeypatch):
    def no_locator(**_):
        raise RuntimeError("cannot cache function")

    def imports_kernels():
        no_locator()

    monkeypatch.setattr("numba.njit", no_locator)
    monkeypatch.setitem(cli.COMMANDS, "version", imports_kernels)
    code, out, error = call("version")
    assert (code, out) == (BAD_INPUT, "")
    assert error.startswith("motm-twin: there is no folder for compiled kernels") and "NUMBA_CACHE_DIR" in error
    monkeypatch.setattr(doctor, "CHECKS", (doctor._cache, imports_kernels))
    code, out, _ = call("doctor")
    (line,) = out.splitlines()
    assert code == 1 and line.startswith("wrong") and "NUMBA_CACHE_DIR" in line


def test_another_error_at_run_time_keeps_its_traceback(call, monkeypatch):
    def breaks():
        raise RuntimeError("of something else")

    monkeypatch.setitem(cli.COMMANDS, "version", breaks)
    with pytest.raises(RuntimeError, match="something else"):
        call("version")
