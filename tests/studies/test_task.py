"""The bench of the task: what it runs, and how it reads the results."""

import math
from pathlib import Path

import pytest

from motm_twin.measures.measures import PARTS
from motm_twin.studies import task
from motm_twin.studies.run import Results


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
    few = task.experiments(0.04)
    assert set(few) == set(_results().trials)
    for each in few.values():
        fast, motm = ([spec for spec in each.specs if spec.method == method] for method in task.METHODS)
        assert len(fast) == len(motm) > 0
    assert len(few["exp1_random"].specs) == 2 * 2
    assert len(task.experiments(1.0)["generated"].specs) == 2 * task.GENERATED
    assert all(spec.changes["robot.base.forward_speed"] == 1.0 for spec in few["quick_robot"].specs)


def test_every_number_is_read_from_the_trials():
    found = task.values(_results(), "fast")
    assert set(found) == {row.key for row in task.WANTED}
    assert found["exp1"] == 80.0
    assert found["random"] == 84.0
    assert found["four"] == pytest.approx(20.0)
    assert found["one"] == pytest.approx(2.5)
    assert found["quick"] == pytest.approx(1.6)
    assert found["generated"] == found["further"] == found["paper"] == 100.0
    assert found["contacts"] == 0.0


def test_where_the_time_goes_is_a_mean_of_the_completed_trials():
    def measured(at_limit, felt, *, success=True):
        parts = dict.fromkeys(PARTS, 0.0) | {"at_limit": at_limit, "turning": 2.0}
        measures = {
            "parts_s": parts, "legs": [{"reference_m": 20.0}, {"reference_m": None}],
            "arm_base_acceleration_mps2": {"p99": felt, "max": 2.0 * felt}, "yaw_sign_changes_per_m": 1.5,
        }  # fmt: skip
        return _result("exp1", 0, 80.0, success=success) | {"measures": measures, "path_length_m": 30.0}

    trials = [measured(40.0, 0.5), measured(50.0, 0.7), measured(1.0, 9.0, success=False)]
    found = task.parts(Results(Path(), {"exp1": trials, "exp1a": [_result("exp1a", 0, 90.0)]}), "fast")
    (row,) = found.values()  # of the other there are no measures
    assert (row["at_limit"], row["turning"], row["evading"]) == (45.0, 2.0, 0.0)
    assert (row["path_m"], row["reference_m"], row["turns_per_m"]) == (30.0, 20.0, 1.5)
    assert row["felt_p99"] == pytest.approx(0.6)
    assert row["felt_max"] == pytest.approx(1.4)
    assert task.parts_table({"fast": found}).row_count == 1


def test_a_trial_without_success_is_no_time_and_is_counted():
    lost = _result("exp1a", 0, 20.0, success=False, contacts=[{"caused_by_robot": True, "closing_speed": 0.3}])
    found = task.values(_results(exp1a=[lost], generated=[_result("generated:1@0.5", 1, 7.0, success=False)]), "fast")
    assert math.isnan(found["exp1a"])
    assert found["generated"] == 0.0
    assert found["paper"] < 100.0
    assert found["contacts"] == 1.0


def test_trials_of_the_other_method_do_not_count():
    slow = _result("exp1", 0, 500.0, method="motm", success=False)
    assert task.values(_results(exp1=[_result("exp1", 0, 80.0), slow]), "fast")["exp1"] == 80.0
