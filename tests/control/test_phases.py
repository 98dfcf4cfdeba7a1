"""Single decisions of the arm's phases."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from motm_twin.control.arm import phases
from motm_twin.control.arm.geometry import stretch
from motm_twin.control.arm.motion import _point
from motm_twin.control.arm.parameters import ArmParameters
from motm_twin.control.arm.types import Phase
from motm_twin.control.arm.view import ManipulatorState, View
from motm_twin.model.profile import RobotProfile
from motm_twin.model.reason import Kind
from motm_twin.model.scene_check import FINGER_ROOM

P = ArmParameters()
CUBE = np.array([0.5, 0.0, 0.7])


def over_cube(tilt: float, above: float, side: float) -> SimpleNamespace:
    """A hand tilted [rad] to one finger, so far [m] above the middle of a cube that stands alone."""
    c, s = math.cos(tilt), math.sin(tilt)
    R = np.array([[1.0, 0.0, 0.0], [0.0, -c, s], [0.0, -s, -c]])
    goal = SimpleNamespace(name="it", position=CUBE, yaw=0.0, position_sd=0.002, side=side, neighbours=np.zeros((0, 6)))
    return SimpleNamespace(
        time=1.0, radius=0.5, distance=0.01, p=CUBE + np.array([0.0, 0.0, above]), target=CUBE, R=R, tilt=tilt,
        velocity=np.zeros(3), width=0.08, goal=goal, seen=lambda _: True, sure=lambda _: True,
        slides=lambda _: False, slips_since=-math.inf,
    )  # fmt: skip


def closes(tilt: float, above: float, side: float) -> bool:
    """The fingers close with the hand tilted [rad] to one finger, and so far [m] above the cube's middle."""
    view, state = over_cube(tilt, above, side), ManipulatorState()
    rules = SimpleNamespace(parameters=P, reach=lambda _: 0.8)
    phases._approach(state, view, rules)
    return state.phase == Phase.CLOSING


def test_the_fingers_close_on_the_middle_of_a_cube():
    assert closes(0.0, 0.0, 0.04)


def test_a_tilted_hand_does_not_close_where_its_pads_would_squeeze_the_cube_out():
    """Of 35 mm cubes taken 13 mm above their middle, pushed up there by furniture, half were shot away."""
    assert closes(0.28, 0.008, 0.035)
    assert not closes(0.28, 0.0125, 0.035)


def test_a_hand_that_is_tilted_too_much_to_close_does_not_come_down():
    """Base and hand swung: 30 degrees tilted, its palm met the cube beside its target."""
    state = ManipulatorState()
    state.phase = Phase.FINAL
    at, tilted = (_point(state, over_cube(tilt, 0.03, 0.045), P)[2] for tilt in (P.close_tilt, math.radians(30.0)))
    edge = 0.1  # [m] from the middle of the palm
    assert tilted - at > edge * math.sin(math.radians(30.0) - P.close_tilt)


@pytest.mark.parametrize(("speed", "since", "stays"), [(0.3, 0.5, False), (0.3, -0.5, True), (0.01, 0.5, True)])
def test_a_hand_that_came_down_before_the_wheels_slipped_goes_up_again(speed, since, stays):
    """It followed the base's measured speed, 0.2 m/s more than the true one, and a finger went into the cube."""
    view, state = over_cube(0.0, 0.03, 0.04), ManipulatorState(phase=Phase.FINAL, since=0.0)
    view.slips_since, view.slides = since, lambda p: speed > p.close_speed
    _, why = phases._approach(state, view, SimpleNamespace(parameters=P, reach=lambda _: 0.8))
    assert state.phase == (Phase.FINAL if stays else Phase.RETRY)
    assert (why is None) == stays


@pytest.mark.parametrize(
    ("since", "twist", "slides"),
    [(1.0, (0.3, 0.0), True), (1.0, (0.0, 0.3), True), (1.0, (0.01, 0.0), False), (-math.inf, (0.3, 0.0), False)],
)
def test_a_base_that_stands_or_grips_does_not_slide(since, twist, slides):
    view = SimpleNamespace(slips_since=since, arm=SimpleNamespace(measured=np.array(twist)))
    assert View.slides(view, P) == slides


