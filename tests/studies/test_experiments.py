"""Trials, their scenes and changes; experiments by name; studies of grasps; every number halved and doubled."""

from pathlib import Path

import msgspec
import pytest

from motm_twin.cli.bench import changes_of
from motm_twin.measures.references import FAILURE_RECOVERY, published
from motm_twin.methods.registry import METHODS, find_method
from motm_twin.model.scene import EARLIER_NOISE
from motm_twin.model.scene_file import load_scene
from motm_twin.studies import catalogue, sensitivity
from motm_twin.studies.catalogue import EXPERIMENTS, MISMATCHES, difficulty_of, experiment, methods_of, reasons
from motm_twin.studies.run import Results
from motm_twin.studies.sensitivity import (
    MISMATCH,
    ROBUSTNESS,
    STUDIES,
    Change,
    experiment_of,
    good,
    ours,
    row_of,
    rows_of,
)
from motm_twin.studies.spec import Job, TrialSpec, job_of, jobs_of, method_of, with_numbers
from motm_twin.studies.statistics import reasons_table

HERE = Path(__file__).parent


def key(*arguments, source="s", **fields):
    return job_of(TrialSpec(*arguments, **fields)).key(source)


def test_changes_reach_noise_limits_and_agents_and_nothing_else():
    changes = {"noise.lidar_range_sd": 0.05, "robot.base.forward_speed": 1.0, "agents.*.speed": 0.5}
    changes |= {"agents.temi_2.radius": 0.2, "time_limit": 60}
    scene, before = job_of(TrialSpec("exp2", "random", 3, changes=changes)).scene, load_scene("exp2", "random", 3)
    assert (scene.noise.lidar_range_sd, scene.robot.base.forward_speed, scene.time_limit) == (0.05, 1.0, 60.0)
    assert [agent.speed for agent in scene.agents] == [0.5] * 4
    assert [agent.radius for agent in scene.agents] == [0.25, 0.2, 0.25, 0.25]
    assert (scene.objects, scene.tasks, scene.start) == (before.objects, before.tasks, before.start)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"noise.lidar_sd": 0.1}, "'noise.lidar_sd'.*did you mean lidar_range_sd"),
        ({"noise.lidar_range_sd": -0.1}, "noise.lidar_range_sd.*>= 0"),
        ({"noise.lidar_range_sd": "much"}, "noise.lidar_range_sd.*float"),
        ({"noise.lidar_range_sd": float("nan")}, "noise.lidar_range_sd"),
        ({"agents.temi_9.speed": 1.0}, "temi_9.*did you mean"),
        ({"agents.temi_1": 1.0}, "name a field"),
        ({"agents.temi_1.speed": 50.0}, "speed.*<= 3"),
        ({"start": [4.2, 1.77, 0.0]}, "overlaps"),
        ({"": 1}, "there is no field"),
    ],
)
def test_a_change_that_cannot_be_is_refused_and_named(changes, said):
    with pytest.raises(ValueError, match=said):
        job_of(TrialSpec("exp2", "random", 0, changes=changes))


def test_the_key_tells_everything_apart_that_matters():
    one = key("exp1", "trial1")
    assert one == key("exp1")  # the default variant
    assert one == key("exp1", "trial1", 0, parameters={}, changes={})  # the file's seed
    otherwise = [{"method": "staa"}, {"changes": {"noise.lidar_range_sd": 0.02}}, {"source": "another"}]
    otherwise += [{"parameters": {"next_weight": 1}}, {"numbers": {"arm.k_transit": 4.0}}]
    others = [key("exp1", "trial2"), key("exp1", "trial1", 1), *(key("exp1", **each) for each in otherwise)]
    assert len({one, *others}) == 1 + len(others)
    assert others[5] == key("exp1", "trial1", parameters={"next_weight": 1.0})
    with pytest.raises(ValueError, match=r"arm\.k_transit"):
        key("exp1", numbers={"arm.k_transitt": 4.0})


def test_a_changed_file_of_the_users_gives_another_key(tmp_path):
    file = tmp_path / "mine.py"
    file.write_text((HERE / "broken_methods.py").read_text())
    before = key("exp1", method=f"{file}:RAISES")
    file.write_text(file.read_text() + "\n# changed\n")
    assert key("exp1", method=f"{file}:RAISES") != before


def test_all_methods_are_all_but_single_modifications():
    found = methods_of(["all"])
    assert "motm" in found
    assert not [name for name in found if name.startswith("no_")]
    assert set(found) <= set(METHODS)
    assert len(methods_of(["ablations"])) == 8
    assert methods_of(["staa", "motm", "staa"]) == ("staa", "motm")
    with pytest.raises(ValueError, match="did you mean motm"):
        methods_of(["motn"])


