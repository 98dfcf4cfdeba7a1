"""The search among others, which looks farther ahead in longer steps."""

import itertools

import msgspec
import numpy as np
import pytest
from idealised import rectangle, world_of

from motm_twin.control.tuning import tuned
from motm_twin.methods.registry import FORESIGHT
from motm_twin.model.profile import BaseLimits, Footprint, RobotProfile
from motm_twin.planning.planner import BasePlanner
from motm_twin.planning.types import BasePlan, BaseProblem, SearchBudget, Target

QUICK = RobotProfile(
    footprint=Footprint(length=0.3, width=0.3),
    base=BaseLimits(forward_speed=3.0, reverse_speed=1.0, yaw_rate=4.0, linear_acceleration=2.0, yaw_acceleration=6.0),
)
THERE = Target(kind="drive", name="there", position=np.array([5.0, 0.0]))
WALL = (1.975, -1.0, 2.025, 1.0)
OTHERS = ((0.15, -1.05, 0.6, 0.16), (0.17, -0.27, -0.04, -0.68), (1.32, -1.55, -0.22, 0.03))


@pytest.fixture(scope="module")
def planned() -> tuple[BasePlanner, BasePlan]:
    """A small quick base that is to drive round a thin wall, among others."""
    tracks = np.array([(*other, 0.25, 0.05, float(k)) for k, other in enumerate(OTHERS)])
    problem = BaseProblem(
        time=0.0, world=msgspec.structs.replace(world_of((rectangle(*WALL),)), tracks=tracks),
        pose=np.array([-0.6, 0.0, 0.0]), twist=np.zeros(2), target=THERE, next_target=None, engaged=False,
    )  # fmt: skip
    planner = BasePlanner(QUICK, tuned(FORESIGHT.parameters).planning)
    return planner, planner.plan(problem, SearchBudget(expansions=300))[1]


def test_the_closed_list_has_room_for_every_node(planned: tuple[BasePlanner, BasePlan]) -> None:
    """It had room for those that are expanded, but takes those of full layers too: a full list is searched for ever."""
    memory = planned[0].controller._far
    assert memory is not None
    assert len(memory.closed) > len(memory.cost)


def test_no_step_leads_through_a_thin_wall(planned: tuple[BasePlanner, BasePlan]) -> None:
    """Twice as long a step as that of the near search took a base of 0.3 m 1.1 m on, through the wall."""
    x_0, y_0, x_1, y_1 = WALL
    for one, two in itertools.pairwise(planned[1].local_poses[:, :2]):
        beside = np.linspace(one, two, 50)
        inside = (beside > (x_0 - 0.01, y_0)) & (beside < (x_1 + 0.01, y_1))
        assert not inside.all(axis=1).any(), (one, two)
