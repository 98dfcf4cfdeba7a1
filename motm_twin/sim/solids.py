"""The solid world as arrays: every solid is a vertical prism over a convex polygon or over a disc."""

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import compress

import numpy as np
from numpy.typing import NDArray

from motm_twin.model.edits import AddObstacle
from motm_twin.model.geometry import Array, from_frame, rectangle
from motm_twin.model.scene import Bin, Box, Cylinder, Prism, Solid


@dataclass(frozen=True, kw_only=True)
class Solids:
    """Convex polygons and discs with their height ranges; polygon i has corners ``first[i]:first[i + 1]``."""

    corners: Array  # [m], shape (m, 2)
    first: NDArray[np.int64]  # shape (p + 1,)
    z: Array  # lower and upper height of the polygons [m], shape (p, 2)
    names: tuple[str, ...]
    mapped: NDArray[np.bool_]  # shape (p,)
    discs: Array  # x, y, radius [m], shape (d, 3)
    disc_z: Array  # shape (d, 2)
    disc_names: tuple[str, ...]
    disc_mapped: NDArray[np.bool_]  # shape (d,)
    bins: tuple[Bin, ...] = ()  # whose plates are among the polygons
    bin_names: frozenset[str] = frozenset()

    @property
    def plan(self) -> tuple[Array, NDArray[np.int64], Array]:
        """Corners, the first of each polygon, and discs: all solids as tall ones, for kernels."""
        return self.corners, self.first, self.discs

    def polygon(self, i: int) -> Array:
        """Corners of polygon i, shape (k, 2)."""
        return self.corners[self.first[i] : self.first[i + 1]]

    def segments_at(self, z: float) -> Array:
        """Edges of all polygons that exist at height z [m]: x, y, x, y, shape (s, 4)."""
        following = np.arange(len(self.corners)) + 1
        following[self.first[1:] - 1] = self.first[:-1]
        edges = np.hstack([self.corners, self.corners[following]])
        return edges[np.repeat((self.z[:, 0] <= z) & (z <= self.z[:, 1]), np.diff(self.first))]

    def discs_at(self, z: float) -> Array:
        """Discs that exist at height z [m], shape (d, 3)."""
        return self.discs[(self.disc_z[:, 0] <= z) & (z <= self.disc_z[:, 1])]

    def below(self, height: float) -> "Solids":
        """Solids that reach into the lowest ``height`` [m] above the floor."""
        low, low_discs = self.z[:, 0] < height, self.disc_z[:, 0] < height
        counts = np.diff(self.first)
        return Solids(
            corners=self.corners[np.repeat(low, counts)],
            first=np.concatenate([[0], np.cumsum(counts[low])]).astype(np.int64),
            z=self.z[low],
            names=tuple(compress(self.names, low)),
            mapped=self.mapped[low],
            discs=self.discs[low_discs],
            disc_z=self.disc_z[low_discs],
            disc_names=tuple(compress(self.disc_names, low_discs)),
            disc_mapped=self.disc_mapped[low_discs],
        )


Piece = tuple[str, Array, float, float, bool]


def bin_plates(box: Bin) -> list[tuple[Array, float, float]]:
    """The floor and the four walls of a bin: corners, lower and upper height."""
    frame = np.array([*box.centre, box.yaw])
    bottom = box.floor_z - box.wall
    plates = [(rectangle(frame, (box.side, box.side)), bottom, box.floor_z)]
    middle = 0.5 * (box.side - box.wall)
    for c, s in ((1, 0), (0, 1), (-1, 0), (0, -1)):
        centre = from_frame(frame, np.array([c * middle, s * middle]))
        size = (box.wall, box.side) if s == 0 else (box.side, box.wall)
        plates.append((rectangle((*centre, box.yaw), size), bottom, box.rim_z))
    return plates


def obstacle_disc(obstacle: AddObstacle) -> tuple[float, float] | None:
    """Radius and height [m] of a round obstacle; None when it is a box."""
    if obstacle.shape == "cylinder":
        return 0.5 * obstacle.size[0], obstacle.size[2]
    return None


