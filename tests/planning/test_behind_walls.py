"""A base does not stand where a wall is between the arm's mount and its target."""

import numpy as np
import pytest

from motm_twin.model.profile import RobotProfile
from motm_twin.planning.parameters import PlanningParameters
from motm_twin.planning.reach import ReachModel
from motm_twin.planning.types import Target

WALL = np.array([[-2.0, 0.3, 2.0, 0.3]])  # along x, beyond the target


@pytest.fixture
def model():
    return ReachModel(RobotProfile(), PlanningParameters().reach)


def reached(model, pose, walls):
    target = Target(kind="pick", name="it", position=np.zeros(2), walls=np.asarray(walls).reshape(-1, 4))
    return bool(model.reached_from(np.array([pose]), target)[0])


@pytest.mark.parametrize("heading", [0.0, np.pi])
def test_from_behind_a_wall_nothing_is_reached(model, heading):
    near, behind = (0.0, -0.65, heading), (0.0, 0.65, heading)
    assert reached(model, behind, [])
    assert not reached(model, behind, WALL)
    assert reached(model, near, WALL)


def test_a_wall_that_ends_before_the_line_is_in_nobodys_way(model):
    assert reached(model, (0.0, 0.65, 0.0), [[-2.0, 0.3, -0.4, 0.3]])
