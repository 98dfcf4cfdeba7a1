"""All figures and tables of the report: where each stands, and which experiments it needs."""

from collections.abc import Callable
from typing import NamedTuple

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
from motm_twin.bench.paper.plan import SWEEPS

SECTIONS = {
    "comparison": "The paper's method and its rivals",
    "worth": "What each modification is worth",
    "temis": "Among moving obstacles",
    "robust": "Errors, delays and surprises",
    "method": "The method in figures",
}


class Source(NamedTuple):
    """One part of the report."""

    name: str
    section: str
    needs: tuple[str, ...]  # experiments
    make: Callable[[Context], Part]


def _watched(name: str, title: str, draw: Callable[[Episode], Part]) -> Callable[[Context], Part]:
    """A part that needs the watched trial."""

    def make(context: Context) -> Part:
        if context.episode is None:
            reason = "no trial of motm in Experiment 2 was completed"
            return Missing(name=name, title=title, reason=reason, command=f"motm-twin paper --only {name}")
        return draw(context.episode)

    return make


def _pages(context: Context) -> Part:
    if not context.pages:
        reason = "photographs of the page were not asked for"
        return Missing(name=snapshots.NAME, title=snapshots.TITLE, reason=reason, command=snapshots.COMMAND)
    return _watched(snapshots.NAME, snapshots.TITLE, snapshots.draw)(context)


PARTS: tuple[Source, ...] = (
    Source("results", "comparison", ("exp1", "exp1a", "exp2"), lambda c: results_table.draw(c.store)),
    Source("box_plots", "comparison", ("exp1", "exp1a"), lambda c: box_plots.draw(c.store)),
    Source("reductions", "comparison", ("exp1", "exp1a", "exp2"), lambda c: reductions.draw(c.store)),
    Source("time_split", "comparison", ("exp1", "exp1a"), lambda c: time_split.draw(c.store)),
    Source("measures", "comparison", ("exp1", "exp1a", "exp2"), lambda c: measures_table.draw(c.store)),
    Source("ablations", "worth", ("exp1", "ablations"), lambda c: ablation.draw(c.store)),
    Source("sweeps", "worth", ("exp1", *SWEEPS), lambda c: sweeps.draw(c.store)),
    Source(
        "gripper_distance",
        "temis",
        ("exp2",),
        _watched(distance_figure.NAME, distance_figure.TITLE, distance_figure.draw),
    ),
    Source("snapshots", "temis", ("exp2",), _pages),
    Source("cutting_in", "temis", ("exp2",), _watched(cutting_in.NAME, cutting_in.TITLE, cutting_in.draw)),
    Source("robustness", "robust", ("robustness",), lambda c: faults.draw_robustness(c.store)),
    Source("grasp_delay", "robust", ("grasp_delay",), lambda c: faults.draw_grasp_delay(c.store)),
    Source("layout", "method", (), lambda _: layout_figure.draw()),
    Source("global_path", "method", (), lambda _: global_path_figure.draw()),
    Source("bezier", "method", (), lambda _: bezier_figure.draw()),
    Source("base_placement", "method", (), lambda _: placement_figure.draw()),
)
NAMES = tuple(source.name for source in PARTS)
EXAMPLES = ("gripper_distance", "snapshots", "cutting_in")  # made from the watched trial
