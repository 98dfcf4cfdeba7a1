"""Experiments by name: errors and mismatches, further scenes, generated scenes."""

import io

import msgspec
from rich.console import Console

from motm_twin.measures.published import FAILURE_RECOVERY, published
from motm_twin.studies import catalogue
from motm_twin.studies.catalogue import difficulty_of, experiment, reasons, row_of
from motm_twin.studies.spec import job_of
from motm_twin.studies.summary import reasons_table


def test_every_level_of_every_error_is_one_that_a_scene_can_have():
    for name in ("robustness", "grasp_delay"):
        specs = experiment(name, ["motm"], trials=1).specs
        changes = [item for spec in specs for item in spec.changes.items()]
        assert len(changes) == len(specs)
        assert all(job_of(spec).scene.seed == 0 for spec in specs)


def test_methods_are_compared_on_the_same_seeds_and_levels():
    for name in ("robustness", "grasp_delay"):
        trials = {method: [] for method in catalogue.COMPARED_METHODS}
        for spec in experiment(name, trials=2).specs:
            trials[spec.method].append((spec.scene, spec.variant, spec.seed, spec.changes))
        ours = trials.pop("motm")
        assert all(theirs == ours for theirs in trials.values())


def test_each_sweep_of_errors_begins_with_none():
    assert all(levels[0] == 0.0 for levels in (*catalogue.ERRORS.values(), *catalogue.GRASP_FAULTS.values()))
    quiet = job_of(experiment("robustness", ["motm"], trials=1).specs[0]).scene.noise
    kinds = ("_sd", "_latency", "_probability")
    assert not any(value for name, value in msgspec.structs.asdict(quiet).items() if name.endswith(kinds))


def test_the_tasks_of_failure_recovery_have_their_published_times():
    assert set(FAILURE_RECOVERY) == set(catalogue.TASKS)
    assert [row.seconds for row in published("line", "line")] == [9.4, 11.6, 18.8, 21.9]


def test_every_mismatch_is_one_that_a_scene_can_have_and_stands_in_a_row_of_its_own():
    specs = experiment("mismatch", trials=2).specs
    assert len(specs) == 2 * len(catalogue.MISMATCHES)
    assert {spec.seed for spec in specs} == {0, 1} and {spec.method for spec in specs} == {"fast"}
    scenes = [job_of(spec).scene for spec in specs[: len(catalogue.MISMATCHES)]]
    assert len({msgspec.json.encode(scene) for scene in scenes}) == len(scenes)


def result(scene, reason=""):
    return {"scene": scene, "variant": "", "seed": 3, "success": not reason, "reason": reason}


def test_generated_trials_have_a_scene_of_their_own_and_every_difficulty():
    specs = experiment("generated", trials=42).specs
    assert len({spec.scene for spec in specs}) == 42
    assert specs[17].scene == "generated:17@0.85"
    assert sorted({difficulty_of(seed) for seed in range(42)}) == [step / 20 for step in range(21)]


def test_the_further_scenes_are_run_with_all_their_variants():
    specs = experiment("further_scenes", trials=2).specs
    assert len(specs) == 2 * 18
    assert {spec.seed for spec in specs} == {0, 1}


def test_generated_scenes_are_counted_by_difficulty():
    assert row_of("exp1") == "exp1"
    assert row_of("generated:3@0.2") == "generated, difficulty 0 to 0.25"
    assert row_of("generated:3@0.25") == "generated, difficulty 0.25 to 0.5"
    assert row_of("generated:3@1") == "generated, difficulty 0.75 to 1"


def test_reasons_are_counted_and_say_where_they_were_first():
    results = [result("a"), result("b", "stuck"), result("c", "stuck [x]"), result("d", "stuck")]
    assert reasons(results) == [("stuck", 2, "b seed 3"), ("stuck [x]", 1, "c seed 3")]
    table = reasons_table(results)
    console = Console(width=100, record=True, file=io.StringIO())
    console.print(table)
    assert "stuck [x]" in console.export_text()
    assert reasons_table([result("a")]) is None
