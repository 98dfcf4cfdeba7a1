"""Meshes of furniture: exactly as large as the solid that the referee knows, with the look of what it stands for."""

from collections.abc import Iterable

import numpy as np
import shapely
import shapely.affinity
import shapely.geometry.polygon
import trimesh
from PIL import Image
from trimesh.visual.material import PBRMaterial
from trimesh.visual.texture import TextureVisuals

from motm_twin.model.scene import Bin, Box, Cylinder, Solid
from motm_twin.ui.textures import wood

TOP = 0.03  # [m] thickness of a wooden top
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
    parts = [part for solid in solids for part in _PARTS.get(solid.style, _plain_parts)(solid)]
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
    for mesh, _ in parts:
        mesh.apply_transform(_planar((box.centre[0] - centre[0], box.centre[1] - centre[1]), box.yaw))
    return _assemble(parts)


def loose_box_mesh(size: tuple[float, float, float]) -> trimesh.Scene:
    """A cardboard box of the given size, origin at the centre of its base."""
    return _assemble(_carton(size[0], size[1], 0.0, size[2]))


def loose_cylinder_mesh(diameter: float, height: float) -> trimesh.Scene:
    """A standing cylinder, origin at the centre of its base."""
    disc = shapely.Point(0, 0).buffer(diameter / 2, quad_segs=12)
    return _assemble([(_extrude(disc, 0.0, height), "plain")])


def blocks(solids: Iterable[Solid], centre: tuple[float, float]) -> list[tuple[shapely.Polygon, float, float]]:
    """Outlines [m] about a centre, with lower and upper ends [m]: what casts the shadow of a piece."""
    return [
        (shapely.affinity.translate(_outline(solid, 0.0), -centre[0], -centre[1]), solid.z_min, solid.z_max)
        for solid in solids
    ]


def _table_parts(solid: Solid) -> list[Part]:
    if solid.z_min > 0.3:
        return [(_extrude(_outline(solid, 0.04), solid.z_min, solid.z_max), "wood")]
    return [(_extrude(_outline(solid, 0.01), solid.z_min, solid.z_max), "steel")]


def _desk_parts(solid: Solid) -> list[Part]:
    body = _extrude(_outline(solid, 0.02).buffer(-0.012), solid.z_min + 0.05, solid.z_max - TOP)
    foot = _extrude(_outline(solid, 0.02).buffer(-0.04), solid.z_min, solid.z_min + 0.05)
    top = _extrude(_outline(solid, 0.02), solid.z_max - TOP, solid.z_max)
    fronts = _fronts(solid, rows=3, width=0.6) if isinstance(solid.shape, Box) else []
    return [(body, "white"), (foot, "dark"), (top, "wood"), *fronts]


def _cabinet_parts(solid: Solid) -> list[Part]:
    body = _extrude(_outline(solid, 0.01).buffer(-0.006), solid.z_min + 0.04, solid.z_max - 0.02)
    foot = _extrude(_outline(solid, 0.01).buffer(-0.03), solid.z_min, solid.z_min + 0.04)
    top = _extrude(_outline(solid, 0.01), solid.z_max - 0.02, solid.z_max)
    fronts = _fronts(solid, rows=1, width=0.48) if isinstance(solid.shape, Box) else []
    return [(body, "white"), (foot, "dark"), (top, "dark wood"), *fronts]


def _shelf_parts(solid: Solid) -> list[Part]:
    """A frame and boards of wood round a dark inside."""
    if not isinstance(solid.shape, Box):
        return _plain_parts(solid)
    (length, width), low, high = solid.shape.size, solid.z_min, solid.z_max
    parts: list[Part] = [(_extrude(_rectangle(length - TOP, width - 0.03, 0.0), low, high - TOP), "inside")]
    for x in (-1.0, 1.0):
        side = _extrude(_rectangle(TOP, width, 0.0), low, high - TOP)
        side.apply_translation((x * (length - TOP) / 2, 0.0, 0.0))
        parts.append((side, "wood"))
    count = max(1, round((high - low) / BOARD_GAP))
    for level in np.linspace(low, high - TOP, count + 1):
        parts.append((_extrude(_rectangle(length, width, 0.0), float(level), float(level) + TOP), "wood"))
    for mesh, _ in parts:
        mesh.apply_transform(_planar(solid.shape.centre, solid.shape.yaw))
    return parts


def _box_parts(solid: Solid) -> list[Part]:
    if not isinstance(solid.shape, Box):
        return [(_extrude(_outline(solid, 0.0), solid.z_min, solid.z_max), "card")]
    parts = _carton(*solid.shape.size, solid.z_min, solid.z_max)
    for mesh, _ in parts:
        mesh.apply_transform(_planar(solid.shape.centre, solid.shape.yaw))
    return parts


def _wall_parts(solid: Solid) -> list[Part]:
    return [(_extrude(_outline(solid, 0.0), solid.z_min, solid.z_max), "wall")]


def _plain_parts(solid: Solid) -> list[Part]:
    return [(_extrude(_outline(solid, 0.01), solid.z_min, solid.z_max), "plain")]


_PARTS = {
    "table": _table_parts,
    "desk": _desk_parts,
    "cabinet": _cabinet_parts,
    "shelf": _shelf_parts,
    "box": _box_parts,
    "wall": _wall_parts,
}


def _carton(length: float, width: float, z_min: float, z_max: float) -> list[Part]:
    body = _extrude(_rectangle(length, width, 0.008), z_min, z_max - 0.001)
    stripe = _extrude(_rectangle(length, 0.06, 0.0), z_max - 0.12, z_max)
    stripe.apply_scale([1.002, 1.0, 1.0])
    return [(body, "card"), (stripe, "tape")]


