"""Target numbers of the experiments beside the measured ones; none is judged without its trials."""

from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

from motm_twin.studies import statistics
from motm_twin.studies.groups import drove_into
from motm_twin.studies.paper import data
from motm_twin.studies.paper.data import Result, Store
from motm_twin.studies.paper.plan import OURS

SEEDS = 50
LINE = 0.02  # [m/s] that the gripper may be faster towards what moves than the damper line
HEADER = ("Number", "Wanted", "Method", "Measured", "n", "")

Choose = Callable[[Store, str], list[Result]]  # the trials of a method


class Found(NamedTuple):
    """Measured value of a goal."""

    good: bool
    said: str  # with its interval
    n: int  # trials
    final: bool = False  # no further trial can change the verdict


Measure = Callable[[Store, str], Found | None]  # None: there are no trials


class Goal(NamedTuple):
    """A number, and how to get at it for a method."""

    name: str
    wanted: str
    measure: Measure


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
    found = goal.measure(store, method)
    if found is None:
        return (goal.name, goal.wanted, method, "not measured", "0", "")
    early = "" if found.n >= SEEDS or found.final else "so far "
    return (goal.name, goal.wanted, method, found.said, str(found.n), early + ("reached" if found.good else "missed"))


def _ours(scene: str, variant: str = "random") -> Choose:
    return lambda store, method: store.of(scene, method=method, variant=variant)


def _placed(choose: Choose) -> Measure:
    def measure(store: Store, method: str) -> Found | None:
        results = choose(store, method)
        placed, wanted = data.placed(results)
        said = f"{placed}/{wanted}, {data.percent(data.delivered(results), 1)}"
        return Found(placed == wanted, said, len(results), placed < wanted) if results else None

    return measure


def _none(choose: Choose, count: Callable[[list[Result]], int], what: Callable[[list[Result]], str]) -> Measure:
    """Nothing of a kind happens in any trial; ``what``: more words."""

    def measure(store: Store, method: str) -> Found | None:
        results = choose(store, method)
        trials = sum(count([result]) > 0 for result in results)
        share = data.percent(statistics.proportion(trials, len(results)), 1)
        said = f"{count(results)}{what(results)}, in {trials} of {len(results)} trials, {share}"
        return Found(trials == 0, said, len(results), trials > 0) if results else None

    return measure


def _contacts(choose: Choose) -> Measure:
    return _none(choose, _hits, lambda _: "")


def _drove_into(choose: Choose) -> Measure:
    return _none(choose, drove_into, lambda results: f" of {_hits(results)} contacts")


def _hits(results: list[Result]) -> int:
    return sum(len(result["contacts"]) for result in results)


def _over_line(choose: Choose) -> Measure:
    """Trials in which the gripper is ever faster towards what moves than the damper line allows."""

    def measure(store: Store, method: str) -> Found | None:
        results = [result for result in choose(store, method) if result.get("measures") is not None]
        speeds = [data.measure(result, "approach_excess_mps") for result in results]
        near = [value for value in speeds if value is not None]
        over = sum(value > LINE for value in near)
        share = data.percent(statistics.proportion(over, len(results)), 1)
        most = f"largest excess {max(near):.3f} m/s" if near else "never near"
        said = f"over it in {over} of {len(results)} trials, {share}; {most}"
        return Found(over == 0, said, len(results), over > 0) if results else None

    return measure


def _mean_at_most(choose: Choose, limit: float) -> Measure:
    def measure(store: Store, method: str) -> Found | None:
        results = choose(store, method)
        time = data.mean_time(results)
        good = time.value <= limit
        said = f"{time.text(_decimals(time.value, limit, good=good))} s{_of(results, time.n)}"
        return Found(good, said, len(results)) if time.n else None

    return measure


def _longer_at_most(choose: Choose, alone: Choose, limit: float) -> Measure:
    def measure(store: Store, method: str) -> Found | None:
        others = alone(store, method)
        seeds = {result["seed"] for result in others}
        results = [result for result in choose(store, method) if result["seed"] in seeds]
        longer = statistics.paired_ratio(data.times(results), _renamed(data.times(others), results))
        good = longer.value <= limit
        decimals = _decimals(100.0 * longer.value, 100.0 * limit, good=good)
        said = f"{data.percent(longer, decimals)}{_of(results, longer.n)}"
        return Found(good, said, len(results)) if longer.n else None

    return measure


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


GOALS = (
    Goal("Experiment 1, random: objects placed", "all", _placed(_ours("exp1"))),
    Goal("Experiment 1, random: contacts", "0", _contacts(_ours("exp1"))),
    Goal("Experiment 1, random: mean time", "at most 96 s", _mean_at_most(_ours("exp1"), 96.0)),
    Goal("Experiment 1a, random: objects placed", "all", _placed(_ours("exp1a"))),
    Goal("Experiment 1a, random: contacts", "0", _contacts(_ours("exp1a"))),
    Goal("Experiment 1a, random: mean time", "at most 107 s", _mean_at_most(_ours("exp1a"), 107.0)),
    Goal("Experiment 2, four Temis: objects placed", "all", _placed(_ours("exp2"))),
    Goal("Experiment 2, four Temis: contacts that we drove into", "0", _drove_into(_ours("exp2"))),
    Goal("Experiment 2, four Temis: gripper's own approach speed over the damper line", f"at most {LINE} m/s",
         _over_line(_ours("exp2"))),
    Goal("Experiment 2, four Temis: longer than Experiment 1, by seed", "at most 25 %",
         _longer_at_most(_ours("exp2"), _ours("exp1"), 0.25)),
    Goal("Experiment 2, one Temi: longer than Experiment 1, by seed", "at most 5 %",
         _longer_at_most(_ours("exp2", "one_temi"), _ours("exp1", "trial1"), 0.05)),
)  # fmt: skip
