"""Scenes beside the paper's: which trials, how they are counted together, and why some went wrong."""

import io

from rich.console import Console

from motm_twin.studies.catalogue import difficulty_of, experiment, reasons, row_of
from motm_twin.studies.summary import reasons_table


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
