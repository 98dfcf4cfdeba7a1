"""Where light comes from, and which numbers make a surface that shines by itself look as wanted on the screen."""

import numpy as np
import viser
from numpy.typing import NDArray

SUN = (-5.2, 0.6, 8.0)  # direction [m] that sunlight comes from: from the left of the overview
SHADOW_SHIFT = (-SUN[0] / SUN[2], -SUN[1] / SUN[2])  # [m] that a shadow is away, per metre of height
_LIGHTS = (  # name, colour, intensity, where it comes from
    ("sun", (255, 243, 224), 2.3, SUN),
    ("fill", (214, 228, 255), 0.75, (4.0, -6.0, 4.0)),
    ("back", (255, 255, 255), 0.5, (2.0, 6.0, 3.0)),
)
_ACES_IN = np.array([[0.59719, 0.35458, 0.04823], [0.07600, 0.90834, 0.01566], [0.02840, 0.13383, 0.83777]])
_ACES_OUT = np.array([[1.60475, -0.53108, -0.07367], [-0.10208, 1.10813, -0.00605], [-0.00327, -0.07276, 1.07602]])
_EXPOSURE = 1.0 / 0.6


class Lights:
    """The lights of the scene: none of them casts shadows, those are baked into pictures (see `shadows`).

    Tried: real shadows. They took 45 % (sun) and 65 % (lamp) of the pictures per second in software rendering, and
    Viser 1.1.1 lets a sun cast them straight down wherever it stands.
    """

    def __init__(self, server: viser.ViserServer) -> None:
        scene = server.scene
        scene.set_up_direction("+z")
        scene.configure_default_lights(enabled=False)
        scene.configure_environment_map(None)  # twenty times the cost of lights where there is no graphics card
        scene.configure_fog(near=30.0, far=90.0, enabled=False)  # with fog, a hovered candidate stops the drawing
        scene.add_light_hemisphere(
            "/light/sky", sky_color=(244, 249, 255), ground_color=(150, 142, 134), intensity=1.35
        )
        for name, colour, strength, place in _LIGHTS:
            scene.add_light_directional(
                f"/light/{name}", color=colour, intensity=strength, position=place, cast_shadow=False
            )


def on_screen(linear: NDArray[np.float64]) -> NDArray[np.float64]:
    """What the viewer's tone curve (ACES, as three.js has it) makes of light, shape (..., 3) linear to sRGB 0-255."""
    v = (linear * _EXPOSURE) @ _ACES_IN.T
    v = (v * (v + 0.0245786) - 0.000090537) / (v * (0.983729 * v + 0.4329510) + 0.238081)
    v = np.clip(v @ _ACES_OUT.T, 0.0, 1.0)
    return 255.0 * np.where(v < 0.0031308, 12.92 * v, 1.055 * v ** (1 / 2.4) - 0.055)


def _grey_table() -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    code = np.linspace(0.0, 255.0, 512)
    v = code / 255.0
    linear = np.where(v < 0.04045, v / 12.92, ((v + 0.055) / 1.055) ** 2.4)
    return on_screen(np.repeat(linear[:, None], 3, axis=1))[:, 0], code


_SEEN, _CODE = _grey_table()
BRIGHTEST = float(_SEEN[-1])  # [0-255] what a surface that shines by itself can reach


def shining(wanted: NDArray[np.float64]) -> NDArray[np.uint8]:
    """Pixel values of an emissive picture that look as ``wanted`` (sRGB 0-255, near grey, at most `BRIGHTEST`)."""
    return np.round(np.interp(wanted, _SEEN, _CODE)).astype(np.uint8)
