"""Statistics of samples: means, medians, paired differences and proportions, each with its 95 % interval.

Independent of trials. Intervals of means are Student's t; `bootstrap` is for statistics without a formula, and is
seeded, so that it gives the same interval every time.
"""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import TypeVar

import msgspec
import numpy as np
from scipy import stats

from motm_twin.model.geometry import Array

K = TypeVar("K")
CONFIDENCE = 0.95
RESAMPLES = 10_000
SEED = 20260101  # of the bootstrap: any fixed number will do


class Estimate(msgspec.Struct, frozen=True, kw_only=True):
    """A value with its interval; both ends are nan where the sample is too small to have one."""

    value: float
    low: float
    high: float
    n: int

    def text(self, decimals: int = 1, *, scale: float = 1.0, sign: str = "", unit: str = "") -> str:
        """As in a table: "85.6 [84.9, 86.3]"; "-" for no value. ``sign`` "+": also of what is not negative."""
        if not math.isfinite(self.value):
            return "-"
        value, low, high = (f"{scale * each:{sign}.{decimals}f}" for each in (self.value, self.low, self.high))
        known = math.isfinite(self.low) and math.isfinite(self.high)
        return f"{value} [{low}, {high}]{unit}" if known else value + unit


def mean(values: Iterable[float], confidence: float = CONFIDENCE) -> Estimate:
    """Mean with Student's t interval: m -+ t_{n-1} s / sqrt(n)."""
    sample = _sample(values)
    n = len(sample)
    centre = float(sample.mean()) if n else math.nan
    if n < 2:
        return Estimate(value=centre, low=math.nan, high=math.nan, n=n)
    half = float(stats.t.ppf(0.5 + 0.5 * confidence, n - 1)) * float(sample.std(ddof=1)) / math.sqrt(n)
    return Estimate(value=centre, low=centre - half, high=centre + half, n=n)


def median(values: Iterable[float]) -> Estimate:
    """Median with its bootstrap interval."""
    return bootstrap(values, lambda samples: np.median(samples, axis=-1))


def bootstrap(values: Iterable[float], statistic: Callable[[Array], Array], *, resamples: int = RESAMPLES) -> Estimate:
    """Any statistic with its percentile bootstrap interval.

    ``statistic`` takes samples of shape (..., n) and gives shape (...).
    """
    sample = _sample(values)
    n = len(sample)
    value = float(statistic(sample)) if n else math.nan
    if n < 2:
        return Estimate(value=value, low=math.nan, high=math.nan, n=n)
    drawn = np.random.default_rng(SEED).integers(0, n, size=(resamples, n))
    tail = 0.5 * (1.0 - CONFIDENCE)
    low, high = np.quantile(statistic(sample[drawn]), [tail, 1.0 - tail])
    return Estimate(value=value, low=float(low), high=float(high), n=n)


def paired_difference(ours: Mapping[K, float], others: Mapping[K, float]) -> Estimate:
    """Mean of ours - others over the keys (variant and seed) that both have, with Student's t interval."""
    return mean([ours[key] - others[key] for key in ours if key in others])


def paired_ratio(ours: Mapping[K, float], others: Mapping[K, float]) -> Estimate:
    """Mean relative change ours / others - 1 over the keys that both have, with Student's t interval."""
    return mean([ours[key] / others[key] - 1.0 for key in ours if key in others])


def proportion(successes: int, n: int, confidence: float = CONFIDENCE) -> Estimate:
    """k of n with the exact interval of Clopper and Pearson: quantiles of beta(k, n - k + 1) and beta(k + 1, n - k).

    Raises ValueError unless 0 <= successes <= n.
    """
    if not 0 <= successes <= n:
        raise ValueError(f"{successes} of {n}: successes are from 0 to the number of trials")
    if n == 0:
        return Estimate(value=math.nan, low=math.nan, high=math.nan, n=0)
    tail = 0.5 * (1.0 - confidence)
    low = 0.0 if successes == 0 else float(stats.beta.ppf(tail, successes, n - successes + 1))
    high = 1.0 if successes == n else float(stats.beta.ppf(1.0 - tail, successes + 1, n - successes))
    return Estimate(value=successes / n, low=low, high=high, n=n)


def _sample(values: Iterable[float]) -> Array:
    sample = np.asarray(list(values) if not isinstance(values, Sequence) else values, dtype=float)
    if not np.isfinite(sample).all():
        raise ValueError("a sample has a value that is not finite: leave out what was not measured, and say so")
    return sample
