import math

import numpy as np
import pytest
from edit_scenes import body, room
from sim_hands import act, cube_of
from sim_scenes import box, scene

from motm_twin.model.edits import AddObstacle, MoveBody, MoveObject, ReleaseBody
from motm_twin.model.scene import Agent
from motm_twin.sim.bodies import FASTEST, FRICTION
from motm_twin.sim.plant import SimulatedPlant


def thrown(velocity, start=(0.0, -3.0), shape="box", solids=(), **changes):
    plant = SimulatedPlant(scene(solids=solids, **changes))
    plant.apply(AddObstacle(name="it", shape=shape, x=start[0], y=start[1], size=(0.4, 0.4, 0.5)))
    plant.apply(ReleaseBody(name="it", velocity=velocity))
    return plant


@pytest.mark.parametrize("shape", ["box", "cylinder", "temi", "person"])
@pytest.mark.parametrize("speed", [0.5, 1.5, 10.0])
def test_a_thrown_body_slides_as_far_as_friction_lets_it(shape, speed):
    plant = thrown((0.6 * speed, 0.8 * speed), start=(-1.0, 1.0), shape=shape)
    plant.step(0.05)
    assert body(plant, "it").state == "sliding"
    plant.step(2.0)
    way = np.array(body(plant, "it").position[:2]) - (-1.0, 1.0)
    first = min(speed, FASTEST)
    np.testing.assert_allclose(way, np.array([0.6, 0.8]) * first**2 / (2.0 * FRICTION), rtol=0.01)
    assert body(plant, "it").state in ("", "standing")


@pytest.mark.parametrize("shape", ["box", "temi"])
@pytest.mark.parametrize("thickness", [0.5, 0.01])
def test_a_thrown_body_stops_at_a_wall_of_any_thickness(shape, thickness):
    wall = box("wall", (1.5 + 0.5 * thickness, -3.0), (thickness, 3.0), 1.0)
    plant = thrown((3.0, 0.0), shape=shape, solids=(wall,))
    plant.step(2.0)
    reach = 0.25 if shape == "temi" else 0.2
    assert 1.5 - reach - 0.003 < body(plant, "it").position[0] <= 1.5 - reach + 1e-9


def test_a_thrown_box_passes_under_a_high_table_and_a_thrown_temi_does_not():
    slab = box("slab", (1.0, -3.0), (0.5, 3.0), 0.78, z_min=0.75)
    low = thrown((3.0, 0.0), solids=(slab,))
    low.step(2.0)
    assert body(low, "it").position[0] > 2.0
    tall = thrown((3.0, 0.0), shape="temi", solids=(slab,))
    tall.step(2.0)
    assert body(tall, "it").position[0] <= 0.5


def test_a_thrown_body_stops_at_other_bodies_that_stand_or_slide():
    plant = thrown((2.5, 0.0))
    plant.apply(AddObstacle(name="other", shape="temi", x=1.2, y=-3.0))
    plant.step(2.0)
    assert body(plant, "it").position[0] <= 1.2 - 0.25 - 0.2 + 1e-9
    plant.apply(AddObstacle(name="a", x=-2.0, y=2.0, size=(0.4, 0.4, 0.5)))
    plant.apply(AddObstacle(name="b", x=0.0, y=2.0, size=(0.4, 0.4, 0.5)))
    plant.apply(ReleaseBody(name="a", velocity=(3.0, 0.0)))
    plant.apply(ReleaseBody(name="b", velocity=(-3.0, 0.0)))
    plant.step(2.0)
    assert 0.4 - 1e-9 <= body(plant, "b").position[0] - body(plant, "a").position[0] < 0.45


@pytest.mark.parametrize(("shape", "part"), [("box", "base"), ("person", "panda_link7")])
@pytest.mark.parametrize("speed", [0.0, 0.3])
def test_a_body_thrown_at_the_robot_stops_at_contact_and_that_is_the_persons_doing(shape, part, speed):
    plant = thrown((-3.0, 0.0), start=(1.6, 0.0), shape=shape)
    plant.command(act((speed, 0.0)))
    plant.step(0.5)
    plant.command(act())
    plant.step(1.5)
    hits = {item.body: item for item in plant.truth().contacts}
    assert part in hits
    assert not any(item.caused_by_robot for item in hits.values())
    assert hits[part].other == "it"
    assert hits[part].other_speed > 1.0
    if speed == 0.0:
        assert all(item.depth < 0.005 for item in hits.values())


def test_a_body_stuck_in_the_robot_can_be_thrown_out_of_it():
    plant = SimulatedPlant(scene())
    plant.apply(AddObstacle(name="it", x=0.4, y=0.0, size=(0.4, 0.4, 0.3)))
    plant.apply(ReleaseBody(name="it", velocity=(2.0, 0.0)))
    plant.step(1.5)
    assert body(plant, "it").position[0] > 1.2


def test_a_thrown_agent_goes_on_with_its_round():
    agent = Agent(name="temi", start=(0.0, 2.0, 0.0), waypoints=((2.0, 2.0), (0.0, 2.0)))
    plant = SimulatedPlant(scene(start=(-2.0, -3.0, 0.0), agents=(agent,)))
    plant.apply(MoveBody(name="temi", x=1.0, y=2.0))
    plant.apply(ReleaseBody(name="temi", velocity=(0.0, 2.0)))
    plant.step(0.3)
    assert body(plant, "temi").state == "sliding"
    plant.step(1.0)
    assert body(plant, "temi").position[1] > 2.8
    for _ in range(200):
        plant.step(0.1)
    assert abs(body(plant, "temi").position[1] - 2.0) < 0.3


def test_a_cube_on_a_thrown_box_slides_with_it():
    plant = SimulatedPlant(room())
    plant.apply(MoveObject(name="cube1", x=-2.0, y=-2.0))
    plant.apply(ReleaseBody(name="crate", velocity=(0.0, -1.0)))
    plant.step(1.0)
    crate = body(plant, "crate")
    assert crate.position[1] == pytest.approx(-2.25, abs=0.01)
    np.testing.assert_allclose(cube_of(plant, "cube1").position[:2], crate.position[:2], atol=1e-9)
    assert cube_of(plant, "cube1").state == "resting"
    assert plant.truth().plant_faults == ()


def test_furniture_is_too_heavy_to_be_thrown_and_a_grabbed_body_stops():
    plant = SimulatedPlant(room())
    plant.apply(ReleaseBody(name="table", velocity=(2.0, 0.0)))
    plant.step(0.5)
    assert plant.truth().furniture == ()
    plant.apply(ReleaseBody(name="crate", velocity=(2.0, 0.0)))
    plant.step(0.2)
    plant.apply(MoveBody(name="crate", x=0.0, y=-3.0))
    plant.step(0.5)
    assert body(plant, "crate").position[:2] == (0.0, -3.0)


@pytest.mark.parametrize("shape", ["box", "cylinder", "temi"])
def test_the_clearance_to_a_body_that_slides_past_is_exact(shape):
    plant = thrown((0.0, 3.0), start=(1.0, -1.5), shape=shape)
    plant.step(2.0)
    assert body(plant, "it").position[1] > 0.5
    reach = 0.25 if shape == "temi" else 0.2
    assert plant.truth().min_base_clearance == pytest.approx(1.0 - reach - 0.35, abs=1e-6)
    assert plant.truth().contacts == ()


def test_a_throw_that_is_no_number_is_refused():
    plant = SimulatedPlant(room())
    with pytest.raises(ValueError, match="velocity"):
        plant.apply(ReleaseBody(name="crate", velocity=(math.inf, 0.0)))
