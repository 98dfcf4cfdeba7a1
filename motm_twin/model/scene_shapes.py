"""Planar outlines of a scene's bodies as shapely polygons, world frame, [m]. For checks and lanes, not for control."""

import math
from collections.abc import Iterable

import numpy as np
from shapely.geometry import Point as ShapelyPoint
from shapely.geometry import Polygon
from shapely.geometry.base import BaseGeometry

from motm_twin.model import geometry
from motm_twin.model.profile import Footprint
from motm_twin.model.scene import Bin, Box, Cylinder, PlanarPose, Point, Prism, Solid

_MIN_AREA = 1e-6  # [m^2]
_MIN_STEP = 1e-6  # [m] between two points of a lane


def rectangle(pose: PlanarPose, size: Point, offset_x: float = 0.0) -> Polygon:
    """A rectangle of a size, centred at ``(offset_x, 0)`` of a pose."""
    return Polygon(geometry.rectangle(pose, size, offset_x))


def outline(shape: Box | Cylinder | Prism) -> Polygon:
    """The outline of a piece of furniture; a disc becomes a 64-gon."""
    if isinstance(shape, Box):
        return rectangle((*shape.centre, shape.yaw), shape.size)
    if isinstance(shape, Cylinder):
        return ShapelyPoint(shape.centre).buffer(shape.radius, quad_segs=16)
    return Polygon(shape.corners)


def covers(shape: Box | Cylinder | Prism, point: Point) -> bool:
    """A point is over a piece of furniture."""
    return bool(outline(shape).covers(ShapelyPoint(point)))


def bin_solid(place: Bin) -> Solid:
    """A bin as base and arm must see it: full up to its rim."""
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
