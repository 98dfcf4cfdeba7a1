"""Nothing of planning is Frankie's by accident: what depends on the robot is derived, and Frankie's numbers stay."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from idealised import rectangle, world_of

from motm_twin.model.profile import BaseLimits, Footprint, RobotProfile
from motm_twin.model.reason import Kind, Reason
from motm_twin.planning.braking import stopping_clearance
from motm_twin.planning.collision import DENT, LARGEST, body_of, clearance, field_of
from motm_twin.planning.controller import StaaController
from motm_twin.planning.cost_to_go import FAR
from motm_twin.planning.global_path import goal_table, path_to_goal, rates_of
from motm_twin.planning.lattice import cells_of
from motm_twin.planning.parameters import PlanningParameters, StaaParameters, fitted, growth, room_for
from motm_twin.planning.rtr import path_rtr
from motm_twin.planning.types import BaseProblem, Placement, SearchBudget, Target
from motm_twin.planning.visibility import build_graph, inside, push_out

FRANKIE = RobotProfile()
JACKAL = RobotProfile(
    name="jackal",
    footprint=Footprint(length=0.508, width=0.43, height=0.25),
    base=BaseLimits(
        forward_speed=2.0, reverse_speed=1.0, yaw_rate=math.pi, linear_acceleration=3.0, yaw_acceleration=10.0
    ),
)
SIZES = st.floats(0.1, 3.0)


def robot(length: float, width: float, **limits: float) -> RobotProfile:
    return RobotProfile(footprint=Footprint(length=length, width=width), base=BaseLimits(**limits))


def test_obstacles_are_grown_by_half_the_width_of_the_base_and_8_cm():
    assert growth(FRANKIE.footprint, StaaParameters()) == 0.33
    assert growth(JACKAL.footprint, StaaParameters()) == pytest.approx(0.295)
    for tightness, room in ((0.0, 0.08), (1.0, 0.02)):
        assert room_for(PlanningParameters(), JACKAL.footprint, tightness).growth == pytest.approx(0.215 + room)


def test_frankie_searches_with_the_parameters_as_they_are():
    assert fitted(StaaParameters(), FRANKIE) == StaaParameters()
    assert cells_of(body_of(FRANKIE.footprint)) == 25
    assert (FRANKIE.base.stopping_way, round(FRANKIE.footprint.outer, 3)) == (pytest.approx(0.3), 0.43)


@pytest.mark.parametrize("fast", ["forward_speed", "reverse_speed"])
def test_a_base_that_is_as_fast_as_short_is_looked_at_at_least_once_for_each_of_its_lengths(fast):
    """Only the speed forward counted: in reverse a faster base stepped over walls, and could not stop in its map."""
    quick = robot(0.3, 0.3, **{fast: 5.0})
    fit = fitted(StaaParameters(), quick)
    assert 0.5 * fit.node_duration * getattr(quick.base, fast) <= quick.footprint.length
    assert fit.local_radius > quick.base.stopping_way > 25.0
    field = field_of(world_of((rectangle(2.0, -0.02, 2.04, 0.02),), (-1.0, -1.0, 9.0, 1.0)))
    post = stopping_clearance(0.0, 0.0, 0.0, 5.0, 0.0, 2.5, 1.0, 0.0, field, body_of(quick.footprint))
    assert post < 0.0  # 0.5 m between two looks would step over it


def test_the_local_region_is_left_only_where_the_base_can_stop_after_it():
    heavy = robot(1.0, 0.8, forward_speed=5.0, linear_acceleration=0.5)
    assert fitted(StaaParameters(), heavy).local_radius > heavy.base.stopping_way > 25.0


@settings(max_examples=40, deadline=None, derandomize=True)
@given(length=SIZES, width=SIZES, share=st.floats(0.0, 1.0), side=st.integers(0, 3))
def test_the_circles_of_a_footprint_leave_little_out_of_its_sides_however_large_it_is(length, width, share, side):
    body = body_of(Footprint(length=length, width=width))
    along = (2.0 * share - 1.0) * 0.5
    place = [(along * length, 0.5 * width), (along * length, -0.5 * width),
             (0.5 * length, along * width), (-0.5 * length, along * width)][side]  # fmt: skip
    gaps = np.hypot(*(body.circle[:, :2] - np.array(place)).T) - body.circle[:, 2]
    assert gaps.min() <= 0.25 * LARGEST + 1e-9


@settings(max_examples=40, deadline=None, derandomize=True)
@given(length=SIZES, width=SIZES, x=st.floats(-0.5, 0.5), y=st.floats(-0.5, 0.5))
def test_a_post_under_a_base_is_in_one_of_its_circles_however_large_it_is(length, width, x, y):
    body = body_of(Footprint(length=length, width=width))
    depth = min(0.5 * length - abs(x * length), 0.5 * width - abs(y * width))
    gaps = np.hypot(*(body.circle[:, :2] - np.array([x * length, y * width])).T) - body.circle[:, 2]
    assert gaps.min() <= max(0.0, 0.25 * LARGEST - depth) + 0.02


def test_the_circles_of_frankie_are_as_they_were():
    body = body_of(FRANKIE.footprint)
    assert len(body.circle) == 19
    assert np.unique(body.circle[:, 2]).tolist() == [0.0, 0.125, 0.25]


def test_a_point_between_polygons_that_nearly_touch_is_pushed_out_of_all_of_them():
    left, right = rectangle(0.0, 0.0, 1.0, 1.0), rectangle(1.661, 0.0, 2.661, 1.0)  # 1 mm apart when grown
    graph = build_graph((left, right), 0.33)
    for px in (1.2, 1.3, 1.329):
        x, y, pushed = push_out(px, 0.5, graph.outline, graph.solids)
        assert 0.0 < pushed < math.inf
        assert not inside(x, y, graph.outline), (px, x, y)


@settings(max_examples=60, deadline=None, derandomize=True)
@given(
    boxes=st.lists(st.tuples(st.floats(-2, 2), st.floats(-2, 2), st.floats(0.05, 0.8)), min_size=1, max_size=12),
    px=st.floats(-2, 2),
    py=st.floats(-2, 2),
)
def test_a_point_that_is_pushed_out_is_outside(boxes, px, py):
    graph = build_graph(tuple(rectangle(x - a, y - a, x + a, y + a) for x, y, a in boxes), 0.295)
    x, y, pushed = push_out(px, py, graph.outline, graph.solids)
    assert pushed < math.inf
    assert not inside(x, y, graph.outline)


def test_a_base_that_cannot_reverse_has_a_way_and_turns_for_it():
    limits = _changed(FRANKIE.base, reverse_speed=0.0)
    graph = build_graph((rectangle(-1.0, -0.2, -0.8, 0.2),), 0.33)
    rates = rates_of(limits)
    assert math.isfinite(rates.back) and rates.back < FAR
    table = goal_table(graph, np.array([[-2.0, 0.0, math.nan]]), rates)
    path, in_reverse = path_to_goal(graph, table, np.zeros(3))
    assert not in_reverse and len(path) >= 3
    way = np.array([[0.0, 0.0], [-1.0, 0.0]])
    turned = path_rtr(way, 0.0, None, v_f=0.5, v_r=0.0, w_max=1.0)
    assert turned == pytest.approx(math.pi + 2.0)


def test_a_base_that_cannot_reverse_plans_no_motion_backwards():
    profile = RobotProfile(base=_changed(FRANKIE.base, reverse_speed=0.0))
    target = Target(kind="drive", name="behind", position=np.array([-2.0, 0.0]), tolerance=0.15)
    problem = BaseProblem(
        time=0.0, world=world_of((), (-5.0, -5.0, 5.0, 5.0)), pose=np.zeros(3), twist=np.zeros(2), target=target,
        next_target=None, engaged=False,
    )  # fmt: skip
    placement = Placement(
        mode="drive", radius=0.0, poses=np.array([[-2.0, 0.0, math.pi]]), cost_current=np.ones(1),
        cost_next=np.zeros(1), cost=np.ones(1), rejected=("",), chosen=0, goal=np.array([-2.0, 0.0, math.pi]),
        goal_has_heading=False, why=Reason(kind=Kind.DRIVE), next_goal=None,
    )  # fmt: skip
    plan = StaaController(profile, PlanningParameters()).plan(problem, placement, SearchBudget(expansions=100))
    assert plan.status in ("goal", "aborted")
    assert plan.local_poses[:, 3].min() >= 0.0
    assert np.isfinite(plan.acceleration).all()


def _changed(limits: BaseLimits, **changed: float) -> BaseLimits:
    fields = {name: getattr(limits, name) for name in limits.__struct_fields__}
    return BaseLimits(**{**fields, **changed})


def test_the_clearance_of_a_wide_base_sees_a_post_at_the_middle_of_its_front():
    field = field_of(world_of((rectangle(0.58, -0.4, 0.6, -0.38),), (-4.0, -4.0, 4.0, 4.0), cell=0.02))
    body = body_of(Footprint(length=1.2, width=2.4))
    assert clearance(0.0, 0.0, 0.0, 1.0, field, body) < DENT
