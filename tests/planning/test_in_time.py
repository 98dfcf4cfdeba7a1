"""Candidates, ways and nodes are judged by who will be there when the base is."""

import dataclasses
import math

import msgspec
import numpy as np
import pytest

from motm_twin.model.known import KnownWorld
from motm_twin.model.profile import RobotProfile
from motm_twin.model.reason import Kind
from motm_twin.perception.base_map import base_map
from motm_twin.perception.world_map import NO_TRACKS, WorldMap
from motm_twin.planning.collision import body_of
from motm_twin.planning.commitment import KeepPlans
from motm_twin.planning.controller import StaaController
from motm_twin.planning.encounters import in_the_way
from motm_twin.planning.every_ring import EveryRing
from motm_twin.planning.in_time import InTime, delay_along
from motm_twin.planning.parameters import PlanningParameters, StaaParameters
from motm_twin.planning.placement import NextTargetPlacement
from motm_twin.planning.prediction import gap_to
from motm_twin.planning.types import BaseProblem, PlanStatus, SearchBudget, Target

ROBOT = RobotProfile()
BODY = body_of(ROBOT.footprint)
FLOOR = KnownWorld(
    robot=ROBOT, start=(0.0, 0.0, 0.0), solids=(), objects=(), object_sd=0.0, bins=(), tasks=(),
    bounds=(-2.0, -4.0, 7.0, 4.0),
)  # fmt: skip
BASE = base_map(FLOOR, 0.05)
BUDGET = SearchBudget(expansions=300)
PICK = Target(kind="pick", name="cube", position=np.array([3.0, 0.0]), dwell=1.3)


def world(*tracks):
    """An empty floor with tracks: x, y [m], velocity [m/s]."""
    rows = [(*track, 0.25, 0.03, 1.0 + k) for k, track in enumerate(tracks)]
    return WorldMap(
        stamp=0.0, resolution=0.05, origin=np.array(BASE.grid.origin), occupied=BASE.occupied, distance=BASE.distance,
        proximity=np.zeros_like(BASE.distance), polygons=(), seen_points=np.zeros((0, 2)),
        seen_static=np.zeros(0, bool), tracks=np.array(rows) if rows else NO_TRACKS,
    )  # fmt: skip


def ask(around, target=PICK, v=0.0, time=0.0):
    return BaseProblem(
        time=time, world=around, pose=np.zeros(3), twist=np.array([v, 0.0]), target=target, next_target=None,
        engaged=False,
    )  # fmt: skip


def place(around):
    rule = InTime(EveryRing(), ROBOT.base.velocity_lag)
    return NextTargetPlacement(ROBOT, PlanningParameters(), candidates=rule).place(ask(around))


def coming_to(goal, seconds, speed=0.5):
    """A track that will be at a place (2,) after so many seconds, coming along y."""
    return (goal[0], goal[1] - speed * seconds, 0.0, speed)


def test_a_candidate_that_somebody_will_have_left_is_as_good_as_any():
    free = place(world())
    leaving = place(world((*free.goal[:2], 0.0, 1.0)))
    assert leaving.goal == pytest.approx(free.goal)
    assert leaving.cost[leaving.chosen] == pytest.approx(free.cost[free.chosen], abs=0.3)


def test_a_candidate_that_somebody_will_be_standing_on_costs_the_time_until_it_is_free():
    free = place(world())
    arrival = free.cost_current[free.chosen]
    met = place(world(coming_to(free.goal, arrival + 0.5)))
    assert met.cost[free.chosen] > free.cost[free.chosen] + 0.5
    assert not np.isinf(met.cost[free.chosen])  # it is waited for when all others are dearer
    assert met.chosen != free.chosen


def test_waiting_is_the_reason_when_it_is_cheaper_than_every_other_place():
    free = place(world())
    late = free.cost_current[free.chosen]
    everywhere = [coming_to((x, y), late, 0.3) for x in (2.2, 2.7, 3.2, 3.7) for y in (-0.8, 0.0, 0.8)]
    met = place(world(*everywhere))
    assert met.chosen >= 0 and met.why.kind == Kind.SOON_FREE
    assert met.why.value > 0.0


