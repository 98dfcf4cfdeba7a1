"""Delay and lag are found out from what the robot does, and looked past."""

import msgspec
import numpy as np
import pytest

from motm_twin.control.response import Response
from motm_twin.model.edits import InjectFault
from motm_twin.model.plant import Actuation
from motm_twin.model.scene import EARLIER_NOISE, Mismatch
from motm_twin.model.scene_file import load_scene
from motm_twin.model.state import state_hash
from motm_twin.sim.plant import SimulatedPlant

SCENE = msgspec.structs.replace(load_scene("exp1", "trial1", 0), noise=EARLIER_NOISE, detections="named")
SHAKING = msgspec.structs.replace(EARLIER_NOISE, arm_rate_sd=0.035, base_speed_scale_sd=0.08)


def watched(seconds=6.0, noise=EARLIER_NOISE, **mismatch):
    """A response that has watched base and arm go to and fro, and the plant."""
    scene = msgspec.structs.replace(SCENE, mismatch=Mismatch(**mismatch), noise=noise)
    plant, response = SimulatedPlant(scene), Response(scene.robot)
    for k in range(round(seconds / 0.01)):
        reported = plant.observe()
        response.observed(reported)
        there = 1.0 if (k // (80 if k < 600 else 240)) % 2 else -1.0
        actuation = Actuation(
            twist=np.array([0.2 * there, 0.6 * there]), joint_velocity=0.3 * there * np.ones(7), gripper="open"
        )
        response.note_command(actuation, reported)
        plant.command(actuation)
        plant.step(0.01)
    return response, plant


@pytest.mark.parametrize("noise", [EARLIER_NOISE, SHAKING])
@pytest.mark.parametrize("delay", [0.0, 0.05, 0.1, 0.2])
def test_the_delay_is_found_out(delay, noise):
    response, _ = watched(command_delay=delay, noise=noise)
    assert response.delay == pytest.approx(delay, abs=0.011)
    assert response.lag <= 0.05


@pytest.mark.parametrize("noise", [EARLIER_NOISE, SHAKING])
@pytest.mark.parametrize("lag", [0.1, 0.2, 0.3])
def test_the_lag_of_the_base_is_found_out(lag, noise):
    response, _ = watched(30.0, base_lag=lag, noise=noise)
    assert response.lag == pytest.approx(lag, abs=0.051)
    assert response.delay == 0.0


def test_both_are_told_apart():
    response, _ = watched(12.0, command_delay=0.1, base_lag=0.2)
    assert response.delay == pytest.approx(0.1, abs=0.011)
    assert response.lag == pytest.approx(0.2, abs=0.051)


def test_a_robot_that_does_as_it_should_is_reported_as_it_is():
    response, plant = watched()
    now = plant.observe()
    assert response.observed(now) is now


def test_an_observation_is_moved_on_to_when_a_command_acts():
    response, plant = watched(command_delay=0.1)
    seen = response.observed(plant.observe())
    plant.step(0.1)
    then = plant.observe()
    assert (seen.time, seen.ahead) == pytest.approx((then.time, 0.1))
    np.testing.assert_allclose(seen.q, then.q, atol=2e-3)
    np.testing.assert_allclose(seen.twist, then.twist, atol=2e-2)
    np.testing.assert_allclose(seen.odometry, then.odometry, atol=2e-3)


def test_a_report_that_is_late_is_moved_on_by_the_commands_given_since():
    """Control took an arm of half a second ago for that of now, and gave the same command again and again."""
    plant, response = SimulatedPlant(SCENE), Response(SCENE.robot)
    plant.apply(InjectFault(fault="state_delay", seconds=2.0, delay=0.4))
    actuation = Actuation(twist=np.array([0.3, 0.5]), joint_velocity=0.5 * np.ones(7), gripper="open")
    for _ in range(60):
        reported = plant.observe()
        seen, told = response.observed(reported), plant._state.arm.q.copy()
        response.note_command(actuation, reported)
        plant.command(actuation)
        plant.step(0.01)
    assert reported.behind == reported.age == pytest.approx(0.4, abs=0.011)
    assert np.abs(reported.q - told).max() > 0.1
    assert seen.q == pytest.approx(told, abs=0.01)
    assert seen.behind == 0.0
    assert seen.age == reported.age


def test_what_an_external_robot_has_looked_past_itself_is_left_alone():
    response, plant = watched(command_delay=0.1)
    now = msgspec.structs.replace(plant.observe(), ahead=0.05)
    assert response.observed(now) is now


def test_a_base_and_an_arm_that_stand_although_they_were_told_to_move_tell_nothing():
    response, plant = Response(SCENE.robot), SimulatedPlant(SCENE)
    still = plant.observe()
    for k in range(400):
        now = msgspec.structs.replace(still, time=0.01 * k)
        response.observed(now)
        response.note_command(
            Actuation(twist=np.array([0.3, 0.0]), joint_velocity=np.full(7, 0.2), gripper="open"), now
        )
    assert (response.delay, response.lag) == (0.0, 0.0)


def test_state_can_be_copied_and_hashed():
    response, plant = watched(1.0, command_delay=0.1)
    saved, before = response.snapshot(), state_hash(response.snapshot())
    plant.step(0.01)
    response.observed(plant.observe())
    assert state_hash(response.snapshot()) != before
    response.restore(saved)
    assert state_hash(response.snapshot()) == before


def test_old_misfits_become_no_surer_by_waiting():
    """What the base did speaks for a lag of 0.2 s; now it stands, where every lag is the same."""
    response, plant = Response(SCENE.robot), SimulatedPlant(SCENE)
    rest = plant.observe()
    still = Actuation(twist=np.zeros(2), joint_velocity=np.zeros(7), gripper="open")
    response.note_command(still, rest)
    response.observed(rest)
    response._state.of_lag = np.array([[0.1, 0.1, 0.1, 0.1, 0.0, 0.1, 0.1], [1.0] * 7])
    for k in range(1, 400):
        response.observed(msgspec.structs.replace(rest, time=0.01 * k, twist=np.zeros(2), dq=np.zeros(7)))
    assert response.lag == 0.0
