"""Seven fixed poses round a table, facing it; and round a bin, facing that."""

import math

import numpy as np
from shapely.geometry import Point as ShapelyPoint
from shapely.geometry import Polygon
from shapely.geometry.base import BaseGeometry
from shapely.ops import unary_union

from motm_twin.methods.method import PlannerParts
from motm_twin.methods.stationary.parameters import StationaryParameters
from motm_twin.methods.stationary.placement import StationaryPlacement, Terms
from motm_twin.methods.stationary.reach_of import TargetReach
from motm_twin.model.geometry import Array, from_frame
from motm_twin.model.known import KnownWorld
from motm_twin.model.scene import Bin, Solid
from motm_twin.model.scene_shapes import base_outline, outline
from motm_twin.planning.global_path import GraphCache
from motm_twin.planning.types import Target

_PHASES = 32  # ways of setting the first pose, of which the best is taken
_RIM_POINTS = 48  # of the line that the poses must serve
_OFFSETS = 5  # distances from the table that are tried
_STEP, _BIN_STEP = 0.05, 0.02  # [m] between them, at a table and at a bin
_FARTHEST = 1.1  # [m] from a bin
_NEAR, _BELOW = 0.10, 0.08  # [m] beside and above what carries an object


class FixedPoses:
    """The poses, found from the furniture that is known beforehand, by one rule for every table.

    Things stand along a line `fixed_inset` inside the edge of the table. The poses are equally spaced along that line,
    each at right angles to the edge and facing it. Their distance from the edge, and where along the line they begin,
    are such that the point of the line that is served worst is reached with the most manipulability.
    """

    def __init__(self, known: KnownWorld, reach: TargetReach, clearance: float, parameters: StationaryParameters):
        self._known, self._reach, self._clearance, self._p = known, reach, clearance, parameters
        self._obstacles = unary_union([outline(solid.shape) for solid in known.solids])
        self._bins = {item.name: item for item in known.bins}
        self._found: dict[tuple[str, ...], Array] = {}  # a pure function of the names

    def round(self, target: Target) -> Array:
        """The poses for a target, shape (7, 3); (0, 3) for an object that stands on no furniture of the map."""
        if target.kind == "place":
            key = ("bin", target.name)
            if key not in self._found:
                self._found[key] = self._round_bin(self._bins[target.name], target)
            return self._found[key]
        table = self._carrier(target)
        if table is None:
            return np.zeros((0, 3))
        key = ("table", table.name, target.name)
        if key not in self._found:
            self._found[key] = self._round_table(outline(table.shape), target)
        return self._found[key]

    def _carrier(self, target: Target) -> Solid | None:
        """The highest furniture below an object."""
        item = next(item for item in self._known.objects if item.name == target.name)
        at, bottom = ShapelyPoint(*target.position[:2]), item.position[2] - 0.5 * item.side
        below = [
            solid
            for solid in self._known.solids
            if abs(solid.z_max - bottom) <= _BELOW and outline(solid.shape).distance(at) <= _NEAR
        ]
        return max(below, key=lambda solid: (solid.z_max, solid.name), default=None)

    def _round_table(self, table: Polygon, target: Target) -> Array:
        rim, foot = self._rim(table), self._known.robot.footprint
        if not len(rim):
            return np.zeros((0, 3))
        nose = 0.5 * foot.length + foot.offset_x + self._clearance
        sets = [self._spaced(table, nose + k * _STEP, j / _PHASES) for k in range(_OFFSETS) for j in range(_PHASES)]
        share = np.array([self._shares(np.concatenate(sets), target, point) for point in rim])
        worst = share.reshape(len(share), len(sets), -1).max(axis=2).min(axis=0)
        return sets[int(np.argmax(worst))]

    def _spaced(self, table: Polygon, distance: float, phase: float) -> Array:
        """Poses at a distance [m] of the base's centre from the edge, the first ``phase`` of a space along."""
        count, edge = self._p.fixed_poses, table.exterior
        poses = []
        for at in self._along(table, (np.arange(count) + phase) / count):
            nearest = edge.interpolate(edge.project(ShapelyPoint(*at)))
            out = np.array([nearest.x, nearest.y]) - at
            out /= np.hypot(*out)
            poses.append((nearest.x + distance * out[0], nearest.y + distance * out[1], math.atan2(-out[1], -out[0])))
        return np.array(poses)

    def _rim(self, table: Polygon) -> Array:
        """Where things stand that can be reached: points a little inside the edge, shape (m, 2)."""
        return self._along(table, np.arange(_RIM_POINTS) / _RIM_POINTS)

    def _along(self, table: Polygon, shares: Array) -> Array:
        """Points of the line a little inside the edge; none when the table is too narrow for one."""
        inside = table.buffer(-self._p.fixed_inset)
        if not isinstance(inside, Polygon) or inside.is_empty:
            return np.zeros((0, 2))
        points = [inside.exterior.interpolate(float(share), normalized=True) for share in shares]
        return np.array([(point.x, point.y) for point in points])

    def _shares(self, poses: Array, like: Target, point: Array) -> Array:
        return self._reach.good_share(poses, Target(kind=like.kind, name=like.name, position=point))

    def _round_bin(self, item: Bin, target: Target) -> Array:
        """Poses in equal directions about a bin, each as near as the furniture lets it, facing the bin."""
        sets, centre = [], np.array(item.centre)
        obstacles = unary_union([self._obstacles, _square(item)])
        for j in range(_PHASES):
            angles = 2.0 * math.pi * (np.arange(self._p.fixed_poses) + j / _PHASES) / self._p.fixed_poses
            sets.append(np.array([self._nearest(centre, angle, obstacles) for angle in angles]))
        share = self._shares(np.concatenate(sets), target, centre).reshape(len(sets), -1)
        return sets[int(np.argmax(share.max(axis=1)))]

    def _nearest(self, centre: Array, angle: float, obstacles: BaseGeometry) -> tuple[float, float, float]:
        heading = math.remainder(angle + math.pi, 2.0 * math.pi)
        pose = (0.0, 0.0, 0.0)
        for distance in np.arange(0.4, _FARTHEST, _BIN_STEP):
            pose = (
                float(centre[0] + distance * math.cos(angle)),
                float(centre[1] + distance * math.sin(angle)),
                heading,
            )
            if base_outline(pose, self._known.robot.footprint).distance(obstacles) >= self._clearance:
                break
        return pose