@pytest.mark.parametrize(("start", "loses"), [(-1.5, True), (1.5, False), (-3.9, False)])
def test_a_way_loses_time_only_to_those_who_are_on_it_when_the_base_is(start, loses):
    path = np.array([(0.0, 0.0), (4.0, 0.0)])
    crossing = np.array([(1.5, start, 0.0, 0.5, 0.25, 0.03, 1.0)])
    delay = delay_along(path, 0.5, crossing, BODY)
    assert (delay > 0.5) == loses


def foresighted(**others):
    staa = dataclasses.replace(StaaParameters(), notches=5, risk_weight=10.0, courtesy_weight=2.5, **others)
    return StaaController(ROBOT, PlanningParameters(staa=staa), commitment=KeepPlans())


DRIVE = Target(kind="drive", name="there", position=np.array([5.0, 0.0]))


def drive(around, controller, v=0.5):
    problem = ask(around, DRIVE, v)
    placement = NextTargetPlacement(ROBOT, PlanningParameters()).place(problem)
    return controller.plan(problem, placement, BUDGET)


def least_gap(plan, track):
    gaps = []
    for pose, time in zip(plan.local_poses, plan.local_times, strict=True):
        later = time + ROBOT.base.velocity_lag
        disc = np.array([[track[0] + later * track[2], track[1] + later * track[3], 0.25]])
        gaps.append(gap_to(pose[0], pose[1], math.cos(pose[2]), math.sin(pose[2]), disc, BODY))
    return min(gaps)


@pytest.mark.parametrize("track", [(1.6, -1.5, 0.0, 0.6), (2.5, 0.2, -0.8, 0.0), (1.2, 1.0, 0.1, -0.5)])
def test_a_plan_keeps_clear_of_where_somebody_will_be(track):
    plan = drive(world(track), foresighted())
    assert plan.status in (PlanStatus.GOAL, PlanStatus.ABORTED)
    assert plan.local_times[-1] > 1.0
    assert least_gap(plan, track) > 0.0


def test_a_kept_plan_is_given_up_when_somebody_is_expected_on_it():
    controller = foresighted()
    drive(world(), controller)
    met = drive(world((1.2, -0.8, 0.0, 0.5)), controller)
    assert met.local_among[0] < 3.0
    assert least_gap(met, (1.2, -0.8, 0.0, 0.5)) > 0.0


@pytest.mark.parametrize(("place", "speed"), [((1.6, -1.4), 0.4), ((2.0, -1.6), 0.4), ((1.5, 1.5), -0.4)])
def test_a_plan_does_not_cut_in_on_those_who_would_yield(place, speed):
    one = np.array([(*place, 0.0, speed, 0.25, 0.03, 1.0)])

    def taken(controller):
        problem = msgspec.structs.replace(ask(world(), DRIVE, 0.5), yielding=one)
        plan = controller.plan(problem, NextTargetPlacement(ROBOT, PlanningParameters()).place(problem), BUDGET)
        assert plan.status in (PlanStatus.GOAL, PlanStatus.ABORTED)
        poses = zip(plan.local_poses[:, :3].tolist(), plan.local_times.tolist(), strict=True)
        return sum(in_the_way(x, y, math.cos(h), math.sin(h), time, one[0], BODY) for (x, y, h), time in poses)

    assert taken(StaaController(ROBOT, PlanningParameters())) > 4.0
    assert taken(foresighted()) < 1.0


def test_without_a_price_of_meetings_tracks_change_nothing():
    track, plain = (1.6, -1.5, 0.0, 0.6), StaaController(ROBOT, PlanningParameters())
    alone, among = drive(world(), plain), drive(world(track), plain)
    assert msgspec.to_builtins(alone.local_poses.tolist()) == msgspec.to_builtins(among.local_poses.tolist())
