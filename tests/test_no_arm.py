"""A robot without an arm is a robot: it drives, is judged, drawn, sent and rerun, and picks nothing."""

import numpy as np
import pytest
from fakes_of_viser import Scene as Drawn

from motm_twin.bus.encode import tick_message
from motm_twin.model.edits import InsertTask
from motm_twin.model.kinematics import Frankie
from motm_twin.model.known import known_world
from motm_twin.model.names import SceneError
from motm_twin.model.scene import Pick, Scene
from motm_twin.model.scene_file import load_scene
from motm_twin.perception.base_map import base_map
from motm_twin.record.replay import rerun
from motm_twin.sessions.session import load_session, save_session
from motm_twin.sim.referee_geometry import RobotShapes
from motm_twin.trial import run_scene
from motm_twin.twin import Twin
from motm_twin.ui.scene.robot_view import GhostView, RobotView

TEXT = """
format: motm-scene/1
robot: {name: cart, arm: none}
furniture:
  shelf: {shape: box, centre: [1.2, 0.0], size: [0.6, 0.8], z: [0.6, 0.9], mapped: false}
tasks: [{drive_to: {x: 0.0, y: 1.2, tolerance: 0.2}}]
time_limit: 30
"""
CUBE = "objects: {cube: {surface: shelf, at: [1.2, 0.0]}}\n"


def scene_of(tmp_path, text: str = TEXT) -> Scene:
    path = tmp_path / "cart.yaml"
    path.write_text(text, encoding="utf-8")
    return load_scene(str(path))


def test_it_drives_where_it_is_told_and_nothing_but_the_base_moves(tmp_path):
    twin = Twin(scene_of(tmp_path))
    rest = twin.plant.observe().q.copy()
    while not twin.done and twin.index < 400:
        tick = twin.advance()
        assert all(step.qp_status == "no arm" and not step.actuation.joint_velocity.any() for step in tick.arm)
    assert twin.done
    assert np.array_equal(tick.observation.q, rest)
    message = tick_message(tick, 1, 0.0)
    assert len(message.robot.q) == 7


def test_the_referee_judges_no_arm_that_is_not_there(tmp_path):
    scene = scene_of(tmp_path)  # with an arm, its hand begins in the shelf
    assert RobotShapes(scene.robot).bodies == ("base", "held")
    result = run_scene(scene)
    assert result["success"] and not result["contacts"]
    assert result["min_arm_clearance_m"] is None and result["min_ee_obstacle_m"] is None


def test_a_task_for_an_arm_is_refused_with_a_sentence(tmp_path):
    with pytest.raises(SceneError, match="the robot has no arm"):
        scene_of(tmp_path, TEXT.replace("tasks: [", "tasks: [{pick: cube}, ") + CUBE)
    twin = Twin(scene_of(tmp_path, TEXT + CUBE))
    twin.advance()
    with pytest.raises(ValueError, match="the robot has no arm"):
        twin.post(InsertTask(tasks=(Pick(object="cube"),)))


def test_its_session_reruns_to_the_same_state(tmp_path):
    twin = Twin(scene_of(tmp_path))
    for _ in range(30):
        twin.advance()
    save_session(twin.session(), tmp_path / "run.json")
    assert rerun(load_session(tmp_path / "run.json")).ok


def test_the_page_draws_the_base_alone(tmp_path):
    drawn = Drawn()
    view, ghosts, twin = RobotView(drawn.server), GhostView(drawn.server), Twin(scene_of(tmp_path))
    view.kinematics = ghosts.kinematics = Frankie(twin.scene.robot)
    for _ in range(40):
        tick = twin.advance()
    message = tick_message(tick, 1, 0.0)
    view.update(message)
    ghosts.update(message, None)
    batches = {name for name in drawn.handles if "arrival" in name or "silhouette" in name}
    assert {name for name, handle in drawn.handles.items() if handle.visible} - batches == {
        "/robot/link/base_link",
        "/robot/shadow/base",
    }
    assert {name for name in batches if drawn.handles[name].batched_positions[:, 2].max() > -1.0} <= {
        "/robot/silhouette"
    }


UNDER = """
format: motm-scene/1
robot: {name: cart, arm: none}
furniture:
  bridge: {shape: box, centre: [1.5, 0.0], size: [0.6, 12.0], z: [Z, 0.9]}
  end: {shape: box, centre: [3.9, 0.0], size: [0.2, 12.0], z: [0.0, 0.9]}
tasks: [{drive_to: {x: 3.0, y: 0.0, tolerance: 0.2}}]
time_limit: 30
"""


def test_it_passes_under_what_is_higher_than_its_base(tmp_path):
    result = run_scene(scene_of(tmp_path, UNDER.replace("Z", "0.5")))
    assert result["success"] and result["contacts"] == []
    assert result["path_length_m"] < 4.0  # straight on


@pytest.mark.parametrize(
    ("z", "arm", "blocked"), [(0.5, "none", False), (0.4, "none", True), (0.5, "{mount_x: 0.15}", True)]
)
def test_what_it_cannot_pass_under_is_in_its_map(tmp_path, z, arm, blocked):
    scene = scene_of(tmp_path, UNDER.replace("Z", str(z)).replace("arm: none", f"arm: {arm}"))
    found = base_map(known_world(scene), 0.05)
    row, column = found.grid.cell_of(np.array([1.5, 0.0]))
    assert bool(found.occupied[row, column]) is blocked
