"""`motm-twin paper` as it is called: trials that are run, kept and drawn in one go, and what it refuses."""

import json

import pytest

from motm_twin.bench.experiments.spec import Experiment, TrialSpec
from motm_twin.bench.paper import cli_paper, plan
from motm_twin.bench.paper.cli_paper import paper
from motm_twin.bench.paper.stored import stored

SHORT = {"time_limit": 2.0}  # [s] the trial ends long before its task: enough for the way through


@pytest.fixture
def short(monkeypatch):
    """A plan of two trials of two seconds, on the same way as the others."""
    specs = tuple(TrialSpec("exp1", "trial1", method=method, changes=SHORT) for method in ("motm", "staa"))
    tiny = plan.Plan(name="quick", experiments=(Experiment("ablations", "Two seconds", specs),))
    monkeypatch.setitem(plan.PLANS, "quick", lambda: tiny)


def test_a_run_keeps_every_trial_and_reports_those_without_success(short, tmp_path, monkeypatch):
    assert paper(out=tmp_path, quick=True, workers=1, no_page=True, only=("ablations", "bezier")) == 0
    trials, sources = stored(tmp_path)
    assert len(trials["ablations"]) == 2
    assert len(sources) == 1
    record = json.loads((tmp_path / "part_of_results.json").read_text())
    assert [each["method"] for each in record["without_success"]] == ["motm", "staa"]
    assert "time limit" in record["without_success"][0]["reason"]
    assert "time limit" in (tmp_path / "part_of_report.html").read_text()
    assert record["parts"]["ablations"]["missing"]
    assert (tmp_path / "figures" / "bezier.png").is_file()

    def never(*_, **__):
        raise AssertionError("drawing runs nothing")

    monkeypatch.setattr("motm_twin.bench.experiments.run.run_job", never)
    assert paper(out=tmp_path, quick=True, draw=True, no_page=True, only=("bezier",)) == 0


@pytest.mark.parametrize(
    ("options", "why"),
    [
        ({"only": ("bezir",)}, "did you mean"),
        ({"quick": True, "full": True}, "exclude"),
        ({"workers": 0}, "at least 1"),
        ({"full": True}, "--yes"),
    ],
)
def test_what_cannot_be_done_is_refused_with_a_sentence(options, why, tmp_path, capsys):
    assert paper(out=tmp_path, **options) == 2
    assert why in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_the_expected_hours_are_said_before_a_long_run(tmp_path, capsys):
    paper(out=tmp_path, full=True)
    assert " h with 2 processes" in capsys.readouterr().out


def test_only_the_experiments_that_are_needed_are_run():
    whole = plan.default()
    assert {each.name for each in cli_paper._needed(whole, ("bezier", "layout")).experiments} == set()
    assert {each.name for each in cli_paper._needed(whole, ("ablations",)).experiments} == {"exp1", "ablations"}
    assert cli_paper._needed(whole, ()) is whole


def test_an_empty_folder_has_no_trials(tmp_path):
    assert stored(tmp_path) == ({}, [])
