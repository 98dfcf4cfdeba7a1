"""Forecast of the base under the twist that an agent asks for, and when the target comes into reach of the arm.

The arm of MotM leaves for its target a moment before that is in reach. A planner tells it when; an agent does not, so
the forecast is that it goes on as it does.
"""

import math

import numpy as np

from motm_twin.model.geometry import Array, frozen
from motm_twin.model.motion import kernel, step
from motm_twin.model.profile import RobotProfile
from motm_twin.planning.parameters import PlanningParameters
from motm_twin.planning.reach import Job, ReachModel, in_reach
from motm_twin.planning.rtr import turn
from motm_twin.planning.types import Target

STEP = 0.1  # [s] between two poses of the forecast
STEPS = 30  # 3 s: the arm leaves at most as long before


class Forecast:
    """Motion and time to range for one robot."""

    def __init__(self, profile: RobotProfile, parameters: PlanningParameters) -> None:
        self._limits = profile.base
        self._reach = ReachModel(profile, parameters.reach)
        self._staa = parameters.staa

    def motion(self, pose: Array, twist: Array, wanted: Array) -> tuple[Array, Array]:
        """Times [s] from now (31,), and x, y, heading, v, w at each, shape (31, 5), when ``wanted`` is kept."""
        poses = np.empty((STEPS + 1, 5))
        limits = self._limits
        follow(
            np.asarray(pose, dtype=float),
            np.asarray(twist, dtype=float),
            np.asarray(wanted, dtype=float),
            limits.linear_acceleration * STEP,
            limits.yaw_acceleration * STEP,
            poses,
        )
        return frozen(STEP * np.arange(STEPS + 1)), poses

    def time_to_range(self, times: Array, poses: Array, target: Target | None) -> float:
        """Time [s] until the target is in reach; 0 when it is, inf without a target.

        A target that the motion does not bring into reach takes at least as long as the forecast, and at least as long
        as turning to it and driving straight would: so the arm does not leave for it.
        """
        if target is None:
            return math.inf
        job = self._reach.job(target, self._staa)
        first = first_in_reach(poses, job)
        if first >= 0:
            return float(times[first])
        return max(float(times[-1]), self._straight(poses[0], job))

    def _straight(self, pose: Array, job: Job) -> float:
        """Time [s] of a turn towards the target and a straight drive until it is in reach, obstacles or not."""
        dx, dy = job.x - pose[0], job.y - pose[1]
        way = max(0.0, math.hypot(dx, dy) - job.mount_x - job.r_max)
        turning = float(turn(float(pose[2]), math.atan2(dy, dx)))
        return turning / self._limits.yaw_rate + way / self._limits.forward_speed


@kernel
def follow(pose: Array, twist: Array, wanted: Array, dv: float, dw: float, out: Array) -> None:
    """Fill ``out`` (n, 5) with x, y, heading, v, w every `STEP`; the twist nears ``wanted`` by dv and dw a step."""
    x, y, heading, v, w = pose[0], pose[1], pose[2], twist[0], twist[1]
    for i in range(out.shape[0]):
        out[i, 0], out[i, 1], out[i, 2], out[i, 3], out[i, 4] = x, y, heading, v, w
        next_v = v + min(max(wanted[0] - v, -dv), dv)
        next_w = w + min(max(wanted[1] - w, -dw), dw)
        x, y, heading = step(x, y, heading, v, w, next_v, next_w, STEP)
        v, w = next_v, next_w


@kernel
def first_in_reach(poses: Array, job: Job) -> int:
    """Index of the first pose (n, 5) from which the job's target is in reach; -1: none."""
    for i in range(poses.shape[0]):
        if in_reach(poses[i, 0], poses[i, 1], poses[i, 2], poses[i, 3], poses[i, 4], job):
            return i
    return -1
