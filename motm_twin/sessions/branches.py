"""Going back in a run, by snapshots of the last two minutes and the log since each; the later part is set aside."""

from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from motm_twin.control.tick import Tick
from motm_twin.model.edits import Edit
from motm_twin.planning.types import SearchBudget
from motm_twin.sessions.session import Cut, LoggedEdit, SessionError
from motm_twin.twin import Twin

SPACING = 40  # periods between two snapshots: 2 s
KEPT = 61  # snapshots: the last 120 s


class Log:
    """Edits and cuts of a run, by period."""

    def __init__(self, edits: Iterable[LoggedEdit], cuts: Iterable[Cut]) -> None:
        self._edits: dict[int, list[Edit]] = {}
        for entry in edits:
            self._edits.setdefault(entry.index, []).append(entry.edit)
        self._cuts = {cut.index: cut.expansions for cut in cuts}

    def edits(self, index: int) -> list[Edit]:
        """Edits applied at the start of a period, in order."""
        return self._edits.get(index, [])

    def budget(self, index: int) -> SearchBudget:
        """Budget of the search in a period, in expansions, so that a repetition does not depend on the clock."""
        return SearchBudget(expansions=self._cuts[index]) if index in self._cuts else SearchBudget()

    def advance(self, twin: Twin, index: int) -> Tick:
        """Let a twin that stands at the start of period ``index`` repeat it. Raises SessionError."""
        for edit in self.edits(index):
            try:
                twin.post(edit)
            except ValueError as error:
                raise SessionError(f"period {index}: the edit {type(edit).__name__} is refused: {error}") from error
        return twin.advance(self.budget(index))


@dataclass(frozen=True)
class _Aside:
    """A run that can be continued: its next period, its state there, and its snapshots."""

    index: int
    state: dict[str, Any]
    kept: tuple[tuple[int, dict[str, Any]], ...]


class Branches:
    """Keeps snapshots of one twin, so that it can go back to the start of any recent period.

    One snapshot is about 0.5 MB and takes 1 ms, so 61 of them are about 35 MB; with a run that is set aside and shares
    none of them, twice that.
    """

    def __init__(self, *, spacing: int = SPACING, kept: int = KEPT) -> None:
        """``spacing``: periods between two snapshots; ``kept``: how many of them at most."""
        self._spacing = spacing
        self._kept: deque[tuple[int, dict[str, Any]]] = deque(maxlen=kept)
        self._aside: _Aside | None = None

    @property
    def oldest(self) -> int:
        """The first period that `branch` can go back to; the last one is the twin's next."""
        return self._kept[0][0] if self._kept else 0

    @property
    def aside(self) -> int | None:
        """The next period of the run that `undo` brings back; None when there is none."""
        return None if self._aside is None else self._aside.index

    def clear(self) -> None:
        """Forget everything: another twin, or the same one from its start."""
        self._kept.clear()
        self._aside = None

    def note(self, twin: Twin, index: int) -> None:
        """Call once a period, before it is computed; ``index`` is that period (0 the first)."""
        if index != twin.index:
            raise ValueError(
                f"period {index} is noted, but the twin stands before period {twin.index}: note each before"
            )
        if index % self._spacing == 0 and (not self._kept or self._kept[-1][0] < index):
            self._kept.append((index, twin.snapshot()))

    def branch(self, twin: Twin, index: int) -> None:
        """Take the twin back to the start of period ``index``; the later part is set aside with its log.

        Waiting edits, and those applied in period ``index`` itself, are dropped. Raises ValueError for
        a period that is out of range.
        """
        if not self._kept:
            raise ValueError(f"cannot go back to period {index}: nothing is kept yet, let the twin run first")
        if not self.oldest <= index <= twin.index:
            raise ValueError(f"cannot go back to period {index}: choose one from {self.oldest} to {twin.index}")
        self._aside = self._whole(twin)
        log = Log(twin.edits, twin.cuts)
        while self._kept[-1][0] > index:
            self._kept.pop()
        start, state = self._kept[-1]
        twin.restore(state)
        for period in range(start, index):
            log.advance(twin, period)

    def undo(self, twin: Twin) -> None:
        """Take the twin to the end of the run that the last branch set aside, and set aside the current run instead.

        Waiting edits are dropped. Raises ValueError when no run is set aside.
        """
        aside = self._aside
        if aside is None:
            raise ValueError("no run is set aside: nothing was branched since the start")
        self._aside = self._whole(twin)
        twin.restore(aside.state)
        self._kept.clear()
        self._kept.extend(aside.kept)

    def _whole(self, twin: Twin) -> _Aside | None:
        """The current run; None after a failed period, which cannot be continued."""
        state = twin.snapshot()
        return None if state["broken"] is not None else _Aside(twin.index, state, tuple(self._kept))
