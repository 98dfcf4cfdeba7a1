"""The map and the robot of a scene before anything moved, for the figures of the method."""

import functools
from typing import NamedTuple

from motm_twin.methods.modifications import MOTM
from motm_twin.model.known import KnownWorld, known_world
from motm_twin.model.scene import Scene
from motm_twin.model.scene_file import load_scene
from motm_twin.perception.world_map import WorldMap
from motm_twin.twin import Twin


class Standing(NamedTuple):
    """A scene, what the robot knows of it, and its map in the first period."""

    scene: Scene
    known: KnownWorld
    world: WorldMap


@functools.cache
def standing(scene: str, variant: str) -> Standing:
    """The first period of a scene."""
    loaded = load_scene(scene, variant)
    return Standing(loaded, known_world(loaded), Twin(loaded, method=MOTM).advance().map)
