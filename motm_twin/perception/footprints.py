"""Outlines of solids on the floor, and exact distances to them."""

import math

import msgspec
import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from motm_twin.model.exact import dot
from motm_twin.model.geometry import Array, from_frame
from motm_twin.model.scene import Box, Cylinder, Prism, Solid

_FLUSH = 1e-6  # [m] by which an edge may stand out and still count as flush
CIRCLE_CORNERS = 16  # of the polygon round a cylinder


def outline(shape: Box | Cylinder | Prism) -> Array:
    """Corners of a shape, counter-clockwise [m], shape (n, 2); a cylinder becomes a circumscribed 16-gon."""
    match shape:
        case Box(centre=(x, y), size=(length, width), yaw=yaw):
            corners = np.array([[-length, -width], [length, -width], [length, width], [-length, width]]) / 2.0
            return from_frame(np.array([x, y, yaw]), corners)
        case Cylinder(centre=(x, y), radius=radius):
            angles = (np.arange(CIRCLE_CORNERS) + 0.5) * 2.0 * math.pi / CIRCLE_CORNERS
            reach = radius / math.cos(math.pi / CIRCLE_CORNERS)
            return np.column_stack([x + reach * np.cos(angles), y + reach * np.sin(angles)])
        case Prism(corners=corners):
            return _counter_clockwise(shapely.Polygon(corners).exterior)


def merged_outlines(solids: tuple[Solid, ...]) -> tuple[Array, ...]:
    """One outline per connected furniture group, counter-clockwise, each shape (n, 2).

    A group that encloses free floor (walls of a room) is left as its separate solids: an outline has no holes.
    """
    groups: dict[str, list[Array]] = {}
    for solid in solids:
        groups.setdefault(_group(solid), []).append(outline(solid.shape))
    outlines: list[Array] = []
    for members in groups.values():
        union = shapely.union_all([shapely.Polygon(corners) for corners in members])
        parts = [part for part in shapely.get_parts(union) if part.area > 0.0]
        if any(len(part.interiors) for part in parts):
            outlines.extend(members)
        else:
            outlines.extend(_corners(part) for part in parts)
    return tuple(outlines)


def uncovered(solids: tuple[Solid, ...], furniture: tuple[Solid, ...]) -> tuple[Solid, ...]:
    """Solids not wholly over furniture, each in the group of the furniture that it overlaps most, if any."""
    outlines = [shapely.Polygon(outline(piece.shape)) for piece in furniture]
    whole = shapely.union_all(outlines).buffer(_FLUSH)
    found = []
    for solid in solids:
        own = shapely.Polygon(outline(solid.shape))
        if whole.covers(own):
            continue
        shared = [own.intersection(other).area for other in outlines]
        if max(shared, default=0.0) > 0.0:
            found.append(msgspec.structs.replace(solid, group=_group(furniture[shared.index(max(shared))])))
        else:
            found.append(solid)
    return tuple(found)


def _group(solid: Solid) -> str:
    """Key of the furniture group of a solid; a solid without a group is its own."""
    return solid.group or f"#{solid.name}"


def _corners(part: shapely.Polygon) -> Array:
    """Corners of a polygon, counter-clockwise, without those that lie on a straight edge."""
    return _counter_clockwise(part.exterior.simplify(1e-6))


def _counter_clockwise(ring: BaseGeometry) -> Array:
    """Corners of a ring, counter-clockwise, the first not repeated; shape (n, 2)."""
    corners = shapely.get_coordinates(ring)[:-1]
    return corners if shapely.is_ccw(ring) else np.ascontiguousarray(corners[::-1])


def distance_to_shape(shape: Box | Cylinder | Prism, points: Array) -> Array:
    """Exact distance [m] of points, shape (..., 2), to a shape; 0 inside. Shape (...)."""
    return np.maximum(signed_distance(shape, points), 0.0)


def signed_distance(shape: Box | Cylinder | Prism, points: Array) -> Array:
    """Exact distance [m] of points, shape (..., 2), to the edge of a shape; negative inside. Shape (...)."""
    if isinstance(shape, Cylinder):
        return np.hypot(points[..., 0] - shape.centre[0], points[..., 1] - shape.centre[1]) - shape.radius
    corners = outline(shape)
    best = np.full(points.shape[:-1], np.inf)
    inside = np.zeros(points.shape[:-1], dtype=bool)
    for start, end in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        edge, offset = end - start, points - start
        along = np.clip((offset * edge).sum(axis=-1) / dot(edge, edge), 0.0, 1.0)
        best = np.minimum(best, np.hypot(offset[..., 0] - along * edge[0], offset[..., 1] - along * edge[1]))
        if start[1] != end[1]:
            spans = (start[1] > points[..., 1]) != (end[1] > points[..., 1])
            crossing = start[0] + (points[..., 1] - start[1]) * edge[0] / edge[1]
            inside ^= spans & (points[..., 0] < crossing)
    return np.where(inside, -best, best)


def distance_to_solids(solids: tuple[Solid, ...], points: Array) -> Array:
    """Distance [m] of points, shape (..., 2), to the nearest footprint, negative inside; inf for none. Shape (...)."""
    best = np.full(points.shape[:-1], np.inf)
    for solid in solids:
        best = np.minimum(best, signed_distance(solid.shape, points))
    return best