@pytest.mark.parametrize(("kind", "phase"), [("pick", Phase.FINAL), ("place", Phase.RELEASE)])
def test_a_hand_over_its_target_comes_down_once_the_base_stands_or_grips(monkeypatch, kind, phase):
    monkeypatch.setattr(phases, "choose_yaw", lambda *_: None)
    room = SimpleNamespace(top_between=lambda *_: -math.inf)
    rules, inputs = SimpleNamespace(parameters=P, reach=lambda _: 0.8, room=room), SimpleNamespace(T_odom_world=None)
    state, view = ManipulatorState(phase=Phase.TRANSIT, holding=kind == "place"), over_cube(0.0, 0.05, 0.04)
    view.goal.kind, view.time_to_range, view.slides = kind, 0.0, lambda _: True
    _, why = phases._arrive(state, view, inputs, rules)
    assert state.phase == Phase.TRANSIT and why.kind == Kind.WAITS_FOR_GRIP
    view.slides = lambda _: False
    phases._arrive(state, view, inputs, rules)
    assert state.phase == phase


def test_after_a_miss_the_hand_goes_straight_up_whatever_becomes_of_its_target():
    """It went 11 cm aside at once, low, through the cubes in between."""
    state, here = ManipulatorState(), CUBE + np.array([0.0, 0.02, 0.005])
    view = SimpleNamespace(time=1.0, p=here, target=CUBE + np.array([0.11, 0.0, 0.0]))
    rules = SimpleNamespace(profile=SimpleNamespace(gripper=SimpleNamespace(closing_time=0.5)))
    phases._miss(state, view, rules, Kind.CLOSED_ON_NOTHING)
    assert state.phase == Phase.RETRY
    assert _point(state, view, P) == pytest.approx(here + np.array([0.0, 0.0, P.hover_height]))


def test_a_hand_that_rises_from_an_object_that_was_given_up_is_not_at_work_on_the_task_after_it():
    """A task that was put first meanwhile came second, and a pick added at the end raised an IndexError."""
    state, view = ManipulatorState(phase=Phase.CLOSING), SimpleNamespace(time=1.0, p=CUBE)
    rules = SimpleNamespace(profile=SimpleNamespace(gripper=SimpleNamespace(closing_time=0.5)))
    phases._miss(state, view, rules, Kind.CLOSED_ON_NOTHING)
    assert phases.engaged(state)
    phases._new_goal(state, view)
    assert state.phase == Phase.RETRY
    assert not phases.engaged(state)


def test_a_hand_that_starts_over_takes_its_fingers_from_beside_the_object_first():
    """It swung away at once, 8 mm into the cube between its fingers."""
    state = ManipulatorState()
    state.phase = Phase.FINAL
    goal = SimpleNamespace(name="it", kind="pick", side=0.04)
    view = SimpleNamespace(time=1.0, p=CUBE, target=CUBE, width=0.08, gripper_moving=False, goal=goal)
    phases.start_over(state, view, P)
    assert state.phase == Phase.RETRY
    assert _point(state, view, P)[2] > CUBE[2]
    phases._retry(state, view, SimpleNamespace(parameters=P))
    assert state.phase == Phase.RETRY
    view.p = CUBE + np.array([0.0, 0.0, P.hover_height])
    phases._retry(state, view, SimpleNamespace(parameters=P))
    assert state.phase == Phase.STOW


@pytest.mark.parametrize("width", [0.08, 0.07])
def test_an_object_that_nearly_fills_the_open_fingers_is_tried_once_they_stand_open(width):
    """A scene takes cubes up to 70 mm, and the hand never began with those over 65 mm."""
    goal = SimpleNamespace(name="it", kind="pick", side=0.08 - FINGER_ROOM)
    view = SimpleNamespace(
        time=1.0, time_to_range=0.0, pose=np.zeros(3), target=CUBE, p=CUBE, mount=CUBE, goal=goal, width=width,
        gripper_moving=False,
    )  # fmt: skip
    seen = SimpleNamespace(twist=np.zeros(2))
    inputs = SimpleNamespace(observation=seen, plan_times=np.ones(1), plan_poses=np.zeros((1, 5)))
    in_time = SimpleNamespace(transit_duration=lambda *_: 0.5)
    rules = SimpleNamespace(parameters=P, profile=RobotProfile(), mount=np.zeros(3), timing=in_time)
    first = ManipulatorState(phase=Phase.STOW)
    phases._leave(first, view, inputs, rules)
    again = ManipulatorState(phase=Phase.RETRY, anchor=CUBE - np.array([0.0, 0.0, P.hover_height]))
    phases._retry(again, view, rules)
    assert (first.phase, again.phase) == ((Phase.TRANSIT,) * 2 if width == 0.08 else (Phase.STOW, Phase.RETRY))


