"""Task time against the weight of the next target, the Bezier offset and the ring radii."""

import math

from motm_twin.bench.experiments import statistics
from motm_twin.bench.paper import data
from motm_twin.bench.paper.data import Store
from motm_twin.bench.paper.part import Drawn, Missing, Part
from motm_twin.bench.paper.plan import SWEEPS
from motm_twin.bench.paper.style import BLACK, BLUE, RED, TWO_COLUMNS, figure, styled
from motm_twin.control.tuning import parameter

NAME, TITLE = "sweeps", "Task time against the parameters of placement and heuristic"
COMMAND = "motm-twin paper --only sweeps"


def points(store: Store, experiment: str) -> list[dict]:
    """For each value: how much slower than the shipped one, by trial, with its interval; the shipped one is 0."""
    name = SWEEPS[experiment][0]
    ours = data.times(store.of("exp1", method="motm"))
    results = [result for result in store.of(experiment, scene="exp1") if name in result["parameters"]]
    values = sorted({float(result["parameters"][name]) for result in results})
    rows = []
    for value in values:
        these = [result for result in results if float(result["parameters"][name]) == value]
        slower = statistics.paired_difference(data.times(these), ours)
        placed, wanted = data.placed(these)
        rows.append(
            {"parameter": name, "value": value, "slower_s": slower.value, "low_s": slower.low, "high_s": slower.high,
             "pairs": slower.n, "placed": placed, "wanted": wanted}
        )  # fmt: skip
    return rows


def draw(store: Store) -> Part:
    """One panel per parameter; the shipped value and the paper's are marked."""
    found = {name: rows for name in SWEEPS if (rows := [row for row in points(store, name) if row["pairs"]])}
    if not found:
        return Missing(
            name=NAME,
            title=TITLE,
            reason="no sweep was run (--full has them all)",
            command="motm-twin bench sweep_next_weight --out out/paper",
        )
    with styled():
        fig = figure(TWO_COLUMNS, 30.0 + 30.0 * ((len(found) + 3) // 4))
        axes = fig.subplots(1, len(found), squeeze=False, sharey=True)[0]
        for panel, (name, rows) in zip(axes, found.items(), strict=True):
            _panel(panel, SWEEPS[name][0], rows)
        axes[0].set_ylabel("slower than as shipped by [s]")
    rows = [row for each in found.values() for row in each]
    return Drawn(
        name=NAME,
        title=TITLE,
        caption=(
            "Paired by arrangement with the shipped value (square, 0 by definition) on Experiment 1; bars are "
            "Student's 95 % "
            "intervals. Dotted: the paper's value."
        ),
        command=COMMAND,
        n=", ".join(f"{row['parameter']} = {row['value']:g}: {row['pairs']}" for row in rows) + " pairs",
        rows=rows,
        figure=fig,
    )  # fmt: skip


def _panel(axes, name: str, rows: list[dict]) -> None:
    about = parameter(name)
    shipped = float(about.default)
    drawn = sorted([*((row["value"], row["slower_s"]) for row in rows), (shipped, 0.0)])
    axes.plot(*zip(*drawn, strict=True), "-", color=BLUE, lw=1.0, zorder=2)
    for row in rows:
        if math.isfinite(row["low_s"]):
            axes.plot([row["value"]] * 2, [row["low_s"], row["high_s"]], "-", color=BLACK, lw=1.0, zorder=3)
        axes.plot(row["value"], row["slower_s"], "o", mfc=BLUE, mec=BLACK, mew=0.5, zorder=4)
    axes.plot(shipped, 0.0, "s", mfc="white", mec=BLACK, ms=5.5, zorder=5)
    if about.paper is not None:
        axes.axvline(float(about.paper), ls=":", color=RED, lw=1.0, zorder=1)
    axes.axhline(0.0, color=BLACK, lw=0.5, zorder=1)
    axes.set_xlabel(about.title + (f" [{about.unit}]" if about.unit else ""))
    axes.grid(axis="y")