@dataclass(frozen=True, kw_only=True)
class Parts:
    """Furniture and bins as polygons and discs, each with name, heights [m] and whether the map knows it."""

    polygons: list[Piece]
    discs: list[Piece]
    bins: tuple[Bin, ...]


def fixed_parts(solids: Iterable[Solid], bins: Iterable[Bin]) -> Parts:
    """Furniture, then bins."""
    parts = Parts(polygons=[], discs=[], bins=tuple(bins))
    polygons, discs = parts.polygons, parts.discs
    for solid in solids:
        tail = (solid.z_min, solid.z_max, solid.mapped)
        match solid.shape:
            case Box(centre=centre, size=size, yaw=yaw):
                polygons.append((solid.name, rectangle((*centre, yaw), size), *tail))
            case Cylinder(centre=centre, radius=radius):
                discs.append((solid.name, np.array([*centre, radius]), *tail))
            case Prism(corners=corners):
                polygons += [(solid.name, part, *tail) for part in convex_parts(np.array(corners, dtype=float))]
    for box in parts.bins:
        polygons += [(box.name, corners, low, high, True) for corners, low, high in bin_plates(box)]
    return parts


def with_obstacles(parts: Parts, obstacles: Iterable[AddObstacle]) -> Solids:
    """Furniture, bins and added obstacles as arrays, in this order."""
    polygons, discs = [*parts.polygons], [*parts.discs]
    for item in obstacles:
        round_one = obstacle_disc(item)
        if round_one is None:
            corners = rectangle((item.x, item.y, item.heading), item.size)
            polygons.append((item.name, corners, 0.0, item.size[2], False))
        else:
            discs.append((item.name, np.array([item.x, item.y, round_one[0]]), 0.0, round_one[1], False))
    return _pack(polygons, discs, parts.bins)


def _pack(polygons: list[Piece], discs: list[Piece], bins: tuple[Bin, ...] = ()) -> Solids:
    counts = [len(piece[1]) for piece in polygons]
    return Solids(
        corners=np.vstack([piece[1] for piece in polygons]) if polygons else np.zeros((0, 2)),
        first=np.concatenate([[0], np.cumsum(counts)]).astype(np.int64),
        z=np.array([piece[2:4] for piece in polygons], dtype=float).reshape(-1, 2),
        names=tuple(piece[0] for piece in polygons),
        mapped=np.array([piece[4] for piece in polygons], dtype=bool),
        discs=np.array([piece[1] for piece in discs], dtype=float).reshape(-1, 3),
        disc_z=np.array([piece[2:4] for piece in discs], dtype=float).reshape(-1, 2),
        disc_names=tuple(piece[0] for piece in discs),
        disc_mapped=np.array([piece[4] for piece in discs], dtype=bool),
        bins=bins,
        bin_names=frozenset(box.name for box in bins),
    )


NOTHING = _pack([], [])


def _cross(a: Array, b: Array, c: Array) -> float:
    return float((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]))


def convex_parts(corners: Array) -> list[Array]:
    """A simple counter-clockwise polygon as convex pieces: itself, or triangles cut off ear by ear."""
    n = len(corners)
    if all(_cross(corners[i - 1], corners[i], corners[(i + 1) % n]) >= 0.0 for i in range(n)):
        return [corners]
    rest = list(range(n))
    parts = []
    while len(rest) > 3:
        ear = next((k for k in range(len(rest)) if _is_ear(corners, rest, k)), None)
        if ear is None:
            raise ValueError("prism corners cross themselves or are not counter-clockwise: give a simple polygon")
        parts.append(corners[[rest[ear - 1], rest[ear], rest[(ear + 1) % len(rest)]]])
        del rest[ear]
    return [*parts, corners[rest]]


def _is_ear(corners: Array, rest: list[int], k: int) -> bool:
    a, b, c = corners[rest[k - 1]], corners[rest[k]], corners[rest[(k + 1) % len(rest)]]
    if _cross(a, b, c) <= 0.0:
        return False
    own = {rest[k - 1], rest[k], rest[(k + 1) % len(rest)]}
    return not any(
        _cross(a, b, p) >= 0.0 and _cross(b, c, p) >= 0.0 and _cross(c, a, p) >= 0.0
        for p in (corners[i] for i in rest if i not in own)
    )