def wait_for_opening(state: ManipulatorState, start: float, *, age: float) -> None:
    """From a time on, twice as long as the hand waits for wide fingers, with reports of an age [s]."""
    for time in np.arange(start, start + 2.0 * P.search_after, 0.1).tolist():
        phases._wait_for_opening(state, SimpleNamespace(time=time, sure=lambda p: age <= p.sure_age), P)


def test_fingers_that_did_not_close_part_of_the_way_may_do_so_for_the_next_object():
    """Reports that came late for a while kept the hand from ever opening its fingers part of the way again."""
    state = ManipulatorState(opening=0.05)
    wait_for_opening(state, 1.0, age=2.0 * P.sure_age)
    assert not state.opens_fully
    wait_for_opening(state, 5.0, age=0.0)
    assert state.opens_fully
    phases._new_goal(state, SimpleNamespace(time=9.0))
    assert not state.opens_fully


def test_the_time_of_an_earlier_try_does_not_count_against_the_fingers():
    state = ManipulatorState(phase=Phase.TRANSIT, opening=0.05)
    view = SimpleNamespace(time=1.0, sure=lambda _: True, p=CUBE)
    phases._wait_for_opening(state, view, P)
    phases._withdraw(state, view)
    state.opening, view.time = 0.05, 9.0
    phases._wait_for_opening(state, view, P)
    assert not state.opens_fully


@pytest.mark.parametrize("side", [0.03, 0.045, 0.065])
def test_the_hand_waits_until_what_it_let_go_has_fallen_from_between_its_fingers(side):
    """A hand that left at 0.8 m/s at once touched the falling cube with a finger."""
    fallen = 0.5 * phases.GRAVITY * phases._falling_time(side, P) ** 2
    assert fallen == pytest.approx(0.5 * side + P.tip_length)


@pytest.mark.parametrize(
    ("others", "aim", "hand", "lets_go"),
    [
        ([], 0.0, 0.0, True),
        ([0.0], 0.06, 0.06, True),
        ([0.0], 0.06, 0.02, False),  # it would land on the other
        ([-0.06, 0.0, 0.06], 0.03, 0.03, True),  # no room anywhere: there is a pile
    ],
)
def test_an_object_is_let_go_beside_what_lies_in_the_bin_while_there_is_room(others, aim, hand, lets_go):
    """It was let go over the middle of what was let go before: of six cubes in a bin, towers of three."""
    there = np.array([[x, 0.0, 0.6, 0.0, 0.04, 1.0] for x in others]).reshape(-1, 6)
    goal = SimpleNamespace(
        kind="place", position=np.array([0.0, 0.0, 0.7]), yaw=0.0, side=0.04, release_half_width=0.15, neighbours=there
    )
    view = SimpleNamespace(
        goal=goal, p=np.array([hand, 0.0, 0.76]), target=np.array([aim, 0.0, 0.755]), velocity=np.zeros(3)
    )
    rules = SimpleNamespace(parameters=P, profile=SimpleNamespace(gripper=SimpleNamespace(opening_time=0.2)))
    assert phases.lands_inside(ManipulatorState(side=0.04), view, rules) == lets_go


def closing(**changes: object) -> SimpleNamespace:
    """A hand whose fingers stand at the width of a cube, 0.1 m from where they began to close."""
    goal = SimpleNamespace(name="it", position=CUBE, side=0.04)
    view = SimpleNamespace(
        time=1.6, dt=0.01, p=CUBE + np.array([0.0, 0.1, 0.0]), target=CUBE, width=0.04, gripper_moving=False, goal=goal,
        sure=lambda _: True,
    )  # fmt: skip
    vars(view).update(changes)
    return view


