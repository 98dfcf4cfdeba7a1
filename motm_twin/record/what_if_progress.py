"""How far the two runs of a what-if are."""

from types import TracebackType
from typing import Self

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn

from motm_twin.record.what_if_run import AS_IT_WAS, CHANGED, Outcome, Sample

STEP = 5.0  # [s] simulated between two lines, at least


class BothRuns:
    """A bar for each run while the console is a terminal; without one, a line whenever both are a tenth further.

    ``recorded`` [s] is the length of the recording: how long a run will be, nobody knows.
    """

    def __init__(self, recorded: float, console: Console) -> None:
        self._recorded, self._console = recorded, console
        self._step = max(STEP, recorded / 10.0)
        self._next = self._step
        self._times = {AS_IT_WAS: 0.0, CHANGED: 0.0}  # [s] simulated
        self._running = set(self._times)
        columns = (TextColumn("  {task.description:9}"), BarColumn(), TextColumn("{task.fields[said]}"))
        self._progress = Progress(*columns, console=console, disable=not console.is_terminal)
        self._tasks = {run: self._progress.add_task(run, total=max(recorded, 0.05), said="") for run in self._times}

    def __enter__(self) -> Self:
        self._progress.start()
        self._say(f"running both: {self._recorded:.2f} s are recorded")
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self._progress.stop()

    def add(self, line: Sample | Outcome) -> None:
        """Take a line of one of the runs into account."""
        if isinstance(line, Outcome):
            self._running.discard(line.run)
            self._progress.update(self._tasks[line.run], total=1.0, completed=1.0, said=f"ended at {line.time_s:.2f} s")
            self._say(f"{line.run}: ended at {line.time_s:.2f} s")
            return
        self._times[line.run] = line.time
        said = f"{line.time:.0f} s, {self._recorded:.0f} s recorded"
        self._progress.update(self._tasks[line.run], completed=line.time, said=said)
        if min(self._times[run] for run in self._running) >= self._next:
            self._next += self._step
            self._say(", ".join(f"{run}: {self._times[run]:.0f} s" for run in self._times if run in self._running))

    def _say(self, text: str) -> None:
        if not self._console.is_terminal:
            self._console.print(f"  {text}", markup=False)