class FixedSetPlacement(StationaryPlacement):
    """Of the seven poses round a table the one with the most manipulability, of those round a bin the nearest.

    When none of them is free and reaches the target, every pose counts, as in `irm`.
    """

    def __init__(self, parts: PlannerParts, graphs: GraphCache, parameters: StationaryParameters | None = None) -> None:
        super().__init__(parts, graphs, Terms(current=False, onward=False), parameters)
        self._fixed = FixedPoses(
            parts.known, self._arm_reach, self._parameters.placement.clearance + 0.01, self.stationary
        )

    def _pose_sets(self, target: Target):
        poses = self._fixed.round(target)
        if len(poses):
            yield poses, np.arange(len(poses)), "fixed pose"
        yield *self.dense(target), "none of the fixed poses is free and near enough: pose"

    def _cost(self, target: Target, share: Array, azimuth: Array, current: Array, onward: Array) -> Array:
        """C_i [s]: for a bin the way to it."""
        if target.kind == "place":
            return current
        return super()._cost(target, share, azimuth, current, onward)


def _square(item: Bin) -> Polygon:
    half = 0.5 * item.side
    corners = np.array([(-half, -half), (half, -half), (half, half), (-half, half)])
    return Polygon(from_frame(np.array([*item.centre, item.yaw]), corners))
