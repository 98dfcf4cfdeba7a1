import math

import numpy as np
import pytest
from sim_hands import act
from sim_scenes import box, experiment, scene, temis

from motm_twin.model.edits import AddObstacle, MoveBody, ReleaseBody, RemoveBody
from motm_twin.model.scene import Agent, Noise, SceneObject
from motm_twin.model.state import state_hash
from motm_twin.sim.plant import SimulatedPlant
from motm_twin.sim.sensors import Localisation


def drive_about(plant, seconds, seed=0):
    rng = np.random.default_rng(seed)
    for _ in range(round(seconds / 0.05)):
        plant.command(act(rng.uniform(-0.5, 0.5, 2), rng.uniform(-1, 1, 7), str(rng.choice(["open", "close"]))))
        plant.step(0.05)
    return state_hash(plant.snapshot())


def test_same_seed_same_hash_and_another_seed_another():
    first, again = SimulatedPlant(experiment(agents=temis())), SimulatedPlant(experiment(agents=temis()))
    other = SimulatedPlant(experiment(agents=temis(), seed=2))
    assert state_hash(first.snapshot()) == state_hash(again.snapshot())
    hashes = [drive_about(plant, 5.0) for plant in (first, again, other)]
    assert hashes[0] == hashes[1] != hashes[2]


def test_a_restored_plant_continues_to_the_same_hash():
    plant = SimulatedPlant(experiment(agents=temis()))
    drive_about(plant, 4.0)
    plant.apply(AddObstacle(name="crate", x=1.0, y=0.6))
    kept = plant.snapshot()
    first = drive_about(plant, 4.0, seed=1)
    plant.apply(RemoveBody(name="crate"))
    drive_about(plant, 1.0, seed=2)
    plant.restore(kept)
    assert drive_about(plant, 4.0, seed=1) == first
    fresh = SimulatedPlant(experiment(agents=temis()))
    fresh.restore(kept)
    assert drive_about(fresh, 4.0, seed=1) == first


def test_five_small_steps_are_one_big_step():
    big, small = SimulatedPlant(experiment(agents=temis())), SimulatedPlant(experiment(agents=temis()))
    for plant in (big, small):
        plant.command(act((0.3, 0.2), 0.3 * np.ones(7)))
    big.step(0.5)
    for _ in range(50):
        small.step(0.01)
    assert state_hash(big.snapshot()) == state_hash(small.snapshot())


def test_observing_changes_nothing():
    plant = SimulatedPlant(experiment())
    before = state_hash(plant.snapshot())
    seen = plant.observe()
    seen.pose[0] = seen.q[0] = 99.0
    plant.truth()
    assert state_hash(plant.snapshot()) == before


@pytest.mark.parametrize("dt", [0.0, -0.01, 0.015, 0.004])
def test_a_step_that_is_no_multiple_of_the_substep_is_refused(dt):
    with pytest.raises(ValueError, match="multiple"):
        SimulatedPlant(scene()).step(dt)


def test_without_noise_the_robot_is_told_the_truth():
    plant = SimulatedPlant(scene(start=(1.0, 2.0, 0.5)))
    plant.command(act((0.4, 0.3)))
    plant.step(3.0)
    seen, pose = plant.observe(), plant.truth().pose
    np.testing.assert_allclose(seen.pose, pose)
    c, s = math.cos(0.5), math.sin(0.5)
    dx, dy = pose[0] - 1.0, pose[1] - 2.0
    np.testing.assert_allclose(seen.odometry, [c * dx + s * dy, -s * dx + c * dy, pose[2] - 0.5], atol=1e-9)
    np.testing.assert_allclose(seen.twist, [0.4, 0.3], atol=1e-9)


def test_localisation_errs_by_the_given_sd_and_slowly():
    localisation = Localisation(Noise(localisation_correlation_time=0.5), 0.01)
    state = localisation.start(np.zeros(3), np.random.default_rng(4))
    errors = []
    for _ in range(30000):
        localisation.step(state, np.zeros(3), np.zeros(2), np.zeros(2))
        errors.append(state.pose)
    np.testing.assert_allclose(np.std(errors, axis=0), [0.01, 0.01, math.radians(0.5)], rtol=0.12)
    lagged = [np.corrcoef(np.array(errors)[:-50, i], np.array(errors)[50:, i])[0, 1] for i in range(3)]
    np.testing.assert_allclose(lagged, math.exp(-1.0), atol=0.12)


def test_odometry_drifts_by_a_fixed_small_share_of_the_way():
    shares = []
    for seed in range(30):
        localisation = Localisation(Noise(), 0.01)
        state = localisation.start(np.zeros(3), np.random.default_rng(seed))
        for _ in range(100):
            localisation.step(state, np.zeros(3), np.array([0.5, 0.0]), np.array([0.5, 0.0]))
        shares.append(state.odometry[0] / 0.5 - 1.0)
    assert 0.001 < np.std(shares) < 0.006


