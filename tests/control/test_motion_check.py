"""Wheels, joints and fingers that do not do what they are told are found; those that do are not."""

import math

import numpy as np
import pytest

from motm_twin.control.motion_check import (
    MotionSettings,
    MotionState,
    check_base,
    check_fingers,
    check_joints,
    failing_joint,
    findings,
    joint_shares,
    note_command,
)
from motm_twin.model.plant import Actuation, Observation
from motm_twin.model.profile import RobotProfile
from motm_twin.sim.mechanics import Base
from motm_twin.sim.plant_state import BaseState

DT, PROFILE, SETTINGS = 0.01, RobotProfile(), MotionSettings()


def observation(time, twist=(0.0, 0.0), dq=None, q=None, width=0.08, moving=False):
    return Observation(
        time=time, pose=np.zeros(3), odometry=np.zeros(3), twist=np.array(twist, dtype=float),
        q=np.zeros(7) + np.array([0, 0, 0, -1.5, 0, 1.5, 0]) if q is None else q,
        dq=np.zeros(7) if dq is None else dq, gripper_width=width, gripper_moving=moving, scan=None, detections=(),
    )  # fmt: skip


def asked(v=0.0, w=0.0, rates=None, gripper="open"):
    rates = np.zeros(7) if rates is None else rates
    return Actuation(twist=np.array([v, w]), joint_velocity=rates, gripper=gripper)


def drive(commands, *, scale=1.0, more_lag=0.0, since=0.0, stuck=(math.inf, math.inf), noise=0.002):
    """Kinds found while a simulated base follows (v, w) of each time step; ``more_lag`` begins ``since`` [s]."""
    rng, state, base = np.random.default_rng(3), MotionState(), Base(PROFILE.base, DT, (scale, scale))
    body, found = BaseState(pose=np.zeros(3)), []
    for k, (v, w) in enumerate(commands):
        time = k * DT
        seen = observation(time, np.array([body.v, body.w]) + noise * rng.standard_normal(2))
        check_base(state, seen, DT if k else 0.0, PROFILE.base, SETTINGS)
        found.append({one.kind for one in findings(state, seen, PROFILE.base, SETTINGS)})
        note_command(state, asked(v, w), seen)
        stands = stuck[0] <= time < stuck[1]
        base.step(body, np.zeros(2) if stands else np.array([v, w]), more_lag=more_lag if time >= since else 0.0)
    return found


def ramps(seconds=20.0):
    """Speeding up, slowing down and turning as the planner does."""
    v = w = 0.0
    for k in range(round(seconds / DT)):
        time = k * DT
        goal_v, goal_w = (0.5, 0.0) if time % 6.0 < 3.0 else (-0.2, 1.2 if time % 3.0 < 1.5 else -1.2)
        v += min(max(goal_v - v, -0.5 * DT), 0.5 * DT)
        w += min(max(goal_w - w, -1.75 * DT), 1.75 * DT)
        yield v, w


@pytest.mark.parametrize("scale", [0.65, 0.8, 1.0, 1.2, 1.35])
def test_a_base_that_is_steadily_faster_or_slower_than_told_is_no_fault(scale):
    assert set().union(*drive(ramps(), scale=scale)) == set()


@pytest.mark.parametrize("more_lag", [0.4, 0.5, 1.0, 2.0])
def test_a_base_that_follows_late_is_found_within_a_second(more_lag):
    found = drive(ramps(), more_lag=more_lag)
    first = next(k for k, kinds in enumerate(found) if kinds)
    assert first * DT <= 1.0
    assert found[first] <= {"base_late", "base_stuck"}


@pytest.mark.parametrize("since", [5.0, 5.3, 5.6, 5.9])
def test_a_base_that_begins_to_follow_late_is_found_within_a_second(since):
    """Its larger turns before that hid the lag."""
    turns = ((0.5, (0.4 if k * DT < since else 0.15) * math.sin(5.0 * k * DT)) for k in range(1200))
    found = drive(turns, more_lag=0.5, since=since)
    first = next(k for k, kinds in enumerate(found) if kinds) * DT
    assert since < first <= since + 1.0


def test_a_base_that_stands_is_found_within_a_second_and_forgiven_when_it_drives():
    found = drive(((0.4, 0.0) for _ in range(1000)), stuck=(3.0, 6.0))
    assert found[290] == set()
    assert found[400] == {"base_stuck"}
    assert found[-1] == set()


