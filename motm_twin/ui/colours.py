"""Colours of the page, each with one meaning. Candidate costs use a scale that colour-blind people can read."""

import numpy as np
from numpy.typing import NDArray

Rgb = tuple[int, int, int]

BRAND: Rgb = (37, 99, 150)
GLOBAL_PATH: Rgb = (214, 40, 40)
NEXT_PATH: Rgb = (0, 178, 202)
BEZIER: Rgb = (245, 158, 11)
GHOST: Rgb = (44, 104, 200)
GOAL: Rgb = (230, 57, 125)
REJECTED: Rgb = (158, 162, 168)
TRAIL: Rgb = (112, 72, 196)
STAA_PATH: Rgb = (250, 204, 21)
INSPECTED: Rgb = (124, 58, 237)
INSPECTED_NEXT: Rgb = (192, 132, 252)
SELECTED: Rgb = (37, 132, 255)
TARGET: Rgb = (230, 57, 125)
DRIVE_TO: Rgb = (22, 140, 90)
BELIEF: Rgb = (255, 170, 60)
OTHERS: tuple[Rgb, ...] = ((240, 140, 30), (120, 80, 200))

NAMED: dict[str, Rgb] = {
    "red": (232, 22, 28),
    "green": (52, 148, 82),
    "blue": (46, 100, 190),
    "yellow": (236, 190, 44),
    "orange": (236, 130, 40),
    "white": (240, 240, 240),
    "black": (40, 40, 40),
    "grey": (140, 140, 140),
}

_VIRIDIS = np.array(
    [(68, 1, 84), (71, 44, 122), (59, 81, 139), (44, 113, 142), (33, 144, 141), (39, 173, 129), (92, 200, 99),
     (170, 220, 50), (253, 231, 37)], dtype=float
)  # fmt: skip
_GROUND = np.array(
    [(64, 176, 90, 0), (72, 184, 92, 70), (140, 200, 70, 105), (236, 196, 60, 130), (240, 130, 50, 150),
     (222, 48, 44, 175)], dtype=float
)  # fmt: skip


def scale(values: NDArray[np.float64]) -> NDArray[np.uint8]:
    """Viridis reversed: 0 (cheap) is bright yellow, 1 (expensive) is dark violet; shape (n,) to (n, 3)."""
    return _interpolate(_VIRIDIS, 1.0 - values)


def ground_table() -> NDArray[np.uint8]:
    """Free to occupied as transparent, green, yellow, red with alpha, for every value of a byte; shape (256, 4)."""
    return _interpolate(_GROUND, np.linspace(0.0, 1.0, 256))


def css(colour: Rgb) -> str:
    """A colour for style sheets."""
    return "rgb({}, {}, {})".format(*colour)


def viridis_css() -> str:
    """The candidate scale as a CSS gradient from cheap to expensive."""
    stops = ", ".join(css(tuple(int(c) for c in colour)) for colour in _VIRIDIS[::-1])  # type: ignore[arg-type]
    return f"linear-gradient(90deg, {stops})"


def _interpolate(table: NDArray[np.float64], values: NDArray[np.float64]) -> NDArray[np.uint8]:
    position = np.clip(values, 0.0, 1.0) * (len(table) - 1)
    low = np.minimum(position.astype(int), len(table) - 2)
    part = (position - low)[..., None]
    return np.round(table[low] * (1.0 - part) + table[low + 1] * part).astype(np.uint8)
