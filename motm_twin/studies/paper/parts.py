"""Figures and tables of the report: the trials that each needs, and its section."""

import dataclasses
import functools
import shlex
from collections.abc import Callable, Collection, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import msgspec
from rich.console import Console

from motm_twin.methods.registry import FORESIGHT
from motm_twin.sessions.session import SOURCE, made_with
from motm_twin.studies.paper import data, planning_figures, sweep_figures, tables, time_figures
from motm_twin.studies.paper.data import LITERAL, OPTIONS_OF_PLANS, PLANS, SWEEPS, TEN, Store
from motm_twin.studies.paper.drawing import Missing, Part
from motm_twin.studies.paper.episode import Episode, draw_cutting_in, draw_distance, draw_snapshots, watch_trial
from motm_twin.studies.spec import Experiment, TrialSpec

EPISODES = "episodes"
EXAMPLE = "cut_ins"  # the example trial of Experiment 2 has the most of these


@dataclass
class Context:
    """The results, their origin, and the output folder."""

    store: Store
    out: Path
    console: Console
    pages: bool = True  # photographs of the page are wanted
    plan: str = "default"  # the plan that ran the trials
    sources: tuple[str, ...] = ()  # of the trials; (): the current one

    def command(self, name: str = "", *, plan: str = "") -> str:
        """Command that makes this report, or only a part of it; ``plan``: in place of the plan of its trials."""
        only = f" --only {name}" if name else ""
        return f"motm-twin paper{OPTIONS_OF_PLANS[plan or self.plan]} --out {shlex.quote(str(self.out))}{only}"

    @property
    def larger(self) -> str:
        """Name of the next larger plan; the largest stays."""
        names = list(PLANS)
        return names[min(names.index(self.plan) + 1, len(names) - 1)]

    @functools.cached_property
    def episode(self) -> Episode | None:
        """Example of Experiment 2: the completed trial of motm with the most cut-ins; None: no trial was completed."""
        found = data.random(self.store.of("exp2", method="motm"))
        found = [result for result in found if data.completed(result)]
        if not found:
            return None
        best = max(found, key=lambda result: (data.measure(result, EXAMPLE) or 0.0, -result["seed"]))
        self.console.print(f"  watching exp2 seed {best['seed']} again, for its figures")
        spec = TrialSpec("exp2", best["variant"], best["seed"], best["method"])
        return self._watch(spec)

    def with_foresight(self, episode: Episode) -> Episode:
        """The same scene and seed with the method that predicts."""
        spec = msgspec.structs.replace(episode.spec, method=FORESIGHT.name)
        self.console.print(f"  watching exp2 seed {spec.seed} with {spec.method}")
        return self._watch(spec)

    def _watch(self, spec: TrialSpec) -> Episode:
        source = self.sources[0] if len(self.sources) == 1 else made_with()[SOURCE]
        return watch_trial(spec, self.out / EPISODES, source)


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
    beside: tuple[str, ...] = ()  # only trials with an arrangement and seed of these experiments, to compare with

    def has(self, spec: TrialSpec, compared: Collection[tuple]) -> bool:
        """True when the part needs this trial; ``compared``: arrangements of the experiments ``beside``."""
        return (
            (not self.methods or spec.method in self.methods)
            and (not self.variants or spec.variant in self.variants)
            and (not self.beside or arrangement(spec) in compared)
        )


class Source(NamedTuple):
    """One part of the report."""

    name: str
    title: str
    section: str
    needs: tuple[Need, ...]
    make: Callable[[Context], Part]


def arrangement(spec: TrialSpec) -> tuple:
    """Scene, variant and seed of a trial: trials with equal arrangements are compared."""
    return spec.scene, spec.variant, spec.seed


def needed(experiments: Iterable[Experiment], names: Collection[str]) -> tuple[Experiment, ...]:
    """These experiments reduced to the trials that the named parts need."""
    whole = {each.name: each for each in experiments}
    needs = [need for source in PARTS if source.name in names for need in source.needs]
    found = []
    for experiment in whole.values():
        these = [
            (need, {arrangement(spec) for name in need.beside if name in whole for spec in whole[name].specs})
            for need in needs
            if need.experiment == experiment.name
        ]
        specs = [spec for spec in experiment.specs if any(need.has(spec, compared) for need, compared in these)]
        if specs:
            found.append(Experiment(experiment.name, experiment.title, tuple(specs)))
    return tuple(found)


