"""Every number of ours halved and doubled: which ones, the trials, and the table."""

import pytest

from motm_twin.methods.registry import find_method
from motm_twin.studies.run import Results
from motm_twin.studies.screening import Change, cells, changes_of, ours, rows_of, specs
from motm_twin.studies.spec import Job, TrialSpec, job_of, method_of, with_numbers


def names(given=()):
    return [".".join(found.path) for found in ours(given)]


def test_numbers_of_the_paper_and_of_the_robot_are_left_alone():
    found = names()
    assert "planning.placement.hysteresis" in found
    assert "planning.staa.grid_weight" in found, "our value of a number of STAA*"
    assert "planning.placement.next_weight" not in found
    assert "arm.tip_length" not in found


def test_some_numbers_can_be_asked_for_by_their_group():
    assert names(["planning.reach"]) == [name for name in names() if name.startswith("planning.reach.")]
    assert names(["arm.qp.elbow_limit"]) == ["arm.qp.elbow_limit"]
    with pytest.raises(ValueError, match=r"arm\.qq"):
        names(["arm.qq"])


def test_a_number_is_halved_and_doubled_and_a_switch_flipped():
    (hysteresis,) = ours(["planning.placement.hysteresis"])
    assert [change.value for change in changes_of(hysteresis)] == [0.15, 0.6]
    (headings,) = ours(["planning.placement.headings"])
    assert [change.value for change in changes_of(headings)] == [8, 32]
    (drive_on,) = ours(["planning.staa.drive_on"])
    assert [change.value for change in changes_of(drive_on)] == [False]


def test_every_change_is_possible():
    for found in ours():
        for change in changes_of(found):
            assert with_numbers(find_method("fast"), {change.name: change.value})


def test_all_changes_run_on_the_same_scenes_and_seeds():
    found = list(specs([Change("arm.k_transit", 4.0)], 2))
    assert len(found) == 8
    assert [(each.scene, each.seed) for each in found[:4]] == [(each.scene, each.seed) for each in found[4:]]
    assert {tuple(each.numbers.items()) for each in found} == {(), (("arm.k_transit", 4.0),)}


def test_a_trial_with_another_number_has_its_own_place_in_the_store():
    shipped, changed = (job_of(TrialSpec("exp1", "trial1", numbers=each)) for each in ({}, {"arm.k_transit": 4.0}))
    assert shipped.key("") != changed.key("")
    with pytest.raises(ValueError, match=r"arm\.k_transit"):
        job_of(TrialSpec("exp1", "trial1", numbers={"arm.k_transitt": 4.0}))


def test_a_change_wins_over_the_value_of_the_method():
    spec = TrialSpec("exp1", "trial1", method="fast", numbers={"planning.staa.steadiness": 0.04})
    job = Job(spec=spec, scene=job_of(spec).scene)
    assert "steadiness" in find_method("fast").parameters
    assert "steadiness" not in method_of(job).parameters
    assert with_numbers(find_method("fast"), spec.numbers).planning.staa.steadiness == 0.04


def result(seed, time, state_hash, numbers):
    return {
        "scene": "exp1", "seed": seed, "numbers": numbers, "success": True, "time_s": time, "state_hash": state_hash,
        "places_done": 6, "places_total": 6, "contacts": [],
    }  # fmt: skip


def test_a_row_tells_the_change_of_time_and_how_many_runs_stayed_the_same(tmp_path):
    other = {"arm.k_transit": 4.0}
    results = [
        result(0, 70.0, "a", {}),
        result(1, 80.0, "b", {}),
        result(0, 70.0, "a", other),
        result(1, 82.0, "c", other),
    ]
    shipped, row = rows_of(Results(tmp_path, {"screening": results}), [Change("arm.k_transit", 4.0)])
    assert shipped["same"] == 2
    assert (row["same"], row["slower_s"], row["placed"], row["contacts"]) == (1, 1.0, 12, 0)
    assert cells(row)[:4] == ("`arm.k_transit`", "4", "2", "1")
