"""`motm-twin what-if`: a session as it was and with other parameters, side by side in a table."""

from collections.abc import Iterator
from types import TracebackType
from typing import Self

import msgspec
from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, Progress, TextColumn
from rich.table import Table

from motm_twin.cli.outputs import refuse_unwritable, write_json
from motm_twin.model.period import PERIODS_PER_SECOND
from motm_twin.program import plain_console, table_console
from motm_twin.record.what_if import (
    AS_IT_WAS,
    CHANGED,
    FAILED,
    OK,
    Line,
    Outcome,
    RunBroke,
    Sample,
    compare,
    parse_changes,
    start_period,
    stream,
)
from motm_twin.sessions.session import SessionError, load_session

STEP = 5.0  # [s] simulated between two lines, at least


def what_if(
    file: str, changes: list[str], *, seconds: float, report: str | None, lines: bool, method: str | None
) -> int:
    """Run both and print them; the exit code. ``lines``: JSON lines of both runs instead, see `record.what_if`.

    ``method``: FILE.py:NAME of a user's, for a session that was made with it.

    Raises SessionError for a file, a parameter or a time that cannot be used.
    """
    if lines:
        return stream(file, changes, seconds, method)
    refuse_unwritable(report)
    session = load_session(file)
    values, start = parse_changes(changes), start_period(session, seconds)
    try:
        console = plain_console(stderr=True) if report == "-" else table_console()
        ends = _run_both(compare(session, values, start, method), session.periods / PERIODS_PER_SECOND, console)
    except SessionError as error:
        raise SessionError(error.problem, file=file) from error
    except RunBroke as error:
        plain_console(stderr=True).print(f"motm-twin what-if: {error}", markup=False)
        return FAILED
    was, changed = ends[AS_IT_WAS], ends[CHANGED]
    if report is not None:
        parts = {"as_it_was": msgspec.to_builtins(was), "changed": msgspec.to_builtins(changed)}
        gain = round(changed.time_s - was.time_s, 3)
        write_json({"file": file, "from_s": seconds, "parameters": values, "difference_s": gain, **parts}, report)
    if report != "-":
        _print(was, changed, f"{', '.join(changes)} from {seconds:g} s")
    return OK


def _run_both(lines: Iterator[Line], recorded: float, console: Console) -> dict[str, Outcome]:
    """Outcomes of both runs, with their progress on the console. ``recorded``: [s]."""
    ends: dict[str, Outcome] = {}
    with BothRuns(recorded, console) as progress:
        for line in lines:
            progress.add(line)
            if isinstance(line, Outcome):
                ends[line.run] = line
    return ends


def _print(was: Outcome, changed: Outcome, title: str) -> None:
    console = table_console()
    table = Table("", "as it was", "changed", "difference")
    for column in table.columns[1:]:
        column.justify = "right"
    table.add_row(escape("time [s]"), *_numbers(was.time_s, changed.time_s, 2))
    begins = ["as recorded" if end.forecast_from_s is None else f"{end.forecast_from_s:.2f}" for end in (was, changed)]
    table.add_row(escape("forecast from [s]"), *begins, "")
    table.add_row("picks", *_numbers(was.picks, changed.picks, 0))
    table.add_row("places", *_numbers(was.places, changed.places, 0))
    table.add_row("contacts", *_numbers(was.all_contacts, changed.all_contacts, 0))
    table.add_row("contacts caused", *_numbers(was.contacts, changed.contacts, 0))
    table.add_row(escape("distance driven [m]"), *_numbers(was.path_length, changed.path_length, 2))
    table.add_row("success", *("yes" if end.success else "no" for end in (was, changed)), "")
    console.print(title, style="bold", markup=False)
    console.print(table)
    lines = [f"{end.run}: {end.reason}" for end in (was, changed) if end.reason]
    for end, why in ((was, "the recording ends there"), (changed, "the change begins there")):
        if end.forecast_from_s is not None:
            lines.append(
                f"{end.run}: forecast from {end.forecast_from_s:g} s on ({why}): no clock cuts its searches, "
                "so a live run may end at another time"
            )
    lines += [f"left out of the changed run: {said}" for said in changed.skipped]
    for line in lines:
        console.print(line, markup=False)


def _numbers(was: float, changed: float, digits: int) -> tuple[str, str, str]:
    return f"{was:.{digits}f}", f"{changed:.{digits}f}", f"{changed - was:+.{digits}f}"


class BothRuns:
    """A bar for each run while the console is a terminal; without one, a line whenever both are a tenth further.

    ``recorded`` [s] is the length of the recording; the length of a run is unknown.
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
