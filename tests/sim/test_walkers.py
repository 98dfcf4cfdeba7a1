"""Agents that walk: ORCA and social forces, among each other, walls and the robot."""

import math

import msgspec
import numpy as np
import pytest
from sim_scenes import box, least_gap, scene, track_of

from motm_twin.model.names import SceneError
from motm_twin.model.scene import Agent
from motm_twin.model.state import state_hash
from motm_twin.plants import make_plant
from motm_twin.sim.crowd import walk
from motm_twin.sim.plant import SimulatedPlant

WALKS = ("orca", "social_force")
FAR = (0.0, -9.0, 0.0)


def person(name, start, goal, behaviour, **more):
    heading = math.atan2(goal[1] - start[1], goal[0] - start[0])
    given = {"speed": 1.0, "radius": 0.3, "height": 1.7, "acceleration": 4.0, "kind": "person"} | more
    return Agent(name=name, start=(*start, heading), waypoints=(goal,), behaviour=behaviour, **given)


def circle(behaviour, count=5, radius=4.0, **more):
    angles = [2.0 * math.pi * i / count + 0.3 * (-1) ** i for i in range(count)]
    starts = [((radius + 0.2 * i) * math.cos(a), radius * math.sin(a)) for i, a in enumerate(angles)]
    return tuple(person(f"p{i}", start, (-start[0], -start[1]), behaviour, **more) for i, start in enumerate(starts))


@pytest.mark.parametrize(("behaviour", "gap"), [("orca", -0.02), ("social_force", -0.10)])
def test_five_who_cross_a_circle_all_arrive_and_keep_apart(behaviour, gap):
    agents = circle(behaviour)
    track = track_of(SimulatedPlant(scene(start=FAR, agents=agents)), 25.0)
    goals = np.array([agent.waypoints[0] for agent in agents])
    assert np.hypot(*(track[-1] - goals).T).max() < 0.3
    assert least_gap(track, 0.3) > gap
    assert np.hypot(*np.diff(track, axis=0).reshape(-1, 2).T).max() <= 1.3 * 0.05 + 1e-6


@pytest.mark.parametrize("behaviour", WALKS)
def test_one_who_sees_the_robot_goes_round_it_and_one_who_does_not_goes_into_it(behaviour):
    for sees in (True, False):
        agent = person("p", (-4.0, 0.02), (4.0, 0.02), behaviour, sees_robot=sees, acceleration=1.5)
        plant = SimulatedPlant(scene(start=(0.0, 0.0, 0.0), agents=(agent,)))
        track = track_of(plant, 20.0)
        assert track[-1, 0, 0] > 3.5
        contacts = plant.truth().contacts
        assert bool(contacts) is not sees
        assert not any(contact.caused_by_robot for contact in contacts)


def test_a_yielding_agent_that_does_not_see_the_robot_drives_into_it_but_not_into_a_box():
    crate = box("crate", (3.0, 0.0), (0.6, 0.6), 0.5, mapped=False)
    agent = Agent(name="a", start=(-3.0, 0.0, 0.0), waypoints=((2.9, 0.0),), sees_robot=False)
    plant = SimulatedPlant(scene(start=(0.0, 0.0, 0.0), agents=(agent,), solids=(crate,)))
    track = track_of(plant, 18.0)
    assert [contact.other for contact in plant.truth().contacts] == ["a"]
    assert track[:, 0, 0].max() < 3.0 - 0.3 - 0.25


@pytest.mark.parametrize("behaviour", WALKS)
def test_one_who_walks_goes_round_a_box_without_touching_it(behaviour):
    crate = box("crate", (0.0, 0.0), (0.8, 0.8), 1.0, mapped=False)
    agent = person("p", (-3.0, 0.1), (3.0, 0.1), behaviour, radius=0.25, acceleration=1.5)
    track = track_of(SimulatedPlant(scene(start=FAR, agents=(agent,), solids=(crate,))), 25.0)[:, 0]
    gaps = np.hypot(*np.maximum(np.abs(track) - 0.4, 0.0).T)
    assert gaps.min() > 0.25 - 0.02
    assert math.dist(track[-1], (3.0, 0.1)) < 0.3


@pytest.mark.parametrize("behaviour", WALKS)
def test_a_run_goes_on_the_same_from_a_snapshot(behaviour):
    plant = SimulatedPlant(scene(start=(0.0, 0.0, 0.0), agents=circle(behaviour)))
    plant.step(2.0)
    kept = plant.snapshot()
    plant.step(3.0)
    first = state_hash(plant.snapshot())
    plant.restore(kept)
    plant.step(3.0)
    assert state_hash(plant.snapshot()) == first
    other = SimulatedPlant(scene(start=(0.0, 0.0, 0.0), agents=circle(behaviour)))
    other.restore(kept)
    other.step(3.0)
    assert state_hash(other.snapshot()) == first


def test_one_with_a_pause_stands_at_every_waypoint_and_goes_back():
    agent = Agent(
        name="p", start=(0.0, 0.0, 0.0), waypoints=((2.0, 0.0), (0.0, 0.0)), behaviour="orca", speed=1.0, pause=2.0
    )
    track = track_of(SimulatedPlant(scene(start=FAR, agents=(agent,))), 14.0)[:, 0]
    steps = np.hypot(*np.diff(track, axis=0).T) / 0.05
    assert 20 <= (steps[20:160] < 0.02).sum() <= 40  # of the two seconds that it brakes and stands
    assert track[:, 0].max() < 2.1
    assert track[100:, 0].min() < 0.2


def test_velocity_changes_no_faster_than_the_acceleration():
    pose, v = np.zeros(3), 1.0
    before = np.array([1.0, 0.0])
    for _ in range(200):
        pose, v = walk(pose, v, np.array([-1.0, 0.2]), 1.5, 0.01)
        now = v * np.array([math.cos(pose[2]), math.sin(pose[2])])
        assert np.hypot(*(now - before)) <= 1.5 * 0.01 + 0.04  # one that turns on the spot keeps no direction
        before = now
    assert np.allclose(before, [-1.0, 0.2])


def test_orca_without_pyrvo_says_what_to_install(monkeypatch):
    monkeypatch.setattr("motm_twin.model.rvo.find_spec", lambda name: None)
    with pytest.raises(SceneError, match=r'pip install "motm_twin\[people\]"'):
        make_plant(scene(start=FAR, agents=circle("orca")))
    make_plant(scene(start=FAR, agents=circle("social_force")))


def test_fields_that_came_later_change_a_hash_only_when_they_are_used():
    agent = Agent(name="a", start=(0.0, 0.0, 0.0))
    assert state_hash(msgspec.structs.replace(agent, sees_robot=True)) == state_hash(agent)
    assert state_hash(msgspec.structs.replace(agent, sees_robot=False)) != state_hash(agent)
    assert state_hash(msgspec.structs.replace(agent, pause=1.0)) != state_hash(agent)
