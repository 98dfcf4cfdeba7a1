"""motm2022 and holistic: the law, and the job done where nothing is in the way."""

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from motm_twin.methods.registry import METHODS, find_method
from motm_twin.model.profile import ArmSpec, RobotProfile
from motm_twin.model.scene_file import load_scene
from motm_twin.planning.parameters import PlanningParameters
from motm_twin.planning.types import BaseProblem, SearchBudget, Target, no_placement
from motm_twin.rivals.holistic import HolisticBase
from motm_twin.rivals.motm2022 import SIDES, departure, path_round, tangent
from motm_twin.trial import run_scene
from motm_twin.twin import Twin

OPEN_FLOOR = str(Path(__file__).with_name("open_floor.yaml"))
RADIUS = 0.6


def run(name, variant):
    """A trial on the open floor: the report and the Ticks."""
    ticks = []
    return run_scene(load_scene(OPEN_FLOOR, variant, 0), method=find_method(name), on_tick=ticks.append), ticks


@pytest.fixture(scope="module")
def tangential():
    """motm2022: a pick, and a drop beyond it."""
    return run("motm2022", "one")


@pytest.fixture(scope="module")
def whole_body():
    """holistic: a pick, and a drop behind."""
    return run("holistic", "back")


@settings(max_examples=50, deadline=None)
@given(
    st.tuples(st.floats(-5, 5), st.floats(-5, 5)).filter(lambda point: math.hypot(*point) > RADIUS + 0.01),
    st.sampled_from(SIDES),
)
def test_the_tangent_touches_the_circle_and_passes_it_on_its_side(point, side):
    pose = np.array([*point, 0.3])
    line = tangent(pose, np.zeros(2), RADIUS, side)
    touching, along = np.array(line.point), np.array([math.cos(line.heading), math.sin(line.heading)])
    assert np.hypot(*touching) == pytest.approx(RADIUS)
    assert touching @ along == pytest.approx(0.0, abs=1e-9)
    assert np.hypot(*(touching - pose[:2])) == pytest.approx(line.rho)
    assert (along[0] * -touching[1] + along[1] * touching[0]) * side > 0.0  # to the left of it for side 1


@pytest.mark.parametrize("side", SIDES)
def test_a_base_leaves_the_circle_where_it_heads_for_the_next_target(side):
    centre, onward = np.array([1.0, 2.0]), np.array([4.0, -1.0])
    angle = departure(centre, RADIUS, side, onward)
    assert angle is not None
    leaves = centre + RADIUS * np.array([math.cos(angle), math.sin(angle)])
    heading = angle + side * 0.5 * math.pi
    way = onward - leaves
    assert math.remainder(math.atan2(way[1], way[0]) - heading, 2.0 * math.pi) == pytest.approx(0.0, abs=1e-9)
    arc = path_round(tangent(np.array([-3.0, 0.0, 0.0]), centre, RADIUS, side), centre, RADIUS, side, onward)
    assert arc[-1] == pytest.approx(leaves)


def test_a_point_to_drive_to_has_no_circle():
    line = tangent(np.array([0.0, 0.0, 1.0]), np.array([3.0, 4.0]), 0.0, 1.0)
    assert line.point == pytest.approx((3.0, 4.0))
    assert line.rho == pytest.approx(5.0)


def test_motm2022_picks_and_places_on_the_move_where_nothing_is_in_the_way(tangential):
    result, _ = tangential
    assert result["success"], result["reason"]
    assert result["mean_closing_base_speed_mps"] > 0.45


def test_motm2022_passes_its_target_at_the_radius_of_the_circle(tangential):
    _, ticks = tangential
    stand = np.array([2.5, 0.7])
    nearest = min(float(np.hypot(*(tick.truth.pose[:2] - stand))) for tick in ticks)
    assert nearest == pytest.approx(RADIUS, abs=0.05)


