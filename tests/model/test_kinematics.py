"""Kinematics against pinocchio, finite differences and published facts."""

import math

import numpy as np
import pinocchio as pin
import pytest

from motm_twin.model import profile
from motm_twin.model.arm_kernels import (
    ARM_FRAMES,
    TCP,
    arm_jacobian,
    fk_arm,
    manipulability,
    manipulability_gradient,
    point_jacobian,
)
from motm_twin.model.assets import LINKS, web_assets_dir
from motm_twin.model.kinematics import Frankie
from motm_twin.model.motion import drive
from motm_twin.model.profile import ArmSpec, RobotProfile

STEP = 1e-6
MOUNT = ArmSpec(mount_x=-0.07, mount_y=0.03, mount_z=0.51)


def draws(count: int = 25) -> list[tuple[np.ndarray, np.ndarray]]:
    rng = np.random.default_rng([7, 1])
    low, high = profile.Q_MIN, profile.Q_MAX
    return [(rng.uniform([-3, -3, -4], [3, 3, 4]), rng.uniform(low, high)) for _ in range(count)]


@pytest.fixture(params=[RobotProfile(), RobotProfile(arm=MOUNT)], ids=["frankie", "other mount"])
def robot(request: pytest.FixtureRequest) -> Frankie:
    return Frankie(request.param)


def rotation_vector(R: np.ndarray) -> np.ndarray:
    return pin.log3(R)


def test_every_frame_of_the_compiled_arm_equals_pinocchio(robot: Frankie) -> None:
    data = robot.model.createData()
    for pose, q in draws():
        configuration = np.concatenate([pose[:2], [math.cos(pose[2]), math.sin(pose[2])], q])
        pin.framesForwardKinematics(robot.model, data, configuration)
        arm = robot.mount_transform(pose) @ fk_arm(q)
        for name, T in zip(ARM_FRAMES, arm, strict=True):
            np.testing.assert_allclose(T, data.oMf[robot.model.getFrameId(name)].homogeneous, atol=1e-9)


def test_tcp_pose_and_the_pose_of_the_hand_equal_the_compiled_arm(robot: Frankie) -> None:
    for pose, q in draws():
        arm = robot.mount_transform(pose) @ fk_arm(q)
        p, R = robot.tcp_pose(pose, q)
        np.testing.assert_allclose(p, arm[TCP, :3, 3], atol=1e-12)
        np.testing.assert_allclose(R, arm[TCP, :3, :3], atol=1e-12)
        hand = robot.link_transforms(pose, q)[LINKS.index("panda_hand")]
        np.testing.assert_allclose(p - hand[:3, 3], 0.1034 * hand[:3, 2], atol=1e-12)


def test_fingers_of_the_drawn_robot_are_where_the_urdf_has_them() -> None:
    robot = Frankie(RobotProfile())
    urdf = pin.buildModelFromUrdf(str(web_assets_dir() / "frankie.urdf"), pin.JointModelPlanar())
    data = urdf.createData()
    for pose, q in draws(5):
        configuration = np.concatenate([pose[:2], [math.cos(pose[2]), math.sin(pose[2])], q, [0.015, 0.015]])
        pin.framesForwardKinematics(urdf, data, configuration)
        for name, T in zip(LINKS, robot.link_transforms(pose, q, width=0.03), strict=True):
            np.testing.assert_allclose(T, data.oMf[urdf.getFrameId(name)].homogeneous, atol=1e-12, err_msg=name)


def test_link_transforms_do_not_depend_on_earlier_calls(robot: Frankie) -> None:
    (pose, q), (other_pose, other_q) = draws(2)
    first = robot.tcp_jacobian(pose, q), robot.link_transforms(pose, q), robot.tcp_pose(pose, q)
    robot.tcp_jacobian(other_pose, other_q)
    robot.tcp_pose(other_pose, other_q)
    again = robot.tcp_jacobian(pose, q), robot.link_transforms(pose, q), robot.tcp_pose(pose, q)
    np.testing.assert_array_equal(first[0], again[0])
    np.testing.assert_array_equal(first[1], again[1])
    np.testing.assert_array_equal(first[2][0], again[2][0])
    assert first[1].shape == (len(LINKS), 4, 4)


