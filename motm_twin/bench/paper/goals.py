"""The numbers that the experiments are to reach, beside what was measured; none is judged without its trials."""

from collections.abc import Callable
from typing import Any, NamedTuple

from motm_twin.bench.experiments import statistics
from motm_twin.bench.groups import drove_into
from motm_twin.bench.paper import data
from motm_twin.bench.paper.data import Result, Store

SEEDS = 50
HEADER = ("Number", "Wanted", "Measured", "n", "")


class Goal(NamedTuple):
    """A number, and how to get at it: measured value, its text, and the number of trials."""

    name: str
    wanted: str
    measure: Callable[[Store], tuple[bool, str, int] | None]


def table(store: Store) -> list[tuple[str, ...]]:
    """Rows of all goals; what has fewer trials than the goal names says so instead of being judged."""
    rows = []
    for goal in GOALS:
        found = goal.measure(store)
        if found is None:
            rows.append((goal.name, goal.wanted, "not measured", "0", ""))
            continue
        good, said, n = found
        enough = n >= SEEDS
        verdict = ("reached" if good else "missed") if enough else ("so far reached" if good else "so far missed")
        rows.append((goal.name, goal.wanted, said, str(n), verdict))
    return rows


def _ours(scene: str, variant: str = "random") -> Callable[[Store], list[Result]]:
    return lambda store: store.of(scene, method="motm", variant=variant)


def _placed(choose: Callable[[Store], list[Result]]) -> Callable[[Store], tuple[bool, str, int] | None]:
    def measure(store: Store):
        results = choose(store)
        placed, wanted = data.placed(results)
        return (placed == wanted, f"{placed}/{wanted}", len(results)) if results else None

    return measure


def _contacts(choose: Callable[[Store], list[Result]]) -> Callable[[Store], tuple[bool, str, int] | None]:
    def measure(store: Store):
        results = choose(store)
        count = sum(len(result["contacts"]) for result in results)
        return (count == 0, str(count), len(results)) if results else None

    return measure


def _drove_into(choose: Callable[[Store], list[Result]]) -> Callable[[Store], tuple[bool, str, int] | None]:
    def measure(store: Store):
        results = choose(store)
        hits = [contact for result in results for contact in result["contacts"]]
        count = drove_into(results)
        return (count == 0, f"{count} (of {len(hits)} contacts)", len(results)) if results else None

    return measure


def _mean_at_most(
    choose: Callable[[Store], list[Result]], limit: float
) -> Callable[[Store], tuple[bool, str, int] | None]:
    def measure(store: Store):
        time = data.mean_time(choose(store))
        return (time.value <= limit, f"{time.text()} s", time.n) if time.n else None

    return measure


def _longer_at_most(
    choose: Callable[[Store], list[Result]], alone: Callable[[Store], list[Result]], limit: float
) -> Callable[[Store], tuple[bool, str, int] | None]:
    def measure(store: Store):
        longer = statistics.paired_ratio(data.times(choose(store)), _renamed(data.times(alone(store)), choose(store)))
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
