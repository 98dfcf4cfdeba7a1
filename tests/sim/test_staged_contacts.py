"""Staged contacts: who touched what, in how many episodes, and whose doing it was."""

import math

import coal
import numpy as np
import pytest
import shapely
from shapely import affinity
from sim_contacts import drive, hits, verdicts
from sim_hands import DOWN, act, grasp, move, over_a_cube, tcp
from sim_scenes import box, scene

from motm_twin.model.arm_kernels import HAND
from motm_twin.model.edits import AddObstacle
from motm_twin.model.geometry import rectangle
from motm_twin.model.profile import READY
from motm_twin.model.scene import Agent, Cylinder, SceneObject, Solid
from motm_twin.model.state import state_hash
from motm_twin.sim.plant import SimulatedPlant

# --- by the robot's own motion ---------------------------------------------------------------------------------


@pytest.mark.parametrize("speed", [0.004, 0.015, 0.2, 0.5])
def test_a_base_that_drives_into_a_box_however_slowly_causes_the_contact(speed):
    plant = SimulatedPlant(scene(solids=(box("it", (0.61, 0.0), (0.5, 0.5), 0.3),)))
    drive(plant, speed, round(0.02 / speed + 1.0, 1))
    assert verdicts(plant) == [True]


@pytest.mark.parametrize("speed", [0.1, 0.5, -0.25])
def test_a_base_that_scrapes_along_a_rail_causes_one_contact(speed):
    rail = box("rail", (math.copysign(2.5, speed), 0.748), (3.0, 1.0), 0.3)
    plant = SimulatedPlant(scene(solids=(rail,)))
    drive(plant, speed, round(0.9 / abs(speed) + 1.0, 1))
    assert verdicts(plant) == [True]


def test_a_base_that_turns_its_rear_corner_into_a_post_causes_the_contact():
    post = Solid(name="post", shape=Cylinder(centre=(-0.3, 0.36), radius=0.05), z_min=0.0, z_max=0.4, mapped=True)
    plant = SimulatedPlant(scene(solids=(post,)))
    drive(plant, 0.0, 1.0, yaw_rate=-0.5)
    assert verdicts(plant) == [True]


@pytest.mark.parametrize("sunk", [0.0003, 0.002])
def test_fingers_that_scrape_over_a_plate_cause_one_contact(sunk):
    hand, _ = tcp()
    top = hand[2] - 0.009 + sunk
    plate = box("plate", (hand[0] + 0.25, hand[1]), (0.4, 0.4), top, z_min=top - 0.02)
    plant = SimulatedPlant(scene(solids=(plate,)), arm_start=DOWN)
    drive(plant, 0.3, 0.8)
    (hit,) = hits(plant)
    assert hit.caused_by_robot
    assert set(hit.bodies) == {"panda_leftfinger", "panda_rightfinger"}


@pytest.mark.parametrize("direction", [(0.0, 0.2, 0.0), (0.0, -0.05, 0.0)])
def test_a_held_cube_that_is_swept_sideways_into_a_stand_causes_the_contact(direction):
    hand, _ = tcp()
    way = 0.11 * np.array(direction) / np.linalg.norm(direction)
    other = box("other", (hand[0] + way[0], hand[1] + way[1]), (0.08, 0.08), hand[2] - 0.02 + 0.05 + 0.0015)
    plant = grasp(over_a_cube(solids=(other,)), lift=0.05)
    assert verdicts(plant) == []
    move(plant, direction, round(0.08 / np.linalg.norm(direction), 2))
    assert verdicts(plant, "other") == [True]
    assert hits(plant, "other")[0].body == "held:cube"


def test_a_held_cube_that_the_base_carries_over_the_edge_of_a_stand_causes_the_contact():
    plant = grasp(over_a_cube(), lift=0.05)
    plant.command(act(gripper="close"))
    plant.step(0.5)
    low = float(plant._state.objects[0].bottom)
    x, y, _ = plant.truth().objects[0].position
    stand = AddObstacle(name="other", x=x + 0.2, y=y, size=(0.2, 0.2, low + 0.001))
    plant.apply(stand)
    plant.step(2.5)
    assert verdicts(plant) == []
    plant.command(act((0.4, 0.0), gripper="close"))
    plant.step(0.7)
    (hit,) = hits(plant)
    assert hit.caused_by_robot
    assert hit.body == "held:cube"


