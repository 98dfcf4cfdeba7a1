"""Furniture: meshes exactly as large as the solids that the referee knows, and the views that draw them.

Fixed solids are one mesh with floor, ground and sky. A piece that can be moved is one frame, with its bins and shadow.
"""

import functools
import itertools
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import shapely
import shapely.affinity
import trimesh
import viser
from PIL import Image
from scipy.ndimage import gaussian_filter
from trimesh.visual.material import PBRMaterial
from trimesh.visual.texture import TextureVisuals
from viser.transforms import SO3

from motm_twin.bus.messages import TickMessage
from motm_twin.model.scene import Bin, Box, Bump, PlanarPose, Scene, Solid
from motm_twin.model.scene_shapes import Piece, outline, pieces
from motm_twin.ui.scene.drag import SIGN, Drag
from motm_twin.ui.scene.light import NO_SHADOW, SHADOW_HEIGHT, Block, floor_glb, ground_glb, shadow_glb, sky_glb
from motm_twin.ui.scene.picking import furniture_poses

FIXED, MOVABLE = "/scene", "/furniture"
LABEL_GAP = 0.10  # [m] above the rim of a bin
SLACK = 0.04  # [m] the pointer must move this far before a piece does: a mere click leaves it in place
TOP = 0.03  # [m] thickness of a wooden top
THINNEST = 1e-4  # [m] least thickness of a part
BOARD_GAP = 0.3  # [m] between the boards of a shelf
PICTURE = 1.2  # [m] side of a surface picture
Part = tuple[trimesh.Trimesh, str]

_PLAIN = {  # sRGB, metallic, roughness
    "steel": ((88, 94, 102), 0.35, 0.5),
    "white": ((243, 242, 238), 0.0, 0.55),
    "dark": ((62, 66, 72), 0.2, 0.6),
    "inside": ((92, 74, 58), 0.0, 0.9),
    "card": ((205, 160, 108), 0.0, 0.9),
    "tape": ((232, 206, 160), 0.0, 0.5),
    "wall": ((232, 231, 227), 0.0, 0.95),
    "plain": ((124, 148, 172), 0.0, 0.65),
    "bin": ((58, 122, 186), 0.0, 0.5),
    "rim": ((86, 150, 212), 0.0, 0.45),
}


def glb(scene: trimesh.Scene) -> bytes:
    """A scene as the bytes of a GLB file."""
    exported = scene.export(file_type="glb")
    assert isinstance(exported, bytes)
    return exported


def solids_mesh(solids: Iterable[Solid], centre: tuple[float, float] = (0.0, 0.0)) -> trimesh.Scene:
    """The solids of one piece of furniture, about a centre [m]."""
    parts = [part for solid in solids for part in _PARTS.get(solid.style, _PARTS["plain"])(solid)]
    for mesh, _ in parts:
        mesh.apply_translation((-centre[0], -centre[1], 0.0))
    return _assemble(parts)


def bin_mesh(box: Bin, centre: tuple[float, float] = (0.0, 0.0)) -> trimesh.Scene:
    """An open box, about a centre [m]."""
    floor = _extrude(_rectangle(box.side, box.side, 0.02), box.floor_z, box.floor_z + box.wall)
    inner = _rectangle(box.side - 2 * box.wall, box.side - 2 * box.wall, 0.0)
    ring = shapely.Polygon(_rectangle(box.side, box.side, 0.02).exterior, [inner.exterior])
    walls = _extrude(ring, box.floor_z, box.rim_z)
    rim = _extrude(ring.buffer(0.006, join_style="mitre"), box.rim_z - 0.012, box.rim_z)
    parts: list[Part] = [(floor, "bin"), (walls, "bin"), (rim, "rim")]
    return _assemble(_placed(parts, (box.centre[0] - centre[0], box.centre[1] - centre[1]), box.yaw))


def bump_mesh(bumps: Iterable[Bump]) -> trimesh.Scene:
    """Ridges on the floor."""
    parts: list[Part] = []
    for bump in bumps:
        radius = (0.25 * bump.width**2 + bump.height**2) / (2.0 * bump.height)
        disc = shapely.Point(0.0, bump.height - radius).buffer(radius, quad_segs=256)
        mesh = _extrude(disc.intersection(shapely.box(-radius, 0.0, radius, radius)), 0.0, bump.length)
        mesh.apply_transform([[0, 0, 1, -0.5 * bump.length], [1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 0, 1]])
        parts += _placed([(mesh, "dark")], bump.centre, bump.yaw)
    return _assemble(parts)


def loose_box_mesh(size: tuple[float, float, float]) -> trimesh.Scene:
    """A cardboard box of the given size, origin at the centre of its base."""
    return _assemble(_carton(size[0], size[1], 0.0, size[2]))


