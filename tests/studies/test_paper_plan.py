"""What the plans of `motm-twin paper` hold."""

from collections import Counter
from pathlib import Path

import pytest

from motm_twin.methods.registry import METHODS
from motm_twin.studies import catalogue
from motm_twin.studies.paper.plan import ABLATIONS, ALL, LITERAL, OVERLAP, SWEEPS, default, full, quick


def specs_of(plan):
    return {each.name: each.specs for each in plan.experiments}


def test_the_plans_hold_what_the_issue_asks_for():
    for plan, exp1, exp1a, exp2 in ((default(), 10, 10, 5), (full(), 60, 60, 50)):
        specs = specs_of(plan)
        for method in ALL:
            counts = [sum(each.method == method and each.variant != "one_temi" for each in specs[name])
                      for name in ("exp1", "exp1a", "exp2")]  # fmt: skip
            assert counts[0] >= exp1
            assert counts[1:] == [exp1a, exp2]
        for method in (LITERAL, OVERLAP):
            assert sum(each.method == method for each in specs["exp1"]) == exp1
        for method in ABLATIONS:
            assert sum(each.method == method for each in specs["ablations"]) == exp1
    assert {*ALL, LITERAL, OVERLAP, *ABLATIONS, *catalogue.COMPARED_METHODS} <= set(METHODS)


@pytest.mark.parametrize(("plan", "alone", "late"), [(default, 10, 5), (full, 50, 50)])
def test_every_level_of_every_error_and_grasp_fault_has_as_many_seeds_as_the_plan_says(plan, alone, late):
    for name, faults_of, scenes, seeds in (
        ("robustness", catalogue.ERRORS, 1, alone),
        ("grasp_delay", catalogue.GRASP_FAULTS, len(catalogue.TASKS), late),
    ):
        counts = Counter((each.method, *each.changes.items()) for each in specs_of(plan())[name])
        assert {key[1] for key in counts} == {(field, value) for field, levels in faults_of.items() for value in levels}
        assert set(counts.values()) == {scenes * seeds}
        assert {key[0] for key in counts} >= {"motm", "open_loop"}


def test_a_quick_plan_has_one_trial_of_each_kind_as_it_says():
    specs = specs_of(quick())
    assert Counter(each.method for each in specs["exp1"]) == Counter([*ALL, LITERAL, OVERLAP])
    assert [each.method for each in specs["exp1a"]] == ["motm", "fast", "irm", "sequential"]
    assert [each.method for each in specs["exp2"]] == ["motm", "fast"]
    assert [each.method for each in specs["ablations"]] == list(ABLATIONS)
    changes = {method: [each.changes for each in specs["robustness"] if each.method == method]
               for method in ("motm", "open_loop")}  # fmt: skip
    for these in changes.values():
        assert sorted(name for each in these for name, value in each.items() if value) == sorted(catalogue.ERRORS)
    late = Counter((each.scene, each.method, *each.changes.items()) for each in specs["grasp_delay"])
    assert len(late) == 3 * 3 * 2
    assert {change for *_, change in late} == {(catalogue.DELAY, 0.0), (catalogue.DELAY, 10.0)}
    for name, (parameter, values) in SWEEPS.items():
        assert {tuple(each.parameters.items()) for each in specs[name]} == {((parameter, values[-1]),)}
    note = " ".join(quick().notes)
    for said in ("on Experiment 1", "motm, fast, irm and sequential on 1a", "one level of every error", "10 s late"):
        assert said in note


def test_the_largest_ring_is_swept_among_boxes_too():
    for plan in (quick(), default(), full()):
        specs = specs_of(plan)
        assert {each.scene for each in specs["sweep_radius_max"]} == {"exp1", "exp1a"}
        shipped = {(each.scene, each.variant, each.seed) for each in (*specs["exp1"], *specs["exp1a"])
                   if each.method == "motm"}  # fmt: skip
        swept = [(each.scene, each.variant, each.seed) for name in SWEEPS for each in specs[name]]
        assert set(swept) <= shipped


def test_the_docs_count_the_trials_of_each_plan():
    def different(plan):
        return len({(each.scene, each.variant, each.seed, each.method, *each.parameters.items(),
                     *(item for item in each.changes.items() if item[1])) for each in plan.specs()})  # fmt: skip

    text = (Path(__file__).parents[2] / "docs" / "results.md").read_text(encoding="utf-8")
    assert f"| trials | {different(default())} | {different(full())} | {different(quick())} |" in text
