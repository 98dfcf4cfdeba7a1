"""Limits, what was measured against them, and how both are printed and written: for groups that run no trials."""

import json
import os
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

from motm_twin.bench.machine import machine
from motm_twin.bench.table import goal_table

Values = dict[str, float]


@dataclass(frozen=True, kw_only=True)
class Limit:
    """A number that must not be exceeded."""

    name: str
    unit: str
    limit: float
    decimals: int


@dataclass
class Report:
    """Values by the keys of the limits, what else is worth knowing, what could not be measured, and what was left."""

    values: Values = field(default_factory=dict)
    details: dict[str, Any] = field(default_factory=dict)
    failures: list[str] = field(default_factory=list)
    skipped: dict[str, str] = field(default_factory=dict)  # limits that are not judged, and why not
    series: dict[str, list[float]] = field(default_factory=dict)  # written, not printed


Steps = list[tuple[str, Callable[[], None]]]


def measure(steps: Steps, report: Report, console: Console) -> None:
    """Take all steps. One that fails is noted: the other numbers are still worth a table."""
    for number, (name, step) in enumerate(steps, 1):
        try:
            step()
        except (RuntimeError, TimeoutError) as error:
            report.failures.append(f"{name}: {error}")
        console.print(f"  {number}/{len(steps)} {name}", markup=False)


def conclude(name: str, title: str, limits: dict[str, Limit], report: Report, out: Path, console: Console) -> bool:
    """Print the table, write ``out/<name>.json``; True when no number exceeds its limit."""
    judged = {key: limit for key, limit in limits.items() if key not in report.skipped}
    goals = [_judged(limit, report.values.get(key, float("nan"))) for key, limit in judged.items()]
    reached = all(goal["reached"] for goal in goals)
    console.print(goal_table({"goals": goals}))
    for key, detail in report.details.items():
        console.print(f"  {key.replace('_', ' ')}: {readable(detail)}", markup=False)
    for key, reason in report.skipped.items():
        console.print(f"  skipped: {limits[key].name}: {reason}", style="yellow", markup=False)
    for failure in report.failures:
        console.print(f"  not measured: {failure}", style="red", markup=False)
    whole = {"group": name, "title": title, "machine": machine(), "reached": reached, "goals": goals}
    whole |= {
        "load_average": load_average(console),
        "details": report.details,
        "skipped": report.skipped,
        "failures": report.failures,
        "series": report.series,
    }
    write(out / f"{name}.json", whole)
    console.print(f"{whole['machine']}; written to {out / f'{name}.json'}")
    return reached


def load_average(console: Console) -> list[float]:
    """How busy the machine was over the last 1, 5 and 15 minutes, measured load included; it is printed, too."""
    load = [round(value, 1) for value in os.getloadavg()]
    console.print(f"load average {', '.join(map(str, load))}; on {os.cpu_count()} cores: above that, no p99 holds")
    return load


def write(target: Path, whole: dict[str, Any]) -> None:
    """A result as a JSON file."""
    target.parent.mkdir(parents=True, exist_ok=True)
    target.write_text(json.dumps(_plain(whole), indent=2, allow_nan=False) + "\n", encoding="utf-8")


def percentiles(values: list[float]) -> Values:
    """Median, p99 and largest of a list, and how many there are; nan for none."""
    if not values:
        return {"p50": float("nan"), "p99": float("nan"), "max": float("nan"), "count": 0.0}
    p50, p99 = np.percentile(values, (50, 99))
    return {"p50": float(p50), "p99": float(p99), "max": float(max(values)), "count": float(len(values))}


def readable(value: Any) -> str:
    """A detail in one line."""
    if isinstance(value, dict):
        return ", ".join(f"{name} {readable(item)}" for name, item in value.items())
    return f"{value:,.6g}" if isinstance(value, float) else str(value)


def _judged(limit: Limit, value: float) -> dict[str, Any]:
    return {
        "name": limit.name,
        "unit": limit.unit,
        "relation": "<=",
        "limit": limit.limit,
        "value": value,
        "decimals": limit.decimals,
        "reached": value <= limit.limit,
    }


def _plain(value: Any) -> Any:
    """The same for JSON, which has no nan: None instead."""
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_plain(item) for item in value]
    return None if isinstance(value, float) and not np.isfinite(value) else value
