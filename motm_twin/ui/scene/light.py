"""Light, and unlit surfaces: soft shadows, floor, ground and sky as pictures.

Floor, ground and sky are unlit: their tones do not depend on the light, they meet without an edge, and in
software rendering they cost a fraction of lit surfaces. All pictures are computed, so that none has to be shipped.
"""

import functools
from typing import Any

import numpy as np
import shapely
import trimesh
import viser
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont
from scipy.ndimage import gaussian_filter
from shapely.affinity import translate
from trimesh.exchange.gltf import export_glb
from trimesh.visual.material import PBRMaterial
from trimesh.visual.texture import TextureVisuals

from motm_twin.model.scene import Scene

SUN = (-5.2, 0.6, 8.0)  # direction [m] that sunlight comes from: from the left of the overview
SHADOW_SHIFT = (-SUN[0] / SUN[2], -SUN[1] / SUN[2])  # [m] shift of a shadow per metre of height
_LIGHTS = (  # name, colour, intensity, direction it comes from
    ("sun", (255, 243, 224), 2.3, SUN),
    ("fill", (214, 228, 255), 0.75, (4.0, -6.0, 4.0)),
    ("back", (255, 255, 255), 0.5, (2.0, 6.0, 3.0)),
)
NO_SHADOW: dict[str, Any] = {"cast_shadow": False, "receive_shadow": False}  # options of nodes: shadows are pictures
SHADOW_HEIGHT = 0.005  # [m] above the floor
LYING = SHADOW_HEIGHT + 0.002  # [m] shadows of bodies lie on those of furniture
SHADOW_PIXELS = 40  # per metre
SHADOW_MARGIN = 0.35  # [m] round the body that casts it
DARKEST = 165  # [0-255] opacity
_NEAR_FLOOR = 0.1  # [m] a block that begins below touches the floor
_TONE = (22, 28, 40)
FLOOR_PIXELS = 80  # per metre
MARGIN = 1.5  # [m] of floor round the map
HORIZON = 30.0  # [m] from the middle of the scene
DEEP = -0.012  # [m] the ground lies this far below the floor
FLOOR = np.array([197.0, 196.0, 192.0])  # sRGB, as on the screen
BACKDROP = np.array([219.0, 223.0, 225.0])  # where ground and sky meet
ZENITH = np.array([168.0, 190.0, 212.0])
_LINE = (74, 84, 96)
_UV = np.array([(0, 0), (1, 0), (1, 1), (0, 1)])
_SQUARE = np.array([(0, 1, 2), (0, 2, 3)])
_UNLIT = "KHR_materials_unlit"
Block = tuple[shapely.Polygon, float, float]  # outline [m], lower and upper end [m]
Bounds = tuple[float, float, float, float]


def add_lights(scene: viser.SceneApi) -> None:
    """Add the lights; none of them casts shadows, which are baked into pictures.

    Tried: real shadows. They cost 45 % (sun) and 65 % (lamp) of the frame rate in software rendering, and
    Viser 1.1.1 lets a sun cast them straight down wherever it stands.
    """
    scene.set_up_direction("+z")
    scene.configure_default_lights(enabled=False)
    scene.configure_environment_map(None)  # costs twenty times as much as lights without a graphics card
    scene.configure_fog(near=30.0, far=90.0, enabled=False)  # with fog, a hovered candidate stops the drawing
    scene.add_light_hemisphere("/light/sky", sky_color=(244, 249, 255), ground_color=(150, 142, 134), intensity=1.35)
    for name, colour, strength, place in _LIGHTS:
        scene.add_light_directional(
            f"/light/{name}", color=colour, intensity=strength, position=place, cast_shadow=False
        )


# Unlit surfaces


def unlit_glb(points: np.ndarray, faces: np.ndarray, uv: np.ndarray, picture: Image.Image) -> bytes:
    """A GLB of a mesh (n, 3), (m, 3) covered with a picture at (n, 2); one with alpha is blended."""
    mode = "BLEND" if picture.mode == "RGBA" else "OPAQUE"
    material = PBRMaterial(baseColorTexture=picture, alphaMode=mode, metallicFactor=0.0, roughnessFactor=1.0)
    mesh = trimesh.Trimesh(points, faces, visual=TextureVisuals(uv=uv, material=material), process=False)
    exported = export_glb(trimesh.Scene(mesh), tree_postprocessor=_without_light)
    assert isinstance(exported, bytes)
    return exported


def _without_light(tree: dict[str, Any]) -> None:
    tree["extensionsUsed"] = [*tree.get("extensionsUsed", []), _UNLIT]
    for material in tree["materials"]:
        material["extensions"] = {_UNLIT: {}}


