"""The rule that came from contact dynamics, beside the strict one."""

import math

import msgspec
import numpy as np
import pytest
from sim_hands import DOWN, act, cube_of, move, over_a_cube, tcp
from sim_scenes import box

from motm_twin.model.profile import Gripper, RobotProfile
from motm_twin.model.scene import Bin, Faults, Pick, Place, SceneObject
from motm_twin.sim.grasp import STRICT, violation
from motm_twin.sim.objects import ObjectState
from motm_twin.sim.plant import SimulatedPlant


def close(plant, seconds=0.8, twist=(0.0, 0.0)):
    plant.command(act(twist, gripper="close"))
    plant.step(seconds)
    return plant


def test_the_test_hand_points_straight_down():
    assert tcp()[1][2, 2] == pytest.approx(-1.0)


def test_a_well_placed_cube_is_held_exactly_after_the_closing_time():
    plant = close(over_a_cube(), 0.79)
    assert plant.observe().gripper_moving
    assert cube_of(plant).state == "resting"
    plant.step(0.01)
    assert cube_of(plant).state == "held"
    assert not plant.observe().gripper_moving
    assert plant.observe().gripper_width == pytest.approx(0.04)


def test_pads_travel_evenly_from_open_to_the_width_of_the_cube():
    plant = over_a_cube()
    plant.command(act(gripper="close"))
    widths = []
    for _ in range(8):
        plant.step(0.1)
        widths.append(plant.observe().gripper_width)
    np.testing.assert_allclose(widths, np.linspace(0.075, 0.04, 8), atol=1e-12)


def test_fingers_open_as_far_as_they_are_told_and_let_go_all_the_same():
    plant = over_a_cube()
    for opening in (0.06, 0.05, None, 0.055):
        plant.command(act(gripper="open", opening=opening))
        plant.step(0.1)
        assert plant.observe().gripper_moving
        plant.step(0.15)
        assert not plant.observe().gripper_moving
        assert plant.observe().gripper_width == pytest.approx(opening or 0.08)
    close(plant)
    assert cube_of(plant).state == "held"
    plant.command(act(gripper="open", opening=0.02))
    plant.step(0.3)
    assert cube_of(plant).state != "held"


def test_with_nothing_between_the_pads_close_to_zero_in_the_closing_time():
    plant = close(over_a_cube(offset=(0.3, 0.0, 0.0)), 0.8)
    assert plant.observe().gripper_width == 0.0
    assert not plant.observe().gripper_moving


@pytest.mark.parametrize("faults", [Faults(), Faults(grasp_delay=0.1)])
@pytest.mark.parametrize(("offset", "width"), [(0.0, 0.04), (0.3, 0.0)])
def test_fingers_that_take_no_time_have_closed_after_a_substep(faults, offset, width):
    """A closing time of 0 was divided by."""
    robot = RobotProfile(gripper=Gripper(closing_time=0.0))
    plant = close(over_a_cube(offset=(offset, 0.0, 0.0), robot=robot, faults=faults), 0.01 + faults.grasp_delay)
    assert plant.observe().gripper_width == pytest.approx(width)
    assert not plant.observe().gripper_moving


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize(("size", "held"), [(0.0145, True), (0.0155, False)])
def test_by_the_strict_rule_an_offset_of_fifteen_millimetres_decides_on_each_axis(axis, sign, size, held):
    offset = np.zeros(3)
    offset[axis] = sign * size
    plant = close(over_a_cube(offset=offset, grasp_rule=STRICT))
    assert (cube_of(plant).state == "held") == held
    if not held:
        plant.step(0.5)
        assert plant.observe().gripper_width == 0.0
        assert cube_of(plant).state != "held"


