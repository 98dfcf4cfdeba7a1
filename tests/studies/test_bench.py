"""Tables of benches: goals are those of the project, a missed one is seen, and results are read rightly."""

import io
import json
import math
from pathlib import Path

import pytest
from rich.console import Console

from motm_twin.cli import bench as command
from motm_twin.cli.bench import main
from motm_twin.generate.challenges import barn
from motm_twin.measures.measures import PARTS
from motm_twin.model.names import SceneError
from motm_twin.model.scene_file import load_scene
from motm_twin.studies import disturbances, groups
from motm_twin.studies.barn import bench_barn, limits_of, metric, optimal_time, worlds
from motm_twin.studies.groups import GROUPS, Trial, failed, run_group
from motm_twin.studies.pool import counts, trials_per_hour
from motm_twin.studies.run import Results
from motm_twin.studies.spec import TrialSpec

from .made_results import SCENE

pytestmark = pytest.mark.usefixtures("in_this_process")


def result(**changes):
    good = failed(Trial(scene="exp1", variant="trial1", seed=0), "") | {
        "success": True, "time_s": 80.0, "picks_done": 6, "picks_total": 6, "places_done": 6,
        "mean_closing_base_speed_mps": 0.3, "tick_ms": {"p50": 5.0, "p99": 9.0, "max": 20.0}, "realtime_factor": 6.0,
        "state_hash": "a",
    }  # fmt: skip
    return good | changes


def judged(name, results):
    return {goal["name"]: goal["reached"] for goal in groups.judged(GROUPS[name], results)}


@pytest.mark.parametrize(
    ("change", "goal"),
    [
        ({}, None),
        ({"picks_done": 5}, "picked"),
        ({"places_done": 5}, "placed"),
        ({"time_s": 300.0}, "mean time"),
        ({"contacts": [{"caused_by_robot": False, "closing_speed": 0.0}]}, "contacts"),
        ({"success": False}, "trials not completed"),
        ({"mean_closing_base_speed_mps": None}, "base speed while the fingers close"),
        ({"time_s": 85.7}, "trial 1"),
        ({"success": False, "time_s": 1.0}, "mean time"),  # what gave up early does not lower it
    ],
)
def test_ten_good_trials_reach_every_goal_and_one_bad_one_misses_its_own(change, goal):
    reached = judged("exp1", [result(**change), *(result(variant=f"trial{k}") for k in range(2, 11))])
    assert all(reached.values()) if goal is None else not reached[goal]


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
        "exp1": 10, "exp1_random": 20, "exp1a": 10, "exp2": 10, "period": 3, "external": 10, "external_bad_link": 10,
        "external_outages": 10, "physics": 20,
    }  # fmt: skip


def test_a_missed_goal_gives_exit_code_1_and_a_readable_file(monkeypatch, tmp_path, capsys):
    good = [result() for _ in range(3)]
    monkeypatch.setattr(groups, "run_group", lambda group, workers: iter(good))
    monkeypatch.setattr(command.period, "bench_period", lambda out, share, console: True)
    assert main(["period", "--out", str(tmp_path)]) == 0
    good[1]["tick_ms"]["p99"] = math.nan
    assert main(["period", "--out", str(tmp_path)]) == 1
    report = json.loads((tmp_path / "period.json").read_text())
    assert report["reached"] is False
    assert report["machine"]
    assert "MISSED" in capsys.readouterr().out


@pytest.mark.parametrize(("name", "said"), [("exp9", "did you mean exp2"), ("zzz", "exp1_random")])
def test_an_unknown_group_is_refused_with_the_names_that_exist(name, said, capsys):
    assert main([name]) == 2
    assert said in capsys.readouterr().err


def test_a_trial_that_breaks_is_a_failed_row_and_time_over_is_said(console):
    first, *_ = run_group(GROUPS["period"], 1, limit_s=-1.0)
    assert not first["success"]
    assert "not run" in first["reason"]
    console.print(groups.SHEET.table([first]))


@pytest.mark.parametrize("words", ["exp1", "growth", "exp1 --methods fast --trials 1"])
def test_a_folder_that_cannot_be_is_refused_before_anything_is_measured(words, tmp_path, capsys):
    file = tmp_path / "file"
    file.write_text("mine")
    assert main([*words.split(), "--out", str(file / "results")]) == 2
    assert f"{file} is a file: give a folder" in capsys.readouterr().err
    assert main([*words.split(), "--out", "/proc/results"]) == 2  # where even root makes no folder
    assert "/proc cannot be written to: give another folder" in capsys.readouterr().err
    assert file.read_text() == "mine"


