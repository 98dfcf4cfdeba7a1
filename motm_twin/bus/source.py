"""Where the running scene comes from: what was asked for, and whether its file still says so."""

import msgspec

from motm_twin.bus.commands import Load, Refused
from motm_twin.bus.messages import SceneChoice
from motm_twin.bus.ports import SceneLibrary
from motm_twin.model.scene import Scene


class SceneSource:
    """The scenes that can be loaded, and the one that was loaded last."""

    def __init__(self, library: SceneLibrary, first: Load) -> None:
        self._library = library
        self.loaded = first  # what `again` loads
        self.choices: list[SceneChoice] = library.choices()
        self.error = ""  # of the file, while the old scene goes on

    def load(self, command: Load) -> Scene:
        """Resolve a scene; from now on it is the loaded one. Raises Refused."""
        scene = self._resolved(command)
        self.loaded, self.error = msgspec.structs.replace(command, variant=scene.variant or None), ""
        self.choices = self._library.choices()
        return scene

    def again(self) -> Scene | None:
        """The loaded scene as its file has it now; None, and `error` says why, while that is wrong."""
        try:
            scene, self.error = self._resolved(self.loaded), ""
        except Refused as refusal:
            self.error = f"the scene file has an error, the old scene goes on: {refusal}"
            return None
        self.choices = self._library.choices()
        return scene

    def _resolved(self, command: Load) -> Scene:
        try:
            return self._library.load(command.scene, command.variant, command.seed)
        except ValueError as error:
            raise Refused(str(error)) from error
