"""The scenes and methods that a server offers: the shipped ones, and the files it was started with.

A command can name no other file.
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec

from motm_twin.bus.commands import Load, Refused
from motm_twin.bus.messages import MethodChoice, SceneChoice
from motm_twin.methods import DEFAULT_METHOD
from motm_twin.model.names import hint
from motm_twin.model.scene import Scene
from motm_twin.model.scene_file import (
    SceneListing,
    find_scene,
    is_made,
    list_scenes,
    listing,
    load_document,
    load_scene,
)

if TYPE_CHECKING:
    from motm_twin.control.method import Method
    from motm_twin.twin import Twin

FileStates = dict[Path, tuple[int, int]]  # time of the last change [ns] and size [bytes] of each file


class FileLibrary:
    """Scene files; ``own`` is the one that the server was started with. Raises SceneError."""

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
        self._seen: FileStates = {}
        self._told: FileStates = {}

    def choices(self) -> list[SceneChoice]:
        """All scenes that can be loaded."""
        return list(self._choices.values())

    def load(self, scene: str, variant: str | None, seed: int | None) -> Scene:
        """Resolve a scene by name, and watch its file from now on. Raises ValueError (SceneError) with the reason."""
        if scene not in self._paths:
            raise ValueError(f"no scene is called {scene[:64]!r}; {hint(scene, self._paths)}")
        path = self._paths[scene]
        file = None if is_made(path) else find_scene(path)[0]
        marks = {} if file is None else _file_states(file)  # before reading, so that a change in between is noticed
        resolved = load_scene(path, variant, seed)
        self._choices[scene] = _choice(listing(load_document(path)))
        self._watched, self._seen, self._told = file, marks, marks
        return resolved

    def changed(self) -> bool:
        """True when the watched files have changed since the last load or the last True, but not since the last call.

        Called twice a second: a file that has changed since the last call may be half written.
        """
        if self._watched is None:
            return False
        before, self._seen = self._seen, _file_states(self._watched)
        if self._seen != before or self._seen == self._told:
            return False
        self._told = self._seen
        return True


def _choice(item: SceneListing) -> SceneChoice:
    return SceneChoice(name=item.name, title=item.title, variants=list(item.variants))


def _file_states(file: Path) -> FileStates:
    """States of a scene file and its neighbours, which it may extend."""
    marks = {}
    for path in {file, *file.parent.glob("*.yaml")}:
        try:
            state = path.stat()
        except OSError:
            continue
        marks[path] = (state.st_mtime_ns, state.st_size)
    return marks


class MethodLibrary:
    """Methods by name. Control and planning, which are slow to import, are imported at the first use."""

    def __init__(self, own: str = DEFAULT_METHOD) -> None:
        """``own``: a shipped name, or FILE.py:NAME from the command line, whose file is run now. Raises MethodError."""
        self._found: dict[str, Method] = {}
        self.own_name = own  # name of the method that the server begins with
        if ":" in own:
            from motm_twin.methods.registry import find_method

            method = find_method(own)
            self._found[method.name] = method
            self.own_name = method.name

    def choices(self) -> list[MethodChoice]:
        """All methods that can be loaded."""
        return [
            MethodChoice(
                name=method.name, title=method.title, summary=method.summary, parameters=dict(method.parameters)
            )
            for method in self._known().values()
        ]

    def find(self, name: str) -> "Method":
        """A method by its name, never by a file. Raises MethodError with the names nearby."""
        from motm_twin.model.names import MethodError

        known = self._known()
        if name not in known:
            raise MethodError(f"no method is called {name[:64]!r}; {hint(name, known)}")
        return known[name]

    def _known(self) -> "dict[str, Method]":
        from motm_twin.methods.registry import METHODS

        return {**METHODS, **self._found}


class SceneSource:
    """The scenes and methods that can be loaded, and the last load."""

    def __init__(self, library: FileLibrary, methods: MethodLibrary, first: Load) -> None:
        self._library, self._methods = library, methods
        self.loaded = first  # `again` loads it
        self.choices: list[SceneChoice] = library.choices()
        self.methods: list[MethodChoice] = []  # filled with the first scene: slow to import
        self.error = ""  # of the scene file, while the old scene goes on

    def load(self, command: Load) -> Scene:
        """Resolve a scene, and note it and its method as the loaded ones. Raises Refused."""
        self._found(command.method)
        scene = self._resolved(command)
        self.loaded, self.error = msgspec.structs.replace(command, variant=scene.variant or None), ""
        self.choices, self.methods = self._library.choices(), self._methods.choices()
        return scene

    def method(self) -> "Method":
        """The loaded method."""
        return self._found(self.loaded.method)

    def shown(self, scene: Scene | None) -> dict[str, Any]:
        """Fields of the status about scenes and methods, for the running scene if any; from any thread."""
        loaded = self.loaded
        return {
            "scene": scene.name if scene else loaded.scene,
            "variant": scene.variant if scene else (loaded.variant or ""),
            "seed": scene.seed if scene else (loaded.seed or 0),
            "method": loaded.method,
            "scenes": self.choices,
            "methods": self.methods,
        }

    def again(self) -> Scene | None:
        """The loaded scene, read again from its file; None while the file is invalid, with the reason in `error`."""
        try:
            scene, self.error = self._resolved(self.loaded), ""
        except Refused as refusal:
            self.error = f"the scene file has an error, the old scene goes on: {refusal}"
            return None
        self.choices = self._library.choices()
        return scene

    def _found(self, name: str) -> "Method":
        try:
            return self._methods.find(name)
        except ValueError as error:
            raise Refused(str(error)) from error

    def _resolved(self, command: Load) -> Scene:
        try:
            return self._library.load(command.scene, command.variant, command.seed)
        except ValueError as error:
            raise Refused(str(error)) from error


MakeTwin = Callable[..., "Twin"]  # (scene, *, method): the twin at its start


@dataclass(frozen=True, kw_only=True)
class TwinSetup:
    """Setup of a server: its scenes and methods, the first to load, and the factory of twins."""

    library: FileLibrary
    make_twin: MakeTwin
    first: Load
    playing: bool = True
    hold: bool = False  # a run waits at its start until a page shows it
    again: bool = False  # after a run that nobody drives, the next seed starts
    methods: MethodLibrary | None = None  # None: the shipped ones
    reference_tour: Callable[[Scene], float] | None = None  # [s] reference time of a scene
    plant: str = "simulated"  # simulated, zenoh or mirror, as the twins that ``make_twin`` makes will be
