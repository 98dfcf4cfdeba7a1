"""What the pointer is at: the first thing along a ray from the eye, found by geometry, so small things can be hit too.

Viser could tell which node is clicked, but then outlines every clickable one in yellow, reports a click on a body to
the ground as well, and asks for pixels that a finger does not hit.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import shapely

from motm_twin.bus.messages import BodyMessage, TickMessage
from motm_twin.model.furniture import moved_scene, pieces
from motm_twin.model.geometry import Array
from motm_twin.model.scene import Scene
from motm_twin.model.scene_shapes import outline, rectangle

SLACK = 0.014  # [rad] a small thing may be missed by
SLACK_NEAR = 0.015  # [m] the same close to the eye
CANDIDATE_HEIGHT = 0.035  # [m]
_ROBOT = ((0.36, 0.0, 0.4), (0.2, 0.4, 1.0))  # radius, lower and upper end [m] of base and arm
_NO_HIT = math.inf


@dataclass(frozen=True)
class Ray:
    """From the eye through the pointer; ``direction`` has length 1."""

    origin: Array
    direction: Array

    @classmethod
    def through(cls, eye: Iterable[float], point: Iterable[float]) -> "Ray":
        """The ray from the eye through a point."""
        origin = np.asarray(tuple(eye), dtype=float)
        direction = np.asarray(tuple(point), dtype=float) - origin
        return cls(origin, direction / np.linalg.norm(direction))

    def at(self, distance: float) -> Array:
        """The point [m] at a distance."""
        return self.origin + distance * self.direction


@dataclass(frozen=True)
class Hit:
    """What is hit: candidate | object | bin | body | piece | robot | fixed | floor, which one, and where [m]."""

    kind: str
    name: str
    point: Array
    distance: float
    index: int = -1  # of a candidate


class Surroundings:
    """A scene with its furniture where a tick has it."""

    def __init__(self, scene: Scene) -> None:
        self._scene, self.pieces = scene, pieces(scene)
        self._owner = {part: piece.name for piece in self.pieces.values() for part in piece.solids}
        self._key: tuple | None = None
        self.now = scene

    def update(self, tick: TickMessage) -> None:
        """Furniture may have moved."""
        moved = {body.name: (body.position[0], body.position[1], body.yaw) for body in tick.furniture}
        gone = tuple(name for name in tick.removed if name in self.pieces)
        key = (tuple(moved.items()), gone)
        if key != self._key:
            self._key = key
            self.now = moved_scene(self._scene, moved, gone)
            self._prisms = [
                (self._owner.get(solid.name), outline(solid.shape), solid.z_min, solid.z_max)
                for solid in self.now.solids
            ]
            self._bins = [
                (box.name, rectangle((*box.centre, box.yaw), (box.side, box.side)), box.floor_z, box.rim_z)
                for box in self.now.bins
            ]

    def first(self, ray: Ray, tick: TickMessage, *, candidates: bool) -> Hit | None:
        """The first thing along a ray; candidates only when they are shown."""
        solid = self.solid(ray, tick)
        behind = self.solid(ray, tick, bins=False)  # bins are open: what lies in one can be seen
        limit = _NO_HIT if behind is None else behind.distance
        small = [self._object(ray, item) for item in tick.objects]
        if candidates:
            small.append(_candidate(ray, tick))
        near = [hit for hit in small if hit is not None and hit.distance < limit + 0.08]
        return min(near, key=lambda hit: hit.distance) if near else solid

    def solid(self, ray: Ray, tick: TickMessage, *, bins: bool = True) -> Hit | None:
        """The first thing along a ray that is not small."""
        found: list[tuple[float, str, str]] = []
        for name, shape, low, high in self._bins if bins else []:
            found.append((_prism(ray, shape, low, high), "bin", name))
        for owner, shape, low, high in self._prisms:
            found.append((_prism(ray, shape, low, high), "fixed" if owner is None else "piece", owner or ""))
        for body in (*tick.agents, *tick.obstacles):
            found.append((_prism(ray, body_outline(body), 0.0, body.size[2] or 1.0), "body", body.name))
        x, y, _ = tick.robot.true_pose
        for radius, low, high in _ROBOT:
            found.append((_prism(ray, shapely.Point(x, y).buffer(radius, quad_segs=6), low, high), "robot", ""))
        found.append((_plane(ray, 0.0), "floor", ""))
        distance, kind, name = min(found, key=lambda entry: entry[0])
        return None if distance == _NO_HIT else Hit(kind, name, ray.at(distance), distance)

    def surface(self, ray: Ray) -> Array | None:
        """Where a ray meets furniture, a bin's floor or the ground from above [m]: where a cube can be put."""
        best = _plane(ray, 0.0)
        for _, shape, low, _ in self._bins:
            best = min(best, _plate(ray, shape, low))
        for _, shape, _, high in self._prisms:
            best = min(best, _plate(ray, shape, high))
        return None if best == _NO_HIT else ray.at(best)

    @staticmethod
    def _object(ray: Ray, item: BodyMessage) -> Hit | None:
        distance = _ball(ray, np.asarray(item.position), 0.6 * item.size[0])
        return None if distance == _NO_HIT else Hit("object", item.name, np.asarray(item.position), distance)


