"""What the base thinks the arm can reach."""

import math

import numpy as np
import pytest

from motm_twin.model.profile import RobotProfile
from motm_twin.model.scene import HEADING_TOLERANCE
from motm_twin.planning.parameters import ReachParameters, StaaParameters
from motm_twin.planning.reach import ReachModel
from motm_twin.planning.types import Target

STANDING = np.zeros(2)


def at(radius, azimuth, kind="pick"):
    """A target at a radius [m] and azimuth [rad] about the mount of a robot at the origin."""
    position = np.array([0.15 + radius * math.cos(azimuth), radius * math.sin(azimuth)])
    return Target(kind=kind, name="cube", position=position, dwell=1.0)


@pytest.mark.parametrize("azimuth", [0.0, 1.5, -1.5, 2.5, -2.5])
def test_what_is_at_arm_s_length_is_in_reach(azimuth):
    assert ReachModel(RobotProfile(), ReachParameters()).contains(np.zeros(3), STANDING, at(0.6, azimuth))


@pytest.mark.parametrize(("radius", "azimuth"), [(0.3, 0.0), (0.8, 0.0), (0.6, 2.7), (0.6, -2.7), (0.6, math.pi)])
def test_what_is_too_near_too_far_or_behind_joint_1_is_not(radius, azimuth):
    model = ReachModel(RobotProfile(), ReachParameters())
    assert not model.contains(np.zeros(3), STANDING, at(radius, azimuth))
    assert not model.reached_from(np.zeros((1, 3)), at(radius, azimuth))[0]


def test_a_bin_is_reached_from_further_away_than_a_cube():
    model = ReachModel(RobotProfile(), ReachParameters())
    assert model.contains(np.zeros(3), STANDING, at(0.85, 0.0, "place"))
    assert not model.contains(np.zeros(3), STANDING, at(0.85, 0.0, "pick"))


def test_an_object_that_passes_too_fast_is_not_in_reach():
    model = ReachModel(RobotProfile(), ReachParameters())
    assert not model.contains(np.zeros(3), np.array([0.0, 2.0]), at(0.6, 1.5))


def test_a_drive_is_at_its_heading_for_the_planner_only_when_its_task_is_done():
    """With a slider at 60 deg the base stood 40 deg off, satisfied, and the task went on for ever."""
    model = ReachModel(RobotProfile(), ReachParameters())
    goal = Target(kind="drive", name="", position=np.zeros(2), dwell=0.0, heading=0.0, tolerance=0.15)
    for off, there in ((0.9 * HEADING_TOLERANCE, True), (1.1 * HEADING_TOLERANCE, False)):
        pose = np.array([0.0, 0.0, off])
        assert model.contains(pose, STANDING, goal, StaaParameters(pass_heading=math.radians(60.0))) == there
