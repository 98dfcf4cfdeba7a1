"""Contacts say if the base moved towards the other when they began: a truth beside the verdict."""

import math

import numpy as np
import pytest
from shapely.geometry import Polygon
from sim_hands import DOWN, ROBOT, act, move, over_a_cube, tcp
from sim_scenes import box, experiment, scene

from motm_twin.model.assets import LINKS
from motm_twin.model.geometry import rectangle
from motm_twin.model.plant import Actuation
from motm_twin.model.profile import READY, Footprint, RobotProfile
from motm_twin.model.scene import Agent, Bin, Cylinder, Prism, Solid
from motm_twin.sim.plant import SimulatedPlant

BODIES = (*(f"panda_link{i}" for i in range(8)), "panda_hand", "panda_leftfinger", "panda_rightfinger")


def contacts(plant):
    return {(body, item.other): item for item in plant.truth().contacts for body in item.bodies}


def probe_at(point, size=0.01):
    return box("probe", (point[0], point[1]), (size, size), point[2] + size / 2, z_min=point[2] - size / 2)


@pytest.mark.parametrize("body", BODIES)
def test_a_probe_inside_a_body_of_the_arm_is_a_contact_with_that_body(body):
    referee = SimulatedPlant(scene())._referee
    placed = referee.robot.place(np.zeros(3), READY, 0.08)
    i = referee.robot.bodies.index(body)
    point = placed[i, :3, :3] @ referee.robot.centres[i] + placed[i, :3, 3]
    plant = SimulatedPlant(scene(solids=(probe_at(point),)))
    plant.step(0.01)
    assert (body, "probe") in contacts(plant)
    away = SimulatedPlant(scene(solids=(probe_at(point + np.array([0.0, 1.0, 0.0])),)))
    away.step(0.01)
    assert contacts(away) == {}


def test_the_referees_own_robot_agrees_with_the_kinematics_of_the_model():
    referee = SimulatedPlant(scene())._referee
    rng = np.random.default_rng(3)
    for _ in range(20):
        pose, q = rng.uniform(-2.0, 2.0, 3), READY + rng.uniform(-0.5, 0.5, 7)
        placed = referee.robot.place(pose, q, 0.06)
        links = dict(zip(LINKS, ROBOT.link_transforms(pose, q, 0.06), strict=True))
        for body in (*(f"panda_link{i}" for i in range(8)), "panda_hand"):
            np.testing.assert_allclose(placed[referee.robot.bodies.index(body)], links[body], atol=1e-9)


def test_an_unmapped_box_below_the_lidar_that_the_base_drives_into_is_reported():
    low = box("low", (1.0, 0.0), (0.3, 0.3), 0.1, mapped=False)
    plant = SimulatedPlant(scene(solids=(low,)))
    plant.command(act((0.5, 0.0)))
    for _ in range(60):
        plant.step(0.05)
        assert not np.isfinite(plant.observe().scan.ranges).any()
    hit = contacts(plant)["base", "low"]
    assert hit.caused_by_robot
    assert hit.closing_speed == pytest.approx(0.5, abs=0.02)
    assert hit.other_speed == 0.0
    assert plant.truth().min_base_clearance == 0.0
    when_touching = 1.5  # 0.5 m at 0.5 m/s^2 and 0.5 m/s, plus the lag
    assert hit.time == pytest.approx(when_touching, abs=0.15)


def test_driving_past_at_a_centimetre_is_no_contact_and_the_clearance_is_exact():
    post = Solid(name="post", shape=Cylinder(centre=(1.0, 0.31), radius=0.05), z_min=0.0, z_max=1.5, mapped=True)
    plant = SimulatedPlant(scene(solids=(post,)))
    plant.command(act((0.5, 0.0)))
    plant.step(2.0)
    assert "base" not in {body for body, _ in contacts(plant)}
    assert plant.truth().min_base_clearance == pytest.approx(0.01, abs=1e-6)


@pytest.mark.parametrize("seed", range(4))
def test_base_clearance_equals_an_independent_geometry_library_along_a_drive(seed):
    rng = np.random.default_rng(seed)
    solids = [box(f"b{i}", tuple(rng.uniform(-3, 3, 2)), (0.4, 0.2), 0.3, yaw=rng.uniform(0, 3)) for i in range(8)]
    solids = [s for s in solids if math.hypot(*s.shape.centre) > 0.8]
    plant = SimulatedPlant(scene(solids=tuple(solids), robot=RobotProfile(footprint=Footprint(offset_x=0.1))))
    shapes = [Polygon(rectangle((*s.shape.centre, s.shape.yaw), s.shape.size)) for s in solids]
    least = math.inf
    plant.command(act((0.3, 0.5 * rng.standard_normal())))
    for step in range(151):
        if step:
            plant.step(0.01)
        pose = plant.truth().pose
        middle = pose[:2] + 0.1 * np.array([math.cos(pose[2]), math.sin(pose[2])])
        body = Polygon(rectangle((*middle, pose[2]), (0.7, 0.5)))
        least = min(least, *(body.distance(s) for s in shapes))
        assert plant.truth().min_base_clearance == pytest.approx(least, abs=1e-6)


