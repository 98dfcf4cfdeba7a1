"""Make every mesh of ``web_assets``: ``python tools/make_assets.py SHARE``.

SHARE is the folder ``cmeel.prefix/share/example-robot-data`` of the unpacked wheel ``example-robot-data==6.0.0``
(``pip download --no-deps``, then unzip), whose ``panda_description`` is Apache-2.0. The base, Temi, person,
cube and bin are our own models and need no input: without SHARE only they are made. Development only: needs
trimesh, pycollada, fast_simplification, manifold3d and scipy.
"""

import argparse
from pathlib import Path

import numpy as np
import trimesh
from model_base import base_model
from model_person import person_model
from model_props import bin_model, cube_model, temi_model
from shapes import linear, shaded
from trimesh.visual.material import PBRMaterial
from trimesh.visual.texture import TextureVisuals

OUT = Path(__file__).resolve().parent.parent / "web_assets"
ARM = (*(f"link{i}" for i in range(8)), "hand")
KEEP = {"link0": 0.18}  # share of the faces that drawn links keep; the foot has small ribs and bolts
KEEP_OWN = {"base": 0.3, "temi": 0.3, "person": 0.65}  # the same for our own models
KEEP_LINK = 0.15
KEEP_GHOST = 0.07
FEWEST = 900  # [faces] of a connected piece: below this, rings and caps tear
TURNED = np.diag([-1.0, -1.0, 1.0, 1.0])  # the right finger is the left one turned about z


def colour_of(mesh: trimesh.Trimesh) -> tuple[int, ...]:
    """Main colour of a mesh, RGB 0-255."""
    return tuple(int(v) for v in np.asarray(mesh.visual.material.main_color)[:3])


def parts_by_colour(path: Path) -> dict[tuple[int, ...], trimesh.Trimesh]:
    """The welded parts of a DAE file, one per colour, in the link's frame."""
    groups: dict[tuple[int, ...], list[trimesh.Trimesh]] = {}
    scene = trimesh.load(path)
    for node in scene.graph.nodes_geometry:
        transform, name = scene.graph[node]
        part = scene.geometry[name]
        bare = trimesh.Trimesh(part.vertices, part.faces, process=False).apply_transform(transform)
        groups.setdefault(colour_of(part), []).append(bare)
    return {colour: welded(trimesh.util.concatenate(meshes)) for colour, meshes in groups.items()}


def welded(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    """The mesh with equal corners merged, whatever their normals, and without empty faces."""
    mesh.merge_vertices(merge_norm=True, merge_tex=True, digits_vertex=6)
    mesh.update_faces(mesh.nondegenerate_faces())
    mesh.update_faces(mesh.unique_faces())
    mesh.remove_unreferenced_vertices()
    return mesh


def lighter(mesh: trimesh.Trimesh, keep: float) -> trimesh.Trimesh:
    """The mesh with about a share ``keep`` of its faces, taken from its large pieces only."""
    if keep >= 1.0:
        return mesh
    pieces = []
    for piece in mesh.split(only_watertight=False):
        count = max(FEWEST, int(keep * len(piece.faces)))
        pieces.append(piece if len(piece.faces) <= count else piece.simplify_quadric_decimation(face_count=count))
    return trimesh.util.concatenate(pieces)


def save_link(parts: dict[tuple[int, ...], trimesh.Trimesh], path: Path, keep: float) -> int:
    """Write a drawn link, one mesh per colour, and return its number of faces."""
    scene = trimesh.Scene()
    for k, (colour, mesh) in enumerate(sorted(parts.items())):
        smooth = shaded(lighter(mesh, keep))
        metal = 0.0 if min(colour) > 128 else 0.1
        material = PBRMaterial(
            baseColorFactor=[*np.round(255 * linear(colour)).astype(int).tolist(), 255],
            roughnessFactor=0.45,
            metallicFactor=metal,
            doubleSided=True,
        )
        smooth.visual = TextureVisuals(material=material)
        scene.add_geometry(smooth, geom_name=f"part{k}", node_name=f"part{k}")
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(trimesh.exchange.gltf.export_glb(scene, include_normals=True))
    return sum(len(mesh.faces) for mesh in scene.geometry.values())


def save_ghost(mesh: trimesh.Trimesh, path: Path, keep: float) -> int:
    """Write a light, colourless mesh and return its number of faces."""
    light = mesh if keep >= 1.0 else mesh.simplify_quadric_decimation(face_count=int(keep * len(mesh.faces)))
    bare = trimesh.Trimesh(light.vertices, light.faces, process=True)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(trimesh.exchange.gltf.export_glb(trimesh.Scene(bare), include_normals=False))
    return len(bare.faces)


def make_arm(meshes: Path) -> int:
    """Drawn links, ghosts and collision hulls of the Panda from its description's mesh folder."""
    faces = 0
    for link in ARM:
        parts = parts_by_colour(meshes / "visual" / f"{link}.dae")
        faces += save_link(parts, OUT / "visual" / f"{link}.glb", KEEP.get(link, KEEP_LINK))
        save_ghost(welded(trimesh.util.concatenate(list(parts.values()))), OUT / "ghost" / f"{link}.glb", KEEP_GHOST)
        hull = trimesh.load(meshes / "collision" / f"{link}.stl", force="mesh").convex_hull
        hull.export(OUT / "collision" / f"{link}.stl")
    for name, turn in (("leftfinger", np.eye(4)), ("rightfinger", TURNED)):
        parts = parts_by_colour(meshes / "visual" / "finger.dae")
        for mesh in parts.values():
            mesh.apply_transform(turn)
        faces += save_link(parts, OUT / "visual" / f"{name}.glb", 1.0)
        save_ghost(trimesh.util.concatenate(list(parts.values())), OUT / "ghost" / f"{name}.glb", 1.0)
    return faces


def base_ghost() -> trimesh.Trimesh:
    """Plain outer shape of the base, for ghosts."""
    from model_base import HEIGHT, LENGTH, WIDTH
    from shapes import squircle, stack

    outline = squircle(LENGTH, WIDTH, power=5.5, count=48)
    return stack(
        outline, [(0.03, 0.012), (0.045, 0.0), (0.12, 0.0), (0.30, 0.014), (0.355, 0.026), (HEIGHT - 0.008, 0.05)]
    )


def main() -> None:
    """Make the assets and print what each weighs."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("share", type=Path, nargs="?", help="unpacked example-robot-data share folder")
    share = parser.parse_args().share
    models = {"base": base_model(), "temi": temi_model(), "person": person_model(), "cube": cube_model()}
    models["bin"] = bin_model()
    for name, model in models.items():
        print(f"{name}: {model.save(OUT / 'visual' / f'{name}.glb', keep=KEEP_OWN.get(name, 1.0))} faces")
    save_ghost(base_ghost(), OUT / "ghost" / "base.glb", 1.0)
    if share is not None:
        print(f"arm: {make_arm(share / 'robots' / 'panda_description' / 'meshes')} faces")
    for folder in ("visual", "ghost", "collision"):
        print(f"{folder}: {sum(file.stat().st_size for file in (OUT / folder).iterdir()) / 1e6:.2f} MB")


if __name__ == "__main__":
    main()