def test_a_held_cube_that_is_swept_along_its_support_into_a_step_causes_the_contact():
    hand, _ = tcp()
    step = box("step", (hand[0] + 0.10, hand[1]), (0.1, 0.1), hand[2] - 0.015)
    plant = grasp(over_a_cube(solids=(step,)))
    move(plant, (0.1, 0.0, 0.0), 0.5)
    assert verdicts(plant, "step") == [True]


def test_a_cube_that_stood_close_beside_another_and_is_swept_into_it_causes_the_contact():
    hand, rotation = tcp()
    along = rotation @ np.array([1.0, 0.0, 0.0])
    beside = SceneObject(name="beside", position=tuple(float(v) for v in hand + 0.043 * along))
    shelf = box("shelf", (hand[0], hand[1]), (0.3, 0.3), float(hand[2]) - 0.02)
    cube = SceneObject(name="cube", position=tuple(float(v) for v in hand))
    plant = grasp(SimulatedPlant(scene(solids=(shelf,), objects=(cube, beside)), arm_start=DOWN))
    assert verdicts(plant) == []
    move(plant, tuple(0.1 * along), 0.4)
    assert verdicts(plant, "beside") == [True]
    assert "held:cube" in hits(plant, "beside")[0].bodies


def test_what_touches_with_several_parts_is_one_episode_with_all_of_them():
    hand, _ = tcp()
    wall = box("wall", (hand[0] + 0.20, hand[1]), (0.2, 1.0), 1.5)
    plant = grasp(over_a_cube(solids=(wall,)), lift=0.05)
    move(plant, (0.1, 0.0, 0.0), 1.2)
    (hit,) = hits(plant, "wall")
    assert {"panda_hand", "panda_leftfinger", "panda_rightfinger", "held:cube"} <= set(hit.bodies)
    assert hit.body == hit.bodies[0]
    assert hit.caused_by_robot


# --- agents ----------------------------------------------------------------------------------------------------


def crossing(y, **changes):
    """A blind agent that comes along x = 1 from a place y, and the robot beside its line."""
    return Agent(name="temi", start=(1.0, y, math.pi / 2), waypoints=((1.0, 4.0),), behaviour="blind", **changes)


def into_the_line(y, wait=0.01, **changes):
    """The robot drives with its front into the agent's line and stands there, 3 s after it has waited [s]."""
    plant = SimulatedPlant(scene(agents=(crossing(y, **changes),)))
    plant.step(wait)
    drive(plant, 0.5, 1.5)
    drive(plant, 0.0, 1.4)
    assert abs(plant.observe().twist[0]) < 1e-3
    assert float(plant.truth().pose[0]) + 0.35 > 0.9
    return plant


def test_a_robot_that_cuts_in_and_stands_when_it_is_hit_caused_the_contact_and_the_cut_in_is_told():
    plant = into_the_line(-3.45, wait=1.5, speed=0.8)
    assert verdicts(plant) == []
    drive(plant, 0.0, 2.0)
    assert verdicts(plant, "temi") == [True]
    (cut,) = plant.truth().cut_ins
    assert cut.agent == "temi"
    assert 0.5 < cut.gap < cut.stopping_way
    assert cut.speed == pytest.approx(0.8, abs=0.01)


def test_a_robot_that_stops_just_before_it_is_hit_caused_the_contact():
    plant = SimulatedPlant(scene(agents=(crossing(-1.25),)))
    drive(plant, 0.5, 1.5)
    drive(plant, 0.0, 3.0)
    assert verdicts(plant, "temi") == [True]


def test_an_agent_that_had_room_to_stop_before_the_robot_that_stood_in_its_line_caused_the_contact():
    plant = into_the_line(-3.2)
    drive(plant, 0.0, 5.0)
    assert verdicts(plant, "temi") == [False]
    assert plant.truth().cut_ins == ()


def test_passing_far_ahead_of_an_agent_is_no_cut_in():
    plant = SimulatedPlant(scene(agents=(crossing(-3.5),)))
    drive(plant, 0.5, 6.0)
    assert hits(plant) == []
    assert plant.truth().cut_ins == ()


def test_an_agent_that_turns_towards_a_standing_robot_was_not_cut_in_on():
    agent = Agent(name="temi", start=(0.0, -3.0, 0.0), waypoints=((2.0, -3.0), (0.5, 0.0)), behaviour="blind")
    plant = SimulatedPlant(scene(agents=(agent,)))
    plant.step(16.0)
    assert verdicts(plant, "temi") == [False]
    assert plant.truth().cut_ins == ()


