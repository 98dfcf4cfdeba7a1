"""The search as an anytime algorithm: task time over its limit of expansions, and over a limit of time."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from motm_twin.bench.machine import machine
from motm_twin.bench.period import one_core
from motm_twin.bench.report import load_average, write
from motm_twin.model.scene_file import load_scene
from motm_twin.planning.types import SearchBudget
from motm_twin.trial import run_scene

NAME = "anytime"
TITLE = "Anytime: task time over the expansions and over the time that the search may take"
TRIALS = ("trial1", "trial3", "trial8")
EXPANSIONS = (50, 100, 200, 300, 500, 1000, 2000)
SECONDS = (0.001, 0.002, 0.004, 0.008, 0.016)  # [s] with up to 2,000 expansions
PICTURE = Path("docs/performance_anytime.png")
Curve = dict[str, dict[str, Any]]  # results by limit, then by trial


def bench_anytime(out: Path, console: Console, *, quick: bool = False, picture: Path = PICTURE) -> bool:
    """Measure both curves, print, write ``out/anytime.json`` and the picture. Takes about 15 minutes.

    ``quick``: one trial with 50 expansions, and no picture. There is no number to reach; True when all trials end.
    """
    console.print(f"\n[bold]{NAME}[/bold]: {TITLE}")
    trials, limits = (TRIALS[:1], EXPANSIONS[:1]) if quick else (TRIALS, EXPANSIONS)
    with one_core():
        by_count = _curve(trials, limits, lambda limit: SearchBudget(expansions=int(limit)), console)
        by_time = {} if quick else _curve(
            trials, SECONDS, lambda limit: SearchBudget(expansions=EXPANSIONS[-1], seconds=limit), console
        )  # fmt: skip
    console.print(curve_table("expansions", by_count))
    if by_time:
        console.print(curve_table("seconds", by_time))
    load = load_average(console)
    write(
        out / f"{NAME}.json",
        {"machine": machine(), "load_average": load, "expansions": by_count, "seconds": by_time},
    )
    if not quick:
        plot(by_count, by_time, picture)
    return all(row["success"] for curve in (by_count, by_time) for point in curve.values() for row in point.values())


def _curve(
    trials: Sequence[str], limits: Sequence[float], budget: Callable[[float], SearchBudget], console: Console
) -> Curve:
    found: Curve = {}
    for limit in limits:
        for trial in trials:
            result = run_scene(load_scene("exp1", trial), budget=budget(limit))
            found.setdefault(f"{limit:g}", {})[trial] = {
                key: result[key] for key in ("success", "time_s", "path_length_m", "tick_ms")
            }
        times = [row["time_s"] for row in found[f"{limit:g}"].values()]
        console.print(f"  {limit:g}: {', '.join(f'{time:.1f}' for time in times)} s", markup=False)
    return found


def curve_table(name: str, curve: Curve) -> Table:
    """Task time of every trial [s], their mean, and the period [ms], by limit."""
    table = Table(box=None, header_style="bold", pad_edge=False)
    trials = next(iter(curve.values()))
    for title in (name, *trials, "mean s", "period p50 ms", "p99 ms"):
        table.add_column(title, justify="right", no_wrap=True)
    for limit, point in curve.items():
        times = [row["time_s"] if row["success"] else float("nan") for row in point.values()]
        period = [f"{np.mean([row['tick_ms'][part] for row in point.values()]):.1f}" for part in ("p50", "p99")]
        table.add_row(limit, *(f"{time:.1f}" for time in times), f"{np.mean(times):.1f}", *period)
    return table


def plot(by_count: Curve, by_time: Curve, target: Path) -> None:
    """Both curves: every trial and the mean."""
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    figure, axes = plt.subplots(1, 2, figsize=(10, 4), sharey=True)
    shipped = SearchBudget().expansions
    panels = ((axes[0], by_count, 1.0, "expansions"), (axes[1], by_time, 1e3, "time limit of the search [ms]"))
    for axis, curve, scale, label in panels:
        limits = [scale * float(limit) for limit in curve]
        for trial in TRIALS:
            axis.plot(limits, [point[trial]["time_s"] for point in curve.values()], ".-", alpha=0.5, label=trial)
        mean = [np.mean([row["time_s"] for row in point.values()]) for point in curve.values()]
        axis.plot(limits, mean, "ko-", label="mean")
        axis.set(xscale="log", xlabel=label)
        axis.set_xticks(limits, [f"{limit:g}" for limit in limits])
        axis.minorticks_off()
        axis.grid(alpha=0.3)
    axes[0].axvline(shipped, color="firebrick", linewidth=0.8, label=f"shipped: {shipped}")
    axes[0].set_ylabel("task time [s]")
    axes[0].legend(fontsize=8)
    figure.tight_layout()
    target.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(target, dpi=110)
    plt.close(figure)