def test_contact_of_the_arm_with_its_own_base_is_reported():
    q = np.array([0.0, 1.7, 0.0, -2.9, 0.0, 2.0, 0.0])
    plant = SimulatedPlant(scene(), arm_start=q)
    plant.step(0.01)
    assert "base" in {other for _, other in contacts(plant)}


def test_at_rest_and_ready_nothing_touches_anything():
    plant = SimulatedPlant(experiment())
    plant.step(1.0)
    truth = plant.truth()
    assert truth.contacts == ()
    assert truth.min_arm_clearance > 0.1
    assert truth.plant_faults == ()


def test_a_hand_in_the_floor_is_reported():
    q = np.array([0.0, 1.76, 0.0, -1.2, 0.0, 3.0, 0.0])
    plant = SimulatedPlant(scene(), arm_start=q)
    plant.step(0.01)
    assert any(other == "floor" for _, other in contacts(plant))


def test_a_hand_that_moves_into_a_wall_causes_the_contact_and_ends_it_by_backing_off():
    hand, _ = tcp()
    wall = box("wall", (hand[0] + 0.20, hand[1]), (0.2, 1.0), 1.5)
    plant = SimulatedPlant(scene(solids=(wall,)), arm_start=DOWN)
    move(plant, (0.1, 0.0, 0.0), 1.5, gripper="open")
    move(plant, (-0.1, 0.0, 0.0), 1.5, gripper="open")
    hits = plant.truth().contacts
    assert len(hits) == 1
    hand_hit = contacts(plant)["panda_hand", "wall"]
    assert hand_hit.caused_by_robot
    assert hand_hit.closing_speed == pytest.approx(0.1, abs=0.01)
    assert 0.0 < hand_hit.depth < 0.15
    assert hand_hit.time + hand_hit.duration < plant.time - 0.2


def closed_on_a_cube(**changes):
    plant = over_a_cube(**changes)
    plant.command(act(gripper="close"))
    plant.step(0.8)
    return plant


def test_a_held_cube_still_on_its_support_is_no_contact_but_lowered_onto_it_again_is():
    plant = closed_on_a_cube()
    plant.step(0.5)
    assert plant.truth().contacts == ()
    move(plant, (0.0, 0.0, 0.1), 1.0)
    assert plant.truth().contacts == ()
    move(plant, (0.0, 0.0, -0.1), 1.15)
    assert ("held:cube", "stand") in contacts(plant)
    assert contacts(plant)["held:cube", "stand"].caused_by_robot


def test_a_held_cube_that_is_carried_into_a_wall_is_a_contact_of_the_cube():
    hand, _ = tcp()
    low = hand[2] + 0.055
    wall = box("wall", (hand[0] + 0.16, hand[1]), (0.2, 0.2), low)
    plant = closed_on_a_cube(solids=(wall,))
    move(plant, (0.0, 0.0, 0.1), 0.7)
    assert plant.truth().contacts == ()
    move(plant, (0.1, 0.0, 0.0), 0.7)
    assert {body for body, other in contacts(plant) if other == "wall"} == {"held:cube"}


def test_fingers_on_the_target_cube_are_no_contact():
    plant = over_a_cube(offset=(0.0, 0.025, 0.0))
    plant.step(0.1)
    assert plant.truth().contacts == ()


def test_a_bin_is_five_plates_open_at_the_top():
    hand, _ = tcp()
    inside = Bin(name="bin", centre=(hand[0], hand[1]), floor_z=hand[2] - 0.05, rim_z=hand[2] + 0.05)
    plant = SimulatedPlant(scene(bins=(inside,)), arm_start=DOWN)
    plant.step(0.01)
    assert plant.truth().contacts == ()
    move(plant, (0.1, 0.0, 0.0), 3.0, gripper="open")
    assert any(other == "bin" for _, other in contacts(plant))


def test_a_prism_with_a_dent_is_not_filled():
    dent = ((0.5, -1.0), (2.0, -1.0), (2.0, 1.0), (0.5, 1.0), (0.5, 0.6), (1.6, 0.6), (1.6, -0.6), (0.5, -0.6))
    solid = Solid(name="dent", shape=Prism(corners=dent), z_min=0.0, z_max=2.0, mapped=True)
    plant = SimulatedPlant(scene(solids=(solid,)))
    plant.step(0.01)
    assert plant.truth().contacts == ()
    plant.command(act((0.5, 0.0)))
    plant.step(3.0)
    assert any(other == "dent" for _, other in contacts(plant))