def on_screen(linear: NDArray[np.float64]) -> NDArray[np.float64]:
    """Tone curve of the viewer (ACES as in three.js), from linear light to sRGB 0-255, shape (..., 3)."""
    v = (linear / 0.6) @ np.array([(0.59719, 0.076, 0.0284), (0.35458, 0.90834, 0.13383), (0.04823, 0.01566, 0.83777)])
    v = (v * (v + 0.0245786) - 0.000090537) / (v * (0.983729 * v + 0.4329510) + 0.238081)
    v = v @ np.array(
        [(1.60475, -0.10208, -0.00327), (-0.53108, 1.10813, -0.07276), (-0.07367, -0.00605, 1.07602)]
    )  # fmt: skip
    v = np.clip(v, 0.0, 1.0)
    return 255.0 * np.where(v < 0.0031308, 12.92 * v, 1.055 * v ** (1 / 2.4) - 0.055)


@functools.cache
def _greys() -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Greys on the screen, and the pixel values (sRGB 0-255) that produce them."""
    code = np.linspace(0.0, 255.0, 512)
    v = code / 255.0
    linear = np.where(v < 0.04045, v / 12.92, ((v + 0.055) / 1.055) ** 2.4)
    return on_screen(np.repeat(linear[:, None], 3, axis=1))[:, 0], code


def before_tone_curve(desired: NDArray[np.float64]) -> NDArray[np.uint8]:
    """Pixel values of an unlit picture that look like ``desired`` after the tone curve (sRGB 0-255, near grey)."""
    return np.round(np.interp(desired, *_greys())).astype(np.uint8)


# Shadows


def shadow_glb(blocks: list[Block]) -> bytes:
    """The shadow of upright blocks as a mesh to lie on the floor, in the frame of their outlines.

    It is dark where a block touches the floor, and where it blocks the sun.
    """
    cast = [shapely.union(_shifted(outline, low), _shifted(outline, high)).convex_hull for outline, low, high in blocks]
    touching = [outline for outline, low, _ in blocks if low < _NEAR_FLOOR]
    hanging = [outline for outline, low, _ in blocks if low >= _NEAR_FLOOR]
    bounds = low_x, low_y, high_x, high_y = shapely.union_all([*cast, *touching, *hanging]).buffer(SHADOW_MARGIN).bounds
    size = (max(2, round((high_x - low_x) * SHADOW_PIXELS)), max(2, round((high_y - low_y) * SHADOW_PIXELS)))

    def drawn(shapes: list, blur: float) -> NDArray[np.float64]:
        picture = Image.new("L", size, 0)
        pen = ImageDraw.Draw(picture)
        for shape in shapes:
            points = (shapely.get_coordinates(shape.exterior) - (low_x, high_y)) * (SHADOW_PIXELS, -SHADOW_PIXELS)
            pen.polygon([tuple(point) for point in points], fill=255)
        return gaussian_filter(np.asarray(picture, dtype=float) / 255.0, blur * SHADOW_PIXELS)

    light = (1.0 - 0.62 * drawn(cast, 0.06)) * (1.0 - 0.55 * drawn(touching, 0.09)) * (1.0 - 0.3 * drawn(hanging, 0.2))
    picture = np.zeros((*light.shape, 4), dtype=np.uint8)
    picture[..., :3] = _TONE
    picture[..., 3] = np.round(np.clip(1.0 - light, 0.0, 1.0) * DARKEST / 4) * 4
    return unlit_glb(_rectangle(bounds, 0.0), _SQUARE, _UV, Image.fromarray(picture))


@functools.cache
def round_shadow_glb(radius: float, height: float) -> bytes:
    """The shadow of a round, upright body; it does not turn with the body."""
    disc = shapely.Point(0.0, 0.0).buffer(radius, quad_segs=8)
    return shadow_glb([(disc, 0.0, 0.3 * height), (disc.buffer(-0.6 * radius), 0.0, height)])


@functools.cache
def box_shadow_glb(length: float, width: float, height: float) -> bytes:
    """The shadow of an upright box."""
    return shadow_glb([(shapely.box(-length / 2, -width / 2, length / 2, width / 2), 0.0, height)])


def _shifted(outline: shapely.Polygon, height: float) -> shapely.Polygon:
    return translate(outline, SHADOW_SHIFT[0] * height, SHADOW_SHIFT[1] * height)


def _rectangle(bounds: Bounds, z: float) -> np.ndarray:
    x, y, u, v = bounds
    return np.array([(x, y, z), (u, y, z), (u, v, z), (x, v, z)])


# Floor, ground and sky


def floor_glb(scene: Scene) -> bytes:
    """The floor as an opaque mesh: Viser's images are transparent, and such surfaces hide each other at random."""
    picture, bounds = floor(scene)
    return _shining_glb(_rectangle(bounds, 0.0), _SQUARE, _UV, picture)


def ground_glb(centre: tuple[float, float]) -> bytes:
    """The ground all around, out to `HORIZON`; the scene is in its middle."""
    axis = HORIZON * (2.0 * (np.arange(256) + 0.5) / 256 - 1.0)
    x, y = centre
    bounds = (x - HORIZON, y - HORIZON, x + HORIZON, y + HORIZON)
    return _shining_glb(_rectangle(bounds, DEEP), _SQUARE, _UV, ground_tone(np.hypot(axis[None, :], axis[:, None])))