def make_part(source: Source, context: Context) -> Part:
    """Make a part and add its name, its title, and the command that makes it."""
    part = source.make(context)
    more = isinstance(part, Missing) and part.larger
    command = context.command(source.name, plan=context.larger if more else context.plan)
    commands = "; ".join(filter(None, (command, part.command)))
    return dataclasses.replace(part, name=source.name, title=source.title, command=commands)


def _watched(draw: Callable[[Context, Episode], Part]) -> Callable[[Context], Part]:
    """Maker of a part that needs the watched trial."""

    def make(context: Context) -> Part:
        episode = context.episode
        if episode is None:
            return Missing(reason="no trial of motm in Experiment 2 was completed")
        part = draw(context, episode)
        if isinstance(part, Missing) or context.sources in ((), (episode.source,)):
            return part
        note = f"Watched with source {episode.source}; the trials are of {', '.join(context.sources)}."
        return dataclasses.replace(part, notes=(*part.notes, note))

    return make


def _cutting_in(context: Context, episode: Episode) -> Part:
    return draw_cutting_in(episode, context.with_foresight(episode) if episode.measures["cut_ins"] else episode)


def _pages(context: Context) -> Part:
    if not context.pages:
        return Missing(reason="photographs of the page were not asked for")
    return _watched(lambda _, episode: draw_snapshots(episode))(context)


COMPARED = (Need("exp1"), Need("exp1a"), Need("exp2"))
TIMED = (Need("exp1", variants=TEN), Need("exp1a", variants=TEN))
ABLATED = (Need("ablations"), Need("exp1", ("motm", LITERAL), beside=("ablations",)))
SHIPPED = tuple(Need(name, ("motm",), beside=tuple(SWEEPS)) for name in ("exp1", "exp1a"))
SWEPT = (*(Need(name) for name in SWEEPS), *SHIPPED)
WATCHED = (Need("exp2", ("motm",), ("random",)),)

PARTS = (
    Source("results", "Task times and success", "comparison", COMPARED, lambda c: tables.draw_results(c.store)),
    Source("box_plots", "Task times of Experiments 1 and 1a", "comparison", COMPARED[:2],
           lambda c: time_figures.draw_box_plots(c.store)),
    Source("reductions", "Reduction of the task time against every rival", "comparison", COMPARED,
           lambda c: time_figures.draw_reductions(c.store)),
    Source("time_split", "Where the time goes", "comparison", TIMED, lambda c: time_figures.draw_time_split(c.store)),
    Source("measures", "Motion, retries, and behaviour among others", "comparison", COMPARED,
           lambda c: tables.draw_measures(c.store)),
    Source("ablations", "Each modification of the paper switched off alone", "worth", ABLATED,
           lambda c: sweep_figures.draw_ablations(c.store)),
    Source("sweeps", "Task time against the parameters of placement and heuristic", "worth", SWEPT,
           lambda c: sweep_figures.draw_sweeps(c.store)),
    Source("gripper_distance", "Distance from gripper to the nearest seen obstacle", "temis", WATCHED,
           _watched(lambda _, episode: draw_distance(episode))),
    Source("snapshots", "Arm and base avoid a Temi: the page at four moments", "temis", WATCHED, _pages),
    Source("cutting_in", "Cutting in front of a moving obstacle", "temis", WATCHED, _watched(_cutting_in)),
    Source("robustness", "Success against errors: reactive, and the same plan executed open-loop", "robust",
           (Need("robustness"),), lambda c: sweep_figures.draw_robustness(c.store)),
    Source("grasp_delay", "Task time when grasps are late, miss or slip", "robust", (Need("grasp_delay"),),
           lambda c: sweep_figures.draw_grasp_delay(c.store)),
    Source("layout", "Layout of Experiments 1, 1a and 2", "method", (), lambda _: planning_figures.draw_layout()),
    Source("global_path", "Global path with and without the cost of rotation", "method", (),
           lambda _: planning_figures.draw_global_path()),
    Source("bezier", "Bézier path and PathRTR between the same two poses", "method", (),
           lambda _: planning_figures.draw_bezier()),
    Source("base_placement", "Base placement for one object and two drop locations", "method", (),
           lambda _: planning_figures.draw_placement()),
)  # fmt: skip
NAMES = tuple(source.name for source in PARTS)
