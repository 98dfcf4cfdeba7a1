"""What is behind everything: the floor with its metre marks, the ground around it, the sky.

All of it shines by itself, so its tones do not depend on the light, and floor, ground and sky meet without an edge.
"""

import numpy as np
from PIL import Image

from motm_twin.model.scene import Scene
from motm_twin.ui.light import shining
from motm_twin.ui.textures import HORIZON, floor, ground, sky
from motm_twin.ui.unlit import unlit_glb

DEEP = -0.012  # [m] the ground lies this far below the floor
_UV = np.array([(0, 0), (1, 0), (1, 1), (0, 1)])


def floor_glb(scene: Scene) -> bytes:
    """The floor as an opaque mesh: pictures of the viewer are transparent ones, which hide each other at random."""
    picture, (x, y), (length, width) = floor(scene)
    return _shining_glb(_plane(x, y, length, width, 0.0), _UV, picture)


def ground_glb(centre: tuple[float, float]) -> bytes:
    """The ground round the floor."""
    return _shining_glb(_plane(*centre, 2 * HORIZON, 2 * HORIZON, DEEP), _UV, ground())


def sky_glb(centre: tuple[float, float]) -> bytes:
    """A dome over the ground, seen from inside."""
    turns, rises = np.linspace(0.0, 2.0 * np.pi, 25), np.linspace(0.0, 0.5 * np.pi, 9)
    turn, rise = (grid.ravel() for grid in np.meshgrid(turns, rises, indexing="ij"))
    around, up = np.cos(rise), np.sin(rise)
    points = HORIZON * np.stack([around * np.cos(turn), around * np.sin(turn), up], axis=1) + (*centre, DEEP)
    uv = np.stack([turn / (2.0 * np.pi), np.clip(2.0 * rise / np.pi, 0.01, 0.99)], axis=1)
    corner = np.arange(24)[:, None] * 9 + np.arange(8)[None, :]
    a, b, c, d = (index.ravel() for index in (corner, corner + 9, corner + 10, corner + 1))
    faces = np.concatenate([np.stack([a, c, b], axis=1), np.stack([a, d, c], axis=1)])
    return _shining_glb(points, uv, sky(), faces)


def _plane(x: float, y: float, length: float, width: float, z: float) -> np.ndarray:
    return np.array([(x + sx * length / 2, y + sy * width / 2, z) for sx, sy in ((-1, -1), (1, -1), (1, 1), (-1, 1))])


def _shining_glb(points: np.ndarray, uv: np.ndarray, picture: Image.Image, faces: np.ndarray | None = None) -> bytes:
    faces = np.array([(0, 1, 2), (0, 2, 3)]) if faces is None else faces
    return unlit_glb(points, faces, uv, Image.fromarray(shining(np.asarray(picture, dtype=float))))
