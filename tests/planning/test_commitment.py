"""Keeping to a plan: until a better one is found, something stands in its way, or the target has moved."""

import dataclasses
import math

import msgspec
import numpy as np
import pytest
from idealised import rectangle, step_unicycle, world_of

from motm_twin.model.profile import RobotProfile
from motm_twin.model.state import state_hash
from motm_twin.planning.collision import body_of, clearances, field_of
from motm_twin.planning.commitment import KeepPlans
from motm_twin.planning.controller import StaaController
from motm_twin.planning.every_ring import EveryRing
from motm_twin.planning.parameters import PlanningParameters
from motm_twin.planning.placement import NextTargetPlacement
from motm_twin.planning.types import BasePlan, BaseProblem, SearchBudget, Target

PERIOD = 0.05
TABLE = rectangle(1.0, 0.5, 3.0, 1.3)
CUBE = (1.6, 0.65)
WHOLE, HARDLY = SearchBudget(expansions=2000), SearchBudget(expansions=1)


class Drive:
    """A robot beside a table that is to pick a cube, period by period."""

    def __init__(self):
        self.placement = NextTargetPlacement(RobotProfile(), PlanningParameters())
        self.controller = StaaController(RobotProfile(), PlanningParameters(), commitment=KeepPlans())
        self.pose, self.twist, self.time = np.array([0.7, 0.0, 0.0]), np.array([0.4, 0.0]), 0.0

    def problem(self, cube=CUBE, boxes=()) -> BaseProblem:
        return BaseProblem(
            time=self.time, world=world_of((TABLE, *boxes)), pose=self.pose, twist=self.twist, engaged=False,
            target=Target(kind="pick", name="cube", position=np.array(cube), dwell=1.3), next_target=None,
        )  # fmt: skip

    def period(self, budget, cube=CUBE, boxes=()) -> BasePlan:
        problem = self.problem(cube, boxes)
        plan = self.controller.plan(problem, self.placement.place(problem), budget)
        self.pose, self.twist = step_unicycle(self.pose, self.twist, plan.acceleration, PERIOD)
        self.time += PERIOD
        return plan


@pytest.fixture
def drive():
    return Drive()


def test_a_plan_that_arrives_is_kept_when_no_search_finds_one(drive):
    first = drive.period(WHOLE)
    assert first.status == "goal"
    for k in range(1, 9):
        plan = drive.period(HARDLY)  # alone, it would not get far
        assert plan.status == "goal"
        assert plan.local_to_go[0] == pytest.approx(np.interp(k * PERIOD, first.local_times, first.local_to_go))
        assert np.allclose(plan.local_poses[-1], first.local_poses[-1], atol=5e-3)
        assert plan.local_times[-1] == pytest.approx(first.local_times[-1] - k * PERIOD)


def test_what_is_left_never_grows_while_nothing_happens(drive):
    left = [drive.period(WHOLE).local_to_go[0] for _ in range(12)]  # until the cube is in reach
    assert (np.diff(left) < 0.0).all()


def test_nothing_is_looked_at_that_is_dearer_than_what_is_left(drive):
    drive.period(WHOLE)
    for _ in range(5):
        problem = drive.problem()
        anew = StaaController(RobotProfile(), PlanningParameters()).plan(problem, drive.placement.place(problem), WHOLE)
        plan = drive.period(WHOLE)
        assert plan.local_to_go[0] <= anew.local_to_go[0]
        assert plan.expansions <= anew.expansions
    assert plan.expansions < anew.expansions


def test_a_box_in_its_way_ends_it(drive):
    first = drive.period(WHOLE)
    ahead = first.local_poses[-1]
    box = rectangle(ahead[0] - 0.1, ahead[1] - 0.1, ahead[0] + 0.1, ahead[1] + 0.1)
    plan = drive.period(WHOLE, boxes=(box,))
    world = world_of((TABLE, box))
    assert (clearances(plan.local_poses[:, :3], 1.0, field_of(world), body_of(RobotProfile().footprint)) >= 0.05).all()


