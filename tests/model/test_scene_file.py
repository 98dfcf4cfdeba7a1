"""Shipped scenes, the parts of the format, and what a variant and a seed change."""

import itertools
import json
import math
from pathlib import Path

import jsonschema
import msgspec
import pytest
import yaml
from shapely.geometry import LineString, Polygon

from motm_twin.cli import scene as cli_scene
from motm_twin.model.assets import scenes_dir
from motm_twin.model.known import known_world
from motm_twin.model.names import SceneError
from motm_twin.model.profile import RobotProfile
from motm_twin.model.scene import EARLIER_NOISE, USUAL_NOISE, Bump, DriveTo, Mismatch, Pick, Place, Prism, Scene
from motm_twin.model.scene_file import check_all, load_document, load_scene
from motm_twin.model.scene_shapes import outline
from motm_twin.model.state import state_hash

DOCS = Path(__file__).parents[2] / "docs"
# The published trials of the real robot, in order.
TRIALS = {
    1: "F1 F5 B3 F2 L F3",
    2: "F5 B2 F1 R B4 B3",
    3: "B5 F4 L B1 F5 B2",
    4: "B2 R F5 B3 B4 F3",
    5: "F4 R F3 F5 F2 B3",
    6: "L B1 F5 R F1 B4",
    7: "B4 B1 R B5 F1 F3",
    8: "F5 L F1 R F2 F3",
    9: "F5 B3 F3 B2 F1 F4",
    10: "B3 B1 F4 B5 F3 B2",
}
FORMAT = "format: motm-scene/1\n"


def write(tmp_path, text: str) -> str:
    path = tmp_path / "mine.yaml"
    path.write_text(FORMAT + text, encoding="utf-8")
    return str(path)


def test_every_shipped_scene_fits_the_published_schema():
    schema = jsonschema.Draft202012Validator(json.loads((DOCS / "scene.schema.json").read_text(encoding="utf-8")))
    for path in scenes_dir().glob("*.yaml"):
        schema.validate(yaml.safe_load(path.read_text(encoding="utf-8")))


def test_the_published_schema_is_the_one_of_the_types():
    assert (DOCS / "scene.schema.json").read_text(encoding="utf-8") == cli_scene.schema_text()


def test_the_schema_refuses_an_unknown_key():
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate({"format": "motm-scene/1", "wheels": 4}, json.loads(cli_scene.schema_text()))


@pytest.mark.parametrize("name", ["exp1", "exp1a", "exp2", "small_base"])
@pytest.mark.parametrize("trial", TRIALS)
def test_the_published_trials_are_picked_in_order_and_delivered_in_turn(name, trial):
    scene = load_scene(name, f"trial{trial}")
    assert [task.object for task in scene.tasks if isinstance(task, Pick)] == [
        f"cube_{s}" for s in TRIALS[trial].split()
    ]
    assert [task.bin for task in scene.tasks if isinstance(task, Place)] == ["drop1", "drop2"] * 3


def test_experiment_1_has_the_measures_of_the_drawing():
    scene = load_scene("exp1")
    assert scene.variant == "trial1"
    solids = {solid.name: solid for solid in scene.solids}
    assert outline(solids["table_top"].shape).bounds == pytest.approx((3.0, 1.37, 5.4, 2.17))
    assert outline(solids["drop2_desk"].shape).bounds == pytest.approx((-0.48, 1.63, 0.29, 2.81))
    assert outline(solids["cabinet"].shape).bounds == pytest.approx((-0.6, -1.7, 1.27, -1.405))
    assert {name for name, solid in solids.items() if solid.group == "table"} == {
        "table_top", "table_post_1", "table_post_2", "table_foot_1", "table_foot_2",
    }  # fmt: skip
    assert all(solid.mapped for solid in scene.solids)
    assert scene.objects[0].position == pytest.approx((3.1, 1.47, 0.78 + 0.02))
    assert [(item.centre, item.rim_z, item.floor_z) for item in scene.bins] == [
        ((4.25, -1.29), 0.72, 0.62),
        ((0.10, 2.13), 0.72, 0.62),
    ]
    assert scene.start == (0.0, 0.0, 0.0)
    assert scene.robot == RobotProfile()
    assert msgspec.to_builtins(scene.noise) == pytest.approx(msgspec.to_builtins(USUAL_NOISE))
    assert scene.detections == "anonymous"
    assert scene.bounds == pytest.approx((-0.6 - 1.5, -1.805 - 1.5, 5.4 + 1.5, 2.81 + 1.5))


