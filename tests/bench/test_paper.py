"""What `motm-twin paper` makes of results: right numbers, published ones marked, and nothing where nothing was run."""

import re

import pytest
from rich.console import Console

from motm_twin.bench import robustness
from motm_twin.bench.paper import (
    ablation,
    box_plots,
    cite,
    data,
    faults,
    goals,
    reductions,
    results_table,
    sweeps,
    time_split,
)
from motm_twin.bench.paper.context import Context
from motm_twin.bench.paper.data import Store
from motm_twin.bench.paper.part import Drawn, Missing, save
from motm_twin.bench.paper.parts import NAMES, PARTS
from motm_twin.bench.paper.plan import ABLATIONS, COMPARED, TEN, Plan, default, full, quick
from motm_twin.bench.paper.plan import OURS as OWN
from motm_twin.bench.paper.report import write
from motm_twin.methods.registry import METHODS


def result(method="motm", variant="trial1", time_s=80.0, **changes):
    good = {
        "scene": "exp1", "method": method, "variant": variant, "seed": 0, "success": True, "time_s": time_s,
        "picks_done": 6, "picks_total": 6, "places_done": 6, "places_total": 6, "contacts": [],
        "contacts_caused_by_robot": 0, "path_length_m": 40.0, "parameters": {}, "changes": {}, "reason": "",
        "measures": {
            "phases_s": {"driving": time_s - 10.0, "closing": 5.0, "waiting_for_arm": 3.0, "stationary": 2.0},
            "moving_share": 0.9, "retries": 0, "cut_ins": [], "near_misses": [], "evasive_manoeuvres": [],
        },
    }  # fmt: skip
    return good | changes


def trials(method, seconds):
    return [result(method, variant, value) for variant, value in zip(TEN, seconds, strict=False)]


OURS = trials("motm", [80.0, 82.0, 84.0, 86.0, 88.0, 90.0])
THEIRS = trials("sequential", [160.0, 164.0, 168.0, 172.0, 176.0, 180.0])


def test_the_plans_hold_what_the_issue_asks_for():
    for plan, exp1, exp1a, exp2 in ((default(), 10, 10, 5), (full(), 60, 60, 50)):
        specs = {each.name: each.specs for each in plan.experiments}
        for method in {*COMPARED, *OWN} & set(METHODS):
            counts = [sum(each.method == method and each.variant != "one_temi" for each in specs[name])
                      for name in ("exp1", "exp1a", "exp2")]  # fmt: skip
            assert counts[0] >= exp1
            assert counts[1:] == [exp1a, exp2]
        for method in ABLATIONS:
            assert sum(each.method == method for each in specs["ablations"]) >= 10
    assert quick().trials() < 30
    assert full().hours(2) > default().hours(2) > quick().hours(2)


def test_the_results_table_has_our_means_and_marks_the_published_rows():
    part = results_table.draw(Store({"exp1": [*OURS, *THEIRS]}))
    assert isinstance(part, Drawn)
    ours = next(
        row for row in part.rows if row["experiment"] == "1, published arrangements" and row["method"] == "motm"
    )
    assert ours["mean_s"] == pytest.approx(85.0)
    assert ours["mean_low_s"] < 85.0 < ours["mean_high_s"]
    assert ours["placed"] == "36/36"
    assert all(part.rows[index]["published"] for index in part.marked)
    assert sum(row["published"] for row in part.rows) == len(part.marked) == 8
    assert {172.3, 192.9, 95.9, 85.6} <= {row["mean_s"] for row in part.rows if row["published"]}


def test_a_trial_that_was_not_completed_has_no_time_but_is_counted():
    broken = result("motm", "trial7", 12.0, places_done=2, success=False, reason="lost")
    part = results_table.draw(Store({"exp1": [*OURS, broken]}))
    assert isinstance(part, Drawn)
    ours = next(row for row in part.rows if row["experiment"] == "1, published arrangements")
    assert ours["mean_s"] == pytest.approx(85.0)
    assert (ours["trials"], ours["completed"], ours["placed"]) == (7, 6, "38/42")


