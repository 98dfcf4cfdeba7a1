"""Reach of the arm as base planning models it: tests that a target is in reach, and the job to be done there."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from motm_twin.model.geometry import Array
from motm_twin.model.motion import arc, kernel
from motm_twin.model.profile import RobotProfile
from motm_twin.model.scene import HEADING_TOLERANCE
from motm_twin.planning.kernels import length_of
from motm_twin.planning.parameters import ReachParameters, StaaParameters
from motm_twin.planning.rtr import turn
from motm_twin.planning.types import Target

MANIPULATE, DRIVE = 1, 2
ARRIVED = 1e-6  # [s] dwell of a drive target: being there is enough


class Job(NamedTuple):
    """A target as the search kernels read it."""

    kind: int  # MANIPULATE or DRIVE
    x: float  # [m]
    y: float
    mount_x: float  # arm mount in the base frame [m]
    mount_y: float
    r_min: float  # [m] mount to object
    r_max: float
    speed: float  # [m/s] limit of the object's motion in the base frame
    dwell: float  # [s] a whole job, started anew whenever reach is lost
    heading: float  # [rad] drive only, nan: free
    heading_tolerance: float  # [rad]
    behind: float  # cosine of the largest azimuth that joint 1 can turn the arm to
    walls: Array  # [m] edges x, y, x, y that the arm does not reach over, shape (k, 4)


@kernel
def in_reach(x: float, y: float, heading: float, v: float, w: float, job: Job) -> bool:
    """Test that the job's target is in reach from a base pose [m, rad] moving at v [m/s] and w [rad/s]."""
    dx, dy = job.x - x, job.y - y
    if job.kind == DRIVE:
        if length_of(dx, dy) > job.r_max:
            return False
        if math.isnan(job.heading):
            return True
        return turn(heading, job.heading) <= job.heading_tolerance
    return manipulable(x, y, math.cos(heading), math.sin(heading), v, w, job)


@kernel
def manipulable(x: float, y: float, c: float, s: float, v: float, w: float, job: Job) -> bool:
    """`in_reach` for a job of the arm, and a heading whose cosine and sine are known."""
    dx, dy = job.x - x, job.y - y
    px, py = c * dx + s * dy, -s * dx + c * dy
    distance = length_of(px - job.mount_x, py - job.mount_y)
    if distance < job.r_min or distance > job.r_max or px - job.mount_x < job.behind * distance:
        return False
    if length_of(v - w * py, w * px) > job.speed:
        return False
    mount_x, mount_y = x + c * job.mount_x - s * job.mount_y, y + s * job.mount_x + c * job.mount_y
    return not _crosses(mount_x, mount_y, job.x, job.y, job.walls)


@kernel
def _crosses(x: float, y: float, to_x: float, to_y: float, walls: Array) -> bool:
    """Test that the line from a point (x, y) to another crosses a wall (k, 4)."""
    for k in range(walls.shape[0]):
        ax, ay, bx, by = walls[k, 0], walls[k, 1], walls[k, 2], walls[k, 3]
        of_a = (to_x - x) * (ay - y) - (to_y - y) * (ax - x)
        of_b = (to_x - x) * (by - y) - (to_y - y) * (bx - x)
        of_start = (bx - ax) * (y - ay) - (by - ay) * (x - ax)
        of_end = (bx - ax) * (to_y - ay) - (by - ay) * (to_x - ax)
        if of_a * of_b < 0.0 and of_start * of_end < 0.0:
            return True
    return False


@kernel
def first_in_reach(start: Array, step: Array, length: float, heading: float, job: Job) -> float:
    """Distance [m] along a straight step (2,) until the target is in reach of a standing base; inf: never."""
    for k in range(int(math.ceil(length / 0.05))):
        s = k * 0.05
        if in_reach(start[0] + s / length * step[0], start[1] + s / length * step[1], heading, 0.0, 0.0, job):
            return s
    return math.inf


@kernel
def first_node_in_reach(states: Array, dt: float, job: Job) -> float:
    """The first node (x, y, heading, v, w; shape (n, 5)), or the middle after it, from which the target is in reach.

    Nodes are dt [s] apart, and an arc of constant speeds between them; inf when there is none.
    """
    n = states.shape[0]
    for i in range(n):
        x, y, heading, v, w = states[i, 0], states[i, 1], states[i, 2], states[i, 3], states[i, 4]
        if in_reach(x, y, heading, v, w, job):
            return i
        if i + 1 < n:
            v_m, w_m = 0.5 * (v + states[i + 1, 3]), 0.5 * (w + states[i + 1, 4])
            mx, my, facing = arc(x, y, heading, v_m, w_m, dt / 2)
            if in_reach(mx, my, facing, v, w, job):
                return i + 0.5
    return math.inf


