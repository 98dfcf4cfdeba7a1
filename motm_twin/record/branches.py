"""Going back in a run: snapshots of the last two minutes, and the log in between."""

from collections import deque
from typing import Any

from motm_twin.record.log import Log
from motm_twin.twin import Twin

SPACING = 40  # periods between two snapshots: 2 s
KEPT = 61  # snapshots: the last 120 s


class Branches:
    """Keeps snapshots of one twin, so that it can go back to the start of any recent period.

    One snapshot is about 0.5 MB and takes 1 ms, so 61 of them are about 35 MB.
    """

    def __init__(self) -> None:
        self._kept: deque[tuple[int, dict[str, Any]]] = deque(maxlen=KEPT)
        self._next = 0  # the period that comes next

    @property
    def oldest(self) -> int:
        """The first period that `branch` can go back to."""
        return self._kept[0][0] if self._kept else self._next

    @property
    def next(self) -> int:
        """The period that comes next, and the last one that `branch` can go to."""
        return self._next

    def clear(self) -> None:
        """Forget everything: another twin, or the same one from its start."""
        self._kept.clear()
        self._next = 0

    def note(self, twin: Twin, index: int) -> None:
        """Call once a period, before it is computed; ``index`` is that period (0 the first)."""
        self._next = index
        if index % SPACING == 0 and (not self._kept or self._kept[-1][0] < index):
            self._kept.append((index, twin.snapshot()))

    def branch(self, twin: Twin, index: int) -> None:
        """Put the twin back to the start of period ``index``: what came after is forgotten, in its log too.

        Edits that wait, and those that were applied in period ``index`` itself, are forgotten. Raises ValueError for
        a period that is out of range.
        """
        if not self._kept or not self.oldest <= index <= self._next:
            raise ValueError(
                f"cannot go back to period {index}: the periods from {self.oldest} to {self._next} are kept, "
                "choose one of these"
            )
        log = Log(twin.edits, twin.cuts)
        while self._kept[-1][0] > index:
            self._kept.pop()
        start, state = self._kept[-1]
        twin.restore(state)
        for period in range(start, index):
            log.advance(twin, period)
        self._next = index