def test_box_plots_show_published_numbers_only_where_there_are_any():
    boxes = [each | {"scene": "exp1a"} for each in (*OURS, *THEIRS)]
    store = Store({"exp1": [*OURS, *THEIRS], "exp1a": boxes})
    part = box_plots.draw(store)
    assert isinstance(part, Drawn)
    assert part.figure is not None
    diamonds = [
        [tuple(line.get_xdata()) for line in axes.lines if line.get_marker() == "D" and len(line.get_xdata())]
        for axes in part.figure.axes
    ]
    assert diamonds[0] == [(95.9,), (172.3,)]
    assert diamonds[1] == []
    assert len(part.rows) == 24


def test_reductions_are_paired_and_the_published_one_stands_beside_them():
    part = reductions.draw(Store({"exp1": [*OURS, *THEIRS]}))
    assert isinstance(part, Drawn)
    (row,) = part.rows
    assert row["reduction"] == pytest.approx(0.5, abs=1e-9)
    assert row["saved_s"] == pytest.approx(85.0)
    assert row["published_reduction"] == pytest.approx(0.43)
    assert row["pairs"] == 6
    assert any("172.3" in note for note in part.notes)


def test_a_modification_without_a_shown_effect_is_said_to_have_none():
    slower = trials("no_bezier", [90.0, 91.0, 95.0, 96.0, 97.0, 101.0])
    same = trials("no_arm_avoidance", [81.0, 81.0, 85.0, 85.0, 89.0, 89.0])
    part = ablation.draw(Store({"exp1": OURS, "ablations": [*slower, *same]}))
    assert isinstance(part, Drawn)
    verdicts = {row["method"]: row["verdict"] for row in part.rows}
    assert verdicts == {"no_bezier": "saves time", "no_arm_avoidance": "no effect on time shown"}
    assert any(METHODS["no_arm_avoidance"].title in note for note in part.notes)


def test_a_sweep_is_compared_with_the_shipped_value():
    swept = [result(time_s=value, variant=variant, parameters={"next_weight": 0.0})
             for variant, value in zip(TEN, (90.0, 93.0), strict=False)]  # fmt: skip
    part = sweeps.draw(Store({"exp1": OURS, "sweep_next_weight": swept}))
    assert isinstance(part, Drawn)
    (row,) = part.rows
    assert (row["value"], row["slower_s"], row["pairs"]) == (0.0, pytest.approx(10.5), 2)


def test_the_time_split_adds_up_to_the_mean_time():
    assert sum(time_split.split(Store({"exp1": OURS}), "exp1", "motm").values()) == pytest.approx(85.0)


def test_goals_are_not_judged_on_few_trials():
    random = [result(variant="random", seed=seed) for seed in range(50)]
    rows = judged(random[:10])
    assert {row[-1] for row in rows.values()} == {"so far reached", ""}
    rows = judged(random)
    assert rows["Experiment 1, random: mean time", "motm"][-1] == "reached"
    assert rows["Experiment 1, random: mean time", "fast"][-3:] == ("not measured", "0", "")
    assert rows["Experiment 2, four Temis: objects placed", "motm"][3] == "not measured"


def test_each_method_is_judged_by_its_own_trials():
    random = [result(variant="random", seed=seed) for seed in range(50)]
    slow = [each | {"time_s": 97.0} for each in random]
    rows = judged([*slow, *(each | {"method": "fast"} for each in random)])
    assert rows["Experiment 1, random: mean time", "motm"][-1] == "missed"
    assert rows["Experiment 1, random: mean time", "fast"][-1] == "reached"


def judged(exp1):
    return {(row[0], row[2]): row for row in goals.table(Store({"exp1": exp1}))}


def test_what_was_not_run_is_missing_with_its_reason():
    context = Context(Store({}), None, Console(quiet=True), pages=False)  # type: ignore[arg-type]
    for source in PARTS:
        if source.needs:
            part = source.make(context)
            assert isinstance(part, Missing), source.name
            assert part.reason
            assert "motm-twin" in part.command


