"""A base does not stand where a wall is between the arm's mount and its target."""

import msgspec
import numpy as np
import pytest
from idealised import rectangle, world_of

from motm_twin.model.profile import RobotProfile
from motm_twin.planning.candidates import smallest_ring
from motm_twin.planning.every_ring import EveryRing
from motm_twin.planning.parameters import PlanningParameters
from motm_twin.planning.placement import NextTargetPlacement
from motm_twin.planning.planner import BasePlanner
from motm_twin.planning.reach import ReachModel
from motm_twin.planning.types import BaseProblem, PastWalls, SearchBudget, Target

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


def test_a_search_does_not_end_and_an_arm_does_not_leave_behind_a_wall(model):
    target = Target(kind="pick", name="it", position=np.zeros(2), walls=WALL)
    assert model.contains(np.array([0.0, -0.65, 0.0]), np.zeros(2), target)
    assert not model.contains(np.array([0.0, 0.65, 0.0]), np.zeros(2), target)


def test_where_no_pose_reaches_the_closest_place_is_before_the_wall_and_not_behind_it():
    """It drove round a wall to the place closest to its target, 0.6 m from it and out of its arm's reach."""
    counter, wall = rectangle(-2.0, -0.6, 2.0, 0.29), rectangle(-2.0, 0.3, 2.0, 0.31)
    corners = np.asarray(wall)
    target = Target(
        kind="pick", name="it", position=np.array([0.0, 0.25]), walls=np.hstack([corners, np.roll(corners, -1, axis=0)])
    )
    problem = BaseProblem(
        time=0.0, world=world_of((counter, wall), (-4, -4, 4, 4)), pose=np.array([0.0, -2.0, 0.0]), twist=np.zeros(2),
        target=target, next_target=None, engaged=False,
    )  # fmt: skip
    placement = NextTargetPlacement(RobotProfile(), PlanningParameters()).place(problem)
    assert placement.mode == "closest"
    assert placement.goal[1] < 0.0


@pytest.mark.parametrize("candidates", [smallest_ring, EveryRing()])
@pytest.mark.parametrize("closed", [False, True])
def test_an_arm_reaches_over_a_low_wall_only_where_there_is_no_other_place(candidates, closed):
    """From before a shelf it reached over the back panel of it for what stands on the other side."""
    counter, beyond = rectangle(-2.0, -0.3, 2.0, 0.3), rectangle(-2.5, 0.31, 2.5, 2.5)
    panel = np.asarray(rectangle(-2.0, 0.0, 2.0, 0.02))
    target = Target(
        kind="pick", name="it", position=np.array([0.0, 0.1]), walls=np.hstack([panel, np.roll(panel, -1, axis=0)]),
        tall=np.zeros((0, 4)),
    )  # fmt: skip
    problem = BaseProblem(
        time=0.0, world=world_of((counter, beyond) if closed else (counter,), (-4, -4, 4, 4)),
        pose=np.array([0.0, -2.0, 1.5]), twist=np.zeros(2), target=target, next_target=None, engaged=False,
    )  # fmt: skip
    rule = NextTargetPlacement(RobotProfile(), PlanningParameters(), candidates=candidates)
    planner = BasePlanner(RobotProfile(), placement=rule)
    placement, plan = planner.plan(problem, SearchBudget(expansions=300))
    assert (placement.mode, placement.past_walls > 0) == ("ring", closed)
    assert (placement.goal[1] > 0.3) == (not closed)
    there = msgspec.structs.replace(problem, pose=placement.goal)
    assert planner.drive(there, placement, SearchBudget(expansions=300)).time_to_range == 0.0
    assert plan.time_to_range > 0.0


@pytest.mark.parametrize(("reach_over", "how"), [(0.62, PastWalls.OVER_NEAR), (0.4, PastWalls.OVER)])
def test_over_a_low_wall_beside_its_target_an_arm_reaches_less_far(reach_over, how):
    """Its hand is high until it is past the wall; where no base comes so near, it tries from as far as ever."""
    counter, beyond = rectangle(-2.0, -0.15, 2.0, 0.3), rectangle(-2.5, 0.31, 2.5, 2.5)
    jars = np.asarray(rectangle(-2.0, -0.1, 2.0, 0.0))
    target = Target(
        kind="pick", name="it", position=np.array([0.0, 0.1]), walls=np.hstack([jars, np.roll(jars, -1, axis=0)]),
        tall=np.zeros((0, 4)), reach=0.75, reach_over=reach_over,
    )  # fmt: skip
    problem = BaseProblem(
        time=0.0, world=world_of((counter, beyond), (-4, -4, 4, 4)), pose=np.array([0.0, -2.0, 1.5]),
        twist=np.zeros(2), target=target, next_target=None, engaged=False,
    )  # fmt: skip
    planner = BasePlanner(RobotProfile(), placement=NextTargetPlacement(RobotProfile(), PlanningParameters()))
    placement, _ = planner.plan(problem, SearchBudget(expansions=300))
    assert placement.past_walls == how
    x, y, heading = placement.goal.tolist()
    arm = RobotProfile().arm
    mount = np.array([x + arm.mount_x * np.cos(heading), y + arm.mount_x * np.sin(heading)])
    assert (np.hypot(*(mount - target.position)) <= reach_over) == (how == PastWalls.OVER_NEAR)