@pytest.mark.parametrize("quarter", [0, 1, -2])
@pytest.mark.parametrize(("degrees", "held"), [(14.5, True), (-14.5, True), (15.5, False), (-15.5, False), (40, False)])
def test_by_the_strict_rule_a_yaw_of_fifteen_degrees_decides(degrees, held, quarter):
    plant = close(over_a_cube(turn=math.radians(degrees + 90 * quarter), grasp_rule=STRICT))
    assert (cube_of(plant).state == "held") == held


@pytest.mark.parametrize(("degrees", "held"), [(0, True), (29, True), (31, False)])
def test_a_tool_may_be_tilted_up_to_thirty_degrees(degrees, held):
    q = DOWN.copy()
    q[5] += math.radians(degrees)
    plant = close(over_a_cube(q=q, pedestal=False))
    assert plant._state.gripper.outcome == ("held" if held else "nothing")


@pytest.mark.parametrize(("speed", "outcome"), [(0.028, "held"), (0.034, "slipping")])
def test_by_the_strict_rule_a_relative_speed_of_three_centimetres_per_second_decides(speed, outcome):
    plant = over_a_cube(grasp_rule=STRICT)
    move(plant, (0.0, 0.0, 0.0), 0.0)
    cube = plant._state.objects[0]
    plant.command(act((speed, 0.0)))
    plant.step(1.0)  # up to speed
    hand, _ = tcp(pose=plant.truth().pose)
    cube.position[:2] = hand[0] + 0.5 * 0.8 * speed, hand[1]  # passes the middle half way through
    close(plant, 0.8, (speed, 0.0))
    assert plant._state.gripper.outcome == outcome


def test_by_the_strict_rule_a_cube_that_slid_between_the_pads_slips_out_when_lifted():
    plant = over_a_cube(grasp_rule=STRICT)
    plant.command(act((0.034, 0.0)))
    plant.step(1.0)
    hand, _ = tcp(pose=plant.truth().pose)
    plant._state.objects[0].position[:2] = hand[0] + 0.013, hand[1]
    close(plant, 0.8, (0.034, 0.0))
    assert cube_of(plant).state == "held"
    move(plant, (0.0, 0.0, 0.1), 0.5)
    truth = plant.truth()
    assert cube_of(plant).state == "resting"
    assert truth.picks == 0
    move(plant, (0.0, 0.0, 0.0), 0.5)
    assert plant.observe().gripper_width == 0.0


def test_the_strict_rule_must_hold_during_the_whole_closing():
    plant = over_a_cube(grasp_rule=STRICT)
    plant.command(act(gripper="close"))
    plant.step(0.7)
    plant._state.objects[0].position[0] += 0.016
    plant.step(0.01)
    plant._state.objects[0].position[0] -= 0.016
    plant.step(0.5)
    assert cube_of(plant).state != "held"


def test_a_loosely_centred_cube_ends_up_centred_and_aligned_between_the_pads():
    plant = close(over_a_cube(offset=(0.0, 0.012, 0.0), turn=math.radians(10)))
    hand, rotation = tcp()
    item = cube_of(plant)
    assert rotation[:, 1] @ (np.array(item.position) - hand) == pytest.approx(0.0, abs=1e-9)
    misfit = math.remainder(math.atan2(rotation[1, 1], rotation[0, 1]) - item.yaw, math.pi / 2)
    assert misfit == pytest.approx(0.0, abs=1e-9)


def test_fingers_that_sweep_sideways_push_the_cube_along_without_grasping():
    plant = over_a_cube(offset=(0.0, 0.08, 0.0), solids=(box("plate", (0.6, 0.0), (0.6, 0.6), tcp()[0][2] - 0.02),))
    stand = plant.scene.solids[0]  # the plate around it is as high
    before = np.array(cube_of(plant).position)
    _, rotation = tcp()
    move(plant, tuple(0.05 * rotation[:, 1]), 0.8, gripper="open")
    after = np.array(cube_of(plant).position)
    assert rotation[:, 1] @ (after - before) > 0.01
    assert after[2] == pytest.approx(stand.z_max + 0.02)
    assert cube_of(plant).state == "resting"


