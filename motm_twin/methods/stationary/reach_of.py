"""How well the arm gets to the targets of a scene from a base pose, read from the reachability map."""

import math

import numpy as np

from motm_twin.control.arm.parameters import ArmParameters
from motm_twin.control.arm.view import PREFERRED_RADIUS
from motm_twin.methods.stationary.reachability import ReachabilityMap, Task, reachability_map
from motm_twin.model.exact import angle_of, turn_between
from motm_twin.model.geometry import Array
from motm_twin.model.known import KnownWorld
from motm_twin.planning.parameters import PlanningParameters
from motm_twin.planning.reach import ReachModel
from motm_twin.planning.types import Target

_NEAR = 1.0  # [m] from the target, beyond which nothing is beside the arm
_ROUNDED = 2  # decimals [m] of heights: tables of nearly the same height share a map


class TargetReach:
    """Manipulability at base poses for the objects and bins that are known beforehand.

    Heights and yaws are those known beforehand too: the base is told where a target is in the plane only.
    """

    def __init__(self, known: KnownWorld, parameters: PlanningParameters) -> None:
        arm = ArmParameters()
        self._reach, self._slack = ReachModel(known.robot, parameters.reach), parameters.placement.reach_slack
        self._arm = known.robot.arm
        self._mount = np.array([self._arm.mount_x, self._arm.mount_y])
        self._objects = {item.name: item for item in known.objects}
        self._bins = {item.name: item for item in known.bins}
        self._release_height, self._release_margin = arm.release_height, arm.release_margin
        for name in self._objects:
            self.of("pick", name)  # now rather than in a period
        for name in self._bins:
            self.of("place", name)

    def of(self, kind: str, name: str) -> ReachabilityMap:
        """The map at the height of a target; KeyError for one that is neither an object nor a bin."""
        z_0 = self._arm.mount_z
        if kind == "pick":
            item = self._objects[name]
            z, surface = item.position[2], item.position[2] - 0.5 * item.side
        else:
            place = self._bins[name]
            z, surface = place.rim_z + self._release_height, place.rim_z
        return reachability_map(Task(kind, round(z - z_0, _ROUNDED), round(surface - z_0, _ROUNDED)))

    def share(self, poses: Array, target: Target) -> Array:
        """Manipulability at base poses (m, 3), as a share of the best there is for the target; 0: out of reach."""
        if not len(poses):
            return np.zeros(0)
        reach = self.of(target.kind, target.name)
        radius, azimuth, outward = self._polar(poses, target)
        yaw = (self._objects[target.name].yaw if target.kind == "pick" else 0.0) - outward
        return reach.at(radius, azimuth, yaw) / reach.best

    def good_share(self, poses: Array, target: Target) -> Array:
        """`share` where the target is well within what the base holds for the reach of the arm, else 0."""
        return np.where(self._reach.reached_from(poses, target, slack=self._slack), self.share(poses, target), 0.0)

    def azimuth(self, poses: Array, target: Target) -> Array:
        """Angle [rad] of the target to either side of straight ahead of the mount, shape (m,)."""
        return turn_between(self._polar(poses, target)[1], 0.0)

    def clear_of(self, poses: Array, target: Target, points: Array) -> Array:
        """Distance [m] of the nearest of points (k, 2) from the line between mount and target, shape (m,)."""
        mount = self._mounts(poses)
        along = self._point(mount, target) - mount
        square = np.maximum((along**2).sum(axis=1), 1e-9)
        nearest = np.full(len(poses), np.inf)
        for point in points[np.hypot(*(points - target.position[:2]).T) < _NEAR]:
            away = point - mount
            part = np.clip((away * along).sum(axis=1) / square, 0.0, 1.0)[:, None]
            nearest = np.minimum(nearest, np.hypot(*(away - part * along).T))
        return nearest

    def _mounts(self, poses: Array) -> Array:
        """Positions [m] of the arm mount, shape (m, 2)."""
        c, s = np.cos(poses[:, 2]), np.sin(poses[:, 2])
        x, y = self._mount
        return poses[:, :2] + np.column_stack((c * x - s * y, s * x + c * y))

    def _polar(self, poses: Array, target: Target) -> tuple[Array, Array, Array]:
        """Radius and azimuth of the target about the mount in the base frame, and its direction in the world."""
        mount = self._mounts(poses)
        away = self._point(mount, target) - mount
        outward = angle_of(away[:, 1], away[:, 0])
        return np.hypot(away[:, 0], away[:, 1]), outward - poses[:, 2], outward

    def _point(self, mount: Array, target: Target) -> Array:
        """Where the hand goes: the object, or the point of the release square that suits the arm best; (m, 2)."""
        centre = np.asarray(target.position[:2])
        if target.kind == "pick":
            return np.broadcast_to(centre, mount.shape)
        place = self._bins[target.name]
        half = max(0.0, place.side / 2.0 - place.wall - 0.02 - self._release_margin)  # 0.02: half a cube
        away = centre - mount
        distance = np.maximum(np.hypot(away[:, 0], away[:, 1]), 1e-6)
        wanted = -away * np.maximum(0.0, 1.0 - PREFERRED_RADIUS / distance)[:, None]
        c, s = math.cos(place.yaw), math.sin(place.yaw)
        x = np.clip(c * wanted[:, 0] + s * wanted[:, 1], -half, half)
        y = np.clip(-s * wanted[:, 0] + c * wanted[:, 1], -half, half)
        return centre + np.column_stack((c * x - s * y, s * x + c * y))