def test_processes_are_doubled_up_to_all_of_them():
    assert [list(counts(workers)) for workers in (1, 2, 3, 4, 6)] == [[1], [1, 2], [1, 2, 3], [1, 2, 4], [1, 2, 4, 6]]


def test_a_rate_is_that_of_trials_that_succeed():
    assert trials_per_hour([TrialSpec(SCENE)], 1) > 0.0
    with pytest.raises(RuntimeError, match="time limit"):
        trials_per_hour([TrialSpec(SCENE, changes={"time_limit": 0.2})], 1)


def _result(scene, seed, seconds, *, method="fast", variant="trial1", success=True, contacts=()):
    return {
        "scene": scene, "variant": variant, "seed": seed, "method": method, "time_s": seconds, "success": success,
        "mean_closing_base_speed_mps": 0.35, "reference_tour_s": 50.0, "contacts": list(contacts), "reason": "",
    }  # fmt: skip


def _results(**changed):
    trials = {
        "exp1": [_result("exp1", 0, 80.0)],
        "exp1a": [_result("exp1a", 0, 90.0)],
        "exp1_random": [_result("exp1", 0, 82.0), _result("exp1", 1, 86.0)],
        "exp2": [_result("exp1", 0, 80.0), _result("exp2", 0, 96.0)],
        "one_temi": [_result("exp1", 0, 80.0), _result("exp2", 0, 82.0)],
        "quick_robot": [_result("exp1", 0, 80.0)],
        "further_scenes": [_result("island", 0, 100.0)],
        "generated": [_result("generated:1@0.5", 1, 70.0)],
    } | changed
    return Results(Path(), trials)


def test_both_methods_run_the_same_trials_and_a_share_means_fewer_seeds():
    few = groups.experiments(0.04)
    assert set(few) == set(_results().trials)
    for each in few.values():
        fast, motm = (sum(spec.method == method for spec in each.specs) for method in groups.METHODS)
        assert fast == motm > 0
    assert len(few["exp1_random"].specs) == 2 * 2
    assert len(groups.experiments(1.0)["generated"].specs) == 2 * groups.GENERATED
    assert all(spec.changes["robot.base.forward_speed"] == 1.0 for spec in few["quick_robot"].specs)


def test_every_number_is_read_from_the_trials():
    found = groups.values(_results(), "fast")
    assert set(found) == {row.key for row in groups.WANTED}
    assert found == pytest.approx({
        "exp1": 80.0, "exp1a": 90.0, "random": 84.0, "four": 20.0, "one": 2.5, "closing": 0.35, "quick": 1.6,
        "generated": 100.0, "further": 100.0, "paper": 100.0, "contacts": 0.0,
    })  # fmt: skip
    slow = _result("exp1", 0, 500.0, method="motm", success=False)  # those of the other method do not count
    assert groups.values(_results(exp1=[_result("exp1", 0, 80.0), slow]), "fast")["exp1"] == 80.0


def test_where_the_time_goes_is_a_mean_of_the_completed_trials():
    def measured(at_limit, felt, *, success=True):
        parts = dict.fromkeys(PARTS, 0.0) | {"at_limit": at_limit, "turning": 2.0}
        measures = {
            "parts_s": parts, "legs": [{"reference_m": 20.0}, {"reference_m": None}],
            "arm_base_acceleration_mps2": {"p99": felt, "max": 2.0 * felt}, "yaw_sign_changes_per_m": 1.5,
        }  # fmt: skip
        return _result("exp1", 0, 80.0, success=success) | {"measures": measures, "path_length_m": 30.0}

    trials = [measured(40.0, 0.5), measured(50.0, 0.7), measured(1.0, 9.0, success=False)]
    found = groups.parts(Results(Path(), {"exp1": trials, "exp1a": [_result("exp1a", 0, 90.0)]}), "fast")
    (row,) = found.values()  # of the other there are no measures
    assert (row["at_limit"], row["turning"], row["evading"]) == (45.0, 2.0, 0.0)
    assert (row["path_m"], row["reference_m"], row["turns_per_m"]) == (30.0, 20.0, 1.5)
    assert row["felt_p99"] == pytest.approx(0.6)
    assert row["felt_max"] == pytest.approx(1.4)
    assert groups.parts_table({"fast": found}).row_count == 1