def _candidate(ray: Ray, tick: TickMessage) -> Hit | None:
    poses = tick.placement.poses
    if not poses:
        return None
    centres = np.column_stack([np.asarray(poses)[:, :2], np.full(len(poses), CANDIDATE_HEIGHT)])
    along = (centres - ray.origin) @ ray.direction
    aside = np.linalg.norm(centres - ray.origin - along[:, None] * ray.direction, axis=1)
    missed = aside - 0.03 - np.minimum(SLACK_NEAR, SLACK * along)
    index = int(np.argmin(np.where(along > 0.0, missed, _NO_HIT)))
    if along[index] <= 0.0 or missed[index] > 0.0:
        return None
    return Hit("candidate", "", centres[index], float(along[index]), index)


def _ball(ray: Ray, centre: Array, radius: float) -> float:
    along = float((centre - ray.origin) @ ray.direction)
    aside = float(np.linalg.norm(centre - ray.at(along)))
    slack = min(SLACK_NEAR, SLACK * along)
    return along - radius if along > 0.0 and aside <= radius + slack else _NO_HIT


def _plane(ray: Ray, height: float) -> float:
    if ray.direction[2] > -1e-6:
        return _NO_HIT
    return max(0.0, float((height - ray.origin[2]) / ray.direction[2]))


def _plate(ray: Ray, shape: shapely.Polygon, height: float) -> float:
    distance = _plane(ray, height)
    if distance == _NO_HIT or ray.origin[2] <= height:
        return _NO_HIT
    return distance if shapely.contains_xy(shape, *ray.at(distance)[:2]) else _NO_HIT


def _prism(ray: Ray, shape: shapely.Polygon, low: float, high: float) -> float:
    """Distance [m] to an upright prism, infinite when it is missed."""
    best = _plate(ray, shape, high)
    corners = shapely.get_coordinates(shape.exterior)
    start, edge = corners[:-1], np.diff(corners, axis=0)
    offset, flat = start - ray.origin[:2], ray.direction[:2]
    cross = flat[0] * edge[:, 1] - flat[1] * edge[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        along = (offset[:, 0] * edge[:, 1] - offset[:, 1] * edge[:, 0]) / cross
        part = (offset[:, 0] * flat[1] - offset[:, 1] * flat[0]) / cross
    height = ray.origin[2] + along * ray.direction[2]
    met = (np.abs(cross) > 1e-12) & (along > 0.0) & (part >= 0.0) & (part <= 1.0) & (height >= low) & (height <= high)
    return min(best, float(along[met].min())) if met.any() else best


def body_outline(body: BodyMessage) -> shapely.Polygon:
    """What a body covers of the floor [m]."""
    x, y = body.position[:2]
    if body.kind == "box":
        return rectangle((x, y, body.yaw), (body.size[0], body.size[1]))
    return shapely.Point(x, y).buffer(body.size[0] / 2, quad_segs=6)
