"""The base controller: searches, termination, clock, limits, recovery."""

import dataclasses
import math

import msgspec
import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from idealised import deliver, exact_clearance, polygons, rectangle, step_unicycle, world_of

from motm_twin.control.tuning import PRESETS, tuned
from motm_twin.model.known import known_world
from motm_twin.model.profile import BaseLimits, Footprint, RobotProfile
from motm_twin.model.scene_file import load_scene
from motm_twin.perception.still_map import StaticMap
from motm_twin.perception.world_map import WorldMap
from motm_twin.planning.braking import stopping_clearance
from motm_twin.planning.collision import body_of, clearance, field_of
from motm_twin.planning.parameters import PlanningParameters, StaaParameters
from motm_twin.planning.planner import BasePlanner
from motm_twin.planning.reach import ReachModel
from motm_twin.planning.types import BasePlan, BaseProblem, SearchBudget, Target

PERIOD = 0.05
HERE = np.zeros(3)
BUDGET = SearchBudget(expansions=300)


def ask(
    world: WorldMap,
    pose: np.ndarray,
    twist: np.ndarray,
    now: Target | None,
    after: Target | None = None,
    *,
    engaged: bool = False,
) -> BaseProblem:
    """One period's question."""
    return BaseProblem(time=0.0, world=world, pose=pose, twist=twist, target=now, next_target=after, engaged=engaged)


def pick(x: float, y: float, dwell: float = 1.3) -> Target:
    """An object."""
    return Target(kind="pick", name="cube", position=np.array([x, y]), dwell=dwell)


def drive_to(x: float, y: float, heading: float | None = None) -> Target:
    """A point or pose."""
    return Target(kind="drive", name="there", position=np.array([x, y]), heading=heading)


def go(
    world: WorldMap,
    pose: tuple,
    target: Target,
    *,
    seconds: float,
    twist: tuple = (0.0, 0.0),
    planner: BasePlanner | None = None,
) -> tuple[np.ndarray, list[BasePlan], float]:
    """Drive for a while: last pose, plans, least clearance (exact)."""
    planner = planner or BasePlanner(RobotProfile())
    here, moving = np.array(pose, dtype=float), np.array(twist, dtype=float)
    area = shapely.union_all([shapely.Polygon(p) for p in world.polygons])
    plans, least = [], math.inf
    for _ in range(round(seconds / PERIOD)):
        _, plan = planner.plan(ask(world, here, moving, target), BUDGET)
        plans.append(plan)
        here, moving = step_unicycle(here, moving, plan.acceleration, PERIOD)
        least = min(least, exact_clearance(here, area))
        if math.dist(here[:2], target.position) < 0.14:
            break
    return here, plans, least


def test_a_search_cut_by_the_clock_is_repeated_exactly_by_its_expansion_count() -> None:
    world = world_of(polygons())
    problem = ask(world, HERE, np.array([0.3, 0.2]), pick(4.2, 1.47), pick(5.3, 2.07))
    now = iter(0.001 * i for i in range(1000))
    timed = BasePlanner(RobotProfile(), clock=lambda: next(now))
    _, cut = timed.plan(problem, SearchBudget(expansions=500, seconds=0.0005))
    assert cut.cut_by_clock
    assert 0 < cut.expansions < 500
    _, again = BasePlanner(RobotProfile()).plan(problem, SearchBudget(expansions=cut.expansions))
    assert not again.cut_by_clock
    assert again.expansions == cut.expansions
    assert np.array_equal(again.acceleration, cut.acceleration)
    assert np.array_equal(again.local_poses, cut.local_poses)


def test_without_a_clock_time_is_not_looked_at_and_the_answer_is_always_the_same() -> None:
    world = world_of(polygons())
    problem = ask(world, HERE, np.array([0.3, 0.2]), pick(4.2, 1.47), pick(5.3, 2.07))
    _, one = BasePlanner(RobotProfile()).plan(problem, SearchBudget(expansions=200, seconds=0.0))
    planner = BasePlanner(RobotProfile())
    planner.plan(ask(world, HERE + 1.0, np.zeros(2), pick(5.3, 2.07)), BUDGET)
    planner.placement.restore(BasePlanner(RobotProfile()).placement.snapshot())
    _, two = planner.plan(problem, SearchBudget(expansions=200))
    assert np.array_equal(one.local_poses, two.local_poses)
    assert one.expansions == two.expansions


