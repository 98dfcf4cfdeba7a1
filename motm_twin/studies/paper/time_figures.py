"""Figures of task times: box plots of all methods, and time by part."""

from collections.abc import Callable

import numpy as np

from motm_twin.measures.published import TABLE_I
from motm_twin.studies import statistics
from motm_twin.studies.paper import data
from motm_twin.studies.paper.data import Result, Store
from motm_twin.studies.paper.part import Drawn, Missing, Part
from motm_twin.studies.paper.style import BLACK, BLUE, GREEN, ORANGE, PALE, RED, TWO_COLUMNS, figure, look, styled
from motm_twin.studies.summary import COMPLETED, TOUCHED

BOXES_NAME, BOXES_TITLE = "box_plots", "Task times of Experiments 1 and 1a"
PANELS: tuple[tuple[str, str, Callable[[list[Result]], list[Result]]], ...] = (
    ("exp1", "Experiment 1, published arrangements", data.ten),
    ("exp1", "Experiment 1, random", data.random),
    ("exp1a", "Experiment 1a, published arrangements", data.ten),
    ("exp1a", "Experiment 1a, random", data.random),
)
FEW = 5  # below this many points a box says more than is known
SPREAD = 0.16  # of the points beside each other


def draw_box_plots(store: Store) -> Part:
    """One panel for each experiment with times of more than one method."""
    panels = [
        (title, experiment, found)
        for experiment, title, choose in PANELS
        if (found := _times(store, experiment, choose))
    ]
    panels = [panel for panel in panels if len(panel[2]) > 1]
    if not panels:
        return Missing(
            name=BOXES_NAME,
            title=BOXES_TITLE,
            reason="no trial of Experiments 1 or 1a was completed by two methods",
        )
    methods = list(dict.fromkeys(method for *_, found in panels for method in found))
    with styled():
        fig = figure(TWO_COLUMNS, 22.0 + 5.2 * len(methods) * ((len(panels) + 1) // 2))
        axes = fig.subplots((len(panels) + 1) // 2, min(2, len(panels)), squeeze=False, sharex=True, sharey=True)
        for panel, (title, experiment, found) in zip(axes.flat, panels, strict=False):
            _panel(panel, methods, found, _touched(store, experiment), experiment == "exp1" and "published" in title)
            panel.set_title(title)
        for unused in list(axes.flat)[len(panels) :]:
            unused.set_axis_off()
            axes[-2][-1].tick_params(labelbottom=True)  # the one above it has no shared numbers below
        handles = [h for h in _handles(axes.flat[0])]
        fig.legend(handles=handles, loc="outside lower center", ncols=3)
    rows = [
        {
            "panel": title,
            "method": method,
            "variant": key[0],
            "seed": key[1],
            "time_s": value,
            "with_contacts": (method, key) in _touched(store, experiment),
        }
        for title, experiment, found in panels
        for method, values in found.items()
        for key, value in values.items()
    ]
    return Drawn(
        name=BOXES_NAME,
        title=BOXES_TITLE,
        caption=(
            "Boxes: quartiles and median; whiskers: the furthest trial within 1.5 times the box; every completed "
            f"trial is a point, open where the robot caused contacts, and with fewer than {FEW} there is no box. "
            f"{COMPLETED} {TOUCHED} Diamonds: published numbers of the simulated "
            "Experiment 1 (Table I; Reister's include 40 s for grasping). The paper's own box plots have no numbers "
            "that "
            "could be drawn, and of Experiment 1a none are published at all."
        ),
        n="; ".join(
            f"{title}: " + ", ".join(f"{data.title(name)} {len(each)}" for name, each in found.items())
            for title, _, found in panels
        ),
        rows=rows,
        facts={"published": [each._asdict() for each in TABLE_I if not each.real]},
        figure=fig,
    )  # fmt: skip


def _times(store: Store, experiment: str, choose: Callable) -> dict[str, dict]:
    found = {method: data.times(choose(store.of(experiment, method=method))) for method in store.methods(experiment)}
    return {method: values for method, values in found.items() if values}


def _touched(store: Store, experiment: str) -> set[tuple[str, data.Key]]:
    """Method and arrangement of the trials in which the robot caused contacts."""
    return {(each["method"], data.key(each)) for each in store.of(experiment) if data.contacts([each])}


def _panel(
    axes, methods: list[str], found: dict[str, dict], touched: set[tuple[str, data.Key]], with_published: bool
) -> None:
    rng = np.random.default_rng(0)  # only moves points apart
    for row, method in enumerate(methods):
        times = found.get(method, {})
        values = np.array(list(times.values()))
        filled = ["none" if (method, key) in touched else BLACK for key in times]
        style = look(method)
        if len(values) >= FEW:
            axes.boxplot(
                values, orientation="horizontal", positions=[row], widths=0.62, patch_artist=True, showfliers=False,
                boxprops={"facecolor": style.colour, "hatch": style.hatch, "alpha": 0.55, "edgecolor": BLACK},
                medianprops={"color": BLACK, "linewidth": 1.6},
            )  # fmt: skip
        if len(values):
            at = row + SPREAD * rng.uniform(-1.0, 1.0, len(values))
            axes.scatter(values, at, s=7, facecolors=filled, edgecolors=BLACK, linewidths=0.5, zorder=4)
        if with_published:
            for each in TABLE_I:
                if each.like == method and not each.real and not each.single:
                    axes.plot(each.seconds, row, "D", mfc="white", mec=RED, mew=1.4, ms=5.5, zorder=5)
    axes.set_yticks(range(len(methods)), [data.title(method) for method in methods])
    axes.set_ylim(len(methods) - 0.5, -0.5)
    axes.set_xlabel("task time [s]")
    axes.grid(axis="x")


def _handles(axes):
    yield axes.plot([], [], "D", mfc="white", mec=RED, mew=1.4, ms=5.5, label="published, Table I")[0]
    yield axes.plot([], [], "o", mfc=BLACK, mec=BLACK, mew=0.5, ms=2.6, ls="", label="one trial")[0]
    yield axes.plot([], [], "o", mfc="none", mec=BLACK, mew=0.5, ms=2.6, ls="", label="one trial, with contacts")[0]


SPLIT_NAME, SPLIT_TITLE = "time_split", "Where the time goes"
PHASES = {  # of `measures`: its look
    "driving": (BLUE, "", "base driving"),
    "closing": (GREEN, "....", "fingers closing"),
    "waiting_for_arm": (ORANGE, "////", "base waits for the arm"),
    "stationary": (PALE, "\\\\\\\\", "standing for another reason"),
}
EXPERIMENTS = {"exp1": "Experiment 1, published arrangements", "exp1a": "Experiment 1a, published arrangements"}


def split(store: Store, experiment: str, method: str) -> dict[str, float]:
    """Mean seconds of each phase over the completed trials; empty when none was measured."""
    results = [each for each in data.ten(store.of(experiment, method=method)) if data.completed(each)]
    values = {phase: [data.measure(each, "phases_s", phase) for each in results] for phase in PHASES}
    known = {phase: [each for each in these if each is not None] for phase, these in values.items()}
    return {phase: statistics.mean(these).value for phase, these in known.items() if these}


def draw_time_split(store: Store) -> Part:
    """One bar per method, its parts the means of the phases."""
    found = {
        experiment: {
            method: parts for method in store.methods(experiment) if (parts := split(store, experiment, method))
        }
        for experiment in EXPERIMENTS
    }
    found = {experiment: methods for experiment, methods in found.items() if methods}
    if not found:
        return Missing(name=SPLIT_NAME, title=SPLIT_TITLE, reason="no trial of Experiment 1 or 1a has its time split")
    names = list(dict.fromkeys(method for methods in found.values() for method in methods))
    with styled():
        fig = figure(TWO_COLUMNS, 26.0 + 5.0 * len(names))
        axes = fig.subplots(1, len(found), squeeze=False, sharey=True, sharex=True)[0]
        for panel, (experiment, methods) in zip(axes, found.items(), strict=True):
            for row, method in enumerate(names):
                left = 0.0
                for phase, (colour, hatch, _) in PHASES.items():
                    width = methods.get(method, {}).get(phase, 0.0)
                    panel.barh(row, width, left=left, height=0.7, color=colour, hatch=hatch, edgecolor=BLACK, lw=0.4)
                    left += width
            panel.set_title(EXPERIMENTS[experiment])
            panel.set_xlabel("time [s]")
        axes[0].set_yticks(range(len(names)), [data.title(name) for name in names])
        axes[0].set_ylim(len(names) - 0.5, -0.5)
        handles = [
            axes[0].barh(0, 0, color=c, hatch=h, edgecolor=BLACK, lw=0.4, label=t) for c, h, t in PHASES.values()
        ]
        fig.legend(handles=handles, loc="outside lower center", ncols=4)
    rows = [
        {"experiment": experiment, "method": method, **{f"{phase}_s": seconds for phase, seconds in parts.items()}}
        for experiment, methods in found.items()
        for method, parts in methods.items()
    ]
    return Drawn(
        name=SPLIT_NAME,
        title=SPLIT_TITLE,
        caption=(
            "Mean times of the completed trials. The base may move while the fingers close: 'closing' is taken from "
            "the rest, "
            "whatever the base does meanwhile."
        ),
        n="; ".join(
            f"{EXPERIMENTS[experiment]}: "
            + ", ".join(f"{data.title(m)} {len(data.times(data.ten(store.of(experiment, method=m))))}" for m in methods)
            for experiment, methods in found.items()
        ),
        rows=rows,
        figure=fig,
    )  # fmt: skip