@pytest.mark.parametrize("speed", [0.1, 0.3])
def test_an_agent_that_runs_into_the_rear_of_a_robot_that_drives_away_caused_the_contact(speed):
    behind = Agent(name="temi", start=(-1.2, 0.0, 0.0), waypoints=((6.0, 0.0),), behaviour="blind")
    plant = SimulatedPlant(scene(agents=(behind,)))
    drive(plant, speed, 1.0)
    drive(plant, speed, 6.5)
    assert verdicts(plant, "temi")[:1] == [False]


def test_a_robot_that_drives_along_an_agents_line_when_it_is_hit_from_the_side_caused_the_contact():
    side = Agent(name="temi", start=(0.9, -1.0, math.pi / 2), waypoints=((0.9, 4.0),), behaviour="blind")
    plant = SimulatedPlant(scene(agents=(side,)))
    drive(plant, 0.4, 2.6)
    assert verdicts(plant, "temi") == [True]


def test_an_agent_that_runs_into_a_robot_whose_arm_moves_elsewhere_caused_the_contact():
    blind = Agent(name="temi", start=(-2.0, 0.0, 0.0), waypoints=((2.0, 0.0),), behaviour="blind")
    plant = SimulatedPlant(scene(agents=(blind,)))
    plant.command(act(dq=(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.3)))
    plant.step(4.2)
    assert verdicts(plant, "temi") == [False]


# --- out of an overlap -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("x", "y", "speed"), [(0.45, 0.0, -0.2), (0.25, 0.0, -0.2), (0.35, 0.3, -0.25), (-0.3, 0.0, 0.3)]
)
def test_a_robot_that_drives_out_of_what_was_put_onto_it_causes_nothing(x, y, speed):
    plant = SimulatedPlant(scene())
    plant.apply(AddObstacle(name="it", x=x, y=y, size=(0.5, 0.5, 0.3)))
    plant.step(4.0)
    assert verdicts(plant) == [False]
    drive(plant, speed, 5.0)
    assert verdicts(plant) == [False]


@pytest.mark.parametrize(("x", "y", "speed"), [(0.45, 0.0, 0.2), (0.1, 0.47, 0.02), (0.35, 0.3, 0.01)])
def test_a_robot_that_drives_further_into_what_was_put_onto_it_or_along_it_causes_the_contact(x, y, speed):
    plant = SimulatedPlant(scene())
    plant.apply(AddObstacle(name="it", x=x, y=y, size=(0.9, 0.5, 0.3)))
    plant.step(4.0)
    assert verdicts(plant) == [False]
    drive(plant, speed, 1.0)
    assert verdicts(plant) == [True]


@pytest.mark.parametrize("seed", range(16))
def test_the_shorter_way_out_of_what_was_put_onto_the_robot_is_no_fault_and_the_longer_one_is(seed):
    rng = np.random.default_rng(seed)
    base = shapely.box(-0.35, -0.25, 0.35, 0.25)
    ahead = back = 0.0
    while abs(ahead - back) < 0.08:
        length, width = rng.uniform(0.1, 0.9, 2).tolist()
        x, y, heading = rng.uniform((-0.6, -0.5, 0.0), (0.6, 0.5, math.pi)).tolist()
        it = shapely.Polygon(rectangle((x, y, heading), (length, width)))
        ahead, back = (way_out(base, it, direction) for direction in (1, -1))
    shorter = 1.0 if ahead < back else -1.0
    plant = SimulatedPlant(scene())
    plant.apply(AddObstacle(name="it", x=x, y=y, heading=heading, size=(length, width, 0.3)))
    plant.step(3.0)
    put = plant.snapshot()
    for speed, seconds, caused in ((0.2 * shorter, 4.0, False), (-0.2 * shorter, 0.6, True)):
        plant.restore(put)
        drive(plant, speed, seconds)
        assert verdicts(plant, "it") == [caused]


def way_out(base, it, direction):
    """How far the base has to go ahead or back until it is clear of a thing [m]."""
    way = 0.0
    while it.intersects(affinity.translate(base, direction * way, 0.0)):
        way += 0.01
    return way


