import math

import numpy as np
import pytest
from edit_scenes import room
from sim_hands import act, cube_of, grasp, over_a_cube, tcp
from sim_scenes import QUIET, box, scene

from motm_twin.model.edits import AddObstacle, InjectFault, PushRobot
from motm_twin.model.scene import Noise
from motm_twin.model.state import state_hash
from motm_twin.sim.plant import SimulatedPlant


def test_a_push_moves_the_base_and_its_odometry_notices_nothing():
    plant = SimulatedPlant(scene(start=(1.0, -1.0, 0.4)))
    plant.command(act((0.2, 0.1)))
    plant.step(1.0)
    before = plant.observe(), plant.truth()
    plant.apply(PushRobot(dx=0.3, dy=-0.2, turn=0.5))
    seen, truth = plant.observe(), plant.truth()
    np.testing.assert_allclose(truth.pose - before[1].pose, (0.3, -0.2, 0.5), atol=1e-12)
    np.testing.assert_allclose(seen.pose - before[0].pose, (0.3, -0.2, 0.5), atol=1e-12)
    np.testing.assert_array_equal(seen.odometry, before[0].odometry)
    np.testing.assert_array_equal(seen.twist, before[0].twist)
    plant.step(1.0)
    assert plant.truth().plant_faults == ()


def test_the_localised_pose_errs_after_a_push_as_it_did_before():
    pushed, free = (SimulatedPlant(scene(noise=Noise())) for _ in range(2))
    pushed.apply(PushRobot(dx=0.3, dy=0.1))
    for plant in (pushed, free):
        plant.step(1.0)
    np.testing.assert_allclose(
        pushed.observe().pose - pushed.truth().pose, free.observe().pose - free.truth().pose, atol=1e-12
    )


def test_path_length_is_what_the_base_drove_and_not_where_it_was_pushed():
    plant = SimulatedPlant(scene())
    plant.command(act((0.4, 0.5)))
    ways, last = 0.0, plant.truth().pose
    for _ in range(100):
        plant.step(0.01)
        pose = plant.truth().pose
        ways, last = ways + math.hypot(*(pose - last)[:2]), pose
    assert plant.truth().path_length == pytest.approx(ways, rel=1e-4)
    driven = plant.truth().path_length
    plant.apply(PushRobot(dx=0.4, dy=0.0))
    assert plant.truth().path_length == driven
    plant.command(act((-0.2, 0.0)))
    plant.step(3.0)
    assert plant.truth().path_length > driven + 0.3


def test_a_plant_that_jumps_by_itself_is_still_found_out_after_a_push():
    plant = SimulatedPlant(scene())
    plant.apply(PushRobot(dx=0.2, dy=0.0))
    plant.step(0.1)
    assert plant.truth().plant_faults == ()
    plant._state.base.pose = plant._state.base.pose + np.array([0.05, 0.0, 0.0])
    plant.step(0.01)
    assert any("way of the base" in fault for fault in plant.truth().plant_faults)


def test_a_held_cube_goes_with_a_pushed_robot():
    plant = grasp(over_a_cube(), lift=0.1)
    x, y, z = cube_of(plant).position
    plant.apply(PushRobot(dx=-0.2, dy=0.1))
    np.testing.assert_allclose(cube_of(plant).position, (x - 0.2, y + 0.1, z), atol=1e-9)
    plant.step(0.2)
    assert cube_of(plant).state == "held"
    assert plant.truth().plant_faults == ()


def test_a_push_while_the_fingers_close_on_a_cube_loses_it():
    plant = over_a_cube()
    plant.command(act(gripper="close"))
    plant.step(0.3)
    plant.apply(PushRobot(dx=-0.1, dy=0.0))
    plant.step(1.0)
    assert plant.observe().gripper_width == 0.0


@pytest.mark.parametrize(
    ("push", "message"),
    [
        (PushRobot(dx=0.5, dy=0.2), "at most 0.5 m"),
        (PushRobot(dx=0.0, dy=0.0, turn=-1.1), "-1 to 1 rad"),
        (PushRobot(dx=math.nan, dy=0.0), "push nan m"),
        (PushRobot(dx=0.4, dy=0.0), "into 'wall'"),
        (PushRobot(dx=0.0, dy=0.4), "into 'temi'"),
        (PushRobot(dx=0.0, dy=0.0, turn=0.8), "into 'wall'"),
    ],
)
def test_a_push_that_is_too_far_or_into_something_is_refused(push, message):
    plant = SimulatedPlant(scene(solids=(box("wall", (0.45, 0.0), (0.1, 1.0), 1.0),)))
    plant.apply(AddObstacle(name="temi", shape="temi", x=0.0, y=0.7))
    before = state_hash(plant.snapshot())
    with pytest.raises(ValueError, match=message):
        plant.apply(push)
    assert state_hash(plant.snapshot()) == before


