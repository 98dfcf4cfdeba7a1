"""Small modelling kit for our own models: lofted shells, revolved and swept bodies, materials, GLB export.

Development only; needs trimesh, and manifold3d for the cuts.
"""

from pathlib import Path

import numpy as np
import trimesh
from numpy.typing import NDArray
from trimesh.visual.material import PBRMaterial
from trimesh.visual.texture import TextureVisuals

Array = NDArray[np.float64]
Levels = list[tuple[float, float]]  # (height z, inset) [m] from bottom to top

CREASE = np.radians(38.0)  # sharper edges than this keep their edge when shaded
FEW = 120  # [faces] of a part that is left as it is
CAP_RING = 0.0025  # [m] a ring this far inside the rim keeps caps flat when shaded


def paint(colour: str, *, rough: float = 0.6, metal: float = 0.0, glow: float = 0.0) -> PBRMaterial:
    """A material of colour ``#rrggbb``; ``glow`` is the share of the colour that it emits."""
    rgb = linear([int(colour[i : i + 2], 16) for i in (1, 3, 5)])
    return PBRMaterial(
        name=f"{colour}-{rough}-{metal}-{glow}",
        baseColorFactor=[*np.round(255.0 * rgb).astype(int).tolist(), 255],
        roughnessFactor=rough,
        metallicFactor=metal,
        emissiveFactor=(glow * rgb).tolist(),
    )


def linear(rgb: list[int]) -> Array:
    """Colour as glTF wants it, linear 0-1, from sRGB 0-255; shape (3,)."""
    return (np.array(rgb) / 255.0) ** 2.2


class Model:
    """Parts collected by material; one GLB mesh per material."""

    def __init__(self) -> None:
        self._parts: dict[str, tuple[PBRMaterial, list[trimesh.Trimesh]]] = {}

    def add(self, material: PBRMaterial, *meshes: trimesh.Trimesh) -> None:
        """Add meshes in one material."""
        self._parts.setdefault(material.name, (material, []))[1].extend(meshes)

    def save(self, path: Path, *, keep: float = 1.0) -> int:
        """Write the GLB with a share of the faces of its round parts, and return its number of faces."""
        scene = trimesh.Scene()
        for name, (material, meshes) in self._parts.items():
            merged = trimesh.util.concatenate([shaded(_lighter(mesh, keep)) for mesh in meshes])
            merged.visual = TextureVisuals(material=material)
            scene.add_geometry(merged, geom_name=name, node_name=name)
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(trimesh.exchange.gltf.export_glb(scene, include_normals=True))
        return sum(len(mesh.faces) for mesh in scene.geometry.values())


def _lighter(mesh: trimesh.Trimesh, keep: float) -> trimesh.Trimesh:
    """The mesh with about a share ``keep`` of its faces; small ones stay as they are."""
    if keep >= 1.0 or len(mesh.faces) <= FEW:
        return mesh
    return mesh.simplify_quadric_decimation(face_count=max(FEW, int(keep * len(mesh.faces))))


