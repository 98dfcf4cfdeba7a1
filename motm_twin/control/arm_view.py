"""What one arm step looks at: the hand, the base and the goal in the odometry frame, computed once."""

import math
from dataclasses import dataclass, field

import msgspec
import numpy as np
from numba import njit

from motm_twin.control.arm_avoidance import nearest_distance
from motm_twin.control.arm_reference import mount_point, polar, release_point, tilt_of
from motm_twin.control.parameters import ArmParameters
from motm_twin.control.qp_rows import hand_of
from motm_twin.control.slate import Record, Slate
from motm_twin.control.types import ArmGoal, ArmInputs
from motm_twin.model.arm_kernels import TCP, factor, fk_arm, point_jacobian
from motm_twin.model.exact import hypot, times
from motm_twin.model.geometry import Array
from motm_twin.model.state import LATER

_NOTHING, _PICK, _PLACE = 0, 1, 2
_GOALS = {"pick": _PICK, "place": _PLACE}
PREFERRED_RADIUS = 0.60  # [m] from the mount at which the arm is most at ease


@dataclass
class ManipulatorState:
    """Everything the arm side remembers from step to step."""

    phase: str = "stow"
    since: float = 0.0  # [s] when the phase began
    goal: str = ""  # kind and name of the goal of the last step
    holding: bool = False
    side: float = 0.0  # [m] of the object in the gripper
    gripper: str = "open"
    yaw: float | None = None  # [rad] of the hand over the object, once chosen
    anchor: Array = field(default_factory=lambda: np.zeros(3))  # [m] point that closing, lift and release hold on to
    clear_z: float = 0.0  # [m] height that cleared what the last target stood on
    in_range_since: float | None = None  # [s] since when a target in range has not been dealt with
    start_over: bool = False  # go to the stow pose before another try
    reported: bool = False  # "picked" has been said
    released: float | None = None  # [s] when the gripper was told to open over the bin
    relaxed: Array = field(default_factory=lambda: np.zeros((0, 2)))  # [m] past grasp for which static obstacles yield
    twist: Array = field(default_factory=lambda: np.zeros(2))  # commanded last
    rates: Array = field(default_factory=lambda: np.zeros(7))  # commanded last [rad/s]
    stop_rates: Array | None = None  # [rad/s] at the beginning of a damped stop
    tight: str = field(default="", metadata=LATER)  # what is nearer to the chosen faces than the arm keeps from it
    tight_tries: int = field(default=0, metadata=LATER)  # times that came to nothing with such faces
    no_room_since: float | None = field(default=None, metadata=LATER)  # [s] no faces can be taken; inf: not seen yet
    inside_since: float | None = field(default=None, metadata=LATER)  # [s] since when something stands where the arm is
    late: float = field(default=0.0, metadata=LATER)  # [s] by which the fingers took longer than they should, lately


