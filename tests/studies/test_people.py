"""`bench people`: cases, what the robot imposes, and the table."""

import io
import json

import numpy as np
import pytest
from rich.console import Console

from motm_twin.cli.bench import main
from motm_twin.model.scene_file import load_scene
from motm_twin.studies.people import SITUATIONS, Situation, alone, bench_people, cases, imposed, summaries


def test_every_situation_is_a_scene():
    for name, situation in SITUATIONS.items():
        (case,) = cases([name], ["fast"], 1)
        assert case.job.scene.agents, name
        assert case.job.spec.method == situation.spec(0, "fast").method


def test_agents_alone_do_not_depend_on_the_robot():
    seen, unseen = (alone(load_scene("circle:2", variant), 40) for variant in ("visible", "invisible"))
    assert all(np.array_equal(seen[name], unseen[name]) for name in seen)


def test_what_the_robot_imposes_is_the_difference_to_the_ways_without_it():
    straight = np.column_stack([0.05 * np.arange(101), np.zeros(101)])
    aside = straight.copy()
    aside[50:, 1] = 0.3
    found = imposed({"a": aside}, {"a": straight})
    assert found["imposed_path_m"] == pytest.approx(np.hypot(0.05, 0.3) - 0.05, abs=1e-3)
    assert found["imposed_velocity_change_mps"] == pytest.approx(2.0 * 0.3 / 0.05, abs=1e-6)
    assert found["imposed_deviation_m"] == pytest.approx(0.3 * 51 / 101, abs=1e-4)
    assert imposed({"a": straight}, {"a": straight})["imposed_path_m"] == 0.0
    assert imposed({}, {})["imposed_deviation_m"] == 0.0


def test_situations_are_run_and_make_one_table(tmp_path, monkeypatch):
    monkeypatch.setitem(SITUATIONS, "turns", Situation("people", "turns", {"time_limit": 5.0}))
    said = io.StringIO()
    bench_people(["turns"], ["fast"], 1, 1, tmp_path, Console(file=said, width=220))
    report = json.loads((tmp_path / "people.json").read_text(encoding="utf-8"))
    (row,) = report["rows"]
    assert row["situation"] == "turns"
    assert row["contacts_base_moved_towards"] <= row["contacts"]
    assert row["least_gap_m"] >= 0.0
    (whole,) = report["whole"]
    assert whole == summaries([row])[0]
    assert whole["success_interval_percent"][0] <= whole["success_percent"] <= whole["success_interval_percent"][1]
    assert "turns" in said.getvalue()


def test_names_that_are_none_are_refused(tmp_path, capsys):
    assert main(["people", "--situations", "circus", "--out", str(tmp_path)]) == 2
    assert "circle" in capsys.readouterr().out
    assert main(["people", "--methods", "nobody", "--out", str(tmp_path)]) == 2
    assert main(["people", "--trials", "0", "--out", str(tmp_path)]) == 2


def test_trials_begin_with_the_seed_that_is_named():
    assert [case.job.scene.seed for case in cases(["circle"], ["fast"], 2, 20)] == [20, 21]
    with pytest.raises(ValueError, match="from seed -1"):
        cases(["circle"], ["fast"], 2, -1)
