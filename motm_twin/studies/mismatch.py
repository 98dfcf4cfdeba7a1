"""Mismatch between reality and the robot's model: objects placed and task times in Experiment 1.

One row for each of `robustness.MISMATCHES`, all on the same arrangements and seeds. Every trial is an experiment's
(`studies.run`), kept on disk and resumed after Ctrl-C.
"""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from motm_twin.methods.registry import FAST
from motm_twin.perf.report import grid, machine, markdown, write_report
from motm_twin.studies.catalogue import MISMATCH_SEEDS, MISMATCHES, SHAKEN, experiment
from motm_twin.studies.run import Result, run_or_stop
from motm_twin.studies.summary import completed

NAME = "mismatch"
TITLE = "What robot and world do otherwise than the robot is told, and the usual noise: Experiment 1"
LOST = 1 / 60  # share of objects that may be left; `SHAKEN` is not judged
HEAD = ("mismatch", "trials", "placed", "contacts", "caused", "mean time", "most grasps")


def bench_mismatch(out: Path, share: float, workers: int, console: Console) -> bool:
    """Run, print, write ``out/mismatch.json`` and ``.md``; True when every row but `SHAKEN` places what it must.

    ``share`` of ten seeds.
    """
    console.print(f"\n[bold]{NAME}[/bold]: {TITLE}")
    chosen = experiment(NAME, (FAST.name,), math.ceil(MISMATCH_SEEDS * share))
    results = run_or_stop([chosen], out=out / NAME, workers=workers, console=console)
    if results is None:
        return False
    rows = rows_of(results.of(NAME))
    console.print(table_of(rows))
    for result in results.of(NAME):
        if not result["success"]:
            console.print(
                f"  seed {result['seed']}, {name_of(result)}: {result['reason']}", style="yellow", markup=False
            )
    reached = all(map(good, rows))
    write_report(out, NAME, TITLE, reached=reached, rows=rows)
    (out / f"{NAME}.md").write_text(markdown(HEAD, map(cells, rows)) + "\n", encoding="utf-8")
    console.print(f"{machine()}, {workers} processes; written to {out / f'{NAME}.json'} and {NAME}.md")
    return reached


def name_of(result: Result) -> str:
    """The mismatch of a trial."""
    return next(name for name, changes in MISMATCHES.items() if dict(changes) == result["changes"])


def rows_of(results: Sequence[Result]) -> list[dict[str, Any]]:
    """One row for each mismatch, in the order of `MISMATCHES`; the time is the mean of completed trials."""
    rows = []
    for name in MISMATCHES:
        these = [result for result in results if name_of(result) == name]
        if not these:
            continue
        times = [result["time_s"] for result in these if completed(result)]
        rows.append(
            {
                "mismatch": name,
                "trials": len(these),
                "placed": sum(result["places_done"] for result in these),
                "places": sum(result["places_total"] for result in these),
                "contacts": sum(len(result["contacts"]) for result in these),
                "caused": sum(result["contacts_caused_by_robot"] for result in these),
                "mean_s": round(float(np.mean(times)), 1) if times else None,
                "grasps": max(result["picks_attempted"] for result in these),
            }
        )
    return rows


def good(row: dict[str, Any]) -> bool:
    """A row places all objects but one in sixty; `SHAKEN` is not judged."""
    left = row["places"] - row["placed"]
    return row["mismatch"] == SHAKEN or left <= LOST * row["places"]


def cells(row: dict[str, Any]) -> tuple[str, ...]:
    """A row as the texts of `HEAD`."""
    time = "" if row["mean_s"] is None else f"{row['mean_s']:.1f} s"
    placed = f"{row['placed']}/{row['places']}"
    counts = (str(row["contacts"]), str(row["caused"]))
    return (row["mismatch"], str(row["trials"]), placed, *counts, time, str(row["grasps"]))


def table_of(rows: Sequence[dict[str, Any]]) -> Table:
    """Rows for a console."""
    table = grid(*HEAD, texts=HEAD[:1])
    for row in rows:
        table.add_row(*cells(row), style=None if good(row) else "yellow")
    return table
