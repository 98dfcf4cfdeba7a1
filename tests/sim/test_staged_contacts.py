"""Staged contacts: who touched what, in how many episodes, and whose doing it was."""

import math

import coal
import numpy as np
import pytest
from sim_hands import DOWN, act, move, over_a_cube, tcp
from sim_scenes import box, scene

from motm_twin.model.arm_kernels import HAND
from motm_twin.model.edits import AddObstacle, MoveObject, PushRobot
from motm_twin.model.joint_limits import READY
from motm_twin.model.scene import Agent, Bin, Cylinder, Pick, Place, SceneObject, Solid
from motm_twin.sim.counts import Counts
from motm_twin.sim.objects import ObjectState
from motm_twin.sim.plant import SimulatedPlant


def hits(plant, other=None):
    return [item for item in plant.truth().contacts if other in (None, item.other)]


def verdicts(plant, other=None):
    return [item.caused_by_robot for item in hits(plant, other)]


def drive(plant, speed, seconds, yaw_rate=0.0):
    plant.command(act((speed, yaw_rate)))
    plant.step(seconds)


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
    plant = over_a_cube(solids=(other,))
    plant.command(act(gripper="close"))
    plant.step(0.9)
    move(plant, (0.0, 0.0, 0.1), 0.5)
    assert verdicts(plant) == []
    move(plant, direction, round(0.08 / np.linalg.norm(direction), 2))
    assert verdicts(plant, "other") == [True]
    assert hits(plant, "other")[0].body == "held:cube"


def test_a_held_cube_that_the_base_carries_over_the_edge_of_a_stand_causes_the_contact():
    plant = over_a_cube()
    plant.command(act(gripper="close"))
    plant.step(0.9)
    move(plant, (0.0, 0.0, 0.1), 0.5)
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
    plant = over_a_cube(solids=(step,))
    plant.command(act(gripper="close"))
    plant.step(0.9)
    move(plant, (0.1, 0.0, 0.0), 0.5)
    assert verdicts(plant, "step") == [True]


def test_a_cube_that_stood_close_beside_another_and_is_swept_into_it_causes_the_contact():
    hand, rotation = tcp()
    along = rotation @ np.array([1.0, 0.0, 0.0])
    beside = SceneObject(name="beside", position=tuple(float(v) for v in hand + 0.043 * along))
    shelf = box("shelf", (hand[0], hand[1]), (0.3, 0.3), float(hand[2]) - 0.02)
    cube = SceneObject(name="cube", position=tuple(float(v) for v in hand))
    plant = SimulatedPlant(scene(solids=(shelf,), objects=(cube, beside)), arm_start=DOWN)
    plant.command(act(gripper="close"))
    plant.step(0.9)
    assert verdicts(plant) == []
    move(plant, tuple(0.1 * along), 0.4)
    assert verdicts(plant, "beside") == [True]
    assert "held:cube" in hits(plant, "beside")[0].bodies


def test_what_touches_with_several_parts_is_one_episode_with_all_of_them():
    hand, _ = tcp()
    wall = box("wall", (hand[0] + 0.20, hand[1]), (0.2, 1.0), 1.5)
    plant = over_a_cube(solids=(wall,))
    plant.command(act(gripper="close"))
    plant.step(0.9)
    move(plant, (0.0, 0.0, 0.1), 0.5)
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


def test_a_robot_that_is_pushed_into_a_wall_and_drives_back_out_causes_nothing():
    plant = SimulatedPlant(scene(solids=(box("wall", (0.6, 0.0), (0.4, 2.0), 0.3),)))
    with pytest.raises(ValueError):
        plant.apply(PushRobot(dx=0.2, dy=0.0))
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


# --- cubes -----------------------------------------------------------------------------------------------------


def shelf_of(*offsets, gripper_start=DOWN, side=0.04):
    """Cubes a, b, ... at these offsets from the tool centre point, along the axes of the hand, on one shelf."""
    hand, rotation = tcp(q=gripper_start)
    yaw = math.atan2(rotation[1, 1], rotation[0, 1])
    cubes = tuple(
        SceneObject(name=name, position=tuple(float(v) for v in hand + rotation @ np.array(offset)), yaw=yaw, side=side)
        for name, offset in zip("abcd", offsets, strict=False)
    )
    top = box("shelf", (hand[0], hand[1]), (0.5, 0.5), float(hand[2]) - 0.5 * side, z_min=float(hand[2]) - 0.05)
    return SimulatedPlant(scene(solids=(top,), objects=cubes), arm_start=gripper_start)


