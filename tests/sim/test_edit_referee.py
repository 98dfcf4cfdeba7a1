"""Who caused a contact: a person who moved something, or the robot."""

import contextlib

import msgspec
import numpy as np
import pytest
from edit_scenes import room
from sim_hands import act
from sim_scenes import box, scene

from motm_twin.model.edits import AddObstacle, FreezeBody, MoveBody, PushRobot, ReleaseBody, RemoveBody
from motm_twin.model.profile import BaseLimits
from motm_twin.model.scene import Agent
from motm_twin.sim.plant import SimulatedPlant
from motm_twin.sim.responsibility import PERSON, braking_time
from motm_twin.sim.world_edits import EditError

BRAKING = braking_time(BaseLimits())  # [s]


def base_hits(plant):
    return [item for item in plant.truth().contacts if "base" in item.bodies]


def driving(speed=0.4, **changes):
    plant = SimulatedPlant(scene(**changes))
    plant.command(act((speed, 0.0)))
    plant.step(2.0)
    return plant


def stop(plant, seconds=2.0):
    plant.command(act())
    plant.step(seconds)


@pytest.mark.parametrize("shape", ["box", "cylinder", "temi", "person"])
@pytest.mark.parametrize("ahead", [0.0, 0.2, 0.5])
def test_what_is_dropped_onto_a_driving_robot_is_the_persons_doing_if_the_robot_stops(shape, ahead):
    plant = driving()
    plant.apply(AddObstacle(name="it", shape=shape, x=float(plant.truth().pose[0]) + ahead, y=0.0))
    stop(plant, 3.0)
    assert base_hits(plant)
    assert not any(item.caused_by_robot for item in plant.truth().contacts)


def test_a_robot_that_does_not_stop_for_what_was_put_before_it_causes_the_contact_in_the_end():
    plant = driving(0.2)
    plant.apply(AddObstacle(name="it", x=float(plant.truth().pose[0]) + 0.55, y=0.0))
    plant.step(0.3)
    assert [item.caused_by_robot for item in base_hits(plant)] == [False]
    plant.step(BRAKING)
    assert [item.caused_by_robot for item in base_hits(plant)] == [True]


def test_a_contact_that_begins_later_is_the_robots_although_it_could_not_have_stopped():
    plant = driving()
    front, half = 0.35, 0.25
    plant.apply(AddObstacle(name="it", x=float(plant.truth().pose[0]) + front + half + 0.17, y=0.0))
    before = plant.time
    plant.step(0.1)
    stop(plant)
    (hit,) = base_hits(plant)
    assert hit.time - before > PERSON
    assert hit.caused_by_robot


def test_what_was_put_down_before_is_the_robots_business():
    plant = driving()
    plant.apply(AddObstacle(name="it", x=float(plant.truth().pose[0]) + 0.6 + 0.4 * (PERSON + 0.2), y=0.0))
    plant.step(2.0)
    assert [item.caused_by_robot for item in base_hits(plant)] == [True]


def test_a_body_that_is_only_held_is_no_excuse_however_often_the_hand_says_so():
    plant = SimulatedPlant(scene())
    plant.apply(AddObstacle(name="it", x=0.9, y=0.0))
    plant.command(act((0.2, 0.0)))
    for _ in range(60):
        plant.apply(MoveBody(name="it", x=0.9, y=0.0, heading=0.0))
        plant.step(0.05)
    assert [item.caused_by_robot for item in base_hits(plant)] == [True]


BOX = AddObstacle(name="it", x=1.2, y=0.0, size=(0.3, 0.3, 0.6))


def hits_while(*edits, speed=0.4, periods=60):
    """Base contacts of a robot that drives at a box while every period brings the next of these edits, in turn."""
    plant = SimulatedPlant(scene())
    plant.apply(BOX)
    plant.step(1.0)
    plant.command(act((speed, 0.0)))
    for k in range(periods):
        for edit in edits[k % len(edits)]:
            with contextlib.suppress(EditError):  # a push further into the box
                plant.apply(edit)
        plant.step(0.05)
    return [item.caused_by_robot for item in base_hits(plant)]


