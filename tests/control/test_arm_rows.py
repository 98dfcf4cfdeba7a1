"""Rows and bounds of the QP against independent computations."""

import math

import coal
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from motm_twin.control.arm.bodies import FINGERS, HELD, arm_balls, mapped_solids, placed, solid_distance
from motm_twin.control.arm.limits import Rows, damper_line
from motm_twin.control.arm.parameters import QpParameters
from motm_twin.control.arm.program import base_bounds, brakable_share, joint_bounds, lag_factor
from motm_twin.control.arm.view import hand_state
from motm_twin.model.arm_kernels import CAPSULE_LINKS, CAPSULE_RADII, HAND, capsule_segments, fk_arm
from motm_twin.model.assets import finger_boxes
from motm_twin.model.kinematics import Frankie
from motm_twin.model.known import known_world
from motm_twin.model.motion import drive
from motm_twin.model.profile import DDQ_MAX, DQ_MAX, Q_MAX, Q_MIN, READY, RobotProfile
from motm_twin.model.scene import Box, Cylinder, Prism
from motm_twin.model.scene_file import load_scene

PROFILE = RobotProfile()
MOUNT = np.array([0.15, 0.0, 0.38])
POSE = np.array([0.4, -1.2, 0.7])


def random_joints(seed):
    rng = np.random.default_rng(seed)
    return Q_MIN + (Q_MAX - Q_MIN) * rng.uniform(0.1, 0.9, 7)


@pytest.mark.parametrize("seed", range(5))
def test_the_hands_pose_and_jacobian_equal_pinocchio(seed):
    q, frankie = random_joints(seed), Frankie(PROFILE)
    _, p, R, J = hand_state(q, POSE, MOUNT)
    expected_p, expected_R = frankie.tcp_pose(POSE, q)
    np.testing.assert_allclose(p, expected_p, atol=1e-9)
    np.testing.assert_allclose(R, expected_R, atol=1e-9)
    np.testing.assert_allclose(J, frankie.tcp_jacobian(POSE, q), atol=1e-9)


def test_the_jacobian_equals_finite_differences():
    q, h = random_joints(7), 1e-6
    _, p, _, J = hand_state(q, POSE, MOUNT)
    for column in range(9):
        pose, joints = POSE, q.copy()
        if column < 2:
            pose = drive(POSE, h if column == 0 else 0.0, h if column == 1 else 0.0, 1.0)
        else:
            joints[column - 2] += h
        np.testing.assert_allclose((hand_state(joints, pose, MOUNT)[1] - p) / h, J[:3, column], atol=1e-5)


def test_beta_is_the_part_of_a_command_that_the_lagging_base_follows():
    beta = lag_factor(0.01, PROFILE)
    v, dt = 0.0, 1e-5
    for _ in range(round(0.015 / dt)):
        v += dt / PROFILE.base.velocity_lag * (1.0 - v)
    assert beta == pytest.approx(v, abs=1e-3)


def test_joint_bounds_keep_speed_acceleration_and_brake_before_limits():
    p = QpParameters()
    _, upper = joint_bounds(READY, np.zeros(7), 0.01, p)
    np.testing.assert_allclose(upper, np.minimum(DQ_MAX, DDQ_MAX * 0.01))
    q = READY.copy()
    q[0] = Q_MAX[0] - 0.05
    _, upper = joint_bounds(q, np.full(7, 0.3), 0.01, p)
    assert upper[0] == pytest.approx(damper_line(0.05, p.damper_stop, p.damper_start, p.damper_gain))


def test_a_joint_beyond_its_limit_is_driven_back_as_fast_as_its_acceleration_allows():
    q = READY.copy()
    q[0] = Q_MAX[0] + 0.02
    lower, upper = joint_bounds(q, np.zeros(7), 0.01, QpParameters())
    assert lower[0] <= upper[0] < 0.0
    assert upper[0] >= -DDQ_MAX[0] * 0.01 - 1e-12


def test_base_bounds_are_one_step_of_acceleration_inside_the_speed_limits():
    lower, upper = base_bounds(np.array([0.498, 0.0]), 0.01, PROFILE)
    np.testing.assert_allclose(upper, [0.5, 0.0175])
    np.testing.assert_allclose(lower, [0.493, -0.0175])