def after_closing(view: SimpleNamespace) -> Phase:
    state = ManipulatorState(phase=Phase.CLOSING, since=1.0, side=0.04, gripper="close", anchor=CUBE.copy())
    gripper = SimpleNamespace(closing_time=0.5, max_width=0.08)
    phases._close(state, view, SimpleNamespace(parameters=P, profile=SimpleNamespace(gripper=gripper)))
    return state.phase


@pytest.mark.parametrize(
    ("changes", "phase"),
    [
        ({}, Phase.LIFT),
        ({"width": 0.06, "gripper_moving": True}, Phase.RETRY),  # open, beside the object
        ({"width": 0.0}, Phase.RETRY),
        ({"width": 0.06, "gripper_moving": True, "sure": lambda _: False}, Phase.CLOSING),
    ],
)
def test_fingers_that_have_the_object_keep_it_wherever_the_hand_is(changes, phase):
    """Reports came half a second late, the base braked, and a cube in the fingers was let go beyond its table."""
    assert after_closing(closing(**changes)) == phase


@pytest.mark.parametrize("radius", [0.45, 0.6, 0.7, 0.74])
def test_a_hand_that_searches_rises_only_as_far_as_it_can_look_down(radius):
    """At 0.73 m it rose until the reach tilted it by 44 deg, and looked past the cube below it for 13 s."""
    view = over_cube(0.0, 0.06, 0.04)
    vars(view).update(time=9.0, radius=radius, mount=np.array([CUBE[0] - radius, 0.0, 0.38]), seen=lambda _: False)
    height = _point(ManipulatorState(phase=Phase.FINAL, since=1.0), view, P)[2]
    risen = height - CUBE[2] - P.hover_height
    full = stretch(radius, CUBE[2] + P.hover_height + P.search_rise - 0.38, P.pick_tilt) <= P.stretch
    assert full == (radius < 0.65)
    assert risen == pytest.approx(P.search_rise) if full else 0.0 <= risen < P.search_rise
    assert stretch(radius, height - 0.38, P.pick_tilt) <= P.stretch + 1e-9 or risen == 0.0


@pytest.mark.parametrize(
    ("others", "changes", "phase"),
    [
        ([], {}, Phase.STOW),
        ([-0.06, 0.0, 0.06], {}, Phase.RELEASE),
        ([-0.06, 0.0, 0.06], {"p": np.array([0.0, 0.0, 0.8])}, Phase.STOW),
        ([-0.06, 0.0, 0.06], {"time": 3.0}, Phase.STOW),  # it cannot rise
        ([], {"gripper_moving": True}, Phase.RELEASE),
        ([], {"gripper_moving": True, "time": 3.0}, Phase.STOW),  # fingers that never report that they stand
    ],
)
def test_the_hand_rises_first_from_an_object_that_it_let_go_on_a_pile(others, changes, phase):
    """The object lay on others, still between the fingers, and the hand left sideways: 13 mm into it."""
    there = np.array([[x, 0.0, 0.6, 0.0, 0.04, 1.0] for x in others]).reshape(-1, 6)
    goal = SimpleNamespace(
        kind="place", position=np.array([0.0, 0.0, 0.7]), yaw=0.0, side=0.04, release_half_width=0.07, neighbours=there
    )
    view = SimpleNamespace(
        time=1.5, dt=0.01, goal=goal, p=np.array([0.0, 0.0, 0.755]), target=np.array([0.0, 0.0, 0.755]), width=0.08,
        gripper_moving=False, sure=lambda _: True,
    )  # fmt: skip
    vars(view).update(changes)
    state = ManipulatorState(
        phase=Phase.RELEASE, holding=True, side=0.04, gripper="open", released=1.0, anchor=view.target.copy()
    )
    gripper = SimpleNamespace(opening_time=0.2)
    phases._release(state, view, SimpleNamespace(parameters=P, profile=SimpleNamespace(gripper=gripper)))
    assert state.phase == phase
    if others and phase == Phase.RELEASE:
        assert state.anchor[2] > view.p[2] + 0.05