def test_the_report_is_one_file_that_loads_nothing(tmp_path):
    store = Store(
        {"exp1": [*OURS, *THEIRS, result("irm", "trial9", 9.0, success=False, places_done=0, reason="stuck")]}
    )
    context = Context(store, tmp_path, Console(quiet=True), pages=False)
    names = [name for name in NAMES if name not in ("layout", "global_path", "base_placement")]
    document = write(context, Plan(name="quick", experiments=()), "motm-twin paper --quick", names, ["abc"]).read_text()
    assert not re.search(r"""(src|href)\s*=\s*["'](?!data:|#)""", document)
    assert not re.search(r"https?://|@import|url\(|<script|<link|<iframe", document)
    assert document.count("<img") == document.count("data:image/png;base64,") >= 4
    for text in ("stuck", "the experiment robustness was not run", "What differs from the paper", "172.3"):
        assert text in document
    assert (tmp_path / "figures" / "reductions.svg").is_file()
    assert (tmp_path / "part_of_results.json").is_file()


def test_results_to_cite_name_version_source_seeds_parameters_and_machine():
    record = cite.record(Store({"exp1": OURS}), "quick", "motm-twin paper --quick", ["abc"], [])
    assert record["version"]
    assert record["source"] == record["made_with"]["source"]
    assert record["machine"]
    assert record["parameters"]["next_weight"] == 1.05
    assert record["experiments"]["exp1"]["seeds"] == [0]
    assert record["experiments"]["exp1"]["methods"]["motm"]["mean_s"] == pytest.approx(85.0)


def test_every_figure_comes_with_png_svg_csv_and_json(tmp_path):
    part = reductions.draw(Store({"exp1": [*OURS, *THEIRS]}))
    assert isinstance(part, Drawn)
    save(part, tmp_path)
    assert sorted(path.suffix for path in tmp_path.iterdir()) == [".csv", ".json", ".png", ".svg"]
    assert (tmp_path / "reductions.csv").read_text().splitlines()[0].startswith("experiment,rival,reduction")


def test_measures_are_read_by_name_and_lists_are_counted():
    one = result(measures={"cut_ins": [{}, {}], "closing_base_speed_mps": {"mean": 0.3}})
    assert data.measure(one, "cut_ins") == 2.0
    assert data.measure(one, "closing_base_speed_mps", "mean") == 0.3
    assert data.measure(one, "retries") is None
    assert data.measure(result(measures=None), "cut_ins") is None


def pick(method, time_s, picked=1, **changes):
    small = {"scene": "turn", "picks_done": picked, "picks_total": 1, "places_done": 0, "places_total": 0}
    return result(method, "quiet", time_s, success=bool(picked), changes=changes, **small)


def test_a_world_without_errors_stands_at_zero_in_every_sweep():
    trials = [pick("motm", 10.0, a=0.0), pick("motm", 11.0, a=1.0), pick("motm", 12.0, b=2.0)]
    rows = faults.points(trials, success=False)
    assert [(row["sweep"], row["value"], row["estimate"]) for row in rows] == [
        ("turn: a", 0.0, 10.0), ("turn: a", 1.0, 11.0), ("turn: b", 0.0, 10.0), ("turn: b", 2.0, 12.0),
    ]  # fmt: skip


def test_a_missed_grasp_has_no_time_and_counts_against_success():
    trials = [pick("open_loop", 9.0, **{"faults.grasp_delay": 0.0}),
              pick("open_loop", 9.0, picked=0, **{"faults.grasp_delay": 5.0})]  # fmt: skip
    part = faults.draw_grasp_delay(Store({"grasp_delay": trials}))
    assert isinstance(part, Drawn)
    assert [row["value"] for row in part.rows] == [0.0]
    assert [row["estimate"] for row in faults.points(trials, success=True)] == [1.0, 0.0]


def test_every_error_that_is_swept_has_a_label_for_people():
    assert {*robustness.ERRORS, *robustness.GRASP_FAULTS} <= set(faults.LABELS)
