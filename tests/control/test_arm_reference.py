"""Geometry of hover points, tilt and yaw."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from motm_twin.control.arm.geometry import (
    STRAIGHT,
    cube_yaw,
    from_polar,
    hand_yaw,
    planar_joints,
    polar,
    pose_at,
    reach_radius,
    release_point,
    room_at,
    rotation_error,
    stretch,
    tilt_for,
    tilt_of,
    tool_rotation,
)
from motm_twin.control.arm.types import TransitRule
from motm_twin.model.arm_kernels import fk_arm
from motm_twin.model.geometry import from_frame

ANGLE = st.floats(-3.1, 3.1)
MOUNT = np.array([0.15, 0.0, 0.38])
BIN = np.array([1.0, 0.0, 0.72])


@settings(deadline=None)
@given(ANGLE, st.floats(0.0, 0.6), ANGLE)
def test_a_tool_rotation_gives_back_its_tilt_and_yaw(yaw, tilt, outward):
    R = tool_rotation(yaw, tilt, outward)
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-12)
    assert tilt_of(R) == pytest.approx(tilt, abs=1e-6)
    assert math.remainder(hand_yaw(R) - yaw, 2.0 * math.pi) == pytest.approx(0.0, abs=1e-9)
    np.testing.assert_allclose(R[:2, 2], math.sin(tilt) * np.array([math.cos(outward), math.sin(outward)]), atol=1e-9)


@settings(deadline=None)
@given(ANGLE, ANGLE)
def test_the_rotation_error_turns_one_rotation_into_the_other(first, second):
    error = rotation_error(tool_rotation(first, 0.1, 0.4), tool_rotation(second, 0.1, 0.4))
    turn = abs(math.remainder(second - first, 2.0 * math.pi))
    assert np.linalg.norm(error) == pytest.approx(turn, abs=1e-6)


@settings(deadline=None)
@given(ANGLE, ANGLE)
def test_the_yaw_over_a_cube_is_one_of_its_faces_and_the_nearest(yaw, near):
    chosen = cube_yaw(yaw, near)
    assert math.remainder(chosen - yaw, math.pi / 2.0) == pytest.approx(0.0, abs=1e-9)
    assert abs(chosen - near) <= math.pi / 4.0 + 1e-9


@settings(deadline=None)
@given(st.floats(0.15, 0.8), ANGLE, ANGLE)
def test_polar_coordinates_about_the_mount_go_both_ways(radius, azimuth, heading):
    pose = np.array([1.0, -2.0, heading])
    point = from_polar(radius, azimuth, 0.8, pose, MOUNT)
    again = polar(point, pose, MOUNT)
    assert again[0] == pytest.approx(radius)
    assert math.remainder(again[1] - azimuth, 2.0 * math.pi) == pytest.approx(0.0, abs=1e-9)


@settings(deadline=None)
@given(st.floats(0.15, 0.65), st.floats(0.3, 0.5), st.floats(0.0, 0.3))
def test_planar_joints_put_the_hand_where_they_should(radius, height, tilt):
    if stretch(radius, height, tilt) > STRAIGHT - 1e-3:
        return
    T = fk_arm(planar_joints(radius, height, tilt))[10]
    np.testing.assert_allclose(T[:3, 3], [radius, 0.0, height], atol=1e-9)
    assert math.atan2(T[0, 2], -T[2, 2]) == pytest.approx(tilt, abs=1e-9)


def test_a_straight_elbow_reaches_as_far_as_computed_for_a_tool_that_points_down():
    assert reach_radius(0.42, 0.0, STRAIGHT) == pytest.approx(0.743, abs=1e-3)
    assert reach_radius(0.54, 0.0, STRAIGHT) == pytest.approx(0.674, abs=2e-3)


def test_the_tool_tilts_only_as_far_as_the_reach_needs():
    assert tilt_for(0.60, 0.42, 0.70, 0.3) == 0.0
    tilt = tilt_for(0.75, 0.42, 0.70, 0.3)
    assert stretch(0.75, 0.42, tilt) == pytest.approx(0.70, abs=1e-3)
    assert tilt_for(1.5, 0.42, 0.70, 0.3) == 0.3


def test_a_pose_of_the_plan_is_interpolated_and_held_at_its_end():
    times, poses = np.array([1.0, 2.0]), np.array([[0.5, 0, 0.2, 0.5, 0], [1.0, 0, 0.4, 0.5, 0]])
    now = np.zeros(3)
    np.testing.assert_allclose(pose_at(0.5, now, times, poses), [0.25, 0.0, 0.1])
    np.testing.assert_allclose(pose_at(1.5, now, times, poses), [0.75, 0.0, 0.3])
    np.testing.assert_allclose(pose_at(9.0, now, times, poses), [1.0, 0.0, 0.4])
    np.testing.assert_allclose(pose_at(0.0, now, times, poses), now)


def released(yaw, mount, *taken, reach=2.0):
    """The release point of a bin 1 m away."""
    return release_point(BIN, yaw, 0.13, np.array(mount), np.array([0.6, reach]), np.array(taken).reshape(-1, 3))


def test_the_release_point_is_in_the_square_and_towards_the_arm():
    np.testing.assert_allclose(released(0.0, [0.0, 0.0, 0.0]), [0.87, 0.0])
    np.testing.assert_allclose(released(0.3, [0.5, 0.0, 0.0]), [1.0, 0.0], atol=1e-9)


@pytest.mark.parametrize("yaw", [0.0, 0.7, -2.0])
@pytest.mark.parametrize("heading", np.linspace(-math.pi, math.pi, 7))
def test_the_release_point_is_beside_what_lies_in_the_bin_wherever_there_is_room(yaw, heading):
    rng = np.random.default_rng(7)
    mount = np.array([1.0 + 0.9 * math.cos(heading), 0.9 * math.sin(heading), 0.3])
    grid = np.stack(np.meshgrid(*[np.linspace(-0.13, 0.13, 27)] * 2), axis=-1).reshape(-1, 2)
    places = from_frame(np.array([*BIN[:2], yaw]), grid)
    for count in (1, 2, 3, 4):
        there = from_frame(np.array([*BIN[:2], yaw]), rng.uniform(-0.13, 0.13, (count, 2)))
        taken = np.column_stack([there, np.full(count, 0.057)])
        point = released(yaw, mount, *taken)
        most = max(room_at(place, BIN, yaw, taken) for place in places)
        assert room_at(point, BIN, yaw, taken) >= min(0.0, most) - 1e-6
        empty = released(yaw, mount)
        free = [math.dist(place, empty) for place in places if room_at(place, BIN, yaw, taken) >= 0.0]
        assert math.dist(point, empty) <= min(free, default=1.0) + 1e-6


def test_a_free_place_out_of_reach_is_not_aimed_at():
    near, behind = [0.87, 0.0, 0.14], 1.0
    assert released(0.0, [0.0, 0.0, 0.0], near)[0] > behind
    assert released(0.0, [0.0, 0.0, 0.0], near, reach=0.95)[0] < 0.95


def test_the_arm_leaves_when_its_transit_takes_as_long_as_the_base():
    rule = TransitRule(k_A=0.5, base_speed=0.3, hand_speed=0.9)
    assert rule.transit_duration(0.5, 0.5, 2.1) is None
    assert rule.transit_duration(0.5, 0.5, 2.0) == 2.0
    assert rule.transit_duration(0.5, 0.5, 0.0) == pytest.approx(0.5 / 0.9)
