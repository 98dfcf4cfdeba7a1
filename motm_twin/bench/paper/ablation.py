"""What each modification of the paper is worth: task time without it, by trial, against the whole method."""

import math

from motm_twin.bench.experiments import statistics
from motm_twin.bench.experiments.statistics import Estimate
from motm_twin.bench.paper import data
from motm_twin.bench.paper.data import Result, Store
from motm_twin.bench.paper.part import Drawn, Missing, Part
from motm_twin.bench.paper.plan import LITERAL
from motm_twin.bench.paper.style import BLACK, BLUE, ONE_COLUMN, figure, styled
from motm_twin.methods.registry import METHODS

NAME, TITLE = "ablations", "Each modification of the paper switched off alone"
OURS = "motm"
HEADER = ("Without", "Paper", "Slower by, mean [95 % CI] [s]", "Pairs", "Objects placed", "Contacts", "What it shows")


def draw(store: Store) -> Part:
    """A dot with its interval for each modification, and what can be said of it."""
    ours = data.times(store.of("exp1", method=OURS))
    found = []
    for method in [name for name in store.methods("ablations") if name != OURS]:
        results = store.of("ablations", method=method)
        found.append((method, results, statistics.paired_difference(data.times(results), ours)))
    for method in [LITERAL] if store.of("exp1", method=LITERAL) else []:
        results = store.of("exp1", method=method)
        found.append((method, results, statistics.paired_difference(data.times(results), ours)))
    if not found or not ours:
        return Missing(name=NAME, title=TITLE, reason="no modification, or not motm itself, was run")
    with styled():
        fig = figure(ONE_COLUMN, 16.0 + 6.0 * len(found))
        axes = fig.add_subplot()
        for row, (_, _, slower) in enumerate(found):
            if slower.n and math.isfinite(slower.low):
                axes.plot([slower.low, slower.high], [row, row], "-", color=BLACK, lw=1.2, solid_capstyle="butt")
            if slower.n:
                clear = shown(slower)
                axes.plot(slower.value, row, "o", mfc=BLUE if clear else "white", mec=BLACK, ms=5)
        axes.axvline(0.0, color=BLACK, lw=0.6)
        axes.set_yticks(range(len(found)), [data.title(method) for method, *_ in found])
        axes.set_ylim(len(found) - 0.5, -0.5)
        axes.set_xlabel("slower than the whole method by [s]")
        axes.grid(axis="x")
    return Drawn(
        name=NAME,
        title=TITLE,
        caption=(
            "Paired by arrangement and seed on Experiment 1, with Student's 95 % interval; right of zero: the "
            "modification "
            "saves time. Filled: the interval excludes zero. Open: no effect is shown by these trials."
        ),
        n="; ".join(f"{data.title(method)}: {slower.n} pairs" for method, _, slower in found),
        rows=[_row(*each) for each in found],
        header=HEADER,
        cells=[_cells(*each) for each in found],
        figure=fig,
        notes=_notes(found),
    )  # fmt: skip


def shown(slower: Estimate) -> bool:
    """Whether the interval excludes no effect."""
    return slower.low > 0.0 or slower.high < 0.0


def verdict(slower: Estimate, results: list[Result]) -> str:
    """What the trials say of a modification, in a few words."""
    placed, wanted = data.placed(results)
    harm = f"without it {wanted - placed} of {wanted} objects are not placed; " if placed < wanted else ""
    hits = data.contacts(results)
    harm += f"without it {hits} contact(s); " if hits else ""
    if slower.n < 2:
        return harm + "too few trials to say"
    if not shown(slower):
        return harm + "no effect on time shown"
    return harm + ("saves time" if slower.value > 0.0 else "costs time here")


def _row(method: str, results: list[Result], slower: Estimate) -> dict:
    placed, wanted = data.placed(results)
    return {
        "method": method, "slower_s": slower.value, "low_s": slower.low, "high_s": slower.high, "pairs": slower.n,
        "placed": placed, "wanted": wanted, "contacts": data.contacts(results), "verdict": verdict(slower, results),
    }  # fmt: skip


def _cells(method: str, results: list[Result], slower: Estimate) -> tuple[str, ...]:
    placed, wanted = data.placed(results)
    source = METHODS[method].source if method in METHODS else ""
    return (
        data.title(method), source, slower.text(1), str(slower.n), f"{placed}/{wanted}", str(data.contacts(results)),
        verdict(slower, results),
    )  # fmt: skip


def _notes(found: list) -> list[str]:
    silent = [data.title(method) for method, results, slower in found if slower.n >= 2 and not shown(slower)]
    if not silent:
        return []
    return [
        f"No effect on the task time is shown for: {', '.join(silent)}. That is not proof that there is none: the "
        "intervals "
        "say how large it may be. Experiment 1 has no obstacle that only the lidar sees, so what acts on obstacles "
        "can show "
        "nothing there."
    ]  # fmt: skip
