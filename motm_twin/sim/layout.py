"""Layout of furniture and loose bodies: the scene's own places, changed by persons; and the arrays made of it.

Three kinds of bodies stand on the floor and do not drive. *Obstacles* were added by a person. *Loose* ones are single
boxes and cylinders of the scene that no map knows; once moved they are obstacles too. Everything else that stands on
the floor is *furniture*, moved as whole pieces with their bins.
"""

import math
from dataclasses import dataclass

import msgspec

from motm_twin.model.edits import AddObstacle
from motm_twin.model.geometry import Array
from motm_twin.model.plant import BodyTruth
from motm_twin.model.scene import Bin, Box, Cylinder, PlanarPose, Scene, Solid
from motm_twin.model.scene_shapes import Piece, moved_bin, moved_solid, outline, pieces, rigid
from motm_twin.sim.solids import Parts, Solids, fixed_parts, with_obstacles

STILL = 1e-4  # [m] of jitter within which a hand-held body counts as still
STILL_TURN = 1e-3  # [rad]


class Layout(msgspec.Struct, frozen=True, kw_only=True):
    """Changes by persons to furniture and loose bodies; empty at the start."""

    obstacles: tuple[AddObstacle, ...] = ()  # boxes and cylinders: added, or loose ones that were moved
    taken: tuple[str, ...] = ()  # loose solids of the scene that are among the obstacles now
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
    """The furniture of one scene in pieces, and what a `Layout` makes of it."""

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        solids, found = {solid.name: solid for solid in scene.solids}, pieces(scene)
        self.loose = {name: solids[name] for name, piece in found.items() if _is_loose(piece, solids)}
        self.pieces = {name: piece for name, piece in found.items() if name not in self.loose}
        self._fixed: tuple[tuple[object, ...], Parts] | None = None

    def pose(self, layout: Layout, name: str) -> PlanarPose:
        """Reference point and turn of a piece as it stands now."""
        return dict(layout.moved).get(name, (*self.pieces[name].centre, 0.0))

    def present(self, layout: Layout) -> list[str]:
        """Loose solids that stand where the scene has them, and pieces that were not removed."""
        return [name for name in (*self.loose, *self.pieces) if name not in (*layout.taken, *layout.removed)]

    def moved(self, layout: Layout, name: str, pose: PlanarPose) -> Layout:
        """The layout with a piece at another pose."""
        return msgspec.structs.replace(layout, moved=tuple({**dict(layout.moved), name: pose}.items()))

    def fixed(self, layout: Layout) -> Parts:
        """Furniture, untaken loose solids and bins at their present places; cached while only obstacles change."""
        key = (layout.taken, layout.moved, layout.removed, layout.announced)
        if self._fixed is None or self._fixed[0] != key:
            self._fixed = (key, fixed_parts(*self._standing(layout)))
        return self._fixed[1]

    def _standing(self, layout: Layout) -> tuple[list[Solid], tuple[Bin, ...]]:
        gone = {*layout.taken, *(part for name in layout.removed for part in self.parts(name))}
        transforms, unmapped, announced = {}, set[str](), dict(layout.announced)
        for name, pose in layout.moved:
            piece = self.pieces[name]
            transforms |= dict.fromkeys((*piece.solids, *piece.bins), rigid(piece, pose))
            if announced.get(name, (*piece.centre, 0.0)) != pose:  # it stands where no map has it
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
        """Names under which the solids and bins of a body of any kind appear among the solids of the world."""
        piece = self.pieces.get(name)
        return (name,) if piece is None else (*piece.solids, *piece.bins)

    def truth(self, layout: Layout) -> tuple[BodyTruth, ...]:
        """Pieces that were moved and are still there: reference point, turn, extents as the scene has them."""
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
    """The poses are equal up to the jitter of a hand that only keeps holding the body."""
    turn = math.remainder(a[2] - b[2], 2.0 * math.pi)
    return math.hypot(a[0] - b[0], a[1] - b[1]) < STILL and abs(turn) < STILL_TURN


@dataclass(frozen=True, kw_only=True)
class Scenery:
    """Everything that does not move by itself."""

    layout: Layout
    solids: Solids
    in_the_way: Solids  # obstacles at the height of the tallest agent
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
