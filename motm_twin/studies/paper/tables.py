"""Tables of the report: numbers to reach, results of all methods beside Table I of the paper, further measures."""

import math
from collections.abc import Callable, Iterable
from functools import partial
from typing import Any, NamedTuple

from motm_twin.measures import agents
from motm_twin.measures.references import TABLE_I, TableRow
from motm_twin.studies import statistics
from motm_twin.studies.paper import data
from motm_twin.studies.paper.data import OURS, Result, Store
from motm_twin.studies.paper.drawing import Drawn, Missing, Part
from motm_twin.studies.statistics import COMPLETED, TOUCHED, Estimate, drove_into, setting, touches

LINE = 0.02  # [m/s] tolerance of the gripper's speed towards dynamic obstacles over the damper line
HEADER = (
    "Experiment", "Method", "Task time, mean [95 % CI] [s]", "Median [s]", "Trials completed",
    "Trials with success [95 % CI]", "Objects placed", "Contacts, caused",
)  # fmt: skip
TRIAL_1, ALL_PUBLISHED = "1, trial 1", "1, published arrangements"
Choose = Callable[[list[Result]], list[Result]]
Line = tuple[dict[str, Any], dict[str, str]]  # row of a table: its numbers, and its printed cells
GROUPS: tuple[tuple[str, str, Choose], ...] = (  # a trial is in one group at most; means are taken within a group
    ("exp1", ALL_PUBLISHED, data.ten),
    ("exp1", "1, random", data.random),
    ("exp1", "1, trial 1, other seeds", lambda all_: [r for r in all_ if r["variant"] == "trial1" and r["seed"] != 0]),
    ("exp1a", "1a, published arrangements", data.ten),
    ("exp1a", "1a, random", data.random),
    ("exp2", "2, four Temis", data.random),
    ("exp2", "2, one Temi", lambda results: [each for each in results if each["variant"] == "one_temi"]),
)


def grouped(store: Store) -> list[tuple[str, str, list[Result]]]:
    """Name, method and trials of every group with trials, in the order of `GROUPS`."""
    return [
        (name, method, results)
        for experiment, name, choose in GROUPS
        for method in store.methods(experiment)
        if (results := choose(store.of(experiment, method=method)))
    ]


def group_of(result: Result) -> str:
    """Name of the group of a trial of any experiment; trials with different settings are in different groups."""
    own = [name for scene, name, choose in GROUPS if scene == result["scene"] and choose([result])]
    name = own[0] if own else f"{result['scene']}, {result['variant']}"
    return ", ".join(filter(None, (name, setting(result))))


def first(results: list[Result]) -> list[Result]:
    """Trial 1 of the published arrangements, which has its own row in the paper."""
    return [each for each in data.ten(results) if each["variant"] == "trial1"]


def successes(results: list[Result]) -> Estimate:
    """Share of trials with success as `run` defines it, with the interval of Clopper and Pearson."""
    return statistics.proportion(sum(bool(result["success"]) for result in results), len(results))


def draw_results(store: Store) -> Part:
    """One row per group and method; trial 1 has a row of its own, and is not repeated as a group of only this trial."""
    found = grouped(store)
    if not found:
        return Missing(reason="no trial of Experiments 1, 1a or 2 was run")
    alone = [(TRIAL_1, method, first(results)) for name, method, results in found if name == ALL_PUBLISHED]
    more = [each for each in found if each[0] != ALL_PUBLISHED or each[2] != first(each[2])]
    lines = [*map(_published, TABLE_I), *(_result(*each) for each in (*alone, *more) if each[2])]
    return Drawn(
        caption=(
            "Times are means over the completed trials, with Student's 95 % interval; medians with a bootstrap "
            f"interval are in the CSV. {COMPLETED} Contacts: all that the referee counts, and of these those that the "
            f"robot caused. {TOUCHED} Success, as motm-twin run says it: completed, and no such contact; with Clopper "
            "and Pearson's interval over trials. The objects of a trial are not independent, so their share has none. "
            "Shaded rows are published numbers, not measured here."
        ),
        n=f"{sum(len(results) for *_, results in found)} trials; of each row in its column",
        rows=[row for row, _ in lines],
        cells=[cells for _, cells in lines],
        marked=range(len(TABLE_I)),
    )


def _published(row: TableRow) -> Line:
    name, placed = f"{row.method} (published)", row.success or "not given"
    cells = (row.experiment, name, f"{row.seconds:.1f}", "-", "-", "not given", placed, "not given")
    return (
        {"experiment": row.experiment, "method": row.method, "published": True, "mean_s": row.seconds,
         "placed": row.success, "source": row.source},
        dict(zip(HEADER, cells, strict=True)),
    )  # fmt: skip


