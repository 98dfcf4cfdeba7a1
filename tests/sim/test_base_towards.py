"""Contacts say if the base moved towards the other when they began: a truth beside the verdict."""

import math

import numpy as np
import pytest
from sim_scenes import scene

from motm_twin.model.plant import Actuation
from motm_twin.model.scene import Agent
from motm_twin.sim.plant import SimulatedPlant


def hit(agent, speed, seconds, turning=0.0):
    plant = SimulatedPlant(scene(agents=(agent,)))
    for _ in range(round(seconds / 0.05)):
        plant.command(Actuation(twist=np.array([speed, turning]), joint_velocity=np.zeros(7), gripper="open"))
        plant.step(0.05)
        if contacts := plant.truth().contacts:
            return contacts[0]
    raise AssertionError("no contact")


@pytest.mark.parametrize(("speed", "towards"), [(0.3, True), (0.0, False), (-0.1, False)])
def test_a_base_that_meets_a_blind_agent_head_on_moved_towards_it_unless_it_stood_or_gave_way(speed, towards):
    agent = Agent(name="a", start=(3.0, 0.0, math.pi), waypoints=((-6.0, 0.0),), behaviour="blind", speed=0.6)
    assert hit(agent, speed, 20.0).base_moved_towards is towards


def test_a_base_that_is_hit_in_the_side_while_it_drives_straight_on_did_not_move_towards_the_other():
    agent = Agent(name="a", start=(1.2, -2.0, math.pi / 2), waypoints=((1.2, 4.0),), behaviour="blind", speed=0.6)
    contact = hit(agent, 0.4, 8.0)
    assert contact.base_moved_towards is False


def test_a_base_that_turns_its_corner_into_one_who_stands_moved_towards_it():
    contact = hit(Agent(name="a", start=(0.0, 0.52, 0.0)), 0.0, 5.0, turning=0.4)
    assert contact.base_moved_towards
    assert contact.caused_by_robot
