"""What `motm-twin paper` makes of results: right numbers, published ones marked, and nothing where nothing was run."""

import re
from pathlib import Path

import msgspec
import pytest
from rich.console import Console

from motm_twin.methods.registry import METHODS
from motm_twin.sessions.session import SOURCE, made_with
from motm_twin.studies import catalogue
from motm_twin.studies.paper import (
    data,
    goals,
    modifications,
    report,
    robustness,
    snapshots,
    tables,
    time_figures,
)
from motm_twin.studies.paper.data import Store, origin
from motm_twin.studies.paper.episode import watch_trial
from motm_twin.studies.paper.part import Drawn, Missing, save
from motm_twin.studies.paper.parts import NAMES, PARTS, Context, make_part
from motm_twin.studies.paper.plan import TEN
from motm_twin.studies.paper.report import write
from motm_twin.studies.spec import TrialSpec, job_of

from .made_results import drawn, episode, moment, result, trials

OURS = trials("motm", [80.0, 82.0, 84.0, 86.0, 88.0, 90.0])
THEIRS = trials("sequential", [160.0, 164.0, 168.0, 172.0, 176.0, 180.0])


def test_the_results_table_has_our_means_and_marks_the_published_rows():
    part = drawn(tables.draw_results(Store({"exp1": [*OURS, *THEIRS]})))
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
    part = drawn(tables.draw_results(Store({"exp1": [*OURS, broken]})))
    ours = next(row for row in part.rows if row["experiment"] == "1, published arrangements")
    assert ours["mean_s"] == pytest.approx(85.0)
    assert (ours["trials"], ours["completed"], ours["placed"]) == (7, 6, "38/42")


def test_box_plots_show_published_numbers_only_where_there_are_any():
    boxes = [each | {"scene": "exp1a"} for each in (*OURS, *THEIRS)]
    store = Store({"exp1": [*OURS, *THEIRS], "exp1a": boxes})
    part = drawn(time_figures.draw_box_plots(store))
    assert part.figure is not None
    diamonds = [
        [tuple(line.get_xdata()) for line in axes.lines if line.get_marker() == "D" and len(line.get_xdata())]
        for axes in part.figure.axes
    ]
    assert diamonds[0] == [(95.9,), (172.3,)]
    assert diamonds[1] == []
    assert len(part.rows) == 24


def test_reductions_are_paired_and_the_published_one_stands_beside_them():
    part = drawn(time_figures.draw_reductions(Store({"exp1": [*OURS, *THEIRS]})))
    (row,) = part.rows
    assert row["reduction"] == pytest.approx(0.5, abs=1e-9)
    assert row["saved_s"] == pytest.approx(85.0)
    assert row["published_reduction"] == pytest.approx(0.43)
    assert row["pairs"] == 6
    assert any("172.3" in note for note in part.notes)


def test_a_modification_without_a_shown_effect_is_said_to_have_none():
    slower = trials("no_bezier", [90.0, 91.0, 95.0, 96.0, 97.0, 101.0])
    same = trials("no_arm_avoidance", [81.0, 81.0, 85.0, 85.0, 89.0, 89.0])
    part = drawn(modifications.draw_ablations(Store({"exp1": OURS, "ablations": [*slower, *same]})))
    verdicts = {row["method"]: row["verdict"] for row in part.rows}
    assert verdicts == {"no_bezier": "saves time", "no_arm_avoidance": "no effect on time shown"}
    assert any(METHODS["no_arm_avoidance"].title in note for note in part.notes)


def test_modifications_are_compared_within_published_and_within_random_arrangements():
    slower = trials("no_bezier", [90.0, 91.0, 95.0, 96.0, 97.0, 101.0])
    ours = [result(variant="random", seed=seed, time_s=80.0 + seed) for seed in range(3)]
    quicker = [result(method="no_bezier", variant="random", seed=seed, time_s=70.0 + seed) for seed in range(3)]
    part = drawn(modifications.draw_ablations(Store({"exp1": [*OURS, *ours], "ablations": [*slower, *quicker]})))
    said = [(row["experiment"], row["pairs"], row["verdict"]) for row in part.rows]
    assert said == [("1, published arrangements", 6, "saves time"), ("1, random", 3, "costs time here")]
    assert part.rows[1]["slower_s"] == pytest.approx(-10.0)


def swept(value, variant, time_s, parameter="next_weight", **changes):
    return result(time_s=time_s, variant=variant, parameters={parameter: value}, **changes)


