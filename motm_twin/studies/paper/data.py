"""Results as figures and tables need them: by method, by trial, and only what was completed where a time is read."""

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from motm_twin.methods.registry import METHODS
from motm_twin.studies import statistics
from motm_twin.studies.paper.plan import TEN
from motm_twin.studies.spec import TrialSpec
from motm_twin.studies.statistics import Estimate
from motm_twin.studies.summary import completed

Result = dict[str, Any]
SCENES = ("exp1", "exp1a", "exp2")
Key = tuple[str, int]  # variant and seed: the same arrangement and the same noise


class Store:
    """Results by experiment; what was not run is an empty list, never an invention."""

    def __init__(self, trials: Mapping[str, Sequence[Result]]) -> None:
        self.trials = {name: _own(name, results) for name, results in trials.items()}

    def of(self, experiment: str, **fields: Any) -> list[Result]:
        """Results of an experiment in which these fields have these values."""
        found = self.trials.get(experiment, ())
        return [result for result in found if all(result.get(key) == value for key, value in fields.items())]

    def methods(self, experiment: str) -> list[str]:
        """Methods of an experiment in the order in which they are shown: the paper's first."""
        there = {result["method"] for result in self.trials.get(experiment, ())}
        known = [name for name in METHODS if name in there]
        return known + sorted(there.difference(known))

    def all(self) -> list[tuple[str, Result]]:
        """Every result with its experiment."""
        return [(name, result) for name, results in self.trials.items() for result in results]


def _own(experiment: str, results: Sequence[Result]) -> Sequence[Result]:
    """Of Experiments 1, 1a and 2 their own trials as shipped: `bench` keeps what they are compared with beside them."""
    if experiment not in SCENES:
        return results
    return [each for each in results if each["scene"] == experiment and not each["parameters"] and not each["changes"]]


def ten(results: Iterable[Result]) -> list[Result]:
    """Those of the ten published arrangements, with the seed of the scene file."""
    return [result for result in results if result["variant"] in TEN and result["seed"] == 0]


def random(results: Iterable[Result]) -> list[Result]:
    """Those of random arrangements."""
    return [result for result in results if result["variant"] == "random"]


def key(result: Result) -> Key:
    """Variant and seed of a trial: two methods are compared where these are equal."""
    return result["variant"], result["seed"]


def times(results: Iterable[Result]) -> dict[Any, float]:
    """Task times [s] of the completed trials: one that gave up early is not fast."""
    return {key(result): float(result["time_s"]) for result in results if completed(result)}


def mean_time(results: Iterable[Result]) -> Estimate:
    """Mean task time [s] of the completed trials with its interval."""
    return statistics.mean(list(times(results).values()))


def placed(results: Iterable[Result]) -> tuple[int, int]:
    """Objects delivered, and objects wanted."""
    these = list(results)
    return sum(each["places_done"] for each in these), sum(each["places_total"] for each in these)


def delivered(results: Iterable[Result]) -> Estimate:
    """Share of objects delivered, with the interval of Clopper and Pearson."""
    return statistics.proportion(*placed(results))


def contacts(results: Iterable[Result]) -> int:
    """Contacts that the robot caused."""
    return sum(int(result["contacts_caused_by_robot"]) for result in results)


def touches(results: Iterable[Result]) -> int:
    """All contacts, whoever caused them."""
    return sum(len(result["contacts"]) for result in results)


def measure(result: Result, *names: str) -> float | None:
    """One of the trial's further measures, entered by name; of a list its length; None when it was not taken."""
    value: Any = result.get("measures")
    for name in names:
        value = value.get(name) if isinstance(value, Mapping) else None
    if isinstance(value, Sequence) and not isinstance(value, str):
        return float(len(value))
    return float(value) if isinstance(value, (int, float)) else None


def command_of(spec: TrialSpec, verb: str = "run") -> str:
    """Command that runs (or serves) this trial again. Only of a trial as shipped: `run` takes no parameters."""
    assert not spec.parameters and not spec.changes
    options = {"variant": spec.variant, "seed": spec.seed, "method": spec.method}
    given = "".join(f" --{name} {value}" for name, value in options.items() if value is not None)
    return f"motm-twin {verb} {spec.scene}{given}"


def title(method: str) -> str:
    """Name of a method in tables and figures."""
    return METHODS[method].title if method in METHODS else method


def percent(estimate: Estimate, decimals: int = 0) -> str:
    """A share with its interval, as "43 % [41, 45]"."""
    if estimate.n == 0:
        return "-"
    value, low, high = (100.0 * each for each in (estimate.value, estimate.low, estimate.high))
    interval = f" [{low:.{decimals}f}, {high:.{decimals}f}]" if math.isfinite(low) and math.isfinite(high) else ""
    return f"{value:.{decimals}f} %{interval}"


def points(estimate: Estimate, decimals: int = 0) -> str:
    """A difference of two shares with its interval, as "43 percentage points [41, 45]"."""
    return percent(estimate, decimals).replace(" %", " percentage points", 1)
