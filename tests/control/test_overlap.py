"""In something that stands where the arm is, base and arm only make the overlap smaller, or stand."""

import math

import numpy as np
import pytest

from motm_twin.control.arm.controller import Manipulator
from motm_twin.control.arm.geometry import planar_joints
from motm_twin.control.arm.monitor import NOWHERE
from motm_twin.control.arm.overlap import ArmOverlap
from motm_twin.control.arm.parameters import ArmParameters
from motm_twin.control.arm.types import ArmGoal, ArmInputs, ArmObstacles, ProgramStatus
from motm_twin.control.arm.view import look
from motm_twin.model.known import known_world
from motm_twin.model.plant import Observation, Scan
from motm_twin.model.reason import Kind
from motm_twin.model.scene_file import load_scene

KNOWN = known_world(load_scene("exp1", "trial1", 0))
ARM = KNOWN.robot.arm
MOUNT = np.array([ARM.mount_x, ARM.mount_y, ARM.mount_z])
OUT = planar_joints(0.6, 0.5, 0.0)  # the hand 0.6 m ahead of the mount
HAND = float(MOUNT[0] + 0.6)  # [m] ahead of the base
FRONT = 0.5 * KNOWN.robot.footprint.length + KNOWN.robot.footprint.offset_x  # [m] of the base
DT = 0.01  # [s]


def front(x, width=0.3):
    """Cells of the near side of a box, ahead of the base."""
    y = np.arange(-0.5 * width + 0.025, 0.5 * width, 0.05)
    return np.column_stack((np.full(len(y), x), y))


def inputs_of(points, *, q=OUT, dq=NOWHERE, time=0.0, twist=(0.0, 0.0), wanted=(0.0, 0.0), scan=None):
    observation = Observation(
        time=time, pose=np.zeros(3), odometry=np.zeros(3), twist=np.array(twist), q=q, dq=dq, gripper_width=0.08,
        gripper_moving=False, scan=scan, detections=(),
    )  # fmt: skip
    goal = ArmGoal(kind="none", name="", position=np.zeros(3), yaw=0.0, side=0.04, position_sd=0.0, last_seen=None)
    return ArmInputs(
        observation=observation, dt=DT, goal=goal, base_twist=np.array(wanted), time_to_range=math.inf,
        plan_times=np.zeros(0), plan_poses=np.zeros((0, 5)),
        obstacles=ArmObstacles(points=points, static=np.zeros(len(points), dtype=bool)), T_odom_world=np.zeros(3),
    )  # fmt: skip


def way_out(inputs, last=(0.0, 0.0), *, withdraws=False):
    """The way out of what is seen, after the base twist commanded last."""
    overlap = ArmOverlap(KNOWN.robot, planar_joints(0.3, 0.5, 0.0), ArmParameters())
    arm = look(inputs, MOUNT, 1.0, ArmParameters()).arm
    inside = overlap.met(arm, inputs, 0.0, None)
    return arm, overlap.way_out(arm, inputs, np.array(last), 0.0, inside, withdraws=withdraws)


def rolled_out(*, arm_moves):
    """Way [m] of the hand in the world while the base stops from 0.5 m/s with the hand in a box."""
    q, dq, v, way = OUT.copy(), np.zeros(7), 0.5, 0.0
    for _ in range(110):
        arm, out = way_out(inputs_of(front(HAND - 0.1), q=q, dq=dq, twist=(v, 0.0)), (v, 0.0))
        assert v == 0.0 or out.twist[0] < v
        dq = out.rates if arm_moves else NOWHERE
        way += DT * (v + (arm.J[:1, 2:] @ dq)[0])
        q, v = q + DT * dq, max(float(out.twist[0]), 0.0)
    return way


def test_the_hand_stays_where_it_is_while_the_base_rolls_out():
    """It was dragged 0.2 m through the box."""
    assert rolled_out(arm_moves=False) > 0.2
    assert abs(rolled_out(arm_moves=True)) < 0.1


@pytest.mark.parametrize("speed", [0.1, 0.004])
def test_the_base_does_not_drag_the_arm_deeper_in_when_it_leaves(speed):
    """A base that left a box took along the hand that was on its far side; and crept when that was forbidden."""
    points = front(FRONT - 0.05, 0.8)  # the middle is 0.4 m behind
    _, out = way_out(inputs_of(points, wanted=(-speed, 0.0)))
    assert out.stuck
    assert not out.twist.any() and not out.rates.any()


def test_the_base_leaves_what_it_takes_the_arm_out_of():
    points = front(FRONT - 0.05, 1.6)  # the middle is 0.8 m behind, beyond the hand
    _, out = way_out(inputs_of(points, wanted=(-0.1, 0.0)))
    assert out.twist[0] < 0.0 and not out.stuck


def test_an_arm_that_reaches_less_than_half_through_withdraws():
    points = front(HAND - 0.15, 0.6)  # the middle is 0.15 m beyond the hand
    arm, out = way_out(inputs_of(points), withdraws=True)
    assert out.withdraws
    assert (arm.J[:1, 2:] @ out.rates)[0] < 0.0
    assert not out.twist.any()


def test_an_arm_on_both_sides_of_the_middle_stands():
    points = front(HAND - 0.2, 0.3)  # the middle is 0.05 m before the hand: part of the arm is before it, part beyond
    _, out = way_out(inputs_of(points), withdraws=True)
    assert out.stuck
    assert not out.rates.any() and not out.twist.any()


def test_an_arm_stands_in_what_is_no_longer_seen():
    """The map forgot a box over a mapped bin after 1.2 s, and the hand went on into it."""
    manipulator = Manipulator(KNOWN)
    points = front(HAND - 0.1)
    assert manipulator.step(inputs_of(points)).program == ProgramStatus.STANDING
    for k in range(1, 400):
        step = manipulator.step(inputs_of(points[:0], time=k * DT))
        assert step.program == ProgramStatus.STANDING
        assert step.why is not None and step.why.kind == Kind.ARM_STANDS


def test_an_arm_goes_on_when_beams_pass_through_what_was_there():
    manipulator, points = Manipulator(KNOWN), front(HAND - 0.1)
    manipulator.step(inputs_of(points))
    lidar = KNOWN.robot.lidar
    for k in range(1, 4):
        scan = Scan(
            stamp=0.05 * k, ranges=np.full(lidar.beams, np.inf), angle_min=-0.5 * lidar.field_of_view,
            angle_step=lidar.field_of_view / (lidar.beams - 1), origin=np.array([lidar.x, lidar.y]),
            range_min=lidar.range_min, range_max=lidar.range_max, pose=np.zeros(3),
        )  # fmt: skip
        step = manipulator.step(inputs_of(points[:0], time=0.05 * k, scan=scan))
    assert step.program == ProgramStatus.SOLVED
