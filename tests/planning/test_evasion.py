"""Moving out of the way of what would meet the base."""

import msgspec
import numpy as np
import pytest

from motm_twin.model.known import KnownWorld
from motm_twin.model.profile import RobotProfile
from motm_twin.model.reason import Kind, Reason
from motm_twin.perception.base_map import base_map
from motm_twin.perception.world_map import WorldMap
from motm_twin.planning.collision import body_of, clearances, field_of
from motm_twin.planning.evasion import MakesWay, StandsItsGround
from motm_twin.planning.prediction import gap_to
from motm_twin.planning.types import BasePlan, BaseProblem, PlanStatus, empty_path

PROFILE = RobotProfile()
BODY = body_of(PROFILE.footprint)
KNOWN = KnownWorld(
    robot=PROFILE, start=(0.0, 0.0, 0.0), solids=(), objects=(), object_sd=0.0, bins=(), tasks=(),
    bounds=(-5.0, -5.0, 5.0, 5.0),
)  # fmt: skip


def world_with(*tracks):
    base = base_map(KNOWN, 0.05)
    rows = np.array([(*t, 0.03, 1.0 + k) for k, t in enumerate(tracks)]).reshape(-1, 7)
    return WorldMap(
        stamp=0.0, resolution=0.05, origin=np.array(base.grid.origin), occupied=base.occupied, distance=base.distance,
        proximity=np.zeros_like(base.distance), polygons=(), seen_points=np.zeros((0, 2)),
        seen_static=np.zeros(0, bool), tracks=rows,
    )  # fmt: skip


def problem(world, time=0.0, *, engaged=False):
    return BaseProblem(
        time=time, world=world, pose=np.zeros(3), twist=np.zeros(2), target=None, next_target=None, engaged=engaged
    )


def standing_plan():
    return BasePlan(
        acceleration=np.zeros(2), status=PlanStatus.IDLE, why=Reason(kind=Kind.NOTHING_TO_DO), global_path=empty_path(),
        next_path=empty_path(), intermediate_goal=np.zeros(3), local_poses=np.zeros((1, 5)), local_times=np.zeros(1),
        bezier=empty_path(), expansions=0, cut_by_clock=False, t_h=0.0, k=1.0, time_to_range=np.inf,
    )  # fmt: skip


def least_gap(plan, track):
    """Least distance [m] between footprint and track while both go on."""
    gaps = []
    for pose, time in zip(plan.local_poses, plan.local_times, strict=True):
        disc = np.array([[track[0] + time * track[2], track[1] + time * track[3], track[4]]])
        gaps.append(gap_to(pose[0], pose[1], np.cos(pose[2]), np.sin(pose[2]), disc, BODY))
    return min(gaps)


@pytest.mark.parametrize(
    "track", [(1.9, 0.3, -0.5, 0.0, 0.25), (-1.5, 0.1, 0.5, 0.0, 0.3), (1.2, 1.2, -0.5, -0.5, 0.2)]
)
def test_a_base_that_stands_in_the_way_leaves_it(track):
    way = MakesWay(KNOWN)
    plan = way.instead(problem(world_with(track)), standing_plan(), BODY, PROFILE.base)
    assert plan.status == PlanStatus.ESCAPING
    assert plan.why is not None and plan.why.kind == Kind.MAKES_WAY
    assert least_gap(plan, track) > 0.0
    assert clearances(np.ascontiguousarray(plan.local_poses[:, :3]), 1.0, field_of(world_with()), BODY).min() > 0.04


def test_it_makes_no_way_for_those_who_are_expected_to_yield_but_tells_of_them():
    coming = world_with((1.7, 0.0, -0.5, 0.0, 0.25)).tracks
    asked = msgspec.structs.replace(problem(world_with()), yielding=coming)
    plan = MakesWay(KNOWN).instead(asked, standing_plan(), BODY, PROFILE.base)
    assert plan.status == PlanStatus.IDLE
    assert [other.track for other in plan.encounters] == [1]


def test_the_paper_stands_its_ground():
    plan = standing_plan()
    coming = world_with((1.0, 0.0, -0.6, 0.0, 0.25))
    assert StandsItsGround().instead(problem(coming), plan, BODY, PROFILE.base) is plan


def test_who_passes_by_is_let_pass():
    passing = (1.0, 1.2, -0.6, 0.0, 0.25)
    plan = MakesWay(KNOWN).instead(problem(world_with(passing)), standing_plan(), BODY, PROFILE.base)
    assert plan.status == PlanStatus.IDLE