def along(axis):
    _, rotation = tcp()
    return rotation @ np.array(axis)


def test_a_base_that_runs_over_a_cube_on_the_floor_causes_the_contact():
    plant = SimulatedPlant(scene(objects=(SceneObject(name="lost", position=(0.6, 0.0, 0.02)),)))
    drive(plant, 0.3, 2.0)
    assert verdicts(plant, "lost") == [True]
    assert hits(plant, "lost")[0].body == "base"


def test_a_finger_that_pushes_a_cube_beside_causes_the_contact():
    plant = shelf_of((0.0, 0.10, 0.0))
    move(plant, tuple(along((0.0, 0.1, 0.0))), 0.5, gripper="open")
    assert verdicts(plant, "a") == [True]
    assert hits(plant, "a")[0].body in ("panda_leftfinger", "panda_rightfinger")


def test_a_finger_that_comes_down_on_a_cube_causes_the_contact():
    plant = over_a_cube(offset=(0.0, 0.05, 0.045))
    move(plant, (0.0, 0.0, -0.05), 0.6, gripper="open")
    assert verdicts(plant, "cube") == [True]


def test_a_hand_that_goes_down_round_a_cube_closes_lifts_and_lets_go_of_it_touches_nothing():
    plant = over_a_cube(offset=(0.004, 0.006, 0.06), turn=0.1)
    move(plant, (0.0, 0.0, -0.1), 0.6, gripper="open")
    assert plant.truth().contacts == ()


def test_a_cube_that_is_taken_lifted_and_released_is_no_contact_of_the_fingers():
    plant = over_a_cube(offset=(0.003, 0.005, 0.0), turn=0.05)
    plant.command(act(gripper="close"))
    plant.step(0.9)
    move(plant, (0.0, 0.0, 0.1), 0.4)
    plant.command(act(gripper="open"))
    plant.step(1.0)
    assert plant.truth().contacts == ()
    assert plant.truth().drops == 1


def test_a_grasped_cube_that_is_pushed_against_the_next_one_is_a_contact_of_the_two():
    plant = shelf_of((0.0, 0.0, 0.0), (0.0, 0.10, 0.0), (0.0, 0.141, 0.0))
    move(plant, tuple(along((0.0, 0.1, 0.0))), 0.5, gripper="open")
    assert verdicts(plant, "b") == [True]
    (hit,) = hits(plant, "c")
    assert hit.caused_by_robot
    assert hit.body == "b"


def test_a_held_cube_that_is_lowered_into_a_lying_one_causes_the_contact():
    hand, _ = tcp()
    other = SceneObject(name="other", position=(float(hand[0]) + 0.12, float(hand[1]), float(hand[2])))
    stand = box("stand2", (hand[0] + 0.12, hand[1]), (0.06, 0.06), float(hand[2]) - 0.02)
    cube = SceneObject(name="cube", position=tuple(float(v) for v in hand))
    under = box("stand", (hand[0], hand[1]), (0.06, 0.06), float(hand[2]) - 0.02)
    plant = SimulatedPlant(scene(solids=(under, stand), objects=(cube, other)), arm_start=DOWN)
    plant.command(act(gripper="close"))
    plant.step(0.9)
    move(plant, (0.0, 0.0, 0.1), 0.3)
    move(plant, (0.1, 0.0, 0.0), 1.0)
    assert verdicts(plant, "other") == [True]
    assert "held:cube" in hits(plant, "other")[0].bodies


def test_a_held_cube_lies_on_the_one_below_without_a_contact():
    hand, _ = tcp()
    top = SceneObject(name="top", position=tuple(float(v) for v in hand))
    low = SceneObject(name="low", position=(float(hand[0]), float(hand[1]), float(hand[2]) - 0.04))
    under = box("stand", (hand[0], hand[1]), (0.06, 0.06), float(hand[2]) - 0.06)
    plant = SimulatedPlant(scene(solids=(under,), objects=(top, low)), arm_start=DOWN)
    plant.command(act(gripper="close"))
    plant.step(0.9)
    assert plant.truth().contacts == ()
    move(plant, (0.0, 0.0, 0.1), 0.5)
    assert plant.truth().contacts == ()


