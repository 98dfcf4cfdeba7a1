"""Pictures that surfaces are covered with, computed so that nothing has to be shipped."""

import functools

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont
from scipy.ndimage import gaussian_filter

from motm_twin.model.scene import Box, Cylinder, Scene, Solid

PIXELS_PER_METRE = 80
MARGIN = 1.5  # [m] of floor round the map
_FLOOR = np.array([226.0, 225.0, 221.0])
_PAGE = np.array([255.0, 255.0, 255.0])


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


def floor(scene: Scene) -> tuple[Image.Image, Image.Image, tuple[float, float], tuple[float, float]]:
    """The floor of a scene: RGB picture, grey picture of its fading edge, its centre [m] and its size [m].

    Metre lines with numbers along two sides, soft shadows where furniture stands, edges that fade into the page.
    """
    x_min, y_min, x_max, y_max = scene.bounds
    x_min, y_min, x_max, y_max = x_min - MARGIN, y_min - MARGIN, x_max + MARGIN, y_max + MARGIN
    width, height = round((x_max - x_min) * PIXELS_PER_METRE), round((y_max - y_min) * PIXELS_PER_METRE)
    shade = Image.new("L", (width, height), 0)
    pen = ImageDraw.Draw(shade)
    for solid in scene.solids:
        _draw_outline(pen, solid, (x_min, y_max))
    dark = np.asarray(shade, dtype=float) / 255.0
    soft = 0.65 * gaussian_filter(dark, 0.05 * PIXELS_PER_METRE) + 0.5 * gaussian_filter(dark, 0.22 * PIXELS_PER_METRE)
    colour = _FLOOR * (1.0 - 0.42 * np.clip(soft, 0.0, 1.0))[..., None]
    marked = Image.fromarray(colour.astype(np.uint8))
    _draw_metres(marked, (x_min, y_min, x_max, y_max), scene.bounds)
    inside = _fade(width, height)[..., None]
    picture = (np.asarray(marked) * inside + _PAGE * (1.0 - inside)).astype(np.uint8)
    edge = Image.fromarray((255.0 * (1.0 - inside[..., 0])).astype(np.uint8))
    return Image.fromarray(picture), edge, ((x_min + x_max) / 2, (y_min + y_max) / 2), (x_max - x_min, y_max - y_min)


@functools.cache
def blob(size: int = 64) -> Image.Image:
    """A soft round shadow with alpha."""
    axis = np.linspace(-1.0, 1.0, size)
    radius = np.hypot(*np.meshgrid(axis, axis))
    picture = np.zeros((size, size, 4), dtype=np.uint8)
    picture[..., 3] = (np.clip(1.0 - radius, 0.0, 1.0) ** 1.2 * 170.0).astype(np.uint8)
    return Image.fromarray(picture)


def _draw_outline(pen: ImageDraw.ImageDraw, solid: Solid, corner: tuple[float, float]) -> None:
    """Fill what a solid covers, paler the higher it hangs; ``corner`` is the upper left [m]."""
    fill = 255 if solid.z_min < 0.1 else 110

    def pixel(x: float, y: float) -> tuple[float, float]:
        return (x - corner[0]) * PIXELS_PER_METRE, (corner[1] - y) * PIXELS_PER_METRE

    shape = solid.shape
    if isinstance(shape, Cylinder):
        (x, y), r = pixel(*shape.centre), shape.radius * PIXELS_PER_METRE
        pen.ellipse([x - r, y - r, x + r, y + r], fill=fill)
        return
    if isinstance(shape, Box):
        c, s = np.cos(shape.yaw), np.sin(shape.yaw)
        half = [(sx * shape.size[0] / 2, sy * shape.size[1] / 2) for sx, sy in ((1, 1), (-1, 1), (-1, -1), (1, -1))]
        corners = [(shape.centre[0] + c * x - s * y, shape.centre[1] + s * x + c * y) for x, y in half]
    else:
        corners = list(shape.corners)
    pen.polygon([pixel(*point) for point in corners], fill=fill)


def _draw_metres(picture: Image.Image, area: tuple[float, ...], bounds: tuple[float, ...]) -> None:
    pen = ImageDraw.Draw(picture, "RGBA")
    font = ImageFont.load_default(size=17)
    x_min, _, _, y_max = area
    left, bottom = int(np.ceil(bounds[0])), int(np.ceil(bounds[1]))

    def pixel(x: float, y: float) -> tuple[float, float]:
        return (x - x_min) * PIXELS_PER_METRE, (y_max - y) * PIXELS_PER_METRE

    for x in range(int(np.ceil(area[0])), int(np.floor(area[2])) + 1):
        pen.line([pixel(x, area[1]), pixel(x, area[3])], fill=(90, 96, 104, 70 if x else 120), width=1)
        px, py = pixel(x, bottom)
        pen.text((px + 4, py + 2), f"{x} m" if x == left else f"{x}", fill=(90, 96, 104, 210), font=font)
    for y in range(int(np.ceil(area[1])), int(np.floor(area[3])) + 1):
        pen.line([pixel(area[0], y), pixel(area[2], y)], fill=(90, 96, 104, 70 if y else 120), width=1)
        px, py = pixel(left, y)
        if y != bottom:
            pen.text((px + 4, py + 2), f"{y}", fill=(90, 96, 104, 210), font=font)


def _fade(width: int, height: int) -> NDArray[np.float64]:
    edge = MARGIN * PIXELS_PER_METRE
    x, y = np.arange(width) + 0.5, np.arange(height) + 0.5
    gap_x, gap_y = np.minimum(x, width - x), np.minimum(y, height - y)
    inside = np.minimum(1.0, np.minimum(gap_x[None, :], gap_y[:, None]) / edge)
    return inside * inside * (3.0 - 2.0 * inside)