def loose_cylinder_mesh(diameter: float, height: float) -> trimesh.Scene:
    """A standing cylinder, origin at the centre of its base."""
    disc = shapely.Point(0, 0).buffer(diameter / 2, quad_segs=12)
    return _assemble([(_extrude(disc, 0.0, height), "plain")])


def blocks(solids: Iterable[Solid], centre: tuple[float, float] = (0.0, 0.0)) -> list[Block]:
    """Outlines [m] about a centre, with lower and upper ends [m]: they cast the shadow of a piece."""
    return [
        (shapely.affinity.translate(outline(solid.shape), -centre[0], -centre[1]), solid.z_min, solid.z_max)
        for solid in solids
    ]


def _desk_parts(solid: Solid) -> list[Part]:
    body = _closed(solid, _outline(solid, 0.02), inset=0.012, recess=0.04, foot=0.05, top=(TOP, "wood"))
    return body + _doors(solid, rows=3, width=0.6)


def _cabinet_parts(solid: Solid) -> list[Part]:
    body = _closed(solid, _outline(solid, 0.01), inset=0.006, recess=0.03, foot=0.04, top=(0.02, "dark wood"))
    return body + _doors(solid, rows=1, width=0.48)


def _shelf_parts(solid: Solid) -> list[Part]:
    """A frame and boards of wood round a dark inside."""
    if not isinstance(solid.shape, Box):
        return [_slab(solid, 0.01, "plain")]
    (length, width), low, high = solid.shape.size, solid.z_min, solid.z_max
    parts: list[Part] = [(_extrude(_rectangle(length - TOP, width - 0.03, 0.0), low, high - TOP), "inside")]
    for x in (-1.0, 1.0):
        side = _extrude(_rectangle(TOP, width, 0.0), low, high - TOP)
        side.apply_translation((x * (length - TOP) / 2, 0.0, 0.0))
        parts.append((side, "wood"))
    levels = np.linspace(low, high - TOP, max(1, round((high - low) / BOARD_GAP)) + 1).tolist()
    parts += [(_extrude(_rectangle(length, width, 0.0), level, level + TOP), "wood") for level in levels]
    return _placed(parts, solid.shape.centre, solid.shape.yaw)


def _box_parts(solid: Solid) -> list[Part]:
    if not isinstance(solid.shape, Box):
        return [_slab(solid, 0.0, "card")]
    return _placed(_carton(*solid.shape.size, solid.z_min, solid.z_max), solid.shape.centre, solid.shape.yaw)


_PARTS = {
    "table": lambda solid: [_slab(solid, 0.04, "wood") if solid.z_min > 0.3 else _slab(solid, 0.01, "steel")],
    "desk": _desk_parts,
    "cabinet": _cabinet_parts,
    "shelf": _shelf_parts,
    "box": _box_parts,
    "wall": lambda solid: [_slab(solid, 0.0, "wall")],
    "plain": lambda solid: [_slab(solid, 0.01, "plain")],
}


def _slab(solid: Solid, rounding: float, material: str) -> Part:
    return _extrude(_outline(solid, rounding), solid.z_min, solid.z_max), material


def _closed(
    solid: Solid, outline: shapely.Polygon, *, inset: float, recess: float, foot: float, top: tuple[float, str]
) -> list[Part]:
    """A white body on a recessed dark foot, under a top with this thickness [m] and material."""
    low, high = solid.z_min + foot, solid.z_max - top[0]
    return [
        (_extrude(outline.buffer(-inset), low, high), "white"),
        (_extrude(outline.buffer(-recess), solid.z_min, low), "dark"),
        (_extrude(outline, high, solid.z_max), top[1]),
    ]


def _carton(length: float, width: float, z_min: float, z_max: float) -> list[Part]:
    body = _extrude(_rectangle(length, width, 0.008), z_min, z_max - 0.001)
    stripe = _extrude(_rectangle(length, 0.06, 0.0), z_max - 0.12, z_max)
    stripe.apply_scale([1.002, 1.0, 1.0])
    return [(body, "card"), (stripe, "tape")]


