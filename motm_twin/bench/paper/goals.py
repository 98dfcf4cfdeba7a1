"""The numbers that the experiments are to reach, beside what was measured; none is judged without its trials."""

from collections.abc import Callable
from typing import Any, NamedTuple

from motm_twin.bench.experiments import statistics
from motm_twin.bench.groups import drove_into
from motm_twin.bench.paper import data
from motm_twin.bench.paper.data import Result, Store
from motm_twin.bench.paper.plan import OURS

SEEDS = 50
HEADER = ("Number", "Wanted", "Method", "Measured", "n", "")

Choose = Callable[[Store, str], list[Result]]  # the trials of a method
Measure = Callable[[Store, str], tuple[bool, str, int] | None]  # whether it is reached, its text, number of trials


class Goal(NamedTuple):
    """A number, and how to get at it for a method: whether it is reached, its text, and the number of trials."""

    name: str
    wanted: str
    measure: Measure


def table(store: Store) -> list[tuple[str, ...]]:
    """Rows of all goals, for each method; what has fewer trials than the goal names says so instead of being judged."""
    return [_row(goal, store, method) for goal in GOALS for method in OURS]


def _row(goal: Goal, store: Store, method: str) -> tuple[str, ...]:
    found = goal.measure(store, method)
    if found is None:
        return (goal.name, goal.wanted, method, "not measured", "0", "")
    good, said, n = found
    verdict = ("reached" if good else "missed") if n >= SEEDS else ("so far reached" if good else "so far missed")
    return (goal.name, goal.wanted, method, said, str(n), verdict)


def _ours(scene: str, variant: str = "random") -> Choose:
    return lambda store, method: store.of(scene, method=method, variant=variant)


def _placed(choose: Choose) -> Measure:
    def measure(store: Store, method: str):
        results = choose(store, method)
        placed, wanted = data.placed(results)
        return (placed == wanted, f"{placed}/{wanted}", len(results)) if results else None

    return measure


def _contacts(choose: Choose) -> Measure:
    def measure(store: Store, method: str):
        results = choose(store, method)
        count = sum(len(result["contacts"]) for result in results)
        return (count == 0, str(count), len(results)) if results else None

    return measure


def _drove_into(choose: Choose) -> Measure:
    def measure(store: Store, method: str):
        results = choose(store, method)
        hits = [contact for result in results for contact in result["contacts"]]
        count = drove_into(results)
        return (count == 0, f"{count} (of {len(hits)} contacts)", len(results)) if results else None

    return measure


def _mean_at_most(choose: Choose, limit: float) -> Measure:
    def measure(store: Store, method: str):
        time = data.mean_time(choose(store, method))
        return (time.value <= limit, f"{time.text()} s", time.n) if time.n else None

    return measure


def _longer_at_most(choose: Choose, alone: Choose, limit: float) -> Measure:
    def measure(store: Store, method: str):
        results = choose(store, method)
        usual = _renamed(data.times(alone(store, method)), results)
        longer = statistics.paired_ratio(data.times(results), usual)
        return (longer.value <= limit, data.percent(longer), longer.n) if longer.n else None

    return measure


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
    Goal("Experiment 2, four Temis: longer than Experiment 1, by seed", "at most 25 %",
         _longer_at_most(_ours("exp2"), _ours("exp1"), 0.25)),
    Goal("Experiment 2, one Temi: longer than Experiment 1, by seed", "at most 5 %",
         _longer_at_most(_ours("exp2", "one_temi"), _ours("exp1", "trial1"), 0.05)),
)  # fmt: skip
