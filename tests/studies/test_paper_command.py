"""`motm-twin paper` as it is called: trials that are run, kept and drawn in one go, and what it refuses."""

import json
import re
import shutil
from pathlib import Path

import pytest

from motm_twin.cli import paper as cli_paper
from motm_twin.cli.paper import paper
from motm_twin.sessions.session import SOURCE, made_with
from motm_twin.studies.paper import plan
from motm_twin.studies.paper.data import keys, missing, stored
from motm_twin.studies.paper.parts import NAMES, PARTS, needed
from motm_twin.studies.settings import PaperSettings
from motm_twin.studies.spec import Experiment, TrialSpec

SHORT = {"time_limit": 0.5}  # [s] the trial ends long before its task: enough for the way through
HERE = made_with()[SOURCE]


def shorten(patch):
    """Plans of two trials of half a second, on the same way as the others."""
    specs = tuple(TrialSpec("exp1", "trial1", method=method, changes=SHORT) for method in ("motm", "staa"))
    for name in ("quick", "full"):
        tiny = plan.Plan(
            name=name, experiments=(Experiment("ablations", "Half a second", specs),), notes=(f"A {name} one.",)
        )
        patch.setitem(plan.PLANS, name, lambda tiny=tiny: tiny)


@pytest.fixture
def short(monkeypatch):
    shorten(monkeypatch)


@pytest.fixture(scope="module")
def once(tmp_path_factory):
    out = tmp_path_factory.mktemp("once")
    with pytest.MonkeyPatch.context() as patch:
        shorten(patch)
        assert run(out) == 0
    return out


@pytest.fixture
def ran(once, short, tmp_path):
    """The folder of a run of the short plan, for this test alone."""
    return Path(shutil.copytree(once, tmp_path / "ran"))


def run(out, **options):
    """The exit code of a run of the short plan without photographs."""
    return paper(
        PaperSettings(
            out=out, **{"quick": True, "workers": 1, "no_page": True, "only": ("ablations", "bezier"), **options}
        )
    )


def draw(out, **options):
    """What is written down when the folder is drawn."""
    assert paper(PaperSettings(out=out, draw=True, no_page=True, only=("bezier",), **options)) == 0
    return json.loads((out / "part_of_results.json").read_text())


def rewrite(out, change):
    """Change the lines of the store."""
    file = out / "ablations" / "trials.jsonl"
    lines = [json.loads(line) for line in file.read_text().splitlines()]
    file.write_text("".join(json.dumps(line) + "\n" for line in change(lines)))


def never(*_, **__):
    raise AssertionError("nothing is run")


def test_a_run_keeps_every_trial_and_reports_those_without_success(ran, monkeypatch):
    trials = stored(ran)
    assert len(trials["ablations"]) == 2
    record = json.loads((ran / "part_of_results.json").read_text())
    assert [each["method"] for each in record["without_success"]] == ["motm", "staa"]
    assert "time limit" in record["without_success"][0]["reason"]
    report = (ran / "part_of_report.html").read_text()
    assert "time limit" in report
    assert "A quick one." in report
    assert record["parts"]["ablations"]["missing"]
    assert (ran / "figures" / "bezier.png").is_file()
    monkeypatch.setattr("motm_twin.studies.run.run_job", never)
    draw(ran)


def test_what_is_drawn_later_names_what_ran_the_trials(short, tmp_path, capsys):
    assert run(tmp_path) == 0
    command = f"motm-twin paper --quick --workers 1 --out {tmp_path} --only ablations bezier"
    record = json.loads((tmp_path / "part_of_results.json").read_text())
    assert (record["plan"], record["command"], record["source"]) == ("quick", command, HERE)
    assert record["drawn"]["command"] == command
    assert "Warning" not in (tmp_path / "part_of_report.html").read_text()

    elsewhere = {"source": "0123456789ab", "machine": "Abacus, 1 core", "numpy": "0.1"}
    rewrite(tmp_path, lambda lines: [line | {"made_with": line["made_with"] | elsewhere} for line in lines])
    capsys.readouterr()
    record = draw(tmp_path)
    assert (record["plan"], record["command"]) == ("quick", command)
    assert (record["source"], record["machine"]) == ("0123456789ab", "Abacus, 1 core")
    assert record["sources_of_trials"] == ["0123456789ab"]
    assert record["made_with"]["numpy"] == "0.1"
    assert record["drawn"]["source"] == HERE
    assert record["drawn"]["numpy"] == made_with()["numpy"]
    assert record["drawn"]["command"] == f"motm-twin paper --draw --out {tmp_path} --only bezier"
    report = (tmp_path / "part_of_report.html").read_text()
    head = report[: report.index("<nav>")]
    for text in ("Warning", "source 0123456789ab", "plan: quick", "Abacus, 1 core", command, HERE, "A quick one."):
        assert text in head
    assert "0123456789ab" in capsys.readouterr().out
    assert f"motm-twin paper --quick --out {tmp_path} --only bezier" in report


def test_trials_of_two_sources_are_counted_and_those_that_say_nothing_too(ran):
    rewrite(ran, lambda lines: [lines[0], lines[1] | {"made_with": {"source": "old"}}])
    record = draw(ran, full=True)
    assert record["source"] == f"{HERE} (1 trial); old (1 trial)"
    assert record["plan"] == "quick (1 trial); not recorded (1 trial)"
    assert record["machine"].endswith("; not recorded (1 trial)")
    assert "Warning" in (ran / "part_of_report.html").read_text()


