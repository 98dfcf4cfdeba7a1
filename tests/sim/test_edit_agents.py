import math

import numpy as np
import pytest
from edit_scenes import body, room
from sim_hands import act
from sim_scenes import QUIET, box, scene

from motm_twin.model.edits import AddObstacle, FreezeBody, MoveBody, ReleaseBody, RemoveBody, SendAgent, SetBehaviour
from motm_twin.model.scene import Agent
from motm_twin.sim.plant import SimulatedPlant


def positions(plant, name, seconds):
    track = []
    for _ in range(round(seconds / 0.1)):
        plant.step(0.1)
        track.append(body(plant, name).position[:2])
    return np.array(track)


@pytest.mark.parametrize(("shape", "height", "speed"), [("temi", 1.0, 0.4), ("person", 1.7, 1.0)])
def test_an_added_agent_stands_until_it_is_sent_and_then_goes_there_and_stands(shape, height, speed):
    plant = SimulatedPlant(scene())
    plant.apply(AddObstacle(name="new", shape=shape, x=-1.5, y=-2.0, heading=0.5))
    standing = positions(plant, "new", 2.0)
    np.testing.assert_array_equal(standing, [(-1.5, -2.0)] * 20)
    new = body(plant, "new")
    assert (new.kind, new.state, new.size) == (shape, "standing", (0.5, 0.5, height))
    assert plant.truth().agents == ()
    plant.apply(SendAgent(name="new", x=4.0, y=-2.0))
    track = positions(plant, "new", 25.0)
    np.testing.assert_allclose(track[-1], (4.0, -2.0), atol=0.06)
    assert body(plant, "new").state == "standing"
    ways = np.hypot(*np.diff(track, axis=0).T) / 0.1
    assert 0.9 * speed < ways.max() <= speed + 1e-9
    np.testing.assert_array_equal(track[-1], track[-20])


def test_a_sent_agent_goes_round_what_is_in_its_way():
    plant = SimulatedPlant(scene(start=(-2.0, -3.0, 0.0), solids=(box("wall", (1.5, 0.0), (0.3, 1.6), 1.0),)))
    plant.apply(AddObstacle(name="guest", shape="person", x=0.0, y=0.0))
    plant.apply(SendAgent(name="guest", x=3.0, y=0.0))
    track = positions(plant, "guest", 30.0)
    np.testing.assert_allclose(track[-1], (3.0, 0.0), atol=0.06)
    gaps = np.hypot(np.maximum(np.abs(track[:, 0] - 1.5) - 0.15, 0), np.maximum(np.abs(track[:, 1]) - 0.8, 0))
    assert gaps.min() > 0.25


def test_an_agent_with_a_round_goes_to_the_point_and_then_on_with_its_round():
    plant = SimulatedPlant(room())
    plant.step(1.0)
    plant.apply(SendAgent(name="temi", x=1.0, y=1.5))
    track = positions(plant, "temi", 40.0)
    assert np.hypot(*(track - (1.0, 1.5)).T).min() < 0.2
    assert track[-100:, 1].max() > 3.3
    assert np.ptp(track[-100:, 0]) > 1.0


@pytest.mark.parametrize("shape", ["temi", "person"])
@pytest.mark.parametrize("behaviour", ["yield", "blind", "orca"])
def test_an_agent_behaves_as_it_is_told(shape, behaviour):
    if behaviour == "orca":
        pytest.importorskip("pyrvo")
    plant = SimulatedPlant(scene(start=(0.0, 0.0, 0.0)))  # the robot stands in the way
    plant.apply(AddObstacle(name="new", shape=shape, x=-2.5, y=0.05))
    plant.apply(SetBehaviour(name="new", behaviour=behaviour))
    plant.apply(SendAgent(name="new", x=3.0, y=0.0))
    track = positions(plant, "new", 20.0)
    assert body(plant, "new").behaviour == behaviour
    contacts = plant.truth().contacts
    assert (len(contacts) > 0) == (behaviour == "blind"), contacts
    assert behaviour == "yield" or track[-1, 0] > 2.9


def test_a_behaviour_is_refused_for_what_is_no_agent_and_without_its_extra(monkeypatch):
    plant = SimulatedPlant(room())
    with pytest.raises(ValueError, match="'crate' is not an agent"):
        plant.apply(SetBehaviour(name="crate", behaviour="blind"))
    with pytest.raises(ValueError, match="behaviour"):
        plant.apply(SetBehaviour(name="temi", behaviour="rude"))
    monkeypatch.setattr("motm_twin.model.rvo.find_spec", lambda _: None)
    with pytest.raises(ValueError, match=r"motm_twin\[people\]"):
        plant.apply(SetBehaviour(name="temi", behaviour="orca"))


@pytest.mark.parametrize("waypoints", [(), ((0.0, 3.5), (-2.0, 3.5))])
def test_an_agent_that_cannot_get_to_where_it_was_sent_gives_up(waypoints):
    agent = Agent(name="temi", start=(0.0, 2.0, 0.0), waypoints=waypoints)
    plant = SimulatedPlant(scene(start=(-2.0, -3.0, 0.0), agents=(agent,)))
    plant.apply(AddObstacle(name="guest", shape="person", x=2.5, y=2.0))
    plant.apply(SendAgent(name="temi", x=2.5, y=2.0))
    track = positions(plant, "temi", 70.0)
    away = np.hypot(*(track - (2.5, 2.0)).T)
    assert 0.5 < away.min() < 0.8
    if waypoints:
        assert away[-1] > 1.5
    else:
        assert body(plant, "temi").state == "standing"


