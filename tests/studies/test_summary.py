"""Intervals are those of the textbooks; the table of methods compares what it may, and leaves the rest alone."""

import io
import json
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.console import Console

from motm_twin.cli.bench import main
from motm_twin.studies import statistics
from motm_twin.studies.statistics import Estimate, published_beside, rows, summary_table

from .made_results import SCENE, result, seeds

pytestmark = pytest.mark.usefixtures("in_this_process")


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
    one, none = statistics.mean([3.0]), statistics.mean([])
    assert (one.value, one.text(), none.text()) == (3.0, "3.0", "-")
    assert math.isnan(none.value) and math.isnan(one.low)
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


def printed(results):
    console = Console(width=200, record=True, file=io.StringIO())
    console.print(summary_table(rows(results), published_beside(results)))
    return console.export_text()


def test_methods_are_compared_by_seed_where_both_completed():
    other = [*seeds([85.0, 95.0, 105.0], "staa"), *seeds([5.0], "staa", first=3, success=False, places_done=2)]
    motm, staa = rows([*seeds([80.0, 90.0, 100.0, 110.0]), *other])
    assert motm.to_motm is None
    assert staa.to_motm.value == pytest.approx(5.0)
    assert staa.to_motm.n == 3
    assert staa.time.value == 95.0  # the trial that gave up after 5 s was not fast
    assert (staa.success.value, staa.placed, staa.places) == (0.75, 20, 24)


def test_settings_have_rows_of_their_own_and_are_compared_with_the_shipped_one():
    swept = seeds([90.0] * 2, parameters={"next_weight": 2.0})
    shipped, other = rows([*seeds([80.0] * 2), *swept])
    assert (shipped.setting, other.setting) == ("", "next_weight=2")
    assert other.to_motm.value == 10.0


def test_experiment_2_is_compared_with_1_by_seed():
    hit = {"caused_by_robot": False, "closing_speed": 0.05}
    row, _ = rows([*seeds([100.0] * 3, scene="exp2", contacts=[hit]), *seeds([80.0] * 3)])
    assert row.to_exp1.value == pytest.approx(0.25)
    assert (row.contacts, row.driven_into) == (3, 3)


def test_published_rows_are_marked_and_come_last():
    text = printed(seeds([80.0, 81.0, 82.0]))
    assert all(said in " ".join(text.split()) for said in ("contacts or not", "compares with nothing"))
    lines = [line for line in text.splitlines() if "published" in line]
    assert any("95.9" in line and "Table I" in line for line in lines)
    assert text.index("motm") < text.index("published")
    assert not [line for line in lines if "85.6" in line]  # one trial's time is not that of many
    assert "85.6" in printed([result()])


def test_the_command_runs_prints_and_writes(tmp_path, capsys, monkeypatch):
    from motm_twin.studies import catalogue
    from motm_twin.studies.spec import TrialSpec

    specs = lambda methods, trials: (TrialSpec(SCENE, None, s, m) for s in range(trials or 1) for m in methods)  # noqa: E731
    entry = catalogue.Entry(title="Half a metre", specs=specs)
    monkeypatch.setitem(catalogue.EXPERIMENTS, "exp1", entry)
    asked = ["exp1", "--methods", "motm", "staa", "--trials", "2", "--out", str(tmp_path)]
    assert main(asked) == 0
    said = capsys.readouterr().out
    assert "4 trials run now" in said
    assert "staa" in said
    assert main(asked) == 0
    assert "0 trials run now, 4 known" in capsys.readouterr().out
    written = json.loads((tmp_path / "exp1" / "summary.json").read_text())
    assert [row["method"] for row in written["rows"]] == ["motm", "staa"]
    assert main(["exp1", "--methods", "mtom"]) == 2
    assert "did you mean motm" in capsys.readouterr().out
    assert main(["page", "--methods", "motm"]) == 2
    assert "unknown experiment 'page'" in capsys.readouterr().err
