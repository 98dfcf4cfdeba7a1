"""Pictures that surfaces are covered with, computed so that nothing has to be shipped."""

import functools

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont
from scipy.ndimage import gaussian_filter

from motm_twin.model.scene import Scene

PIXELS_PER_METRE = 80
MARGIN = 1.5  # [m] of floor round the map
HORIZON = 30.0  # [m] from the middle of the scene
FLOOR = np.array([197.0, 196.0, 192.0])  # sRGB, as on the screen
BACKDROP = np.array([219.0, 223.0, 225.0])  # where ground and sky meet
ZENITH = np.array([168.0, 190.0, 212.0])
_LINE = (74, 84, 96)


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


def floor(scene: Scene) -> tuple[Image.Image, tuple[float, float], tuple[float, float]]:
    """The floor of a scene as it shall look: picture, its centre [m] and its size [m].

    Tiles of one metre with numbers along two sides; at the edges it goes over into the `ground` around.
    """
    x_min, y_min, x_max, y_max = scene.bounds
    area = (x_min - MARGIN, y_min - MARGIN, x_max + MARGIN, y_max + MARGIN)
    width, height = (round((area[i + 2] - area[i]) * PIXELS_PER_METRE) for i in (0, 1))
    centre, size = ((area[0] + area[2]) / 2, (area[1] + area[3]) / 2), (area[2] - area[0], area[3] - area[1])
    x = area[0] + (np.arange(width) + 0.5) / PIXELS_PER_METRE
    y = area[3] - (np.arange(height) + 0.5) / PIXELS_PER_METRE
    marked = Image.fromarray(_tiles(x, y).astype(np.uint8))
    _draw_metres(marked, area, scene.bounds)
    around = ground_tone(np.hypot(x[None, :] - centre[0], y[:, None] - centre[1]))
    inside = _fade(width, height)[..., None]
    picture = np.asarray(marked) * inside + around * (1.0 - inside)
    return Image.fromarray(np.round(picture).astype(np.uint8)), centre, size


def ground_tone(distance: NDArray[np.float64]) -> NDArray[np.float64]:
    """Colour of the ground at a distance [m] from the middle of the scene, shape (...) to (..., 3)."""
    part = np.clip((distance - 3.0) / (HORIZON - 3.0), 0.0, 1.0)[..., None]
    return FLOOR + (BACKDROP - FLOOR) * (1.0 - (1.0 - part) ** 2.2)


def ground(size: int = 256) -> Image.Image:
    """The ground all around, out to `HORIZON`, as it shall look; the scene is in its middle."""
    axis = HORIZON * (2.0 * (np.arange(size) + 0.5) / size - 1.0)
    return Image.fromarray(np.round(ground_tone(np.hypot(axis[None, :], axis[:, None]))).astype(np.uint8))


def sky(size: int = 64) -> Image.Image:
    """The sky from the zenith (top row) to the horizon, as it shall look."""
    part = np.linspace(0.0, 1.0, size)[:, None] ** 0.6
    column = ZENITH + (BACKDROP - ZENITH) * part
    return Image.fromarray(np.round(np.repeat(column[:, None, :], 4, axis=1)).astype(np.uint8))


def _tiles(x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float64]:
    """Tiles of one metre, every other one a little lighter; shape (len(y), len(x), 3)."""
    odd = (np.floor(x)[None, :] + np.floor(y)[:, None]) % 2.0
    return FLOOR * (1.0 + 0.02 * (2.0 * odd - 1.0))[..., None]


def _draw_metres(picture: Image.Image, area: tuple[float, ...], bounds: tuple[float, ...]) -> None:
    pen = ImageDraw.Draw(picture, "RGBA")
    font = ImageFont.load_default(size=17)
    x_min, _, _, y_max = area
    left, bottom = int(np.ceil(bounds[0])), int(np.ceil(bounds[1]))

    def pixel(x: float, y: float) -> tuple[float, float]:
        return (x - x_min) * PIXELS_PER_METRE, (y_max - y) * PIXELS_PER_METRE

    for x in range(int(np.ceil(area[0])), int(np.floor(area[2])) + 1):
        pen.line([pixel(x, area[1]), pixel(x, area[3])], fill=(*_LINE, 58 if x else 150), width=1)
        px, py = pixel(x, bottom)
        pen.text((px + 4, py + 2), f"{x} m" if x == left else f"{x}", fill=(*_LINE, 200), font=font)
    for y in range(int(np.ceil(area[1])), int(np.floor(area[3])) + 1):
        pen.line([pixel(area[0], y), pixel(area[2], y)], fill=(*_LINE, 58 if y else 150), width=1)
        px, py = pixel(left, y)
        if y != bottom:
            pen.text((px + 4, py + 2), f"{y}", fill=(*_LINE, 200), font=font)


def _fade(width: int, height: int) -> NDArray[np.float64]:
    edge = MARGIN * PIXELS_PER_METRE
    x, y = np.arange(width) + 0.5, np.arange(height) + 0.5
    gap_x, gap_y = np.minimum(x, width - x), np.minimum(y, height - y)
    inside = np.minimum(1.0, np.minimum(gap_x[None, :], gap_y[:, None]) / edge)
    return inside * inside * (3.0 - 2.0 * inside)
