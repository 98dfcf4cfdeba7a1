"""Overlap of the arm with an obstacle that the lidar sees: a person put it there, or pushed the robot into it.

The lidar sees only the near side of the obstacle, below the arm; its extent beyond that is unknown. So arm and base
stop for `overlap_stands`. Then the arm returns to its stow pose in joint space, no faster than `overlap_speed`, at
which a touch does no harm. The arm pursues no goal meanwhile.
"""

import math

import numpy as np

from motm_twin.control.arm.bodies import BODIES, Balls, arm_balls, placed
from motm_twin.control.arm.limits import seen_distances
from motm_twin.control.arm.parameters import ArmParameters
from motm_twin.control.arm.types import ArmInputs, Overlap
from motm_twin.control.arm.view import Arm
from motm_twin.model.compiler import njit
from motm_twin.model.exact import norm, times
from motm_twin.model.geometry import Array
from motm_twin.model.profile import DDQ_MAX, RobotProfile

_BESIDE = 0.11  # [m] between the middles of cells of one obstacle
_STOWED = 0.02  # [rad] joints this near to the stow pose count as stowed


class ArmOverlap:
    """Detects overlaps of the arm with seen obstacles, and computes the motion out of them."""

    def __init__(self, profile: RobotProfile, stow_joints: Array, parameters: ArmParameters) -> None:
        """``stow_joints`` (7,) [rad]: end of the arm's way out."""
        self._profile, self._stow, self._parameters = profile, stow_joints, parameters
        self._balls = arm_balls()

    def find(self, arm: Arm, inputs: ArmInputs, held_side: float, *, lasts: bool) -> Overlap | None:
        """The arm body that is deepest in seen obstacles, and its depth; None without an overlap.

        ``held_side`` [m]: side of a held cube, 0: none. ``lasts``: an overlap was found before, so any depth counts.
        """
        points, width = inputs.obstacles.points, inputs.observation.gripper_width
        if not len(points):
            return None
        balls = placed(self._balls, width, held_side)
        found = self._deepest(arm, balls, points, 0.0 if lasts else self._parameters.overlap_depth)
        if found is None or lasts:
            return found
        apart = np.hypot(*(points[:, None] - points[None]).transpose(2, 0, 1))
        whole = np.ascontiguousarray(points[(apart < _BESIDE).sum(axis=1) > 1])
        return found._replace(alone=self._deepest(arm, balls, whole, self._parameters.overlap_depth) is None)

    def _deepest(self, arm: Arm, balls: Balls, points: Array, least: float) -> Overlap | None:
        """The body of the arm that is deepest in points (m, 2), and more than ``least`` [m]."""
        distance, _, _ = seen_distances(arm.T, balls, len(BODIES), 0.0, points, arm.mount, arm.pose[2])
        deepest = int(distance.argmin())
        depth = -float(distance[deepest, 0])
        return Overlap(BODIES[deepest], depth) if depth > least else None

    def way_out(self, arm: Arm, inputs: ArmInputs, twist: Array, *, withdraws: bool) -> tuple[Array, Array]:
        """Next base twist (2,) and arm rates (7,): the base brakes, the joints stop or return to the stow pose.

        ``twist`` (2,): base twist commanded last. ``withdraws``: the joints return to the stow pose. While an obstacle
        is inside the footprint of the base, the base follows its plan to leave it, and the joints stop.
        """
        base, dt = self._profile.base, inputs.dt
        leaving = self._inside_base(arm.pose, inputs.obstacles.points)
        limits = np.array([base.linear_acceleration, base.yaw_acceleration]) * dt
        desired = inputs.base_twist if leaving else np.zeros(2)
        after = np.clip(desired, twist - limits, twist + limits)
        way = self._stow - arm.q
        joints = np.zeros(7)
        if withdraws and not leaving and float(np.abs(way).max()) > _STOWED:
            hand = norm(times(arm.jacobian[:3], way))
            slow = self._parameters.overlap_speed
            joints = way * min(1.0, slow / max(hand, 1e-9), slow / max(float(np.abs(way).max()) * 0.5, 1e-9))
        return after, np.clip(joints, arm.dq - DDQ_MAX * dt, arm.dq + DDQ_MAX * dt)

    def _inside_base(self, pose: Array, points: Array) -> bool:
        body = self._profile.footprint
        return _inside(pose, points, 0.5 * body.length, 0.5 * body.width, body.offset_x)


@njit(cache=True)
def _inside(pose: Array, points: Array, half_length: float, half_width: float, offset: float) -> bool:
    """Test that one of the points (m, 2) is in the rectangle of a base at a pose (3,)."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    for i in range(points.shape[0]):
        dx, dy = points[i, 0] - pose[0], points[i, 1] - pose[1]
        if abs(c * dx + s * dy - offset) < half_length and abs(c * dy - s * dx) < half_width:
            return True
    return False