def test_a_robot_in_which_something_stands_can_be_pushed_out_of_it():
    plant = SimulatedPlant(scene())
    plant.apply(AddObstacle(name="crate", x=0.5, y=0.0))
    with pytest.raises(ValueError, match="into 'crate'"):
        plant.apply(PushRobot(dx=0.2, dy=0.0))
    plant.apply(PushRobot(dx=-0.4, dy=0.0))


def test_without_lidar_the_scan_keeps_its_old_stamp_until_it_is_back():
    plant = SimulatedPlant(scene())
    plant.step(0.5)
    plant.apply(InjectFault(fault="lidar_off", seconds=1.0))
    assert plant.truth().faults == ("lidar off for 1.0 s",)
    stamps = []
    for _ in range(30):
        plant.step(0.05)
        stamps.append(plant.observe().scan.stamp)
    assert stamps[:19] == [0.5] * 19
    np.testing.assert_allclose(stamps[20:], np.arange(31, 41) * 0.05, atol=1e-9)
    assert plant.truth().faults == ()


def test_sweeps_never_run_backwards_when_a_shorter_delay_replaces_a_longer_one():
    """The sweeps that were still under way came after newer ones."""
    plant, stamps = SimulatedPlant(scene()), []
    for k in range(60):
        if k in (10, 20):
            plant.apply(InjectFault(fault="lidar_delay", seconds=10.0, delay={10: 1.0, 20: 0.22}[k]))
        plant.step(0.05)
        stamps.append(plant.observe().scan.stamp)
    assert stamps == sorted(stamps)
    assert plant.time - stamps[-1] < 0.22 + 0.06


def camera_room():
    return over_a_cube(offset=(0.0, 0.0, 0.3), noise=QUIET)


def test_without_camera_nothing_is_detected_until_it_is_back():
    plant = camera_room()
    plant.step(0.05)
    assert plant.observe().detections
    plant.apply(InjectFault(fault="camera_off", seconds=0.5))
    plant.step(0.1)
    assert plant.truth().faults == ("camera off for 0.4 s",)
    assert plant.observe().detections == ()
    assert plant.observe().camera_stamp == pytest.approx(0.05)  # no picture shows that nothing is there
    plant.step(0.5)
    assert plant.observe().detections[0].stamp == plant.observe().camera_stamp == pytest.approx(plant.time)


@pytest.mark.parametrize("delay", [0.0, 0.2, 0.33, 1.0])
def test_delayed_detections_come_late_with_their_true_stamps(delay):
    plant, prompt = camera_room(), camera_room()
    frames = {0.0: prompt.observe().detections}
    plant.step(0.5), prompt.step(0.5)
    plant.apply(InjectFault(fault="camera_delay", seconds=2.0, delay=delay))
    for k in range(11, 50):
        for each in (plant, prompt):
            each.command(act((0.1, 0.2)))
            each.step(0.05)
        frames[round(prompt.time, 2)] = prompt.observe().detections
        (seen,) = plant.observe().detections
        assert seen.stamp <= plant.time - delay + 1e-9 or seen.stamp == 0.5
        if plant.time - 0.5 > delay + 0.06:
            assert seen.stamp > plant.time - delay - 0.05 - 1e-9
            original = frames[round(seen.stamp, 2)][0]
            np.testing.assert_array_equal(seen.p_base, original.p_base)
            np.testing.assert_array_equal(seen.odometry, original.odometry)
        assert k < 50
    plant.step(0.2)
    assert plant.observe().detections[0].stamp == pytest.approx(plant.time)
    assert plant._state.camera.late == []


def test_a_fault_of_one_kind_replaces_the_one_before_and_others_last():
    plant = SimulatedPlant(scene())
    plant.apply(InjectFault(fault="lidar_off", seconds=5.0))
    plant.apply(InjectFault(fault="camera_delay", seconds=3.0, delay=0.25))
    plant.apply(InjectFault(fault="lidar_off", seconds=0.5))
    assert plant.truth().faults == ("camera 0.25 s late for 3.0 s", "lidar off for 0.5 s")
    plant.step(1.0)
    assert plant.truth().faults == ("camera 0.25 s late for 2.0 s",)


@pytest.mark.parametrize(
    ("fault", "message"),
    [
        (InjectFault(fault="lidar_of"), "did you mean lidar_off"),
        (InjectFault(fault="lidar_off", seconds=0.01), "0.05 to 60 s"),
        (InjectFault(fault="lidar_off", seconds=math.nan), "0.05 to 60 s"),
        (InjectFault(fault="camera_delay", delay=5.5), "0 to 5 s"),
    ],
)
def test_faults_out_of_range_are_refused(fault, message):
    with pytest.raises(ValueError, match=message):
        SimulatedPlant(scene()).apply(fault)


def test_the_arm_is_where_the_push_has_brought_it_at_once():
    plant = SimulatedPlant(room())
    plant.apply(PushRobot(dx=0.1, dy=0.2, turn=0.3))
    np.testing.assert_allclose(plant._state.tcp, tcp(plant.truth().pose, plant.observe().q)[0], atol=1e-9)
