"""Surfaces that no light changes: a picture as it is. They cost a fraction of lit ones in software rendering."""

from typing import Any

import numpy as np
import trimesh
from PIL import Image
from trimesh.exchange.gltf import export_glb
from trimesh.visual.material import PBRMaterial
from trimesh.visual.texture import TextureVisuals

_EXTENSION = "KHR_materials_unlit"


def unlit_glb(points: np.ndarray, faces: np.ndarray, uv: np.ndarray, picture: Image.Image) -> bytes:
    """A GLB of a mesh (n, 3), (m, 3) covered with a picture at (n, 2); one with alpha is blended."""
    material = PBRMaterial(
        baseColorTexture=picture,
        alphaMode="BLEND" if picture.mode == "RGBA" else "OPAQUE",
        metallicFactor=0.0,
        roughnessFactor=1.0,
    )
    mesh = trimesh.Trimesh(points, faces, visual=TextureVisuals(uv=uv, material=material), process=False)
    exported = export_glb(trimesh.Scene(mesh), tree_postprocessor=_without_light)
    assert isinstance(exported, bytes)
    return exported


def _without_light(tree: dict[str, Any]) -> None:
    tree["extensionsUsed"] = [*tree.get("extensionsUsed", []), _EXTENSION]
    for material in tree["materials"]:
        material["extensions"] = {_EXTENSION: {}}
