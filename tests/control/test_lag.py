"""A base that answers with a lag: where its next command acts from, and when it is where a plan says."""

import math

import msgspec
import numpy as np
import pytest

from motm_twin.control.predictor import dwell_to_plan, followed
from motm_twin.model.motion import command_pose, drive
from motm_twin.model.profile import BaseLimits
from motm_twin.model.scene_file import load_scene
from motm_twin.sim.mechanics import Base
from motm_twin.sim.plant_state import BaseState
from motm_twin.twin import Twin

LAG, DT = 0.1, 0.001


def carried_out(state, twists, seconds):
    """Drive with these commands, each for so long [s]."""
    base = Base(BaseLimits(velocity_lag=LAG, linear_acceleration=9.0, yaw_acceleration=9.0), DT)
    for twist in twists:
        for _ in range(round(seconds / DT)):
            base.step(state, np.asarray(twist, dtype=float))


@pytest.mark.parametrize(("v", "w"), [(0.5, 0.0), (0.5, 0.4), (-0.2, 0.3)])
def test_a_base_that_is_told_to_stand_comes_to_rest_at_the_command_pose(v, w):
    state = BaseState(pose=np.array([1.0, 2.0, 0.7]), v=v, w=w)
    end = command_pose(state.pose, np.array([v, w]), LAG)
    assert math.dist(end[:2], state.pose[:2]) == pytest.approx(abs(v) * LAG, rel=0.01)
    carried_out(state, [(0.0, 0.0)], 1.0)
    assert np.abs(state.pose - end).max() < 0.002


def test_what_is_planned_from_the_command_pose_ends_where_the_base_does():
    """Speeding up and braking on the way: what was commanded last has no part in it."""
    state = BaseState(pose=np.zeros(3), v=0.2, w=0.0)
    planned = command_pose(state.pose, np.array([0.2, 0.0]), LAG)
    twists = [(0.3, 0.1), (0.5, 0.2), (0.5, 0.2), (0.3, 0.2), (0.1, 0.1), (0.0, 0.0)]
    for v, w in twists:
        planned = drive(planned, v, w, 0.2)
    carried_out(state, twists, 0.2)
    carried_out(state, [(0.0, 0.0)], 1.0)
    assert np.abs(state.pose - planned).max() < 0.004


def test_while_the_arm_is_at_work_the_base_stays_for_its_lag_by_itself():
    assert dwell_to_plan(0.7, True, LAG) == pytest.approx(0.6)
    assert dwell_to_plan(0.05, True, LAG) == 0.0
    assert dwell_to_plan(0.7, False, LAG) == 0.7
    assert dwell_to_plan(None, True, LAG) is None


def test_the_base_is_where_a_plan_says_after_its_lag():
    """Through a pick at speed: the pose of the plan at its time and the lag, against the true one then."""
    twin = Twin(load_scene("exp1", "trial1"))
    ticks = [twin.advance() for _ in range(240)]
    errors, at_once = [], []
    for before, after in zip(ticks[40:-10:7], ticks[50::7], strict=False):
        times, poses = before.plan.local_times, before.plan.local_poses
        if len(times) < 2 or times[-1] < 0.6 or before.observation.twist[0] < 0.3:
            continue
        true = np.array([*after.observation.pose])
        later = followed(before.plan, LAG)[1]
        for when, found in ((later, errors), (times, at_once)):
            there = [np.interp(after.time - before.time, when, poses[:, column]) for column in (0, 1)]
            found.append(math.dist(there, true[:2]))
    assert len(errors) > 8
    assert np.median(errors) < 0.02 < np.median(at_once)


def test_passed_time_counts_and_a_target_in_range_stays_in_range():
    twin = Twin(load_scene("exp1", "trial1"))
    plan = twin.advance().plan
    to_range, times = followed(plan, LAG, 0.02)
    assert to_range == pytest.approx(plan.time_to_range + 0.08)
    assert times[1] == pytest.approx(plan.local_times[1] + 0.08)
    assert followed(plan, LAG, 99.0)[1].max() == 0.0
    assert followed(msgspec.structs.replace(plan, time_to_range=0.0), LAG)[0] == 0.0