def test_a_sweep_is_compared_with_the_shipped_value():
    found = [swept(0.0, variant, value) for variant, value in zip(TEN, (90.0, 93.0), strict=False)]
    part = drawn(modifications.draw_sweeps(Store({"exp1": OURS, "sweep_next_weight": found})))
    (row,) = part.rows
    assert (row["value"], row["slower_s"], row["pairs"]) == (0.0, pytest.approx(10.5), 2)


def test_a_sweep_among_boxes_is_compared_with_experiment_1a():
    boxes = [each | {"scene": "exp1a", "time_s": 100.0} for each in OURS]
    found = [swept(0.7, variant, 110.0, "radius_max", scene="exp1a") for variant in TEN[:3]]
    part = drawn(modifications.draw_sweeps(Store({"exp1": OURS, "exp1a": boxes, "sweep_radius_max": found})))
    (row,) = part.rows
    assert (row["scene"], row["value"], row["slower_s"], row["pairs"]) == ("exp1a", 0.7, pytest.approx(10.0), 3)


def test_a_sweep_of_bench_has_its_own_shipped_value_and_no_other_method():
    shipped = [result(variant=variant, time_s=80.0) for variant in TEN[:2]]
    found = [swept(2.0, variant, 84.0) for variant in TEN[:2]]
    fast = [swept(2.0, variant, 60.0, method="fast") for variant in TEN[:2]]
    (row,) = modifications.points(Store({"sweep_next_weight": [*shipped, *found, *fast]}), "sweep_next_weight")
    assert (row["slower_s"], row["pairs"]) == (pytest.approx(4.0), 2)


def test_the_time_split_adds_up_to_the_mean_time():
    assert sum(time_figures.split(Store({"exp1": OURS}), "exp1", "motm").values()) == pytest.approx(85.0)


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


def judged(exp1, exp2=()):
    return {(row[0], row[2]): row for row in goals.table(Store({"exp1": exp1, "exp2": exp2}))}


def temis(times, **changes):
    return [result(scene="exp2", variant="random", seed=seed, time_s=value, **changes)
            for seed, value in enumerate(times)]  # fmt: skip


LONGER = "Experiment 2, four Temis: longer than Experiment 1, by seed"
LINE = "Experiment 2, four Temis: gripper's own approach speed over the damper line"


@pytest.mark.parametrize(
    ("seconds", "said", "verdict"),
    [(100.24, "25.3 % [25.3, 25.3]", "missed"), (100.0, "25.0 %", "reached"), (100.02, "25.02 %", "missed")],
)
def test_what_is_missed_by_little_does_not_read_as_the_limit(seconds, said, verdict):
    alone = [result(variant="random", seed=seed) for seed in range(50)]
    around = [seconds + 0.01 * (-1) ** seed for seed in range(50)]
    row = judged(alone, temis(around))[LONGER, "motm"]
    assert row[3].startswith(said)
    assert row[-1] == verdict


def test_the_gripper_is_judged_by_the_trials_in_which_it_is_over_its_line():
    def over(value):
        return {"approach_excess_mps": value}

    good = [*temis([90.0] * 49, measures=over(-0.05)), temis([90.0] * 50, measures=over(None))[-1]]
    row = judged([], good)[LINE, "motm"]
    said = "over it in 0 of 50 trials, 0.0 % [0.0, 7.1]; largest excess -0.050 m/s"
    assert row[1:] == ("at most 0.02 m/s", "motm", said, "50", "reached")
    row = judged([], [*good[:49], good[49] | {"measures": over(0.113)}])[LINE, "motm"]
    assert row[3:] == ("over it in 1 of 50 trials, 2.0 % [0.1, 10.6]; largest excess 0.113 m/s", "50", "missed")


def test_whatever_is_missed_is_said_with_number_and_interval():
    hit = {"caused_by_robot": True, "closing_speed": 0.2}
    random = [result(variant="random", seed=seed, time_s=97.0 + seed % 2) for seed in range(50)]
    random[3] |= {"contacts": [hit, hit], "places_done": 5}
    assert goals.missed(goals.table(Store({"exp1": random}))) == [
        "Missed by motm: Experiment 1, random: objects placed: 299/300, 99.7 % [98.2, 100.0], wanted all (n = 50).",
        "Missed by motm: Experiment 1, random: contacts: 2, in 1 of 50 trials, 2.0 % [0.1, 10.6], wanted 0 (n = 50).",
        "Missed by motm: Experiment 1, random: mean time: 97.5 [97.3, 97.6] s over 49 of 50 trials, "
        "wanted at most 96 s (n = 50).",
    ]
    few = goals.missed(goals.table(Store({"exp1": random[:5]})))
    assert [each.partition(":")[0] for each in few] == ["Missed by motm", "Missed by motm", "So far missed by motm"]