def test_experiment_1a_adds_two_boxes_that_the_map_does_not_know():
    scene = load_scene("exp1a")
    boxes = [solid for solid in scene.solids if not solid.mapped]
    assert [(solid.shape.centre, solid.shape.size, solid.z_max) for solid in boxes] == [
        ((2.7, 1.7), (0.5, 0.5), 0.6),
        ((3.9, 0.96), (0.5, 0.5), 0.6),
    ]
    assert all(solid in scene.solids for solid in load_scene("exp1").solids)
    assert not {solid.name for solid in boxes} & {solid.name for solid in known_world(scene).solids}


def test_experiment_2_has_four_yielding_temis_half_a_metre_to_0_9_m_from_the_table_both_ways_round():
    scene = load_scene("exp2")
    assert scene.variant == "random"
    table = Polygon([(3.0, 1.37), (5.4, 1.37), (5.4, 2.17), (3.0, 2.17)])
    ways = []
    for agent in scene.agents:
        assert (agent.behaviour, agent.speed, agent.radius, agent.height) == ("yield", 0.4, 0.25, 1.0)
        lane = LineString([agent.start[:2], *agent.waypoints])
        assert lane.is_ring
        away = [lane.interpolate(i / 500, normalized=True).distance(table) for i in range(500)]
        assert 0.5 <= min(away) <= max(away) <= 0.9
        ways.append(Polygon(lane.coords).exterior.is_ccw)
    assert sorted(ways) == [False, False, True, True]


def test_lanes_turn_smoothly_and_agents_start_along_them():
    for agent in load_scene("exp2").agents:
        points = [agent.start[:2], *agent.waypoints]
        headings = [math.atan2(b[1] - a[1], b[0] - a[0]) for a, b in itertools.pairwise(points)]
        turns = [math.remainder(b - a, math.tau) for a, b in itertools.pairwise(headings)]
        assert max(map(abs, turns)) < math.radians(20)
        assert agent.start[2] == pytest.approx(headings[0])


def test_variant_one_temi_keeps_one_agent_and_the_published_trial():
    scene = load_scene("exp2", "one_temi")
    assert [agent.name for agent in scene.agents] == ["temi_1"]
    assert scene.tasks == load_scene("exp1", "trial1").tasks


@pytest.mark.parametrize("name", ["exp1", "exp1a", "exp2"])
def test_the_random_variant_depends_on_the_seed_alone(name):
    drawn, again = ([load_scene(name, "random", seed) for seed in range(5)] for _ in range(2))
    assert [state_hash(scene) for scene in drawn] == [state_hash(scene) for scene in again]
    assert all(len({item.name for item in scene.objects}) == 6 for scene in drawn)
    assert len({tuple(item.name for item in scene.objects) for scene in drawn}) == 5
    assert [scene.tasks for scene in drawn] == [load_scene("exp1", "random", seed).tasks for seed in range(5)]


def test_the_seed_does_not_change_a_published_trial():
    assert load_scene("exp1", "trial4", 7).objects == load_scene("exp1", "trial4").objects
    assert load_scene("exp1", "trial4", 7).seed == 7


def test_the_small_base_is_another_robot_with_the_same_arm():
    robot = load_scene("small_base").robot
    assert (robot.footprint.length, robot.footprint.width, robot.base.forward_speed) == (0.51, 0.43, 2.0)
    assert robot.gripper == RobotProfile().gripper
    assert robot.base.yaw_rate == RobotProfile().base.yaw_rate


