import numpy as np
import pytest
from edit_scenes import room
from sim_hands import act, cube_of, grasp, move, over_a_cube
from sim_scenes import box

from motm_twin.model.edits import AddObstacle, MoveBody, MoveObject, RemoveBody
from motm_twin.model.scene import Bin, Pick, Place
from motm_twin.sim.plant import SimulatedPlant


@pytest.mark.parametrize(
    ("x", "y", "z", "state"),
    [
        (3.3, 2.1, 0.77, "resting"),  # the table
        (3.05, -2.03, 0.64, "binned:bin"),
        (-2.0, 2.0, 0.82, "resting"),  # the cabinet
        (-2.0, -2.0, 0.62, "resting"),  # the loose crate
        (1.0, 3.0, 0.02, "resting"),  # the floor
    ],
)
def test_a_cube_is_put_on_whatever_is_below(x, y, z, state):
    plant = SimulatedPlant(room())
    plant.apply(MoveObject(name="cube1", x=x, y=y))
    for _ in range(2):
        cube = cube_of(plant, "cube1")
        np.testing.assert_allclose(cube.position, (x, y, z), atol=1e-9)
        assert (cube.state, cube.yaw) == (state, 0.3)
        plant.step(0.5)
    truth = plant.truth()
    assert (truth.picks, truth.places, truth.drops, truth.plant_faults) == (0, 0, 0, ())


def test_a_cube_put_on_the_rim_of_a_bin_ends_inside():
    plant = SimulatedPlant(room())
    plant.apply(MoveObject(name="cube2", x=3.199, y=-2.199))
    np.testing.assert_allclose(cube_of(plant, "cube2").position, (3.17, -2.17, 0.64), atol=1e-9)
    assert cube_of(plant, "cube2").state == "binned:bin"


def test_a_cube_is_put_upon_another_but_not_into_it():
    plant = SimulatedPlant(room())
    plant.apply(MoveObject(name="cube1", x=3.51, y=2.2))
    assert cube_of(plant, "cube1").position[2] == pytest.approx(0.81)
    plant.apply(MoveObject(name="cube1", x=1.0, y=3.0))
    with pytest.raises(ValueError, match="inside 'cube2'"):
        plant.apply(MoveObject(name="cube1", x=3.5 + 0.031, y=2.2 + 0.031))
    assert cube_of(plant, "cube1").position[0] == 1.0


def test_a_cube_is_not_put_into_an_agent_nor_into_the_robot():
    plant = SimulatedPlant(room())
    with pytest.raises(ValueError, match="inside 'temi'"):
        plant.apply(MoveObject(name="cube1", x=0.2, y=3.5))
    with pytest.raises(ValueError, match="the robot's base"):
        plant.apply(MoveObject(name="cube1", x=0.3, y=0.1))
    with pytest.raises(ValueError, match="'cube' is not an object here; did you mean cube2 or cube1"):
        plant.apply(MoveObject(name="cube", x=0.3, y=2.0))


def test_a_cube_that_lost_the_one_below_it_falls_and_that_is_no_drop_of_the_robot():
    plant = SimulatedPlant(room())
    plant.apply(MoveObject(name="cube1", x=3.5, y=2.2))
    plant.apply(MoveObject(name="cube2", x=2.5, y=1.9))
    plant.step(0.5)
    assert cube_of(plant, "cube1").position[2] == pytest.approx(0.77)
    plant.apply(MoveObject(name="cube1", x=-2.0, y=-2.0))
    plant.apply(RemoveBody(name="crate"))
    plant.step(1.0)
    assert cube_of(plant, "cube1").state == "dropped"
    assert plant.truth().drops == 0


def holding(**changes):
    plant = grasp(over_a_cube(tasks=(Pick(object="cube"), Place(bin="bin")), **changes), lift=0.05)
    plant.command(act(gripper="close"))
    plant.step(0.1)
    assert cube_of(plant).state == "held"
    return plant


def test_a_cube_taken_out_of_the_gripper_leaves_fingers_that_close_on_nothing():
    plant = holding()
    assert plant.observe().gripper_width == pytest.approx(0.04)
    plant.apply(MoveObject(name="cube", x=2.0, y=2.0))
    plant.step(0.05)
    assert plant.observe().gripper_moving
    plant.step(0.6)
    assert plant.observe().gripper_width == 0.0
    assert not plant.observe().gripper_moving
    truth = plant.truth()
    assert (truth.picks, truth.places, truth.drops, truth.plant_faults) == (1, 0, 0, ())
    assert cube_of(plant).state == "resting"
    plant.command(act(gripper="open"))
    plant.step(0.5)
    assert plant.observe().gripper_width == pytest.approx(0.08)
    np.testing.assert_allclose(cube_of(plant).position, (2.0, 2.0, 0.02), atol=1e-9)


def test_a_cube_taken_while_the_fingers_close_on_it_is_not_held_in_the_end():
    plant = over_a_cube()
    plant.command(act(gripper="close"))
    plant.step(0.4)
    plant.apply(MoveObject(name="cube", x=2.0, y=2.0))
    plant.step(1.0)
    assert plant.observe().gripper_width == 0.0
    assert cube_of(plant).state == "resting"


def test_a_cube_that_a_person_bins_is_no_place_of_the_robot_but_one_that_the_robot_bins_later_is():
    fixed = Bin(name="bin", centre=(2.0, 2.0))
    plant = holding(bins=(fixed,), solids=(box("shelf", (2.0, 2.0), (0.5, 0.5), 0.6),))
    grasped = plant.observe().q
    hand = plant._state.tcp.copy()
    plant.apply(MoveObject(name="cube", x=2.0, y=2.0))
    plant.step(0.5)
    assert cube_of(plant).state == "binned:bin"
    assert plant.truth().places == 0
    plant.command(act(gripper="open"))
    plant.step(0.5)
    stand_top = cube_of(over_a_cube()).position[2] - 0.02
    x, y = float(hand[0]), float(hand[1])
    plant.apply(MoveObject(name="cube", x=x, y=y))
    assert cube_of(plant).position[2] == pytest.approx(stand_top + 0.02)
    move(plant, (0.0, 0.0, -0.1), 0.5, gripper="open")
    plant.command(act())
    plant.step(0.1)
    grasp(plant)
    assert cube_of(plant).state == "held"
    move(plant, (0.0, 0.0, 0.1), 0.5)
    assert plant.truth().picks == 2
    plant.apply(MoveBody(name="stand", x=-2.0, y=-2.0))
    plant.apply(MoveBody(name="shelf", x=x, y=y))
    np.testing.assert_allclose(plant.observe().q, grasped, atol=0.05)
    plant.command(act(gripper="open"))
    plant.step(1.0)
    assert cube_of(plant).state == "binned:bin"
    assert plant.truth().places == 1


def test_what_the_robot_does_to_a_cube_that_a_person_put_down_counts_again():
    plant = holding()
    plant.apply(MoveObject(name="cube", x=2.0, y=2.0))
    plant.step(0.1)
    state = plant._state
    cube = state.objects[0]
    cube.position = np.array([2.0, 2.0, 0.3])  # as if fingers had carried and lost it
    cube.state = "falling"
    plant.step(1.0)
    assert plant.truth().drops == 1


def test_a_cube_can_be_put_on_an_added_box():
    plant = SimulatedPlant(room())
    plant.apply(AddObstacle(name="crate2", x=1.0, y=3.0, size=(0.5, 0.5, 0.4)))
    plant.apply(MoveObject(name="cube1", x=1.1, y=3.1))
    assert cube_of(plant, "cube1").position[2] == pytest.approx(0.42)
