"""What else was measured, by method: motion while grasping, and behaviour among Temis."""

from collections.abc import Callable
from typing import NamedTuple

from motm_twin.bench.experiments import statistics
from motm_twin.bench.experiments.statistics import Estimate
from motm_twin.bench.paper import data
from motm_twin.bench.paper.data import Result, Store
from motm_twin.bench.paper.part import Drawn, Missing, Part

NAME, TITLE = "measures", "Motion, retries, and behaviour among others"
COMMAND = "motm-twin paper --only measures"


class Column(NamedTuple):
    """A measure and how it is printed."""

    title: str
    key: str
    value: Callable[[Result], float | None]
    decimals: int


def _of(*names: str) -> Callable[[Result], float | None]:
    return lambda result: data.measure(result, *names)


COLUMNS = (
    Column("Base speed while closing [m/s]", "closing_speed", _of("closing_base_speed_mps", "mean"), 2),
    Column("Share of time base moves", "moving_share", _of("moving_share"), 2),
    Column("Path [m]", "path_length", lambda result: result["path_length_m"], 1),
    Column("Retries", "retries", _of("retries"), 2),
    Column("Least gripper distance [m]", "min_gripper_obstacle", _of("min_gripper_obstacle_m"), 2),
    Column("Cut-ins", "cut_ins", _of("cut_ins"), 1),
    Column("Near misses", "near_misses", _of("near_misses"), 1),
    Column("Evasive manoeuvres", "evasive_manoeuvres", _of("evasive_manoeuvres"), 1),
)
EXPERIMENTS = {"exp1": "1", "exp1a": "1a", "exp2": "2"}


def row(results: list[Result]) -> dict[str, Estimate]:
    """Means over all trials in which the measure was taken."""
    found = {}
    for column in COLUMNS:
        values = [column.value(result) for result in results]
        found[column.key] = statistics.mean([value for value in values if value is not None])
    return found


def draw(store: Store) -> Part:
    """One row per experiment and method."""
    found = [
        (experiment, method, results, row(results))
        for experiment in EXPERIMENTS
        for method in store.methods(experiment)
        if (results := store.of(experiment, method=method))
    ]
    if not any(estimates["moving_share"].n for *_, estimates in found):
        return Missing(name=NAME, title=TITLE, reason="no trial has these measures", command=COMMAND)
    return Drawn(
        name=NAME,
        title=TITLE,
        caption=(
            "Means per trial with Student's 95 % interval, over all trials in which the measure was taken, completed "
            "or not. "
            "How each is defined stands in bench/measures: cut-ins within 1.5 s and 1 m of a moving agent, near "
            "misses below 0.10 m."
        ),
        command=COMMAND,
        n=f"{sum(len(results) for _, _, results, _ in found)} trials; of each row in its column",
        rows=[
            {"experiment": experiment, "method": method, "trials": len(results),
             **{f"{key}{end}": value for key, each in estimates.items()
                for end, value in (("", each.value), ("_low", each.low), ("_high", each.high), ("_n", each.n))}}
            for experiment, method, results, estimates in found
        ],
        header=("Experiment", "Method", "Trials", *(column.title for column in COLUMNS)),
        cells=[
            (EXPERIMENTS[experiment], data.title(method), str(len(results)),
             *(estimates[column.key].text(column.decimals) for column in COLUMNS))
            for experiment, method, results, estimates in found
        ],
    )  # fmt: skip
