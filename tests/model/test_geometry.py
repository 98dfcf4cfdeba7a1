"""Planar poses: property tests."""

import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from motm_twin.model.geometry import compose, from_frame, inverse, to_frame, wrap_angle
from motm_twin.model.motion import drive

metres = st.floats(-50.0, 50.0)
angles = st.floats(-20.0, 20.0)
poses = st.tuples(metres, metres, angles).map(np.array)


@given(angles)
def test_wrapped_angles_are_in_range_and_point_the_same_way(angle):
    wrapped = wrap_angle(angle)
    assert -math.pi < wrapped <= math.pi
    assert math.isclose(math.cos(wrapped), math.cos(angle), abs_tol=1e-9)
    assert math.isclose(math.sin(wrapped), math.sin(angle), abs_tol=1e-9)


@given(poses)
def test_a_pose_times_its_inverse_is_the_origin(pose):
    origin = compose(pose, inverse(pose))
    assert np.allclose(origin[:2], 0.0, atol=1e-9)
    assert abs(wrap_angle(origin[2])) < 1e-9


@given(poses, st.tuples(metres, metres).map(np.array))
def test_a_point_survives_a_change_of_frame_and_back(pose, point):
    assert np.allclose(from_frame(pose, to_frame(pose, point)), point, atol=1e-9)


@given(poses, st.tuples(metres, metres, metres).map(np.array))
def test_height_is_kept_by_a_change_of_frame(pose, point):
    assert to_frame(pose, point)[2] == point[2]


@given(poses, st.floats(-1.0, 1.0), st.floats(-2.0, 2.0), st.floats(0.01, 2.0))
def test_driving_an_arc_equals_many_small_steps(pose, v, w, dt):
    stepped = pose
    for _ in range(400):
        stepped = drive(stepped, v, w, dt / 400)
    arc = drive(pose, v, w, dt)
    assert np.allclose(arc[:2], stepped[:2], atol=1e-6)
    assert abs(wrap_angle(arc[2] - stepped[2])) < 1e-6