@pytest.mark.parametrize("name", EXPERIMENTS)
def test_every_experiment_has_trials_that_can_be_run(name):
    assert jobs_of(experiment(name, trials=1).specs)


def test_experiment_1_is_the_ten_published_trials_or_random_ones():
    assert [spec.variant for spec in experiment("exp1").specs] == [f"trial{k}" for k in range(1, 11)]
    fifty = experiment("exp1", ["motm", "staa"], 50).specs
    assert {(spec.variant, spec.seed, spec.method) for spec in fifty} == {
        ("random", seed, method) for seed in range(50) for method in ("motm", "staa")
    }
    with pytest.raises(ValueError, match="0 trials"):
        experiment("exp1", trials=0)
    with pytest.raises(ValueError, match="exp1a"):
        experiment("exp1b")


def test_changes_of_the_command_line_give_a_scene_of_another_noise():
    changes = changes_of(["noise={}", "detections=named", "agents.*.speed=0.6"])
    spec = experiment("exp2", ["fast"], 1).changed(changes).specs[0]
    scene = job_of(spec).scene
    assert (scene.noise, scene.detections) == (EARLIER_NOISE, "named")
    assert {agent.speed for agent in scene.agents} == {0.6}
    with pytest.raises(ValueError, match="FIELD=VALUE"):
        changes_of(["detections"])


@pytest.mark.parametrize("name", ["robustness", "grasp_delay"])
def test_every_level_of_every_error_is_one_that_a_scene_can_have_and_the_same_for_all_methods(name):
    specs = experiment(name, ["motm"], trials=1).specs
    changes = [item for spec in specs for item in spec.changes.items()]
    assert len(changes) == len(specs)
    assert all(job_of(spec).scene.seed == 0 for spec in specs)
    trials = {method: [] for method in catalogue.COMPARED_METHODS}
    for spec in experiment(name, trials=2).specs:
        trials[spec.method].append((spec.scene, spec.variant, spec.seed, spec.changes))
    assert all(theirs == trials["motm"] for theirs in trials.values())


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


def reasoned(scene, reason=""):
    return {"scene": scene, "variant": "", "seed": 3, "success": not reason, "reason": reason}


def test_generated_trials_have_a_scene_of_their_own_and_every_difficulty_and_are_counted_by_it():
    specs = experiment("generated", trials=42).specs
    assert len({spec.scene for spec in specs}) == 42
    assert specs[17].scene == "generated:17@0.85"
    assert sorted({difficulty_of(seed) for seed in range(42)}) == [step / 20 for step in range(21)]
    rows = [catalogue.row_of(scene) for scene in ("exp1", "generated:3@0.2", "generated:3@0.25", "generated:3@1")]
    assert rows == ["exp1", *(f"generated, difficulty {band}" for band in ("0 to 0.25", "0.25 to 0.5", "0.75 to 1"))]


def test_the_further_scenes_are_run_with_all_their_variants():
    specs = experiment("further_scenes", trials=2).specs
    assert len(specs) == 2 * 18
    assert {spec.seed for spec in specs} == {0, 1}


def test_reasons_are_counted_and_say_where_they_were_first(console):
    results = [reasoned("a"), reasoned("b", "stuck"), reasoned("c", "stuck [x]"), reasoned("d", "stuck")]
    assert reasons(results) == [("stuck", 2, "b seed 3"), ("stuck [x]", 1, "c seed 3")]
    console.print(reasons_table(results))
    assert "stuck [x]" in console.export_text()
    assert reasons_table([reasoned("a")]) is None


def grasped(placed=6, grasps=6, caused=0, time=80.0, **more):
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
    rows = rows_of(ROBUSTNESS, [(spec, grasped(changes=spec.changes)) for spec in specs])
    assert [(row["trials"], row["places"]) for row in rows] == [(20, 120)] * len(ROBUSTNESS.settings)


def test_a_row_counts_grasps_and_misses_its_share_when_two_of_120_are_lost():
    one = sensitivity.Setting("slow", {}, least=0.99)
    felt = {
        "grasps": [{"shift": 0.001}, {"shift": 0.004}], "phantoms": [3, 1], "torque_peaks": [7.0, 21.0],
        "wrist_peaks": [12.0, 1.0],
    }  # fmt: skip
    lost = row_of(one, ("fast",), [grasped(), grasped(grasps=8, physics=felt), *[grasped()] * 17, grasped(placed=4)])
    assert (lost["placed"], lost["grasps"], lost["held"].value) == (118, 122, pytest.approx(118 / 122))
    assert lost["time"].n == 19  # what was not completed has no time
    assert not good(lost)
    assert good(row_of(one, ("fast",), [grasped()] * 19 + [grasped(placed=5)]))
    assert not good(row_of(one, ("fast",), [grasped(caused=1)]))
    assert len(sensitivity.cells(lost)) == len(sensitivity.HEAD)
    assert {"2.5, 4.0", "3, 1", "21.0"} < set(sensitivity.cells(lost))