def test_what_was_not_run_is_missing_with_its_reason(tmp_path):
    context = Context(Store({}), tmp_path, Console(quiet=True), pages=False)
    for source in PARTS:
        if source.needs:
            part = make_part(source, context)
            assert isinstance(part, Missing), source.name
            assert part.reason
            assert part.command == f"motm-twin paper --out {tmp_path} --only {source.name}"


def test_the_report_is_one_file_that_loads_nothing(tmp_path):
    store = Store(
        {"exp1": [*OURS, *THEIRS, result("irm", "trial9", 9.0, success=False, places_done=0, reason="stuck")]}
    )
    context = Context(store, tmp_path, Console(quiet=True), pages=False)
    names = [name for name in NAMES if name not in ("layout", "global_path", "base_placement")]
    document = write(context, origin([], "draw"), "draw", names, ("Quick.",)).read_text()
    assert not re.search(r"""(src|href)\s*=\s*["'](?!data:|#)""", document)
    assert not re.search(r"https?://|@import|url\(|<script|<link|<iframe", document)
    assert document.count("<img") == document.count("data:image/png;base64,") >= 4
    for text in ("stuck", "the experiment robustness was not run", "What differs from the paper", "172.3", "Quick."):
        assert text in document
    assert (tmp_path / "figures" / "reductions.svg").is_file()
    assert (tmp_path / "part_of_results.json").is_file()


def watched_trial(cut_ins):
    """A made-up episode of 60 periods in which a Temi is near."""
    shown = {"task": "place drop1", "phase": "reach", "plan": ((1.0, 0.0, 0.0),) * 4, "path": ((1.0, 0.0), (3.0, 0.0)),
             "goal": (3.0, 0.0), "target": (4.25, -1.29)}  # fmt: skip
    moments = [moment(k, (2.0, 0.6 - 0.02 * k, -1.57), pose=(1.0 + 0.02 * k, 0.0, 0.0), **shown) for k in range(60)]
    return episode(moments, made_with()[SOURCE], cut_ins=cut_ins)


def report_among_temis(out, monkeypatch, cut_ins, names=NAMES):
    monkeypatch.setattr(snapshots, "_photographs", lambda _, chosen: [[[[0, 0, 0]]]] * len(chosen))
    context = Context(Store({"exp1": OURS}), out, Console(quiet=True), plan="quick")
    context.episode = watched_trial(cut_ins)
    other = msgspec.structs.replace(context.episode, spec=TrialSpec("exp2", "random", 3, "foresight"))
    monkeypatch.setattr(Context, "with_foresight", lambda *_: other)
    return write(context, origin([], "draw"), "draw", names).read_text()


def test_every_command_in_a_report_is_that_of_its_data(tmp_path, monkeypatch):
    out = tmp_path / "a report"
    out.mkdir()
    cut = {"time": 2.0, "agent": "temi_1", "gap_m": 0.6, "gap_s": 1.2, "least_gap_m": 0.6}
    document = report_among_temis(out, monkeypatch, [cut])
    codes = re.findall(r"<code>([^<]*)</code>", document.replace("&#x27;", "'"))
    commands = [each for code in codes for each in code.split("; ") if each.startswith("motm-twin")]
    one = [each for each in commands if not each.startswith("motm-twin paper") and "SCENE" not in each]
    assert sorted(one) == [
        "motm-twin run exp2 --variant random --seed 3 --method foresight",
        "motm-twin run exp2 --variant random --seed 3 --method motm",
        "motm-twin run exp2 --variant random --seed 3 --method motm",
        "motm-twin serve exp2 --variant random --seed 3 --method motm --expansions-only",
    ]
    papers = {each for each in commands if each.startswith("motm-twin paper")}
    quick = {f"motm-twin paper --quick --out '{out}' --only {name}" for name in NAMES}
    assert papers == {*quick, f"motm-twin paper --full --yes --out '{out}'"}
    assert all("--method" in each for each in commands if "SCENE" in each)
    for name in NAMES:
        about = Path(out / "figures" / f"{name}.json")
        if about.is_file():
            assert f"--quick --out '{out}' --only {name}" in about.read_text()


def test_what_these_trials_do_not_have_is_looked_for_with_the_next_larger_plan(tmp_path, monkeypatch):
    document = report_among_temis(tmp_path, monkeypatch, [], ["cutting_in"])
    assert 'class="missing" id="cutting_in"' in document
    assert f"motm-twin paper --out {tmp_path} --only cutting_in" in document


