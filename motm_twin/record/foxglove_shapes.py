"""The building blocks of Foxglove messages as plain dictionaries: stamps, poses, primitives, entities."""

import math
from collections.abc import Sequence
from typing import Any

Json = dict[str, Any]
Colour = tuple[float, float, float, float]  # red, green, blue, opacity, 0 to 1

_DIGITS = 4  # 0.1 mm
_FOR_EVER: Json = {"sec": 0, "nsec": 0}


def stamp(seconds: float) -> Json:
    """A time; before 1970 there is none."""
    nanoseconds = max(0, round(seconds * 1e9))
    return {"sec": nanoseconds // 1_000_000_000, "nsec": nanoseconds % 1_000_000_000}


def point(x: float, y: float, z: float) -> Json:
    """A point, or the extents of something."""
    return {"x": round(x, _DIGITS), "y": round(y, _DIGITS), "z": round(z, _DIGITS)}


def quaternion(yaw: float) -> Json:
    """A turn about the vertical [rad]."""
    return {"x": 0.0, "y": 0.0, "z": round(math.sin(yaw / 2.0), 6), "w": round(math.cos(yaw / 2.0), 6)}


def pose(x: float, y: float, z: float = 0.0, yaw: float = 0.0) -> Json:
    """A place and a turn about the vertical."""
    return {"position": point(x, y, z), "orientation": quaternion(yaw)}


def colour(values: Colour) -> Json:
    """Red, green, blue and opacity."""
    return dict(zip("rgba", values, strict=True))


def cube(centre: Sequence[float], size: Sequence[float], tint: Colour, yaw: float = 0.0) -> Json:
    """A box."""
    x, y, z = centre
    return {"pose": pose(x, y, z, yaw), "size": point(size[0], size[1], size[2]), "color": colour(tint)}


def cylinder(centre: Sequence[float], size: Sequence[float], tint: Colour, yaw: float = 0.0) -> Json:
    """An upright cylinder of these extents."""
    return {**cube(centre, size, tint, yaw), "bottom_scale": 1.0, "top_scale": 1.0}


def entity(at: Json, frame: str, name: str, **primitives: list[Json]) -> Json:
    """Something that is drawn until it is replaced, and moves with its frame."""
    kinds = ("arrows", "cubes", "spheres", "cylinders", "lines", "triangles", "texts", "models")
    return {
        "timestamp": at,
        "frame_id": frame,
        "id": name,
        "lifetime": _FOR_EVER,
        "frame_locked": True,
        "metadata": [],
        **{kind: primitives.get(kind, []) for kind in kinds},
    }
