"""Colours of the page. Each has one meaning, and colour-blind users can tell them apart by brightness or shape.

The ground is brown where it is costly, paths are red, cyan and blue, and costs go from yellow to violet.
"""

import numpy as np
from numpy.typing import NDArray

from motm_twin.model.scene_format import COLOURS

Rgb = tuple[int, int, int]

BRAND: Rgb = (37, 99, 150)  # of the panel
WAY_THERE: Rgb = (214, 40, 40)
WAY_ON: Rgb = (0, 178, 202)
PLAN: Rgb = (44, 104, 200)
PLAN_LIGHT: Rgb = (120, 168, 232)
TARGET: Rgb = (230, 57, 125)
PEOPLE: Rgb = (96, 104, 118)
LIDAR: Rgb = (101, 163, 13)
STAA_PATH: Rgb = (40, 44, 52)
REJECTED: Rgb = (158, 162, 168)
SELECTED: Rgb = (17, 24, 39)
OTHERS: tuple[Rgb, ...] = ((240, 140, 30), (22, 140, 90))  # two runs that are compared

NAMED: dict[str, Rgb] = COLOURS

_VIRIDIS = np.array(
    [(68, 1, 84), (71, 44, 122), (59, 81, 139), (44, 113, 142), (33, 144, 141), (39, 173, 129), (92, 200, 99),
     (170, 220, 50), (253, 231, 37)], dtype=float
)  # fmt: skip
_GROUND = np.array(
    [(214, 186, 140, 0), (212, 180, 130, 70), (200, 158, 100, 110), (182, 132, 74, 140), (158, 104, 52, 160),
     (128, 76, 34, 185)], dtype=float
)  # fmt: skip


def of_cube(colour: str) -> Rgb:
    """Colour of a cube by its name or as ``#rrggbb``; red for an unknown name."""
    if colour.startswith("#"):
        red, green, blue = bytes.fromhex(colour[1:])
        return red, green, blue
    return NAMED.get(colour, NAMED["red"])


def scale(values: NDArray[np.float64]) -> NDArray[np.uint8]:
    """Viridis reversed: 0 (cheap) is bright yellow, 1 (expensive) is dark violet; shape (n,) to (n, 3)."""
    return _interpolate(_VIRIDIS, 1.0 - values)


def ground_table() -> NDArray[np.uint8]:
    """Free to occupied as clear to dark brown with alpha, for every value of a byte; shape (256, 4)."""
    return _interpolate(_GROUND, np.linspace(0.0, 1.0, 256))


def linear(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """SRGB to linear light, 0 to 255, for colours that the page draws without decoding, such as those of points."""
    return 255.0 * (values / 255.0) ** 2.2


def css(colour: Rgb) -> str:
    """A colour for style sheets."""
    return "rgb({}, {}, {})".format(*colour)


def viridis_css() -> str:
    """The candidate scale as a CSS gradient from cheap to expensive."""
    stops = ", ".join(css(tuple(int(c) for c in colour)) for colour in _VIRIDIS[::-1])  # type: ignore[arg-type]
    return f"linear-gradient(90deg, {stops})"


def ground_css() -> str:
    """The scale of the ground as a CSS gradient from free to occupied."""
    stops = ", ".join("rgba({:.0f}, {:.0f}, {:.0f}, {:.2f})".format(*row[:3], row[3] / 185) for row in _GROUND)
    return f"linear-gradient(90deg, {stops})"


def _interpolate(table: NDArray[np.float64], values: NDArray[np.float64]) -> NDArray[np.uint8]:
    position = np.clip(values, 0.0, 1.0) * (len(table) - 1)
    low = np.minimum(position.astype(int), len(table) - 2)
    part = (position - low)[..., None]
    return np.round(table[low] * (1.0 - part) + table[low + 1] * part).astype(np.uint8)