def test_a_blind_agent_that_runs_into_a_standing_robot_is_not_the_robots_doing():
    blind = Agent(name="temi", start=(2.0, 0.0, math.pi), waypoints=((-2.0, 0.0),), behaviour="blind")
    plant = SimulatedPlant(scene(agents=(blind,)))
    plant.step(4.0)
    hit = contacts(plant)["base", "temi"]
    assert not hit.caused_by_robot
    assert hit.other_speed == pytest.approx(0.4, abs=0.01)
    assert hit.closing_speed == pytest.approx(0.0, abs=1e-9)


def test_a_robot_that_drives_into_a_standing_agent_causes_the_contact():
    plant = SimulatedPlant(scene(agents=(Agent(name="temi", start=(1.5, 0.0, 0.0)),)))
    plant.command(act((0.3, 0.0)))
    plant.step(5.0)
    assert contacts(plant)["base", "temi"].caused_by_robot


def test_ee_obstacle_is_the_plane_distance_to_what_is_not_in_the_map():
    mapped = box("mapped", (0.9, 0.6), (0.2, 0.2), 0.5)
    unknown = box("unknown", (3.0, 0.0), (0.2, 0.2), 0.1, mapped=False)
    plant = SimulatedPlant(scene(solids=(mapped, unknown), agents=(Agent(name="temi", start=(0.0, 2.5, 0.0)),)))
    hand, _ = tcp(q=READY)
    expected = min(2.9 - hand[0], math.hypot(hand[0], 2.5 - hand[1]) - 0.25)
    assert plant.truth().ee_obstacle == pytest.approx(expected, abs=1e-9)
    assert math.isinf(SimulatedPlant(scene(solids=(mapped,))).truth().ee_obstacle)


def test_a_plant_that_breaks_its_promises_is_found_out():
    plant = SimulatedPlant(scene())
    plant.step(0.1)
    plant._state.base.pose = plant._state.base.pose + np.array([0.05, 0.0, 0.0])
    plant.step(0.01)
    assert any("way of the base" in fault for fault in plant.truth().plant_faults)
    plant = SimulatedPlant(scene())
    plant._state.base.v = 0.4
    plant.step(0.01)
    assert any("linear acceleration" in fault for fault in plant.truth().plant_faults)
    plant = SimulatedPlant(scene())
    plant._state.arm.dq = np.array([3.0, 0, 0, 0, 0, 0, 0])
    plant.step(0.01)
    assert any("joint" in fault for fault in plant.truth().plant_faults)


def test_wild_commands_break_no_limit():
    plant, rng = SimulatedPlant(scene()), np.random.default_rng(5)
    for _ in range(200):
        plant.command(act(rng.uniform(-3, 3, 2), rng.uniform(-5, 5, 7), str(rng.choice(["open", "close"]))))
        plant.step(0.01 * int(rng.integers(1, 9)))
    assert plant.truth().plant_faults == ()


@pytest.mark.parametrize("seed", range(3))
def test_skipping_far_pairs_changes_neither_clearance_nor_contacts(seed):
    rng = np.random.default_rng(seed)
    boxes = [box(f"b{i}", (1.2, 0.9 * i - 0.9), (0.3, 0.5), 0.5 + 0.15 * i, yaw=0.4 * i) for i in range(3)]
    pillar = Solid(name="pillar", shape=Cylinder(centre=(0.2, 1.0), radius=0.1), z_min=0.0, z_max=1.2, mapped=True)
    plant = SimulatedPlant(scene(solids=(*boxes, pillar), agents=(Agent(name="temi", start=(0.0, -1.0, 0.0)),)))
    referee = plant._referee
    around = referee._surroundings
    least, touched = math.inf, set()
    for k in range(150):
        if k % 30 == 0:
            plant.command(act((0.3, 0.3 * rng.standard_normal()), rng.uniform(-1.0, 1.0, 7)))
        if k:
            plant.step(0.01)
        placed = referee.robot.place(plant.truth().pose, plant.observe().q, 0.08)
        for i, body in enumerate(referee.robot.bodies[:-1]):
            for j, other in enumerate(around.names):
                if other in ("base", "floor") or body == "base":
                    continue
                distance = referee._distance(placed, around, i, j)
                least = min(least, max(0.0, distance))
                if distance < -1e-5:
                    touched.add((body, other))
        assert plant.truth().min_arm_clearance == pytest.approx(least, abs=1e-6)
    own = ("base", "floor", *BODIES)
    found = {pair for pair in contacts(plant) if pair[1] not in own and pair[0] != "base"}
    assert found == touched


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
