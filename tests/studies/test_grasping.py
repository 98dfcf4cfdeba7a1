"""Studies of grasps on the move: their settings, and how rows are counted."""

import msgspec
import pytest

from motm_twin.studies.catalogue import MISMATCHES, SHAKEN
from motm_twin.studies.grasping import (
    HEAD,
    MISMATCH,
    ROBUSTNESS,
    STUDIES,
    Setting,
    cells,
    experiment_of,
    good,
    row_of,
    rows_of,
)
from motm_twin.studies.spec import job_of


def result(placed=6, grasps=6, caused=0, time=80.0, **more):
    return {
        "places_done": placed, "places_total": 6, "picks_done": placed, "picks_total": 6, "picks_attempted": grasps,
        "mean_closing_base_speed_mps": 0.25, "contacts": [{}] * caused, "contacts_caused_by_robot": caused,
        "time_s": time, **more,
    }  # fmt: skip


@pytest.mark.parametrize("study", STUDIES.values(), ids=STUDIES)
def test_every_setting_is_one_that_a_scene_can_have(study):
    pytest.importorskip("mujoco")
    specs = experiment_of(study, 1).specs
    assert len(specs) == len(study.settings) * len(study.methods)
    scenes = {msgspec.json.encode(job_of(spec).scene) for spec in specs}
    assert len(scenes) == len(study.settings)


def test_ten_trials_of_two_methods_are_120_picks_of_each_error():
    specs = experiment_of(ROBUSTNESS).specs
    together = [spec for spec in specs if len(spec.changes) == 7]
    assert len(together) == 20
    rows = rows_of(ROBUSTNESS, [(spec, result(changes=spec.changes)) for spec in specs])
    assert [(row["trials"], row["places"]) for row in rows] == [(20, 120)] * len(ROBUSTNESS.settings)


def test_a_row_counts_grasps_and_misses_its_share_when_two_of_120_are_lost():
    one = Setting("slow", {}, least=0.99)
    felt = {
        "grasps": [{"shift": 0.001}, {"shift": 0.004}], "phantoms": [3, 1], "torque_peaks": [7.0, 21.0],
        "wrist_peaks": [12.0, 1.0],
    }  # fmt: skip
    lost = row_of(one, ("fast",), [result(), result(grasps=8, physics=felt), *[result()] * 17, result(placed=4)])
    assert (lost["placed"], lost["grasps"], lost["held"].value) == (118, 122, pytest.approx(118 / 122))
    assert lost["time"].n == 19  # what was not completed has no time
    assert not good(lost)
    assert good(row_of(one, ("fast",), [result()] * 19 + [result(placed=5)]))
    assert not good(row_of(one, ("fast",), [result(caused=1)]))
    assert len(cells(lost)) == len(HEAD)
    assert {"2.5, 4.0", "3, 1", "21.0"} < set(cells(lost))


def test_of_a_mismatch_one_object_in_sixty_may_be_left_and_shaken_joints_are_not_judged():
    specs = experiment_of(MISMATCH).specs
    assert [(spec.variant, spec.seed) for spec in specs[:: len(MISMATCHES)]] == [("random", k) for k in range(10)]
    results = [result(placed=5 if spec.seed == 0 else 6, caused=1, changes=spec.changes) for spec in specs]
    rows = {row["setting"]: row for row in rows_of(MISMATCH, list(zip(specs, results, strict=True)))}
    assert (rows["delay 100 ms"]["placed"], rows["delay 100 ms"]["places"], rows["none"]["time"].n) == (59, 60, 9)
    assert all(map(good, rows.values()))
    lost = [{**row, "placed": 58} for row in rows.values()]
    assert [row["setting"] for row in lost if good(row)] == [SHAKEN]