def test_what_was_looked_up_on_one_part_of_a_map_is_not_taken_for_another() -> None:
    # Moved on and of several sizes: what the number of a cell stands for differs, and so does what is seen from it.
    bounds = [(-2.5, -3.6, 7.4, 4.4), (-3.0, -3.6, 6.9, 4.4), (-2.5, -4.1, 7.4, 3.9), (-2.0, -3.6, 7.4, 4.4)]
    pose = np.array([3.4, 0.8, 3.0])  # the goal is on the other side of the table
    straight = PlanningParameters(staa=StaaParameters(bezier=False))  # every node's cost is looked up
    kept = BasePlanner(RobotProfile(), straight)
    for each in (*bounds, *bounds):
        problem = ask(world_of(polygons(boxes=True), each), pose, np.array([0.3, 0.0]), drive_to(3.6, 2.75))
        kept.placement.restore(BasePlanner(RobotProfile(), straight).placement.snapshot())
        _, plan = kept.plan(problem, BUDGET)
        _, fresh = BasePlanner(RobotProfile(), straight).plan(problem, BUDGET)
        assert np.array_equal(plan.local_poses, fresh.local_poses)
        assert np.array_equal(plan.local_to_go, fresh.local_to_go)


def test_whoever_pays_for_turning_turns_less_and_can_go_straight() -> None:
    # With 5 accelerations of turning a node changes the yaw rate by whole 15 deg/s: from 6 deg/s it is never 0.
    plain, steady = (
        PlanningParameters(staa=StaaParameters(notches=5, steadiness=steadiness)) for steadiness in (0.0, 0.02)
    )
    problem = ask(world_of(()), HERE, np.array([0.5, math.radians(6.0)]), drive_to(3.0, 0.05, 0.0))
    before, after = (
        np.degrees(BasePlanner(RobotProfile(), chosen).plan(problem, BUDGET)[1].local_poses[:, 4])
        for chosen in (plain, steady)
    )
    assert len(before) > 5
    assert not (np.abs(before) < 1e-9).any()
    assert (np.abs(after) < 1e-9).any()
    assert np.abs(np.diff(after)).sum() < np.abs(np.diff(before)).sum()


def test_steadiness_is_not_negative() -> None:
    with pytest.raises(ValueError, match="steadiness and the weights of others must not be negative"):
        StaaParameters(steadiness=-0.1)


def test_from_standstill_the_robot_starts() -> None:
    """Bug of the prototype: a closed list without speed froze a standing robot for ever."""
    _, plan = BasePlanner(RobotProfile()).plan(ask(world_of(polygons()), HERE, np.zeros(2), pick(3.1, 1.47)), BUDGET)
    assert plan.expansions > 3
    assert np.abs(plan.acceleration).max() > 0.1


@settings(max_examples=40, deadline=None)
@given(
    st.floats(-1.0, 6.4),
    st.floats(-2.5, 3.4),
    st.floats(-math.pi, math.pi),
    st.floats(-0.25, 0.5),
    st.floats(-1.74, 1.74),
)
def test_accelerations_never_lead_over_a_limit(x: float, y: float, heading: float, v: float, w: float) -> None:
    limits = BaseLimits()
    pose, twist = np.array([x, y, heading]), np.array([v, w])
    _, plan = PLANNER.plan(ask(WORLD, pose, twist, pick(4.2, 1.47), pick(5.3, 2.07)), SearchBudget(expansions=40))
    end = twist + plan.acceleration * PERIOD
    assert np.isfinite(plan.acceleration).all()
    assert abs(plan.acceleration[0]) <= limits.linear_acceleration + 1e-9
    assert abs(plan.acceleration[1]) <= limits.yaw_acceleration + 1e-9
    assert -limits.reverse_speed - 1e-9 <= end[0] <= limits.forward_speed + 1e-9
    assert abs(end[1]) <= limits.yaw_rate + 1e-9
    assert plan.reason or plan.status in ("goal", "aborted")


