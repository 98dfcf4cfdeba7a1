"""The scenes that a server offers: the shipped ones, and the file it was started with. No command names other files."""

from pathlib import Path

from motm_twin.bus.messages import SceneChoice
from motm_twin.model.names import hint
from motm_twin.model.scene import Scene
from motm_twin.model.scene_file import SceneListing, list_scenes, listing, load_scene
from motm_twin.model.scene_load import find_scene, is_made, load_document

Marks = dict[Path, tuple[int, int]]  # time of the last change [ns] and size [bytes] of each file


class FileLibrary:
    """Scene files; ``own`` is what the server was started with. Raises SceneError."""

    def __init__(self, own: str) -> None:
        own_listing = listing(load_document(own))
        found = {item.name: item for item in list_scenes()}
        self._paths = {name: name for name in found}
        if own not in found:
            found[own_listing.name] = own_listing
            self._paths[own_listing.name] = own
        self.own_name = own_listing.name
        self._choices = {item.name: _choice(item) for item in found.values()}
        self._watched: Path | None = None
        self._seen: Marks = {}
        self._told: Marks = {}

    def choices(self) -> list[SceneChoice]:
        """What can be loaded."""
        return list(self._choices.values())

    def load(self, scene: str, variant: str | None, seed: int | None) -> Scene:
        """Resolve a scene by name, and watch its file from now on. Raises ValueError (SceneError) with the reason."""
        if scene not in self._paths:
            raise ValueError(f"no scene is called {scene[:64]!r}; {hint(scene, self._paths)}")
        path = self._paths[scene]
        file = None if is_made(path) else find_scene(path)[0]
        marks = {} if file is None else _marks(file)  # before it is read: a change in between must be seen
        resolved = load_scene(path, variant, seed)
        self._choices[scene] = _choice(listing(load_document(path)))
        self._watched, self._seen, self._told = file, marks, marks
        return resolved

    def changed(self) -> bool:
        """Whether the watched files changed since the last load or the last True, and came to rest.

        Asked twice a second. A file that is other than at the last question may be half written: it is told next time.
        """
        if self._watched is None:
            return False
        before, self._seen = self._seen, _marks(self._watched)
        if self._seen != before or self._seen == self._told:
            return False
        self._told = self._seen
        return True


def _choice(item: SceneListing) -> SceneChoice:
    return SceneChoice(name=item.name, title=item.title, variants=list(item.variants))


def _marks(file: Path) -> Marks:
    """The file and its neighbours, which it may extend."""
    marks = {}
    for path in {file, *file.parent.glob("*.yaml")}:
        try:
            state = path.stat()
        except OSError:
            continue
        marks[path] = (state.st_mtime_ns, state.st_size)
    return marks
