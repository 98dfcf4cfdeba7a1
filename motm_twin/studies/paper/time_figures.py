"""Figures of task times: box plots of all methods, time per phase, and reductions beside the published ones."""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from motm_twin.measures.references import REDUCTIONS, TABLE_I
from motm_twin.studies import statistics
from motm_twin.studies.paper import data
from motm_twin.studies.paper.data import Result, Store
from motm_twin.studies.paper.drawing import (
    BLACK,
    BLUE,
    GREEN,
    GREY,
    ONE_COLUMN,
    ORANGE,
    PALE,
    RED,
    TWO_COLUMNS,
    Drawn,
    Missing,
    Part,
    figure,
    look,
    rows_down,
    styled,
)
from motm_twin.studies.paper.tables import GROUPS
from motm_twin.studies.statistics import COMPLETED, TOUCHED, Estimate, touches

PANELS: tuple[tuple[str, str, Callable[[list[Result]], list[Result]]], ...] = (
    ("exp1", "Experiment 1, published arrangements", data.ten),
    ("exp1", "Experiment 1, random", data.random),
    ("exp1a", "Experiment 1a, published arrangements", data.ten),
    ("exp1a", "Experiment 1a, random", data.random),
)
FEW = 5  # no box for fewer points
SPREAD = 0.16  # vertical jitter of the points, in rows