def test_a_cube_pushed_over_the_edge_falls_to_the_floor_and_counts_as_a_drop():
    plant = over_a_cube(offset=(0.0, 0.08, 0.0))
    _, rotation = tcp()
    move(plant, tuple(0.1 * rotation[:, 1]), 1.0, gripper="open")
    assert cube_of(plant).state == "dropped"
    assert cube_of(plant).position[2] == pytest.approx(0.02)
    assert plant.truth().drops == 1


def test_a_held_cube_follows_the_hand_rigidly():
    plant = close(over_a_cube(offset=(0.01, 0.0, 0.005)))
    move(plant, (0.05, 0.02, 0.1), 1.0, twist=(0.2, 0.3))
    hand, rotation = tcp(pose=plant.truth().pose, q=plant.observe().q)
    np.testing.assert_allclose(rotation.T @ (np.array(cube_of(plant).position) - hand), [0.01, 0.0, 0.005], atol=1e-9)


def test_pick_lift_turn_and_drop_into_the_right_bin_is_counted_once():
    hand, _ = tcp()
    distance = math.hypot(hand[0], hand[1])
    bin_ = Bin(
        name="bin", centre=(distance * math.cos(1.0), distance * math.sin(1.0)), side=0.2, floor_z=0.3, rim_z=0.4
    )
    plant = close(over_a_cube(bins=(bin_,), tasks=(Pick(object="cube"), Place(bin="bin"))))
    assert plant.truth().picks == 0
    move(plant, (0.0, 0.0, 0.1), 1.0)
    assert plant.truth().picks == 1
    while plant.truth().pose[2] < 0.9:
        plant.command(act((0.0, 0.3), gripper="close"))
        plant.step(0.05)
    plant.command(act((0.0, 0.3), gripper="open"))
    plant.step(0.19)
    assert cube_of(plant).state == "held"
    plant.step(0.02)
    assert cube_of(plant).state == "falling"
    plant.step(1.0)
    truth = plant.truth()
    assert cube_of(plant).state == "binned:bin"
    assert cube_of(plant).position[2] == pytest.approx(0.32)
    assert (truth.picks, truth.places, truth.drops) == (1, 1, 0)
    assert truth.contacts == ()
    assert truth.plant_faults == ()


def test_a_released_cube_keeps_the_speed_of_the_hand_while_it_falls():
    plant = close(over_a_cube())
    move(plant, (0.0, 0.0, 0.1), 1.0)
    while plant.truth().pose[0] < 0.3:
        plant.command(act((0.3, 0.0), gripper="close"))
        plant.step(0.05)
    plant.command(act((0.3, 0.0), gripper="open"))
    plant.step(0.2)
    freed = np.array(cube_of(plant).position)
    plant.step(1.0)
    item = cube_of(plant)
    fall_time = math.sqrt(2.0 * (freed[2] - 0.02) / 9.81)
    assert item.state == "dropped"
    assert item.position[0] - freed[0] == pytest.approx(0.3 * fall_time, abs=0.01)


def test_a_cube_released_over_the_rim_slides_inside_the_bin():
    plant = over_a_cube(bins=(Bin(name="bin", centre=(3.0, 0.0)),))
    cube = plant._state.objects[0]
    cube.position, cube.state = np.array([3.195, 0.0, 0.9]), "falling"
    plant.step(1.0)
    assert cube_of(plant).state == "binned:bin"
    assert cube_of(plant).position[0] <= 3.0 + 0.2 - 0.01 - 0.02 + 1e-9


def test_the_wrong_bin_is_no_place():
    bins = (Bin(name="right", centre=(3.0, 0.0)), Bin(name="wrong", centre=(3.0, 2.0)))
    plant = over_a_cube(bins=bins, tasks=(Pick(object="cube"), Place(bin="right")))
    cube = plant._state.objects[0]
    cube.position, cube.state = np.array([3.0, 2.0, 0.9]), "falling"
    plant.step(1.0)
    assert cube_of(plant).state == "binned:wrong"
    assert plant.truth().places == 0


