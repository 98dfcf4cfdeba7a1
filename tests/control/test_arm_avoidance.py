"""The damper line of the paper, and what may come how near."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from motm_twin.control.arm import limits as arm_limits
from motm_twin.control.arm.bodies import BODIES, arm_balls, placed
from motm_twin.control.arm.geometry import nearest_distance
from motm_twin.control.arm.limits import LidarLimits, damper_line
from motm_twin.control.arm.parameters import AvoidanceParameters, numbers

PARAMETERS = AvoidanceParameters()
NO_TARGETS = np.zeros((0, 2))


def obstacles(points, static):
    points = np.array(points, dtype=float).reshape(-1, 2)
    return points, np.full(len(points), static)


def lidar_limits(gripper, obstacles, targets, parameters) -> LidarLimits:
    return arm_limits.lidar_limits(gripper, *obstacles, targets, numbers(parameters))


@pytest.mark.parametrize(("d", "speed"), [(0.6, 0.6), (0.425, 0.3), (0.25, 0.0), (0.18, -0.12)])
def test_the_damper_line_has_the_papers_values(d, speed):
    assert damper_line(d, 0.25, 0.6, 0.6) == pytest.approx(speed, abs=1e-3)


@pytest.mark.parametrize(("away", "d_s"), [(0.15, 0.10), (0.50, 0.25), (0.02, 0.0)])
def test_a_static_obstacle_gives_way_to_a_target_close_to_it(away, d_s):
    limits = lidar_limits(np.zeros(3), obstacles([(0.5, 0.0)], True), np.array([[0.5 - away, 0.0]]), PARAMETERS)
    assert limits.d_s[0] == pytest.approx(d_s)


def test_d_s_of_a_static_obstacle_follows_the_distance_of_the_whole_obstacle_to_the_target():
    wall = [(0.30, y) for y in np.arange(-0.3, 0.31, 0.05)]
    limits = lidar_limits(np.zeros(3), obstacles(wall, True), np.array([[0.15, 0.0]]), PARAMETERS)
    np.testing.assert_allclose(limits.d_s, 0.10, atol=1e-9)


def test_another_static_obstacle_keeps_its_distance():
    points = [(0.30, 0.0), (-0.5, 0.0)]
    limits = lidar_limits(np.zeros(3), obstacles(points, True), np.array([[0.15, 0.0]]), PARAMETERS)
    assert limits.d_s[limits.normal[:, 0] > 0] == pytest.approx(0.10)
    assert limits.d_s[limits.normal[:, 0] < 0] == pytest.approx(0.25)


def test_a_moving_obstacle_keeps_its_distance_beside_any_target():
    limits = lidar_limits(np.zeros(3), obstacles([(0.30, 0.0)], False), np.array([[0.15, 0.0]]), PARAMETERS)
    assert limits.d_s[0] == 0.25
    assert limits.allowed[0] == pytest.approx(0.6 * (0.05 - 0.035) / 0.35)  # it may begin within its cell


def test_without_a_grasp_under_way_a_static_obstacle_keeps_its_distance():
    limits = lidar_limits(np.zeros(3), obstacles([(0.30, 0.0)], True), NO_TARGETS, PARAMETERS)
    assert limits.d_s[0] == 0.25


def test_obstacles_on_both_sides_limit_both_directions():
    limits = lidar_limits(np.zeros(3), obstacles([(0.4, 0.0), (-0.3, 0.0), (0.0, 2.0)], False), NO_TARGETS, PARAMETERS)
    assert len(limits.distance) == 2
    assert limits.distance[0] == pytest.approx(0.3)
    np.testing.assert_allclose(limits.normal[0], [-1.0, 0.0])


@pytest.mark.parametrize("static", [False, True])
def test_what_is_beyond_the_end_of_the_line_limits_nothing_but_is_reported(static):
    far = obstacles([(PARAMETERS.d_i + PARAMETERS.lead + 0.05, 0.0)], static)
    assert len(lidar_limits(np.zeros(3), far, NO_TARGETS, PARAMETERS).distance) == 0
    assert nearest_distance(np.zeros(3), far[0]) == pytest.approx(1.15)


@pytest.mark.parametrize(("static", "margin"), [(False, 0.035), (True, 0.0)])  # a static one may move again
def test_the_line_goes_on_beyond_d_i_so_that_nothing_crosses_it_too_fast(static, margin):
    beyond = lidar_limits(np.zeros(3), obstacles([(0.9, 0.0)], static), NO_TARGETS, PARAMETERS)
    assert beyond.allowed[0] == pytest.approx(0.6 * (0.9 - margin - 0.25) / 0.35)
    at_d_i = lidar_limits(np.zeros(3), obstacles([(PARAMETERS.d_i, 0.0)], static), NO_TARGETS, PARAMETERS)
    assert at_d_i.allowed[0] == pytest.approx(PARAMETERS.xi * (1.0 - margin / 0.35))
    assert at_d_i.allowed[0] < beyond.allowed[0]


def test_avoidance_can_be_switched_off():
    near = obstacles([(0.1, 0.0)], False)
    assert len(lidar_limits(np.zeros(3), near, NO_TARGETS, AvoidanceParameters(enabled=False)).distance) == 0


@settings(max_examples=60, deadline=None)
@given(
    bearing=st.floats(-math.pi, math.pi), distance=st.floats(0.26, 0.55), radius=st.floats(0.15, 0.3),
    corner=st.tuples(st.floats(0.0, 0.05), st.floats(0.0, 0.05)),
)  # fmt: skip
def test_a_hand_that_passes_a_moving_disc_obeys_its_line_whichever_way_it_goes(bearing, distance, radius, corner):
    """The disc is seen as cells, and the nearest of a wide sector may lie to the side of the nearest point of it."""
    towards = np.array([math.cos(bearing), math.sin(bearing)])
    middle = (distance + radius) * towards
    grid = np.arange(-1.0, 1.0, 0.05)
    cells = np.stack(np.meshgrid(grid, grid), axis=-1).reshape(-1, 2) + corner
    seen = cells[np.abs(np.hypot(*(cells - middle).T) - radius) < 0.036]  # what the edge of the disc passes through
    limits = lidar_limits(np.zeros(3), obstacles(seen, False), NO_TARGETS, PARAMETERS)
    course = np.linspace(-math.pi, math.pi, 721)
    ways = np.column_stack((np.cos(course), np.sin(course)))
    approach = ways @ limits.normal.T  # of each course, towards each point
    speeds = np.where(approach > 0.0, limits.allowed / np.maximum(approach, 1e-9), math.inf).min(axis=1)
    fastest = np.minimum(np.maximum(speeds, 0.0), 0.5)
    assert np.all(
        fastest * (ways @ towards) <= damper_line(distance, PARAMETERS.d_s, PARAMETERS.d_i, PARAMETERS.xi) + 0.02
    )


def test_something_static_does_not_hide_what_moves_beside_it():
    points = np.array([[0.40, 0.0], [0.42, 0.0]])
    limits = lidar_limits(np.zeros(3), (points, np.array([True, False])), NO_TARGETS, PARAMETERS)
    assert sorted(limits.static.tolist()) == [False, True]


@pytest.mark.parametrize("side", [0.03, 0.06])
def test_the_balls_of_a_held_cube_cover_its_lower_half_to_the_corners(side):
    """A tilted cube of 6 cm met a chair with a lower corner, which stood out of its one ball by 9 mm."""
    balls = placed(arm_balls(), side, side)
    held = [k for k in range(len(balls.body)) if BODIES[balls.body[k]] == "held object"]
    half = 0.5 * side * np.linspace(-1.0, 1.0, 5)
    surface = [(x, y, z) for x in half for y in half for z in half[2:] if max(map(abs, (x, y, z))) > 0.49 * side]
    for point in surface:
        assert min(np.linalg.norm(balls.centre[k] - point) - balls.radius[k] for k in held) < 1e-6
