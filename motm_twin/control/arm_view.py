"""What one arm step looks at: the hand, the base and the goal in the odometry frame, computed once."""

from dataclasses import dataclass, field

import msgspec
import numpy as np
from numba import njit

from motm_twin.control.arm_reference import mount_point, polar, release_point
from motm_twin.control.parameters import ArmParameters
from motm_twin.control.qp_rows import hand_state
from motm_twin.control.types import ArmGoal, ArmInputs
from motm_twin.model.exact import hypot
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
    late: float = field(default=0.0, metadata=LATER)  # [s] by which the fingers took longer than they should, lately


class View(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """One instant, in the odometry frame."""

    time: float
    dt: float
    goal: ArmGoal
    pose: Array  # base, shape (3,)
    beta: float  # share of a commanded change of the base twist that is there when the arm's rates act
    measured: Array  # base twist now, shape (2,)
    twist: Array  # base rates expected while the commanded arm rates act, shape (2,)
    mount: Array  # position of the arm mount, shape (3,)
    q: Array
    dq: Array  # arm rates now, shape (7,)
    T: Array  # arm transforms relative to the mount, shape (11, 4, 4)
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

    @property
    def velocity(self) -> Array:
        """Of the tool centre point, measured, shape (3,)."""
        return self.J[:3, :2] @ self.measured + self.J[:3, 2:] @ self.dq

    def seen(self, parameters: ArmParameters) -> bool:
        """Has the object been seen recently?"""
        last = self.goal.last_seen
        return last is not None and self.time - last <= parameters.seen_within


def look(inputs: ArmInputs, mount: Array, beta: float, parameters: ArmParameters) -> View:
    """The view of one step; ``mount`` [m] in the base frame, beta from `lag_factor`."""
    observation, goal = inputs.observation, inputs.goal
    pose = np.asarray(observation.odometry, dtype=float)
    q = np.asarray(observation.q, dtype=float)
    measured = np.asarray(observation.twist, dtype=float)
    half = max(0.0, goal.release_half_width - 0.5 * goal.side - parameters.release_margin)
    T, R, J, points, twist = np.empty((11, 4, 4)), np.empty((3, 3)), np.empty((6, 9)), np.empty((3, 3)), np.empty(2)
    radius, azimuth, distance = _look(
        q, pose, measured, inputs.base_twist, mount, goal.position, _GOALS.get(goal.kind, _NOTHING), goal.yaw, half,
        parameters.release_height, beta, T, R, J, points, twist,
    )  # fmt: skip
    p, mount_now, target = points
    return View(
        time=observation.time,
        dt=inputs.dt,
        goal=goal,
        pose=pose,
        beta=beta,
        measured=measured,
        twist=twist,
        mount=mount_now,
        q=q,
        dq=observation.dq,
        T=T,
        p=p,
        R=R,
        J=J,
        target=target,
        radius=radius,
        azimuth=azimuth,
        distance=distance,
        time_to_range=inputs.time_to_range,
        width=observation.gripper_width,
        gripper_moving=observation.gripper_moving,
    )


@njit(cache=True)
def _look(
    q: Array, pose: Array, measured: Array, wanted: Array, mount: Array, position: Array, goal: int, yaw: float,
    half: float, rise: float, beta: float, T: Array, R: Array, J: Array, points: Array, twist: Array,
) -> tuple[float, float, float]:  # fmt: skip
    """Fill in T, R, J, the twist and three points: hand, mount, target. Returns what `View` says of the target.

    ``half`` and ``rise`` [m]: half the release square, and how far above the bin's rim the object is released.
    """
    T[:], p, R[:], J[:] = hand_state(q, pose, mount)
    m = mount_point(pose, mount)
    target = m + np.array([1.0, 0.0, 0.0])
    if goal == _PICK:
        target[:] = position
    elif goal == _PLACE:  # the point of the release square that is easiest to reach
        target[:2], target[2] = release_point(position, yaw, half, m, PREFERRED_RADIUS), position[2] + rise
    points[0], points[1], points[2] = p, m, target
    for k in range(2):
        twist[k] = measured[k] + beta * (wanted[k] - measured[k])
    radius, azimuth = polar(target, pose, mount)
    return radius, azimuth, hypot(p[0] - target[0], p[1] - target[1])
