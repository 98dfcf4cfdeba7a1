"""What `motm-twin paper` makes of results: right numbers, published ones marked, and nothing where nothing was run."""

import re

import msgspec
import pytest
from matplotlib.figure import Figure
from rich.console import Console

from motm_twin.perception.tracks import TrackParameters
from motm_twin.sessions.session import SOURCE, made_with
from motm_twin.studies import statistics
from motm_twin.studies.paper import data, report, sweep_figures, tables, time_figures
from motm_twin.studies.paper.data import TEN, Store, origin
from motm_twin.studies.paper.drawing import Drawn, Missing
from motm_twin.studies.paper.episode import draw_cutting_in, draw_snapshots, watch_trial
from motm_twin.studies.paper.parts import NAMES, PARTS, Context, make_part
from motm_twin.studies.paper.report import write
from motm_twin.studies.paper.tables import LINE, goal_rows, missed
from motm_twin.studies.spec import TrialSpec, job_of
from motm_twin.studies.statistics import proportion

from .made_results import drawn, episode, moment, result, seeds, trials

OURS = trials("motm", [80.0, 82.0, 84.0, 86.0, 88.0, 90.0])
THEIRS = trials("sequential", [160.0, 164.0, 168.0, 172.0, 176.0, 180.0])
MIXED = {  # as `--full` has them: what there is to meet differs between the groups of an experiment
    "exp1": [*trials(), *seeds([100.0] * 5), *seeds([70.0] * 3, variant="trial1", first=1),
             *trials("irm", [120.0] * 10)],
    "exp2": [*seeds([110.0] * 4, scene="exp2", excess=0.03),
             *seeds([82.0] * 3, variant="one_temi", scene="exp2", excess=-0.1)],
}  # fmt: skip
PUBLISHED = "1, published arrangements"


def by_group(part):
    return {(row["experiment"], row["method"]): row for row in part.rows if not row.get("published")}


def test_the_results_table_has_our_means_and_marks_the_published_rows():
    broken = result("motm", "trial7", 12.0, places_done=2, success=False, reason="lost")
    part = drawn(tables.draw_results(Store({"exp1": [*OURS, broken, *THEIRS]})))
    ours = by_group(part)[PUBLISHED, "motm"]
    assert ours["mean_s"] == pytest.approx(85.0)  # what was not completed has no time, but is counted
    assert ours["mean_low_s"] < 85.0 < ours["mean_high_s"]
    assert (ours["trials"], ours["completed"], ours["placed"]) == (7, 6, "38/42")
    assert all(part.rows[index]["published"] for index in part.marked)
    assert sum(row["published"] for row in part.rows) == len(part.marked) == 8
    assert {172.3, 192.9, 95.9, 85.6} <= {row["mean_s"] for row in part.rows if row["published"]}


def test_measures_and_results_are_of_the_same_groups_and_every_trial_is_in_one():
    store = Store(MIXED)
    measures, whole = by_group(drawn(tables.draw_measures(store))), drawn(tables.draw_results(store))
    counts = {
        (PUBLISHED, "motm"): 10, ("1, random", "motm"): 5, ("1, trial 1, other seeds", "motm"): 3,
        (PUBLISHED, "irm"): 10, ("2, four Temis", "motm"): 4, ("2, one Temi", "motm"): 3,
    }  # fmt: skip
    assert {key: row["trials"] for key, row in measures.items()} == counts
    assert {key: row["trials"] for key, row in by_group(whole).items() if key[0] != "1, trial 1"} == counts
    counted = [id(each) for *_, results in tables.grouped(store) for each in results]
    assert sorted(counted) == sorted(id(each) for _, each in store.all())
    assert whole.n.startswith(f"{len(counted)} trials")


def test_trials_over_the_damper_line_are_counted_and_a_line_that_nobody_was_near_is_no_zero():
    near = [result(scene="exp2", variant="random", seed=seed, excess=excess)
            for seed, excess in enumerate([2.0 * LINE, -0.1, None, 0.5 * LINE])]  # fmt: skip
    part = drawn(tables.draw_measures(Store({"exp1": trials(), "exp2": near})))
    over_line = f"Trials over the damper line by {LINE} m/s"
    said = {cells["Experiment"]: cells[over_line] for cells in part.cells}
    assert said == {PUBLISHED: "-", "2, four Temis": "1/4"}
    assert by_group(part)["2, four Temis", "motm"]["over_line"] == 1


