"""Where the running scene and its method come from: what was asked for, and whether the file still says so."""

from typing import TYPE_CHECKING, Any

import msgspec

from motm_twin.bus.commands import Load, Refused
from motm_twin.bus.messages import MethodChoice, SceneChoice
from motm_twin.bus.ports import Methods, SceneLibrary
from motm_twin.model.scene import Scene

if TYPE_CHECKING:
    from motm_twin.control.method import Method


class SceneSource:
    """The scenes and methods that can be loaded, and those that were loaded last."""

    def __init__(self, library: SceneLibrary, methods: Methods, first: Load) -> None:
        self._library, self._methods = library, methods
        self.loaded = first  # what `again` loads
        self.choices: list[SceneChoice] = library.choices()
        self.methods: list[MethodChoice] = []  # asked for with the first scene: they take a while to import
        self.error = ""  # of the file, while the old scene goes on

    def load(self, command: Load) -> Scene:
        """Resolve a scene; from now on it, and its method, are the loaded ones. Raises Refused."""
        self._found(command.method)
        scene = self._resolved(command)
        self.loaded, self.error = msgspec.structs.replace(command, variant=scene.variant or None), ""
        self.choices, self.methods = self._library.choices(), self._methods.choices()
        return scene

    def method(self) -> "Method":
        """The loaded one."""
        return self._found(self.loaded.method)

    def shown(self, scene: Scene | None) -> dict[str, Any]:
        """Its part of the status, while this scene is there; from any thread."""
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
        """The loaded scene as its file has it now; None, and `error` says why, while that is wrong."""
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