def test_tcp_jacobian_equals_finite_differences_in_all_nine_columns(robot: Frankie) -> None:
    for pose, q in draws(10):
        J = robot.tcp_jacobian(pose, q)
        assert J.shape == (6, 9)
        for column in range(9):
            rates = np.zeros(9)
            rates[column] = 1.0
            p_plus, R_plus = robot.tcp_pose(drive(pose, rates[0], rates[1], STEP), q + rates[2:] * STEP)
            p_minus, R_minus = robot.tcp_pose(drive(pose, rates[0], rates[1], -STEP), q - rates[2:] * STEP)
            linear = (p_plus - p_minus) / (2 * STEP)
            angular = rotation_vector(R_plus @ R_minus.T) / (2 * STEP)
            np.testing.assert_allclose(J[:, column], np.concatenate([linear, angular]), atol=1e-7)


def test_arm_jacobian_is_the_arm_part_of_the_tcp_jacobian_seen_from_the_mount(robot: Frankie) -> None:
    for pose, q in draws():
        R = robot.mount_transform(pose)[:3, :3]
        turned = np.vstack([R @ arm_jacobian(q)[:3], R @ arm_jacobian(q)[3:]])
        np.testing.assert_allclose(robot.tcp_jacobian(pose, q)[:, 2:], turned, atol=1e-12)


def test_point_jacobian_of_the_elbow_equals_finite_differences() -> None:
    local = np.array([0.02, -0.1, 0.05, 1.0])
    for _, q in draws(10):
        T = fk_arm(q)
        J = point_jacobian(T, 4, (T[4] @ local)[:3])
        for i in range(7):
            dq = STEP * np.eye(7)[i]
            difference = ((fk_arm(q + dq)[4] - fk_arm(q - dq)[4]) @ local)[:3] / (2 * STEP)
            np.testing.assert_allclose(J[:3, i], difference, atol=1e-8)


def test_manipulability_equals_its_definition() -> None:
    for _, q in draws():
        J = arm_jacobian(q)
        assert manipulability(q) == pytest.approx(math.sqrt(np.linalg.det(J @ J.T)), abs=1e-10)


def test_manipulability_gradient_equals_central_differences() -> None:
    for _, q in draws():
        central = [(manipulability(q + d) - manipulability(q - d)) / (2 * STEP) for d in STEP * np.eye(7)]
        np.testing.assert_allclose(manipulability_gradient(q), central, atol=1e-8)


def test_a_stretched_arm_has_no_manipulability_and_a_zero_gradient() -> None:
    stretched = np.zeros(7)
    assert manipulability(stretched) == 0.0
    np.testing.assert_array_equal(manipulability_gradient(stretched), np.zeros(7))


def test_limits_of_the_urdf_are_the_published_panda_limits() -> None:
    model = Frankie(RobotProfile()).model
    np.testing.assert_array_equal(model.lowerPositionLimit[4:], profile.Q_MIN)
    np.testing.assert_array_equal(model.upperPositionLimit[4:], profile.Q_MAX)
    np.testing.assert_array_equal(model.velocityLimit[3:], profile.DQ_MAX)


def test_ready_pose_is_within_limits_and_points_the_hand_down() -> None:
    assert np.all((profile.READY > profile.Q_MIN) & (profile.READY < profile.Q_MAX))
    p, R = Frankie(RobotProfile()).tcp_pose(np.zeros(3), profile.READY)
    assert R[2, 2] < -0.99
    assert abs(p[1]) < 1e-9
    assert 0.4 < p[0] - 0.15 < 0.6
