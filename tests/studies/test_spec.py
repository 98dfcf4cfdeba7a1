"""A trial, its scene and its changes."""

from pathlib import Path

import pytest

from motm_twin.cli.bench import changes_of
from motm_twin.methods.registry import METHODS
from motm_twin.model.scene import EARLIER_NOISE
from motm_twin.model.scene_file import load_scene
from motm_twin.studies.catalogue import EXPERIMENTS, experiment, methods_of
from motm_twin.studies.spec import TrialSpec, job_of, jobs_of

HERE = Path(__file__).parent


def key(*arguments, source="s", **fields):
    return job_of(TrialSpec(*arguments, **fields)).key(source)


def test_changes_reach_noise_limits_and_agents_and_nothing_else():
    changes = {
        "noise.lidar_range_sd": 0.05,
        "robot.base.forward_speed": 1.0,
        "agents.*.speed": 0.5,
        "agents.temi_2.radius": 0.2,
        "time_limit": 60,
    }
    scene, before = job_of(TrialSpec("exp2", "random", 3, changes=changes)).scene, load_scene("exp2", "random", 3)
    assert scene.noise.lidar_range_sd == 0.05
    assert scene.robot.base.forward_speed == 1.0
    assert [agent.speed for agent in scene.agents] == [0.5] * 4
    assert [agent.radius for agent in scene.agents] == [0.25, 0.2, 0.25, 0.25]
    assert scene.time_limit == 60.0
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
    others = [
        key("exp1", "trial2"),
        key("exp1", "trial1", 1),
        key("exp1", "trial1", method="staa"),
        key("exp1", "trial1", parameters={"next_weight": 1}),
        key("exp1", "trial1", changes={"noise.lidar_range_sd": 0.02}),
        key("exp1", "trial1", source="another"),
    ]
    assert len({one, *others}) == 1 + len(others)
    assert others[3] == key("exp1", "trial1", parameters={"next_weight": 1.0})


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
