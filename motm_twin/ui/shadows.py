"""Soft shadows on the floor as pictures: dark where something touches it, and where it keeps the sun away."""

import functools

import numpy as np
import shapely
from numpy.typing import NDArray
from PIL import Image, ImageDraw
from scipy.ndimage import gaussian_filter

from motm_twin.ui.light import SHADOW_SHIFT
from motm_twin.ui.unlit import unlit_glb

PIXELS_PER_METRE = 40
MARGIN = 0.35  # [m] round what casts the shadow
DARKEST = 165  # [0-255] opacity
_NEAR_FLOOR = 0.1  # [m] what begins below touches the floor
_TONE = (22, 28, 40)
Block = tuple[shapely.Polygon, float, float]  # outline [m], lower and upper end [m]


def shadow_glb(blocks: list[Block]) -> bytes:
    """The shadow of upright blocks as a mesh to lie on the floor, in the frame of their outlines."""
    cast = [shapely.union(_shifted(outline, low), _shifted(outline, high)).convex_hull for outline, low, high in blocks]
    touching = [outline for outline, low, _ in blocks if low < _NEAR_FLOOR]
    hanging = [outline for outline, low, _ in blocks if low >= _NEAR_FLOOR]
    low_x, low_y, high_x, high_y = shapely.union_all([*cast, *touching, *hanging]).buffer(MARGIN).bounds
    size = (max(2, round((high_x - low_x) * PIXELS_PER_METRE)), max(2, round((high_y - low_y) * PIXELS_PER_METRE)))

    def drawn(shapes: list, blur: float) -> NDArray[np.float64]:
        picture = Image.new("L", size, 0)
        pen = ImageDraw.Draw(picture)
        for shape in shapes:
            points = shapely.get_coordinates(shape.exterior)
            pen.polygon(
                [((x - low_x) * PIXELS_PER_METRE, (high_y - y) * PIXELS_PER_METRE) for x, y in points], fill=255
            )
        return gaussian_filter(np.asarray(picture, dtype=float) / 255.0, blur * PIXELS_PER_METRE)

    light = (1.0 - 0.62 * drawn(cast, 0.06)) * (1.0 - 0.55 * drawn(touching, 0.09)) * (1.0 - 0.3 * drawn(hanging, 0.2))
    return _flat_glb(1.0 - light, (low_x, low_y, high_x, high_y))


@functools.cache
def round_shadow_glb(radius: float, height: float) -> bytes:
    """The shadow of something round and upright; it does not turn with its body."""
    disc = shapely.Point(0.0, 0.0).buffer(radius, quad_segs=8)
    return shadow_glb([(disc, 0.0, 0.3 * height), (disc.buffer(-0.6 * radius), 0.0, height)])


@functools.cache
def box_shadow_glb(length: float, width: float, height: float) -> bytes:
    """The shadow of an upright box."""
    return shadow_glb([(shapely.box(-length / 2, -width / 2, length / 2, width / 2), 0.0, height)])


def _shifted(outline: shapely.Polygon, height: float) -> shapely.Polygon:
    from shapely.affinity import translate

    return translate(outline, SHADOW_SHIFT[0] * height, SHADOW_SHIFT[1] * height)


def _flat_glb(dark: NDArray[np.float64], bounds: tuple[float, float, float, float]) -> bytes:
    picture = np.zeros((*dark.shape, 4), dtype=np.uint8)
    picture[..., :3] = _TONE
    picture[..., 3] = np.round(np.clip(dark, 0.0, 1.0) * DARKEST / 4) * 4
    x, y, u, v = bounds
    corners = np.array([(x, y, 0.0), (u, y, 0.0), (u, v, 0.0), (x, v, 0.0)])
    uv = np.array([(0, 0), (1, 0), (1, 1), (0, 1)])
    return unlit_glb(corners, np.array([(0, 1, 2), (0, 2, 3)]), uv, Image.fromarray(picture))