def test_a_cube_dropped_on_another_lies_on_top_of_it():
    plant = over_a_cube(bins=(Bin(name="bin", centre=(3.0, 0.0)),))
    lower = plant._state.objects[0]
    lower.position, lower.state = np.array([3.0, 0.0, 0.64]), "binned:bin"
    upper = ObjectState(name="other", position=np.array([3.01, 0.0, 1.0]), yaw=0.3, side=0.04, state="falling")
    plant._state.objects.append(upper)
    plant._state.referee.check.objects = np.array([item.position for item in plant._state.objects])
    plant.step(1.0)
    assert upper.state == "binned:bin"
    assert upper.position[2] == pytest.approx(0.68)


def test_the_rule_itself_names_what_is_broken():
    hand, rotation = tcp()
    item = ObjectState(name="cube", position=hand.copy(), yaw=math.pi / 2, side=0.04)
    assert violation(hand, rotation, item) == ""
    item.yaw += math.radians(20)
    assert violation(hand, rotation, item) == "yaw"
    item.position[1] += 0.02
    assert violation(hand, rotation, item) == "offset"


def hand(rule, **how):
    scene = msgspec.structs.replace(over_a_cube(**how).scene, grasp_rule=rule)
    return SimulatedPlant(scene, arm_start=DOWN)


def held(plant, twist=(0.0, 0.0)):
    move(plant, (0.0, 0.0, 0.0), 0.9, twist=twist)
    move(plant, (0.0, 0.0, 0.1), 0.5)
    return plant.truth().objects[0].state == "held"


def test_a_cube_off_along_the_pads_is_held_as_far_as_contact_dynamics_hold_it():
    assert held(hand("swept", offset=(0.02, 0.0, 0.0)))
    assert not held(hand("strict", offset=(0.02, 0.0, 0.0)))
    assert not held(hand("swept", offset=(0.032, 0.0, 0.0)))


def test_a_turned_cube_is_turned_by_the_pads():
    assert held(hand("swept", turn=0.6))
    assert not held(hand("strict", turn=0.6))


def test_a_hand_that_moves_while_it_closes_holds_what_stays_between_its_pads():
    assert held(hand("swept"), twist=(0.02, 0.0))
    assert not held(hand("swept"), twist=(0.06, 0.0))


def test_the_speed_at_which_the_strict_rule_loses_a_cube_can_be_lowered():
    slow = over_a_cube(grasp_rule="strict").scene
    assert held(SimulatedPlant(slow, arm_start=DOWN), twist=(0.012, 0.0))
    strict = msgspec.structs.replace(slow, grasp_speed=0.01)
    assert not held(SimulatedPlant(strict, arm_start=DOWN), twist=(0.012, 0.0))


def test_of_two_cubes_the_pads_take_the_one_between_them():
    position, rotation = tcp()
    beside = SceneObject(name="beside", position=tuple(position + rotation @ np.array([0.045, 0.0, 0.0])))
    cubes = (over_a_cube().scene.objects[0], beside)
    scene = msgspec.structs.replace(over_a_cube().scene, objects=cubes)
    plant = SimulatedPlant(scene, arm_start=DOWN)
    move(plant, (0.0, 0.0, 0.0), 0.9)
    assert [item.state for item in plant.truth().objects] == ["held", "resting"]


def test_pads_that_close_beside_a_cube_do_not_pull_it_to_their_middle():
    plant = hand("swept", offset=(0.06, 0.01, 0.0))
    before = plant.truth().objects[0].position
    move(plant, (0.0, 0.0, 0.0), 0.9)
    assert plant.truth().objects[0].position == pytest.approx(before, abs=1e-9)
