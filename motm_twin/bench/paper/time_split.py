"""Where the time of a trial goes, by method: driving, waiting for the arm, standing, closing the fingers."""

from motm_twin.bench.experiments import statistics
from motm_twin.bench.paper import data
from motm_twin.bench.paper.data import Store
from motm_twin.bench.paper.part import Drawn, Missing, Part
from motm_twin.bench.paper.style import BLACK, BLUE, GREEN, ORANGE, PALE, TWO_COLUMNS, figure, styled

NAME, TITLE = "time_split", "Where the time goes"
PHASES = {  # of bench/measures: its look
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


def draw(store: Store) -> Part:
    """One bar per method, its parts the means of the phases."""
    found = {
        experiment: {
            method: parts for method in store.methods(experiment) if (parts := split(store, experiment, method))
        }
        for experiment in EXPERIMENTS
    }
    found = {experiment: methods for experiment, methods in found.items() if methods}
    if not found:
        return Missing(name=NAME, title=TITLE, reason="no trial of Experiment 1 or 1a has its time split")
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
        name=NAME,
        title=TITLE,
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