def test_a_target_that_has_moved_ends_it(drive):
    drive.period(WHOLE)
    assert drive.period(HARDLY, cube=(CUBE[0] + 0.6, CUBE[1])).status != "goal"
    assert drive.period(HARDLY).status != "goal"


def test_a_copy_goes_on_as_the_one_it_was_copied_from(drive):
    drive.period(WHOLE)
    copy = Drive()
    copy.controller.commitment.restore(drive.controller.commitment.snapshot())
    copy.pose, copy.twist, copy.time = drive.pose, drive.twist, drive.time
    assert state_hash(copy.period(HARDLY)) == state_hash(drive.period(HARDLY))
    assert state_hash(copy.controller.commitment.snapshot()) == state_hash(drive.controller.commitment.snapshot())


def test_the_costs_of_a_plan_are_what_the_search_counts():
    problem = BaseProblem(
        time=0.0, world=world_of((TABLE,)), pose=np.array([0.7, 0.0, 0.0]), twist=np.array([0.4, 0.0]), engaged=False,
        target=Target(kind="pick", name="cube", position=np.array(CUBE), dwell=1.3), next_target=None,
    )  # fmt: skip
    parameters = PlanningParameters()
    free = dataclasses.replace(parameters, staa=dataclasses.replace(parameters.staa, grid_weight=0.0, margin_cost=0.0))
    placement = NextTargetPlacement(RobotProfile(), free).place(problem)
    plan = StaaController(RobotProfile(), free).plan(problem, placement, WHOLE)
    assert plan.status == "goal"  # nothing comes after it: what is left is time
    assert plan.local_to_go == pytest.approx(plan.local_times[-1] - plan.local_times)


def test_all_rings_are_tried_and_the_nearest_way_wins():
    """The smallest ring is free only beyond the table; a little further out there is room on this side."""
    table = rectangle(1.0, 0.55, 3.0, 1.3)
    problem = BaseProblem(
        time=0.0, world=world_of((table,)), pose=np.array([0.0, 0.0, 0.0]), twist=np.zeros(2), engaged=False,
        target=Target(kind="pick", name="cube", position=np.array([2.0, 0.95])), next_target=None,
    )  # fmt: skip
    strict = NextTargetPlacement(RobotProfile(), PlanningParameters()).place(problem)
    wide = NextTargetPlacement(RobotProfile(), PlanningParameters(), candidates=EveryRing()).place(problem)
    assert len(wide.poses) == 5 * 72
    assert wide.chosen >= 0 and wide.cost[wide.chosen] <= strict.cost[strict.chosen]


def test_the_chosen_pose_stays_while_it_is_free_at_all():
    placement = NextTargetPlacement(RobotProfile(), PlanningParameters(), candidates=EveryRing())

    def place(*more):
        """With a table, and perhaps a box."""
        return placement.place(
            BaseProblem(
                time=0.0, world=world_of((TABLE, *more)), pose=np.array([0.0, 0.0, 0.0]), twist=np.zeros(2),
                target=Target(kind="pick", name="cube", position=np.array(CUBE)), next_target=None, engaged=False,
            )
        )  # fmt: skip

    def box(away):
        """This far [m] in front of the robot at the chosen pose."""
        x, y, heading = first.goal
        ahead = RobotProfile().footprint.length / 2 + RobotProfile().footprint.offset_x + away
        x, y = x + ahead * math.cos(heading), y + ahead * math.sin(heading)
        return rectangle(x, y - 0.02, x + 0.04, y + 0.02)

    first = place()
    assert np.allclose(place(box(0.04)).goal, first.goal)
    assert not np.allclose(place(box(-0.06)).goal, first.goal)
    assert not np.allclose(place(box(0.04)).goal, first.goal)  # to be chosen anew it must have its whole clearance


