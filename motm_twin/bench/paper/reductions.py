"""How much quicker the paper's method is than every rival, by trial, beside the published reductions."""

import math

from motm_twin.bench.experiments import statistics
from motm_twin.bench.experiments.statistics import Estimate
from motm_twin.bench.paper import data
from motm_twin.bench.paper.data import Store
from motm_twin.bench.paper.part import Drawn, Missing, Part
from motm_twin.bench.paper.style import BLACK, ONE_COLUMN, RED, figure, look, styled
from motm_twin.bench.published import REDUCTIONS, TABLE_I

NAME, TITLE = "reductions", "Reduction of the task time against every rival"
COMMAND = "motm-twin paper --only reductions"
OURS = "motm"
EXPERIMENTS = {"exp1": "Experiment 1", "exp1a": "Experiment 1a", "exp2": "Experiment 2"}
MARKS = {"exp1": ("o", -0.22), "exp1a": ("s", 0.0), "exp2": ("^", 0.22)}
HEADER = (
    "Experiment",
    "Rival",
    "Reduction, mean [95 % CI]",
    "Seconds saved, mean [95 % CI]",
    "Pairs",
    "Published reduction",
)


def reduction(store: Store, experiment: str, rival: str) -> tuple[Estimate, Estimate]:
    """Share of the rival's time that is saved, and the seconds, over the trials that both completed."""
    ours = data.times(store.of(experiment, method=OURS))
    theirs = data.times(store.of(experiment, method=rival))
    return turned(statistics.paired_ratio(ours, theirs)), turned(statistics.paired_difference(ours, theirs))


def turned(estimate: Estimate) -> Estimate:
    """The same with the other sign."""
    return Estimate(value=-estimate.value, low=-estimate.high, high=-estimate.low, n=estimate.n)


def draw(store: Store) -> Part:
    """A dot with its interval for each rival and experiment; diamonds where the paper gives a number."""
    found = [
        (experiment, rival, *reduction(store, experiment, rival))
        for experiment in EXPERIMENTS
        for rival in store.methods(experiment)
        if rival != OURS
    ]
    found = [each for each in found if each[2].n]
    if not found:
        return Missing(name=NAME, title=TITLE, reason="no rival completed a trial that motm completed", command=COMMAND)
    rivals = list(dict.fromkeys(rival for _, rival, *_ in found))
    with styled():
        fig = figure(ONE_COLUMN, 24.0 + 7.0 * len(rivals))
        axes = fig.add_subplot()
        for experiment, rival, share, _ in found:
            marker, shift = MARKS[experiment]
            at = rivals.index(rival) + shift
            style = look(rival)
            if math.isfinite(share.low):
                axes.plot([100 * share.low, 100 * share.high], [at, at], "-", color=BLACK, lw=1.0)
            axes.plot(100 * share.value, at, marker, mfc=style.colour, mec=BLACK, mew=0.6, ms=5)
            if rival == "sequential" and experiment in REDUCTIONS:
                axes.plot(100 * REDUCTIONS[experiment][0], at, "D", mfc="white", mec=RED, mew=1.4, ms=5.5)
        axes.axvline(0.0, color=BLACK, lw=0.6)
        axes.set_yticks(range(len(rivals)), [data.title(rival) for rival in rivals])
        axes.set_ylim(len(rivals) - 0.5, -0.5)
        axes.set_xlabel("reduction of the task time [%]")
        axes.grid(axis="x")
        for experiment, (marker, _) in MARKS.items():
            if any(each[0] == experiment for each in found):
                axes.plot([], [], marker, color="white", mec=BLACK, label=EXPERIMENTS[experiment])
        axes.plot([], [], "D", mfc="white", mec=RED, mew=1.4, ms=5.5, label="published, other rivals' times")
        fig.legend(loc="outside lower center", ncols=2)
    return Drawn(
        name=NAME,
        title=TITLE,
        caption=(
            "Mean over trials of 1 - ours/theirs, same arrangement and seed, both completed, with Student's 95 % "
            "interval. The published 43 % (Experiment 1) and 46 % (1a) compare the paper's times with the times that "
            "Reister et al. published for another robot, plus 40 s for grasping; ours compare two methods on the same "
            "robot. The published 48 % are of one arrangement on real robots."
        ),
        command=COMMAND,
        n=f"{sum(each[2].n for each in found)} pairs of trials; of each rival in its row",
        rows=[_row(*each) for each in found],
        facts={"published": {name: share for name, (share, _) in REDUCTIONS.items()}},
        header=HEADER,
        cells=[_cells(*each) for each in found],
        figure=fig,
        notes=why(store),
    )


def _row(experiment: str, rival: str, share: Estimate, saved: Estimate) -> dict:
    published = REDUCTIONS.get(experiment, (None, ""))[0] if rival == "sequential" else None
    return {
        "experiment": experiment, "rival": rival, "reduction": share.value, "low": share.low, "high": share.high,
        "saved_s": saved.value, "saved_low_s": saved.low, "saved_high_s": saved.high, "pairs": share.n,
        "published_reduction": published,
    }  # fmt: skip


def _cells(experiment: str, rival: str, share: Estimate, saved: Estimate) -> tuple[str, ...]:
    published = (
        f"{100 * REDUCTIONS[experiment][0]:.0f} %" if rival == "sequential" and experiment in REDUCTIONS else "-"
    )
    return EXPERIMENTS[experiment], data.title(rival), data.percent(share), saved.text(1), str(share.n), published


def why(store: Store) -> list[str]:
    """Where our times are shorter than the published ones, and why; only sentences for which there are numbers."""
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
