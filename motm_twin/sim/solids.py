"""The solid world: every solid is a vertical prism over a convex polygon or a disc; and the layout of furniture.

Three kinds of bodies stand on the floor and do not drive. *Obstacles* were added by a person. *Loose* bodies are single
boxes and cylinders of the scene that are in no map; once moved they are obstacles too. Everything else on the floor
is *furniture*, moved as whole pieces with their bins.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import compress

import msgspec
import numpy as np
from numpy.typing import NDArray

from motm_twin.model.edits import AddObstacle
from motm_twin.model.geometry import Array, from_frame, rectangle
from motm_twin.model.plant import BodyTruth
from motm_twin.model.scene import Bin, Box, Cylinder, PlanarPose, Prism, Scene, Solid
from motm_twin.model.scene_shapes import Piece, moved_bin, moved_solid, outline, pieces, rigid


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
    bins: tuple[Bin, ...] = ()  # bins whose plates are among the polygons
    bin_names: frozenset[str] = frozenset()

    @property
    def plan(self) -> tuple[Array, NDArray[np.int64], Array]:
        """Corners, index of the first corner of each polygon, and discs, for kernels that ignore heights."""
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


Part = tuple[str, Array, float, float, bool]


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
    """Furniture and bins as polygons and discs, each with name, heights [m] and a flag for those in the map."""

    polygons: list[Part]
    discs: list[Part]
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


def _pack(polygons: list[Part], discs: list[Part], bins: tuple[Bin, ...] = ()) -> Solids:
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


STILL = 1e-4  # [m] of jitter within which a hand-held body counts as still
STILL_TURN = 1e-3  # [rad]


class Layout(msgspec.Struct, frozen=True, kw_only=True):
    """Changes by persons to furniture and loose bodies; empty at the start."""

    obstacles: tuple[AddObstacle, ...] = ()  # boxes and cylinders: added, or loose ones that were moved
    taken: tuple[str, ...] = ()  # loose solids of the scene that have become obstacles
    moved: tuple[tuple[str, PlanarPose], ...] = ()  # pieces of furniture: x, y of the reference, turn
    removed: tuple[str, ...] = ()  # pieces, loose solids and agents of the scene that are gone
    announced: tuple[tuple[str, PlanarPose], ...] = ()  # announced places of furniture

    def obstacle(self, name: str) -> AddObstacle | None:
        """The obstacle of this name, if there is one."""
        return next((item for item in self.obstacles if item.name == name), None)

    def with_obstacle(self, item: AddObstacle) -> "Layout":
        """The layout with an obstacle added, or replacing the one of the same name."""
        if self.obstacle(item.name) is None:
            return msgspec.structs.replace(self, obstacles=(*self.obstacles, item))
        others = tuple(item if old.name == item.name else old for old in self.obstacles)
        return msgspec.structs.replace(self, obstacles=others)


class Furnishings:
    """The furniture of one scene in pieces, and its state under a `Layout`."""

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        solids, found = {solid.name: solid for solid in scene.solids}, pieces(scene)
        self.loose = {name: solids[name] for name, piece in found.items() if _is_loose(piece, solids)}
        self.pieces = {name: piece for name, piece in found.items() if name not in self.loose}
        self._fixed: tuple[tuple[object, ...], Parts] | None = None

    def pose(self, layout: Layout, name: str) -> PlanarPose:
        """Present reference point and turn of a piece."""
        return dict(layout.moved).get(name, (*self.pieces[name].centre, 0.0))

    def present(self, layout: Layout) -> list[str]:
        """Loose solids that have not been moved or removed, and pieces that have not been removed."""
        return [name for name in (*self.loose, *self.pieces) if name not in (*layout.taken, *layout.removed)]

    def moved(self, layout: Layout, name: str, pose: PlanarPose) -> Layout:
        """The layout with a piece at another pose."""
        return msgspec.structs.replace(layout, moved=tuple({**dict(layout.moved), name: pose}.items()))

    def fixed(self, layout: Layout) -> Parts:
        """Furniture, untaken loose solids and bins at their present places; cached while only obstacles change."""
        key = (layout.taken, layout.moved, layout.removed, layout.announced)
        if self._fixed is None or self._fixed[0] != key:
            self._fixed = (key, fixed_parts(*self._present(layout)))
        return self._fixed[1]

    def _present(self, layout: Layout) -> tuple[list[Solid], tuple[Bin, ...]]:
        gone = {*layout.taken, *(part for name in layout.removed for part in self.parts(name))}
        transforms, unmapped, announced = {}, set[str](), dict(layout.announced)
        for name, pose in layout.moved:
            piece = self.pieces[name]
            transforms |= dict.fromkeys((*piece.solids, *piece.bins), rigid(piece, pose))
            if announced.get(name, (*piece.centre, 0.0)) != pose:  # it is not where the map has it
                unmapped.update(piece.solids)
        solids = [
            moved_solid(transforms[solid.name], solid) if solid.name in transforms else solid
            for solid in self.scene.solids
            if solid.name not in gone
        ]
        solids = [msgspec.structs.replace(solid, mapped=False) if solid.name in unmapped else solid for solid in solids]
        bins = [moved_bin(transforms[box.name], box) if box.name in transforms else box for box in self.scene.bins]
        return solids, tuple(bins)

    def parts(self, name: str) -> tuple[str, ...]:
        """Names of the solids and bins of a body of any kind, as among the solids of the world."""
        piece = self.pieces.get(name)
        return (name,) if piece is None else (*piece.solids, *piece.bins)

    def truth(self, layout: Layout) -> tuple[BodyTruth, ...]:
        """Pieces that were moved and not removed: reference point, turn, and extents from the scene."""
        return tuple(
            BodyTruth(name=name, kind="furniture", position=(x, y, 0.0), yaw=turn, size=self._size(self.pieces[name]))
            for name, (x, y, turn) in layout.moved
            if name not in layout.removed
        )

    def _size(self, piece: Piece) -> tuple[float, float, float]:
        parts = [solid for solid in self.scene.solids if solid.name in piece.solids]
        reach = [outline(part.shape).bounds for part in parts]
        half_x = max(max(piece.centre[0] - low, high - piece.centre[0]) for low, _, high, _ in reach)
        half_y = max(max(piece.centre[1] - low, high - piece.centre[1]) for _, low, _, high in reach)
        return 2.0 * half_x, 2.0 * half_y, max(part.z_max for part in parts)


def _is_loose(piece: Piece, solids: dict[str, Solid]) -> bool:
    if piece.mapped or piece.bins or piece.solids != (piece.name,):
        return False
    return isinstance(solids[piece.name].shape, Box | Cylinder)


def as_obstacle(solid: Solid) -> AddObstacle:
    """A loose solid of the scene as an obstacle of the same name."""
    match solid.shape:
        case Box(centre=(x, y), size=size, yaw=yaw):
            return AddObstacle(name=solid.name, shape="box", x=x, y=y, heading=yaw, size=(*size, solid.z_max))
        case Cylinder(centre=(x, y), radius=radius):
            size = (2.0 * radius, 2.0 * radius, solid.z_max)
            return AddObstacle(name=solid.name, shape="cylinder", x=x, y=y, size=size)
    raise ValueError(f"{solid.name!r} is a prism: only boxes and cylinders are loose")


def same_pose(a: PlanarPose, b: PlanarPose) -> bool:
    """True when the poses are equal up to the jitter of a hand that holds the body still."""
    turn = math.remainder(a[2] - b[2], 2.0 * math.pi)
    return math.hypot(a[0] - b[0], a[1] - b[1]) < STILL and abs(turn) < STILL_TURN


@dataclass(frozen=True, kw_only=True)
class Scenery:
    """Everything that does not move by itself."""

    layout: Layout
    solids: Solids
    in_the_way: Solids  # solids that the tallest agent cannot pass under
    tallest: float  # [m]
    lidar_segments: Array  # at the lidar's height, shape (s, 4)
    lidar_discs: Array  # shape (d, 3)


def build_scenery(furnishings: Furnishings, layout: Layout, tallest: float) -> Scenery:
    """Arrays of the world for a layout, with agents up to ``tallest`` [m]."""
    solids = with_obstacles(furnishings.fixed(layout), layout.obstacles)
    lidar_z = furnishings.scene.robot.lidar.z
    return Scenery(
        layout=layout,
        solids=solids,
        in_the_way=solids.below(tallest),
        tallest=tallest,
        lidar_segments=solids.segments_at(lidar_z),
        lidar_discs=solids.discs_at(lidar_z),
    )
