"""Whom the robot keeps off: named as the scene names it, where it is near the way and not in the map."""

import msgspec
import numpy as np
import pytest
from fake_twin import FakeTwin, fake_scene

from motm_twin.bus.encode import tick_message
from motm_twin.bus.messages import BodyMessage, TickMessage
from motm_twin.model.furniture import pieces
from motm_twin.ui.panel.explain import avoided, gripper, limited_by, unmapped
from motm_twin.ui.panel.why_tab import headline, now_card

replace = msgspec.structs.replace
SCENE = fake_scene()


def body(name, x, y, kind="temi"):
    return BodyMessage(name=name, kind=kind, position=[x, y, 0.0], yaw=0.0, state="", size=[0.4, 0.4, 1.0])


@pytest.fixture
def tick():
    """The robot drives along x from the origin; nothing is near."""
    sent = msgspec.json.encode(tick_message(FakeTwin(SCENE).advance(), 1, 0.0))
    tick = msgspec.json.decode(sent, type=TickMessage)
    robot = replace(tick.robot, true_pose=[0.0, 0.0, 0.0], twist=[0.4, 0.0])
    way = replace(tick.plan, status="goal", local_poses=[[x, 0.0, 0.0, 0.4, 0.0] for x in (0.3, 0.6, 0.9)])
    arm = [replace(step, active=[], limiter="") for step in tick.arm]
    return replace(tick, robot=robot, plan=way, arm=arm, agents=[], obstacles=[], stop_reason="", done=False)


@pytest.mark.parametrize(
    ("place", "said"),
    [
        ((1.2, 0.2), "past temi 1, 0.7 m ahead"),
        ((0.5, 0.8), "past temi 1, 0.4 m to its left"),
        ((0.5, -0.8), "past temi 1, 0.4 m to its right"),
        ((-0.9, 0.0), ""),
        ((2.5, 0.0), ""),
    ],
)
def test_a_body_near_the_way_is_named_with_its_distance_and_side(tick, place, said):
    assert avoided(replace(tick, obstacles=[body("temi 1", *place)]), SCENE) == said


def test_the_kind_is_told_where_the_name_does_not(tick):
    assert "Ann (person)" in avoided(replace(tick, agents=[body("Ann", 1.2, 0.0, "person")]), SCENE)


def test_who_it_brakes_for_is_named_or_else_what_the_lidar_sees(tick):
    why = "braking from 0.50 m/s and 0.0 rad/s: something that the lidar sees, the nearest 0.61 m from it, is in"
    braking = replace(tick, stop_reason=why)
    assert avoided(braking, SCENE) == "braking for something the lidar sees 0.6 m away"
    braking = replace(braking, obstacles=[body("box 1", 1.1, 0.0, "box")])
    assert avoided(braking, SCENE) == "braking for box 1, 0.6 m ahead"
    still = replace(braking, robot=replace(braking.robot, twist=[0.0, 0.0]))
    assert avoided(still, SCENE) == "held up by box 1, 0.6 m ahead"
    waits = replace(still, stop_reason="waiting for the arm at cube1: the fingers close")
    assert avoided(waits, SCENE) == ""


def test_what_slows_the_gripper_is_named_when_it_is_as_far_as_the_lidar_says(tick):
    hand = gripper(tick, SCENE)
    near = body("temi 1", hand.x, hand.y + 0.6)
    limit = {"active": ["lidar moving"], "limiter": "moving obstacle", "obstacle_distance": 0.4}
    arm = [replace(step, allowed_approach=0.1, **limit) for step in tick.arm]
    slow = replace(tick, arm=arm, obstacles=[near])
    assert avoided(slow, SCENE) == "keeping the gripper off temi 1 (0.4 m)"
    assert limited_by(slow, SCENE) == "temi 1"
    assert "temi 1 0.40 m away: the gripper may approach" in now_card(slow, SCENE)
    elsewhere = replace(slow, obstacles=[])
    assert "something that moves" in avoided(elsewhere, SCENE) and limited_by(elsewhere, SCENE) == ""


def test_furniture_that_was_moved_is_not_in_the_map_until_the_robot_is_told(tick):
    name = next(name for name, piece in pieces(SCENE).items() if piece.mapped)
    moved = replace(tick, furniture=[BodyMessage(
        name=name, kind="piece", position=[1.4, 0.0, 0.0], yaw=0.0, state="", size=[1.0, 1.0, 1.0])])  # fmt: skip
    assert not [thing for thing in unmapped(tick, SCENE) if name in thing.label]
    assert f"past {name}, which is not where the map has it," in avoided(moved, SCENE)
    told = replace(moved, announced={name: [1.4, 0.0, 0.0]})  # by whomever
    assert avoided(told, SCENE) == ""
    again = replace(told, furniture=[replace(moved.furniture[0], position=[1.5, 0.0, 0.0])])
    assert name in avoided(again, SCENE)
    back = replace(told, furniture=[])
    assert [thing for thing in unmapped(back, SCENE) if name in thing.label], "the map has it where it no longer is"


def test_hostile_names_stay_text(tick):
    evil = "<img src=x onerror=alert(1)>"
    page = headline(replace(tick, obstacles=[body(evil, 1.2, 0.0)]), SCENE)
    assert "<img" not in page and "&lt;img" in page


def test_the_hand_is_where_the_kinematics_has_it(tick):
    turned = replace(tick, robot=replace(tick.robot, true_pose=[1.0, 2.0, np.pi]))
    first, second = gripper(tick, SCENE), gripper(turned, SCENE)
    assert (second.x, second.y) == pytest.approx((1.0 - first.x, 2.0 - first.y))