def test_the_playground_has_agents_goals_odd_yaws_and_something_unknown():
    scene = load_scene("playground")
    assert len(scene.agents) == 2
    assert [task for task in scene.tasks if isinstance(task, DriveTo)]
    assert any(not solid.mapped for solid in scene.solids)
    assert len({item.yaw for item in scene.objects}) == len(scene.objects)
    assert load_scene("playground", "calm").agents == ()


def test_degrees_become_radians_and_clockwise_outlines_are_turned_round(tmp_path):
    scene = load_scene(
        write(
            tmp_path,
            "start: {x: 1, y: 2, heading_deg: 90}\n"
            "robot:\n"
            "  base: {yaw_rate_dps: 90, yaw_acceleration_dps2: 180}\n"
            "  lidar: {field_of_view_deg: 180, rate_hz: 10}\n"
            "furniture: {wall: {shape: polygon, corners: [[5, 0], [5, 1], [6, 1], [6, 0]], z: [0, 1]}}\n"
            "noise: {localisation_heading_sd_deg: 1, lidar_range_sd: 0}\n"
            "tasks: [{drive_to: {x: 1, y: 0, heading_deg: -90}}]\n",
        )
    )
    assert scene.start == pytest.approx((1.0, 2.0, math.pi / 2))
    assert (scene.robot.base.yaw_rate, scene.robot.base.yaw_acceleration) == pytest.approx((math.pi / 2, math.pi))
    assert (scene.robot.lidar.field_of_view, scene.robot.lidar.rate) == pytest.approx((math.pi, 10.0))
    assert scene.noise.localisation_heading_sd == pytest.approx(math.pi / 180)
    assert (scene.noise.lidar_range_sd, scene.noise.slot_error_until_seen) == (0.0, 0.03)
    assert scene.tasks == (DriveTo(point=(1.0, 0.0), heading=-math.pi / 2),)
    assert scene.solids[0].shape == Prism(corners=((6.0, 0.0), (6.0, 1.0), (5.0, 1.0), (5.0, 0.0)))


def test_numbers_follow_yaml_1_2_so_that_an_exponent_is_a_number(tmp_path):
    scene = load_scene(write(tmp_path, "noise: {lidar_range_sd: 1e-3}\ntasks: [{drive_to: {x: 1e0, y: +1}}]\n"))
    assert scene.noise.lidar_range_sd == 0.001


def test_a_variant_lays_its_sections_over_those_of_the_scene(tmp_path):
    path = write(
        tmp_path,
        "extends: exp2\n"
        "variants:\n"
        "  quiet: {agents: {temi_1: null, temi_2: null, temi_3: null}, noise: {lidar_range_sd: 0}, seed: 5}\n"
        "  errand: {tasks: [{drive_to: {x: 1, y: 0}}], start: {x: -1, y: 0}, time_limit: 20}\n",
    )
    quiet, errand = load_scene(path, "quiet"), load_scene(path, "errand")
    assert [agent.name for agent in quiet.agents] == ["temi_4"]
    assert (quiet.noise.lidar_range_sd, quiet.seed) == (0.0, 5)
    assert (len(errand.tasks), errand.start, errand.time_limit) == (1, (-1.0, 0.0, 0.0), 20.0)
    assert errand.objects == ()
    assert len(load_document(path).variants()) == 15


def test_a_scene_extends_a_file_in_its_own_folder(tmp_path):
    (tmp_path / "room.yaml").write_text(FORMAT + "extends: exp1\ntime_limit: 77\n", encoding="utf-8")
    for name in ("room", "room.yaml"):
        assert load_scene(write(tmp_path, f"extends: {name}\n")).time_limit == 77.0


def test_bumps_are_read_in_degrees_and_may_not_be_steps(tmp_path):
    path = tmp_path / "floor.yaml"
    text = "format: motm-scene/1\nextends: exp1\n"
    text += "bumps: {cable: {at: [1.0, 0.5], length: 2.0, yaw_deg: 90, height: HIGH}}\n"
    path.write_text(text.replace("HIGH", "0.01"))
    assert load_scene(str(path)).bumps == (Bump(name="cable", centre=(1.0, 0.5), length=2.0, yaw=math.pi / 2),)
    path.write_text(text.replace("HIGH", "0.05"))
    with pytest.raises(SceneError, match="height"):
        load_scene(str(path))


