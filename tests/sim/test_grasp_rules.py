"""The rule that came from contact dynamics, beside the strict one."""

import msgspec
import numpy as np
import pytest
from sim_hands import DOWN, move, over_a_cube, tcp

from motm_twin.model.scene import SceneObject
from motm_twin.sim.plant import SimulatedPlant


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
