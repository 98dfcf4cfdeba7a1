"""The table of methods: what it compares, and what it leaves alone."""

import io
import json
from pathlib import Path

import pytest
from rich.console import Console

from motm_twin.cli.bench import main
from motm_twin.studies.summary import published_beside, rows, summary_table

from . import made_results

SCENE = Path(__file__).parent / "half_a_metre.yaml"


def result(method="motm", seed=0, time_s=80.0, **changes):
    return made_results.result(method, time_s=time_s, **{"variant": "random", "seed": seed, **changes})


def printed(results):
    console = Console(width=200, record=True, file=io.StringIO())
    console.print(summary_table(rows(results), published_beside(results)))
    return console.export_text()


def test_methods_are_compared_by_seed_where_both_completed():
    ours = [result(seed=seed, time_s=80.0 + 10 * seed) for seed in range(4)]
    other = [result("staa", seed, 85.0 + 10 * seed) for seed in range(3)]
    failed = result("staa", 3, 5.0, success=False, places_done=2)
    motm, staa = rows([*ours, *other, failed])
    assert motm.to_motm is None
    assert staa.to_motm.value == pytest.approx(5.0)
    assert staa.to_motm.n == 3
    assert staa.time.value == 95.0  # the trial that gave up after 5 s was not fast
    assert (staa.success.value, staa.placed, staa.places) == (0.75, 20, 24)


def test_a_trial_with_contacts_has_a_time_but_no_success():
    """It was completed here with success only, and in the report with contacts or not."""
    touched = result(seed=1, time_s=90.0, success=False)
    (row,) = rows([result(), touched])
    assert (row.time.value, row.time.n, row.success.value) == (85.0, 2, 0.5)
    words = printed([touched]).split()
    assert "contacts or not" in " ".join(words)
    assert "compares with nothing" in " ".join(words)


def test_settings_have_rows_of_their_own_and_are_compared_with_the_shipped_one():
    swept = [result(seed=seed, parameters={"next_weight": 2.0}, time_s=90.0) for seed in range(2)]
    shipped, other = rows([result(seed=0), result(seed=1), *swept])
    assert (shipped.setting, other.setting) == ("", "next_weight=2")
    assert other.to_motm.value == 10.0


def test_experiment_2_is_compared_with_1_by_seed():
    hit = {"caused_by_robot": False, "closing_speed": 0.05}
    temis = [result(scene="exp2", seed=seed, time_s=100.0, contacts=[hit]) for seed in range(3)]
    alone = [result(seed=seed, time_s=80.0) for seed in range(3)]
    row, _ = rows([*temis, *alone])
    assert row.to_exp1.value == pytest.approx(0.25)
    assert (row.contacts, row.driven_into) == (3, 3)


def test_published_rows_are_marked_and_come_last():
    text = printed([result(seed=seed, time_s=80.0 + seed) for seed in range(3)])
    lines = [line for line in text.splitlines() if "published" in line]
    assert any("95.9" in line and "Table I" in line for line in lines)
    assert text.index("motm") < text.index("published")
    assert not [line for line in lines if "85.6" in line]  # one trial's time is not that of many
    assert "85.6" in printed([result(variant="trial1")])


def test_the_command_runs_prints_and_writes(tmp_path, capsys, monkeypatch):
    from motm_twin.studies import catalogue
    from motm_twin.studies.spec import TrialSpec

    entry = catalogue.Entry(
        title="Half a metre",
        specs=lambda methods, trials: (TrialSpec(str(SCENE), None, s, m) for s in range(trials or 1) for m in methods),
    )
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
