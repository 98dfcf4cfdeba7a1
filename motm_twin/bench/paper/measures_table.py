"""What else was measured, by method: motion while grasping, and behaviour among Temis."""

import math
from collections.abc import Callable
from typing import NamedTuple

from motm_twin.bench.experiments import statistics
from motm_twin.bench.experiments.statistics import Estimate
from motm_twin.bench.measures import cut_ins, encounters
from motm_twin.bench.paper import data
from motm_twin.bench.paper.data import Result, Store
from motm_twin.bench.paper.goals import LINE
from motm_twin.bench.paper.part import Drawn, Missing, Part
from motm_twin.bench.paper.results_table import grouped

NAME, TITLE = "measures", "Motion, retries, and behaviour among others"


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
    Column("Cut-ins", "cut_ins", _of("cut_ins"), 2),
    Column("Near misses", "near_misses", _of("near_misses"), 2),
    Column("Evasive manoeuvres", "evasive_manoeuvres", _of("evasive_manoeuvres"), 1),
)
OVER = f"Trials over the damper line by {LINE} m/s"
DEFINITIONS = (
    f"Cut-in: by its own motion, not by the agent's turning, the base gets in front of an agent that drives, within "
    f"{cut_ins.CUT_DISTANCE:g} m and {cut_ins.CUT_TIME:g} s of being touched while they close; once per agent, until "
    f"they are {cut_ins.PARTED:g} m apart. "
    f"Near miss: an agent is less than {encounters.NEAR:.2f} m from the base while it moves, until "
    f"{encounters.NEAR_END:.2f} m. "
    f"Evasive manoeuvre: had both gone on, the gap would have become less than {encounters.CONFLICT:.2f} m within "
    f"{encounters.HORIZON:g} s, and the base became {encounters.SLOWED} m/s slower or turned off by "
    f"{math.degrees(encounters.TURNED):.0f}°. "
    "Retries: attempts at a pick or a place after the first. "
    f"Over the damper line: below d_i of what moves, the gripper's own true approach speed was ever more than {LINE} "
    "m/s above it; '-': it was never there. "
    "Phases of a trial: fingers closing; else the base drives, or stands and waits for the arm (it is at work, or the "
    "target in its reach), or is stationary for another reason. docs/results.md has the definitions in full."
)


def row(results: list[Result]) -> dict[str, Estimate]:
    """Means over all trials in which the measure was taken."""
    found = {}
    for column in COLUMNS:
        values = [column.value(result) for result in results]
        found[column.key] = statistics.mean([value for value in values if value is not None])
    return found


def over_line(results: list[Result]) -> tuple[int, int] | None:
    """Trials over the damper line, and trials measured; None where the gripper was never near what moves."""
    measured = [result for result in results if result.get("measures") is not None]
    near = [speed for each in measured if (speed := data.measure(each, "approach_excess_mps")) is not None]
    return (sum(speed > LINE for speed in near), len(measured)) if near else None


def draw(store: Store) -> Part:
    """One row per method and group of trials, as in the results table: they differ in what there is to meet."""
    found = [(name, method, results, row(results)) for name, method, results in grouped(store)]
    if not any(estimates["moving_share"].n for *_, estimates in found):
        return Missing(name=NAME, title=TITLE, reason="no trial has these measures")
    return Drawn(
        name=NAME,
        title=TITLE,
        caption=(
            "Means per trial with Student's 95 % interval, over all trials in which the measure was taken, completed "
            f"or not. {DEFINITIONS}"
        ),
        n=f"{sum(len(results) for _, _, results, _ in found)} trials; of each row in its column",
        rows=[
            {"experiment": name, "method": method, "trials": len(results),
             **{f"{key}{end}": value for key, each in estimates.items()
                for end, value in (("", each.value), ("_low", each.low), ("_high", each.high), ("_n", each.n))},
             **dict(zip(("over_line", "over_line_n"), over_line(results) or (None, None), strict=True))}
            for name, method, results, estimates in found
        ],
        header=("Experiment", "Method", "Trials", *(column.title for column in COLUMNS), OVER),
        cells=[
            (name, data.title(method), str(len(results)),
             *(estimates[column.key].text(column.decimals) for column in COLUMNS),
             "/".join(map(str, over_line(results) or ())) or "-")
            for name, method, results, estimates in found
        ],
    )  # fmt: skip