def shaded(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    """The mesh with smooth normals except across creases."""
    clean = trimesh.Trimesh(mesh.vertices, mesh.faces, process=True)
    smooth = trimesh.graph.smooth_shade(clean, angle=CREASE)
    return trimesh.Trimesh(smooth.vertices, smooth.faces, vertex_normals=smooth.vertex_normals, process=False)


def squircle(length: float, width: float, power: float = 5.0, count: int = 96) -> Array:
    """Superellipse outline of a given length (x) and width (y), anticlockwise, equal turns apart, shape (count, 2)."""
    normal = 2.0 * np.pi * (np.arange(count) + 0.5) / count
    half = np.array([0.5 * length, 0.5 * width])
    direction = np.column_stack([np.cos(normal), np.sin(normal)])
    share = np.abs(half * direction) ** (1.0 / (power - 1.0))
    share /= (share**power).sum(axis=1, keepdims=True) ** (1.0 / power)
    return half * np.sign(direction) * share


def rounded(length: float, width: float, radius: float, steps: int = 6) -> Array:
    """Rectangle with round corners, anticlockwise, shape (4 * (steps + 1), 2)."""
    arc = np.linspace(0.0, 0.5 * np.pi, steps + 1)
    corners = []
    for k, (sx, sy) in enumerate([(1, 1), (-1, 1), (-1, -1), (1, -1)]):
        centre = np.array([sx * (0.5 * length - radius), sy * (0.5 * width - radius)])
        corners.append(centre + radius * np.column_stack([np.cos(arc + k * np.pi / 2), np.sin(arc + k * np.pi / 2)]))
    return np.vstack(corners)


def loft(loops: list[Array]) -> trimesh.Trimesh:
    """Closed body through loops of equal length, each anticlockwise seen from the last one, shape (m, 3) each."""
    first, last = loops[0], loops[-1]
    loops = [_inner(first), first, *loops[1:-1], last, _inner(last)] if len(loops) > 1 else loops
    m = len(first)
    vertices = np.vstack([*loops, first.mean(axis=0), last.mean(axis=0)])
    k, after = np.arange(m), (np.arange(m) + 1) % m
    faces = []
    for i in range(len(loops) - 1):
        low, high = i * m, (i + 1) * m
        faces.append(np.column_stack([low + k, low + after, high + after]))
        faces.append(np.column_stack([low + k, high + after, high + k]))
    top = (len(loops) - 1) * m
    faces.append(np.column_stack([np.full(m, len(vertices) - 2), after, k]))
    faces.append(np.column_stack([np.full(m, len(vertices) - 1), top + k, top + after]))
    return trimesh.Trimesh(vertices, np.vstack(faces), process=True)


def _inner(loop: Array) -> Array:
    centre = loop.mean(axis=0)
    size = np.linalg.norm(loop - centre, axis=1).max()
    return centre + (loop - centre) * max(0.5, 1.0 - CAP_RING / size)


def stack(outline: Array, levels: Levels) -> trimesh.Trimesh:
    """Body whose outline (n, 2) is drawn in by each level's inset, scaled per axis about its centre."""
    centre, half = outline.mean(axis=0), 0.5 * np.ptp(outline, axis=0)
    loops = []
    for z, inset in levels:
        flat = centre + (outline - centre) * (half - inset) / half
        loops.append(np.column_stack([flat, np.full(len(flat), z)]))
    return loft(loops)


def edges(low: float, high: float, inset: float = 0.0, radius: float = 0.004, steps: int = 4) -> Levels:
    """Levels of an upright body from z ``low`` to ``high`` with both edges rounded."""
    angle = np.linspace(0.0, 0.5 * np.pi, steps + 1)
    bottom = [(low + radius * (1 - np.sin(a)), inset + radius * (1 - np.cos(a))) for a in angle[::-1]]
    top = [(high - radius * (1 - np.sin(a)), inset + radius * (1 - np.cos(a))) for a in angle]
    return bottom + top


def slab(
    length: float, width: float, low: float, high: float, *, corner: float = 0.01, edge: float = 0.002
) -> trimesh.Trimesh:
    """Plate with round corners and edges, centred in x and y."""
    return stack(rounded(length, width, corner), edges(low, high, radius=edge, steps=3))


def revolve(profile: list[tuple[float, float]], sections: int = 48) -> trimesh.Trimesh:
    """Body of revolution about z through (radius, z) points from bottom to top."""
    angle = 2.0 * np.pi * np.arange(sections) / sections
    ring = np.column_stack([np.cos(angle), np.sin(angle)])
    return loft([np.column_stack([max(r, 1e-4) * ring, np.full(sections, z)]) for r, z in profile])


def disc(radius: float, low: float, high: float, *, edge: float = 0.0015, sections: int = 32) -> trimesh.Trimesh:
    """Round plate about z with round edges."""
    return revolve([(radius - inset, z) for z, inset in edges(low, high, radius=edge, steps=2)], sections)


def sweep(path: Array, outlines: list[Array]) -> trimesh.Trimesh:
    """Body along a path (n, 3) in the x-z plane; outlines (m, 2) have x across the path in that plane, y sideways."""
    tangents = np.gradient(path, axis=0)
    tangents /= np.linalg.norm(tangents, axis=1, keepdims=True)
    loops = []
    for point, tangent, outline in zip(path, tangents, outlines, strict=True):
        across = np.array([tangent[2], 0.0, -tangent[0]])
        loops.append(point + outline[:, :1] * across + outline[:, 1:] * np.array([0.0, 1.0, 0.0]))
    return loft(loops)


def curve(points: list[tuple[float, float, float]], count: int = 40) -> Array:
    """Smooth path through points, shape (count, 3)."""
    from scipy.interpolate import CubicSpline

    knots = np.array(points)
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(knots, axis=0), axis=1))])
    return CubicSpline(length, knots)(np.linspace(0.0, length[-1], count))


def moved(
    mesh: trimesh.Trimesh, xyz: tuple[float, float, float], *, turn: str = "", degrees: float = 0.0
) -> trimesh.Trimesh:
    """A copy turned about an axis through the origin ("x", "y" or "z"), then shifted."""
    copy = mesh.copy()
    if turn:
        copy.apply_transform(trimesh.transformations.rotation_matrix(np.radians(degrees), np.eye(3)["xyz".index(turn)]))
    copy.apply_translation(xyz)
    return copy


def box(size: tuple[float, float, float], centre: tuple[float, float, float]) -> trimesh.Trimesh:
    """Plain box."""
    return moved(trimesh.creation.box(size), centre)


def cut(body: trimesh.Trimesh, *tools: trimesh.Trimesh) -> trimesh.Trimesh:
    """The body without what the tools cover."""
    return trimesh.boolean.difference([body, *tools], engine="manifold")


def common(body: trimesh.Trimesh, tool: trimesh.Trimesh) -> trimesh.Trimesh:
    """What the body and the tool both cover."""
    return trimesh.boolean.intersection([body, tool], engine="manifold")