@kernel
def _mark_reached(
    poses: Array, c: Array, s: Array, mount_x: float, mount_y: float, x: float, y: float, least: float, most: float,
    behind: float, result: NDArray[np.bool_],
) -> None:  # fmt: skip
    """Kernel of `ReachModel.reached_from`; c, s of the headings, ``behind``: cosine of the largest azimuth."""
    for i in range(poses.shape[0]):
        dx = x - (poses[i, 0] + c[i] * mount_x - s[i] * mount_y)
        dy = y - (poses[i, 1] + s[i] * mount_x + c[i] * mount_y)
        distance = math.hypot(dx, dy)
        result[i] = least <= distance <= most and c[i] * dx + s[i] * dy >= behind * distance


@kernel
def _mark_behind(
    poses: Array, c: Array, s: Array, mount: tuple[float, float], to: tuple[float, float], walls: Array,
    result: NDArray[np.bool_],
) -> None:  # fmt: skip
    """Kernel of `ReachModel.behind_walls`; c, s of the headings."""
    for i in range(poses.shape[0]):
        x = poses[i, 0] + c[i] * mount[0] - s[i] * mount[1]
        y = poses[i, 1] + s[i] * mount[0] + c[i] * mount[1]
        result[i] = _crosses(x, y, to[0], to[1], walls)


class ReachModel:
    """Reach of the arm of one robot: horizontal distance and azimuth of the object from the mount, and its speed."""

    def __init__(self, profile: RobotProfile, parameters: ReachParameters) -> None:
        self._arm = profile.arm
        self.parameters = parameters

    def r_max(self, target: Target) -> float:
        """Largest distance [m] from arm mount to target: a hand that is high, or low, reaches less far."""
        return min(self.parameters.r_max(target.kind), target.reach)

    def job(self, target: Target, staa: StaaParameters, *, slack: float = 0.0) -> Job:
        """The target for the kernels; `slack` [m] narrows the reach and, if positive, lowers the speed limit."""
        p = self.parameters
        if target.kind == "drive":
            heading = math.nan if target.heading is None else float(target.heading)
            turned = min(staa.pass_heading, HEADING_TOLERANCE)  # beyond that the task is not done
            return Job(
                DRIVE, float(target.position[0]), float(target.position[1]), 0.0, 0.0, 0.0, float(target.tolerance),
                math.inf, ARRIVED, heading, turned, -1.0, np.array(target.walls),
            )  # fmt: skip
        r_max = self.r_max(target)
        speed = p.relative_speed * (p.plan_speed if slack > 0.0 else 1.0)
        return Job(
            MANIPULATE, float(target.position[0]), float(target.position[1]), self._arm.mount_x, self._arm.mount_y,
            p.r_min + slack, r_max - slack, speed, p.dwell(target.kind),
            math.nan, 0.0, math.cos(p.azimuth_max), np.array(target.walls),
        )  # fmt: skip

    def contains(self, pose: Array, twist: Array, target: Target, staa: StaaParameters | None = None) -> bool:
        """Test that the target is in reach from a base pose (3,) moving with twist (2,)."""
        job = self.job(target, staa or StaaParameters())
        return bool(in_reach(*(float(value) for value in (*pose, *twist)), job))

    def reached_from(self, poses: Array, target: Target, *, slack: float = 0.0) -> Array:
        """Test that the target is in reach of a standing robot at each of the poses (m, 3), shape (m,) of bool."""
        p = self.parameters
        least, most = p.r_min + slack, self.r_max(target) - slack
        result = np.empty(len(poses), dtype=np.bool_)
        _mark_reached(
            poses, np.cos(poses[:, 2]), np.sin(poses[:, 2]), self._arm.mount_x, self._arm.mount_y,
            float(target.position[0]), float(target.position[1]), least, most, math.cos(p.azimuth_max), result,
        )  # fmt: skip
        return result & ~self.behind_walls(poses, target)

    def behind_walls(self, poses: Array, target: Target) -> Array:
        """Test that the line from the mount to the target crosses a wall, at each pose (m, 3); shape (m,) of bool."""
        result = np.empty(len(poses), dtype=np.bool_)
        _mark_behind(
            poses, np.cos(poses[:, 2]), np.sin(poses[:, 2]), (self._arm.mount_x, self._arm.mount_y),
            (float(target.position[0]), float(target.position[1])), np.array(target.walls), result,
        )  # fmt: skip
        return result
