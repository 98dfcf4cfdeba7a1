"""Intervals are those of the textbooks."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from motm_twin.studies import statistics
from motm_twin.studies.statistics import Estimate


def test_the_mean_has_students_interval():
    found = statistics.mean([1.0, 2.0, 3.0, 4.0, 5.0])
    half = 2.776445105 * math.sqrt(2.5) / math.sqrt(5)  # t of 4 degrees of freedom
    assert (found.value, found.n) == (3.0, 5)
    assert (found.low, found.high) == pytest.approx((3.0 - half, 3.0 + half), abs=1e-8)


@pytest.mark.parametrize(
    ("k", "n", "low", "high"),
    [
        (0, 10, 0.0, 0.3084971),  # 1 - 0.025^(1/10)
        (10, 10, 0.6915029, 1.0),
        (58, 60, 0.8847, 0.9959),  # the paper's robot, beta quantiles
        (5, 10, 0.1870860, 0.8129140),
    ],
)
def test_proportions_have_the_exact_interval(k, n, low, high):
    found = statistics.proportion(k, n)
    assert found.value == k / n
    assert (found.low, found.high) == pytest.approx((low, high), abs=1e-4)


def test_small_samples_have_no_interval_and_none_no_value():
    assert math.isnan(statistics.mean([]).value)
    assert statistics.mean([3.0]).value == 3.0
    assert math.isnan(statistics.mean([3.0]).low)
    assert statistics.mean([3.0]).text() == "3.0"
    assert statistics.mean([]).text() == "-"
    assert math.isnan(statistics.proportion(0, 0).value)
    with pytest.raises(ValueError, match="3 of 2"):
        statistics.proportion(3, 2)
    with pytest.raises(ValueError, match="not finite"):
        statistics.mean([1.0, math.nan])


def test_differences_are_paired_by_key_and_take_out_what_both_share():
    shared = dict(enumerate(np.random.default_rng(1).normal(90.0, 10.0, 30)))
    ours = {key: value + (0.5 if key % 2 else 1.5) for key, value in shared.items()}
    found = statistics.paired_difference(ours, shared | {99: 1.0})
    assert found.n == 30
    assert found.value == pytest.approx(1.0)
    assert found.high - found.low < 0.5  # the spread of 10 s does not count
    assert statistics.paired_ratio({1: 110.0}, {1: 100.0}).value == pytest.approx(0.1)
    assert statistics.paired_difference({1: 1.0}, {2: 1.0}).n == 0


def test_the_bootstrap_gives_the_same_interval_every_time():
    sample = list(np.random.default_rng(2).normal(0.0, 1.0, 40))
    assert statistics.median(sample) == statistics.median(sample)
    found = statistics.bootstrap(sample, lambda samples: samples.mean(axis=-1))
    assert (found.low, found.high) == pytest.approx(
        (statistics.mean(sample).low, statistics.mean(sample).high), abs=0.05
    )


@given(st.lists(st.floats(-1e6, 1e6), min_size=2, max_size=20))
def test_a_value_lies_in_its_interval(sample):
    for found in (statistics.mean(sample), statistics.bootstrap(sample, lambda s: s.mean(axis=-1), resamples=50)):
        assert isinstance(found, Estimate)
        assert min(sample) - 1e-6 <= found.value <= max(sample) + 1e-6
    found = statistics.mean(sample)
    assert found.low <= found.value <= found.high


@given(st.integers(1, 200), st.data())
def test_intervals_of_proportions_hold_the_proportion_and_shrink_with_n(n, data):
    k = data.draw(st.integers(0, n))
    one, ten = statistics.proportion(k, n), statistics.proportion(10 * k, 10 * n)
    assert 0.0 <= one.low <= one.value <= one.high <= 1.0
    assert ten.high - ten.low < one.high - one.low
