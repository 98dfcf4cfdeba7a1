"""The robot as the control loop sees it: a Plant with three verbs, its observations and commands, and the period.

`TwinPlant` is the robot of a twin, which in addition takes edits, if the robot supports them.
"""

import math
from collections.abc import Mapping, Sequence
from typing import ClassVar, Protocol

import msgspec
import numpy as np
from numpy.typing import NDArray

from motm_twin.model.edits import WorldEdit
from motm_twin.model.geometry import Array
from motm_twin.model.scene import PlanarPose, Scene, Task

PERIOD = 0.05  # [s] the paper's 20 Hz (Sec. IV)
LONGEST_PERIOD = 1.2 * PERIOD  # [s] longest time between two consecutive periods
PERIODS_PER_SECOND = round(1.0 / PERIOD)
ARM_STEPS = 5  # arm steps in a period: 100 Hz
ARM_STEP = PERIOD / ARM_STEPS  # [s]
SUBSTEP = 0.01  # [s] of the simulated plants
SLOW_AGE = 0.15  # [s] age of a scan or state from which robots slow down, by default


class Scan(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """One sweep of the lidar; beam i points at ``angle_min + i * angle_step`` in the base frame."""

    stamp: float  # [s]
    ranges: Array  # [m], shape (n,); inf = no return within range_max
    angle_min: float  # [rad]
    angle_step: float  # [rad]
    origin: Array  # sensor position in the base frame [m], shape (2,)
    range_min: float
    range_max: float
    pose: Array  # localised base pose at the stamp, world frame, shape (3,)
    blind: NDArray[np.bool_] | None = None  # beams known to be blind, shape (n,): nan, but no fault of the sweep


class Detection(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """An object seen by the gripper camera, at the stamp."""

    stamp: float  # [s]
    name: str  # "" when the camera does not know which object it is
    p_base: Array  # centre of the object in the base frame at the stamp [m], shape (3,)
    yaw_base: float  # [rad] in the base frame, modulo 90 deg for a cube
    position_sd: float  # [m] per axis, specified for the sensor at this distance
    odometry: Array  # odometry pose at the stamp, shape (3,)


class Observation(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """The robot's report at one instant. Scan and detections are the newest ones, each with its own stamp."""

    time: float  # [s]
    pose: Array  # localised base pose in the world [m, m, rad], shape (3,)
    odometry: Array  # dead-reckoned base pose: smooth, drifts, shape (3,)
    twist: Array  # measured base forward speed and yaw rate [m/s, rad/s], shape (2,)
    q: Array  # arm joints [rad], shape (7,)
    dq: Array  # arm joint rates [rad/s], shape (7,)
    gripper_width: float  # [m] between the finger pads
    gripper_moving: bool
    scan: Scan | None
    detections: tuple[Detection, ...]
    ahead: float = 0.0  # [s] ``time`` is this far in the future: it is when a command given now acts
    age: float = 0.0  # [s] present age of the robot's last report
    pose_sd: float = 0.0  # [m] per axis, sd of the pose on the map, from `perception/scan_match.py`; 0 in reports
    camera_stamp: float | None = None  # [s] stamp of the newest picture, even an empty one; None: not reported
    behind: float = 0.0  # [s] by which pose, odometry, twist and joints are older than ``time``


class Actuation(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """A command to the robot, held until the next one."""

    twist: Array  # base forward speed and yaw rate [m/s, rad/s], shape (2,)
    joint_velocity: Array  # arm joint rates [rad/s], shape (7,)
    gripper: str  # "open" | "close"
    opening: float | None = None  # [m] between the pads when open; None: all the way

    def __post_init__(self) -> None:
        if self.twist.shape != (2,) or self.joint_velocity.shape != (7,):
            raise ValueError(f"actuation shapes {self.twist.shape}, {self.joint_velocity.shape}: need (2,) and (7,)")
        if not math.isfinite(sum(self.twist.tolist()) + sum(self.joint_velocity.tolist())):
            raise ValueError("actuation is not finite: send a damped stop instead")
        if self.gripper not in ("open", "close"):
            raise ValueError(f"gripper command {self.gripper!r}: use 'open' or 'close'")


class Plant(Protocol):
    """A robot: simulated, external or recorded. Control cannot tell which."""

    def observe(self) -> Observation:
        """The newest observation."""
        ...

    def command(self, actuation: Actuation) -> None:
        """Set the command from now on."""
        ...

    def step(self, dt: float) -> None:
        """Let dt [s] pass."""
        ...


class BodyTruth(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """True pose of an object or agent."""

    name: str
    kind: str  # cube | temi | box | ...
    position: tuple[float, float, float]  # centre (objects) or floor point (agents) [m]
    yaw: float
    state: str = ""  # objects: resting | held | binned:<bin> | dropped; agents: driving | waiting | ...
    size: tuple[float, float, float] = (0.0, 0.0, 0.0)  # extents x, y, z [m]
    behaviour: str = ""  # of an agent: yield | blind | orca | social_force


class Contact(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """One contact episode with one thing, as judged by the referee."""

    later: ClassVar[tuple[str, ...]] = ("base_moved_towards",)
    time: float  # [s] when it began
    body: str  # that touched first: base, panda_link5, panda_hand, held:<cube>, ..., or a cube that the robot moved
    other: str  # an own link where the robot touched itself
    depth: float  # [m] largest
    closing_speed: float  # [m/s] of the contact point of the robot body towards the other, when it began
    other_speed: float  # [m/s] of the other towards the robot body
    caused_by_robot: bool
    duration: float  # [s]
    bodies: tuple[str, ...] = ()  # all that touched it in this episode, in order
    base_moved_towards: bool = False  # when it began, the motion of the base took the touching part towards the other


class CutIn(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """The robot moved into an agent's stopping area."""

    time: float  # [s]
    agent: str
    gap: float  # [m] between the two at that time
    stopping_way: float  # [m] of the agent: reaction and braking
    speed: float  # [m/s] of the agent


class ContactForce(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """One contact of the robot, or of a held object, under contact dynamics."""

    time: float  # [s] when it began
    body: str  # that touched first
    other: str
    force: float  # [N] largest
    impulse: float  # [Ns]
    duration: float  # [s]


class GraspTruth(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """One grasp under contact dynamics, from the command to close until the object is loose."""

    object: str
    time: float  # [s] of the command
    firm: float  # [s] from the command until both pads held the object firmly
    shift: float  # [m] that the fingers shifted the object by while they closed
    speed: float  # [m/s] largest of the tool centre point while they closed
    slip: float  # [m] largest in the hand since then
    turn: float  # [rad] largest in the hand since then
    lost: bool = False  # it slipped out of closed fingers


class PhysicsTruth(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Ground truth of a plant with contact dynamics."""

    forces: tuple[ContactForce, ...]  # so far, without those of the pads on the held object
    disagreements: tuple[str, ...]  # contacts found by the referee's geometry only, or by the forces only
    grasps: tuple[GraspTruth, ...]  # so far
    finger_forces: tuple[float, float]  # [N] now, of the pads on the object between them
    external_torque: tuple[float, ...]  # [Nm] of the joints now, estimated as if the base were at rest
    torque_peaks: tuple[float, ...]  # [Nm] largest magnitudes so far
    reflexes: tuple[str, ...]  # passed thresholds of the Panda's reflex, with the first time
    phantoms: tuple[int, int] = (0, 0)  # number of times that each was passed without a contact
    wrist: tuple[float, float] = (0.0, 0.0)  # [N], [Nm] at the hand's mount now, weight included
    wrist_peaks: tuple[float, float] = (0.0, 0.0)  # largest so far


class Truth(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Ground truth of a simulated plant, for readers of Ticks; the loop never sees it."""

    pose: Array  # true base pose, shape (3,)
    objects: tuple[BodyTruth, ...]
    agents: tuple[BodyTruth, ...]
    obstacles: tuple[BodyTruth, ...]  # added by a person during the run
    contacts: tuple[Contact, ...]  # so far
    picks: int
    places: int
    drops: int
    min_base_clearance: float  # [m] so far
    min_arm_clearance: float
    min_ee_obstacle: float  # gripper centre to anything that is not in the map, so far
    ee_obstacle: float  # [m] the same now
    plant_faults: tuple[str, ...]  # limits that the plant itself broke: must stay empty
    furniture: tuple[BodyTruth, ...] = ()  # pieces that were moved: reference point, yaw = turn from the scene's pose
    removed: tuple[str, ...] = ()  # pieces, loose solids and agents of the scene that a person took away
    faults: tuple[str, ...] = ()  # active injected faults, one phrase each: "lidar off for 0.6 s"
    path_length: float = 0.0  # [m] driven by the base so far (pushes by a person not counted)
    cut_ins: tuple[CutIn, ...] = ()  # so far
    dropped: tuple[str, ...] = ()  # objects that fell by the robot's doing and were not picked up and placed since
    physics: PhysicsTruth | None = None  # None without contact dynamics


class WorldRehearsal(Protocol):
    """Tries queued edits, one after another, before they are applied."""

    def accept(self, edit: WorldEdit) -> None:
        """Accept an edit after the earlier ones. Raises ValueError when the world refuses it."""
        ...


class TwinPlant(Plant, Protocol):
    """A twin's robot. Unsupported requests raise ValueError; truth is None where there is none."""

    def truth(self) -> Truth | None:
        """Ground truth, if the robot has one."""
        ...

    def rehearsal(self) -> WorldRehearsal:
        """A rehearsal of edits before they are applied."""
        ...

    def apply(self, edit: WorldEdit) -> None:
        """Change the world as a person does."""
        ...

    def expect_tasks(self, tasks: Sequence[Task]) -> None:
        """Give the referee, if there is one, the current task list."""
        ...

    def expect_map(self, announced: Mapping[str, PlanarPose]) -> None:
        """Give the referee, if there is one, the announced places of furniture."""
        ...


class ExternalPlant(TwinPlant, Protocol):
    """A robot in another program."""

    mirror: bool  # the robot is shown, but not commanded

    @property
    def shared(self) -> bool:
        """True when the robot's time passes only as far as the twin grants it."""
        ...

    def begin(self, scene: Scene) -> None:
        """Begin another run."""
        ...

    def ready(self) -> bool:
        """True when there is a robot to observe."""
        ...

    def text(self) -> str:
        """One sentence about the robot."""
        ...

    def interrupted(self) -> bool:
        """True when control was interrupted since the last call."""
        ...
