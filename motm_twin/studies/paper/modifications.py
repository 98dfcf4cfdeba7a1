"""Figures of single choices: each modification of the paper switched off, and sweeps of parameters."""

import math
from typing import NamedTuple

from motm_twin.control.tuning import parameter
from motm_twin.methods.registry import METHODS
from motm_twin.studies import statistics
from motm_twin.studies.groups import touches
from motm_twin.studies.paper import data
from motm_twin.studies.paper.data import Result, Store
from motm_twin.studies.paper.part import (
    BLACK,
    BLUE,
    ONE_COLUMN,
    ORANGE,
    RED,
    TWO_COLUMNS,
    Drawn,
    Missing,
    Part,
    figure,
    rows_down,
    styled,
)
from motm_twin.studies.paper.plan import LITERAL, SWEEPS, swept_scenes
from motm_twin.studies.paper.tables import group_of
from motm_twin.studies.statistics import Estimate

ABLATIONS_NAME, ABLATIONS_TITLE = "ablations", "Each modification of the paper switched off alone"
OURS = "motm"


class Ablation(NamedTuple):
    """The trials of one group without a modification."""

    method: str
    group: str  # of the results table: published and random arrangements are never in one mean
    results: list[Result]
    slower: Estimate

    @property
    def title(self) -> str:
        """Title of the modification that is left out."""
        return data.title(self.method)


def compared(store: Store) -> list[Ablation]:
    """Every modification in every group of trials, and the paper as printed."""
    ours = data.times(store.of("exp1", method=OURS))
    ablated = [(name, store.of("ablations", method=name)) for name in store.methods("ablations") if name != OURS]
    found = []
    for method, results in [*ablated, (LITERAL, store.of("exp1", method=LITERAL))]:
        for group in dict.fromkeys(map(group_of, results)):
            own = [result for result in results if group_of(result) == group]
            found.append(Ablation(method, group, own, statistics.paired_difference(data.times(own), ours)))
    return found if ours else []


def draw_ablations(store: Store) -> Part:
    """A dot with its interval for each modification, and the verdict."""
    found = compared(store)
    if not found:
        reason = "no modification, or not motm itself, was run"
        return Missing(name=ABLATIONS_NAME, title=ABLATIONS_TITLE, reason=reason)
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
        rows_down(axes, named, "slower than the whole method by [s]")
        axes.grid(axis="x")
    return Drawn(
        name=ABLATIONS_NAME,
        title=ABLATIONS_TITLE,
        caption=(
            "Paired by arrangement and seed on Experiment 1, with Student's 95 % interval; right of zero: the "
            "modification saves time. Filled: the interval excludes zero. Open: no effect is shown by these trials."
        ),
        n="; ".join(f"{name}: {each.slower.n} pairs" for name, each in zip(named, found, strict=True)),
        rows=[_ablation_row(each) for each in found],
        cells=[_cells(each) for each in found],
        figure=fig,
        notes=_notes(found),
    )  # fmt: skip


def shown(slower: Estimate) -> bool:
    """The interval excludes zero."""
    return slower.low > 0.0 or slower.high < 0.0


def verdict(slower: Estimate, results: list[Result]) -> str:
    """Verdict of the trials on a modification, in a few words."""
    placed, wanted = data.placed(results)
    harm = f"without it {wanted - placed} of {wanted} objects are not placed; " if placed < wanted else ""
    hits = data.contacts(results)
    harm += f"without it {hits} contact(s); " if hits else ""
    if slower.n < 2:
        return harm + "too few trials to say"
    if not shown(slower):
        return harm + "no effect on time shown"
    return harm + ("saves time" if slower.value > 0.0 else "costs time here")


def _ablation_row(found: Ablation) -> dict:
    method, group, results, slower = found
    placed, wanted = data.placed(results)
    return {
        "method": method, "experiment": group,
        "slower_s": slower.value, "low_s": slower.low, "high_s": slower.high, "pairs": slower.n,
        "placed": placed, "wanted": wanted, "contacts": data.contacts(results),
        "all_contacts": touches(results), "verdict": verdict(slower, results),
    }  # fmt: skip


def _cells(found: Ablation) -> dict[str, str]:
    method, group, results, slower = found
    placed, wanted = data.placed(results)
    return {
        "Without": found.title,
        "Paper": METHODS[method].source if method in METHODS else "",
        "Experiment": group,
        "Slower by, mean [95 % CI] [s]": slower.text(1),
        "Pairs": str(slower.n),
        "Objects placed": f"{placed}/{wanted}",
        "Contacts, caused": f"{touches(results)}, {data.contacts(results)}",
        "What it shows": verdict(slower, results),
    }


def _notes(found: list[Ablation]) -> list[str]:
    several = len({each.group for each in found}) > 1
    silent = [each for each in found if each.slower.n >= 2 and not shown(each.slower)]
    names = [f"{each.title} in {each.group}" if several else each.title for each in silent]
    if not silent:
        return []
    return [
        f"No effect on the task time is shown for: {', '.join(names)}. That is not proof that there is none: the "
        "intervals say how large it may be. Experiment 1 has no obstacle that only the lidar sees, so what acts on "
        "obstacles can show nothing there."
    ]  # fmt: skip


