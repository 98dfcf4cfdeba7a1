"""What each modification of the paper is worth: task time without it, by trial, against the whole method."""

import math
from typing import NamedTuple

from motm_twin.bench.experiments import statistics
from motm_twin.bench.experiments.statistics import Estimate
from motm_twin.bench.paper import data
from motm_twin.bench.paper.data import Result, Store
from motm_twin.bench.paper.part import Drawn, Missing, Part
from motm_twin.bench.paper.plan import LITERAL
from motm_twin.bench.paper.results_table import group_of
from motm_twin.bench.paper.style import BLACK, BLUE, ONE_COLUMN, figure, styled
from motm_twin.methods.registry import METHODS

NAME, TITLE = "ablations", "Each modification of the paper switched off alone"
OURS = "motm"
HEADER = (
    "Without",
    "Paper",
    "Experiment",
    "Slower by, mean [95 % CI] [s]",
    "Pairs",
    "Objects placed",
    "Contacts, caused",
    "What it shows",
)


class Without(NamedTuple):
    """The trials of one group without a modification."""

    method: str
    group: str  # of the results table: published and random arrangements are never in one mean
    results: list[Result]
    slower: Estimate

    @property
    def title(self) -> str:
        """What is left out."""
        return data.title(self.method)


def compared(store: Store) -> list[Without]:
    """Every modification in every group of trials, and the paper as printed."""
    ours = data.times(store.of("exp1", method=OURS))
    ablated = [(name, store.of("ablations", method=name)) for name in store.methods("ablations") if name != OURS]
    found = []
    for method, results in [*ablated, (LITERAL, store.of("exp1", method=LITERAL))]:
        for group in dict.fromkeys(map(group_of, results)):
            own = [result for result in results if group_of(result) == group]
            found.append(Without(method, group, own, statistics.paired_difference(data.times(own), ours)))
    return found if ours else []


def draw(store: Store) -> Part:
    """A dot with its interval for each modification, and what can be said of it."""
    found = compared(store)
    if not found:
        return Missing(name=NAME, title=TITLE, reason="no modification, or not motm itself, was run")
    with styled():
        fig = figure(ONE_COLUMN, 16.0 + 6.0 * len(found))
        axes = fig.add_subplot()
        for row, (*_, slower) in enumerate(found):
            if slower.n and math.isfinite(slower.low):
                axes.plot([slower.low, slower.high], [row, row], "-", color=BLACK, lw=1.2, solid_capstyle="butt")
            if slower.n:
                clear = shown(slower)
                axes.plot(slower.value, row, "o", mfc=BLUE if clear else "white", mec=BLACK, ms=5)
        axes.axvline(0.0, color=BLACK, lw=0.6)
        several = len({each.group for each in found}) > 1
        named = [f"{each.title} ({each.group})" if several else each.title for each in found]
        axes.set_yticks(range(len(found)), named)
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
        n="; ".join(f"{name}: {each.slower.n} pairs" for name, each in zip(named, found, strict=True)),
        rows=[_row(each) for each in found],
        header=HEADER,
        cells=[_cells(each) for each in found],
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


def _row(found: Without) -> dict:
    method, group, results, slower = found
    placed, wanted = data.placed(results)
    return {
        "method": method, "experiment": group,
        "slower_s": slower.value, "low_s": slower.low, "high_s": slower.high, "pairs": slower.n,
        "placed": placed, "wanted": wanted, "contacts": data.contacts(results),
        "all_contacts": data.touches(results), "verdict": verdict(slower, results),
    }  # fmt: skip


def _cells(found: Without) -> tuple[str, ...]:
    method, group, results, slower = found
    placed, wanted = data.placed(results)
    source = METHODS[method].source if method in METHODS else ""
    return (
        found.title, source, group, slower.text(1), str(slower.n), f"{placed}/{wanted}",
        f"{data.touches(results)}, {data.contacts(results)}",
        verdict(slower, results),
    )  # fmt: skip


def _notes(found: list[Without]) -> list[str]:
    several = len({each.group for each in found}) > 1
    silent = [
        f"{each.title} in {each.group}" if several else each.title
        for each in found
        if each.slower.n >= 2 and not shown(each.slower)
    ]
    if not silent:
        return []
    return [
        f"No effect on the task time is shown for: {', '.join(silent)}. That is not proof that there is none: the "
        "intervals "
        "say how large it may be. Experiment 1 has no obstacle that only the lidar sees, so what acts on obstacles "
        "can show "
        "nothing there."
    ]  # fmt: skip
