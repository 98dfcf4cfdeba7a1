"""Staged contacts of cubes: pushed, dropped, carried into each other; and what belongs to grasping and placing."""

import math

import numpy as np
import pytest
from sim_contacts import drive, hits, verdicts
from sim_hands import DOWN, act, grasp, move, over_a_cube, tcp
from sim_scenes import box, scene

from motm_twin.model.edits import AddObstacle, MoveObject, ReleaseBody
from motm_twin.model.scene import Bin, Pick, Place, SceneObject
from motm_twin.sim.objects import ObjectState
from motm_twin.sim.plant import SimulatedPlant
from motm_twin.sim.verdict import Counts


def shelf_of(*offsets, gripper_start=DOWN, side=0.04):
    """Cubes a, b, ... at these offsets from the tool centre point, along the axes of the hand, on one shelf."""
    hand, rotation = tcp(q=gripper_start)
    yaw = math.atan2(rotation[1, 1], rotation[0, 1])
    cubes = tuple(
        SceneObject(name=name, position=tuple(float(v) for v in hand + rotation @ np.array(offset)), yaw=yaw, side=side)
        for name, offset in zip("abcd", offsets, strict=False)
    )
    top = box("shelf", (hand[0], hand[1]), (0.5, 0.5), float(hand[2]) - 0.5 * side, z_min=float(hand[2]) - 0.05)
    return SimulatedPlant(scene(solids=(top,), objects=cubes), arm_start=gripper_start)


def along(axis):
    _, rotation = tcp()
    return rotation @ np.array(axis)


def test_a_base_that_runs_over_a_cube_on_the_floor_causes_the_contact():
    plant = SimulatedPlant(scene(objects=(SceneObject(name="lost", position=(0.6, 0.0, 0.02)),)))
    drive(plant, 0.3, 2.0)
    assert verdicts(plant, "lost") == [True]
    assert hits(plant, "lost")[0].body == "base"


def test_a_finger_that_pushes_a_cube_beside_causes_the_contact():
    plant = shelf_of((0.0, 0.10, 0.0))
    move(plant, tuple(along((0.0, 0.1, 0.0))), 0.5, gripper="open")
    assert verdicts(plant, "a") == [True]
    assert hits(plant, "a")[0].body in ("panda_leftfinger", "panda_rightfinger")


def test_a_finger_that_comes_down_on_a_cube_causes_the_contact():
    plant = over_a_cube(offset=(0.0, 0.05, 0.045))
    move(plant, (0.0, 0.0, -0.05), 0.6, gripper="open")
    assert verdicts(plant, "cube") == [True]


def test_a_cube_that_brushes_a_finger_as_it_falls_out_of_the_opened_hand_is_let_go_without_a_contact():
    plant = over_a_cube(offset=(0.0, 0.023, 0.023))
    item = plant._state.objects[0]
    item.state, item.velocity = "falling", np.array([0.0, 0.0, -0.8])
    plant.step(0.01)
    assert hits(plant) == []


def test_a_hand_that_goes_down_round_a_cube_closes_lifts_and_lets_go_of_it_touches_nothing():
    plant = over_a_cube(offset=(0.004, 0.006, 0.06), turn=0.1)
    move(plant, (0.0, 0.0, -0.1), 0.6, gripper="open")
    assert plant.truth().contacts == ()


def test_a_cube_that_is_taken_lifted_and_released_is_no_contact_of_the_fingers():
    plant = grasp(over_a_cube(offset=(0.003, 0.005, 0.0), turn=0.05), lift=0.04)
    plant.command(act(gripper="open"))
    plant.step(1.0)
    assert plant.truth().contacts == ()
    assert plant.truth().drops == 1


def test_a_grasped_cube_that_is_pushed_against_the_next_one_is_a_contact_of_the_two():
    plant = shelf_of((0.0, 0.0, 0.0), (0.0, 0.10, 0.0), (0.0, 0.141, 0.0))
    move(plant, tuple(along((0.0, 0.1, 0.0))), 0.5, gripper="open")
    assert verdicts(plant, "b") == [True]
    (hit,) = hits(plant, "c")
    assert hit.caused_by_robot
    assert hit.body == "b"


def test_a_held_cube_that_is_lowered_into_a_lying_one_causes_the_contact():
    hand, _ = tcp()
    other = SceneObject(name="other", position=(float(hand[0]) + 0.12, float(hand[1]), float(hand[2])))
    stand = box("stand2", (hand[0] + 0.12, hand[1]), (0.06, 0.06), float(hand[2]) - 0.02)
    cube = SceneObject(name="cube", position=tuple(float(v) for v in hand))
    under = box("stand", (hand[0], hand[1]), (0.06, 0.06), float(hand[2]) - 0.02)
    plant = grasp(SimulatedPlant(scene(solids=(under, stand), objects=(cube, other)), arm_start=DOWN), lift=0.03)
    move(plant, (0.1, 0.0, 0.0), 1.0)
    assert verdicts(plant, "other") == [True]
    assert "held:cube" in hits(plant, "other")[0].bodies


