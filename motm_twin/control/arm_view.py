"""What one arm step looks at: the hand, the base and the goal in the odometry frame, computed once."""

import math
from dataclasses import dataclass, field

import numpy as np

from motm_twin.control.arm_reference import mount_point, polar, release_point
from motm_twin.control.parameters import ArmParameters
from motm_twin.control.qp_rows import hand_state
from motm_twin.control.types import ArmGoal, ArmInputs
from motm_twin.model.geometry import Array
from motm_twin.model.state import LATER

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
    late: float = field(default=0.0, metadata=LATER)  # [s] by which the fingers took longer than they should, lately


@dataclass(frozen=True)
class View:
    """One instant, in the odometry frame."""

    time: float
    dt: float
    goal: ArmGoal
    pose: Array  # base, shape (3,)
    twist: Array  # base rates expected while the commanded arm rates act, shape (2,)
    mount: Array  # position of the arm mount, shape (3,)
    q: Array
    T: Array  # arm transforms relative to the mount, shape (11, 4, 4)
    p: Array  # tool centre point, shape (3,)
    R: Array  # rotation of the hand, shape (3, 3)
    J: Array  # Jacobian of the tool centre point, shape (6, 9)
    velocity: Array  # of the tool centre point, measured, shape (3,)
    target: Array  # point that the object's centre is to reach or is at, shape (3,)
    radius: float  # of the target about the mount [m]
    azimuth: float  # of the target about the mount, base frame [rad]
    time_to_range: float
    width: float
    gripper_moving: bool

    @property
    def distance(self) -> float:
        """Horizontal distance of the tool centre point from the target [m]."""
        return math.hypot(self.p[0] - self.target[0], self.p[1] - self.target[1])

    def seen(self, parameters: ArmParameters) -> bool:
        """Has the object been seen recently?"""
        last = self.goal.last_seen
        return last is not None and self.time - last <= parameters.seen_within


def look(inputs: ArmInputs, mount: Array, beta: float, parameters: ArmParameters) -> View:
    """The view of one step; ``mount`` [m] in the base frame, beta from `lag_factor`."""
    observation, goal = inputs.observation, inputs.goal
    pose = np.asarray(observation.odometry, dtype=float)
    q = np.asarray(observation.q, dtype=float)
    T, p, R, J = hand_state(q, pose, mount)
    m = mount_point(pose, mount)
    target = _target(goal, m, parameters)
    radius, azimuth = polar(target, pose, mount)
    measured = np.asarray(observation.twist, dtype=float)
    return View(
        time=observation.time,
        dt=inputs.dt,
        goal=goal,
        pose=pose,
        twist=measured + beta * (inputs.base_twist - measured),
        mount=m,
        q=q,
        T=T,
        p=p,
        R=R,
        J=J,
        velocity=J[:3, :2] @ measured + J[:3, 2:] @ observation.dq,
        target=target,
        radius=radius,
        azimuth=azimuth,
        time_to_range=inputs.time_to_range,
        width=observation.gripper_width,
        gripper_moving=observation.gripper_moving,
    )


def _target(goal: ArmGoal, mount: Array, parameters: ArmParameters) -> Array:
    """The object's centre, or the point of the release square that is easiest to reach, above the rim."""
    if goal.kind == "pick":
        return np.array(goal.position, dtype=float)
    if goal.kind == "place":
        half = max(0.0, goal.release_half_width - 0.5 * goal.side - parameters.release_margin)
        xy = release_point(goal.position, goal.yaw, half, mount, PREFERRED_RADIUS)
        return np.array([xy[0], xy[1], goal.position[2] + parameters.release_height])
    return mount + np.array([1.0, 0.0, 0.0])
