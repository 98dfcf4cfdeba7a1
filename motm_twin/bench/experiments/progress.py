"""How far a sweep is, and how long it will still take."""

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field
from types import TracebackType
from typing import Self

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

HOUR, MINUTE = 3600, 60  # [s]


@dataclass
class TimeLeft:
    """Time that the remaining trials need, from the mean time of those of the same method."""

    workers: int
    remaining: Counter[str]  # method: trials
    seconds: dict[str, list[float]] = field(default_factory=dict)

    def add(self, method: str, seconds: float | None) -> None:
        """A trial is done; None: it gave no time to learn from."""
        self.remaining[method] -= 1
        if seconds is not None:
            self.seconds.setdefault(method, []).append(seconds)

    def left(self) -> float | None:
        """Seconds of wall time; None as long as no trial is done. Methods not seen yet count as the mean of all."""
        measured = {method: sum(values) / len(values) for method, values in self.seconds.items()}
        if not measured:
            return None
        mean = sum(measured.values()) / len(measured)
        whole = sum(count * measured.get(method, mean) for method, count in self.remaining.items())
        return whole / self.workers


class Bar:
    """A progress bar on the console while it is a terminal; without one, a line whenever a tenth more is done."""

    def __init__(self, methods: Iterable[str], workers: int, console: Console) -> None:
        self.time = TimeLeft(workers, Counter(methods))
        self.total = self.time.remaining.total()
        self.done = 0
        self.console = console
        columns = (TextColumn("  trials"), BarColumn(), MofNCompleteColumn(), TextColumn("{task.fields[left]}"))
        self._progress = Progress(*columns, console=console, disable=not console.is_terminal)
        self._task = self._progress.add_task("", total=self.total, left="")

    def __enter__(self) -> Self:
        self._progress.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self._progress.stop()

    def add(self, method: str, seconds: float | None) -> None:
        """A trial is done."""
        self.time.add(method, seconds)
        self.done += 1
        left = left_text(self.time.left())
        self._progress.update(self._task, completed=self.done, left=left)
        tenth = max(1, self.total // 10)
        if not self.console.is_terminal and (self.done % tenth == 0 or self.done == self.total):
            self.console.print(f"  {self.done}/{self.total} trials {left}".rstrip(), markup=False)

    def say(self, text: str) -> None:
        """A line above the bar."""
        self.console.print(f"  {text}", style="yellow", markup=False, soft_wrap=True)


def left_text(seconds: float | None) -> str:
    """'1 h 05 min left'; "" while unknown."""
    if seconds is None:
        return ""
    if seconds >= HOUR:
        return f"{int(seconds // HOUR)} h {int(seconds % HOUR // MINUTE):02d} min left"
    return f"{int(seconds // MINUTE)} min {int(seconds % MINUTE):02d} s left"
