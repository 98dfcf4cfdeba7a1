"""The command line, as a user calls it."""

import json
import re
import subprocess
import sys

import pytest

from motm_twin.model.data_dirs import scenes_dir


def call(*arguments, cwd=None):
    return subprocess.run(
        [sys.executable, "-m", "motm_twin.cli", *arguments],
        capture_output=True,
        text=True,
        timeout=240,
        cwd=cwd,
        check=False,
    )


def test_run_prints_json_and_nothing_else_and_exits_with_success(tmp_path):
    result = call("run", "exp1", "--variant", "trial8", "--json", "-", cwd=tmp_path)
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


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("run", "exp11"), "exp1"),
        (("run", "exp1", "--variant", "trial11"), "trial1"),
        (("run", "no/such/file.yaml"), "no/such/file.yaml"),
        (("scene", "check", "nothing"), "nothing"),
        (("scene", "check"), "check"),
        (("run", "exp1", "--seed", "x"), "seed"),
        (("fly",), "fly"),
    ],
)
def test_bad_input_exits_with_two_and_says_what_is_wrong(arguments, words):
    result = call(*arguments)
    assert result.returncode == 2, result.stdout
    assert words in result.stderr + result.stdout
    assert "Traceback" not in result.stderr


def test_shipped_scenes_are_listed_from_any_directory(tmp_path):
    result = call("scene", "list", cwd=tmp_path)
    assert result.returncode == 0
    for name in ("exp1", "exp1a", "exp2", "playground"):
        assert name in result.stdout


def test_a_shipped_scene_checks_and_the_schema_is_json():
    assert call("scene", "check", "exp1").returncode == 0
    assert json.loads(call("scene", "schema").stdout)