def _result(name: str, method: str, results: list[Result]) -> Line:
    time, median = data.mean_time(results), statistics.median(list(data.times(results).values()))
    share, (placed, places) = successes(results), data.placed(results)
    row = {
        "experiment": name, "method": method, "published": False, "mean_s": time.value, "mean_low_s": time.low,
        "mean_high_s": time.high, "median_s": median.value, "median_low_s": median.low, "median_high_s": median.high,
        "trials": len(results), "completed": time.n, "success": share.value, "success_low": share.low,
        "success_high": share.high, "placed": f"{placed}/{places}", "contacts": data.contacts(results),
        "all_contacts": touches(results),
    }  # fmt: skip
    interval = f"[{100 * share.low:.0f}, {100 * share.high:.0f}] %"
    cells = (
        name, data.title(method), time.text(1), f"{median.value:.1f}" if median.n else "-",
        f"{time.n} of {len(results)}", f"{round(share.value * share.n)}/{share.n} {interval}", f"{placed}/{places}",
        f"{touches(results)}, {data.contacts(results)}",
    )  # fmt: skip
    return row, dict(zip(HEADER, cells, strict=True))


class Column(NamedTuple):
    """A column of the table: a measure and its format."""

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
    "Cut-in: by its own motion, not by the agent's turning, the base gets in front of an agent that drives, within "
    f"{agents.CUT_DISTANCE:g} m and {agents.CUT_TIME:g} s of being touched while they close; once per agent, until "
    f"they are {agents.PARTED:g} m apart. Near miss: an agent is less than {agents.NEAR:.2f} m from the base while it "
    f"moves, until {agents.NEAR_END:.2f} m. Evasive manoeuvre: had both gone on, the gap would have become less than "
    f"{agents.CONFLICT:.2f} m within {agents.HORIZON:g} s, and the base became {agents.SLOWED} m/s slower or turned "
    f"off by {math.degrees(agents.TURNED):.0f}°. Retries: attempts at a pick or a place after the first. Over the "
    f"damper line: below d_i of what moves, the gripper's own true approach speed was ever more than {LINE} m/s above "
    "it; '-': it was never there. Phases of a trial: fingers closing; else the base drives, or stands and waits for "
    "the arm (it is at work, or the target in its reach), or is stationary for another reason. docs/results.md has the "
    "definitions in full."
)


def means_of(results: list[Result]) -> dict[str, Estimate]:
    """Mean of each measure over all trials in which it was taken."""
    return {
        column.key: statistics.mean([value for each in results if (value := column.value(each)) is not None])
        for column in COLUMNS
    }


def over_line(results: list[Result]) -> tuple[int, int] | None:
    """Number of trials over the damper line, and of measured trials; None: never near a dynamic obstacle."""
    near, n = excesses(results)
    return (sum(speed > LINE for speed in near), n) if near else None


def excesses(results: list[Result]) -> tuple[list[float], int]:
    """Excesses over the damper line [m/s], one per trial near a dynamic obstacle; and the number of measured trials."""
    measured = [result for result in results if result.get("measures") is not None]
    near = [speed for each in measured if (speed := data.measure(each, "approach_excess_mps")) is not None]
    return near, len(measured)


def draw_measures(store: Store) -> Part:
    """One row per method and group of trials, as in the results table: obstacles differ between the groups."""
    found = [(name, method, results, means_of(results)) for name, method, results in grouped(store)]
    if not any(estimates["moving_share"].n for *_, estimates in found):
        return Missing(reason="no trial has these measures")
    return Drawn(
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
        cells=[
            {"Experiment": name, "Method": data.title(method), "Trials": str(len(results)),
             **{column.title: estimates[column.key].text(column.decimals) for column in COLUMNS},
             OVER: "/".join(map(str, over_line(results) or ())) or "-"}
            for name, method, results, estimates in found
        ],
    )  # fmt: skip


SEEDS = 50  # needed for a verdict
GOAL_HEADER = ("Number", "Wanted", "Method", "Measured", "n", "")


class Found(NamedTuple):
    """Measured value of a goal."""

    good: bool
    measured: str  # the value with its interval, as text
    n: int  # number of trials
    final: bool = False  # no further trial can change the verdict


class Goal(NamedTuple):
    """A number to reach, and its computation from the trials of a method."""

    name: str
    required: str
    trials: tuple[tuple[str, str], ...]  # (scene, variant) of the judged trials, then of those to compare with
    measure: Callable[..., Found | None]  # computed from these trials; None: not measured in them


def goal_rows(store: Store) -> list[tuple[str, ...]]:
    """Rows of all goals for each method; with fewer than `SEEDS` trials an open verdict begins with "so far"."""
    return [_goal_row(goal, store, method) for goal in GOALS for method in OURS]


def missed(rows: Iterable[tuple[str, ...]]) -> list[str]:
    """One sentence for each goal that is missed."""
    return [
        f"{verdict[0].upper()}{verdict[1:]} by {method}: {name}: {measured}, wanted {required} (n = {n})."
        for name, required, method, measured, n, verdict in rows
        if verdict.endswith("missed")
    ]