def sky_glb(centre: tuple[float, float]) -> bytes:
    """A dome over the ground, seen from inside, from the zenith (top row of its picture) to the horizon."""
    turns, rises = np.linspace(0.0, 2.0 * np.pi, 25), np.linspace(0.0, 0.5 * np.pi, 9)
    turn, rise = (grid.ravel() for grid in np.meshgrid(turns, rises, indexing="ij"))
    around, up = np.cos(rise), np.sin(rise)
    points = HORIZON * np.stack([around * np.cos(turn), around * np.sin(turn), up], axis=1) + (*centre, DEEP)
    uv = np.stack([turn / (2.0 * np.pi), np.clip(2.0 * rise / np.pi, 0.01, 0.99)], axis=1)
    corner = np.arange(24)[:, None] * 9 + np.arange(8)[None, :]
    a, b, c, d = (index.ravel() for index in (corner, corner + 9, corner + 10, corner + 1))
    faces = np.concatenate([np.stack([a, c, b], axis=1), np.stack([a, d, c], axis=1)])
    column = ZENITH + (BACKDROP - ZENITH) * np.linspace(0.0, 1.0, 64)[:, None] ** 0.6
    return _shining_glb(points, faces, uv, np.repeat(column[:, None, :], 4, axis=1))


def _shining_glb(points: np.ndarray, faces: np.ndarray, uv: np.ndarray, picture: NDArray[np.float64]) -> bytes:
    return unlit_glb(points, faces, uv, Image.fromarray(before_tone_curve(np.round(picture))))


def floor(scene: Scene) -> tuple[NDArray[np.float64], Bounds]:
    """The wanted look of a scene's floor, sRGB 0-255, and its bounds [m].

    Tiles of one metre with numbers along two sides; the edges fade into the surrounding ground.
    """
    x_min, y_min, x_max, y_max = scene.bounds
    area = (x_min - MARGIN, y_min - MARGIN, x_max + MARGIN, y_max + MARGIN)
    width, height = (round((area[i + 2] - area[i]) * FLOOR_PIXELS) for i in (0, 1))
    x = area[0] + (np.arange(width) + 0.5) / FLOOR_PIXELS
    y = area[3] - (np.arange(height) + 0.5) / FLOOR_PIXELS
    odd = (np.floor(x)[None, :] + np.floor(y)[:, None]) % 2.0
    tiles = FLOOR * (1.0 + 0.02 * (2.0 * odd - 1.0))[..., None]  # every other tile is a little lighter
    marked = Image.fromarray(tiles.astype(np.uint8))
    _draw_metres(marked, area, scene.bounds)
    around = ground_tone(np.hypot(x[None, :] - (area[0] + area[2]) / 2, y[:, None] - (area[1] + area[3]) / 2))
    gap_x, gap_y = (np.minimum(place + 0.5, n - place - 0.5) for n in (width, height) for place in [np.arange(n)])
    inside = np.minimum(1.0, np.minimum(gap_x[None, :], gap_y[:, None]) / (MARGIN * FLOOR_PIXELS))[..., None]
    inside = inside * inside * (3.0 - 2.0 * inside)
    return np.asarray(marked) * inside + around * (1.0 - inside), area


def ground_tone(distance: NDArray[np.float64]) -> NDArray[np.float64]:
    """Colour of the ground at a distance [m] from the middle of the scene, shape (...) to (..., 3)."""
    part = np.clip((distance - 3.0) / (HORIZON - 3.0), 0.0, 1.0)[..., None]
    return FLOOR + (BACKDROP - FLOOR) * (1.0 - (1.0 - part) ** 2.2)


def _draw_metres(picture: Image.Image, area: Bounds, bounds: Bounds) -> None:
    pen = ImageDraw.Draw(picture, "RGBA")
    font = ImageFont.load_default(size=17)
    left, bottom = int(np.ceil(bounds[0])), int(np.ceil(bounds[1]))

    def pixel(x: float, y: float) -> tuple[float, float]:
        return (x - area[0]) * FLOOR_PIXELS, (area[3] - y) * FLOOR_PIXELS

    def mark(value: int, ends: list[tuple[float, float]], at: tuple[float, float], text: str) -> None:
        pen.line([pixel(*end) for end in ends], fill=(*_LINE, 58 if value else 150), width=1)
        px, py = pixel(*at)
        pen.text((px + 4, py + 2), text, fill=(*_LINE, 200), font=font)

    for x in range(int(np.ceil(area[0])), int(np.floor(area[2])) + 1):
        mark(x, [(x, area[1]), (x, area[3])], (x, bottom), f"{x} m" if x == left else f"{x}")
    for y in range(int(np.ceil(area[1])), int(np.floor(area[3])) + 1):
        mark(y, [(area[0], y), (area[2], y)], (left, y), f"{y}" if y != bottom else "")
