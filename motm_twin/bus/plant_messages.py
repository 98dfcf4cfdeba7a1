"""Messages between twin and external robot, version 1: JSON (UTF-8; lengths [m], angles [rad], times [s]).

Times are on the robot's clock, which may begin anywhere; ``life`` names one start of the robot: stamps and numbers of
two lives have nothing to do with each other. Infinite numbers are ``null``. Fields may be added within a version.
"""

from typing import Any

import msgspec
import numpy as np

from motm_twin.model.edits import WorldEdit
from motm_twin.model.plant import BodyTruth, Contact, CutIn
from motm_twin.model.scene import PlanarPose, Scene, Task

VERSION = "motm.plant/1"
LIFETIME = 0.30  # [s] that a command may act at most
HOLD = 0.03  # [s] that a command of this twin acts without a newer one: near a table a hand must not go on blindly

Vector = list[float]


class Info(msgspec.Struct, frozen=True, kw_only=True):
    """The robot: answer to a question on ``info``."""

    version: str
    life: str
    name: str
    clock: str = "real"  # real: time passes by itself | shared: it passes when the twin grants it
    step: float = 0.01  # [s] between two states
    scheduled: bool = True  # commands act at their ``act_at``; else when they arrive
    can: list[str] = []  # of: edit, truth, reset, opening


class RobotState(msgspec.Struct, frozen=True, kw_only=True):
    """The robot at one instant."""

    version: str
    life: str
    seq: int
    stamp: float
    pose: Vector  # localised base pose x, y, heading, world
    odometry: Vector  # dead-reckoned base pose x, y, heading: smooth, drifts
    twist: Vector  # forward speed [m/s], yaw rate [rad/s]
    q: Vector  # arm joints, 7
    dq: Vector  # arm joint rates [rad/s], 7
    gripper_width: float  # [m] between the finger pads
    gripper_moving: bool
    heard: list[tuple[int, float]] = []  # number and time of arrival of the commands that came since the last state
    commander: str = ""  # who is obeyed now
    refused: int = 0  # commands refused so far
    refusal: str = ""  # why the last one was


class ScanData(msgspec.Struct, frozen=True, kw_only=True):
    """One sweep of the lidar; beam i points at ``angle_min + i * angle_step`` in the base frame."""

    version: str
    life: str
    stamp: float
    pose: Vector  # localised base pose at the stamp, world
    origin: Vector  # sensor position in the base frame, shape (2,)
    angle_min: float
    angle_step: float
    range_min: float
    range_max: float
    ranges: list[float | None]  # null: no return within range_max


class DetectionData(msgspec.Struct, frozen=True, kw_only=True):
    """An object that the gripper camera sees."""

    stamp: float  # [s] when the picture was taken
    name: str  # of the object, as in the scene; "" when the camera does not know which one it is
    p_base: Vector  # [m] its centre in the base frame at the stamp: forward, left, up from the floor
    yaw_base: float  # [rad] of its faces about the vertical, in the base frame
    position_sd: float  # [m] standard deviation, of each axis
    odometry: Vector  # pose of the base in its odometry at the stamp, x, y, heading


class DetectionList(msgspec.Struct, frozen=True, kw_only=True):
    """One frame of the gripper camera; empty when it shows nothing."""

    version: str
    life: str
    stamp: float
    detections: list[DetectionData]


class RobotCommand(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, omit_defaults=True):
    """The order for the robot from ``act_at`` on, until a later command acts, or for ``lifetime``."""

    version: str
    life: str  # of the robot that is meant
    sender: str
    seq: int  # rises with every command of a sender
    act_at: float  # robot's clock; one that is past acts at once
    twist: Vector  # base forward speed [m/s], yaw rate [rad/s]
    joint_velocity: Vector  # [rad/s], 7
    gripper: str  # "open" | "close"
    opening: float | None = None  # [m] between the finger pads when open; none: all the way
    lifetime: float = LIFETIME


class ClockGrant(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Shared clock: time may pass until then, when the command of number ``after`` has come."""

    version: str
    life: str
    until: float
    after: int = -1  # number of the newest command; a grant that overtook it waits for it; -1: there is none


class ClockReached(msgspec.Struct, frozen=True, kw_only=True):
    """Shared clock: the time is this, and everything that was sent before it has been sent before."""

    version: str
    life: str
    stamp: float


class TruthData(msgspec.Struct, frozen=True, kw_only=True):
    """Ground truth of a simulated robot; fields as in `motm_twin.model.plant.Truth`."""

    version: str
    life: str
    stamp: float
    pose: Vector
    objects: tuple[BodyTruth, ...]
    agents: tuple[BodyTruth, ...]
    obstacles: tuple[BodyTruth, ...]
    contacts: tuple[Contact, ...]
    picks: int
    places: int
    drops: int
    min_base_clearance: float | None
    min_arm_clearance: float | None
    min_ee_obstacle: float | None
    ee_obstacle: float | None
    plant_faults: tuple[str, ...]
    furniture: tuple[BodyTruth, ...]
    removed: tuple[str, ...]
    faults: tuple[str, ...]
    path_length: float
    cut_ins: tuple[CutIn, ...] = ()
    dropped: tuple[str, ...] = ()


class ResetRequest(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Begin again, in this scene or in your own."""

    version: str
    scene: Scene | None = None


class EditRequest(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Change the world as a person does: would ``edit`` be possible after ``before`` (check), or do it."""

    version: str
    check: bool
    before: tuple[WorldEdit, ...] = ()
    edit: WorldEdit


class TaskNotice(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """For a referee that counts: the task list of now, or where the robot was told that furniture stands."""

    version: str
    tasks: tuple[Task, ...] | None = None
    announced: dict[str, PlanarPose] | None = None  # x, y [m] of the reference point, turn [rad], by piece


class PlantAnswer(msgspec.Struct, frozen=True, kw_only=True):
    """The outcome of a request."""

    version: str
    ok: bool
    reason: str = ""
    life: str = ""  # reset: the new one


def to_message(source: Any, target: Any, **others: Any) -> Any:
    """The message ``target``: ``others``, and the fields of ``source`` with the same names; arrays as exact lists."""
    taken = {name: _plain(getattr(source, name)) for name in target.__struct_fields__ if name not in others}
    return target(**taken, **others)


def _plain(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        finite = np.isfinite(value)
        return [item if ok else None for item, ok in zip(value.tolist(), finite.tolist(), strict=True)]
    return value.item() if isinstance(value, np.generic) else value


def from_message(message: msgspec.Struct, target: Any, **others: Any) -> Any:
    """The reverse of `to_message`: lists become arrays, null in them becomes infinite."""
    names = [name for name in message.__struct_fields__ if name in target.__struct_fields__ and name not in others]
    values = {name: getattr(message, name) for name in names}
    return target(**{name: _array(value) for name, value in values.items()}, **others)


def _array(value: Any) -> Any:
    if not isinstance(value, list):
        return value
    return np.array([np.inf if one is None else one for one in value], dtype=float)
