"""The view of one arm step: hand, base and goal in the odometry frame, computed once."""

import math
from dataclasses import dataclass, field
from typing import NamedTuple

import msgspec
import numpy as np

from motm_twin.control.arm.geometry import mount_point, nearest_distance, polar, release_point, tilt_of
from motm_twin.control.arm.parameters import ArmParameters
from motm_twin.control.arm.types import ArmGoal, ArmInputs, Overlap, Phase
from motm_twin.model.arm_kernels import TCP, factor, fk_arm, point_jacobian
from motm_twin.model.compiler import njit
from motm_twin.model.exact import hypot, times
from motm_twin.model.geometry import Array
from motm_twin.model.reason import Reason
from motm_twin.model.state import LATER

_NOTHING, _PICK, _PLACE = 0, 1, 2
_GOALS = {"pick": _PICK, "place": _PLACE}
_LANDING = 0.005  # [m] error of the seen place of one object plus that of the landing place of another


@dataclass
class ManipulatorState:
    """Everything the arm side remembers from step to step."""

    phase: Phase = Phase.STOW
    since: float = 0.0  # [s] when the phase began
    goal: str = ""  # kind and name of the goal of the last step
    leaves: bool = field(default=False, metadata=LATER)  # the hand rises from an object that is no longer the goal
    holding: bool = False
    side: float = 0.0  # [m] of the object in the gripper
    gripper: str = "open"
    opening: float | None = field(default=None, metadata=LATER)  # [m] between the pads when open; None: all the way
    narrowing_since: float | None = field(default=None, metadata=LATER)  # [s] since when the pads are wider than that
    opens_fully: bool = field(default=False, metadata=LATER)  # for this goal: the gripper cannot open partly
    yaw: float | None = None  # [rad] of the hand over the object, once chosen
    anchor: Array = field(default_factory=lambda: np.zeros(3))  # [m] point that closing, lift and release hold on to
    clear_z: float = 0.0  # [m] height of the hand that is clear of the surroundings of the last target
    top_between: float = field(default=-math.inf, metadata=LATER)  # [m] of furniture between hand and target
    in_range_since: float | None = None  # [s] since when a target has been in range without result
    start_over: bool = False  # go to the stow pose before another try
    reported: bool = False  # "picked" has been reported
    released: float | None = None  # [s] when the gripper was commanded to open over the bin
    relaxed: Array = field(default_factory=lambda: np.zeros((0, 2)))  # [m] past grasp for which static obstacles yield
    twist: Array = field(default_factory=lambda: np.zeros(2))  # the program's last answer, before the monitors
    rates: Array = field(default_factory=lambda: np.zeros(7))  # the same [rad/s]
    stop_rates: Array | None = None  # [rad/s] at the beginning of a damped stop
    tight: Reason | None = field(
        default=None, metadata=LATER
    )  # an obstacle nearer to the chosen faces than the distance to be kept
    tight_tries: int = field(default=0, metadata=LATER)  # failed tries with such faces
    no_room_since: float | None = field(default=None, metadata=LATER)  # [s] no faces can be taken; inf: not seen yet
    inside_since: float | None = field(default=None, metadata=LATER)  # [s] since when the arm overlaps an obstacle
    inside: Overlap | None = field(default=None, metadata=LATER)  # the newest overlap
    glimpsed: float | None = field(default=None, metadata=LATER)  # [s] since when only a single cell shows an overlap
    inside_at: float = field(default=-math.inf, metadata=LATER)  # [s] time of `inside`
    late: float = field(default=0.0, metadata=LATER)  # [s] by which recent closings took longer than they should


class Arm(NamedTuple):
    """Arm and base of one step as kernels read them, in the odometry frame unless stated otherwise."""

    q: Array  # [rad], shape (7,)
    dq: Array  # [rad/s], shape (7,)
    pose: Array  # of the base, shape (3,)
    measured: Array  # base twist now, shape (2,)
    desired: Array  # base twist that its planner wants, shape (2,)
    expected: Array  # base twist expected while the commanded arm rates act, shape (2,)
    T_odom_world: Array  # planar pose of the world frame, shape (3,)
    base_mount: Array  # [m] of the arm, base frame, shape (3,)
    mount: Array  # [m] of the arm, shape (3,)
    T: Array  # arm transforms relative to the mount, shape (11, 4, 4)
    jacobian: Array  # of the arm's tool centre point, axes of the mount, shape (6, 7)
    p: Array  # [m] tool centre point, shape (3,)
    R: Array  # rotation of the hand, shape (3, 3)
    J: Array  # Jacobian of the tool centre point over (v, w, arm), shape (6, 9)
    factor: Array  # lower factor of `jacobian` times its transpose, shape (6, 6)
    target: Array  # [m] point where the object's centre is or is to go, shape (3,)