SWEEPS_NAME, SWEEPS_TITLE = "sweeps", "Task time against the parameters of placement and heuristic"
SCENES = {  # title, marker, line, colour, share of the axis by which it is moved aside
    "exp1": ("Experiment 1", "o", "-", BLUE, 0.0),
    "exp1a": ("Experiment 1a", "D", "--", ORANGE, 0.012),
}


def points(store: Store, experiment: str) -> list[dict]:
    """For each scene and value: the slowdown against the shipped one, by trial, with its interval."""
    name = SWEEPS[experiment][0]
    return [row for scene in swept_scenes(name) for row in _of_scene(store, experiment, name, scene)]


def _of_scene(store: Store, experiment: str, name: str, scene: str) -> list[dict]:
    swept = store.of(experiment, scene=scene, method=OURS)
    shipped = [each for each in swept if not each["parameters"]]  # `bench` keeps it beside the other values
    ours = data.times([*shipped, *store.of(scene, method=OURS)])
    found: dict[float, list[Result]] = {}
    for result in swept:
        if name in result["parameters"]:
            found.setdefault(float(result["parameters"][name]), []).append(result)
    rows = []
    for value, results in sorted(found.items()):
        slower = statistics.paired_difference(data.times(results), ours)
        placed, wanted = data.placed(results)
        rows.append(
            {"parameter": name, "scene": scene, "value": value, "slower_s": slower.value, "low_s": slower.low,
             "high_s": slower.high, "pairs": slower.n, "placed": placed, "wanted": wanted}
        )  # fmt: skip
    return rows


def draw_sweeps(store: Store) -> Part:
    """One panel per parameter; the shipped value and the paper's are marked."""
    swept = {name: points(store, name) for name in SWEEPS}
    found = {name: rows for name, rows in swept.items() if any(row["pairs"] for row in rows)}
    if not found:
        return Missing(name=SWEEPS_NAME, title=SWEEPS_TITLE, reason="no other value of a parameter was completed")
    with styled():
        fig = figure(TWO_COLUMNS, 60.0)
        axes = fig.subplots(1, len(found), squeeze=False, sharey=True)[0]
        for panel, (name, rows) in zip(axes, found.items(), strict=True):
            _panel(panel, SWEEPS[name][0], [row for row in rows if row["pairs"]])
        axes[0].set_ylabel("slower than as shipped by [s]")
        handles = {h.get_label(): h for panel in axes for h in panel.get_legend_handles_labels()[0]}
        fig.legend(handles=list(handles.values()), loc="outside lower center", ncols=len(handles))
    rows = [row for each in found.values() for row in each]
    return Drawn(
        name=SWEEPS_NAME,
        title=SWEEPS_TITLE,
        caption=(
            "Paired by arrangement with the shipped value (square, 0 by definition); bars are Student's 95 % "
            "intervals. Open: not every object was placed with this value. Dotted: the paper's value. The largest ring "
            "is swept on Experiment 1a, too: Experiment 1 needs none beyond 0.7 m."
        ),
        n=", ".join(f"{row['parameter']} = {row['value']:g} ({row['scene']}): {row['pairs']}" for row in rows)
        + " pairs",
        rows=rows,
        figure=fig,
    )


def _panel(axes, name: str, rows: list[dict]) -> None:
    about = parameter(name)
    shipped = float(about.default)
    span = max(abs(row["value"] - shipped) for row in rows)
    for scene in dict.fromkeys(row["scene"] for row in rows):
        _line(axes, shipped, [row for row in rows if row["scene"] == scene], span)
    axes.plot(shipped, 0.0, "s", mfc="white", mec=BLACK, ms=5.5, zorder=5)
    if about.paper is not None:
        axes.axvline(float(about.paper), ls=":", color=RED, lw=1.0, zorder=1)
    axes.axhline(0.0, color=BLACK, lw=0.5, zorder=1)
    axes.set_xlabel(about.title + (f" [{about.unit}]" if about.unit else ""))
    axes.grid(axis="y")


def _line(axes, shipped: float, rows: list[dict], span: float) -> None:
    """The values of one scene, a little aside so that equal ones are seen beside each other."""
    title, marker, line, colour, aside = SCENES[rows[0]["scene"]]
    drawn = sorted([*((row["value"] + aside * span, row["slower_s"]) for row in rows), (shipped, 0.0)])
    axes.plot(*zip(*drawn, strict=True), line, marker=marker, ms=0, color=colour, lw=1.0, zorder=2)
    for row in rows:
        at, whole = row["value"] + aside * span, row["placed"] == row["wanted"]
        if math.isfinite(row["low_s"]):
            axes.plot([at] * 2, [row["low_s"], row["high_s"]], "-", color=BLACK, lw=1.0, zorder=3)
        axes.plot(at, row["slower_s"], marker, mfc=colour if whole else "white", mec=BLACK, mew=0.5, zorder=4)
    axes.plot([], [], line, marker=marker, mec=BLACK, mew=0.5, color=colour, label=title)
