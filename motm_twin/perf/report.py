"""Goals and limits of benchmarks, measured values, and the tables and JSON files with them."""

import json
import math
import os
import platform
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import joblib
import numpy as np
from rich.console import Console
from rich.table import Table

Values = dict[str, float]
Steps = list[tuple[str, Callable[[], None]]]  # names of measurements and their functions


def machine() -> str:
    """Processor, number of cores and Python, for the table's caption."""
    model = platform.processor() or platform.machine()
    info = Path("/proc/cpuinfo")
    if info.is_file():
        lines = [line for line in info.read_text().splitlines() if line.startswith("model name")]
        model = lines[0].split(":", 1)[1].strip() if lines else model
    return f"{model}, {joblib.cpu_count()} cores, {platform.system()}, Python {platform.python_version()}"


def load_average(console: Console) -> list[float]:
    """Load of the machine over the last 1, 5 and 15 minutes, including the measured program; it is also printed."""
    load = [round(value, 1) for value in os.getloadavg()]
    console.print(f"load average {', '.join(map(str, load))}; on {os.cpu_count()} cores: above that, no p99 holds")
    return load


def percentiles(values: list[float]) -> Values:
    """Median, p99, largest value and count of a list; nan for an empty one."""
    if not values:
        return {"p50": math.nan, "p99": math.nan, "max": math.nan, "count": 0.0}
    p50, p99 = np.percentile(values, (50, 99))
    return {"p50": float(p50), "p99": float(p99), "max": float(max(values)), "count": float(len(values))}


def spread(times: list[float]) -> Values:
    """p50, p99 and largest of some times in their unit, rounded to three decimals."""
    return {name: round(value, 3) for name, value in percentiles(times).items() if name != "count"}


@dataclass(frozen=True, kw_only=True)
class Limit:
    """A number to reach: at most, at least, or exactly."""

    name: str
    unit: str
    limit: float
    relation: str = "<="  # ">=" | "<=" | "=="
    decimals: int = 0

    def met_by(self, value: float) -> bool:
        """True when a measured value reaches the limit; nan never does."""
        return {">=": value >= self.limit, "<=": value <= self.limit, "==": value == self.limit}[self.relation]

    def judged(self, value: float) -> dict[str, Any]:
        """Limit, measured value and verdict as printed and written."""
        about = ("name", "unit", "relation", "limit", "decimals")
        return {name: getattr(self, name) for name in about} | {"value": value, "reached": self.met_by(value)}


@dataclass(frozen=True, kw_only=True)
class Wanted:
    """A number to reach at least, and one that would be better still."""

    key: str
    name: str
    unit: str
    least: float
    best: float
    more: bool = False  # True: larger values are better; False: smaller ones
    decimals: int = 2


def enough(row: Wanted, value: float, limit: float) -> bool:
    """True when a measured value reaches a limit; nan never does."""
    return value >= limit if row.more else value <= limit


@dataclass
class Report:
    """Values by the keys of the limits, further details, and failed or skipped measurements."""

    values: Values = field(default_factory=dict)
    details: dict[str, Any] = field(default_factory=dict)
    failures: list[str] = field(default_factory=list)
    skipped: dict[str, str] = field(default_factory=dict)  # limits that are not judged, with the reason
    series: dict[str, list[float]] = field(default_factory=dict)  # written to the file, not printed


def measure(steps: Steps, report: Report, console: Console) -> None:
    """Run all measurements. A failed one is noted and does not stop the others."""
    for number, (name, step) in enumerate(steps, 1):
        try:
            step()
        except (RuntimeError, TimeoutError) as error:
            report.failures.append(f"{name}: {error}")
        console.print(f"  {number}/{len(steps)} {name}", markup=False)


def conclude(name: str, title: str, limits: dict[str, Limit], report: Report, out: Path, console: Console) -> bool:
    """Print the table, write ``out/<name>.json``; True when no number exceeds its limit."""
    judged = {key: limit for key, limit in limits.items() if key not in report.skipped}
    goals = [limit.judged(report.values.get(key, math.nan)) for key, limit in judged.items()]
    reached = all(goal["reached"] for goal in goals)
    console.print(goal_table(goals))
    for key, detail in report.details.items():
        console.print(f"  {key.replace('_', ' ')}: {readable(detail)}", markup=False)
    for key, reason in report.skipped.items():
        console.print(f"  skipped: {limits[key].name}: {reason}", style="yellow", markup=False)
    for failure in report.failures:
        console.print(f"  not measured: {failure}", style="red", markup=False)
    target = write_report(
        out, name, title, reached=reached, goals=goals, load_average=load_average(console), details=report.details,
        skipped=report.skipped, failures=report.failures, series=report.series,
    )  # fmt: skip
    console.print(f"{machine()}; written to {target}")
    return reached