def test_of_a_mismatch_one_object_in_sixty_may_be_left_and_shaken_joints_are_not_judged():
    specs = experiment_of(MISMATCH).specs
    assert [(spec.variant, spec.seed) for spec in specs[:: len(MISMATCHES)]] == [("random", k) for k in range(10)]
    results = [grasped(placed=5 if spec.seed == 0 else 6, caused=1, changes=spec.changes) for spec in specs]
    rows = {row["setting"]: row for row in rows_of(MISMATCH, list(zip(specs, results, strict=True)))}
    assert (rows["delay 100 ms"]["placed"], rows["delay 100 ms"]["places"], rows["none"]["time"].n) == (59, 60, 9)
    assert all(map(good, rows.values()))
    lost = [{**row, "placed": 58} for row in rows.values()]
    assert [row["setting"] for row in lost if good(row)] == [catalogue.SHAKEN]


def numbers(given=()):
    return [".".join(found.path) for found in ours(given)]


def test_numbers_of_the_paper_and_of_the_robot_are_left_alone_and_some_can_be_asked_for_by_their_group():
    found = numbers()
    assert "planning.placement.hysteresis" in found
    assert "planning.staa.grid_weight" in found, "our value of a number of STAA*"
    assert "planning.placement.next_weight" not in found
    assert "arm.tip_length" not in found
    assert numbers(["planning.reach"]) == [name for name in found if name.startswith("planning.reach.")]
    assert numbers(["arm.qp.elbow_limit"]) == ["arm.qp.elbow_limit"]
    with pytest.raises(ValueError, match=r"arm\.qq"):
        numbers(["arm.qq"])


def test_a_number_is_halved_and_doubled_and_a_switch_flipped_as_far_as_it_is_possible():
    names = ("placement.hysteresis", "placement.headings", "staa.drive_on")
    chosen = [ours([f"planning.{name}"]) for name in names]
    others = [[change.value for change in sensitivity.changes_of(found)] for (found,) in chosen]
    assert others == [[0.15, 0.6], [8, 32], [False]]
    for found in ours():
        for change in sensitivity.changes_of(found):
            assert with_numbers(find_method("fast"), {change.name: change.value})


def test_all_changes_run_on_the_same_scenes_and_seeds():
    found = list(sensitivity.screening_specs([Change("arm.k_transit", 4.0)], 2))
    assert len(found) == 8
    assert [(each.scene, each.seed) for each in found[:4]] == [(each.scene, each.seed) for each in found[4:]]
    assert {tuple(each.numbers.items()) for each in found} == {(), (("arm.k_transit", 4.0),)}


def test_a_change_wins_over_the_value_of_the_method():
    spec = TrialSpec("exp1", "trial1", method="fast", numbers={"planning.staa.steadiness": 0.04})
    job = Job(spec=spec, scene=job_of(spec).scene)
    assert "steadiness" in find_method("fast").parameters
    assert "steadiness" not in method_of(job).parameters
    assert with_numbers(find_method("fast"), spec.numbers).planning.staa.steadiness == 0.04


def screened(seed, time, state_hash, numbers):
    return {
        "scene": "exp1", "seed": seed, "numbers": numbers, "success": True, "time_s": time, "state_hash": state_hash,
        "places_done": 6, "places_total": 6, "contacts": [],
    }  # fmt: skip


def test_a_row_tells_the_change_of_time_and_how_many_runs_stayed_the_same(tmp_path):
    other = {"arm.k_transit": 4.0}
    results = [screened(0, 70.0, "a", {}), screened(1, 80.0, "b", {})]
    results += [screened(0, 70.0, "a", other), screened(1, 82.0, "c", other)]
    shipped, row = sensitivity.number_rows(Results(tmp_path, {"screening": results}), [Change("arm.k_transit", 4.0)])
    assert shipped["same"] == 2
    assert (row["same"], row["slower_s"], row["placed"], row["contacts"]) == (1, 1.0, 12, 0)
    assert sensitivity.number_cells(row)[:4] == ("`arm.k_transit`", "4", "2", "1")