def test_a_robot_that_starts_in_a_wall_and_drives_back_out_causes_nothing():
    start = SimulatedPlant(scene(solids=(box("wall", (0.4, 0.0), (0.4, 2.0), 0.3),)))
    start.step(0.5)
    assert verdicts(start) == [False]
    drive(start, -0.2, 3.0)
    assert verdicts(start) == [False]


# --- the robot with itself -------------------------------------------------------------------------------------


def test_a_link_that_is_folded_onto_another_of_the_arm_is_a_contact_caused_by_the_robot():
    q = READY.copy()
    q[5:] = 1.0, 2.3
    plant = SimulatedPlant(scene(), arm_start=q)
    plant.step(0.1)
    assert hits(plant) == []
    plant.command(act(dq=(0.0, 0.0, 0.0, 0.0, 0.0, -1.0, 0.0)))
    plant.step(1.0)
    found = {frozenset((*item.bodies, item.other)) for item in hits(plant)}
    assert any("panda_link5" in pair and pair & {"panda_link7", "panda_hand"} for pair in found)
    assert all(verdicts(plant))


def test_an_arm_that_is_folded_at_the_start_is_a_contact_of_nobody_and_unfolds_without_blame():
    q = READY.copy()
    q[5:] = 0.1, 2.3
    plant = SimulatedPlant(scene(), arm_start=q)
    plant.step(0.2)
    assert verdicts(plant)
    assert not any(verdicts(plant))
    plant.command(act((0.3, 0.0), dq=(0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0)))
    plant.step(1.5)
    assert not any(verdicts(plant))


def test_driving_and_turning_with_the_arm_at_rest_touches_nothing_of_the_own_arm():
    plant = SimulatedPlant(scene())
    drive(plant, 0.5, 3.0, yaw_rate=1.0)
    assert hits(plant) == []


# --- what is not measured cannot touch -------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(3))
def test_what_is_remembered_of_every_pair_is_never_more_than_its_distance(seed):
    rng = np.random.default_rng(seed)
    hand, _ = tcp()
    spots = hand + rng.uniform((-0.15, -0.25, -0.1), (0.25, 0.25, 0.1), (4, 3))
    cubes = tuple(SceneObject(name=f"c{k}", position=tuple(spot.tolist())) for k, spot in enumerate(spots))
    plant = SimulatedPlant(scene(objects=cubes), arm_start=DOWN)
    referee = plant._referee
    for k in range(150):
        if k % 30 == 0:
            plant.command(act((0.3, 0.5 * rng.standard_normal()), rng.uniform(-1.5, 1.5, 7)))
        plant.step(0.01)
        state, around = plant._state.referee, referee._surroundings
        placed = state.placed_before
        for i in range(len(placed) - 1):
            for j in range(around.first_cube, around.floor):
                assert state.gaps[i, j] <= referee._distance(placed, around, i, j) + 1e-9
        places = [coal.Transform3s(T[:3, :3], T[:3, 3]) for T in placed]
        for p, (i, j) in enumerate(referee._self_pairs.tolist()):
            if i < len(placed) - 1:
                answer = coal.DistanceResult()
                shapes = referee.robot.shapes
                true = coal.distance(shapes[i], places[i], shapes[j], places[j], coal.DistanceRequest(), answer)
                assert state.self_gaps[p] <= true + 1e-9


def test_what_is_remembered_of_an_empty_hand_does_not_depend_on_what_it_held_later():
    plant = over_a_cube()
    plant.step(0.05)
    before = plant.snapshot()
    ends = []
    for _ in range(2):
        plant.restore(before)
        drive(plant, -0.25, 4.0)
        ends.append(state_hash(plant.snapshot()))
        plant.restore(before)
        plant.command(act(gripper="close"))
        plant.step(1.0)
        assert plant.truth().objects[0].state == "held"
    assert ends[0] == ends[1]


def test_a_held_cube_that_touches_the_own_arm_is_a_contact():
    plant = grasp(over_a_cube())
    held = plant._state.objects[0]
    lower = plant._referee.robot.place(np.zeros(3), plant._state.arm.q, 0.04)[1, :3, 3]
    hand = plant._frames(plant._state.base.pose, plant._state.arm.q)[HAND]
    plant._state.gripper.position_in_hand = hand[:3, :3].T @ (lower + np.array([0.0, 0.0, 0.05]) - hand[:3, 3])
    plant.step(0.01)
    assert held.state == "held"
    assert ("held:cube", "panda_link0") in {(body, item.other) for item in hits(plant) for body in item.bodies}
