"""Pieces of furniture of generated scenes, with places for cubes or a bin, and their number by difficulty.

A piece is drawn about its own origin, its front towards -y, and then put at a pose. Later checks use the rounded
numbers of the file.
"""

import dataclasses
import math
from collections.abc import Callable
from typing import Any

import numpy as np
from shapely.geometry import Point, Polygon
from shapely.geometry.base import BaseGeometry
from shapely.ops import unary_union

from motm_twin.model.scene_shapes import rectangle

AGENTS_FROM = 0.6  # difficulty from which there are agents
DOORS_FROM = 0.3  # difficulty from which half of the rooms are divided by a wall with a doorway


@dataclasses.dataclass(frozen=True, kw_only=True)
class Dial:
    """Numbers of a difficulty from 0 to 1. Every count grows, and every width shrinks, with the difficulty."""

    difficulty: float
    surfaces: int  # pieces of furniture with cubes on them
    bins: int  # each on a piece of its own
    cubes: int
    drives: int  # tasks to drive somewhere
    clutter: int  # pieces of furniture without tasks
    boxes: int  # further ones, outside the map: only the lidar sees them
    agents: int  # they drive about and yield
    gap: float  # [m] least width between any two pieces
    doorway: float  # [m] width of a doorway, if there is one
    doors: bool  # a wall with a doorway may part the room
    spread: float  # [m] by which heights differ from 0.75 m, either way


def dial(difficulty: float) -> Dial:
    """The numbers for a difficulty from 0 to 1."""
    d = difficulty
    return Dial(
        difficulty=d,
        surfaces=1 + round(2.0 * d),
        bins=1 + round(1.5 * d),
        cubes=2 + round(4.0 * d),
        drives=round(1.6 * d),
        clutter=round(5.0 * d),
        boxes=round(3.0 * d),
        agents=0 if d < AGENTS_FROM else 1 + round(2.0 * (d - AGENTS_FROM) / (1.0 - AGENTS_FROM)),
        gap=1.6 - 0.7 * d,
        doorway=1.4 - 0.5 * d,
        doors=d >= DOORS_FROM,
        spread=0.03 + 0.08 * d,
    )


Rng = np.random.Generator
Pose = tuple[float, float, float]  # x, y [m], yaw [deg]
Entry = dict[str, Any]
HEIGHT = 0.75  # [m] of a table, about which heights vary
INSET = (0.11, 0.26)  # [m] of a cube from the edge that it is taken from: the arm does not reach over a whole table
SPACING = 0.25  # [m] between cubes: room for the open fingers


@dataclasses.dataclass(frozen=True)
class Draft:
    """A piece about its own origin."""

    length: float  # [m] along x
    width: float  # [m] along y
    parts: dict[str, Entry]  # entries of the furniture; positions are of this frame
    spots: tuple[tuple[float, float], ...] = ()  # [m] places for cubes
    bins: tuple[tuple[float, float], ...] = ()  # [m] places for a bin


@dataclasses.dataclass(frozen=True)
class Piece:
    """A piece at its pose, as written to the file."""

    name: str
    furniture: dict[str, Entry]
    area: BaseGeometry  # its outline on the floor
    spots: tuple[tuple[float, float], ...]
    bins: tuple[tuple[float, float], ...]
    top: float  # [m] height of the surface for cubes or a bin
    yaw: float  # [deg]


Maker = Callable[[Rng, Dial, bool], Draft]  # last argument: its back is to a wall


def put(draft: Draft, name: str, pose: Pose) -> Piece:
    """The piece at a pose, with all numbers rounded as in the file."""
    furniture = {
        name if len(draft.parts) == 1 else f"{name}_{key}": _moved(part, pose) for key, part in draft.parts.items()
    }
    if len(furniture) > 1:
        furniture = {key: {**part, "group": name, "style": part["style"]} for key, part in furniture.items()}
    spots, bins = (tuple(_point(place, pose) for place in places) for places in (draft.spots, draft.bins))
    top = max(part["z"][1] for part in furniture.values())
    area = unary_union([area_of(part) for part in furniture.values()])
    return Piece(name, furniture, area, spots, bins, top, pose[2])


def area_of(part: Entry) -> BaseGeometry:
    """The outline of one entry of the furniture."""
    if part["shape"] == "cylinder":
        return Point(part["centre"]).buffer(part["radius"], quad_segs=16)
    if part["shape"] == "polygon":
        return Polygon(part["corners"])
    yaw = math.radians(part.get("yaw_deg", 0.0))
    return rectangle((*part["centre"], yaw), tuple(part["size"]))


def table(rng: Rng, dial: Dial, backed: bool) -> Draft:
    """A slab on two posts, or on four legs."""
    length, width, height = _size(rng, 1.2, 2.2), _size(rng, 0.6, 0.8), _height(rng, dial)
    parts = {"top": _box(length, width, [height - 0.03, height], "table")}
    inset = 0.1 * length
    places = [(-0.5 * length + inset, 0.0), (0.5 * length - inset, 0.0)]
    if rng.random() < 0.5:
        places = [(x, y) for x, _ in places for y in (-0.5 * width + 0.06, 0.5 * width - 0.06)]
    radius = 0.1 / len(places)
    for index, (x, y) in enumerate(places):
        parts[f"leg_{index + 1}"] = _cylinder(radius, [0.0, height - 0.03], "table", (x, y))
    return Draft(length, width, parts, spots=_spots(rng, length, width, backed))