def test_a_held_cube_lies_on_the_one_below_without_a_contact():
    hand, _ = tcp()
    top = SceneObject(name="top", position=tuple(float(v) for v in hand))
    low = SceneObject(name="low", position=(float(hand[0]), float(hand[1]), float(hand[2]) - 0.04))
    under = box("stand", (hand[0], hand[1]), (0.06, 0.06), float(hand[2]) - 0.06)
    plant = grasp(SimulatedPlant(scene(solids=(under,), objects=(top, low)), arm_start=DOWN))
    assert plant.truth().contacts == ()
    move(plant, (0.0, 0.0, 0.1), 0.5)
    assert plant.truth().contacts == ()


def test_two_cubes_that_a_person_piles_up_are_no_contact_and_lie_as_they_do():
    plant = SimulatedPlant(scene(objects=(
        SceneObject(name="a", position=(2.0, 0.0, 0.02)), SceneObject(name="b", position=(2.5, 0.0, 0.02)),
    )))  # fmt: skip
    plant.apply(MoveObject(name="b", x=2.0, y=0.005))
    plant.step(0.5)
    assert hits(plant) == []


@pytest.mark.parametrize("offset", [0.0, 0.03, 0.042, 0.044])
def test_a_cube_that_falls_onto_one_in_the_bin_lies_on_top_however_little_of_it_is_below(offset):
    hand, _ = tcp()
    x, y, floor = float(hand[0]), float(hand[1]), float(hand[2]) - 0.2
    frame = Bin(name="bin", centre=(x, y), floor_z=floor, rim_z=floor + 0.08)
    lying = SceneObject(name="lying", position=(x + offset, y, floor + 0.02), yaw=math.pi / 4)
    cube = SceneObject(name="cube", position=(x, y, float(hand[2])))
    plant = SimulatedPlant(scene(bins=(frame,), objects=(cube, lying)), arm_start=DOWN)
    item = next(item for item in plant._state.objects if item.name == "cube")
    item.state = "falling"
    plant.step(1.0)
    assert item.position[2] == pytest.approx(floor + 0.06)
    assert hits(plant) == []


def test_a_falling_cube_that_drifts_into_a_lying_one_is_a_contact_of_the_two():
    hand, _ = tcp()
    x, y, floor = float(hand[0]) - 0.02, float(hand[1]), float(hand[2]) - 0.2
    lying = SceneObject(name="lying", position=(x + 0.2, y, floor + 0.02))
    table = box("table", (x + 0.2, y), (1.0, 0.3), floor)
    cube = SceneObject(name="cube", position=(x, y, float(hand[2]) - 0.1))
    plant = SimulatedPlant(scene(solids=(table,), objects=(cube, lying)))
    item = next(item for item in plant._state.objects if item.name == "cube")
    item.state, item.velocity = "falling", np.array([1.25, 0.0, 0.0])
    plant.step(1.0)
    (hit,) = hits(plant, "lying")
    assert hit.caused_by_robot
    assert hit.body == "cube"


# --- dropped, and put right ------------------------------------------------------------------------------------


def test_a_cube_that_falls_out_of_the_hand_is_dropped():
    plant = grasp(over_a_cube(tasks=(Pick(object="cube"), Place(bin="bin"))), lift=0.04)
    assert plant.truth().dropped == ()
    plant.command(act(gripper="open"))
    plant.step(1.0)
    assert (plant.truth().drops, plant.truth().dropped) == (1, ("cube",))


def falls(counts, cube, to):
    cube.state = "falling"
    counts.step([cube], "")
    cube.position = cube.position - np.array([0.0, 0.0, 0.3])
    cube.state = to
    counts.step([cube], "")


def lifted(counts, cube):
    cube.state = "held"
    counts.step([cube], cube.name)
    cube.position = cube.position + np.array([0.0, 0.0, 0.3])
    counts.step([cube], cube.name)


def test_a_dropped_cube_stays_dropped_until_it_is_picked_up_and_placed():
    cube = ObjectState(name="cube", position=np.array([0.0, 0.0, 0.5]), yaw=0.0, side=0.04)
    counts = Counts(right_bins={"cube": ("bin",)})
    falls(counts, cube, "dropped")
    lifted(counts, cube)
    assert counts.dropped == ("cube",)
    falls(counts, cube, "binned:other")
    assert counts.dropped == ("cube",)
    lifted(counts, cube)
    falls(counts, cube, "binned:bin")
    assert (counts.drops, counts.dropped, counts.placed) == (1, (), ("cube",))


def test_a_dropped_cube_that_belongs_in_no_bin_is_put_right_by_picking_it_up():
    cube = ObjectState(name="cube", position=np.array([0.0, 0.0, 0.5]), yaw=0.0, side=0.04)
    counts = Counts()
    falls(counts, cube, "resting")
    assert counts.dropped == ("cube",)
    lifted(counts, cube)
    assert counts.dropped == ()


def test_cubes_on_a_board_that_a_person_throws_ride_along_without_a_contact():
    pair = [SceneObject(name=name, position=(2.0, 1.0 + k * 0.0402, 0.07)) for k, name in enumerate("ab")]
    plant = SimulatedPlant(scene(objects=tuple(pair)))
    plant.apply(AddObstacle(name="board", x=2.0, y=1.0, size=(0.4, 0.4, 0.05)))
    plant.apply(ReleaseBody(name="board", velocity=(0.0, -1.0)))
    plant.step(1.0)
    assert plant.truth().objects[0].position[1] < 0.9
    assert hits(plant) == []
