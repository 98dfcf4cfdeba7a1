"""`motm-twin paper` as it is called: its plans; trials that are run, kept and drawn in one go; what it refuses."""

import json
import re
import shutil
from collections import Counter
from pathlib import Path
from unittest.mock import Mock

import pytest
from own_process import run_in_this_process

from motm_twin.cli import bench
from motm_twin.cli.bench import write_paper
from motm_twin.cli.settings import PaperSettings
from motm_twin.methods.registry import METHODS
from motm_twin.sessions.session import SOURCE, made_with
from motm_twin.studies import catalogue
from motm_twin.studies.paper import data
from motm_twin.studies.paper.data import (
    ABLATIONS,
    ALL,
    LITERAL,
    OVERLAP,
    SWEEPS,
    default,
    full,
    keys,
    missing,
    quick,
    stored,
)
from motm_twin.studies.paper.parts import NAMES, PARTS, needed
from motm_twin.studies.spec import Experiment, TrialSpec

SHORT = {"time_limit": 0.5}  # [s] the trial ends long before its task: enough for the way through
HERE = made_with()[SOURCE]

pytestmark = pytest.mark.usefixtures("in_this_process")


def shorten(patch):
    """Plans of two trials of half a second, on the same way as the others."""
    specs = tuple(TrialSpec("exp1", "trial1", method=method, changes=SHORT) for method in ("motm", "staa"))
    half = (Experiment("ablations", "Half a second", specs),)
    for name in ("quick", "full"):
        tiny = data.Plan(name=name, experiments=half, notes=(f"A {name} one.",))
        patch.setitem(data.PLANS, name, lambda tiny=tiny: tiny)


@pytest.fixture
def short(monkeypatch):
    shorten(monkeypatch)


@pytest.fixture(scope="module")
def once(tmp_path_factory):
    out = tmp_path_factory.mktemp("once")
    with pytest.MonkeyPatch.context() as patch:
        shorten(patch)
        run_in_this_process(patch)
        assert run(out) == 0
    return out


@pytest.fixture
def ran(once, short, tmp_path):
    """The folder of a run of the short plan, for this test alone."""
    return Path(shutil.copytree(once, tmp_path / "ran"))


def run(out, **options):
    """The exit code of a run of the short plan without photographs."""
    given = {"quick": True, "workers": 1, "no_page": True, "only": ("ablations", "bezier"), **options}
    return write_paper(PaperSettings(out=out, **given))


def draw(out, **options):
    """What is written down when the folder is drawn."""
    assert write_paper(PaperSettings(out=out, draw=True, no_page=True, only=("bezier",), **options)) == 0
    return json.loads((out / "part_of_results.json").read_text())


def rewrite(out, change):
    """Change the lines of the store."""
    file = out / "ablations" / "trials.jsonl"
    lines = [json.loads(line) for line in file.read_text().splitlines()]
    file.write_text("".join(json.dumps(line) + "\n" for line in change(lines)))


def test_a_run_keeps_every_trial_and_reports_those_without_success(ran, monkeypatch):
    assert len(stored(ran)["ablations"]) == 2
    record = json.loads((ran / "part_of_results.json").read_text())
    assert [each["method"] for each in record["without_success"]] == ["motm", "staa"]
    assert "time limit" in record["without_success"][0]["reason"]
    report = (ran / "part_of_report.html").read_text()
    assert "time limit" in report
    assert "A quick one." in report
    assert record["parts"]["ablations"]["missing"]
    assert (ran / "figures" / "bezier.png").is_file()
    monkeypatch.setattr("motm_twin.studies.run.run_job", None)  # nothing is run
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
    assert len(missing(tmp_path, keys(data.PLANS["quick"]().experiments), retry_failed=True)[0]) == 2