def test_added_obstacles_are_seen_by_the_lidar_move_and_go_again():
    plant = SimulatedPlant(scene())
    plant.apply(AddObstacle(name="crate", x=1.55, y=0.0))
    plant.step(0.05)
    assert plant.observe().scan.ranges[360] == pytest.approx(1.3)
    plant.apply(MoveBody(name="crate", x=2.55, y=0.0))
    plant.step(0.05)
    assert plant.observe().scan.ranges[360] == pytest.approx(2.3)
    assert [item.name for item in plant.truth().obstacles] == ["crate"]
    plant.apply(RemoveBody(name="crate"))
    plant.step(0.05)
    assert np.isinf(plant.observe().scan.ranges).all()


def test_a_box_of_the_scene_that_the_map_does_not_know_can_be_moved_and_removed():
    plant = SimulatedPlant(scene(solids=(box("crate", (1.55, 0.0), (0.5, 0.5), 0.6, mapped=False),)))
    plant.apply(MoveBody(name="crate", x=2.55, y=0.0))
    plant.step(0.05)
    assert plant.observe().scan.ranges[360] == pytest.approx(2.3)
    plant.apply(RemoveBody(name="crate"))
    plant.step(0.05)
    assert np.isinf(plant.observe().scan.ranges).all()


def test_a_contact_that_a_person_makes_is_not_the_robots():
    plant = SimulatedPlant(scene())
    plant.command(act((0.3, 0.0)))
    plant.step(2.0)
    plant.apply(AddObstacle(name="crate", x=float(plant.truth().pose[0]) + 0.5, y=0.0))
    plant.step(0.5)
    (hit,) = (item for item in plant.truth().contacts if "base" in item.bodies)
    assert hit.closing_speed > 0.02
    assert not hit.caused_by_robot


def test_a_held_agent_stays_where_it_is_put_and_drives_on_when_released():
    agent = Agent(name="temi", start=(3.0, 0.0, 0.0), waypoints=((6.0, 0.0), (3.0, 0.0)))
    plant = SimulatedPlant(scene(agents=(agent,)))
    plant.step(1.0)
    plant.apply(MoveBody(name="temi", x=2.0, y=2.0, heading=1.0))
    plant.step(1.0)
    (body,) = plant.truth().agents
    assert (body.position[:2], body.yaw, body.state) == ((2.0, 2.0), 1.0, "held")
    plant.apply(ReleaseBody(name="temi"))
    plant.step(3.0)
    assert plant.truth().agents[0].position[0] > 2.2


@pytest.mark.parametrize(
    ("edit", "message"),
    [
        (AddObstacle(name="desk", x=1.0, y=0.0), "taken"),
        (AddObstacle(name="new", shape="cone", x=1.0, y=0.0), "box, cylinder, temi"),
        (AddObstacle(name="new", x=math.nan, y=0.0), "allowed is -100 to 100 m"),
        (AddObstacle(name="new", x=1e9, y=0.0), "allowed is -100 to 100 m"),
        (AddObstacle(name="new", x=1.0, y=0.0, size=(0.5, -0.5, 0.5)), "size"),
        (MoveBody(name="dsek", x=1.0, y=0.0), "not an agent"),
        (MoveBody(name="desk", x=math.inf, y=0.0), "allowed is -100 to 100 m"),
        (RemoveBody(name="temi9"), "loose"),
    ],
)
def test_an_edit_that_cannot_be_is_refused_with_the_reason_and_changes_nothing(edit, message):
    plant = SimulatedPlant(experiment(agents=temis(1)))
    before = state_hash(plant.snapshot())
    for attempt in (plant.rehearsal().accept, plant.apply):
        with pytest.raises(ValueError, match=message):
            attempt(edit)
    assert state_hash(plant.snapshot()) == before


def test_edits_that_wait_are_taken_into_account_when_the_next_is_checked():
    plant = SimulatedPlant(scene(solids=(box("crate", (2.0, 0.0), (0.5, 0.5), 0.6, mapped=False),)))
    added = AddObstacle(name="new", x=1.0, y=2.0)
    rehearsal = plant.rehearsal()
    rehearsal.accept(added)
    with pytest.raises(ValueError, match="taken"):
        rehearsal.accept(added)
    rehearsal.accept(MoveBody(name="new", x=1.0, y=1.0))
    gone = RemoveBody(name="crate")
    rehearsal.accept(gone)
    with pytest.raises(ValueError, match="loose"):
        rehearsal.accept(gone)
    plant.apply(gone)
    with pytest.raises(ValueError, match="loose"):
        plant.apply(MoveBody(name="crate", x=0.0, y=2.0))


def test_a_cube_falls_when_the_box_under_it_is_taken_away():
    cube = SceneObject(name="cube", position=(2.0, 0.0, 0.62))
    plant = SimulatedPlant(scene(solids=(box("crate", (2.0, 0.0), (0.5, 0.5), 0.6, mapped=False),), objects=(cube,)))
    plant.step(0.5)
    assert plant.truth().objects[0].state == "resting"
    plant.apply(RemoveBody(name="crate"))
    plant.step(1.0)
    assert plant.truth().objects[0].state == "dropped"
    assert plant.truth().objects[0].position[2] == pytest.approx(0.02)