WORLD = world_of(polygons())
PLANNER = BasePlanner(RobotProfile())


def test_a_robot_with_a_box_dropped_beside_its_nose_moves_away() -> None:
    box = rectangle(0.37, -0.2, 0.87, 0.3)
    here, _, least = go(world_of((box,)), (0.0, 0.0, 0.0), drive_to(3.0, 0.0), seconds=25.0)
    assert math.dist(here[:2], (3.0, 0.0)) < 0.2
    assert least >= 0.019


def test_a_robot_between_two_boxes_reverses_out() -> None:
    boxes = (rectangle(-0.4, 0.30, 0.6, 0.6), rectangle(-0.4, -0.6, 0.6, -0.30), rectangle(0.45, -0.3, 0.6, 0.3))
    here, _, least = go(world_of(boxes), (0.0, 0.0, 0.0), drive_to(3.0, 0.0), seconds=40.0)
    assert math.dist(here[:2], (3.0, 0.0)) < 0.2
    assert least >= 0.03


def test_a_robot_beside_a_wall_nearer_than_the_margin_turns_away_without_touching() -> None:
    wall = rectangle(-2.0, 0.27, 2.0, 0.5)
    here, _, least = go(world_of((wall,)), (0.0, 0.0, 0.0), drive_to(0.0, -2.0), seconds=20.0)
    assert math.dist(here[:2], (0.0, -2.0)) < 0.2
    assert least > 0.0


def test_the_margin_does_not_ratchet_along_a_wall() -> None:
    """Bug of the prototype: a little less clearance every period ended in contact."""
    wall = rectangle(-3.0, 0.30, 7.0, 0.5)
    _, _, least = go(world_of((wall,)), (0.0, 0.0, 0.0), drive_to(5.0, 0.02), seconds=20.0)
    assert least >= 0.045


def test_a_moving_robot_stops_for_a_box_that_appears_in_front() -> None:
    clear = world_of((rectangle(6.0, 3.0, 6.5, 3.5),))
    planner = BasePlanner(RobotProfile())
    pose, twist = HERE, np.array([0.5, 0.0])
    planner.plan(ask(clear, pose, twist, drive_to(5.0, 0.0)), BUDGET)
    box = rectangle(0.70, -0.3, 1.2, 0.3)
    _, _, least = go(world_of((box,)), (0.0, 0.0, 0.0), drive_to(3.0, 0.0), seconds=20.0, twist=(0.5, 0.0))
    assert least > 0.0


def test_a_walled_in_robot_says_that_it_cannot_move_and_stays_whole() -> None:
    walls = (rectangle(0.38, -0.5, 0.5, 0.5), rectangle(-0.5, -0.5, -0.38, 0.5), rectangle(-0.5, 0.28, 0.5, 0.5),
             rectangle(-0.5, -0.5, 0.5, -0.28))  # fmt: skip
    _, plans, least = go(world_of(walls), (0.0, 0.0, 0.0), drive_to(3.0, 0.0), seconds=3.0)
    assert least > 0.015
    assert plans[-1].status in ("braking", "aborted")


def test_without_a_target_the_robot_comes_to_rest() -> None:
    planner, pose, twist = BasePlanner(RobotProfile()), HERE, np.array([0.5, 1.0])
    for _ in range(40):
        _, plan = planner.plan(ask(WORLD, pose, twist, None), BUDGET)
        assert plan.status == "idle"
        pose, twist = step_unicycle(pose, twist, plan.acceleration, PERIOD)
    assert np.allclose(twist, 0.0, atol=1e-9)


