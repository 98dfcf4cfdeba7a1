"""What robot and world do otherwise than the robot is told."""

import copy
import math

import msgspec
import numpy as np
import pytest
from sim_scenes import QUIET, experiment, scene

from motm_twin.model.known import known_world
from motm_twin.model.plant import SUBSTEP, Actuation
from motm_twin.model.scene import EARLIER_NOISE, Mismatch
from motm_twin.sim.plant import SimulatedPlant
from motm_twin.sim.sensors import Localisation


def drive(plant, v, count, rate=0.0):
    """Twists and joint rates measured after each 10 ms of a command."""
    twists, rates = [], []
    for _ in range(count):
        plant.command(Actuation(twist=np.array([v, 0.0]), joint_velocity=np.full(7, rate), gripper="open"))
        plant.step(0.01)
        twists.append(float(plant.observe().twist[0]))
        rates.append(float(plant.observe().dq[6]))
    return np.array(twists), np.array(rates)


def test_commands_act_late_and_in_their_order():
    plain = drive(SimulatedPlant(scene()), 0.4, 60, rate=0.2)
    late = drive(SimulatedPlant(scene(mismatch=Mismatch(command_delay=0.2))), 0.4, 60, rate=0.2)
    for usual, delayed in zip(plain, late, strict=True):
        assert not delayed[:20].any()
        np.testing.assert_array_equal(delayed[20:], usual[:40])


def test_late_commands_are_part_of_the_state():
    plant = SimulatedPlant(scene(mismatch=Mismatch(command_delay=0.1)))
    drive(plant, 0.4, 15)
    saved = plant.snapshot()
    first = drive(plant, 0.0, 30)[0]
    plant.restore(saved)
    np.testing.assert_array_equal(drive(plant, 0.0, 30)[0], first)


def test_a_base_lags_and_is_faster_than_told():
    lagging = drive(SimulatedPlant(scene(mismatch=Mismatch(base_lag=0.2))), 0.02, 30)[0]
    assert lagging[-1] == pytest.approx(0.02 * (1.0 - math.exp(-1.0)), rel=1e-6)  # 0.3 s with the profile's 0.1 s
    fast = drive(SimulatedPlant(scene(mismatch=Mismatch(base_scale=0.08))), 0.3, 200)[0]
    assert fast[-1] == pytest.approx(1.08 * 0.3)


def test_the_map_is_off_with_all_that_is_on_it_and_the_world_is_not():
    plain = experiment(noise=QUIET)
    off = msgspec.structs.replace(plain, mismatch=Mismatch(map_offset=0.04))
    right, wrong = known_world(plain), known_world(off)
    ways = [np.subtract(b.position, a.position)[:2] for a, b in zip(right.objects, wrong.objects, strict=True)]
    ways += [np.subtract(b.centre, a.centre) for a, b in zip(right.bins, wrong.bins, strict=True)]
    ways += [np.subtract(b.shape.centre, a.shape.centre) for a, b in zip(right.solids, wrong.solids, strict=True)]
    assert np.hypot(*ways[0]) == pytest.approx(0.04)
    np.testing.assert_allclose(ways, np.tile(ways[0], (len(ways), 1)), atol=1e-12)


def test_what_carries_objects_is_lower_in_the_map_with_them():
    plain = experiment(noise=QUIET)
    right, wrong = known_world(plain), known_world(msgspec.structs.replace(plain, mismatch=Mismatch(table_height=0.01)))
    lower = {a.name: a.z_max - b.z_max for a, b in zip(right.solids, wrong.solids, strict=True)}
    assert lower.pop("slab") == pytest.approx(0.01)
    assert not any(lower.values())
    assert [a.position[2] - b.position[2] for a, b in zip(right.objects, wrong.objects, strict=True)] == pytest.approx(
        [0.01, 0.01]
    )


def test_localisation_drifts_slowly_by_as_much_as_it_should():
    noise = msgspec.structs.replace(QUIET, localisation_drift_sd=0.02, localisation_drift_time=60.0)
    errors = []
    for seed in range(60):
        localisation = Localisation(noise, SUBSTEP)
        state = localisation.start(np.zeros(3), np.random.default_rng(seed))
        begin = state.pose[:2]
        for _ in range(round(0.5 / SUBSTEP)):
            localisation.step(state, np.zeros(3), (0.0, 0.0), (0.0, 0.0))
        errors.append((begin, state.pose[:2]))
    begins, ends = np.array(errors).transpose(1, 0, 2)
    assert begins.std() == pytest.approx(0.02, rel=0.25)
    assert (ends - begins).std() == pytest.approx(0.02 * math.sqrt(2.0 * 0.5 / 60.0), rel=0.25)
    plant = SimulatedPlant(scene(noise=noise))
    state = copy.deepcopy(plant._state.localisation)
    plant.step(SUBSTEP)
    localisation.step(state, np.zeros(3), (0.0, 0.0), (0.0, 0.0))
    assert state.drift and plant.observe().pose.tolist() == state.pose.tolist(), "a plant localises with its scene's"


def test_with_the_earlier_noise_nothing_new_is_drawn():
    plant = SimulatedPlant(experiment(noise=EARLIER_NOISE))
    assert plant._state.localisation.drift == ()
    assert plant._errors.base_scale.tolist() == [1.0, 1.0]
    rates = np.ones(7)
    assert plant._errors.rates(rates, 3) is rates


def test_an_arm_lags_more_than_its_profile_says():
    lagging = drive(SimulatedPlant(scene(mismatch=Mismatch(arm_lag=0.05))), 0.0, 6, rate=0.05)[1]
    assert lagging[-1] == pytest.approx(0.05 * (1.0 - math.exp(-1.0)), rel=1e-6)  # 0.06 s with the profile's 0.01 s
