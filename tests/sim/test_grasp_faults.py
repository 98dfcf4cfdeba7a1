import math

import numpy as np
import pytest
from sim_hands import act, cube_of, move, over_a_cube
from sim_scenes import QUIET, experiment, scene

from motm_twin.model.plant import Actuation
from motm_twin.model.scene import Faults, Noise
from motm_twin.model.state import state_hash
from motm_twin.sim.gripper import Gripper, GripperState
from motm_twin.sim.plant import SimulatedPlant


def close(plant, seconds):
    plant.command(act(gripper="close"))
    plant.step(seconds)
    return plant


def let_go(plant):
    plant.command(act())
    plant.step(0.3)


def put_back(plant):
    """The cube where it was, between the open fingers."""
    cube, start = plant._state.objects[0], plant.scene.objects[0]
    cube.position, cube.state, cube.velocity = np.array(start.position), "resting", np.zeros(3)
    cube.turn_to(start.yaw)


def test_without_faults_the_gripper_is_the_plain_one_and_its_state_has_nothing_of_them():
    plant = SimulatedPlant(experiment())
    assert type(plant._gripper) is Gripper
    assert type(plant._state.gripper) is GripperState


def test_late_fingers_still_move_at_the_width_of_the_cube_until_they_hold_it():
    plant = close(over_a_cube(faults=Faults(grasp_delay=3.0)), 0.8)
    for seconds in (0.0, 2.9):
        if seconds:
            plant.step(seconds)
        seen = plant.observe()
        assert seen.gripper_moving
        assert seen.gripper_width == pytest.approx(0.04)
        assert cube_of(plant).state == "resting"
    plant.step(0.1)
    assert cube_of(plant).state == "held"
    assert not plant.observe().gripper_moving


def test_late_fingers_lose_a_cube_that_does_not_stay_between_them():
    plant = close(over_a_cube(faults=Faults(grasp_delay=3.0)), 1.5)
    plant._state.objects[0].position[0] += 0.03
    plant.step(3.0)
    assert cube_of(plant).state != "held"
    assert plant.observe().gripper_width == 0.0


def test_the_first_grasps_close_on_nothing_and_the_next_one_holds():
    plant = over_a_cube(faults=Faults(grasp_misses=2))
    for _ in range(2):
        close(plant, 1.0)
        assert plant.observe().gripper_width == 0.0
        assert cube_of(plant).state == "resting"
        let_go(plant)
        put_back(plant)
    close(plant, 0.8)
    assert cube_of(plant).state == "held"


def test_a_cube_that_slips_is_held_until_it_is_lifted():
    plant = over_a_cube(faults=Faults(grasp_slips=1))
    close(plant, 0.8)
    assert cube_of(plant).state == "held"
    move(plant, (0.0, 0.0, 0.1), 0.5)
    assert cube_of(plant).state == "resting"
    assert plant.truth().picks == 0


def test_faults_may_be_kept_for_another_object():
    assert cube_of(close(over_a_cube(faults=Faults(grasp_misses=1, only_object=2)), 0.8)).state == "held"


def test_failures_by_chance_follow_the_seed_alone():
    def outcomes(seed):
        plant, found = over_a_cube(faults=Faults(grasp_failure_probability=0.5), seed=seed), []
        for _ in range(8):
            close(plant, 1.0)
            found.append(cube_of(plant).state)
            let_go(plant)
            put_back(plant)
        return found

    one = outcomes(1)
    assert outcomes(1) == one
    assert {"held", "resting"} <= set(one)
    assert outcomes(2) != one


def test_faults_are_copied_and_restored_with_everything_else():
    plant = close(over_a_cube(faults=Faults(grasp_delay=1.0, grasp_delay_spread=1.0)), 0.5)
    then = plant.snapshot()
    plant.step(3.0)
    after = state_hash(plant.snapshot())
    plant.restore(then)
    plant.step(3.0)
    assert state_hash(plant.snapshot()) == after


def test_somebody_moves_the_cube_once_as_the_robot_comes_near_and_leaves_it_on_the_table():
    moved = Faults(cube_moved_by=0.1, cube_moved_within=1.5)
    plant = SimulatedPlant(experiment(noise=QUIET, faults=moved, start=(1.0, 0.6, 0.0)))
    start = np.array(plant.scene.objects[0].position)
    plant.step(0.05)
    np.testing.assert_array_equal(cube_of(plant, "cube1").position, start)
    plant.command(act((0.5, 0.0)))
    plant.step(3.0)
    x, y, z = cube_of(plant, "cube1").position
    assert math.hypot(x - start[0], y - start[1]) == pytest.approx(0.1)
    assert z == start[2]
    np.testing.assert_array_equal(cube_of(plant, "cube2").position, plant.scene.objects[1].position)


def test_a_base_with_a_scale_error_drives_another_way_than_it_was_told():
    plain, scaled = (SimulatedPlant(scene(noise=Noise(base_speed_scale_sd=sd))) for sd in (0.0, 0.2))
    for plant in (plain, scaled):
        plant.command(act((0.2, 0.3)))
        plant.step(2.0)
    told, done = plain.truth().pose, scaled.truth().pose
    assert abs(done[2] / told[2] - 1.0) > 0.02


def test_shaking_joints_stay_about_where_they_are_told_to_be_and_those_told_to_stand_hold():
    q = []
    for noise in (Noise(arm_rate_sd=0.05), Noise()):
        plant = SimulatedPlant(scene(noise=noise))
        plant.command(Actuation(twist=np.zeros(2), joint_velocity=np.array([0.1] * 6 + [0.0]), gripper="open"))
        start = plant.observe().q
        plant.step(1.0)
        q.append(plant.observe().q - start)
    away = np.abs(q[0] - q[1])
    assert 0.0005 < away[:6].max() < 0.03
    assert away[6] == 0.0