class View(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """One instant, in the odometry frame. Its arrays are those of the slate: they change with the next step."""

    time: float
    dt: float
    goal: ArmGoal
    finite: bool  # a sum of all numbers that the step reads is
    pose: Array  # base, shape (3,)
    beta: float  # share of a commanded change of the base twist that is there when the arm's rates act
    measured: Array  # base twist now, shape (2,)
    mount: Array  # position of the arm mount, shape (3,)
    q: Array
    dq: Array  # arm rates now, shape (7,)
    p: Array  # tool centre point, shape (3,)
    R: Array  # rotation of the hand, shape (3, 3)
    J: Array  # Jacobian of the tool centre point, shape (6, 9)
    target: Array  # point that the object's centre is to reach or is at, shape (3,)
    radius: float  # of the target about the mount [m]
    azimuth: float  # of the target about the mount, base frame [rad]
    distance: float  # horizontal, of the tool centre point from the target [m]
    time_to_range: float
    width: float
    gripper_moving: bool
    age: float  # [s] of what the robot said last
    tilt: float  # of the tool axis from straight down [rad]
    manipulability: float
    nearest: float  # horizontal, of the tool centre point from the nearest seen obstacle [m], inf when there is none

    @property
    def velocity(self) -> Array:
        """Of the tool centre point, measured, shape (3,)."""
        return times(self.J[:3, :2], self.measured) + times(self.J[:3, 2:], self.dq)

    def seen(self, parameters: ArmParameters) -> bool:
        """Has the object been seen recently?"""
        last = self.goal.last_seen
        return last is not None and self.time - last <= parameters.seen_within

    def sure(self, parameters: ArmParameters) -> bool:
        """Has the robot said lately where the hand is? What was told it since then it may not have heard."""
        return self.age <= parameters.sure_age


def look(inputs: ArmInputs, slate: Slate, beta: float, parameters: ArmParameters) -> View:
    """The view of one step, written down on the slate, which it is gone from with the next; beta from `lag_factor`."""
    observation, goal = inputs.observation, inputs.goal
    half = max(0.0, goal.release_half_width - 0.5 * goal.side - parameters.release_margin)
    total, radius, azimuth, distance, tilt, dexterity, nearest = _look(
        slate.record, observation.q, observation.dq, observation.odometry, observation.twist, inputs.base_twist,
        inputs.T_odom_world, goal.position, inputs.obstacles.points, inputs.plan_poses,
        _GOALS.get(goal.kind, _NOTHING), goal.yaw, half, parameters.release_height, beta,
    )  # fmt: skip
    return View(
        time=observation.time,
        dt=inputs.dt,
        goal=goal,
        finite=math.isfinite(total + observation.time + observation.gripper_width + inputs.dt),
        pose=slate.pose,
        beta=beta,
        measured=slate.measured,
        mount=slate.mount,
        q=slate.q,
        dq=slate.dq,
        p=slate.p,
        R=slate.R,
        J=slate.J,
        target=slate.target,
        radius=radius,
        azimuth=azimuth,
        distance=distance,
        time_to_range=inputs.time_to_range,
        width=observation.gripper_width,
        gripper_moving=observation.gripper_moving,
        age=observation.age,
        tilt=tilt,
        manipulability=dexterity,
        nearest=nearest,
    )


@njit(cache=True)
def _look(
    slate: Record, q: Array, dq: Array, pose: Array, measured: Array, wanted: Array, T_odom_world: Array,
    position: Array, points: Array, plan_poses: Array, goal: int, yaw: float, half: float, rise: float, beta: float,
) -> tuple[float, float, float, float, float, float, float]:  # fmt: skip
    """Write down what is seen; returns a sum of all numbers, finite when each is, and what `View` has beside arrays.

    ``half`` and ``rise`` [m]: half the release square, and how far above the bin's rim the object is released.
    """
    s = slate[0]
    s.q[:], s.dq[:], s.pose[:], s.measured[:], s.wanted[:] = q, dq, pose, measured, wanted
    s.T_odom_world[:] = T_odom_world
    s.T[:] = fk_arm(s.q)
    s.arm[:] = point_jacobian(s.T, 7, s.T[TCP, :3, 3])
    hand_of(s.T, s.arm, s.pose, s.base_mount, s.p, s.R, s.J)
    s.mount[:] = mount_point(s.pose, s.base_mount)
    if goal == _PICK:
        s.target[:] = position
    elif goal == _PLACE:  # the point of the release square that is easiest to reach
        s.target[:2] = release_point(position, yaw, half, s.mount, PREFERRED_RADIUS)
        s.target[2] = position[2] + rise
    else:
        s.target[:] = s.mount + np.array([1.0, 0.0, 0.0])
    for k in range(2):
        s.twist[k] = s.measured[k] + beta * (s.wanted[k] - s.measured[k])
    radius, azimuth = polar(s.target, s.pose, s.base_mount)
    distance = hypot(s.p[0] - s.target[0], s.p[1] - s.target[1])
    total = _sum(slate) + position.sum() + yaw + _sum_of_rows(points) + _sum_of_rows(plan_poses)
    return total, radius, azimuth, distance, tilt_of(s.R), factor(s.arm, s.factor), nearest_distance(s.p, points)


@njit(cache=True)
def _sum(slate: Record) -> float:
    """Of what was told by the robot, and what the base wants."""
    s = slate[0]
    return s.q.sum() + s.dq.sum() + s.pose.sum() + s.measured.sum() + s.wanted.sum() + s.T_odom_world.sum()


@njit(cache=True)
def _sum_of_rows(matrix: Array) -> float:
    total = 0.0
    for row in range(matrix.shape[0]):
        for column in range(matrix.shape[1]):
            total += matrix[row, column]
    return total
