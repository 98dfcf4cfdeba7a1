"""The bench table: its goals are those of the project, and a missed one is seen."""

import json
import math
from pathlib import Path

import pytest
from rich.console import Console

from motm_twin.cli import bench as command
from motm_twin.studies import groups
from motm_twin.studies.groups import GROUPS, Trial, failed, run_group
from motm_twin.studies.pool import counts, trials_per_hour
from motm_twin.studies.spec import TrialSpec


def result(**changes):
    good = failed(Trial(scene="exp1", variant="trial1", seed=0), "") | {
        "success": True, "time_s": 80.0, "picks_done": 6, "picks_total": 6, "places_done": 6,
        "mean_closing_base_speed_mps": 0.3, "tick_ms": {"p50": 5.0, "p99": 9.0, "max": 20.0}, "realtime_factor": 6.0,
        "state_hash": "a",
    }  # fmt: skip
    return good | changes


def judged(name, results):
    return {goal["name"]: goal["reached"] for goal in groups.summary(GROUPS[name], results)["goals"]}


def test_ten_good_trials_reach_every_goal_of_experiment_1():
    report = groups.summary(GROUPS["exp1"], [result() for _ in range(10)])
    assert report["reached"]
    assert report["machine"]


@pytest.mark.parametrize(
    ("change", "goal"),
    [
        ({"picks_done": 5}, "picked"),
        ({"places_done": 5}, "placed"),
        ({"time_s": 300.0}, "mean time"),
        ({"contacts": [{"caused_by_robot": False, "closing_speed": 0.0}]}, "contacts"),
        ({"success": False}, "trials not completed"),
        ({"mean_closing_base_speed_mps": None}, "base speed while the fingers close"),
        ({"time_s": 85.7}, "trial 1"),
    ],
)
def test_one_bad_trial_misses_its_goal(change, goal):
    results = [result(**change)] + [result(variant=f"trial{k}") for k in range(2, 11)]
    reached = judged("exp1", results)
    assert not reached[goal]


def test_a_trial_that_gave_up_early_does_not_lower_the_mean_time():
    results = [result(success=False, time_s=1.0)] + [result(variant=f"trial{k}") for k in range(2, 11)]
    assert not judged("exp1", results)["mean time"]


def test_with_temis_only_contacts_that_we_drive_into_count():
    slow = {"caused_by_robot": False, "closing_speed": 0.01}
    fast = {"caused_by_robot": False, "closing_speed": 0.03}
    assert judged("exp2", [result(contacts=[slow])])["contacts"]
    assert not judged("exp2", [result(contacts=[fast])])["contacts"]


def test_two_runs_that_differ_are_seen():
    assert judged("period", [result(), result()])["different state hashes"]
    assert not judged("period", [result(), result(state_hash="b")])["different state hashes"]


def test_groups_hold_the_trials_of_the_issue():
    assert {name: len(group.trials) for name, group in GROUPS.items()} == {
        "exp1": 10, "exp1_random": 20, "exp1a": 10, "exp2": 10, "period": 3, "external": 10,
        "external_bad_link": 10,
        "external_outages": 10,
        "physics": 20,
    }  # fmt: skip


def test_a_missed_goal_gives_exit_code_1_and_a_readable_file(monkeypatch, tmp_path, capsys):
    good = [result() for _ in range(3)]
    monkeypatch.setattr(groups, "run_group", lambda group, workers: iter(good))
    monkeypatch.setattr(command.period, "bench_period", lambda out, share, console: True)
    assert command.main(["period", "--out", str(tmp_path)]) == 0
    good[1]["tick_ms"]["p99"] = math.nan
    assert command.main(["period", "--out", str(tmp_path)]) == 1
    report = json.loads((tmp_path / "period.json").read_text())
    assert report["reached"] is False
    assert "MISSED" in capsys.readouterr().out


def test_an_unknown_group_is_refused_with_the_names_that_exist(capsys):
    assert command.main(["exp9"]) == 2
    assert "did you mean exp2" in capsys.readouterr().err
    assert command.main(["zzz"]) == 2
    assert "exp1_random" in capsys.readouterr().err


def test_a_trial_that_breaks_is_a_failed_row_and_time_over_is_said():
    group = GROUPS["period"]
    first, *_ = run_group(group, 1, limit_s=-1.0)
    assert not first["success"]
    assert "not run" in first["reason"]
    Console(quiet=True).print(groups.SHEET.table([first]))


def test_a_folder_that_cannot_be_is_refused_before_anything_is_measured(tmp_path, capsys):
    file = tmp_path / "file"
    file.write_text("mine")
    for names in (["exp1"], ["growth"], ["exp1", "--methods", "fast", "--trials", "1"]):
        assert command.main([*names, "--out", str(file / "results")]) == 2
        assert f"{file} is a file: give a folder" in capsys.readouterr().err
        assert command.main([*names, "--out", "/proc/results"]) == 2  # where even root makes no folder
        assert "/proc cannot be written to: give another folder" in capsys.readouterr().err
    assert file.read_text() == "mine"


SCENE = str(Path(__file__).parent / "half_a_metre.yaml")


def test_processes_are_doubled_up_to_all_of_them():
    assert [list(counts(workers)) for workers in (1, 2, 3, 4, 6)] == [[1], [1, 2], [1, 2, 3], [1, 2, 4], [1, 2, 4, 6]]


def test_a_rate_is_that_of_trials_that_succeed():
    assert trials_per_hour([TrialSpec(SCENE)], 1) > 0.0
    with pytest.raises(RuntimeError, match="time limit"):
        trials_per_hour([TrialSpec(SCENE, changes={"time_limit": 0.2})], 1)
