"""Who holds which body: a dragged body is let go when its holder has fallen silent."""

from motm_twin.model.edits import MoveBody, ReleaseBody, WorldEdit

SILENCE = 1.5  # [s] after the last move of a held body


class Holds:
    """Bodies that are being dragged, with the time until which the grip lasts."""

    def __init__(self) -> None:
        self._until: dict[str, float] = {}

    def note(self, edit: WorldEdit, now: float) -> None:
        """Follow an edit that was accepted at ``now`` [s]."""
        if isinstance(edit, MoveBody) and edit.held:
            self._until[edit.name] = now + SILENCE
        else:
            self._until.pop(edit.name, None)

    def expired(self, now: float) -> list[ReleaseBody]:
        """Releases for those who fell silent; they are forgotten."""
        silent = [name for name, until in self._until.items() if until <= now]
        for name in silent:
            del self._until[name]
        return [ReleaseBody(name=name) for name in silent]

    def clear(self) -> None:
        """A new run: nothing is held."""
        self._until.clear()
