"""The search as an anytime algorithm: task time over its limit of expansions, and over a limit of processor time.

What is in ``out/anytime.json`` already is not run again, if it is of the same method and sources.
"""

import json
import time
from collections import deque
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from motm_twin.methods.registry import FAST
from motm_twin.model.scene_file import load_scene
from motm_twin.perf.period import one_core
from motm_twin.perf.report import grid, load_average, machine, save_picture, write
from motm_twin.planning.types import SearchBudget
from motm_twin.server_process import SEARCH_SECONDS
from motm_twin.sessions.session import made_with
from motm_twin.twin import Twin

NAME = "anytime"
TITLE = "Anytime: task time over the expansions and over the time that the search may take"
TRIALS = ("exp1 trial1", "exp1 trial3", "exp1 trial8", "exp1a trial1")  # not Experiment 2: its times are of chance
EXPANSIONS = (50, 100, 200, 300, 500, 1000, 2000)
SECONDS = (0.001, 0.002, 0.005, 0.010, 0.020, 0.040)  # [s] with up to 2,000 expansions; `serve` has 0.020
PICTURE = Path("docs/performance_anytime.png")
Curve = dict[str, dict[str, Any]]  # results by limit, then by trial


def bench_anytime(out: Path, console: Console, *, quick: bool = False) -> bool:
    """Measure both curves, print, write ``out/anytime.json`` and the picture. Takes about 8 minutes.

    ``quick``: one trial with 50 expansions, and no picture. There is no number to reach; True when all trials end.
    """
    console.print(f"\n[bold]{NAME}[/bold]: {TITLE}")
    trials, limits = (TRIALS[:1], EXPANSIONS[:1]) if quick else (TRIALS, EXPANSIONS)
    kept = out / f"{NAME}.json"
    found = json.loads(kept.read_text()) if kept.exists() else {}
    ours = {"method": FAST.name, **made_with()}
    by_count, by_time = (found[name] if found.get("of") == ours else {} for name in ("expansions", "seconds"))

    def keep() -> None:
        write(kept, {"machine": machine(), "of": ours, "expansions": by_count, "seconds": by_time})

    with one_core():
        _curve(by_count, trials, limits, lambda limit: SearchBudget(expansions=int(limit)), console, keep)
        if not quick:
            most = EXPANSIONS[-1]
            _curve(by_time, trials, SECONDS, lambda t: SearchBudget(expansions=most, seconds=t), console, keep)
    console.print(curve_table("expansions", by_count))
    if by_time:
        console.print(curve_table("seconds", by_time))
    load_average(console)
    if not quick:
        plot(by_count, by_time, PICTURE)
    return all(row["success"] for curve in (by_count, by_time) for point in curve.values() for row in point.values())


def _curve(
    curve: Curve, trials: Sequence[str], limits: Sequence[float], budget: Callable[[float], SearchBudget],
    console: Console, keep: Callable[[], None],
) -> None:  # fmt: skip
    """Fill in what is missing of a curve."""
    for limit in limits:
        point = curve.setdefault(f"{limit:g}", {})
        for trial in trials:
            if trial not in point:
                point[trial] = _run(trial, budget(limit))
                keep()
        times = ", ".join(f"{row['time_s']:.1f}" for row in point.values())
        console.print(f"  {limit:g}: {times} s", markup=False)


def _run(trial: str, budget: SearchBudget) -> dict[str, Any]:
    """One trial with a limit; its time [s] and whether it was completed."""
    scene, variant = trial.split()
    twin = Twin(load_scene(scene, variant), method=FAST, budget=budget, clock=time.thread_time)
    (last,) = deque(twin.ticks(), maxlen=1)
    return {"success": last.success, "time_s": round(last.time, 2)}


def curve_table(name: str, curve: Curve) -> Table:
    """Task time of every trial [s] and their mean, by limit."""
    table = grid(name, *next(iter(curve.values())), "mean s", texts=())
    for limit, point in curve.items():
        times = [row["time_s"] if row["success"] else float("nan") for row in point.values()]
        table.add_row(limit, *(f"{seconds:.1f}" for seconds in times), f"{np.mean(times):.1f}")
    return table


def plot(by_count: Curve, by_time: Curve, target: Path) -> None:
    """Both curves: every trial and the mean."""
    from matplotlib.figure import Figure

    shipped = SearchBudget().expansions
    curves = [(by_count, 1.0, "expansions"), (by_time, 1e3, "time limit of the search [ms]")][: 2 if by_time else 1]
    figure = Figure(figsize=(5 * len(curves), 4))
    axes = figure.subplots(1, len(curves), sharey=True, squeeze=False)[0]
    for axis, (curve, scale, label) in zip(axes, curves, strict=True):
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
    if by_time:
        axes[-1].axvline(1e3 * SEARCH_SECONDS, color="firebrick", linewidth=0.8)
        axes[-1].set_title(f"red: `serve` and its {1e3 * SEARCH_SECONDS:g} ms", fontsize=8, loc="right")
    axes[0].set_ylabel("task time [s]")
    axes[0].legend(fontsize=7, ncols=3, loc="lower left", bbox_to_anchor=(0.0, 1.0), frameon=False, borderaxespad=0.2)
    save_picture(figure, target)