def test_the_numbers_to_cite_have_no_mean_over_different_settings():
    sweep = [each for weight, value in ((0.0, 90.0), (2.0, 96.0))
             for each in trials(seconds=[value] * 2, parameters={"next_weight": weight})]  # fmt: skip
    errors = [result(scene="turn", variant="quiet", time_s=value, changes={"faults.grasp_delay": level})
              for level, value in ((0.0, 10.0), (5.0, 16.0))]  # fmt: skip
    store = Store({**MIXED, "sweep_next_weight": sweep, "grasp_delay": errors})
    record = report.record(store, origin([], "draw"), "draw", [])
    assert record["version"]
    assert record["source"] == record["made_with"]["source"]
    assert record["machine"]
    assert record["parameters"]["next_weight"] == 1.05
    found = {name: each["methods"] for name, each in record["experiments"].items()}
    assert record["experiments"]["exp1"]["seeds"] == [0, 1, 2, 3, 4]
    assert found["exp1"]["irm"]["mean_s"] == 120.0
    assert not any("mean_s" in each["motm"] for each in found.values())
    means = {name: {group: each["mean_s"] for group, each in methods["motm"]["groups"].items()}
             for name, methods in found.items()}  # fmt: skip
    assert means == {
        "exp1": {PUBLISHED: 80.0, "1, random": 100.0, "1, trial 1, other seeds": 70.0},
        "exp2": {"2, four Temis": 110.0, "2, one Temi": 82.0},
        "sweep_next_weight": {f"{PUBLISHED}, next_weight=0": 90.0, f"{PUBLISHED}, next_weight=2": 96.0},
        "grasp_delay": {"turn, quiet, faults.grasp_delay=0": 10.0, "turn, quiet, faults.grasp_delay=5": 16.0},
    }  # fmt: skip
    assert found["exp1"]["motm"]["trials"] == 18


def test_success_is_counted_over_trials_not_over_their_objects():
    ours = trials()
    ours[3] |= {"places_done": 5, "success": False}
    ours[4] = result(variant=TEN[4], hits=2)
    part = drawn(tables.draw_results(Store({"exp1": ours})))
    index = next(k for k, row in enumerate(part.rows) if row["experiment"] == PUBLISHED)
    cells, share = part.cells[index], proportion(8, 10)
    assert cells["Trials with success [95 % CI]"] == f"8/10 [{100 * share.low:.0f}, {100 * share.high:.0f}] %"
    assert (cells["Objects placed"], cells["Trials completed"]) == ("59/60", "9 of 10")
    assert (part.rows[index]["success_low"], part.rows[index]["success_high"]) == (share.low, share.high)


def test_completed_is_the_same_in_bench_and_in_the_report_and_all_captions_say_what_it_is():
    """A trial that was given up has no time, whatever it says of success; one with a contact has, and no success."""
    touched = result(time_s=77.0, hits=3)
    (row,) = statistics.rows([touched, result(places_done=5, time_s=9.0)])
    assert row.time.value == data.mean_time([touched]).value == 77.0
    assert (row.time.n, row.success.value, row.contacts) == (1, 0.5, 0)
    store = Store({"exp1": [touched, result("irm")]})
    draws = (tables.draw_results, time_figures.draw_reductions, time_figures.draw_box_plots)
    for caption in (statistics.CAPTION, *(drawn(draw(store)).caption for draw in draws)):
        assert statistics.COMPLETED in caption
        assert statistics.TOUCHED in caption


def judged(exp1, exp2=()):
    return {(row[0], row[2]): row for row in goal_rows(Store({"exp1": exp1, "exp2": exp2}))}


def test_goals_are_judged_for_each_method_by_its_own_trials_and_not_on_few():
    time = "Experiment 1, random: mean time"
    assert {row[-1] for row in judged(seeds([80.0] * 10)).values()} == {"so far reached", ""}
    rows = judged(seeds([80.0] * 50))
    assert rows[time, "motm"][-1] == "reached"
    assert rows[time, "fast"][-3:] == ("not measured", "0", "")
    assert rows["Experiment 2, four Temis: objects placed", "motm"][3] == "not measured"
    rows = judged([*seeds([97.0] * 50), *seeds([80.0] * 50, "fast")])
    assert (rows[time, "motm"][-1], rows[time, "fast"][-1]) == ("missed", "reached")


