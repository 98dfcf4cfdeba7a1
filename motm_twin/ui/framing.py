"""Camera poses that show a scene: how far away the eye must be for everything to be in the picture."""

import math

import numpy as np

from motm_twin.model.geometry import Array
from motm_twin.model.scene import DriveTo, Scene
from motm_twin.model.scene_shapes import outline

FIELD_OF_VIEW = math.radians(40.0)  # vertical
ASPECT = 1.18  # width / height of the picture beside the panel on a 1280 x 800 screen
SAME_ASPECT = 0.03  # share by which an aspect ratio may differ without another pose
_EDGE = 0.93  # share of the picture that is used
_FROM = np.array([-0.40, -0.72, 0.60])  # direction of the overview from the scene
_ABOVE = np.array([0.0, -0.012, 1.0])
_ROBOT = 0.45  # [m] kept free round the start
_TALL = 1.0  # [m] height of what may be anywhere
View = tuple[Array, Array]  # position and look-at point [m]


def overview(scene: Scene, aspect: float = ASPECT) -> View:
    """Position and look-at point [m] that show the whole of a scene from its front left."""
    return fitted(extent(scene), _FROM, _usual(aspect))


def from_above(scene: Scene, aspect: float = ASPECT) -> View:
    """Position and look-at point [m] for a plan view, x to the right."""
    return fitted(extent(scene), _ABOVE, _usual(aspect))


def extent(scene: Scene) -> Array:
    """Points [m] that must be in the picture, shape (n, 3): furniture, start, ends of drives, ways of agents."""
    points: list[tuple[float, float, float]] = []
    for solid in scene.solids:
        if solid.style == "wall":
            continue
        x, y, u, v = outline(solid.shape).bounds
        points += [(a, b, z) for a in (x, u) for b in (y, v) for z in (0.0, solid.z_max)]
    sent = [task.point for task in scene.tasks if isinstance(task, DriveTo)]
    points += [
        (x + dx, y + dy, z)
        for x, y in (scene.start[:2], *sent)
        for dx in (-_ROBOT, _ROBOT)
        for dy in (-_ROBOT, _ROBOT)
        for z in (0.0, _TALL)
    ]
    for agent in scene.agents:
        points += [(*place, z) for place in (agent.start[:2], *agent.waypoints) for z in (0.0, _TALL)]
    return np.array(points)


def fitted(points: Array, direction: Array, aspect: float) -> View:
    """The nearest eye in a direction that has all points within the picture, centred; and where it looks."""
    forward = -direction / np.linalg.norm(direction)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    up = np.cross(right, forward)
    across, high, deep = points @ right, points @ up, points @ forward
    tangent = _EDGE * math.tan(FIELD_OF_VIEW / 2)
    eye_x, back_x = _between(across, deep, tangent * aspect)
    eye_y, back_y = _between(high, deep, tangent)
    position = eye_x * right + eye_y * up + min(back_x, back_y) * forward
    along = (0.2 - position[2]) / forward[2]
    return position, position + along * forward


def _between(side: Array, deep: Array, tangent: float) -> tuple[float, float]:
    """Place of the eye along one axis of the picture, and the greatest depth at which both edges hold everything."""
    low, high = float(np.max(-side - tangent * deep)), float(np.max(side - tangent * deep))
    return (high - low) / 2, -(high + low) / (2 * tangent)


def _usual(aspect: float) -> float:
    return ASPECT if abs(aspect / ASPECT - 1.0) <= SAME_ASPECT else aspect
