"""Reduction of the task time by the paper's method against every rival, by trial, beside the published reductions."""

import math
from typing import NamedTuple

from motm_twin.measures.published import REDUCTIONS, TABLE_I
from motm_twin.studies import statistics
from motm_twin.studies.paper import data
from motm_twin.studies.paper.data import Result, Store
from motm_twin.studies.paper.part import Drawn, Missing, Part
from motm_twin.studies.paper.style import BLACK, GREY, ONE_COLUMN, RED, figure, look, styled
from motm_twin.studies.paper.tables import GROUPS
from motm_twin.studies.statistics import Estimate
from motm_twin.studies.summary import COMPLETED, TOUCHED

NAME, TITLE = "reductions", "Reduction of the task time against every rival"
OURS = "motm"
MARKS = dict(zip((name for _, name, _ in GROUPS), "ov*s<^X", strict=True))
SPREAD, BETWEEN = 0.8, 0.16  # of the distance between two rivals: all marks of one, and from one to the next at most
HEADER = (
    "Experiment",
    "Rival",
    "Reduction, mean [95 % CI]",
    "Seconds saved, mean [95 % CI]",
    "Pairs",
    "Contacts caused by the rival, by ours",
    "All contacts",
    "Published reduction",
)


class Compared(NamedTuple):
    """A rival in one group of trials."""

    experiment: str
    group: str
    rival: str
    share: Estimate  # of its time that is saved
    saved: Estimate  # [s]
    contacts: int  # that it caused in the trials compared
    own: int  # that ours caused in them
    touches: tuple[int, int] = (0, 0)  # all contacts, of the rival and of ours

    @property
    def clean(self) -> bool:
        """Neither caused a contact, so that the times say something."""
        return not self.contacts and not self.own

    @property
    def published(self) -> float | None:
        """The reduction that the paper gives."""
        return REDUCTIONS.get(self.experiment, (None, ""))[0] if self.rival == "sequential" else None


def compared(store: Store) -> list[Compared]:
    """Every rival in every group, over the trials that both completed."""
    found = [
        _compared(experiment, name, rival, choose(store.of(experiment, method=OURS)), choose(theirs))
        for experiment, name, choose in GROUPS
        for rival in store.methods(experiment)
        if rival != OURS and (theirs := store.of(experiment, method=rival))
    ]
    return [each for each in found if each.share.n]


def _compared(experiment: str, group: str, rival: str, ours: list[Result], theirs: list[Result]) -> Compared:
    own, other = data.times(ours), data.times(theirs)
    share, saved = turned(statistics.paired_ratio(own, other)), turned(statistics.paired_difference(own, other))
    ours, theirs = ([each for each in these if data.key(each) in own.keys() & other.keys()] for these in (ours, theirs))
    touches = data.touches(theirs), data.touches(ours)
    return Compared(experiment, group, rival, share, saved, data.contacts(theirs), data.contacts(ours), touches)


def turned(estimate: Estimate) -> Estimate:
    """The same with the other sign."""
    return Estimate(value=-estimate.value, low=-estimate.high, high=-estimate.low, n=estimate.n)


def draw(store: Store) -> Part:
    """A mark with its interval for each rival and group, open where there were contacts; diamonds: published."""
    found = compared(store)
    if not found:
        return Missing(name=NAME, title=TITLE, reason="no rival completed a trial that motm completed")
    rivals = list(dict.fromkeys(each.rival for each in found))
    groups = [name for name in MARKS if any(each.group == name for each in found)]
    step = min(BETWEEN, SPREAD / len(groups))
    last = {each.experiment: each for each in found if each.published is not None}  # has the published mark, once
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
        axes.set_yticks(range(len(rivals)), [data.title(rival) for rival in rivals])
        axes.set_ylim(len(rivals) - 0.5, -0.5)
        axes.set_xlabel("reduction of the task time [%]")
        axes.grid(axis="x")
        for name in groups:
            axes.plot([], [], MARKS[name], mfc=GREY, mec=BLACK, mew=0.6, ms=5, ls="", label=f"Experiment {name}")
        if not all(each.clean for each in found):
            label = "open: with contacts, compares with nothing"
            axes.plot([], [], "o", mfc="white", mec=BLACK, mew=0.6, ms=5, ls="", label=label)
        axes.plot([], [], "D", mfc="white", mec=RED, mew=1.4, ms=4.5, ls="", label="published, other rivals' times")
        fig.legend(loc="outside lower center", ncols=1)
    return Drawn(
        name=NAME,
        title=TITLE,
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
        header=HEADER,
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


def _cells(each: Compared) -> tuple[str, ...]:
    return (
        each.group, data.title(each.rival), data.percent(each.share) + ("" if each.clean else ", with contacts"),
        each.saved.text(1), str(each.share.n),
        f"{each.contacts}, {each.own}",
        f"{each.touches[0]}, {each.touches[1]}",
        "-" if each.published is None else f"{100 * each.published:.0f} %",
    )  # fmt: skip


def touched(found: list[Compared]) -> list[str]:
    """One sentence on the rivals whose times compare with nothing."""
    hits = [
        f"{data.title(each.rival)} in {each.group}: {each.contacts} by it, {each.own} by ours (pairs: {each.share.n})"
        for each in found
        if not each.clean
    ]
    return [f"{TOUCHED} So it is with {'; '.join(hits)}."] if hits else []


def why(store: Store) -> list[str]:
    """Reasons for times shorter than the published ones; only sentences for which there are numbers."""
    sentences = []
    for row in TABLE_I:
        if row.real or row.like == OURS:
            continue
        here = data.mean_time(data.ten(store.of("exp1", method=row.like)))
        if here.n:
            sentences.append(_rival(row.method, row.like, row.seconds, here))
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
            f"{single[1][0]:.1f} s here, "
            f"{share:.0f} % less; published on real robots: 91 s and 176 s, 48 % less."
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


def _rival(name: str, method: str, published: float, here: Estimate) -> str:
    """One rival's time here and published."""
    text = f"{name}: published {published} s, here {here.text()} s (n = {here.n})."
    if here.value >= published:
        return text
    return text + (
        " Ours is quicker because it is built to be: the same base controller and limits as the paper's method, a "
        "grasp "
        "as quick as a stationary one can be instead of the 40 s that the paper adds for six, no time for computing, "
        "and a map, objects and a robot that a simulation has and a laboratory has not. How fast the robot of Reister "
        "et al. drove is not in the paper, so how much of the difference is speed cannot be said."
    )