def write_report(out: Path, name: str, title: str, **more: Any) -> Path:
    """Write ``out/<name>.json`` with a description of this machine, and return its path."""
    target = out / f"{name}.json"
    write(target, {"group": name, "title": title, "machine": machine(), **more})
    return target


def write(target: Path, whole: Mapping[str, Any]) -> None:
    """Write a JSON file with null in place of nan and infinity."""
    target.parent.mkdir(parents=True, exist_ok=True)
    new = target.with_name(f"{target.name}.new")
    new.write_text(json.dumps(plain(whole), indent=2, allow_nan=False) + "\n", encoding="utf-8")
    new.replace(target)


def save_picture(figure: Any, target: Path) -> None:
    """Write a matplotlib figure for the documentation."""
    figure.tight_layout()
    target.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(target, dpi=110)


def plain(value: Any) -> Any:
    """The value in JSON's types: lists for arrays and tuples, None for nan and infinity."""
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, (np.ndarray, np.generic)):
        return plain(value.tolist())
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def readable(value: Any) -> str:
    """A detail as one line of text."""
    if isinstance(value, dict):
        return ", ".join(f"{name} {readable(item)}" for name, item in value.items())
    return f"{value:,.6g}" if isinstance(value, float) else str(value)


def number(value: float | None, decimals: int) -> str:
    """A number with this many decimals as text; "-" for None, nan and infinity."""
    return "-" if value is None or not math.isfinite(value) else f"{value:.{decimals}f}"


def grid(*names: str, texts: Collection[str] | None = None, **options: Any) -> Table:
    """A table without lines; ``texts``: left-aligned columns with text (None: the first), the others have numbers."""
    table = Table(box=None, header_style="bold", pad_edge=False, **options)
    for name in names:
        left = name in (names[:1] if texts is None else texts)
        table.add_column(name, justify="left" if left else "right", no_wrap=texts is None)
    return table


@dataclass(frozen=True, kw_only=True)
class Sheet:
    """Format of a table: its head, the cells of a row, and the style of rows that are not good."""

    head: Collection[str]
    cells: Callable[[Any], Sequence[str]]
    texts: Collection[str] | None = None  # columns with text, as in `grid`
    good: Callable[[Any], bool] = lambda _: True
    bad: str = "yellow"  # style of rows that are not good

    def table(self, rows: Iterable[Any], **options: Any) -> Table:
        """The rows as a table for a console."""
        table = grid(*self.head, texts=self.texts, **options)
        for row in rows:
            table.add_row(*self.cells(row), style=None if self.good(row) else self.bad)
        return table

    def write(self, target: Path, rows: Iterable[Any]) -> None:
        """Write the rows as a Markdown table."""
        lines = [self.head, ("---",) * len(self.head), *map(self.cells, rows)]
        target.write_text("".join(f"| {' | '.join(line)} |\n" for line in lines), encoding="utf-8")


VERDICTS = {True: "[green]reached[/green]", False: "[red]MISSED[/red]"}


def goal_table(goals: Iterable[Mapping[str, Any]]) -> Table:
    """Table of goals from `Limit.judged`: the limit, the measured value, and the verdict."""
    table = grid("number to reach", "goal", "measured", "", texts=("number to reach", ""))
    for goal in goals:
        wanted = f"{goal['relation']} {goal['limit']:g} {goal['unit']}".strip()
        table.add_row(goal["name"], wanted, number(goal["value"], goal["decimals"]), VERDICTS[goal["reached"]])
    return table


def wanted_table(wanted: Sequence[Wanted], columns: Mapping[str, Mapping[str, float]]) -> Table:
    """Table of every row with its value in each column, the least number, and the number to reach for.

    The first column is judged and must have every value; the others need not.
    """
    texts = ("number to reach", "unit")
    table = grid(*texts, *columns, "at least", "", "reach for", " ", texts=texts)
    judged = next(iter(columns.values()))
    for row in wanted:
        verdicts = []
        for limit in (row.least, row.best):
            good = enough(row, judged[row.key], limit)
            verdicts += [f"{limit:g}", "[green]reached[/green]" if good else "[red]not reached[/red]"]
        values = (f"{column[row.key]:.{row.decimals}f}" if row.key in column else "-" for column in columns.values())
        table.add_row(row.name, row.unit, *values, *verdicts)
    return table


def wanted_rows(wanted: Sequence[Wanted], columns: Mapping[str, Mapping[str, float]]) -> list[dict[str, Any]]:
    """The rows of `wanted_table` for a JSON file; None where a column has no value."""
    return [
        {"name": row.name, "unit": row.unit, "least": row.least, "best": row.best}
        | {name: column.get(row.key) for name, column in columns.items()}
        for row in wanted
    ]