def _doors(solid: Solid, rows: int, width: float) -> list[Part]:
    """Doors or drawers on the two long sides of a box; none on another shape."""
    box = solid.shape
    if not isinstance(box, Box):
        return []
    along_x = box.size[0] >= box.size[1]
    length, depth = (box.size[0], box.size[1]) if along_x else (box.size[1], box.size[0])
    low, high, columns = solid.z_min + 0.07, solid.z_max - 0.05, max(1, round(length / width))
    cell, tall = (length - 0.05) / columns, (high - low) / rows
    parts: list[Part] = []
    for side, column, row in itertools.product((1.0, -1.0), range(columns), range(rows)):
        x, z = -length / 2 + 0.025 + (column + 0.5) * cell, low + (row + 0.5) * tall
        door = trimesh.creation.box((cell - 0.012, 0.01, tall - 0.012))
        door.apply_translation((x, side * (depth / 2 - 0.008), z))
        grip = trimesh.creation.box((min(0.12, 0.4 * cell), 0.008, 0.012))
        grip.apply_translation((x, side * (depth / 2 - 0.004), z + 0.5 * tall - 0.05))
        parts += [(door, "white"), (grip, "steel")]
    return _placed(parts, box.centre, box.yaw + (0.0 if along_x else np.pi / 2))


def _placed(parts: list[Part], centre: tuple[float, float], yaw: float) -> list[Part]:
    c, s = np.cos(yaw), np.sin(yaw)
    transform = np.array([[c, -s, 0, centre[0]], [s, c, 0, centre[1]], [0, 0, 1, 0], [0, 0, 0, 1.0]])
    for mesh, _ in parts:
        mesh.apply_transform(transform)
    return parts


def _outline(solid: Solid, rounding: float) -> shapely.Polygon:
    """Outline of a solid; the corners of a box are rounded with at most this radius [m]."""
    shape = outline(solid.shape)
    return _rounded(shape, min(rounding, 0.45 * min(solid.shape.size))) if isinstance(solid.shape, Box) else shape


def _rectangle(length: float, width: float, rounding: float) -> shapely.Polygon:
    half = (length / 2, width / 2)
    return _rounded(shapely.box(-half[0], -half[1], *half), min(rounding, 0.9 * min(half)))


def _rounded(shape: shapely.Polygon, radius: float) -> shapely.Polygon:
    return shape.buffer(-radius, join_style="mitre").buffer(radius, quad_segs=4) if radius > 0.0 else shape


def _extrude(outline: shapely.Polygon, z_min: float, z_max: float) -> trimesh.Trimesh:
    """A vertical prism over an outline, with its holes."""
    triangles = shapely.orient_polygons(shapely.get_parts(shapely.constrained_delaunay_triangles(outline)))
    corners = shapely.get_coordinates(triangles).reshape(-1, 4, 2)[:, :3].reshape(-1, 2)
    unique, faces = np.unique(corners, axis=0, return_inverse=True)
    height = max(z_max - z_min, THINNEST)  # the sides of a shelf with one board have no height
    prism = trimesh.creation.extrude_triangulation(unique, faces.reshape(-1, 3), height)
    prism.apply_translation((0.0, 0.0, z_min))
    return prism


def _assemble(parts: list[Part]) -> trimesh.Scene:
    """Join parts of one material each into a scene."""
    scene = trimesh.Scene()
    for material in dict.fromkeys(name for _, name in parts):
        corners = np.concatenate([part.triangles for part, name in parts if name == material])
        scene.add_geometry(_textured(corners, material), node_name=material)
    return scene


def _textured(triangles: np.ndarray, material: str) -> trimesh.Trimesh:
    """Flat triangles, shape (n, 3, 3), with the picture projected along the axis that each one faces."""
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    corners = triangles.reshape(-1, 3)
    axis = np.repeat(np.abs(normals).argmax(axis=1), 3)[:, None]
    uv = np.where(axis == 2, corners[:, :2], np.where(axis == 1, corners[:, ::2], corners[:, 1:])) / PICTURE
    visual = TextureVisuals(uv=uv, material=_material(material))
    return trimesh.Trimesh(corners, np.arange(len(corners)).reshape(-1, 3), visual=visual, process=False)


@functools.cache
def wood(light: bool = True, size: int = 256) -> Image.Image:
    """Planks with grain along x; tiles without a seam."""
    rng = np.random.default_rng(7)
    noise = gaussian_filter(rng.normal(size=(size, size)), (1.2, 26.0), mode="wrap")
    noise /= np.abs(noise).max()
    broad = gaussian_filter(rng.normal(size=(size, size)), (9.0, 60.0), mode="wrap")
    broad /= np.abs(broad).max()
    tone = 0.55 + 0.22 * noise + 0.30 * broad
    dark, bright = ((172, 124, 78), (222, 182, 132)) if light else ((120, 82, 52), (166, 120, 80))
    picture = np.array(dark) + (np.array(bright) - np.array(dark)) * np.clip(tone, 0.0, 1.0)[..., None]
    return Image.fromarray(picture.astype(np.uint8)).quantize(48).convert("RGB")


