"""Shapes of a scene's bodies, world frame [m]: outlines as shapely polygons, and furniture as pieces that can be moved.

A piece is a ``group`` of solids (a table: slab and posts), or a solid without a group. Bins belong to the piece that
they stand on. A piece is moved rigidly: its reference is the centre of its bounding box in the scene file. Outlines are
for checks and lanes, not for control.
"""

import math
from collections.abc import Iterable, Mapping

import msgspec
import numpy as np
from shapely.geometry import Point as ShapelyPoint
from shapely.geometry import Polygon
from shapely.geometry.base import BaseGeometry

from motm_twin.model import geometry
from motm_twin.model.geometry import Array, from_frame, frozen, to_frame, wrap_angle
from motm_twin.model.profile import Footprint
from motm_twin.model.scene import Bin, Box, Cylinder, PlanarPose, Point, Prism, Scene, SceneObject, Solid

_MIN_AREA = 1e-6  # [m^2]
_MIN_STEP = 1e-6  # [m] between two points of a lane


def rectangle(pose: PlanarPose, size: Point, offset_x: float = 0.0) -> Polygon:
    """A rectangle of this size, centred at ``(offset_x, 0)`` in the frame of a pose."""
    return Polygon(geometry.rectangle(pose, size, offset_x))


def outline(shape: Box | Cylinder | Prism) -> Polygon:
    """The outline of a piece of furniture; a disc becomes a 64-gon."""
    if isinstance(shape, Box):
        return rectangle((*shape.centre, shape.yaw), shape.size)
    if isinstance(shape, Cylinder):
        return ShapelyPoint(shape.centre).buffer(shape.radius, quad_segs=16)
    return Polygon(shape.corners)


def covers(shape: Box | Cylinder | Prism, point: Point) -> bool:
    """True when a point is over a piece of furniture."""
    return bool(outline(shape).covers(ShapelyPoint(point)))


def surface(name: str, solids: Iterable[Solid]) -> Solid | None:
    """The piece of furniture of this name, for a group its highest; None for an unknown name."""
    named = {solid.name: solid for solid in solids}
    group = [solid for solid in named.values() if solid.group == name]
    return named.get(name) or max(group, key=lambda solid: solid.z_max, default=None)


def bin_solid(place: Bin) -> Solid:
    """A bin as an obstacle for base and arm: a solid up to its rim."""
    return Solid(
        name=place.name,
        shape=Box(centre=place.centre, size=(place.side, place.side), yaw=place.yaw),
        z_min=place.floor_z - place.wall,
        z_max=place.rim_z,
        mapped=True,
    )


def base_outline(pose: PlanarPose, footprint: Footprint) -> Polygon:
    """The outline of the base body at a pose."""
    return rectangle(pose, (footprint.length, footprint.width), footprint.offset_x)


def is_simple(corners: tuple[Point, ...]) -> bool:
    """True for an outline that has an area and does not cross or touch itself."""
    polygon = Polygon(corners)
    return bool(polygon.is_valid and polygon.area > _MIN_AREA)


def counter_clockwise(corners: Iterable[Point]) -> tuple[Point, ...]:
    """The same corners, counter-clockwise."""
    points = list(corners)
    ring = Polygon(points).exterior
    return tuple(points if ring.is_ccw else points[::-1])


def lane(hull: BaseGeometry, distance: float, *, clockwise: bool, start_at: float) -> tuple[Point, ...]:
    """Points of the closed line at a distance [m] round a convex outline, its corners rounded.

    The first point is ``start_at`` (0 to 1) of the length away, in the direction of travel, from where the line
    crosses the positive x axis of the outline's centre.
    """
    ring = np.array(hull.buffer(distance, quad_segs=6).exterior.coords[:-1])
    ring = np.array(counter_clockwise(map(tuple, ring)))
    if clockwise:
        ring = ring[::-1]
    line = Polygon(ring).exterior
    east = line.project(ShapelyPoint(hull.bounds[2] + distance, hull.centroid.y))
    offset = (east + start_at * line.length) % line.length
    along = np.array([line.project(ShapelyPoint(*point)) for point in ring])
    first = line.interpolate(offset)
    ordered = [(first.x, first.y), *(tuple(ring[i]) for i in np.argsort((along - offset) % line.length))]
    points: list[Point] = []
    for x, y in ordered:
        if not points or math.dist((x, y), points[-1]) > _MIN_STEP:
            points.append((round(float(x), 6), round(float(y), 6)))
    if math.dist(points[0], points[-1]) <= _MIN_STEP:
        points.pop()
    return tuple(points)


REST = 0.03  # [m] largest gap between an object's lower face and the top that carries it


class Piece(msgspec.Struct, frozen=True, kw_only=True):
    """One piece of furniture as the scene has it."""

    name: str
    solids: tuple[str, ...]
    bins: tuple[str, ...]
    centre: Point  # of its bounding box [m]
    mapped: bool