@pytest.mark.parametrize(
    ("seconds", "said", "verdict"),
    [(100.24, "25.3 % [25.3, 25.3]", "missed"), (100.0, "25.0 %", "reached"), (100.02, "25.02 %", "missed")],
)
def test_what_is_missed_by_little_does_not_read_as_the_limit(seconds, said, verdict):
    around = [seconds + 0.01 * (-1) ** seed for seed in range(50)]
    rows = judged(seeds([80.0] * 50), seeds(around, scene="exp2"))
    row = rows["Experiment 2, four Temis: longer than Experiment 1, by seed", "motm"]
    assert row[3].startswith(said)
    assert row[-1] == verdict


def test_the_gripper_is_judged_by_the_trials_in_which_it_is_over_its_line():
    def row(last):
        near = [*seeds([90.0] * 49, scene="exp2", excess=-0.05), *seeds([90.0], first=49, scene="exp2", excess=last)]
        name = "Experiment 2, four Temis: gripper's own approach speed over the damper line"
        return judged([], near)[name, "motm"]

    said = "over it in 0 of 50 trials, 0.0 % [0.0, 7.1]; largest excess -0.050 m/s"
    assert row(None)[1:] == ("at most 0.02 m/s", "motm", said, "50", "reached")
    said = "over it in 1 of 50 trials, 2.0 % [0.1, 10.6]; largest excess 0.113 m/s"
    assert row(0.113)[3:] == (said, "50", "missed")


def test_whatever_is_missed_is_said_with_number_and_interval():
    hit = {"caused_by_robot": True, "closing_speed": 0.2}
    random = seeds([97.0, 98.0] * 25)
    random[3] |= {"contacts": [hit, hit], "places_done": 5}
    assert missed(goal_rows(Store({"exp1": random}))) == [
        "Missed by motm: Experiment 1, random: objects placed: 299/300, 99.7 % [98.2, 100.0], wanted all (n = 50).",
        "Missed by motm: Experiment 1, random: contacts: 2, in 1 of 50 trials, 2.0 % [0.1, 10.6], wanted 0 (n = 50).",
        "Missed by motm: Experiment 1, random: mean time: 97.5 [97.3, 97.6] s over 49 of 50 trials, "
        "wanted at most 96 s (n = 50).",
    ]
    few = missed(goal_rows(Store({"exp1": random[:5]})))
    assert [each.partition(":")[0] for each in few] == ["Missed by motm", "Missed by motm", "So far missed by motm"]


def test_what_was_not_run_is_missing_with_its_reason(tmp_path):
    context = Context(Store({}), tmp_path, Console(quiet=True), pages=False)
    for source in PARTS:
        if source.needs:
            part = make_part(source, context)
            assert isinstance(part, Missing), source.name
            assert part.reason
            assert part.command == f"motm-twin paper --out {tmp_path} --only {source.name}"


def test_the_report_is_one_file_that_loads_nothing_and_every_figure_has_files(tmp_path):
    stuck = result("irm", "trial9", 9.0, success=False, places_done=0, reason="stuck")
    context = Context(Store({"exp1": [*OURS, *THEIRS, stuck]}), tmp_path, Console(quiet=True), pages=False)
    names = [name for name in NAMES if name not in ("layout", "global_path", "base_placement")]
    document = write(context, origin([], "draw"), "draw", names, ("Quick.",)).read_text()
    assert not re.search(r"""(src|href)\s*=\s*["'](?!data:|#)""", document)
    assert not re.search(r"https?://|@import|url\(|<script|<link|<iframe", document)
    assert document.count("<img") == document.count("data:image/png;base64,") >= 4
    for text in ("stuck", "the experiment robustness was not run", "What differs from the paper", "172.3", "Quick."):
        assert text in document
    files = sorted((tmp_path / "figures").glob("reductions.*"))
    assert [path.suffix for path in files] == [".csv", ".json", ".png", ".svg"]
    assert files[0].read_text().splitlines()[0].startswith("experiment,rival,reduction")
    assert (tmp_path / "part_of_results.json").is_file()


def near_a_temi(cut_ins):
    """A made-up episode of 60 periods in which a Temi is near a robot with an object."""
    shown = {"task": "place drop1", "phase": "reach", "plan": ((1.0, 0.0, 0.0),) * 4, "path": ((1.0, 0.0), (3.0, 0.0)),
             "goal": (3.0, 0.0), "target": (4.25, -1.29)}  # fmt: skip
    moments = [moment(k, (2.0, 0.6 - 0.02 * k, -1.57), pose=(1.0 + 0.02 * k, 0.0, 0.0), **shown) for k in range(60)]
    return episode(moments=moments, cut_ins=cut_ins)