def shelf(rng: Rng, dial: Dial, backed: bool) -> Draft:
    """A solid shelf, cubes on its top."""
    length, width, height = _size(rng, 1.0, 2.4), _size(rng, 0.36, 0.5), _height(rng, dial)
    return _boxed(length, width, height, "shelf", spots=_spots(rng, length, width, backed))


def desk(rng: Rng, dial: Dial, backed: bool) -> Draft:
    """A desk with a bin at its front edge."""
    length, width, height = _size(rng, 0.6, 1.4), _size(rng, 0.5, 0.7), _bin_support_height(rng, dial)
    x = round(float(rng.uniform(-1.0, 1.0)) * (0.5 * length - 0.25), 2)
    return _boxed(length, width, height, "desk", bins=((x, 0.22 - 0.5 * width),))


def stand(rng: Rng, dial: Dial, backed: bool) -> Draft:
    """A round stand, a bin in its middle."""
    radius, height = _size(rng, 0.2, 0.26), _bin_support_height(rng, dial)
    body = _cylinder(radius, [0.0, height], "desk", (0.0, 0.0))
    return Draft(2.0 * radius, 2.0 * radius, {"body": body}, bins=((0.0, 0.0),))


def cabinet(rng: Rng, dial: Dial, backed: bool) -> Draft:
    """A large piece without tasks."""
    length, width, height = _size(rng, 0.6, 1.6), _size(rng, 0.3, 0.5), _size(rng, 0.5, 1.3)
    return _boxed(length, width, height, "cabinet")


def column(rng: Rng, dial: Dial, backed: bool) -> Draft:
    """A round column up to the ceiling."""
    radius = _size(rng, 0.12, 0.25)
    return Draft(2.0 * radius, 2.0 * radius, {"body": _cylinder(radius, [0.0, 2.2], "wall", (0.0, 0.0))})


def corner(rng: Rng, dial: Dial, backed: bool) -> Draft:
    """An L-shaped counter: a dead end."""
    length, width, deep = _size(rng, 1.2, 1.8), _size(rng, 1.2, 1.6), _size(rng, 0.3, 0.45)
    a, b = 0.5 * length, 0.5 * width
    corners = [[-a, b], [-a, -b], [deep - a, -b], [deep - a, b - deep], [a, b - deep], [a, b]]
    part = {"shape": "polygon", "corners": corners, "z": [0.0, _size(rng, 0.5, 1.1)], "style": "cabinet"}
    return Draft(length, width, {"body": part})


def box(rng: Rng, dial: Dial, backed: bool) -> Draft:
    """A box outside the map; the lidar, 0.2 m above the floor, sees it."""
    length, width, height = _size(rng, 0.3, 0.55), _size(rng, 0.3, 0.5), _size(rng, 0.3, 0.6)
    return _boxed(length, width, height, "box", {"mapped": False})


def _size(rng: Rng, low: float, high: float) -> float:
    return round(float(rng.uniform(low, high)), 2)


def _height(rng: Rng, dial: Dial) -> float:
    return _size(rng, HEIGHT - dial.spread, HEIGHT + dial.spread)


def _bin_support_height(rng: Rng, dial: Dial) -> float:
    """Height [m] of the surface below a bin: the rim is then about as high as a table."""
    return round(_height(rng, dial) - 0.15, 2)


def _spots(rng: Rng, length: float, width: float, backed: bool) -> tuple[tuple[float, float], ...]:
    """Places for cubes at the front edge, and at the back edge of a free-standing piece, all well apart."""
    found: list[tuple[float, float]] = []
    for side in (-1.0,) if backed else (-1.0, 1.0):
        steps = max(1, int((length - 0.2) / SPACING))
        for along in (np.arange(steps) - 0.5 * (steps - 1)) * SPACING:
            inset = min(_size(rng, *INSET), 0.5 * width)
            found.append((round(float(along), 3), side * (0.5 * width - inset)))
    return tuple(place for i, place in enumerate(found) if all(math.dist(place, o) >= 0.2 for o in found[:i]))


def _box(length: float, width: float, z: list[float], style: str) -> Entry:
    return {"shape": "box", "centre": [0.0, 0.0], "size": [length, width], "z": _rounded(z), "style": style}


def _boxed(length: float, width: float, height: float, style: str, more: Entry | None = None, **places: Any) -> Draft:
    """A piece that is one box; ``places``: spots or bins on it."""
    return Draft(length, width, {"body": _box(length, width, [0.0, height], style) | (more or {})}, **places)


def _cylinder(radius: float, z: list[float], style: str, at: tuple[float, float]) -> Entry:
    return {"shape": "cylinder", "centre": list(at), "radius": round(radius, 3), "z": _rounded(z), "style": style}


def _moved(part: Entry, pose: Pose) -> Entry:
    moved = dict(part)
    if "corners" in part:
        moved["corners"] = [list(_point((x, y), pose)) for x, y in part["corners"]]
    else:
        moved["centre"] = list(_point(tuple(part["centre"]), pose))
    if part["shape"] == "box" and pose[2] != 0.0:
        moved["yaw_deg"] = pose[2]
    return moved


def _point(place: tuple[float, float], pose: Pose) -> tuple[float, float]:
    x, y, yaw = pose
    c, s = math.cos(math.radians(yaw)), math.sin(math.radians(yaw))
    return round(x + c * place[0] - s * place[1], 3), round(y + s * place[0] + c * place[1], 3)


def _rounded(values: list[float]) -> list[float]:
    return [round(value, 3) for value in values]
