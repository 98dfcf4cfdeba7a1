"""Prints a group's trials and how its numbers compare with the goals, and writes both to a file."""

import json
import math
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from motm_twin.bench.groups import Goal, Group, Result, caused
from motm_twin.bench.machine import machine
from motm_twin.bench.runner import run_group

COLUMNS = (
    "trial", "seed", "time s", "tour s", "picked", "placed", "contacts", "caused", "base m", "arm m", "path m",
    "closing m/s", "p50 ms", "p99 ms", "x real", "done",
)  # fmt: skip


def bench(group: Group, out: Path, workers: int, console: Console) -> bool:
    """Run a group, print its table, write ``out/<group>.json``; True when every goal was reached."""
    console.print(f"\n[bold]{group.name}[/bold]: {group.title}")
    results = []
    for result in run_group(group, workers):
        results.append(result)
        console.print(f"  {len(results)}/{len(group.trials)} {progress(result)}", markup=False)
    report = summary(group, results)
    console.print(trial_table(results))
    console.print(goal_table(report))
    out.mkdir(parents=True, exist_ok=True)
    target = out / f"{group.name}.json"
    target.write_text(json.dumps(_plain(report), indent=2, allow_nan=False) + "\n", encoding="utf-8")
    console.print(f"{report['machine']}, {workers} processes; written to {target}")
    return bool(report["reached"])


def summary(group: Group, results: list[Result]) -> dict[str, Any]:
    """Every goal with its measured value, and the results behind them."""
    goals = [_judged(goal, results) for goal in group.goals]
    return {
        "group": group.name,
        "title": group.title,
        "machine": machine(),
        "reached": len(results) == len(group.trials) and all(goal["reached"] for goal in goals),
        "goals": goals,
        "trials": results,
    }


def _judged(goal: Goal, results: list[Result]) -> dict[str, Any]:
    value = goal.measure(results)
    return {
        "name": goal.name,
        "unit": goal.unit,
        "relation": goal.relation,
        "limit": goal.limit,
        "value": value,
        "decimals": goal.decimals,
        "reached": goal.met_by(value),
    }


def progress(result: Result) -> str:
    """One trial in one line, as soon as it is done."""
    name = f"{result['scene']}/{result['variant']} seed {result['seed']}: {result['time_s']:.1f} s"
    return name if result["success"] else f"{name}, not completed: {result['reason']}"


def row(result: Result) -> list[str]:
    """One trial as the cells of a table row."""
    tick = result["tick_ms"]
    return [
        f"{result['scene']}/{result['variant']}",
        str(result["seed"]),
        f"{result['time_s']:.1f}",
        f"{result['reference_tour_s']:.1f}",
        f"{result['picks_done']}/{result['picks_total']}",
        str(result["places_done"]),
        str(len(result["contacts"])),
        str(caused([result])),
        _number(result["min_base_clearance_m"], 3),
        _number(result["min_arm_clearance_m"], 3),
        _number(result["path_length_m"], 1),
        _number(result["mean_closing_base_speed_mps"], 3),
        _number(tick["p50"], 1),
        _number(tick["p99"], 1),
        f"{result['realtime_factor']:.1f}",
        "yes" if result["success"] else "NO",
    ]


def trial_table(results: Iterable[Result]) -> Table:
    """All trials of a group."""
    table = Table(box=None, header_style="bold", pad_edge=False)
    for name in COLUMNS:
        table.add_column(name, justify="left" if name == "trial" else "right", no_wrap=True)
    for result in results:
        table.add_row(*row(result), style=None if result["success"] else "red")
    return table


def goal_table(report: dict[str, Any]) -> Table:
    """Every goal, what was measured, and whether that is enough."""
    table = Table(box=None, header_style="bold", pad_edge=False, title_justify="left")
    for name, side in (("number to reach", "left"), ("goal", "right"), ("measured", "right"), ("", "left")):
        table.add_column(name, justify=side)  # type: ignore[arg-type]
    for goal in report["goals"]:
        wanted = f"{goal['relation']} {goal['limit']:g} {goal['unit']}".strip()
        verdict = "[green]reached[/green]" if goal["reached"] else "[red]MISSED[/red]"
        table.add_row(goal["name"], wanted, _number(goal["value"], goal["decimals"]), verdict)
    return table


def _number(value: float | None, decimals: int) -> str:
    return "-" if value is None or not math.isfinite(value) else f"{value:.{decimals}f}"


def _plain(value: Any) -> Any:
    """The same for JSON, which has neither nan nor infinity: None instead."""
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