def test_a_standing_agent_needs_only_a_start(tmp_path):
    text = "agents: {post: {start: {x: 2, y: 2, heading_deg: 180}}}\ntasks: [{drive_to: {x: 1, y: 0}}]\n"
    agent = load_scene(write(tmp_path, text)).agents[0]
    assert (agent.start, agent.waypoints) == ((2.0, 2.0, math.pi), ())


def test_the_example_of_the_documentation_is_a_good_scene(tmp_path):
    text = (DOCS / "scenes.md").read_text(encoding="utf-8")
    example = text.split("<!-- example -->\n```yaml\n")[1].split("```")[0]
    path = tmp_path / "example.yaml"
    path.write_text(example, encoding="utf-8")
    assert len(check_all(str(path))) >= 2
    jsonschema.validate(yaml.safe_load(example), json.loads(cli_scene.schema_text()))


def test_every_section_and_key_of_the_format_is_documented():
    text = (DOCS / "scenes.md").read_text(encoding="utf-8")
    schema = json.loads(cli_scene.schema_text())
    keys = {key for part in schema["$defs"].values() for key in part.get("properties", {})}
    assert [key for key in sorted(keys) if f"`{key}`" not in text] == []


def test_the_command_line_lists_checks_and_prints_the_schema(capsys):
    assert cli_scene.list_scenes() == 0
    assert "trial1 (default)" in capsys.readouterr().out
    assert cli_scene.check_scenes(["line"]) == 0
    assert "line: good" in capsys.readouterr().out
    assert cli_scene.print_schema() == 0
    assert json.loads(capsys.readouterr().out)["title"] == "motm-twin scene"


def test_the_command_line_ends_with_2_and_one_line_for_a_bad_scene(capsys):
    assert cli_scene.check_scenes(["exp9"]) == 2
    assert capsys.readouterr().err.count("\n") == 1


def test_scene_error_is_a_value_error_that_carries_its_place():
    with pytest.raises(SceneError) as caught:
        load_scene("exp1", "none")
    assert isinstance(caught.value, ValueError)
    assert caught.value.file == "scenes/exp1.yaml"


def test_a_scene_that_says_nothing_has_the_usual_errors_and_one_that_says_earlier_those_of_old(tmp_path):
    tasks = "tasks: [{drive_to: {x: 1, y: 0}}]\n"
    usual = load_scene(write(tmp_path, tasks))
    assert (usual.noise, usual.detections, usual.mismatch) == (USUAL_NOISE, "anonymous", Mismatch())
    given = load_scene(write(tmp_path, f"{tasks}noise: {{camera_latency: 0.1}}\ndetections: named\n"))
    assert given.noise == msgspec.structs.replace(USUAL_NOISE, camera_latency=0.1)
    assert given.detections == "named"
    text = (
        f"{tasks}noise: {{lidar_range_sd: 0.5}}\nvariants: {{old: {{noise: earlier, mismatch: {{base_lag: 0.2}}}}}}\n"
    )
    old = load_scene(write(tmp_path, text), "old")
    assert (old.noise, old.mismatch) == (EARLIER_NOISE, Mismatch(base_lag=0.2))


def test_a_scene_of_an_older_session_keeps_the_errors_that_it_was_made_with():
    whole = msgspec.to_builtins(load_scene("exp1", "trial1"))
    later = ("localisation_drift_sd", "localisation_drift_time", "camera_latency", "camera_miss_probability",
             "camera_false_probability")  # fmt: skip
    for name in later:
        del whole["noise"][name]
    del whole["mismatch"], whole["detections"]
    scene = msgspec.convert(whole, Scene)
    assert [getattr(scene.noise, name) for name in later] == [getattr(EARLIER_NOISE, name) for name in later]
    assert (scene.mismatch, scene.detections) == (Mismatch(), "named")