def test_an_engaged_base_keeps_the_object_in_reach_until_the_job_is_done() -> None:
    profile, parameters = RobotProfile(), PlanningParameters()
    model = ReachModel(profile, parameters.reach)
    planner = BasePlanner(profile, parameters)
    pose, twist, left = np.array([3.5, 0.87, 0.0]), np.array([0.45, 0.0]), 0.9
    speeds = []
    while left > 1e-9:
        target = pick(3.65, 1.47, dwell=left)
        problem = ask(
            WORLD, pose, twist, target, Target(kind="place", name="bin", position=np.array([4.25, -1.29])), engaged=True
        )
        _, plan = planner.plan(problem, BUDGET)
        pose, twist = step_unicycle(pose, twist, plan.acceleration, PERIOD)
        assert model.contains(pose, twist, target)
        speeds.append(twist[0])
        left -= PERIOD
    assert np.mean(speeds) > 0.2


def test_an_engaged_base_does_not_leave_for_a_place_to_wait() -> None:
    """Something that moves has taken all places while the fingers close: it backed out, and the cube stayed."""
    profile, parameters = RobotProfile(), PlanningParameters()
    model = ReachModel(profile, parameters.reach)
    planner = BasePlanner(profile, parameters)
    pose, twist, left = np.array([3.3, 0.87, 0.0]), np.zeros(2), 2.5
    while left > 1e-9:
        target = pick(3.65, 1.47, dwell=left)
        problem = ask(WORLD, pose, twist, target, engaged=True)
        placement = msgspec.structs.replace(
            planner.place(problem), mode="closest", goal=np.array([2.0, 0.6, 0.0]), goal_has_heading=False
        )
        plan = planner.drive(problem, placement, BUDGET)
        pose, twist = step_unicycle(pose, twist, plan.acceleration, PERIOD)
        assert model.contains(pose, twist, target), left
        left -= PERIOD


def test_time_to_range_counts_down_with_the_drive() -> None:
    planner, pose, twist, time = BasePlanner(RobotProfile()), HERE, np.zeros(2), 0.0
    predicted = []
    while time < 20.0:
        _, plan = planner.plan(ask(WORLD, pose, twist, pick(4.2, 1.47), pick(5.3, 2.07)), BUDGET)
        if plan.time_to_range == 0.0:
            break
        predicted.append((time, plan.time_to_range))
        pose, twist = step_unicycle(pose, twist, plan.acceleration, PERIOD)
        time += PERIOD
    moments = np.array(predicted)
    assert time < 20.0
    assert np.abs(moments[:, 0] + moments[:, 1] - time).max() < 1.5
    assert np.abs(moments[-20:, 0] + moments[-20:, 1] - time).max() < 0.4


def test_the_intermediate_goal_lies_on_the_border_of_the_local_region() -> None:
    planner = BasePlanner(RobotProfile())
    _, far = planner.plan(ask(WORLD, HERE, np.zeros(2), pick(5.3, 2.07)), BUDGET)
    assert math.hypot(*far.intermediate_goal[:2]) == pytest.approx(3.5, abs=1e-6)
    _, near = planner.plan(ask(WORLD, np.array([3.5, 0.5, 0.0]), np.zeros(2), pick(4.2, 1.47)), BUDGET)
    placement, _ = planner.plan(ask(WORLD, np.array([3.5, 0.5, 0.0]), np.zeros(2), pick(4.2, 1.47)), BUDGET)
    assert np.allclose(near.intermediate_goal, placement.goal)


def test_k_shrinks_towards_the_goal_and_stays_one_without_the_modification() -> None:
    _, far = BasePlanner(RobotProfile()).plan(ask(WORLD, HERE, np.zeros(2), pick(5.3, 2.07)), BUDGET)
    assert far.k == 1.0
    beside = np.array([3.6, 0.86, 0.0])
    _, near = BasePlanner(RobotProfile()).plan(ask(WORLD, beside, np.array([0.4, 0.0]), pick(4.2, 1.47)), BUDGET)
    assert near.k == pytest.approx(max(0.1, min(near.t_h / 3.0, 1.0)))
    assert near.k < 0.5
    fixed = dataclasses.replace(PlanningParameters(), staa=StaaParameters(scale_penalty=False))
    _, plain = BasePlanner(RobotProfile(), fixed).plan(ask(WORLD, beside, np.zeros(2), pick(4.2, 1.47)), BUDGET)
    assert plain.k == 1.0


