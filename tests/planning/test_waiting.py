"""Waiting until others have passed, when that is cheaper than to go in front of them."""

import msgspec
import numpy as np
import pytest
from idealised import rectangle, world_of

from motm_twin.control.tuning import tuned
from motm_twin.methods.registry import FORESIGHT
from motm_twin.model.profile import RobotProfile
from motm_twin.model.reason import Kind
from motm_twin.planning.collision import body_of
from motm_twin.planning.encounters import Weights
from motm_twin.planning.planner import BasePlanner
from motm_twin.planning.prediction import SPREAD
from motm_twin.planning.types import BaseProblem, PlanStatus, SearchBudget, Target
from motm_twin.planning.waiting import Among, best_wait

ROBOT = RobotProfile()
BODY = body_of(ROBOT.footprint)
WEIGHTS = Weights(10.0, 0.6, SPREAD)
PATH = np.array([(0.0, 0.0), (4.0, 0.0)])
STANDS = np.zeros(5)


def wait(*tracks, path=PATH, begins=0.0):
    rows = np.array([(*track, 0.25, 0.03, 1.0 + k, 1.0) for k, track in enumerate(tracks)]).reshape(-1, 8)
    return best_wait(STANDS, path, ROBOT.base, Among(rows, BODY, WEIGHTS), begins)


def test_nobody_is_not_waited_for():
    assert wait() == (0.0, 0.0, -1)


@pytest.mark.parametrize("track", [(1.2, 1.5, 0.0, 0.5), (1.2, -6.0, 0.0, 0.5), (-2.0, 0.0, -0.5, 0.0)])
def test_who_has_passed_or_comes_late_or_leaves_is_not_waited_for(track):
    assert wait(track).delay == 0.0


def test_who_crosses_the_path_when_the_base_would_be_there_is_waited_for():
    met = wait((1.0, 1.5, 0.0, 0.5), (1.2, -1.0, 0.0, 0.4))
    assert met.delay > 0.5 and met.track == 1
    assert met.cost >= met.delay


def test_a_base_that_gets_there_later_meets_those_who_come_later():
    late = (1.2, -3.0, 0.0, 0.5)
    assert wait(late).delay == 0.0
    assert wait(late, begins=4.0).delay > 0.0


def test_a_base_at_the_end_of_its_path_waits_for_nobody_who_keeps_clear():
    assert wait((3.0, 3.0, 0.0, 0.5), path=PATH[:1]).delay == 0.0


@pytest.mark.parametrize("speed", [0.0, 0.4])
def test_in_a_narrow_corridor_the_base_stands_and_says_for_whom(speed):
    corridor = world_of((rectangle(-1.5, 0.45, 2.0, 1.95), rectangle(-1.5, -1.95, 2.0, -0.45)))
    crossing = np.array([(2.4, -0.8, 0.0, 0.4, 0.25, 0.03, 7.0)])
    there = Target(kind="drive", name="there", position=np.array([4.0, 0.0]))
    problem = BaseProblem(
        time=0.0, world=msgspec.structs.replace(corridor, tracks=crossing), pose=np.array([0.6, 0.0, 0.0]),
        twist=np.array([speed, 0.0]), target=there, next_target=None, engaged=False,
    )  # fmt: skip
    planner = BasePlanner(ROBOT, tuned(FORESIGHT.parameters).planning)
    _, plan = planner.plan(problem, SearchBudget(expansions=300))
    assert plan.status == PlanStatus.BRAKING
    assert plan.why is not None and plan.why.kind == Kind.GIVES_WAY and plan.why.subject == "track 7"
    assert plan.acceleration[0] <= 0.0