def _goal_row(goal: Goal, store: Store, method: str) -> tuple[str, ...]:
    trials = [store.of(scene, method=method, variant=variant) for scene, variant in goal.trials]
    found = goal.measure(*trials) if trials[0] else None
    if found is None:
        return (goal.name, goal.required, method, "not measured", "0", "")
    early = "" if found.n >= SEEDS or found.final else "so far "
    verdict = early + ("reached" if found.good else "missed")
    return (goal.name, goal.required, method, found.measured, str(found.n), verdict)


def _placed(results: list[Result]) -> Found:
    placed, places = data.placed(results)
    measured = f"{placed}/{places}, {data.percent(statistics.proportion(placed, places), 1)}"
    return Found(placed == places, measured, len(results), placed < places)


def _never(count: Callable[[list[Result]], int], results: list[Result], beside: str = "") -> Found:
    """Goal that the count is 0 in every trial; ``beside``: text after the count."""
    trials = sum(count([result]) > 0 for result in results)
    share = data.percent(statistics.proportion(trials, len(results)), 1)
    measured = f"{count(results)}{beside}, in {trials} of {len(results)} trials, {share}"
    return Found(trials == 0, measured, len(results), trials > 0)


def _over_line(results: list[Result]) -> Found | None:
    """Goal that the gripper is never faster towards a dynamic obstacle than the damper line (tolerance `LINE`)."""
    near, n = excesses(results)
    over = sum(value > LINE for value in near)
    share = data.percent(statistics.proportion(over, n), 1)
    most = f"largest excess {max(near):.3f} m/s" if near else "never near"
    return Found(over == 0, f"over it in {over} of {n} trials, {share}; {most}", n, over > 0) if n else None


def _mean_at_most(limit: float, results: list[Result]) -> Found | None:
    time = data.mean_time(results)
    good = time.value <= limit
    measured = f"{time.text(_decimals(time.value, limit, good=good))} s{_over(results, time.n)}"
    return Found(good, measured, len(results)) if time.n else None


def _longer_at_most(limit: float, results: list[Result], others: list[Result]) -> Found | None:
    seeds = {result["seed"] for result in others}
    results = [result for result in results if result["seed"] in seeds]
    longer = statistics.paired_ratio(data.times(results), _renamed(data.times(others), results))
    good = longer.value <= limit
    decimals = _decimals(100.0 * longer.value, 100.0 * limit, good=good)
    measured = f"{data.percent(longer, decimals)}{_over(results, longer.n)}"
    return Found(good, measured, len(results)) if longer.n else None


def _decimals(value: float, limit: float, *, good: bool) -> int:
    """Decimals to print: one, or as many as distinguish a missed value from the limit."""
    apart = (decimals for decimals in (1, 2, 3) if good or f"{value:.{decimals}f}" != f"{limit:.{decimals}f}")
    return next(apart, 4)


def _over(results: list[Result], n: int) -> str:
    return "" if n == len(results) else f" over {n} of {len(results)} trials"


def _renamed(times: dict[Any, float], like: list[Result]) -> dict[Any, float]:
    """Times by seed under the variants of ``like``: Experiment 2 has other names for the same arrangement."""
    variants = {result["variant"] for result in like}
    return {(variant, seed): value for (_, seed), value in times.items() for variant in variants}


EXP1, EXP1A, EXP2 = (((scene, "random"),) for scene in ("exp1", "exp1a", "exp2"))
CONTACTS = partial(_never, touches)
GOALS = (
    Goal("Experiment 1, random: objects placed", "all", EXP1, _placed),
    Goal("Experiment 1, random: contacts", "0", EXP1, CONTACTS),
    Goal("Experiment 1, random: mean time", "at most 96 s", EXP1, partial(_mean_at_most, 96.0)),
    Goal("Experiment 1a, random: objects placed", "all", EXP1A, _placed),
    Goal("Experiment 1a, random: contacts", "0", EXP1A, CONTACTS),
    Goal("Experiment 1a, random: mean time", "at most 107 s", EXP1A, partial(_mean_at_most, 107.0)),
    Goal("Experiment 2, four Temis: objects placed", "all", EXP2, _placed),
    Goal("Experiment 2, four Temis: contacts that we drove into", "0", EXP2,
         lambda results: _never(drove_into, results, f" of {touches(results)} contacts")),
    Goal("Experiment 2, four Temis: gripper's own approach speed over the damper line", f"at most {LINE} m/s",
         EXP2, _over_line),
    Goal("Experiment 2, four Temis: longer than Experiment 1, by seed", "at most 25 %",
         EXP2 + EXP1, partial(_longer_at_most, 0.25)),
    Goal("Experiment 2, one Temi: longer than Experiment 1, by seed", "at most 5 %",
         (("exp2", "one_temi"), ("exp1", "trial1")), partial(_longer_at_most, 0.05)),
)  # fmt: skip
