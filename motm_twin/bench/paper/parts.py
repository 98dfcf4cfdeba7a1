"""All figures and tables of the report: where each stands, and which trials it needs."""

import dataclasses
from collections.abc import Callable, Collection, Iterable
from typing import NamedTuple

from motm_twin.bench.experiments.spec import Experiment, TrialSpec
from motm_twin.bench.paper import (
    ablation,
    bezier_figure,
    box_plots,
    cutting_in,
    distance_figure,
    faults,
    global_path_figure,
    layout_figure,
    measures_table,
    placement_figure,
    reductions,
    results_table,
    snapshots,
    sweeps,
    time_split,
)
from motm_twin.bench.paper.context import Context
from motm_twin.bench.paper.episode import Episode
from motm_twin.bench.paper.part import Missing, Part
from motm_twin.bench.paper.plan import LITERAL, SWEEPS, TEN

SECTIONS = {
    "comparison": "The paper's method and its rivals",
    "worth": "What each modification is worth",
    "temis": "Among moving obstacles",
    "robust": "Errors, delays and surprises",
    "method": "The method in figures",
}


class Need(NamedTuple):
    """Trials of an experiment that a part is made from."""

    experiment: str
    methods: tuple[str, ...] = ()  # (): all
    variants: tuple[str, ...] = ()  # (): all
    beside: tuple[str, ...] = ()  # only what is compared with these experiments: the same arrangements and seeds

    def has(self, spec: TrialSpec, compared: Collection[tuple]) -> bool:
        """Whether a trial of the experiment is one of them; ``compared``: arrangements of the experiments beside."""
        return (
            (not self.methods or spec.method in self.methods)
            and (not self.variants or spec.variant in self.variants)
            and (not self.beside or arrangement(spec) in compared)
        )


class Source(NamedTuple):
    """One part of the report."""

    name: str
    section: str
    needs: tuple[Need, ...]
    make: Callable[[Context], Part]


def arrangement(spec: TrialSpec) -> tuple:
    """What two trials have in common that are compared."""
    return spec.scene, spec.variant, spec.seed


def needed(experiments: Iterable[Experiment], names: Collection[str]) -> tuple[Experiment, ...]:
    """These experiments with only those of their trials that the named parts are made from."""
    whole = {each.name: each for each in experiments}
    needs = [need for source in PARTS if source.name in names for need in source.needs]
    found = []
    for experiment in whole.values():
        these = [need for need in needs if need.experiment == experiment.name]
        compared = [
            {arrangement(spec) for name in need.beside if name in whole for spec in whole[name].specs} for need in these
        ]
        specs = [
            spec
            for spec in experiment.specs
            if any(need.has(spec, beside) for need, beside in zip(these, compared, strict=True))
        ]
        if specs:
            found.append(Experiment(experiment.name, experiment.title, tuple(specs)))
    return tuple(found)


def made(source: Source, context: Context) -> Part:
    """The part, with the command that makes it."""
    part = source.make(context)
    more = isinstance(part, Missing) and part.larger
    command = context.command(source.name, plan=context.larger if more else context.plan)
    return dataclasses.replace(part, command="; ".join(filter(None, (command, part.command))))


def _watched(name: str, title: str, draw: Callable[[Episode], Part]) -> Callable[[Context], Part]:
    """A part that needs the watched trial."""

    def make(context: Context) -> Part:
        episode = context.episode
        if episode is None:
            return Missing(name=name, title=title, reason="no trial of motm in Experiment 2 was completed")
        part = draw(episode)
        if isinstance(part, Missing) or context.sources in ((), (episode.source,)):
            return part
        note = f"Watched with source {episode.source}; the trials are of {', '.join(context.sources)}."
        return dataclasses.replace(part, notes=(*part.notes, note))

    return make


def _pages(context: Context) -> Part:
    if not context.pages:
        reason = "photographs of the page were not asked for"
        return Missing(name=snapshots.NAME, title=snapshots.TITLE, reason=reason)
    return _watched(snapshots.NAME, snapshots.TITLE, snapshots.draw)(context)


COMPARED = (Need("exp1"), Need("exp1a"), Need("exp2"))
WATCHED = (Need("exp2", ("motm",), ("random",)),)
SWEPT = (
    *(Need(name) for name in SWEEPS),
    *(Need(name, ("motm",), beside=tuple(SWEEPS)) for name in ("exp1", "exp1a")),
)

PARTS: tuple[Source, ...] = (
    Source("results", "comparison", COMPARED, lambda c: results_table.draw(c.store)),
    Source("box_plots", "comparison", (Need("exp1"), Need("exp1a")), lambda c: box_plots.draw(c.store)),
    Source("reductions", "comparison", COMPARED, lambda c: reductions.draw(c.store)),
    Source(
        "time_split",
        "comparison",
        (Need("exp1", variants=TEN), Need("exp1a", variants=TEN)),
        lambda c: time_split.draw(c.store),
    ),
    Source("measures", "comparison", COMPARED, lambda c: measures_table.draw(c.store)),
    Source(
        "ablations",
        "worth",
        (Need("ablations"), Need("exp1", ("motm", LITERAL), beside=("ablations",))),
        lambda c: ablation.draw(c.store),
    ),
    Source("sweeps", "worth", SWEPT, lambda c: sweeps.draw(c.store)),
    Source(
        "gripper_distance",
        "temis",
        WATCHED,
        _watched(distance_figure.NAME, distance_figure.TITLE, distance_figure.draw),
    ),
    Source("snapshots", "temis", WATCHED, _pages),
    Source("cutting_in", "temis", WATCHED, _watched(cutting_in.NAME, cutting_in.TITLE, cutting_in.draw)),
    Source("robustness", "robust", (Need("robustness"),), lambda c: faults.draw_robustness(c.store)),
    Source("grasp_delay", "robust", (Need("grasp_delay"),), lambda c: faults.draw_grasp_delay(c.store)),
    Source("layout", "method", (), lambda _: layout_figure.draw()),
    Source("global_path", "method", (), lambda _: global_path_figure.draw()),
    Source("bezier", "method", (), lambda _: bezier_figure.draw()),
    Source("base_placement", "method", (), lambda _: placement_figure.draw()),
)
NAMES = tuple(source.name for source in PARTS)