def test_a_watched_trial_of_another_source_says_so(tmp_path):
    context = Context(Store({}), tmp_path, Console(quiet=True), sources=("0123456789ab",))
    context.episode = watched_trial([])
    (source,) = (each for each in PARTS if each.name == "gripper_distance")
    part = source.make(context)
    assert isinstance(part, Drawn)
    assert part.notes[-1] == f"Watched with source {made_with()[SOURCE]}; the trials are of 0123456789ab."


def test_an_episode_of_the_source_of_the_trials_is_taken_from_the_folder(tmp_path):
    kept = msgspec.structs.replace(watched_trial([]), source="0123456789ab")
    name = f"{job_of(kept.spec).key(kept.source)}.json"
    (tmp_path / name).write_bytes(msgspec.json.encode(kept))
    assert watch_trial(kept.spec, tmp_path, "0123456789ab") == kept
    part = snapshots.draw(kept)
    assert isinstance(part, Missing)
    assert "another source (0123456789ab)" in part.reason


def test_results_to_cite_name_version_source_seeds_parameters_and_machine():
    record = report.record(Store({"exp1": OURS}), origin([], "draw"), "draw", [])
    assert record["version"]
    assert record["source"] == record["made_with"]["source"]
    assert record["machine"]
    assert record["parameters"]["next_weight"] == 1.05
    assert record["experiments"]["exp1"]["seeds"] == [0]
    assert record["experiments"]["exp1"]["methods"]["motm"]["mean_s"] == pytest.approx(85.0)


def test_every_figure_comes_with_png_svg_csv_and_json(tmp_path):
    part = drawn(time_figures.draw_reductions(Store({"exp1": [*OURS, *THEIRS]})))
    save(part, tmp_path)
    assert sorted(path.suffix for path in tmp_path.iterdir()) == [".csv", ".json", ".png", ".svg"]
    assert (tmp_path / "reductions.csv").read_text().splitlines()[0].startswith("experiment,rival,reduction")


def test_measures_are_read_by_name_and_lists_are_counted():
    one = result(measures={"cut_ins": [{}, {}], "closing_base_speed_mps": {"mean": 0.3}})
    assert data.measure(one, "cut_ins") == 2.0
    assert data.measure(one, "closing_base_speed_mps", "mean") == 0.3
    assert data.measure(one, "retries") is None
    assert data.measure(result(measures=None), "cut_ins") is None


def pick(method, time_s, picked=1, seed=0, **changes):
    small = {"scene": "turn", "seed": seed, "picks_done": picked, "picks_total": 1, "places_done": 0,
             "places_total": 0}  # fmt: skip
    return result(method, "quiet", time_s, success=bool(picked), changes=changes, **small)


def test_a_world_without_errors_stands_at_zero_in_every_sweep():
    trials = [pick("motm", 10.0, a=0.0), pick("motm", 11.0, a=1.0), pick("motm", 12.0, b=2.0)]
    rows = robustness.points(trials, success=False)
    assert [(row["sweep"], row["value"], row["estimate"]) for row in rows] == [
        ("turn: a", 0.0, 10.0), ("turn: a", 1.0, 11.0), ("turn: b", 0.0, 10.0), ("turn: b", 2.0, 12.0),
    ]  # fmt: skip


def test_a_missed_grasp_has_no_time_and_counts_against_success():
    trials = [pick("open_loop", 9.0, **{"faults.grasp_delay": 0.0}),
              pick("open_loop", 9.0, picked=0, **{"faults.grasp_delay": 5.0})]  # fmt: skip
    part = drawn(robustness.draw_grasp_delay(Store({"grasp_delay": trials})))
    assert [row["value"] for row in part.rows] == [0.0]
    assert [row["estimate"] for row in robustness.points(trials, success=True)] == [1.0, 0.0]


def test_every_error_that_is_swept_has_a_label_for_people():
    assert {*catalogue.ERRORS, *catalogue.GRASP_FAULTS} <= set(robustness.LABELS)


def test_success_with_errors_is_compared_by_seed():
    trials = [pick(method, 10.0, picked=int(method == "motm" or value < 2.0 + seed), seed=seed, a=value)
              for method in ("motm", "open_loop") for seed in range(2) for value in (0.0, 1.0, 2.0)]  # fmt: skip
    part = drawn(robustness.draw_robustness(Store({"robustness": trials})))
    ours, theirs = part.notes
    assert "4 of 4 trials with an error" in ours
    assert "3 of 4 trials with an error" in theirs
    assert "by seed 25 percentage points [" in theirs
