"""The log of a run as it is replayed: what to post, and how far to search, in each period."""

from collections.abc import Iterable

from motm_twin.control.tick import Tick
from motm_twin.model.edits import Edit
from motm_twin.planning.types import SearchBudget
from motm_twin.record.session import Cut, LoggedEdit, SessionError
from motm_twin.twin import Twin


class Log:
    """Edits and cuts of a run, by period."""

    def __init__(self, edits: Iterable[LoggedEdit], cuts: Iterable[Cut]) -> None:
        self._edits: dict[int, list[Edit]] = {}
        for entry in edits:
            self._edits.setdefault(entry.index, []).append(entry.edit)
        self._cuts = {cut.index: cut.expansions for cut in cuts}

    def edits(self, index: int) -> list[Edit]:
        """What was applied at the start of a period, in order."""
        return self._edits.get(index, [])

    def budget(self, index: int) -> SearchBudget:
        """How far the search of a period went; the clock has no say."""
        return SearchBudget(expansions=self._cuts[index]) if index in self._cuts else SearchBudget()

    def advance(self, twin: Twin, index: int) -> Tick:
        """Let a twin that stands at the start of period ``index`` repeat it. Raises SessionError."""
        for edit in self.edits(index):
            try:
                twin.post(edit)
            except ValueError as error:
                raise SessionError(f"period {index}: the edit {type(edit).__name__} is refused: {error}") from error
        return twin.advance(self.budget(index))