def test_motm2022_knows_beforehand_when_the_target_comes_into_reach(tangential):
    _, ticks = tangential
    arrival = next(tick.time for tick in ticks if tick.plan.time_to_range == 0.0)
    early = next(tick for tick in ticks if tick.plan.time_to_range < 3.0)
    assert early.time + early.plan.time_to_range == pytest.approx(arrival, abs=0.2)


def test_motm2022_shows_both_tangent_points_and_takes_the_nearer(tangential):
    _, ticks = tangential
    placement = ticks[0].placement
    assert (placement.mode, len(placement.poses)) == ("ring", 2)
    turns = np.abs(np.remainder(placement.poses[:, 2] + math.pi, 2.0 * math.pi) - math.pi)
    assert placement.chosen == int(np.argmin(turns))
    assert np.hypot(*(placement.poses[:, :2] - [2.5, 0.7]).T) == pytest.approx(RADIUS, abs=0.1)


def test_holistic_picks_and_places_where_nothing_is_in_the_way(whole_body):
    result, _ = whole_body
    assert result["success"], result["reason"]


def test_the_base_of_holistic_reckons_from_the_mount_of_the_arm(whole_body):
    """An arm beside the middle of the base was taken for one in the middle: the way was too long, or too short."""
    target = Target(kind="pick", name="cube", position=np.array([0.15, 3.0]))
    problem = BaseProblem(
        time=0.0, world=whole_body[1][0].map, pose=np.zeros(3), twist=np.zeros(2), target=target, next_target=None,
        engaged=False,
    )  # fmt: skip
    times = []
    for y in (0.0, 0.2):
        base = HolisticBase(RobotProfile(arm=ArmSpec(mount_y=y)), PlanningParameters())
        times.append(base.plan(problem, no_placement(problem.pose), SearchBudget(expansions=1)).time_to_range)
    assert times[0] - times[1] == pytest.approx(0.2 / RobotProfile().base.forward_speed)


def test_the_base_of_holistic_moves_with_the_hand_and_rests_with_it(whole_body):
    _, ticks = whole_body
    speed = [abs(float(tick.observation.twist[0])) for tick in ticks if tick.task_index == 0]
    assert max(speed) > 0.45
    lifted = next(tick for tick in ticks if tick.arm[-1].phase == "lift")
    assert abs(float(lifted.observation.twist[0])) < 0.15
    assert not any(tick.plan.acceleration.any() for tick in ticks if not tick.done)  # nobody plans for it


def test_the_base_of_holistic_keeps_the_limits_of_all_methods(whole_body):
    _, ticks = whole_body
    limits = load_scene(OPEN_FLOOR, "back", 0).robot.base
    twists = np.array([step.actuation.twist for tick in ticks for step in tick.arm])
    changes = np.abs(np.diff(twists, axis=0)) / 0.01
    assert (twists[:, 0] <= limits.forward_speed + 1e-9).all()
    assert (twists[:, 0] >= -limits.reverse_speed - 1e-9).all()
    assert (np.abs(twists[:, 1]) <= limits.yaw_rate + 1e-9).all()
    assert (changes <= np.array([limits.linear_acceleration, limits.yaw_acceleration]) + 1e-6).all()


@pytest.mark.parametrize("name", ["motm2022", "holistic"])
def test_a_snapshot_is_gone_on_from_bit_for_bit(name):
    twin = Twin(load_scene(OPEN_FLOOR, "one", 0), method=METHODS[name])
    for _ in range(20):
        twin.advance()
    kept = twin.snapshot()
    for _ in range(10):
        twin.advance()
    once = twin.state_hash()
    twin.restore(kept)
    for _ in range(10):
        twin.advance()
    assert twin.state_hash() == once


@pytest.mark.parametrize("name", ["motm2022", "holistic"])
def test_drives_to_points_end_at_the_point(name):
    twin = Twin(load_scene(OPEN_FLOOR, "drive", 0), method=METHODS[name])
    tick = twin.advance()
    while not tick.done and tick.index < 200:
        tick = twin.advance()
    assert tick.success
    assert tick.truth is not None
    assert math.hypot(tick.truth.pose[0] - 1.5, tick.truth.pose[1] + 0.8) < 0.3
