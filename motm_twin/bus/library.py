"""The scenes that a server offers: the shipped ones, and the file it was started with. No command names other files."""

import difflib

from motm_twin.bus.messages import SceneChoice
from motm_twin.model.scene import Scene
from motm_twin.model.scene_file import list_scenes, listing, load_scene
from motm_twin.model.scene_load import load_document


class FileLibrary:
    """Scene files; ``own`` is the shipped name or the path that the server was started with. Raises SceneError."""

    def __init__(self, own: str) -> None:
        own_listing = listing(load_document(own))
        found = {item.name: item for item in list_scenes()}
        self._paths = {name: name for name in found}
        if own not in found:
            found[own_listing.name] = own_listing
            self._paths[own_listing.name] = own
        self.own_name = own_listing.name
        self._choices = [
            SceneChoice(name=item.name, title=item.title, variants=list(item.variants)) for item in found.values()
        ]

    def choices(self) -> list[SceneChoice]:
        """What can be loaded."""
        return self._choices

    def load(self, scene: str, variant: str | None, seed: int | None) -> Scene:
        """Resolve a scene by name. Raises ValueError (SceneError) with the reason."""
        if scene not in self._paths:
            near = difflib.get_close_matches(scene, self._paths, 3, 0.3) or list(self._paths)
            raise ValueError(f"no scene is called {scene[:64]!r}; there are: {', '.join(near)}")
        return load_scene(self._paths[scene], variant, seed)