def draw_box_plots(store: Store) -> Part:
    """One panel for each group of trials with times of more than one method."""
    panels = [
        (title, experiment, found)
        for experiment, title, choose in PANELS
        if len(found := _times(store, experiment, choose)) > 1
    ]
    if not panels:
        return Missing(reason="no trial of Experiments 1 or 1a was completed by two methods")
    methods = list(dict.fromkeys(method for *_, found in panels for method in found))
    with styled():
        fig = figure(TWO_COLUMNS, 22.0 + 5.2 * len(methods) * ((len(panels) + 1) // 2))
        axes = fig.subplots((len(panels) + 1) // 2, min(2, len(panels)), squeeze=False, sharex=True, sharey=True)
        for panel, (title, experiment, found) in zip(axes.flat, panels, strict=False):
            _panel(panel, methods, found, _touched(store, experiment), experiment == "exp1" and "published" in title)
            panel.set_title(title)
        for unused in list(axes.flat)[len(panels) :]:
            unused.set_axis_off()
            axes[-2][-1].tick_params(labelbottom=True)  # the panel above an empty place needs its own numbers
        fig.legend(handles=_handles(axes.flat[0]), loc="outside lower center", ncols=3)
    rows = [
        {"panel": title, "method": method, "variant": key[0], "seed": key[1], "time_s": value,
         "with_contacts": (method, key) in _touched(store, experiment)}
        for title, experiment, found in panels
        for method, values in found.items()
        for key, value in values.items()
    ]  # fmt: skip
    return Drawn(
        caption=(
            "Boxes: quartiles and median; whiskers: the furthest trial within 1.5 times the box; every completed trial "
            f"is a point, open where the robot caused contacts, and with fewer than {FEW} there is no box. {COMPLETED} "
            f"{TOUCHED} Diamonds: published numbers of the simulated Experiment 1 (Table I; Reister's include 40 s for "
            "grasping). The paper's own box plots have no numbers that could be drawn, and of Experiment 1a none are "
            "published at all."
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
    rng = np.random.default_rng(0)  # only for the jitter of the points
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
    rows_down(axes, [data.title(method) for method in methods], "task time [s]")
    axes.grid(axis="x")


def _handles(axes) -> list:
    dot = {"mec": BLACK, "mew": 0.5, "ms": 2.6, "ls": ""}
    return [
        *axes.plot([], [], "D", mfc="white", mec=RED, mew=1.4, ms=5.5, label="published, Table I"),
        *axes.plot([], [], "o", mfc=BLACK, label="one trial", **dot),
        *axes.plot([], [], "o", mfc="none", label="one trial, with contacts", **dot),
    ]


PHASES = {  # phase of `Measures`: colour, hatch, label
    "driving": (BLUE, "", "base driving"),
    "closing": (GREEN, "....", "fingers closing"),
    "waiting_for_arm": (ORANGE, "////", "base waits for the arm"),
    "stationary": (PALE, "\\\\\\\\", "standing for another reason"),
}
EXPERIMENTS = {"exp1": "Experiment 1, published arrangements", "exp1a": "Experiment 1a, published arrangements"}


def split(store: Store, experiment: str, method: str) -> dict[str, float]:
    """Mean time [s] of each phase over the completed published trials; empty when no phase was measured."""
    results = [each for each in data.ten(store.of(experiment, method=method)) if data.completed(each)]
    values = {phase: [data.measure(each, "phases_s", phase) for each in results] for phase in PHASES}
    known = {phase: [each for each in these if each is not None] for phase, these in values.items()}
    return {phase: statistics.mean(these).value for phase, these in known.items() if these}


def draw_time_split(store: Store) -> Part:
    """One stacked bar per method with the mean time of each phase."""
    found = {
        experiment: {
            method: parts for method in store.methods(experiment) if (parts := split(store, experiment, method))
        }
        for experiment in EXPERIMENTS
    }
    found = {experiment: methods for experiment, methods in found.items() if methods}
    if not found:
        return Missing(reason="no trial of Experiment 1 or 1a has its time split")
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
        rows_down(axes[0], [data.title(name) for name in names], "time [s]")
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
        caption=(
            "Mean times of the completed trials. The base may move while the fingers close: 'closing' is taken from "
            "the rest, whatever the base does meanwhile."
        ),
        n="; ".join(
            f"{EXPERIMENTS[experiment]}: "
            + ", ".join(f"{data.title(m)} {len(data.times(data.ten(store.of(experiment, method=m))))}" for m in methods)
            for experiment, methods in found.items()
        ),
        rows=rows,
        figure=fig,
    )  # fmt: skip


OURS = "motm"
MARKS = dict(zip((name for _, name, _ in GROUPS), "ov*s<^X", strict=True))
GROUP_WIDTH, BETWEEN = 0.8, 0.16  # [rows] largest height of all marks of a rival, and largest step between two marks


class Compared(NamedTuple):
    """A rival in one group of trials."""

    experiment: str
    group: str
    rival: str
    share: Estimate  # saved share of the rival's time
    saved: Estimate  # saved time [s]
    contacts: int  # that the rival caused in the compared trials
    own: int  # that our method caused in them
    touches: tuple[int, int] = (0, 0)  # all contacts: the rival's and ours

    @property
    def clean(self) -> bool:
        """True when neither method caused a contact, so that the times are comparable."""
        return not self.contacts and not self.own

    @property
    def published(self) -> float | None:
        """The published reduction; None: not published."""
        return REDUCTIONS.get(self.experiment, (None, ""))[0] if self.rival == "sequential" else None


def compared(store: Store) -> list[Compared]:
    """Every rival in every group, over the trials that both methods completed."""
    found = [
        _compared(experiment, name, rival, choose(store.of(experiment, method=OURS)), choose(theirs))
        for experiment, name, choose in GROUPS
        for rival in store.methods(experiment)
        if rival != OURS and (theirs := store.of(experiment, method=rival))
    ]
    return [each for each in found if each.share.n]


def _compared(experiment: str, group: str, rival: str, ours: list[Result], theirs: list[Result]) -> Compared:
    own, other = data.times(ours), data.times(theirs)
    share, saved = (turned(each(own, other)) for each in (statistics.paired_ratio, statistics.paired_difference))
    ours, theirs = ([each for each in these if data.key(each) in own.keys() & other.keys()] for these in (ours, theirs))
    hits = touches(theirs), touches(ours)
    return Compared(experiment, group, rival, share, saved, data.contacts(theirs), data.contacts(ours), hits)


def turned(estimate: Estimate) -> Estimate:
    """The estimate with the opposite sign."""
    return Estimate(value=-estimate.value, low=-estimate.high, high=-estimate.low, n=estimate.n)


def draw_reductions(store: Store) -> Part:
    """A mark with its interval for each rival and group, open where there were contacts; diamonds: published."""
    found = compared(store)
    if not found:
        return Missing(reason="no rival completed a trial that motm completed")
    rivals = list(dict.fromkeys(each.rival for each in found))
    groups = [name for name in MARKS if any(each.group == name for each in found)]
    step = min(BETWEEN, GROUP_WIDTH / len(groups))
    last = {each.experiment: each for each in found if each.published is not None}  # draws the published mark, once
    with styled():
        fig = figure(ONE_COLUMN, 30.0 + (4.0 + 1.6 * len(groups)) * len(rivals))
        axes = fig.add_subplot()
        for each in found:
            at = rivals.index(each.rival) + step * (groups.index(each.group) - 0.5 * (len(groups) - 1))
            share, colour = each.share, look(each.rival).colour if each.clean else "white"
            if math.isfinite(share.low):
                axes.plot([100 * share.low, 100 * share.high], [at, at], "-", color=BLACK, lw=1.0)
            axes.plot(100 * share.value, at, MARKS[each.group], mfc=colour, mec=BLACK, mew=0.6, ms=5, zorder=3)
            if each.published is not None and each is last[each.experiment]:
                axes.plot(100 * each.published, at, "D", mfc="white", mec=RED, mew=1.4, ms=4.5)
        axes.axvline(0.0, color=BLACK, lw=0.6)
        rows_down(axes, [data.title(rival) for rival in rivals], "reduction of the task time [%]")
        axes.grid(axis="x")
        for name in groups:
            axes.plot([], [], MARKS[name], mfc=GREY, mec=BLACK, mew=0.6, ms=5, ls="", label=f"Experiment {name}")
        if not all(each.clean for each in found):
            label = "open: with contacts, compares with nothing"
            axes.plot([], [], "o", mfc="white", mec=BLACK, mew=0.6, ms=5, ls="", label=label)
        axes.plot([], [], "D", mfc="white", mec=RED, mew=1.4, ms=4.5, ls="", label="published, other rivals' times")
        fig.legend(loc="outside lower center", ncols=1)
    return Drawn(
        caption=(
            "Mean over trials of 1 - ours/theirs, same arrangement and seed, both completed, with Student's 95 % "
            f"interval. {COMPLETED} Open marks: one of the two caused contacts in these trials. {TOUCHED} The "
            "published 43 % (Experiment 1) and 46 % (1a) compare the paper's times with the times that "
            "Reister et al. published for another robot, plus 40 s for grasping; ours compare two methods on the same "
            "robot. The published 48 % are of one arrangement on real robots."
        ),
        n=f"{sum(each.share.n for each in found)} pairs of trials; of each rival in its row",
        rows=[_row(each) for each in found],
        facts={"published": {name: share for name, (share, _) in REDUCTIONS.items()}},
        cells=[_cells(each) for each in found],
        figure=fig,
        notes=[*touched(found), *why(store)],
    )


def _row(each: Compared) -> dict:
    share, saved = each.share, each.saved
    return {
        "experiment": each.group, "rival": each.rival, "reduction": share.value, "low": share.low, "high": share.high,
        "saved_s": saved.value, "saved_low_s": saved.low, "saved_high_s": saved.high, "pairs": share.n,
        "contacts": each.contacts, "own_contacts": each.own,
        "all_contacts": each.touches[0], "own_all_contacts": each.touches[1], "comparable": each.clean,
        "published_reduction": each.published,
    }  # fmt: skip


def _cells(each: Compared) -> dict[str, str]:
    return {
        "Experiment": each.group,
        "Rival": data.title(each.rival),
        "Reduction, mean [95 % CI]": data.percent(each.share) + ("" if each.clean else ", with contacts"),
        "Seconds saved, mean [95 % CI]": each.saved.text(1),
        "Pairs": str(each.share.n),
        "Contacts caused by the rival, by ours": f"{each.contacts}, {each.own}",
        "All contacts": f"{each.touches[0]}, {each.touches[1]}",
        "Published reduction": "-" if each.published is None else f"{100 * each.published:.0f} %",
    }


def touched(found: list[Compared]) -> list[str]:
    """One sentence on the rivals whose times are not comparable; none: an empty list."""
    hits = [
        f"{data.title(each.rival)} in {each.group}: {each.contacts} by it, {each.own} by ours (pairs: {each.share.n})"
        for each in found
        if not each.clean
    ]
    return [f"{TOUCHED} So it is with {'; '.join(hits)}."] if hits else []


def why(store: Store) -> list[str]:
    """Sentences that compare our times with the published ones, as far as there are numbers."""
    means = {method: data.mean_time(data.ten(store.of("exp1", method=method))) for method in store.methods("exp1")}
    simulated = [row for row in TABLE_I if not row.real and row.like in means and means[row.like].n]
    sentences = [_rival(row.method, row.seconds, means[row.like]) for row in simulated if row.like != OURS]
    ours = data.mean_time(data.ten(store.of("exp1", method=OURS)))
    for row in TABLE_I:
        if ours.n and row.like == "sequential" and not row.real:
            sentences.append(
                f"Against the published {row.seconds} s of {row.method}, with another robot in another simulation, "
                "our mean of "
                f"{ours.value:.1f} s is a reduction of {100 * (1 - ours.value / row.seconds):.0f} % (published: 43 %)."
            )
    first = [store.of("exp1", method=method, variant="trial1", seed=0) for method in (OURS, "sequential")]
    single = [list(data.times(results).values()) for results in first]
    if all(single):
        share = 100 * (1 - single[0][0] / single[1][0])
        sentences.append(
            f"On the arrangement of trial 1 ours takes {single[0][0]:.1f} s and the sequential method "
            f"{single[1][0]:.1f} s here, {share:.0f} % less; published on real robots: 91 s and 176 s, 48 % less."
        )
    literal = data.mean_time(data.ten(store.of("exp1", method="paper_literal")))
    paper = next(row.seconds for row in TABLE_I if row.like == OURS and not row.single and not row.real)
    if ours.n:
        sentences.append(
            f"The paper's own method takes {ours.text()} s here (n = {ours.n}) and {paper} s in the paper's simulation."
        )
    if ours.n and literal.n:
        sentences.append(
            f"With the termination as printed and STAA*'s proximity grid it takes {literal.text()} s here "
            f"(n = {literal.n}): what is left of the difference to {ours.value:.1f} s is due to those two choices, "
            "which docs/method.md explains."
        )
    return sentences


def _rival(name: str, published: float, here: Estimate) -> str:
    """Sentence with a rival's published time and its time here."""
    text = f"{name}: published {published} s, here {here.text()} s (n = {here.n})."
    if here.value >= published:
        return text
    return text + (
        " Ours is quicker because it is built to be: the same base controller and limits as the paper's method, a "
        "grasp as quick as a stationary one can be instead of the 40 s that the paper adds for six, no time for "
        "computing, and a map, objects and a robot that a simulation has and a laboratory has not. How fast the robot "
        "of Reister et al. drove is not in the paper, so how much of the difference is speed cannot be said."
    )