def draft(figure, path, save=Figure.savefig, **_):
    """Save a figure as a small picture only: everything is drawn, in half the time."""
    if path.suffix == ".png":
        save(figure, path, dpi=20)


def report_among_temis(out, monkeypatch, cut_ins, names=NAMES):
    monkeypatch.setattr(Figure, "savefig", draft)
    monkeypatch.setattr("motm_twin.studies.paper.episode._photographs", lambda _, chosen: [[[[0, 0, 0]]]] * len(chosen))
    context = Context(Store({"exp1": OURS}), out, Console(quiet=True), plan="quick")
    context.episode = near_a_temi(cut_ins)
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
    for about in (out / "figures").glob("*.json"):
        assert f"--quick --out '{out}' --only {about.stem}" in about.read_text()


def test_what_these_trials_do_not_have_is_looked_for_with_the_next_larger_plan(tmp_path, monkeypatch):
    part = draw_cutting_in(near_a_temi([]), near_a_temi([]))
    assert isinstance(part, Missing)
    assert "in none of the completed trials" in part.reason
    document = report_among_temis(tmp_path, monkeypatch, [], ["cutting_in"])
    assert 'class="missing" id="cutting_in"' in document
    assert f"motm-twin paper --out {tmp_path} --only cutting_in" in document


def test_a_watched_trial_of_another_source_says_so(tmp_path):
    context = Context(Store({}), tmp_path, Console(quiet=True), sources=("0123456789ab",))
    context.episode = near_a_temi([])
    (source,) = (each for each in PARTS if each.name == "gripper_distance")
    part = source.make(context)
    assert isinstance(part, Drawn)
    assert part.notes[-1] == f"Watched with source {made_with()[SOURCE]}; the trials are of 0123456789ab."


def test_an_episode_of_the_source_of_the_trials_is_taken_from_the_folder(tmp_path):
    kept = msgspec.structs.replace(near_a_temi([]), source="0123456789ab")
    name = f"{job_of(kept.spec).key(kept.source)}.json"
    (tmp_path / name).write_bytes(msgspec.json.encode(kept))
    assert watch_trial(kept.spec, tmp_path, "0123456789ab") == kept
    part = draw_snapshots(kept)
    assert isinstance(part, Missing)
    assert "another source (0123456789ab)" in part.reason


def test_measures_are_read_by_name_and_lists_are_counted():
    one = result(measures={"cut_ins": [{}, {}], "closing_base_speed_mps": {"mean": 0.3}})
    assert data.measure(one, "cut_ins") == 2.0
    assert data.measure(one, "closing_base_speed_mps", "mean") == 0.3
    assert data.measure(one, "retries") is None
    assert data.measure(result(measures=None), "cut_ins") is None


def test_what_is_static_is_said_as_the_loop_has_it():
    text = report.body()
    assert f"has rested for {TrackParameters().rests:g} s" in text
    assert "been in the same place for 3 s" in text
    assert "stood for 3 s" not in text


@pytest.mark.parametrize(
    ("experiment", "parameter", "value", "found"),
    [
        ("sweep_next_weight", "next_weight", 0.0, {"exp1": OURS, "seconds": (90.0, 93.0), "slower": 10.5}),
        ("sweep_radius_max", "radius_max", 0.7, {"scene": "exp1a", "seconds": (90.0, 92.0, 94.0), "slower": 10.0}),
        ("sweep_next_weight", "next_weight", 2.0, {"exp1": (), "seconds": (84.0, 84.0), "slower": 4.0}),
    ],
    ids=["with the shipped value", "among boxes with Experiment 1a", "of bench with its own shipped value"],
)
def test_a_sweep_is_compared_by_arrangement_and_with_no_other_method(experiment, parameter, value, found):
    scene = found.get("scene", "exp1")
    changed = {"parameters": {parameter: value}, "scene": scene}
    others = [*trials(seconds=found["seconds"], **changed), *trials("fast", [60.0] * 2, **changed)]
    own = trials(seconds=[80.0] * 2) if found.get("exp1") == () else []
    boxes = [each | {"scene": "exp1a"} for each in OURS]
    store = Store({"exp1": found.get("exp1", OURS), "exp1a": boxes, experiment: [*own, *others]})
    (row,) = drawn(sweep_figures.draw_sweeps(store)).rows
    assert (row["scene"], row["value"], row["pairs"]) == (scene, value, len(found["seconds"]))
    assert row["slower_s"] == pytest.approx(found["slower"])
