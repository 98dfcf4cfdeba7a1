"""The robot's doings in words: every state has its sentence, and whom it keeps off is named as the scene names it."""

import msgspec
import numpy as np
import pytest
from fake_twin import fake_scene
from person import in_hand, with_arm

from motm_twin.bus.messages import BodyMessage, EncounterMessage, TrackMessage
from motm_twin.control.arm.bodies import BODIES
from motm_twin.control.arm.controller import _BOUND_NAMES
from motm_twin.model.furniture import pieces
from motm_twin.model.joint_limits import DQ_MAX, READY
from motm_twin.model.reason import Kind, Reason
from motm_twin.ui.panel import explain
from motm_twin.ui.panel.explain import avoided, gripper, limited_by, unmapped
from motm_twin.ui.panel.why_tab import headline, now_card

replace = msgspec.structs.replace
PHASES = ("stow", "transit", "final", "closing", "lift", "carry", "release", "retry")
SCENE = fake_scene()


def test_the_sentence_tells_for_whom_the_robot_waits_and_on_which_side_it_passes(driving):
    here = driving.robot.true_pose[:2]
    walker = body("Ann", here[0] + 1.0, here[1], "person")
    tracks = [
        TrackMessage(track=number, position=[here[0] + x, here[1]], velocity=[0.0, 0.5], radius=0.25, position_sd=0.02,
                     expected=[])
        for number, x in ((3, 1.05), (7, 2.5))
    ]  # fmt: skip
    met = replace(driving, agents=[walker], tracks=tracks)

    def said(tick, **plan):
        return avoided(replace(tick, plan=replace(tick.plan, **plan)), SCENE)

    def other(track, yields="", passes=""):
        return EncounterMessage(
            track=track, yields=yields, passes=passes, time=1.0, gap=0.4, speed=0.5, courtesy=0.0, reason="",
            why=Reason(kind=Kind.KEEPS_CLEAR),
        )  # fmt: skip

    brakes = replace(met, why=Reason(kind=Kind.MEETS_MOVER, value=0.6, limit=0.5))
    assert said(brakes) == "braking for Ann"
    assert said(replace(brakes, robot=replace(met.robot, twist=[0.0, 0.0]))) == "waiting for Ann"
    assert said(met, why=Reason(kind=Kind.MAKES_WAY, value=0.5)) == "making way for Ann"
    assert said(met, encounters=[other(7, passes="behind")]) == "passing behind person 7"
    assert said(met, encounters=[other(3, passes="in front")]) == "passing in front of Ann"
    assert said(met, encounters=[other(3, yields="other")]) == "Ann gives way"
    assert said(met, encounters=[other(3, passes="in front"), other(7, yields="robot")]) == "giving way to person 7"
    late = replace(other(7, passes="behind"), time=6.0)  # much may change until then
    assert said(met, encounters=[late]) == said(met, encounters=[other(7)]) == said(met)


@pytest.mark.parametrize("kind", ["pick", "place"])
@pytest.mark.parametrize("phase", [*PHASES, "something new"])
def test_every_phase_has_a_sentence_about_its_target(driving, phase, kind):
    driving = with_arm(in_hand(driving, kind), phase=phase)
    target = driving.tasks[driving.task_index].target
    assert target in explain.doing(driving) or "cube1" in explain.doing(driving)


def test_the_sentence_tells_whether_the_base_moves(driving):
    reaching = with_arm(in_hand(driving, "pick"), phase="final")
    assert explain.doing(reaching) == "Closing in on cube1, on the move"
    still = replace(reaching, robot=replace(driving.robot, twist=[0.0, 0.0]))
    assert explain.doing(still) == "Closing in on cube1"
    assert explain.doing(with_arm(still, why=Reason(kind=Kind.WAITS_FOR_SIGHT, subject="cube1"))) == "Looking for cube1"
    carrying = with_arm(in_hand(driving, "place"), phase="carry")
    assert explain.doing(carrying) == "Carrying cube1 to drop1"


def test_the_end_tells_what_was_given_up(driving):
    done = [replace(task, status="done") for task in driving.tasks]
    ended = replace(driving, tasks=done, task_index=len(done), done=True, success=True)
    assert explain.doing(ended) == "All 8 tasks are done"
    failed = replace(ended, tasks=[replace(done[0], status="failed"), *done[1:]], success=False)
    assert explain.doing(failed) == "All tasks have ended; given up: pick cube1"
    assert explain.doing(replace(ended, tasks=[], task_index=0)) == "Nothing to do: the list of tasks is empty"


def test_what_holds_the_robot_up_is_told_once_with_numbers(driving):
    slowed = with_arm(
        driving, active=["lidar moving"], limiter="moving obstacle", obstacle_distance=0.4, allowed_approach=0.257
    )
    tries = [replace(driving.tasks[0], attempts=2), *driving.tasks[1:]]
    why = explain.waiting(replace(slowed, stop_reason="braking: something", tasks=tries, task_index=0))
    assert why[0] == ("Braking: something", True)
    assert why[1] == ("A moving obstacle is 0.40 m away: the gripper may approach at 0.26 m/s", False)
    assert why[-1] == ("This is the second try at cube1", False)
    retreat = with_arm(slowed, allowed_approach=-0.1)
    assert "backs off at 0.10 m/s or more" in explain.slowed_by(retreat.arm)
    assert explain.slowed_by(with_arm(slowed, active=[]).arm) == ""