def joints(rates, follow, steps=60, q=None):
    """Findings while joints are told rates (7,) and do ``follow`` of them (7,)."""
    state, found = MotionState(), []
    for k in range(steps):
        seen = observation(k * DT, dq=follow * rates if k else np.zeros(7), q=q)
        check_joints(state, seen, DT, SETTINGS)
        found.append([(one.kind, one.subject) for one in findings(state, seen, PROFILE.base, SETTINGS)])
        note_command(state, asked(rates=rates), seen)
    return state, found


@pytest.mark.parametrize("joint", range(7))
def test_the_joint_that_stands_is_named(joint):
    follow = np.ones(7)
    follow[joint] = 0.0
    state, found = joints(np.full(7, 0.3), follow)
    assert found[10] == []
    assert found[30] == [("joint_stuck", f"joint {joint + 1}")]
    shares = joint_shares(state, stands=True)
    assert shares[joint] > 0.0 and np.delete(shares, joint).max() == 0.0


def test_a_joint_that_brakes_is_astray_at_once_and_none_for_a_lag():
    state = MotionState()
    for k in range(20):
        rates = np.full(7, 0.1 * min(k, 10))
        late = np.full(7, 0.1 * min(max(k - 5, 0), 10))  # 50 ms behind
        late[3] = late[3] if k < 19 else 0.8
        check_joints(state, observation(k * DT, dq=late), DT, SETTINGS)
        if k < 19:
            assert np.abs(state.astray).max() == 0.0
        note_command(state, asked(rates=rates), observation(k * DT))
    assert state.astray[3] == pytest.approx(-0.2) and np.abs(np.delete(state.astray, 3)).max() == 0.0


def test_a_joint_that_leaves_its_commands_is_not_counted_on_before_it_is_named():
    """For a quarter of a second the program still went by a joint that stood, and put a finger on the table."""
    state, rates, given = MotionState(), np.full(7, 0.8), []
    follow = np.ones(7)
    for k in range(60):
        follow[3] = max(0.0, 1.0 - 0.2 * max(k - 10, 0))  # brakes and stands
        seen = observation(k * DT, dq=follow * rates)
        check_joints(state, seen, DT, SETTINGS)
        given.append((failing_joint(state), state.joint))
        rates[3] = 0.8 if failing_joint(state) is None else 0.05
        note_command(state, asked(rates=rates.copy()), seen)
    assert given[10] == (None, -1) and given[13] == (3, -1)
    assert all(failing == 3 for failing, _ in given[13:]) and given[45][1] == 3


def test_joints_that_follow_or_are_not_asked_are_not_named():
    assert joints(np.full(7, 0.3), np.full(7, 0.7))[1][-1] == []
    assert joints(np.full(7, 0.05), np.zeros(7))[1][-1] == []


def test_a_joint_at_its_end_may_stand():
    q = np.array([2.85, 0.0, 0.0, -1.5, 0.0, 1.5, 0.0])
    rates = np.array([0.3, 0, 0, 0, 0, 0, 0])
    assert joints(rates, np.zeros(7), q=q)[1][-1] == []


def test_a_freed_joint_is_no_longer_named():
    state, _ = joints(np.full(7, 0.3), np.array([1, 1, 0, 1, 1, 1, 1.0]))
    seen = observation(1.0, dq=np.full(7, 0.3))
    check_joints(state, seen, DT, SETTINGS)
    assert findings(state, seen, PROFILE.base, SETTINGS) == []


def fingers(frames, gripper="close", start=0.08):
    """Findings while the fingers are told to ``gripper`` and report these (width, moving)."""
    state, found = MotionState(gripper="open" if gripper == "close" else "close"), []
    note_command(state, asked(gripper=gripper), observation(0.0, width=start))
    for k, (width, moving) in enumerate(frames):
        seen = observation((k + 1) * DT, width=width, moving=moving)
        check_fingers(state, seen, PROFILE, SETTINGS)
        found.append([one.kind for one in findings(state, seen, PROFILE.base, SETTINGS)])
    return found


@pytest.mark.parametrize(("gripper", "width"), [("close", 0.08), ("open", 0.04)])
def test_fingers_that_stand_are_found_and_forgiven_when_they_move(gripper, width):
    found = fingers([(width, False)] * 60 + [(width, True)] * 5, gripper, width)
    assert found[20] == [] and found[50] == ["fingers_stuck"] and found[-1] == []


def test_fingers_that_move_or_have_nothing_to_do_are_not_named():
    assert fingers([(0.08 - 0.001 * k, True) for k in range(40)])[-1] == []
    assert fingers([(0.08, False)] * 80, "open", 0.08)[-1] == []
    assert fingers([(0.04, False)] * 80, "close", 0.04)[-1] == []