@pytest.mark.parametrize("parameters", [tuned(PRESETS[name]).planning for name in ("STAA*", "The paper's words")])
def test_unmodified_staa_and_the_literal_paper_are_the_same_code_by_configuration(
    parameters: PlanningParameters,
) -> None:
    planner = BasePlanner(RobotProfile(), parameters, still=StaticMap(known_world(load_scene("exp1", "trial1"))))
    here, plans, least = go(WORLD, (0.0, 0.0, 0.0), drive_to(2.5, -0.5), seconds=15.0, planner=planner)
    assert math.dist(here[:2], (2.5, -0.5)) < 0.2
    assert least > 0.03
    assert plans[0].status in ("goal", "aborted")


def test_the_path_of_unmodified_staa_can_be_shown_beside_ours() -> None:
    planner = BasePlanner(RobotProfile())
    problem = ask(WORLD, HERE, np.zeros(2), pick(4.2, 2.07))
    placement, plan = planner.plan(problem, BUDGET)
    plain = planner.controller.unmodified_path(problem, placement)
    length = np.hypot(*np.diff(plain, axis=0).T).sum()
    assert np.allclose(plain[-1], placement.goal[:2])
    assert length <= np.hypot(*np.diff(plan.global_path, axis=0).T).sum() + 1e-9


def test_another_base_drives_with_its_own_footprint_and_limits() -> None:
    small = RobotProfile(
        name="small",
        footprint=Footprint(length=0.51, width=0.43),
        base=BaseLimits(forward_speed=2.0, reverse_speed=0.5, linear_acceleration=2.0, yaw_acceleration=4.0),
    )
    planner = BasePlanner(small)
    world, pose, twist = world_of(polygons()), HERE, np.zeros(2)
    target, fastest = drive_to(6.3, 0.0, heading=0.0), 0.0
    for _ in range(140):
        _, plan = planner.plan(ask(world, pose, twist, target), BUDGET)
        pose, twist = step_unicycle(pose, twist, plan.acceleration, PERIOD)
        fastest = max(fastest, twist[0])
        if math.dist(pose[:2], target.position) < 0.15:
            break
    assert math.dist(pose[:2], target.position) < 0.15
    assert 1.5 < fastest <= 2.0 + 1e-9


def test_the_footprint_circles_agree_with_the_exact_rectangle() -> None:
    shapes = polygons(boxes=True)
    world = world_of(shapes, cell=0.05)
    field, body = field_of(world), body_of(Footprint())
    area = shapely.union_all([shapely.Polygon(p) for p in shapes])
    rng = np.random.default_rng(3)
    errors = []
    while len(errors) < 400:
        pose = rng.uniform((-1.5, -2.5, -3.1), (6.5, 3.5, 3.1))
        exact = exact_clearance(pose, area)
        if 0.0 < exact < 0.2:
            errors.append(clearance(*pose, 1.0, field, body) - exact)
    assert max(errors) < 0.03
    assert min(errors) > -0.01


def test_outside_the_map_is_a_collision() -> None:
    world = world_of((), (-1, -1, 1, 1))
    assert clearance(0.9, 0.0, 0.0, 0.2, field_of(world), body_of(Footprint())) < 0.0
    assert clearance(0.0, 0.0, 0.0, 0.2, field_of(world), body_of(Footprint())) == pytest.approx(0.2, abs=1e-6)


def test_braking_needs_the_distance_that_physics_says() -> None:
    world = world_of((rectangle(1.0, -1.0, 1.5, 1.0),))
    field, body = field_of(world), body_of(Footprint())
    least = stopping_clearance(0.2, 0.0, 0.0, 0.5, 0.0, 0.5, 1.75, 0.19, field, body)
    assert least == pytest.approx(0.45 - 0.25, abs=0.02)


def test_a_pocket_of_experiment_1a_is_entered_and_left() -> None:
    done, free, modes = deliver(60.0)
    assert done
    assert free
    assert "reach" in modes