def at(x, heading=0.0):
    return (MoveBody(name="it", x=x, y=0.0, heading=heading),)


@pytest.mark.parametrize(
    "edits",
    [
        (at(1.20011), at(1.2)),
        (at(1.2), at(1.2, 0.002)),
        (at(1.203), at(1.197), at(1.2)),
        tuple(at(1.2 - 0.00011 * k) for k in range(60)),
        ((PushRobot(dx=0.0, dy=0.0002),), (PushRobot(dx=0.0, dy=-0.0002),)),
        ((PushRobot(dx=0.0, dy=0.0, turn=0.0011),), (PushRobot(dx=0.0, dy=0.0, turn=-0.0011),)),
        ((RemoveBody(name="it"), BOX),),
        ((RemoveBody(name="it"), BOX, *at(1.2002)),),
    ],
)
def test_a_hand_that_trembles_or_puts_a_body_back_where_it_was_is_no_excuse(edits):
    assert hits_while(*edits) == [True]


def test_a_body_that_is_dragged_away_from_a_faster_robot_is_no_excuse():
    assert hits_while(*(at(1.2 + 0.005 * k) for k in range(60))) == [True]


def test_a_body_dragged_slowly_towards_a_slow_robot_is_the_persons_doing():
    assert hits_while(*(at(1.2 - 0.6 * k / 300) for k in range(300)), speed=0.035, periods=250) == [False]


def test_a_trembling_hand_does_not_prolong_the_excuse_of_a_contact():
    plant = driving(0.2)
    x = float(plant.truth().pose[0]) + 0.55
    plant.apply(AddObstacle(name="it", x=x, y=0.0))
    charged = []
    for k in range(30):
        plant.apply(MoveBody(name="it", x=x + 0.002 * (k % 2), y=0.0))
        plant.step(0.05)
        charged.append(any(item.caused_by_robot for item in base_hits(plant)))
    assert not any(charged[: round(BRAKING / 0.05) - 1])
    assert charged[-1]


@pytest.mark.parametrize(
    "back",
    [
        BOX,
        AddObstacle(name="it", x=1.0, y=0.0, size=(0.3, 0.3, 0.6)),
        AddObstacle(name="it", x=1.2, y=0.0, size=(0.8, 0.3, 0.6)),
    ],
)
def test_a_body_that_comes_back_elsewhere_or_larger_or_after_a_while_onto_the_robot_is_the_persons_doing(back):
    plant = SimulatedPlant(scene())
    plant.apply(BOX)
    plant.command(act((0.3, 0.0)))
    plant.step(2.0)
    plant.apply(RemoveBody(name="it"))
    if back is BOX:
        plant.step(PERSON + 1.0)
    plant.apply(back)
    stop(plant)
    assert [item.caused_by_robot for item in base_hits(plant)] == [False]


def test_a_push_that_moves_nothing_is_refused():
    plant = SimulatedPlant(scene())
    with pytest.raises(ValueError, match="a push needs at least"):
        plant.apply(PushRobot(dx=0.0, dy=0.0, turn=0.0))


def test_a_push_sideways_does_not_excuse_what_lay_ahead_anyway():
    assert hits_while((PushRobot(dx=0.0, dy=0.01),), (PushRobot(dx=0.0, dy=-0.01),)) == [True]


def test_a_body_held_against_the_robot_for_seconds_is_its_own_business_when_it_drives_on():
    plant = SimulatedPlant(scene())
    plant.apply(AddObstacle(name="it", x=0.9, y=0.0))
    plant.apply(MoveBody(name="it", x=0.595, y=0.0))
    for _ in range(60):
        plant.apply(MoveBody(name="it", x=0.595, y=0.0))
        plant.step(0.05)
    assert [item.caused_by_robot for item in base_hits(plant)] == [False]
    plant.command(act((0.2, 0.0)))
    plant.step(1.0)
    assert [item.caused_by_robot for item in base_hits(plant)] == [True]


