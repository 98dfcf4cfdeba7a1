"""The period and the solvers of the arm's program."""

import json

import msgspec
import pytest

from motm_twin.model.plant import ARM_STEPS
from motm_twin.model.scene_file import load_scene
from motm_twin.perf import growth, period
from motm_twin.perf.growth import sweeps
from motm_twin.perf.period import bench_solvers
from motm_twin.perf.report import wanted_table
from motm_twin.twin import Twin


def test_timing_every_arm_step_changes_nothing():
    scene = load_scene("exp1", "trial1")
    found = period.measured(scene, periods=4)
    twin = Twin(scene)
    for _ in range(4):
        twin.advance()
    assert found.state_hash == twin.state_hash()
    assert len(found.arm_steps) == 4 * ARM_STEPS
    assert found.table()["period"]["p50"] > 0.0


def test_every_number_of_the_table_is_judged_twice(console):
    values = {row.key: row.least for row in period.WANTED}
    console.print(wanted_table(period.WANTED, {"measured": values, "processor time": {}}))
    text = console.export_text()
    assert text.count("reached") == 2 * len(period.WANTED)
    assert "not reached" in text


def test_a_scene_that_never_ends_has_its_own_tasks_first():
    scene = load_scene("exp2", "random")
    assert period.round_for_ever(scene).tasks[: len(scene.tasks)] == scene.tasks


def test_furniture_is_added_beside_the_task_and_all_of_it_is_in_the_map():
    scene = growth.with_obstacles(growth.base_scene(), 100, 200.0)
    added = [solid for solid in scene.solids if solid.name.startswith("desk_")]
    assert len(added) == 100
    assert scene.bounds[2] - scene.bounds[0] == pytest.approx(200.0)
    assert not any(-3.0 < x < 8.0 and -4.5 < y < 5.0 for x, y in (solid.shape.centre for solid in added))
    with pytest.raises(ValueError, match="do not fit"):
        growth.with_obstacles(growth.base_scene(), 1000, 20.0)


def test_every_sweep_begins_small_and_grows():
    counts = [[point.count for point in sweep.points] for sweep in sweeps()]
    assert counts == list(map(sorted, counts))
    assert len(growth.with_targets(growth.base_scene(), 100).tasks) == 100
    assert len(growth.with_agents(growth.base_scene(), 64).agents) == 64


def test_the_quick_bench_of_growth_runs_and_prints_every_respect(tmp_path, monkeypatch, console):
    monkeypatch.setattr(growth, "OFFICE", 60.0)  # [m] a tenth of the floor
    monkeypatch.setattr(growth, "QUICK_PERIODS", 4)
    assert growth.bench_growth(tmp_path, console, quick=True)
    text = console.export_text()
    assert all(sweep.name in text for sweep in sweeps())


def test_a_large_floor_gives_the_same_plan_as_the_room_alone():
    """What is far away changes nothing: neither the map of the period nor the plan."""
    scene = growth.with_obstacles(growth.base_scene(), 0, 60.0)
    room = msgspec.structs.replace(scene, bounds=(-12.5, -12.75, 17.5, 13.25))
    large, small = Twin(scene), Twin(room)
    for _ in range(5):
        one, other = large.advance(), small.advance()
    assert one.map.distance.size < 0.5 * 1200**2
    assert one.placement.chosen == other.placement.chosen
    assert one.plan.acceleration == pytest.approx(other.plan.acceleration)


def test_a_quick_look_cuts_the_runs_off_and_says_so(tmp_path, console):
    assert bench_solvers(tmp_path, console, quick=True)
    rows = json.loads((tmp_path / "solvers.json").read_text(encoding="utf-8"))["rows"]
    assert all(row["cut_off"] and not row["success"] and row["task_s"] <= 1.0 for row in rows.values())
    said = console.export_text()
    assert said.count("cut off") == len(rows)
    assert "NO" not in said
