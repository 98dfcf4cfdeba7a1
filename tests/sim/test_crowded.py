"""Cubes that stand close: they push each other, and fingers need room beside the one that they take."""

import math

import numpy as np
import pytest
from sim_hands import DOWN, act, grasp, move, tcp
from sim_scenes import box, scene

from motm_twin.model.scene import SceneObject
from motm_twin.sim.plant import SimulatedPlant

SIDE = 0.04


def hand_over(places, *, above=0.05, solids=()):
    """A plant whose hand is ``above`` [m] the middle of cubes at places (x, y) in the axes of the hand."""
    position, rotation = tcp()
    yaw = math.atan2(rotation[1, 1], rotation[0, 1])
    cubes = []
    for k, (x, y) in enumerate(places):
        centre = position + rotation @ np.array([x, y, 0.0]) - [0.0, 0.0, above]
        cubes.append(SceneObject(name=f"c{k}", position=tuple(map(float, centre)), yaw=yaw, side=SIDE))
    middle, top = cubes[0].position, cubes[0].position[2] - 0.5 * SIDE
    stand = box("stand", middle[:2], (0.4, 0.4), float(top), mapped=True)
    beside = [box_beside(name, position + rotation @ np.array([x, y, 0.0]), size, top) for name, x, y, size in solids]
    return SimulatedPlant(scene(solids=(stand, *beside), objects=tuple(cubes)), arm_start=DOWN.copy())


def box_beside(name, at, size, top):
    solid = box(name, (float(at[0]), float(at[1])), (size, size), float(top) + 0.06, mapped=True)
    return solid


def gaps(plant):
    """Least distance [m] between the middles of two cubes that stand, measured along their common axes."""
    there = [item for item in plant.truth().objects if item.state != "held"]
    found = []
    for k, one in enumerate(there):
        for other in there[k + 1 :]:
            c, s = math.cos(one.yaw), math.sin(one.yaw)
            dx, dy = other.position[0] - one.position[0], other.position[1] - one.position[1]
            found.append(max(abs(c * dx + s * dy), abs(c * dy - s * dx)))
    return min(found)


def reach_and_grasp(plant, above=0.05):
    move(plant, (0.0, 0.0, -0.1), above / 0.1, gripper="open")
    plant.command(act())
    plant.step(0.2)
    grasp(plant, lift=0.05)
    return plant.truth()


def test_the_middle_of_nine_cubes_five_millimetres_apart_cannot_be_picked():
    step = SIDE + 0.005
    grid = [(0.0, 0.0), *((step * i, step * j) for i in (-1, 0, 1) for j in (-1, 0, 1) if (i, j) != (0, 0))]
    plant = hand_over(grid)
    truth = reach_and_grasp(plant)
    assert truth.picks == 0
    assert plant._state.gripper.outcome == "no room"
    assert gaps(plant) >= SIDE - 1e-3


def test_a_cube_with_room_for_both_fingers_is_picked_between_two_others():
    plant = hand_over([(0.0, 0.0), (SIDE + 0.005, 0.0), (-SIDE - 0.005, 0.0)])
    assert reach_and_grasp(plant).picks == 1
    assert gaps(plant) >= SIDE - 1e-3


@pytest.mark.parametrize("others", [1, 2, 3])
def test_a_row_of_cubes_is_pushed_as_one(others):
    """The hand, with its fingers beside the first, moves along the row."""
    row = [(0.0, 0.085 + (SIDE + 0.004) * k) for k in range(others + 1)]
    plant = hand_over(row, above=0.0)
    before = [np.array(item.position) for item in plant.truth().objects]
    rotation = tcp()[1]
    move(plant, tuple(0.05 * rotation[:, 1]), 0.6, gripper="open")
    after = [np.array(item.position) for item in plant.truth().objects]
    assert gaps(plant) >= SIDE - 1e-3
    assert min(float(np.linalg.norm(b - a)) for a, b in zip(before, after, strict=True)) > 0.004


def test_a_cube_at_a_wall_does_not_go_into_it():
    plant = hand_over([(0.0, 0.085)], above=0.0, solids=[("wall", 0.0, 0.085 + 0.5 * SIDE + 0.05 + 0.005, 0.1)])
    rotation = tcp()[1]
    wall = tcp()[0] + rotation @ np.array([0.0, 0.085 + 0.5 * SIDE + 0.005, 0.0])
    move(plant, tuple(0.05 * rotation[:, 1]), 0.6, gripper="open")
    cube = plant.truth().objects[0]
    assert float((wall - np.array(cube.position)) @ rotation[:, 1]) >= 0.5 * SIDE - 1e-3
