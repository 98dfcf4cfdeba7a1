"""Does a resolved scene make sense? Every refusal names the place in the file, what is wrong and what to do."""

from motm_twin.model.scene import Scene
from motm_twin.model.scene_yaml import Node


def check_scene(scene: Scene, root: Node) -> None:
    """Raise SceneError for the first thing that cannot be right."""
