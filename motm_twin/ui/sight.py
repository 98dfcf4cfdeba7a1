"""What a visitor sees: whether something that stands on the floor is in the picture and not hidden."""

import math

import numpy as np
import viser

from motm_twin.bus.messages import TickMessage
from motm_twin.model.geometry import Array
from motm_twin.ui.aim import Ray, Surroundings

_EDGE = 0.9  # share of the picture that counts
_PARTS = (0.35, 0.9)  # of the height of a body, which must both be in sight
_OWN = 0.3  # [m] by which a hit may lie before the point: the body itself, or its own edge


class Sight:
    """The picture of one visitor."""

    def __init__(self, camera: viser.CameraHandle, surroundings: Surroundings, tick: TickMessage) -> None:
        self._eye, self._look_at = np.asarray(camera.position, float), np.asarray(camera.look_at, float)
        self._half = math.tan(camera.fov / 2)
        self._aspect = camera.image_width / max(camera.image_height, 1)
        self._surroundings, self._tick = surroundings, tick

    def sees(self, place: tuple[float, float], height: float) -> bool:
        """Whether something of this height [m] on the floor is in the picture, and nothing is before it."""
        points = [np.array([*place, part * height]) for part in _PARTS]
        return all(self._in_picture(point) and not self._hidden(point) for point in points)

    def middle(self) -> tuple[float, float] | None:
        """The floor point [m] in the middle of the picture; None when that is the sky."""
        direction = self._look_at - self._eye
        if direction[2] > -1e-6:
            return None
        point = self._eye - direction * self._eye[2] / direction[2]
        return float(point[0]), float(point[1])

    def _in_picture(self, point: Array) -> bool:
        forward = self._look_at - self._eye
        forward /= np.linalg.norm(forward)
        right = np.cross(forward, [0.0, 0.0, 1.0])
        right /= max(float(np.linalg.norm(right)), 1e-9)
        ray = point - self._eye
        depth = float(ray @ forward)
        across, high = float(ray @ right), float(ray @ np.cross(right, forward))
        return (
            depth > 0.0
            and abs(high) < _EDGE * depth * self._half
            and abs(across) < (_EDGE * depth * self._half * self._aspect)
        )

    def _hidden(self, point: Array) -> bool:
        hit = self._surroundings.solid(Ray.through(self._eye, point), self._tick)
        return hit is not None and hit.distance < float(np.linalg.norm(point - self._eye)) - _OWN