def test_two_cubes_that_a_person_piles_up_are_no_contact_and_lie_as_they_do():
    plant = SimulatedPlant(scene(objects=(
        SceneObject(name="a", position=(2.0, 0.0, 0.02)), SceneObject(name="b", position=(2.5, 0.0, 0.02)),
    )))  # fmt: skip
    plant.apply(MoveObject(name="b", x=2.0, y=0.005))
    plant.step(0.5)
    assert hits(plant) == []


def test_a_cube_that_the_robot_drops_into_another_is_a_contact_of_the_two_and_on_top_of_it_is_none():
    for offset, expected in ((0.0, []), (0.044, [True])):
        hand, _ = tcp()
        floor = float(hand[2]) - 0.2
        frame = Bin(name="bin", centre=(float(hand[0]), float(hand[1])), floor_z=floor, rim_z=floor + 0.08)
        place = (float(hand[0]) + offset, float(hand[1]), floor + 0.02)
        lying = SceneObject(name="lying", position=place, yaw=math.pi / 4)
        cube = SceneObject(name="cube", position=tuple(float(v) for v in hand))
        plant = SimulatedPlant(scene(bins=(frame,), objects=(cube, lying)), arm_start=DOWN)
        item = next(item for item in plant._state.objects if item.name == "cube")
        item.state = "falling"
        plant.step(1.0)
        assert verdicts(plant) == expected


# --- dropped, and put right ------------------------------------------------------------------------------------


def test_a_cube_that_falls_out_of_the_hand_is_dropped():
    plant = over_a_cube(tasks=(Pick(object="cube"), Place(bin="bin")))
    plant.command(act(gripper="close"))
    plant.step(0.9)
    move(plant, (0.0, 0.0, 0.1), 0.4)
    assert plant.truth().dropped == ()
    plant.command(act(gripper="open"))
    plant.step(1.0)
    assert (plant.truth().drops, plant.truth().dropped) == (1, ("cube",))


def falls(counts, cube, to):
    cube.state = "falling"
    counts.step([cube], "")
    cube.position = cube.position - np.array([0.0, 0.0, 0.3])
    cube.state = to
    counts.step([cube], "")


def lifted(counts, cube):
    cube.state = "held"
    counts.step([cube], cube.name)
    cube.position = cube.position + np.array([0.0, 0.0, 0.3])
    counts.step([cube], cube.name)


def test_a_dropped_cube_stays_dropped_until_it_is_picked_up_and_placed():
    cube = ObjectState(name="cube", position=np.array([0.0, 0.0, 0.5]), yaw=0.0, side=0.04)
    counts = Counts(right_bins={"cube": ("bin",)})
    falls(counts, cube, "dropped")
    lifted(counts, cube)
    assert counts.dropped == ("cube",)
    falls(counts, cube, "binned:other")
    assert counts.dropped == ("cube",)
    lifted(counts, cube)
    falls(counts, cube, "binned:bin")
    assert (counts.drops, counts.dropped, counts.placed) == (1, (), ("cube",))


def test_a_dropped_cube_that_belongs_in_no_bin_is_put_right_by_picking_it_up():
    cube = ObjectState(name="cube", position=np.array([0.0, 0.0, 0.5]), yaw=0.0, side=0.04)
    counts = Counts()
    falls(counts, cube, "resting")
    assert counts.dropped == ("cube",)
    lifted(counts, cube)
    assert counts.dropped == ()


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


def test_a_held_cube_that_touches_the_own_arm_is_a_contact():
    plant = over_a_cube()
    plant.command(act(gripper="close"))
    plant.step(0.9)
    held = plant._state.objects[0]
    lower = plant._referee.robot.place(np.zeros(3), plant._state.arm.q, 0.04)[1, :3, 3]
    hand = plant._frames(plant._state.base.pose, plant._state.arm.q)[HAND]
    plant._state.gripper.position_in_hand = hand[:3, :3].T @ (lower + np.array([0.0, 0.0, 0.05]) - hand[:3, 3])
    plant.step(0.01)
    assert held.state == "held"
    assert ("held:cube", "panda_link0") in {(body, item.other) for item in hits(plant) for body in item.bodies}