class View(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """One instant, in the odometry frame."""

    time: float
    dt: float
    goal: ArmGoal
    finite: bool  # True if the sum of all numbers that the step reads is finite
    arm: Arm
    beta: float  # share of a commanded change of the base twist that is reached when the arm's rates act
    radius: float  # of the target about the mount [m]
    azimuth: float  # of the target about the mount, base frame [rad]
    distance: float  # horizontal, of the tool centre point from the target [m]
    time_to_range: float
    width: float
    gripper_moving: bool
    age: float  # [s] of the robot's last report
    slips_since: float  # [s] when the wheels were found to slip; -inf: they grip
    tilt: float  # of the tool axis from straight down [rad]
    manipulability: float
    nearest: float  # horizontal, of the tool centre point from the nearest seen obstacle [m], inf when there is none

    @property
    def pose(self) -> Array:
        """Pose of the base, shape (3,)."""
        return self.arm.pose

    @property
    def mount(self) -> Array:
        """Position of the arm mount [m], shape (3,)."""
        return self.arm.mount

    @property
    def q(self) -> Array:
        """Joints [rad], shape (7,)."""
        return self.arm.q

    @property
    def p(self) -> Array:
        """Tool centre point [m], shape (3,)."""
        return self.arm.p

    @property
    def R(self) -> Array:
        """Rotation of the hand, shape (3, 3)."""
        return self.arm.R

    @property
    def target(self) -> Array:
        """Point where the object's centre is or is to go [m], shape (3,)."""
        return self.arm.target

    @property
    def velocity(self) -> Array:
        """Measured velocity of the tool centre point, shape (3,)."""
        return times(self.arm.J[:3, :2], self.arm.measured) + times(self.arm.J[:3, 2:], self.arm.dq)

    def seen(self, parameters: ArmParameters) -> bool:
        """Test that the object has been seen recently."""
        last = self.goal.last_seen
        return last is not None and self.time - last <= parameters.seen_within

    def sure(self, parameters: ArmParameters) -> bool:
        """Test that the robot's last report is recent enough to grip or release; an old one may miss newer commands."""
        return self.age <= parameters.sure_age

    def slides(self, parameters: ArmParameters) -> bool:
        """Test that the base moves on slipping wheels: the hand follows a twist that is wrong by up to its speed."""
        return self.slips_since > -math.inf and math.hypot(*self.arm.measured) > parameters.close_speed


def look(inputs: ArmInputs, base_mount: Array, beta: float, parameters: ArmParameters) -> View:
    """The view of one step; ``base_mount`` (3,) [m] of the arm in the base frame, beta from `lag_factor`."""
    observation, goal = inputs.observation, inputs.goal
    half = max(0.0, goal.release_half_width - 0.5 * goal.side - parameters.release_margin)
    report = StepReport(
        observation.q, observation.dq, observation.odometry, observation.twist, inputs.base_twist, inputs.T_odom_world,
        base_mount, goal.position, goal.yaw, taken(goal, 1.0),
    )  # fmt: skip
    kind = _GOALS.get(goal.kind, _NOTHING)
    arm, radius, azimuth, distance, dexterity, nearest, total = _look(
        report, inputs.obstacles.points, inputs.plan_poses, kind, half, parameters.release_height,
        np.array([parameters.preferred_radius, parameters.place_reach]), beta,
    )  # fmt: skip
    return View(
        time=observation.time,
        dt=inputs.dt,
        goal=goal,
        finite=math.isfinite(total + observation.time + observation.gripper_width + inputs.dt),
        arm=arm,
        beta=beta,
        radius=radius,
        azimuth=azimuth,
        distance=distance,
        time_to_range=inputs.time_to_range,
        width=observation.gripper_width,
        gripper_moving=observation.gripper_moving,
        age=observation.age,
        slips_since=inputs.slips_since,
        tilt=tilt_of(arm.R),
        manipulability=dexterity,
        nearest=nearest,
    )


class StepReport(NamedTuple):
    """Report of the robot, and the goal."""

    q: Array
    dq: Array
    pose: Array
    measured: Array
    desired: Array
    T_odom_world: Array
    base_mount: Array
    position: Array  # [m] of the goal, shape (3,)
    yaw: float
    taken: Array  # of `release_point`


def taken(goal: ArmGoal, turned: float) -> Array:
    """Keep-out squares of the objects in the bin of a place, for `release_point`: x, y, half side [m], shape (n, 3).

    ``turned``: 0 takes all objects as parallel to the bin's axes, 1 as turned by 45 deg, the worst case.
    """
    if goal.kind != "place" or not len(goal.neighbours):
        return np.zeros((0, 3))
    apart = 0.5 * (goal.neighbours[:, 4] + goal.side) * (1.0 + turned * (math.sqrt(2.0) - 1.0))
    return np.column_stack([goal.neighbours[:, :2], apart + _LANDING])


@njit(cache=True)
def _look(
    report: StepReport,
    points: Array,
    plan_poses: Array,
    goal: int,
    half: float,
    rise: float,
    radii: Array,
    beta: float,
) -> tuple[Arm, float, float, float, float, float, float]:
    """The arm, the other computed fields of `View`, and a sum of all numbers, finite when each is.

    ``half`` and ``rise`` [m]: half the release square, and how far above the bin's rim the object is released;
    ``radii`` as in `release_point`.
    """
    t = report
    q, pose, measured, desired = t.q.copy(), t.pose.copy(), t.measured.copy(), t.desired.copy()
    T = fk_arm(q)
    jacobian, p, R, J = point_jacobian(T, 7, T[TCP, :3, 3]), np.empty(3), np.empty((3, 3)), np.empty((6, 9))
    hand_of(T, jacobian, pose, t.base_mount, p, R, J)
    mount, target = mount_point(pose, t.base_mount), np.empty(3)
    if goal == _PICK:
        target[0], target[1], target[2] = t.position[0], t.position[1], t.position[2]
    elif goal == _PLACE:  # the point of the release square that is easiest to reach
        released = release_point(t.position, t.yaw, half, mount, radii, t.taken)
        target[0], target[1], target[2] = released[0], released[1], t.position[2] + rise
    else:
        target[0], target[1], target[2] = mount[0] + 1.0, mount[1], mount[2]
    expected, root = np.empty(2), np.empty((6, 6))
    for k in range(2):
        expected[k] = measured[k] + beta * (desired[k] - measured[k])
    radius, azimuth = polar(target, pose, t.base_mount)
    distance = hypot(p[0] - target[0], p[1] - target[1])
    dexterity = factor(jacobian, root)
    arm = Arm(
        q=q, dq=t.dq.copy(), pose=pose, measured=measured, desired=desired, expected=expected,
        T_odom_world=t.T_odom_world.copy(), base_mount=t.base_mount.copy(), mount=mount, T=T, jacobian=jacobian, p=p,
        R=R, J=J, factor=root, target=target,
    )  # fmt: skip
    total = q.sum() + t.dq.sum() + pose.sum() + measured.sum() + desired.sum() + t.T_odom_world.sum()
    total += t.position.sum() + t.yaw + _sum_of_rows(points) + _sum_of_rows(plan_poses)
    return arm, radius, azimuth, distance, dexterity, nearest_distance(p, points), total


@njit(cache=True)
def hand_state(q: Array, pose: Array, mount: Array) -> tuple[Array, Array, Array, Array]:
    """Arm transforms (11, 4, 4), position (3,) and rotation (3, 3) of the tool centre point, its Jacobian (6, 9)."""
    T, p, R, J = fk_arm(q), np.empty(3), np.empty((3, 3)), np.empty((6, 9))
    hand_of(T, point_jacobian(T, 7, T[TCP, :3, 3]), pose, mount, p, R, J)
    return T, p, R, J


@njit(cache=True)
def hand_of(T: Array, arm: Array, pose: Array, mount: Array, p: Array, R: Array, J: Array) -> None:
    """Fill in p, R, J of `hand_state`; T from `fk_arm`, ``arm``: Jacobian in the axes of the mount, shape (6, 7).

    Columns of J: v, w, arm; axes of the planar frame of ``pose``.
    """
    c, s = math.cos(pose[2]), math.sin(pose[2])
    x, y = mount[0] + T[TCP, 0, 3], mount[1] + T[TCP, 1, 3]
    p[0], p[1], p[2] = pose[0] + c * x - s * y, pose[1] + s * x + c * y, mount[2] + T[TCP, 2, 3]
    for k in range(3):
        R[0, k] = c * T[TCP, 0, k] - s * T[TCP, 1, k]
        R[1, k] = s * T[TCP, 0, k] + c * T[TCP, 1, k]
        R[2, k] = T[TCP, 2, k]
    J[:, :2] = 0.0
    J[0, 0], J[1, 0] = c, s
    J[0, 1], J[1, 1] = -(s * x + c * y), c * x - s * y
    J[5, 1] = 1.0
    for k in range(7):
        for r in (0, 3):
            J[r, 2 + k] = c * arm[r, k] - s * arm[r + 1, k]
            J[r + 1, 2 + k] = s * arm[r, k] + c * arm[r + 1, k]
            J[r + 2, 2 + k] = arm[r + 2, k]


@njit(cache=True)
def _sum_of_rows(matrix: Array) -> float:
    total = 0.0
    for row in range(matrix.shape[0]):
        for column in range(matrix.shape[1]):
            total += matrix[row, column]
    return total
