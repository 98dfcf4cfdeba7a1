"""Target numbers of the experiments beside the measured ones; none is judged without its trials."""

from collections.abc import Callable, Iterable
from functools import partial
from typing import Any, NamedTuple

from motm_twin.studies import statistics
from motm_twin.studies.groups import drove_into, touches
from motm_twin.studies.paper import data
from motm_twin.studies.paper.data import Result, Store
from motm_twin.studies.paper.plan import OURS

SEEDS = 50
LINE = 0.02  # [m/s] that the gripper may be faster towards what moves than the damper line
HEADER = ("Number", "Wanted", "Method", "Measured", "n", "")


class Found(NamedTuple):
    """Measured value of a goal."""

    good: bool
    said: str  # with its interval
    n: int  # trials
    final: bool = False  # no further trial can change the verdict


class Goal(NamedTuple):
    """A number, and how to get at it from the trials of a method."""

    name: str
    wanted: str
    trials: tuple[tuple[str, str], ...]  # scene and variant: those that are judged, then those they are compared with
    measure: Callable[..., Found | None]  # of these trials; None: they do not have it


def table(store: Store) -> list[tuple[str, ...]]:
    """Rows of all goals, for each method; what has fewer trials than the goal names says so instead of being judged."""
    return [_row(goal, store, method) for goal in GOALS for method in OURS]


def missed(rows: Iterable[tuple[str, ...]]) -> list[str]:
    """One sentence for each number that is not reached."""
    return [
        f"{verdict[0].upper()}{verdict[1:]} by {method}: {name}: {said}, wanted {wanted} (n = {n})."
        for name, wanted, method, said, n, verdict in rows
        if verdict.endswith("missed")
    ]


def _row(goal: Goal, store: Store, method: str) -> tuple[str, ...]:
    trials = [store.of(scene, method=method, variant=variant) for scene, variant in goal.trials]
    found = goal.measure(*trials) if trials[0] else None
    if found is None:
        return (goal.name, goal.wanted, method, "not measured", "0", "")
    early = "" if found.n >= SEEDS or found.final else "so far "
    return (goal.name, goal.wanted, method, found.said, str(found.n), early + ("reached" if found.good else "missed"))


def _placed(results: list[Result]) -> Found:
    placed, wanted = data.placed(results)
    said = f"{placed}/{wanted}, {data.percent(data.delivered(results), 1)}"
    return Found(placed == wanted, said, len(results), placed < wanted)


def _never(count: Callable[[list[Result]], int], results: list[Result], beside: str = "") -> Found:
    """Nothing of a kind happens in any trial; ``beside``: more words."""
    trials = sum(count([result]) > 0 for result in results)
    share = data.percent(statistics.proportion(trials, len(results)), 1)
    said = f"{count(results)}{beside}, in {trials} of {len(results)} trials, {share}"
    return Found(trials == 0, said, len(results), trials > 0)


def _drove_into(results: list[Result]) -> Found:
    return _never(drove_into, results, f" of {touches(results)} contacts")


def _over_line(results: list[Result]) -> Found | None:
    """Trials in which the gripper is ever faster towards what moves than the damper line allows."""
    results = [result for result in results if result.get("measures") is not None]
    speeds = [data.measure(result, "approach_excess_mps") for result in results]
    near = [value for value in speeds if value is not None]
    over = sum(value > LINE for value in near)
    share = data.percent(statistics.proportion(over, len(results)), 1)
    most = f"largest excess {max(near):.3f} m/s" if near else "never near"
    said = f"over it in {over} of {len(results)} trials, {share}; {most}"
    return Found(over == 0, said, len(results), over > 0) if results else None


def _mean_at_most(limit: float, results: list[Result]) -> Found | None:
    time = data.mean_time(results)
    good = time.value <= limit
    said = f"{time.text(_decimals(time.value, limit, good=good))} s{_of(results, time.n)}"
    return Found(good, said, len(results)) if time.n else None


def _longer_at_most(limit: float, results: list[Result], others: list[Result]) -> Found | None:
    seeds = {result["seed"] for result in others}
    results = [result for result in results if result["seed"] in seeds]
    longer = statistics.paired_ratio(data.times(results), _renamed(data.times(others), results))
    good = longer.value <= limit
    decimals = _decimals(100.0 * longer.value, 100.0 * limit, good=good)
    said = f"{data.percent(longer, decimals)}{_of(results, longer.n)}"
    return Found(good, said, len(results)) if longer.n else None


def _decimals(value: float, limit: float, *, good: bool) -> int:
    """Decimals to print: one, or as many as it takes to tell a missed value from the limit."""
    apart = (decimals for decimals in (1, 2, 3) if good or f"{value:.{decimals}f}" != f"{limit:.{decimals}f}")
    return next(apart, 4)


def _of(results: list[Result], n: int) -> str:
    return "" if n == len(results) else f" over {n} of {len(results)} trials"


def _renamed(times: dict[Any, float], like: list[Result]) -> dict[Any, float]:
    """Times by seed under the variants of others: the same arrangement is called otherwise in Experiment 2."""
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
    Goal("Experiment 2, four Temis: contacts that we drove into", "0", EXP2, _drove_into),
    Goal("Experiment 2, four Temis: gripper's own approach speed over the damper line", f"at most {LINE} m/s",
         EXP2, _over_line),
    Goal("Experiment 2, four Temis: longer than Experiment 1, by seed", "at most 25 %",
         EXP2 + EXP1, partial(_longer_at_most, 0.25)),
    Goal("Experiment 2, one Temi: longer than Experiment 1, by seed", "at most 5 %",
         (("exp2", "one_temi"), ("exp1", "trial1")), partial(_longer_at_most, 0.05)),
)  # fmt: skip