def test_nobody_is_sent_into_furniture_and_only_agents_are_sent():
    plant = SimulatedPlant(room())
    with pytest.raises(ValueError, match="'cabinet' stands there"):
        plant.apply(SendAgent(name="temi", x=-2.0, y=2.0))
    with pytest.raises(ValueError, match="not an agent here; did you mean temi"):
        plant.apply(SendAgent(name="temmi", x=0.0, y=2.0))
    with pytest.raises(ValueError, match="not an agent"):
        plant.apply(SendAgent(name="crate", x=0.0, y=2.0))
    with pytest.raises(ValueError, match="x nan m"):
        plant.apply(SendAgent(name="temi", x=math.nan, y=2.0))


def test_a_frozen_agent_stands_still_and_goes_on_when_it_thaws():
    plant = SimulatedPlant(room())
    plant.step(2.0)
    plant.apply(FreezeBody(name="temi"))
    track = positions(plant, "temi", 2.0)
    assert np.ptp(track, axis=0).max() == 0.0
    assert body(plant, "temi").state == "frozen"
    plant.apply(FreezeBody(name="temi", frozen=False))
    assert np.ptp(positions(plant, "temi", 2.0), axis=0).max() > 0.4
    with pytest.raises(ValueError, match="not an agent"):
        plant.apply(FreezeBody(name="crate"))


def test_an_added_agent_that_is_held_stays_and_says_so():
    plant = SimulatedPlant(scene())
    plant.apply(AddObstacle(name="guest", shape="person", x=2.0, y=0.0))
    plant.apply(SendAgent(name="guest", x=2.0, y=3.0))
    plant.apply(MoveBody(name="guest", x=3.0, y=0.0))
    np.testing.assert_array_equal(positions(plant, "guest", 1.0), [(3.0, 0.0)] * 10)
    assert body(plant, "guest").state == "held"
    plant.apply(ReleaseBody(name="guest"))
    np.testing.assert_allclose(positions(plant, "guest", 12.0)[-1], (2.0, 3.0), atol=0.06)


def test_agents_give_way_to_each_other_whoever_added_them():
    a = Agent(name="a", start=(0.0, 0.0, 0.0), waypoints=((4.0, 0.0), (0.0, 0.0)))
    plant = SimulatedPlant(scene(start=(-2.0, -3.0, 0.0), agents=(a,)))
    plant.apply(AddObstacle(name="guest", shape="person", x=4.0, y=0.05, heading=math.pi))
    plant.apply(SendAgent(name="guest", x=0.0, y=0.05))
    least = math.inf
    for _ in range(300):
        plant.step(0.1)
        p, q = body(plant, "a").position, body(plant, "guest").position
        least = min(least, math.hypot(p[0] - q[0], p[1] - q[1]) - 0.5)
    assert least > 0.0


def test_lidar_camera_and_gripper_distance_know_added_agents():
    plant = SimulatedPlant(scene(noise=QUIET))
    plant.apply(AddObstacle(name="guest", shape="person", x=2.0, y=0.0))
    plant.step(0.05)
    assert plant.observe().scan.ranges[360] == pytest.approx(1.75)
    hand = plant._state.tcp
    assert plant.truth().ee_obstacle == pytest.approx(2.0 - hand[0] - 0.25, abs=1e-3)


def test_the_referee_sees_a_person_and_how_fast_it_comes():
    blind = Agent(name="temi", start=(2.0, 0.0, math.pi), waypoints=((-2.0, 0.0),), behaviour="blind")
    plant = SimulatedPlant(scene(agents=(blind,)))
    plant.apply(AddObstacle(name="guest", shape="person", x=-2.0, y=2.0))
    plant.step(4.0)
    (hit,) = (item for item in plant.truth().contacts if "base" in item.bodies)
    assert (hit.other, hit.caused_by_robot) == ("temi", False)
    assert hit.other_speed == pytest.approx(0.4, abs=0.01)
    plant.apply(MoveBody(name="guest", x=-0.8, y=0.0))
    plant.apply(ReleaseBody(name="guest"))
    plant.step(1.0)
    plant.command(act((-0.2, 0.0)))
    plant.step(4.0)
    assert any(item.other == "guest" and item.caused_by_robot for item in plant.truth().contacts)


def test_added_agents_are_removed_without_a_trace_and_their_name_is_free_again():
    plant = SimulatedPlant(scene())
    plant.apply(AddObstacle(name="guest", shape="person", x=2.0, y=0.0))
    with pytest.raises(ValueError, match=r"^name 'guest' is taken: choose another$"):
        plant.apply(AddObstacle(name="guest", x=3.0, y=0.0))
    with pytest.raises(ValueError, match=r"^the name is empty: choose one$"):
        plant.apply(AddObstacle(name="", x=3.0, y=0.0))
    plant.apply(RemoveBody(name="guest"))
    plant.step(0.05)
    assert np.isinf(plant.observe().scan.ranges).all()
    assert (plant.truth().obstacles, plant.truth().removed) == ((), ())
    plant.apply(AddObstacle(name="guest", x=3.0, y=0.0))


def test_not_more_bodies_than_the_world_can_take():
    plant = SimulatedPlant(scene())
    for k in range(100):
        plant.apply(AddObstacle(name=f"b{k}", shape="temi" if k % 25 == 0 else "box", x=5.0 + 0.9 * k, y=-3.0 + k % 7))
    with pytest.raises(ValueError, match="100 added bodies"):
        plant.apply(AddObstacle(name="one more", x=3.0, y=0.0))
