"""What is left out because a bound proves it: the answer is the same number as without."""

import math

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from motm_twin.model.motion import arc, drive, step
from motm_twin.model.profile import Footprint
from motm_twin.planning.bezier import bezier_curve, curve_time
from motm_twin.planning.collision import Field, body_of, clearance, distance_at

CELL = 0.05
ANGLE = st.floats(-math.pi, math.pi)


def field_with_points(seed: int) -> Field:
    """Distances to five points and to the border of a map of 6 x 5 m."""
    points = np.random.default_rng(seed).uniform((0.0, 0.0), (6.0, 5.0), (5, 2))
    x, y = np.meshgrid(CELL * (np.arange(120) + 0.5), CELL * (np.arange(100) + 0.5))
    away = np.hypot(x[..., None] - points[:, 0], y[..., None] - points[:, 1]).min(axis=-1)
    border = np.minimum(np.minimum(x, 6.0 - x), np.minimum(y, 5.0 - y))
    return Field(np.minimum(away, border).astype(np.float32), 0.0, 0.0, 1.0 / CELL)


@settings(max_examples=300, deadline=None)
@given(st.integers(0, 20), st.floats(-0.2, 6.2), st.floats(-0.2, 5.2), ANGLE, st.sampled_from((0.0, 0.1)))
def test_clearance_is_that_of_the_nearest_circle(seed, x, y, heading, offset_x):
    field, body = field_with_points(seed), body_of(Footprint(offset_x=offset_x))
    c, s = math.cos(heading), math.sin(heading)
    least = distance_at(x + c * body.centre_x, y + s * body.centre_x, field) - body.inner
    for cx, cy, r, _ in body.circle:
        least = min(least, distance_at(x + c * cx - s * cy, y + s * cx + c * cy, field) - r)
    found = clearance(x, y, heading, 10.0, field, body)
    assert found == least


@settings(max_examples=300, deadline=None)
@given(st.tuples(st.floats(-2, 2), st.floats(-2, 2), ANGLE), st.tuples(st.floats(-2, 2), st.floats(-2, 2), ANGLE))
def test_a_limit_changes_no_time_below_it(start, goal):
    curve = bezier_curve(np.array(start), np.array(goal), samples=8)
    time = curve_time(curve, start[2], goal[2], 0.5, 1.7)
    assert curve_time(curve, start[2], goal[2], 0.5, 1.7, time + 1e-6) == time
    assert curve_time(curve, start[2], goal[2], 0.5, 1.7, time - 1e-6) >= time - 1e-6


@settings(max_examples=300, deadline=None)
@given(st.floats(-20.0, 20.0), st.floats(-0.5, 0.5), st.floats(-1.8, 1.8))
def test_an_arc_is_where_many_short_steps_lead(heading, v, w):
    pose = (1.0, 2.0, heading)
    for _ in range(100):
        pose = step(*pose, v, w, v, w, 0.0015)
    x, y, turned = arc(1.0, 2.0, heading, v, w, 0.15)
    assert math.hypot(pose[0] - x, pose[1] - y) < 1e-7
    assert abs(math.remainder(pose[2] - turned, 2.0 * math.pi)) < 1e-9


@settings(max_examples=300, deadline=None)
@given(st.floats(-20.0, 20.0), st.floats(-0.5, 0.5), st.floats(-1.8, 1.8))
def test_an_arc_of_the_kernel_is_one_of_python_to_the_bit(heading, v, w):
    by_hand = arc.py_func(1.0, 2.0, heading, v, w, 0.15)
    assert arc(1.0, 2.0, heading, v, w, 0.15) == by_hand == tuple(drive(np.array([1.0, 2.0, heading]), v, w, 0.15))
