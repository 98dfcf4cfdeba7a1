"""Which bodies are being dragged: they are let go when their holder falls silent or gives the wheel away."""

from motm_twin.model.edits import Edit, MoveBody, ReleaseBody, RemoveBody

SILENCE = 1.5  # [s] after the last move of a held body


class Holds:
    """Bodies that are being dragged, with the time until which the grip lasts."""

    def __init__(self) -> None:
        self._until: dict[str, float] = {}

    def note(self, edit: Edit, now: float) -> None:
        """Follow an edit that was accepted at ``now`` [s]."""
        if isinstance(edit, MoveBody) and edit.held:
            self._until[edit.name] = now + SILENCE
        elif isinstance(edit, MoveBody | ReleaseBody | RemoveBody):
            self._until.pop(edit.name, None)

    def expired(self, now: float) -> list[ReleaseBody]:
        """Releases for those who fell silent; they are forgotten."""
        silent = [name for name, until in self._until.items() if until <= now]
        for name in silent:
            del self._until[name]
        return [ReleaseBody(name=name) for name in silent]

    def all(self) -> list[ReleaseBody]:
        """Releases for everything that is held; it is forgotten."""
        releases = [ReleaseBody(name=name) for name in self._until]
        self._until.clear()
        return releases

    def clear(self) -> None:
        """A new run: nothing is held."""
        self._until.clear()