def test_trials_of_another_source_are_drawn_only_where_there_are_none_of_this(ran):
    older = [{"key": f"x{k}", "made_with": {"source": "old"}} for k in range(2)]
    rewrite(ran, lambda lines: [*lines, *(line | old for line, old in zip(lines, older, strict=True))])
    assert draw(ran)["source"] == "old"
    assert run(ran) == 0
    assert json.loads((ran / "part_of_results.json").read_text())["source"] == HERE


def test_a_run_of_a_part_keeps_the_results_of_the_others(ran, monkeypatch):
    whole = (ran / "ablations" / "results.jsonl").read_bytes()
    assert len(whole.splitlines()) == 2
    monkeypatch.setattr("motm_twin.studies.paper.parts.Need.has", lambda _, spec, __: spec.method == "motm")
    assert run(ran) == 0
    assert (ran / "ablations" / "results.jsonl").read_bytes() == whole
    assert json.loads((ran / "part_of_results.json").read_text())["trials"] == 2


def test_only_what_is_missing_is_announced(short, tmp_path, capsys):
    assert run(tmp_path) == 0
    assert "2 of 2 trials to run, expected to take" in capsys.readouterr().out
    assert run(tmp_path) == 0
    assert "0 of 2 trials to run, expected to take 0 min" in capsys.readouterr().out
    wanted = keys(plan.PLANS["quick"]().experiments)
    assert len(missing(tmp_path, wanted, retry_failed=True)[0]) == 2


def test_hours_are_confirmed_once_for_a_plan_and_a_source(short, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(cli_paper, "WARN_HOURS", 0.0)
    full = {"quick": False, "full": True}
    assert run(tmp_path, **full) == 2
    assert "--yes" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())
    assert run(tmp_path, yes=True) == 0
    rewrite(tmp_path, lambda lines: lines[:1])
    assert run(tmp_path, **full) == 2  # what was begun is another plan
    assert run(tmp_path, **full, yes=True) == 0
    rewrite(tmp_path, lambda lines: lines[1:])
    assert run(tmp_path, **full) == 0
    rewrite(tmp_path, lambda lines: [line | {"key": "x", "made_with": line["made_with"] | {"source": "old"}}
                                     for line in lines])  # fmt: skip
    assert run(tmp_path, **full) == 2  # a new source begins anew


@pytest.mark.parametrize(
    ("options", "why"),
    [
        ({"only": ("bezir",)}, "did you mean"),
        ({"quick": True, "full": True}, "exclude"),
        ({"workers": 0}, "at least 1"),
    ],
)
def test_what_cannot_be_done_is_refused_with_a_sentence(options, why, tmp_path, capsys):
    assert paper(PaperSettings(out=tmp_path, **options)) == 2
    assert why in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_a_folder_that_cannot_be_is_refused(tmp_path, capsys):
    (tmp_path / "file").touch()
    assert paper(PaperSettings(out=tmp_path / "file")) == 2
    assert "is a file: give a folder" in capsys.readouterr().err
    assert paper(PaperSettings(out=Path("/proc/paper"), quick=True)) == 2  # where even root makes no folder
    assert "/proc cannot be written to: give another folder" in capsys.readouterr().err


def test_a_folder_without_trials_is_not_drawn_and_not_made(tmp_path, capsys):
    assert paper(PaperSettings(out=tmp_path / "typo", draw=True)) == 2
    assert "there is no trial in it to draw: give the folder of a run" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_the_default_plan_is_announced_to_take_less_than_an_hour_on_two_cores(tmp_path, monkeypatch, capsys):
    def stopped(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr("motm_twin.studies.run.run", stopped)
    assert paper(PaperSettings(out=tmp_path, workers=2)) == 130
    announced = re.search(r"expected to take (\d+) min with 2 processes", capsys.readouterr().out)
    assert announced is not None
    assert int(announced[1]) < 55  # the figures and photographs come after


def test_a_full_plan_takes_hours_and_a_quick_one_minutes():
    least = [len({repr(spec): None for spec in plan.PLANS[name]().specs()}) for name in ("quick", "default", "full")]
    assert least == sorted(least)
    quick = plan.quick().specs()
    assert plan.hours(quick, 2) * 60.0 < 4.0
    assert plan.hours(plan.full().specs(), 2) > cli_paper.WARN_HOURS


def counts(names, of=None):
    whole = (of or plan.default()).experiments
    return {each.name: len(each.specs) for each in needed(whole, names)}


def test_only_the_trials_that_are_needed_are_run():
    assert counts(("bezier", "layout")) == {}
    assert counts(("cutting_in",)) == counts(("snapshots", "gripper_distance")) == {"exp2": 5}
    assert counts(("ablations",)) == {"exp1": 20, "ablations": 70}
    assert counts(("robustness",)) == {"robustness": 10 * 2 * 40}
    swept = {"sweep_next_weight": 15, "sweep_bezier_offset": 10, "sweep_radius_min": 10, "sweep_radius_max": 20}
    assert counts(("sweeps",)) == {"exp1": 5, "exp1a": 5, **swept}
    assert counts(("time_split",)) == {"exp1": 110, "exp1a": 90}
    methods = {spec.method for each in needed(plan.default().experiments, ("ablations",)) for spec in each.specs}
    assert methods == {"motm", plan.LITERAL, *plan.ABLATIONS}
    assert counts(("cutting_in",), plan.full()) == {"exp2": 50}
    assert counts(NAMES) == {each.name: len(each.specs) for each in plan.default().experiments}


def test_every_part_that_needs_trials_finds_them_in_every_plan():
    for make in plan.PLANS.values():
        experiments = {each.name for each in make().experiments}
        for source in PARTS:
            assert {need.experiment for need in source.needs} <= experiments
            assert {need.experiment for need in source.needs} == set(counts((source.name,), make()))


def test_an_empty_folder_has_no_trials(tmp_path):
    assert stored(tmp_path) == {}