def test_a_trial_without_success_is_no_time_and_is_counted():
    lost = _result("exp1a", 0, 20.0, success=False, contacts=[{"caused_by_robot": True, "closing_speed": 0.3}])
    found = groups.values(_results(exp1a=[lost], generated=[_result("generated:1@0.5", 1, 7.0, success=False)]), "fast")
    assert math.isnan(found["exp1a"])
    assert found["generated"] == 0.0
    assert found["paper"] < 100.0
    assert found["contacts"] == 1.0


@pytest.mark.parametrize(
    ("success", "seconds", "expected"),
    [(True, 5.0, 0.5), (True, 10.0, 0.5), (True, 20.0, 0.25), (True, 90.0, 0.125), (False, 5.0, 0.0)],
)
def test_the_metric_is_that_of_the_challenge(success, seconds, expected):
    assert metric(success, seconds, 5.0) == pytest.approx(expected)


def test_the_optimal_time_is_what_the_file_says_or_that_of_the_shortest_way():
    scene = load_scene("barn:0")
    assert optimal_time(scene, "# BARN world_0, optimal time 6.7961 s (path_0.npy / 2 m/s)\n") == 6.7961
    assert 5.0 <= optimal_time(scene) < 5.05
    assert 5.0 < optimal_time(load_scene("barn:3")) < 5.6


def test_a_profile_takes_the_place_of_the_limits_of_the_file():
    (plain,), (controller,) = worlds(["barn:0"], ["fast"], None), worlds(["barn:0"], ["fast"], "controller")
    assert plain.scene.robot.base.linear_acceleration == 3.0
    assert controller.scene.robot.base == limits_of("controller")
    assert (controller.scene.robot.base.linear_acceleration, controller.scene.robot.base.reverse_speed) == (20.0, 2.0)
    assert controller.scene.robot.lidar == plain.scene.robot.lidar


def test_files_and_seeds_are_run_and_make_one_table(tmp_path, console):
    path = tmp_path / "easy.yaml"
    path.write_text("# optimal time 5.5 s\n" + barn(16), encoding="utf-8")
    assert bench_barn([str(path), "barn:0"], (), None, 1, tmp_path, console)
    report = json.loads((tmp_path / "barn.json").read_text(encoding="utf-8"))
    assert [row["world"] for row in report["rows"]] == ["easy", "barn:0"]
    assert report["rows"][0]["optimal_s"] == 5.5
    assert report["whole"]["fast"]["success_percent"] == 100.0
    assert report["whole"]["fast"]["metric"] == pytest.approx(0.5)
    assert "all 2" in console.export_text()


def test_what_is_no_world_is_refused(tmp_path, capsys):
    assert main(["barn", "--out", str(tmp_path)]) == 2
    assert main(["barn", "exp1", "--out", str(tmp_path)]) == 2
    assert "is no BARN world" in capsys.readouterr().out
    with pytest.raises(SceneError):
        worlds(["barn:x"], ["fast"], None)
    assert main(["barn", "--worlds", "0"]) == 2


def test_trials_with_faults_that_the_same_source_has_run_are_not_run_again(tmp_path, monkeypatch):
    ran = []

    def trial(scene, kind, seed):
        ran.append((scene, kind, seed))
        return {
            "scene": scene, "kind": kind, "seed": seed, "success": True, "placed": 6, "places": 6, "time_s": 80.0,
            "contacts": 0, "caused": [], "dropped": [], "named_s": [0.2], "false": {}, "reason": "",
        }  # fmt: skip

    monkeypatch.setattr(disturbances, "run_trial", trial)
    console = Console(file=io.StringIO())
    assert disturbances.bench_faults(tmp_path, 0.1, 1, console, kinds=("lidar_off",), scenes=("exp1",))
    assert disturbances.bench_faults(tmp_path, 0.2, 1, console, kinds=("lidar_off",), scenes=("exp1",))
    assert disturbances.bench_faults(tmp_path, 0.1, 1, console, kinds=("lidar_nan",), scenes=("exp1",))
    assert disturbances.bench_faults(tmp_path, 0.2, 1, console, kinds=("lidar_off",), scenes=("exp1",))
    assert ran == [("exp1", "lidar_off", 0), ("exp1", "lidar_off", 1), ("exp1", "lidar_nan", 0)]
    monkeypatch.setattr(disturbances, "made_with", lambda: {"source": "another"})
    disturbances.bench_faults(tmp_path, 0.1, 1, console, kinds=("lidar_off",), scenes=("exp1",))
    assert len(ran) == 4