class Taken:
    """The map once what moves is gone."""

    def __init__(self, world):
        self.world = world

    def of(self, _world):
        return self.world


def _before_a_table_that_is_taken(still):
    """A robot that drives to the south side of a table, along which people walk; the free side is the north."""
    south = [(x, y) for x in (0.6, 1.2, 1.8, 2.4) for y in (0.05, -0.4)]
    walkers = [rectangle(x - 0.2, y - 0.2, x + 0.2, y + 0.2) for x, y in (*south, (0.6, 0.9))]
    world = world_of((TABLE, *walkers))
    problem = BaseProblem(
        time=0.0, world=world, pose=np.array([-0.8, -1.2, 0.0]), twist=np.zeros(2), engaged=False,
        target=Target(kind="pick", name="cube", position=np.array(CUBE)), next_target=None,
    )  # fmt: skip
    placement = NextTargetPlacement(RobotProfile(), PlanningParameters(), candidates=EveryRing(still))
    return problem, placement.place(problem)


def test_it_waits_beside_what_moves_and_does_not_go_round_the_table():
    _, closest = _before_a_table_that_is_taken(None)
    problem, beside = _before_a_table_that_is_taken(Taken(world_of((TABLE,))))
    assert closest.mode in ("reach", "closest") and closest.goal[1] > 1.3  # the other side
    assert beside.mode == "closest" and beside.goal[1] < 0.5
    assert beside.reason.startswith("moving obstacles take every place to stand for cube")
    free = clearances(beside.goal[None], 1.0, field_of(problem.world), body_of(RobotProfile().footprint))
    assert free[0] >= PlanningParameters().placement.clearance
    assert beside.cost[beside.chosen] < closest.cost_current[closest.chosen]
    assert len(beside.poses) <= 72
    away = np.hypot(*(beside.poses[:, :2] - CUBE).T)
    assert beside.radius == pytest.approx(away.min(), abs=0.01)


def test_what_is_taken_by_furniture_is_not_waited_for():
    _, closest = _before_a_table_that_is_taken(None)
    walled = [rectangle(-0.5, -0.6, 4.0, 0.5), rectangle(0.4, 0.5, 1.0, 3.0), rectangle(1.0, 1.3, 3.0, 2.5)]
    _, placement = _before_a_table_that_is_taken(Taken(world_of((TABLE, *walled))))
    assert np.allclose(placement.goal, closest.goal) and "what moves" not in placement.reason


@pytest.mark.parametrize(
    ("speed", "radius", "lost"), [(0.5, 0.6, 0.0), (0.5, 0.7, 0.22), (0.5, 0.75, 1.3), (1.0, 0.6, 0.12)]
)
def test_what_is_lost_by_passing_more_slowly_counts(speed, radius, lost):
    """With a reach of 0.75 m (0.77 less the slack of plans) a job of 1.3 s takes 0.65 m at 0.5 m/s, 0.99 at 0.76."""
    base = msgspec.structs.replace(RobotProfile().base, forward_speed=speed)
    profile = msgspec.structs.replace(RobotProfile(), base=base)

    def costs(dwell):
        target = Target(kind="pick", name="cube", position=np.array(CUBE), dwell=dwell)
        problem = BaseProblem(
            time=0.0, world=world_of(()), pose=np.array([0.0, 0.0, 0.0]), twist=np.zeros(2), target=target,
            next_target=None, engaged=False,
        )  # fmt: skip
        placement = NextTargetPlacement(profile, PlanningParameters(), candidates=EveryRing()).place(problem)
        on_ring = np.isclose(np.hypot(*(placement.poses[:, :2] - CUBE).T), radius)
        return placement.cost_current[on_ring & np.isfinite(placement.cost_current)]

    assert len(costs(1.3)) > 10
    assert costs(1.3) - costs(0.0) == pytest.approx(lost, abs=0.01)