def test_distances_to_mapped_furniture_equal_coal():
    known = known_world(load_scene("exp1", "trial1", 0))
    solids = mapped_solids(known).solids
    rng = np.random.default_rng(0)
    for k, solid in enumerate(known.solids):
        if isinstance(solid.shape, Prism):
            continue
        height = solid.z_max - solid.z_min
        centre = np.array([*solid.shape.centre, 0.5 * (solid.z_min + solid.z_max)])
        if isinstance(solid.shape, Box):
            geometry, yaw = coal.Box(*solid.shape.size, height), solid.shape.yaw
        else:
            assert isinstance(solid.shape, Cylinder)
            geometry, yaw = coal.Cylinder(solid.shape.radius, height), 0.0
        c, s = math.cos(yaw), math.sin(yaw)
        place = coal.Transform3s(np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]]), centre)
        for point in centre + rng.uniform(-1.0, 1.0, (20, 3)):
            result = coal.DistanceResult()
            expected = coal.distance(
                coal.Sphere(1e-6), coal.Transform3s(np.eye(3), point), geometry, place, coal.DistanceRequest(), result
            )
            d, *normal = solid_distance(*point, k, solids)
            if d > 0.0:
                assert d == pytest.approx(expected, abs=2e-5)
                assert np.linalg.norm(normal) == pytest.approx(1.0)


def test_bounds_of_solids_contain_them():
    named = mapped_solids(known_world(load_scene("exp1", "trial1", 0)))
    solids, bounds = named.solids, named.solids.bounds
    for k in range(len(named.names)):
        inside = solids.vertices[solids.first[k] : solids.first[k + 1]]
        assert (inside[:, 0] >= bounds[k, 0] - 1e-9).all() and (inside[:, 1] <= bounds[k, 3] + 1e-9).all()


def test_balls_cover_the_axis_of_every_capsule_from_the_elbow_to_the_hand():
    balls = arm_balls()
    _, centre, radius, _ = placed(balls, 0.08, 0.04)
    T = fk_arm(READY)
    points = np.array([T[f, :3, :3] @ c + T[f, :3, 3] for f, c in zip(balls.frame, centre, strict=True)])
    for i, segment in enumerate(capsule_segments(T)):
        if CAPSULE_LINKS[i] in ("panda_link1", "panda_link2") or "finger" in CAPSULE_LINKS[i]:
            continue
        for part in np.linspace(0.0, 1.0, 11):
            point = segment[0] + part * (segment[1] - segment[0])
            inside = np.linalg.norm(points - point, axis=1) <= radius + 1e-9
            assert inside.any(), f"{CAPSULE_LINKS[i]} of radius {CAPSULE_RADII[i]} is not covered"


@given(tilt=st.floats(0.0, 0.7), about=st.floats(-math.pi, math.pi), width=st.floats(0.0, 0.08))
def test_no_corner_of_a_tilted_finger_is_lower_than_its_balls_by_more_than_2_millimetres(tilt, about, width):
    """A finger whose tip was one ball touched the table with a corner when the hand was tilted by 25 degrees."""
    down = np.array([math.sin(tilt) * math.cos(about), math.sin(tilt) * math.sin(about), math.cos(tilt)])  # hand frame
    frame, centre, radius, body = placed(arm_balls(), width, 0.0)
    fingers = (body >= FINGERS) & (body < HELD) & (radius > 0.0)
    assert (frame[fingers] == HAND).all()
    balls = (centre[fingers] @ down + radius[fingers]).max()
    lowest = -math.inf
    for link, side in (("panda_leftfinger", 1.0), ("panda_rightfinger", -1.0)):
        for middle, size in finger_boxes(link):
            at = middle + np.array([0.0, side * 0.5 * width, 0.0584])
            lowest = max(lowest, float(at @ down + np.abs(down) @ (0.5 * size)))
    assert balls > lowest - 0.002


@pytest.mark.parametrize("width", [0.0, 0.05, 0.08])
def test_the_balls_of_a_finger_are_as_wide_as_it_is_whatever_the_gripper_opens(width):
    """Fingers 8 cm wide at every width left no room beside a butter dish that they would have passed by 17 mm."""
    _, centre, radius, body = placed(arm_balls(), width, 0.0)
    left = body == FINGERS
    middles, sizes = zip(*finger_boxes("panda_leftfinger"), strict=True)
    outer = 0.5 * width + max(float(m[1] + 0.5 * s[1]) for m, s in zip(middles, sizes, strict=True))
    assert (centre[left, 1] + radius[left]).max() == pytest.approx(outer, abs=0.001)


@pytest.mark.parametrize(("room", "speed", "share"), [
    (0.09, 0.5, 0.6), (0.09, -0.5, 1.0), (0.0, 0.5, 0.06), (-0.01, 0.5, 0.06), (0.0, 0.03, 1.0), (0.3, 0.5, 1.0),
])  # fmt: skip
def test_a_base_carries_its_arm_at_furniture_no_faster_than_it_can_brake(room, speed, share):
    """It drove on at 0.4 m/s beside a pillar; the forearm gave way until the hand lay level, 8 cm in the table."""
    slope, braking = 0.112 / 0.6, 0.5
    rows = Rows(np.array([[1.0] + 8 * [0.0]]), np.array([room / slope]), np.zeros(1, np.int64))
    found = brakable_share(rows, np.array([True]), np.array([speed, 0.0]), braking, slope)
    assert found == pytest.approx(share)
    assert brakable_share(rows, np.array([False]), np.array([speed, 0.0]), braking, slope) == 1.0