def _material(name: str) -> PBRMaterial:
    if name.endswith("wood"):
        picture: Image.Image = wood(light=name == "wood")
        return PBRMaterial(baseColorTexture=picture, metallicFactor=0.0, roughnessFactor=0.62)
    colour, metal, rough = _PLAIN[name]
    linear = np.round(255.0 * (np.array(colour) / 255.0) ** 2.2).astype(int)  # glTF takes factors as linear ones
    return PBRMaterial(baseColorFactor=[*linear.tolist(), 255], metallicFactor=metal, roughnessFactor=rough)


def show_fixed(page: viser.SceneApi, scene: Scene) -> None:
    """Draw floor, ground, sky, walls and other fixed solids of this scene instead of those of the last one."""
    page.remove_by_name(FIXED)
    x_min, y_min, x_max, y_max = scene.bounds
    centre = ((x_min + x_max) / 2, (y_min + y_max) / 2)
    meshes = {"floor": floor_glb(scene), "ground": ground_glb(centre), "sky": sky_glb(centre)}
    movable = {name for piece in pieces(scene).values() for name in piece.solids}
    fixed = [solid for solid in scene.solids if solid.name not in movable]
    if fixed:
        meshes |= {"fixed": glb(solids_mesh(fixed)), "shadow": shadow_glb(blocks(fixed))}
    if scene.bumps:
        meshes["bumps"] = glb(bump_mesh(scene.bumps))
    for name, mesh in meshes.items():
        height = SHADOW_HEIGHT if name == "shadow" else 0.0
        page.add_glb(f"{FIXED}/{name}", mesh, position=(0.0, 0.0, height), **NO_SHADOW)


@dataclass
class _Drawn:
    piece: Piece
    frame: viser.FrameHandle
    pose: PlanarPose


class FurnitureView:
    """One movable node per piece; its mesh, shadow and bins are its children."""

    def __init__(self, server: viser.ViserServer, drag: Drag) -> None:
        self._scene, self._drag = server.scene, drag
        self._drawn: dict[str, _Drawn] = {}

    def show(self, scene: Scene) -> None:
        """Draw the pieces of this scene instead of those of the last one."""
        self._scene.remove_by_name(MOVABLE)
        self._drawn = {
            name: self._add(f"{MOVABLE}/piece{number}", scene, piece)
            for number, (name, piece) in enumerate(pieces(scene).items())
        }
        for number, box in enumerate(scene.bins):  # bins that stand on something fixed
            if not any(box.name in drawn.piece.bins for drawn in self._drawn.values()):
                self._add_bin(f"{MOVABLE}/bin{number}", box, (0.0, 0.0))

    def update(self, tick: TickMessage) -> None:
        """Place the pieces: where a visitor drags them, else as in the tick, else at home."""
        moved = furniture_poses(tick)
        for name, drawn in self._drawn.items():
            pose, held = moved.get(name, (*drawn.piece.centre, 0.0)), self._drag.held(name)
            if held is not None:
                pose = (held.x, held.y, pose[2] if held.heading is None else held.heading)
            if pose != drawn.pose:
                drawn.pose = pose
                drawn.frame.position, drawn.frame.wxyz = (pose[0], pose[1], 0.0), SO3.from_z_radians(pose[2]).wxyz
            drawn.frame.visible = name not in tick.removed

    def _add(self, path: str, scene: Scene, piece: Piece) -> _Drawn:
        add = self._scene
        solids = [solid for solid in scene.solids if solid.name in piece.solids]
        frame = add.add_frame(path, show_axes=False, position=(*piece.centre, 0.0))
        mesh = add.add_glb(f"{path}/mesh", glb(solids_mesh(solids, piece.centre)), **NO_SHADOW)
        shadow = shadow_glb(blocks(solids, piece.centre))
        add.add_glb(f"{path}/shadow", shadow, position=(0.0, 0.0, SHADOW_HEIGHT), **NO_SHADOW)
        for number, box in enumerate(box for name in piece.bins for box in scene.bins if box.name == name):
            self._add_bin(f"{path}/bin{number}", box, piece.centre)
        drawn = _Drawn(piece, frame, (*piece.centre, 0.0))
        self._drag.attach(mesh, piece.name, where=lambda: drawn.pose[:2], slack=SLACK)
        return drawn

    def _add_bin(self, path: str, box: Bin, centre: tuple[float, float]) -> None:
        self._scene.add_glb(path, glb(bin_mesh(box, centre)), **NO_SHADOW)
        place = (box.centre[0] - centre[0], box.centre[1] - centre[1], box.rim_z + LABEL_GAP)
        self._scene.add_label(f"{path}/name", box.name, position=place, depth_test=True, **SIGN)