def test_every_row_and_bound_of_the_arms_program_is_told_in_words(driving):
    """Also those that the furniture of any scene brings: its names come from the scene."""
    names = ["lidar static", "lidar moving", "lidar height", *_BOUND_NAMES]
    names += [f"{body} - {other}" for body in BODIES for other in ("lidar", "own base", "own column", "desk - left")]
    for name in names:
        ((what, by),) = explain.constraints(with_arm(driving, active=[name]).arm, READY)
        assert by != "at its limit"
        assert " - " not in what
    assert explain.constraints(with_arm(driving, active=["brand new"]).arm, READY) == [("brand new", "at its limit")]


def test_rows_are_grouped_and_joints_tell_their_limit(driving):
    fast = DQ_MAX * [0, 1, 0, 0, 0, 0, 0]
    step = with_arm(
        driving, active=["joint 4", "joint 2", "joint 1", "joint 3", "elbow - desk", "wrist - desk"],
        joint_velocity=fast.tolist(),
    )  # fmt: skip
    q = np.array(READY)
    q[3] = -0.2
    assert explain.constraints(step.arm, q) == [
        ("joint 4", "near the end of its range"),
        ("joint 2", "at full speed"),
        ("joints 1, 3", "speeds up or brakes as fast as it may"),
        ("elbow, wrist", "kept off desk"),
    ]


def body(name, x, y, kind="temi"):
    return BodyMessage(name=name, kind=kind, position=[x, y, 0.0], yaw=0.0, state="", size=[0.4, 0.4, 1.0])


@pytest.fixture
def straight(tick):
    """The robot drives along x from the origin; nothing is near."""
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
def test_a_body_near_the_way_is_named_with_its_distance_and_side(straight, place, said):
    assert avoided(replace(straight, obstacles=[body("temi 1", *place)]), SCENE) == said


def test_the_kind_is_told_where_the_name_does_not(straight):
    assert "Ann (person)" in avoided(replace(straight, agents=[body("Ann", 1.2, 0.0, "person")]), SCENE)


def test_who_it_brakes_for_is_named_or_else_what_the_lidar_sees(straight):
    braking = replace(straight, why=Reason(kind=Kind.IN_STOPPING_WAY, subject="lidar", value=0.61, limit=0.7))
    assert avoided(braking, SCENE) == "braking for something the lidar sees 0.6 m away"
    braking = replace(braking, obstacles=[body("box 1", 1.1, 0.0, "box")])
    assert avoided(braking, SCENE) == "braking for box 1, 0.6 m ahead"
    still = replace(braking, robot=replace(braking.robot, twist=[0.0, 0.0]))
    assert avoided(still, SCENE) == "held up by box 1, 0.6 m ahead"
    waits = replace(still, why=Reason(kind=Kind.PHASE, subject="cube1", other="the fingers close"))
    assert avoided(waits, SCENE) == ""


def test_what_slows_the_gripper_is_named_when_it_is_as_far_as_the_lidar_says(straight):
    hand = gripper(straight, SCENE)
    near = body("temi 1", hand.x, hand.y + 0.6)
    limit = {"active": ["lidar moving"], "limiter": "moving obstacle", "obstacle_distance": 0.4}
    arm = [replace(step, allowed_approach=0.1, **limit) for step in straight.arm]
    slow = replace(straight, arm=arm, obstacles=[near])
    assert avoided(slow, SCENE) == "keeping the gripper off temi 1 (0.4 m)"
    assert limited_by(slow, SCENE) == "temi 1"
    assert "temi 1 is 0.40 m away: the gripper may approach" in now_card(slow, SCENE)
    elsewhere = replace(slow, obstacles=[])
    assert "something that moves" in avoided(elsewhere, SCENE) and limited_by(elsewhere, SCENE) == ""


def test_furniture_that_was_moved_is_not_in_the_map_until_the_robot_is_told(straight):
    name = next(name for name, piece in pieces(SCENE).items() if piece.mapped)
    moved = replace(straight, furniture=[BodyMessage(
        name=name, kind="piece", position=[1.4, 0.0, 0.0], yaw=0.0, state="", size=[1.0, 1.0, 1.0])])  # fmt: skip
    assert not [thing for thing in unmapped(straight, SCENE) if name in thing.label]
    assert f"past {name}, which is not where the map has it," in avoided(moved, SCENE)
    told = replace(moved, announced={name: [1.4, 0.0, 0.0]})  # by whomever
    assert avoided(told, SCENE) == ""
    again = replace(told, furniture=[replace(moved.furniture[0], position=[1.5, 0.0, 0.0])])
    assert name in avoided(again, SCENE)
    back = replace(told, furniture=[])
    assert [thing for thing in unmapped(back, SCENE) if name in thing.label], "the map has it where it no longer is"


def test_hostile_names_stay_text(straight):
    evil = "<img src=x onerror=alert(1)>"
    page = headline(replace(straight, obstacles=[body(evil, 1.2, 0.0)]), SCENE)
    assert "<img" not in page and "&lt;img" in page


def test_the_hand_is_where_the_kinematics_has_it(straight):
    turned = replace(straight, robot=replace(straight.robot, true_pose=[1.0, 2.0, np.pi]))
    first, second = gripper(straight, SCENE), gripper(turned, SCENE)
    assert (second.x, second.y) == pytest.approx((1.0 - first.x, 2.0 - first.y))