def test_hours_are_confirmed_once_for_a_plan_and_a_source(short, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(bench, "WARN_HOURS", 0.0)
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
    assert write_paper(PaperSettings(out=tmp_path, **options)) == 2
    assert why in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("out", "options", "why"),
    [
        ("file", {}, "is a file: give a folder"),
        ("/proc/paper", {"quick": True}, "/proc cannot be written to: give another folder"),  # not even by root
        ("typo", {"draw": True}, "there is no trial in it to draw: give the folder of a run"),
    ],
)
def test_a_folder_that_cannot_be_or_has_no_trials_is_refused_and_not_made(out, options, why, tmp_path, capsys):
    (tmp_path / "file").touch()
    assert write_paper(PaperSettings(out=tmp_path / out, **options)) == 2
    assert why in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def test_the_default_plan_is_announced_to_take_less_than_an_hour_on_two_cores(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("motm_twin.cli.bench.run", Mock(side_effect=KeyboardInterrupt))
    assert write_paper(PaperSettings(out=tmp_path, workers=2)) == 130
    announced = re.search(r"expected to take (\d+) min with 2 processes", capsys.readouterr().out)
    assert announced is not None
    assert int(announced[1]) < 55  # the figures and photographs come after


def test_a_full_plan_takes_hours_and_a_quick_one_minutes():
    assert list(data.PLANS) == ["quick", "default", "full"]
    least = [len({repr(spec) for spec in made().specs()}) for made in data.PLANS.values()]
    assert least == sorted(least)
    assert data.hours(quick().specs(), 2) * 60.0 < 4.0
    assert data.hours(full().specs(), 2) > bench.WARN_HOURS


def counts(names, of=None):
    return {each.name: len(each.specs) for each in needed((of or default()).experiments, names)}


def test_only_the_trials_that_are_needed_are_run():
    assert counts(("bezier", "layout")) == {}
    assert counts(("cutting_in",)) == counts(("snapshots", "gripper_distance")) == {"exp2": 5}
    assert counts(("ablations",)) == {"exp1": 20, "ablations": 70}
    assert counts(("robustness",)) == {"robustness": 10 * 2 * 40}
    swept = {"sweep_next_weight": 15, "sweep_bezier_offset": 10, "sweep_radius_min": 10, "sweep_radius_max": 20}
    assert counts(("sweeps",)) == {"exp1": 5, "exp1a": 5, **swept}
    assert counts(("time_split",)) == {"exp1": 110, "exp1a": 90}
    methods = {spec.method for each in needed(default().experiments, ("ablations",)) for spec in each.specs}
    assert methods == {"motm", LITERAL, *ABLATIONS}
    assert counts(("cutting_in",), full()) == {"exp2": 50}
    assert counts(NAMES) == {each.name: len(each.specs) for each in default().experiments}


def test_every_part_that_needs_trials_finds_them_in_every_plan():
    for make in data.PLANS.values():
        for source in PARTS:
            assert {need.experiment for need in source.needs} == set(counts((source.name,), make()))


def specs_of(plan):
    return {each.name: each.specs for each in plan.experiments}


def test_the_plans_hold_what_the_issue_asks_for():
    for whole, exp1, exp1a, exp2 in ((default(), 10, 10, 5), (full(), 60, 60, 50)):
        specs = specs_of(whole)
        for method in ALL:
            counts = [sum(each.method == method and each.variant != "one_temi" for each in specs[name])
                      for name in ("exp1", "exp1a", "exp2")]  # fmt: skip
            assert counts[0] >= exp1
            assert counts[1:] == [exp1a, exp2]
        for method in (LITERAL, OVERLAP):
            assert sum(each.method == method for each in specs["exp1"]) == exp1
        for method in ABLATIONS:
            assert sum(each.method == method for each in specs["ablations"]) == exp1
    assert {*ALL, LITERAL, OVERLAP, *ABLATIONS, *catalogue.COMPARED_METHODS} <= set(METHODS)


@pytest.mark.parametrize(("plan", "alone", "late"), [(default, 10, 5), (full, 50, 50)])
def test_every_level_of_every_error_and_grasp_fault_has_as_many_seeds_as_the_plan_says(plan, alone, late):
    for name, faults_of, scenes, seeds in (
        ("robustness", catalogue.ERRORS, 1, alone),
        ("grasp_delay", catalogue.GRASP_FAULTS, len(catalogue.TASKS), late),
    ):
        counts = Counter((each.method, *each.changes.items()) for each in specs_of(plan())[name])
        assert {key[1] for key in counts} == {(field, value) for field, levels in faults_of.items() for value in levels}
        assert set(counts.values()) == {scenes * seeds}
        assert {key[0] for key in counts} >= {"motm", "open_loop"}


def test_a_quick_plan_has_one_trial_of_each_kind_as_it_says():
    specs = specs_of(quick())
    assert Counter(each.method for each in specs["exp1"]) == Counter([*ALL, LITERAL, OVERLAP])
    assert [each.method for each in specs["exp1a"]] == ["motm", "fast", "irm", "sequential"]
    assert [each.method for each in specs["exp2"]] == ["motm", "fast"]
    assert [each.method for each in specs["ablations"]] == list(ABLATIONS)
    changes = {method: [each.changes for each in specs["robustness"] if each.method == method]
               for method in ("motm", "open_loop")}  # fmt: skip
    for these in changes.values():
        assert sorted(name for each in these for name, value in each.items() if value) == sorted(catalogue.ERRORS)
    late = Counter((each.scene, each.method, *each.changes.items()) for each in specs["grasp_delay"])
    assert len(late) == 3 * 3 * 2
    assert {change for *_, change in late} == {(catalogue.DELAY, 0.0), (catalogue.DELAY, 10.0)}
    for name, (parameter, values) in SWEEPS.items():
        assert {tuple(each.parameters.items()) for each in specs[name]} == {((parameter, values[-1]),)}
    note = " ".join(quick().notes)
    for said in ("on Experiment 1", "motm, fast, irm and sequential on 1a", "one level of every error", "10 s late"):
        assert said in note


def test_the_largest_ring_is_swept_among_boxes_too():
    for whole in (quick(), default(), full()):
        specs = specs_of(whole)
        assert {each.scene for each in specs["sweep_radius_max"]} == {"exp1", "exp1a"}
        shipped = {(each.scene, each.variant, each.seed) for each in (*specs["exp1"], *specs["exp1a"])
                   if each.method == "motm"}  # fmt: skip
        swept = [(each.scene, each.variant, each.seed) for name in SWEEPS for each in specs[name]]
        assert set(swept) <= shipped


def test_the_docs_count_the_trials_of_each_plan():
    def different(plan):
        return len({(each.scene, each.variant, each.seed, each.method, *each.parameters.items(),
                     *(item for item in each.changes.items() if item[1])) for each in plan.specs()})  # fmt: skip

    text = (Path(__file__).parents[2] / "docs" / "results.md").read_text(encoding="utf-8")
    assert f"| trials | {different(default())} | {different(full())} | {different(quick())} |" in text