def test_a_body_dragged_about_in_front_of_the_robot_is_the_persons_doing():
    plant = SimulatedPlant(scene())
    plant.apply(AddObstacle(name="it", x=1.2, y=0.0))
    plant.command(act((0.2, 0.0)))
    for k in range(60):
        plant.apply(MoveBody(name="it", x=1.2 - 0.005 * k, y=0.0))
        plant.step(0.05)
    stop(plant)
    assert [item.caused_by_robot for item in base_hits(plant)] == [False]


def test_letting_go_of_a_body_that_stands_is_no_motion_of_it():
    plant = driving(0.3)
    plant.apply(AddObstacle(name="it", x=float(plant.truth().pose[0]) + 0.85, y=0.0))
    plant.step(0.7)
    plant.apply(ReleaseBody(name="it"))
    plant.step(1.0)
    assert [item.caused_by_robot for item in base_hits(plant)] == [True]


def test_a_frozen_agent_is_no_excuse():
    agent = Agent(name="temi", start=(1.0, 0.0, 0.0), waypoints=((6.0, 0.0), (1.0, 0.0)))
    plant = driving(0.4, agents=(agent,))
    plant.apply(FreezeBody(name="temi"))
    plant.step(2.0)
    assert [item.caused_by_robot for item in base_hits(plant)] == [True]


@pytest.mark.parametrize("after", [0.1, PERSON + 0.3])
def test_furniture_pushed_before_the_robot_excuses_for_a_while_although_its_parts_have_other_names(after):
    slab = room().solids[1]
    parts = (slab, box("foot", (3.0, 2.0), (0.6, 0.6), 0.1))
    parts = tuple(part if part.group else _grouped(part) for part in parts)
    plant = driving(0.4, solids=parts)
    x = float(plant.truth().pose[0])
    plant.apply(MoveBody(name="table", x=x + 0.35 + 0.3 + 0.4 * after, y=0.0))
    plant.step(after + 0.2)
    stop(plant)
    (hit,) = base_hits(plant)
    assert hit.other == "foot"
    assert hit.caused_by_robot == (after > PERSON)


def _grouped(solid):
    return msgspec.structs.replace(solid, group="table")


@pytest.mark.parametrize(("gap", "excused"), [(0.02, True), (0.4, False)])
def test_contacts_right_after_a_push_are_the_persons_doing(gap, excused):
    wall = box("wall", (1.5, 0.0), (0.2, 2.0), 0.3)
    plant = SimulatedPlant(scene(solids=(wall,)))
    plant.command(act((0.3, 0.0)))
    plant.step(1.0)
    room_ahead = 1.4 - 0.35 - float(plant.truth().pose[0])
    plant.apply(PushRobot(dx=min(0.5, room_ahead - gap), dy=0.0))
    for _ in range(4):
        ahead = 1.4 - 0.35 - float(plant.truth().pose[0])
        if ahead > gap + 0.001:
            plant.apply(PushRobot(dx=min(0.5, ahead - gap), dy=0.0))
    plant.step(round(gap / 0.3 + 0.2, 2))
    stop(plant)
    assert [item.caused_by_robot for item in base_hits(plant)] == [not excused]
    assert all(item.closing_speed < 0.6 for item in base_hits(plant))


def test_a_push_does_not_excuse_the_arm_that_hits_its_own_base():
    plant = SimulatedPlant(scene(), arm_start=np.array([0.0, 0.1, 0.0, -2.9, 0.0, 2.0, 0.0]))
    plant.step(0.05)
    assert plant.truth().contacts == ()
    plant.command(act(dq=(0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0)))
    for _ in range(10):
        plant.apply(PushRobot(dx=0.01, dy=0.0))
        plant.step(0.1)
    own = [item for item in plant.truth().contacts if item.other == "base"]
    assert own
    assert all(item.caused_by_robot for item in own)


def test_a_thrown_body_that_has_come_to_rest_is_the_robots_business_after_a_while():
    plant = SimulatedPlant(scene())
    plant.apply(AddObstacle(name="it", x=2.0, y=0.0, size=(0.4, 0.4, 0.5)))
    plant.apply(ReleaseBody(name="it", velocity=(-1.0, 0.0)))
    plant.step(1.5)
    plant.command(act((0.4, 0.0)))
    plant.step(4.0)
    assert [item.caused_by_robot for item in base_hits(plant)] == [True]
