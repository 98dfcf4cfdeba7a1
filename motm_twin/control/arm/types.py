"""Inputs and answer of one step of the arm (100 Hz or faster)."""

import math
from enum import StrEnum
from typing import NamedTuple, Protocol

import msgspec
import numpy as np
from numpy.typing import NDArray

from motm_twin.model.geometry import Array, from_frame, frozen
from motm_twin.model.plant import Actuation, Observation
from motm_twin.model.reason import Kind, Reason
from motm_twin.perception.world_map import NO_POINTS, WorldMap

_RIM = 0.1  # [m] beyond the radius of a track, within which a point belongs to it
NO_NEIGHBOURS = frozen(np.zeros((0, 6)))


class ArmGoal(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Goal of the hand. Positions are in the odometry frame: smooth, and refreshed by the camera."""

    kind: str  # "pick" | "place" | "none" (drive only: carry or stow)
    name: str  # object or bin
    position: Array  # [m] pick: point of the object between the fingers; place: the same at the bin's rim; shape (3,)
    yaw: float  # [rad] of the object (modulo 90 deg) or bin, odometry frame
    side: float  # [m] of the object to grasp or being held
    position_sd: float  # [m] per axis of the estimate
    last_seen: float | None  # [s]; None: never seen, position is the prior
    release_half_width: float = 0.0  # [m] place: half of the square in which the released object must be
    neighbours: Array = NO_NEIGHBOURS  # beside the object or in the bin: x, y, z [m], yaw [rad], side [m], 1: seen
    neighbour_names: tuple[str, ...] = ()
    others: Array = NO_NEIGHBOURS  # seen objects in reach, not in the bin, that the hand may swing across; (n, 6)


class ArmObstacles(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Lidar obstacles outside the map, in the odometry frame; any is assumed tall (Paper, Sec. V)."""

    points: Array  # [m], shape (m, 2)
    static: NDArray[np.bool_]  # in the same place for 3 s, at rest for 12 s if it was seen to move, shape (m,)
    expected: Array = NO_POINTS  # predicted points of moving ones, where nothing is yet, shape (k, 2)

    @classmethod
    def of(cls, world: WorldMap, T_odom_world: Array, ahead: float = 0.0) -> "ArmObstacles":
        """Seen points, and far sides of obstacles that may be moving; ``ahead`` [s]: time of the predicted points."""
        static = np.zeros(len(world.seen_points) + len(world.hidden), dtype=bool)
        static[: len(world.seen_points)] = world.seen_static
        points = np.concatenate((world.seen_points, world.hidden))
        later = _expected(points, world.tracks, ahead) if ahead > 0.0 else NO_POINTS
        return cls(
            points=from_frame(T_odom_world, points), static=static,
            expected=from_frame(T_odom_world, later) if len(later) else NO_POINTS,
        )  # fmt: skip

    def kept_from(self) -> tuple[Array, NDArray[np.bool_]]:
        """Points (m, 2) that the arm keeps away from, and which of them are static (m,)."""
        if not len(self.expected):
            return self.points, self.static
        moving = np.zeros(len(self.expected), dtype=bool)
        return np.concatenate((self.points, self.expected)), np.concatenate((self.static, moving))


def _expected(points: Array, tracks: Array, ahead: float) -> Array:
    """Predicted places of the points (n, 2) that belong to tracks (k, 7), after a time [s], shape (m, 2)."""
    later = [NO_POINTS]
    for x, y, vx, vy, radius in tracks[:, :5]:
        own = np.hypot(points[:, 0] - x, points[:, 1] - y) <= radius + _RIM
        later.append(points[own] + ahead * np.array([vx, vy]))
    return np.concatenate(later)


class Overlap(NamedTuple):
    """The body of the arm that is deepest in a seen obstacle, and its depth [m]."""

    body: str
    depth: float
    alone: bool = False  # the obstacle is a single cell, which may be a wrong hit


class ArmInputs(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Inputs of one arm step."""

    observation: Observation
    dt: float  # [s] of this step
    goal: ArmGoal
    base_twist: Array  # v_B the base controller wants at the end of this step [m/s, rad/s], shape (2,)
    time_to_range: float  # [s] until the target is in range
    plan_times: Array  # [s] from now, local plan of the base, shape (j,)
    plan_poses: Array  # odometry frame: x, y, heading, v, w, shape (j, 5)
    obstacles: ArmObstacles
    T_odom_world: Array  # planar pose of the world frame in the odometry frame, for mapped furniture, shape (3,)
    stuck_joint: int | None = None  # a joint that does not follow its commands, counted from 0
    slips_since: float = -math.inf  # [s] when the wheels were found to slip, and the base twist wrong; -inf: they grip


class Phase(StrEnum):
    """Phases of the hand's work on one target."""

    STOW = "stow"
    TRANSIT = "transit"  # on its way over the target
    FINAL = "final"  # down to the object
    CLOSING = "closing"
    LIFT = "lift"
    CARRY = "carry"
    RELEASE = "release"
    RETRY = "retry"  # the fingers open again


class ProgramStatus(StrEnum):
    """Outcome of the arm's quadratic program."""

    SOLVED = "solved"
    GAVE_WAY = "gave way"  # rows of furniture gave way
    DAMPED_STOP = "damped stop"  # there is no answer
    STANDING = "standing"  # the arm overlaps a seen obstacle
    WITHDRAWING = "withdrawing"
    NONE = "no arm"
    OPEN_LOOP = "open loop"
    COMMANDED = "commanded from outside"  # by an agent


_FAULTS = (ProgramStatus.GAVE_WAY, ProgramStatus.DAMPED_STOP, ProgramStatus.STANDING, ProgramStatus.WITHDRAWING)


class ArmStep(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Decision of one arm step, and its reasons."""

    time: float  # [s]
    phase: Phase
    actuation: Actuation  # QP answer: base twist, joint velocities, gripper
    reference: Array  # desired tool centre point, odometry frame [m], shape (3,)
    error: float  # [m] distance from tool centre point to reference
    tilt: float  # [rad] of the tool axis from vertical
    slack: Array  # end-effector velocity slack, shape (6,)
    manipulability: float
    active: tuple[str, ...]  # names of active QP rows and bounds
    limiter: str  # obstacle that limits the gripper now, "" when none
    obstacle_distance: float  # [m] gripper centre to the nearest seen obstacle, inf when none
    allowed_approach: float  # [m/s] damper line value, inf when not limited
    program: ProgramStatus
    holding: bool  # the gripper believes that it holds the object
    engaged: bool  # final approach to lift: the base must keep the object in reach
    dwell: float  # [s] that the job still needs in reach
    # "" | "picked" | "placed" | "missed" (failed, is retried) | "lost" (held object gone) | "stuck" (starts over)
    # | "no room" (beside the object, for the fingers)
    outcome: str
    why: Reason | None = None  # the arm waits, tries again or stops

    @property
    def reason(self) -> str:
        """`why` in one sentence; "" for none."""
        return "" if self.why is None else str(self.why)

    @property
    def qp_status(self) -> str:
        """Status of the program, with the reason if it is not "solved"."""
        if self.why is None or self.program not in _FAULTS:
            return str(self.program)
        return f"{self.program}: {self.why.other if self.why.kind == Kind.ARM_STOPPED else self.why}"


class ArmTiming(Protocol):
    """Rule for the time at which the arm leaves for the target, and for its speed (default: that of MotM)."""

    def transit_duration(self, distance: float, speed: float, time_to_range: float) -> float | None:
        """Seconds to take for the remaining distance [m] at base speed [m/s]; None: do not start yet."""
        ...


class TransitRule(msgspec.Struct, frozen=True, kw_only=True):
    """Leave when the expected transit, distance / (v_B k_A), takes as long as the target needs to come into range."""

    k_A: float  # MotM; 0.25 to 1.0 are stable
    base_speed: float  # [m/s] v_B is taken as at least this: a turning or braking base soon drives again
    hand_speed: float  # [m/s] a transit is never planned faster than this

    def transit_duration(self, distance: float, speed: float, time_to_range: float) -> float | None:
        """Seconds to take for the remaining distance [m] at base speed [m/s]; None: do not start yet."""
        expected = distance / (max(abs(speed), self.base_speed) * self.k_A)
        if expected < time_to_range:
            return None
        return max(time_to_range, distance / self.hand_speed)