def _fronts(solid: Solid, rows: int, width: float) -> list[Part]:
    """Doors or drawers on the two long sides of a box."""
    box = solid.shape
    assert isinstance(box, Box)
    along_x = box.size[0] >= box.size[1]
    length, depth = (box.size[0], box.size[1]) if along_x else (box.size[1], box.size[0])
    low, high, columns = solid.z_min + 0.07, solid.z_max - 0.05, max(1, round(length / width))
    cell, tall = (length - 0.05) / columns, (high - low) / rows
    parts: list[Part] = []
    for side in (1.0, -1.0):
        for column in range(columns):
            for row in range(rows):
                x = -length / 2 + 0.025 + (column + 0.5) * cell
                z = low + (row + 0.5) * tall
                door = trimesh.creation.box((cell - 0.012, 0.01, tall - 0.012))
                door.apply_translation((x, side * (depth / 2 - 0.008), z))
                grip = trimesh.creation.box((min(0.12, 0.4 * cell), 0.008, 0.012))
                grip.apply_translation((x, side * (depth / 2 - 0.004), z + 0.5 * tall - 0.05))
                parts += [(door, "white"), (grip, "steel")]
    turn = box.yaw + (0.0 if along_x else np.pi / 2)
    for mesh, _ in parts:
        mesh.apply_transform(_planar(box.centre, turn))
    return parts


def _outline(solid: Solid, rounding: float) -> shapely.Polygon:
    shape = solid.shape
    if isinstance(shape, Cylinder):
        return shapely.Point(*shape.centre).buffer(shape.radius, quad_segs=16)
    if isinstance(shape, Box):
        outline = _rectangle(*shape.size, rounding)
        outline = shapely.affinity.rotate(outline, shape.yaw, origin=(0, 0), use_radians=True)
        return shapely.affinity.translate(outline, *shape.centre)
    return shapely.Polygon(shape.corners)


def _rectangle(length: float, width: float, rounding: float) -> shapely.Polygon:
    r = min(rounding, 0.45 * min(length, width))
    inner = shapely.box(-length / 2 + r, -width / 2 + r, length / 2 - r, width / 2 - r)
    return inner.buffer(r, quad_segs=4) if r > 0.0 else inner


def _extrude(outline: shapely.Polygon, z_min: float, z_max: float) -> trimesh.Trimesh:
    """A vertical prism over an outline, with its holes."""
    outline = shapely.geometry.polygon.orient(outline)
    triangulated = shapely.constrained_delaunay_triangles(outline)
    caps = shapely.get_coordinates(triangulated).reshape(-1, 4, 2)[:, :3]
    flat = np.array([cap if _turns_left(cap) else cap[::-1] for cap in caps])
    triangles = [_at(flat, z_max), _at(flat[:, ::-1], z_min)]
    for ring in (outline.exterior, *outline.interiors):
        points = np.array(ring.coords)
        start, end = points[:-1], points[1:]
        low_start, low_end, high_start, high_end = (_at(p, z) for z in (z_min, z_max) for p in (start, end))
        triangles += [
            np.stack([low_start, low_end, high_end], axis=1),
            np.stack([low_start, high_end, high_start], axis=1),
        ]
    corners = np.concatenate(triangles).reshape(-1, 3)
    return trimesh.Trimesh(corners, np.arange(len(corners)).reshape(-1, 3), process=False)


def _at(points: np.ndarray, z: float) -> np.ndarray:
    return np.concatenate([points, np.full((*points.shape[:-1], 1), z)], axis=-1)


def _turns_left(corners: np.ndarray) -> bool:
    (ax, ay), (bx, by) = corners[1] - corners[0], corners[2] - corners[0]
    return bool(ax * by - ay * bx > 0.0)


def _planar(centre: tuple[float, float], yaw: float) -> np.ndarray:
    c, s = np.cos(yaw), np.sin(yaw)
    return np.array([[c, -s, 0, centre[0]], [s, c, 0, centre[1]], [0, 0, 1, 0], [0, 0, 0, 1.0]])


def _assemble(parts: list[Part]) -> trimesh.Scene:
    """Join parts of one material each into a scene."""
    scene = trimesh.Scene()
    for material in dict.fromkeys(name for _, name in parts):
        corners = np.concatenate([part.triangles for part, name in parts if name == material])
        scene.add_geometry(_textured(corners, material), node_name=material)
    return scene


def _textured(triangles: np.ndarray, material: str) -> trimesh.Trimesh:
    """Flat triangles, shape (n, 3, 3), with the picture laid on along the axis that each one faces."""
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    corners = triangles.reshape(-1, 3)
    axis = np.repeat(np.abs(normals).argmax(axis=1), 3)[:, None]
    uv = np.where(axis == 2, corners[:, :2], np.where(axis == 1, corners[:, ::2], corners[:, 1:])) / PICTURE
    visual = TextureVisuals(uv=uv, material=_material(material))
    return trimesh.Trimesh(corners, np.arange(len(corners)).reshape(-1, 3), visual=visual, process=False)


def _material(name: str) -> PBRMaterial:
    if name.endswith("wood"):
        picture: Image.Image = wood(light=name == "wood")
        return PBRMaterial(baseColorTexture=picture, metallicFactor=0.0, roughnessFactor=0.62)
    colour, metal, rough = _PLAIN[name]
    linear = np.round(255.0 * (np.array(colour) / 255.0) ** 2.2).astype(int)  # glTF takes factors as linear ones
    return PBRMaterial(baseColorFactor=[*linear.tolist(), 255], metallicFactor=metal, roughnessFactor=rough)