def pieces(scene: Scene) -> dict[str, Piece]:
    """All pieces that stand on the floor and can be moved, by name: those without a prism."""
    groups: dict[str, list[Solid]] = {}
    for solid in scene.solids:
        groups.setdefault(solid.group or solid.name, []).append(solid)
    found = {}
    for name, solids in groups.items():
        if any(isinstance(solid.shape, Prism) for solid in solids) or min(s.z_min for s in solids) > 0.0:
            continue
        bounds = np.array([outline(solid.shape).bounds for solid in solids])
        low, high = bounds[:, :2].min(axis=0), bounds[:, 2:].max(axis=0)
        top = max(solid.z_max for solid in solids)
        bins = [
            box.name
            for box in scene.bins
            if abs(box.floor_z - top) <= REST and any(covers(solid.shape, box.centre) for solid in solids)
        ]
        found[name] = Piece(
            name=name,
            solids=tuple(solid.name for solid in solids),
            bins=tuple(bins),
            centre=(float(low[0] + high[0]) / 2, float(low[1] + high[1]) / 2),
            mapped=any(solid.mapped for solid in solids),
        )
    return found


def rigid(piece: Piece, pose: PlanarPose) -> Array:
    """The planar transform (x, y, turn) that moves a piece from its place in the scene to ``pose``."""
    x, y, turn = pose
    c, s = math.cos(turn), math.sin(turn)
    cx, cy = piece.centre
    return np.array([x - c * cx + s * cy, y - s * cx - c * cy, wrap_angle(turn)])


def moved_point(transform: Array, point: Point) -> Point:
    """A point of the plane after a `rigid` transform."""
    moved = from_frame(transform, np.array(point, dtype=float))
    return float(moved[0]), float(moved[1])


def moved_solid(transform: Array, solid: Solid) -> Solid:
    """A solid after a `rigid` transform."""
    shape = solid.shape
    match shape:
        case Box(centre=centre, yaw=yaw):
            shape = msgspec.structs.replace(
                shape, centre=moved_point(transform, centre), yaw=wrap_angle(yaw + float(transform[2]))
            )
        case Cylinder(centre=centre):
            shape = msgspec.structs.replace(shape, centre=moved_point(transform, centre))
        case Prism(corners=corners):
            shape = msgspec.structs.replace(shape, corners=tuple(moved_point(transform, c) for c in corners))
    return msgspec.structs.replace(solid, shape=shape)


def moved_bin(transform: Array, box: Bin) -> Bin:
    """A bin after a `rigid` transform."""
    return msgspec.structs.replace(
        box, centre=moved_point(transform, box.centre), yaw=wrap_angle(box.yaw + float(transform[2]))
    )


def moved_object(transform: Array, item: SceneObject) -> SceneObject:
    """An object that rides on a piece, after its `rigid` transform."""
    x, y = moved_point(transform, item.position[:2])
    return msgspec.structs.replace(
        item, position=(x, y, item.position[2]), yaw=wrap_angle(item.yaw + float(transform[2]))
    )


def stands_on(scene: Scene, piece: Piece, point: Point, bottom: float) -> bool:
    """True when a body over a point, with its lower face at ``bottom`` [m], stands on a piece of the scene."""
    parts = [solid for solid in scene.solids if solid.name in piece.solids]
    return any(abs(bottom - solid.z_max) <= REST and covers(solid.shape, point) for solid in parts)


def moved_scene(scene: Scene, moved: Mapping[str, PlanarPose], removed: tuple[str, ...] = ()) -> Scene:
    """The scene with pieces moved (with their bins, and the objects that start on them) or removed.

    Raises KeyError for a name that is no piece.
    """
    if not moved and not removed:
        return scene
    known = pieces(scene)
    solids = {solid.name: solid for solid in scene.solids}
    bins = {box.name: box for box in scene.bins}
    objects = {item.name: item for item in scene.objects}
    for name, pose in moved.items():
        piece, transform = known[name], rigid(known[name], pose)
        for part in piece.solids:
            solids[part] = moved_solid(transform, solids[part])
        for box in piece.bins:
            bins[box] = moved_bin(transform, bins[box])
        for item in scene.objects:
            if stands_on(scene, piece, item.position[:2], item.position[2] - 0.5 * item.side):
                objects[item.name] = moved_object(transform, item)
    for name in removed:
        for part in known[name].solids:
            del solids[part]
    return msgspec.structs.replace(
        scene, solids=tuple(solids.values()), bins=tuple(bins.values()), objects=tuple(objects.values())
    )


def relative(transform: Array, other: Array) -> Array:
    """The transform that takes a piece from its place after one `rigid` transform to that after ``other``."""
    moved = from_frame(other, to_frame(transform, np.zeros(2)))
    return frozen([*moved, wrap_angle(float(other[2] - transform[2]))])
