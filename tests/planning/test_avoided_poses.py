"""Where the arm was stuck, the base does not stand again."""

import math

import msgspec
import numpy as np
import pytest
from idealised import rectangle, step_unicycle, world_of

from motm_twin.model.profile import RobotProfile
from motm_twin.planning.candidates import is_avoided, smallest_ring, times_avoided
from motm_twin.planning.commitment import KeepPlans, SearchAnew
from motm_twin.planning.controller import StaaController
from motm_twin.planning.every_ring import EveryRing
from motm_twin.planning.parameters import PlanningParameters
from motm_twin.planning.placement import NextTargetPlacement
from motm_twin.planning.types import BaseProblem, SearchBudget, Target

WORLD = world_of((rectangle(1.0, 0.5, 3.0, 1.3),))
METHODS = [(smallest_ring, SearchAnew), (EveryRing(), KeepPlans)]


def problem_at(pose, twist=(0.0, 0.0), time: float = 0.0) -> BaseProblem:
    return BaseProblem(
        time=time, world=WORLD, pose=np.array(pose), twist=np.array(twist), engaged=False,
        target=Target(kind="pick", name="cube", position=np.array([2.0, 0.65]), dwell=1.3), next_target=None,
    )  # fmt: skip


def test_near_is_a_matter_of_place_and_heading():
    poses = np.array(
        [(1.0, 0.0, 0.1), (1.2, 0.0, 0.1), (1.3, 0.0, 0.1), (1.0, 0.0, 0.8), (1.0, 0.0, 0.1 - 2 * math.pi)]
    )
    assert times_avoided(poses, np.array([(1.0, 0.0, 0.1), (1.0, 0.1, 0.1)])).tolist() == [2, 2, 0, 0, 2]
    assert not is_avoided(poses[0], np.zeros((0, 3))) and is_avoided(poses[0], poses[1:2])


@pytest.mark.parametrize(("candidates", "commitment"), METHODS)
def test_the_base_goes_elsewhere_although_the_target_is_in_reach(candidates, commitment):
    rule = NextTargetPlacement(RobotProfile(), PlanningParameters(), candidates=candidates)
    base = StaaController(RobotProfile(), PlanningParameters(), commitment=commitment())
    was = rule.place(problem_at((1.0, -0.6, 0.5))).goal
    pose, twist = np.array(was), np.zeros(2)
    for k in range(300):
        problem = msgspec.structs.replace(problem_at(pose, twist, 0.05 * k), stuck_at=was[None])
        placed = rule.place(problem)
        assert not is_avoided(placed.goal, was[None])
        pose, twist = step_unicycle(
            pose, twist, base.plan(problem, placed, SearchBudget(expansions=300)).acceleration, 0.05
        )
        if not is_avoided(pose, was[None]):
            break
    assert k < 100
    assert math.hypot(*(pose[:2] - [2.0, 0.65])) < 1.0  # and still beside the cube


def test_where_there_is_no_other_place_it_stays():
    rule = NextTargetPlacement(RobotProfile(), PlanningParameters())
    placed = rule.place(problem_at((1.0, -0.6, 0.5)))
    everywhere = placed.poses[np.isfinite(placed.cost)]
    again = rule.place(msgspec.structs.replace(problem_at((1.0, -0.6, 0.5)), stuck_at=everywhere))
    assert again.mode == "ring" and again.chosen >= 0
