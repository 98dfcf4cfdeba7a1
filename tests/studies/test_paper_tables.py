"""Tables and figures of the report: what is one group, what a contact does to a time, and what the figures say."""

import math
from itertools import pairwise

import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_rgb
from matplotlib.transforms import Bbox

from motm_twin.measures.agents import NEAR
from motm_twin.perception.movers import MoverParameters
from motm_twin.studies import summary
from motm_twin.studies.paper import (
    data,
    planning_figures,
    report,
    tables,
    time_figures,
)
from motm_twin.studies.paper import episode as watched
from motm_twin.studies.paper.data import Store
from motm_twin.studies.paper.goals import LINE
from motm_twin.studies.paper.part import ORANGE, Missing, styled
from motm_twin.studies.paper.plan import TEN
from motm_twin.studies.statistics import proportion

from .made_results import drawn, episode, moment, result


def ten(method="motm", **changes):
    return [result(method, variant, **changes) for variant in TEN]


def by_group(part):
    return {(row["experiment"], row["method"]): row for row in part.rows if not row.get("published")}


MIXED = {  # as `--full` has them: what there is to meet differs between the groups of an experiment
    "exp1": [*ten(), *(result(variant="random", seed=seed, time_s=100.0) for seed in range(5)),
             *(result(seed=seed, time_s=70.0) for seed in range(1, 4)), *ten("irm", time_s=120.0)],
    "exp2": [*(result(scene="exp2", variant="random", seed=seed, time_s=110.0, excess=0.03) for seed in range(4)),
             *(result(scene="exp2", variant="one_temi", seed=seed, time_s=82.0, excess=-0.1) for seed in range(3))],
}  # fmt: skip


def test_measures_are_of_one_group_each_and_of_the_same_ones_as_the_results():
    store = Store(MIXED)
    measures, results = by_group(drawn(tables.draw_measures(store))), by_group(drawn(tables.draw_results(store)))
    assert {key: row["trials"] for key, row in measures.items()} == {
        ("1, published arrangements", "motm"): 10, ("1, random", "motm"): 5, ("1, trial 1, other seeds", "motm"): 3,
        ("1, published arrangements", "irm"): 10, ("2, four Temis", "motm"): 4, ("2, one Temi", "motm"): 3,
    }  # fmt: skip
    assert {key: row["trials"] for key, row in results.items() if key[0] != "1, trial 1"} == {
        key: row["trials"] for key, row in measures.items()
    }


def test_every_trial_is_in_one_group():
    store = Store(MIXED)
    counted = [id(each) for *_, results in tables.grouped(store) for each in results]
    assert sorted(counted) == sorted(id(each) for _, each in store.all())
    n = drawn(tables.draw_results(store)).n
    assert n.startswith(f"{len(counted)} trials")


def test_trials_over_the_damper_line_are_counted_and_a_line_that_nobody_was_near_is_no_zero():
    over = 2.0 * LINE
    trials = [result(scene="exp2", variant="random", seed=seed, excess=excess)
              for seed, excess in enumerate([over, -0.1, None, 0.5 * LINE])]  # fmt: skip
    part = drawn(tables.draw_measures(Store({"exp1": ten(), "exp2": trials})))
    over_line = f"Trials over the damper line by {LINE} m/s"
    assert {cells["Experiment"]: cells[over_line] for cells in part.cells} == {
        "1, published arrangements": "-",
        "2, four Temis": "1/4",
    }
    assert by_group(part)["2, four Temis", "motm"]["over_line"] == 1


def test_the_caption_of_the_measures_says_what_each_of_them_is():
    caption = drawn(tables.draw_measures(Store(MIXED))).caption
    near = f"Near miss: an agent is less than {NEAR:.2f} m"
    words = ("Cut-in: by its own motion", "1 m and 1.5 s", near, "Evasive manoeuvre: had both gone on", "Retries: ")
    for said in (*words, "Phases of a trial: ", "docs/results.md"):
        assert said in caption
    assert "measures." not in caption


def test_the_numbers_to_cite_have_no_mean_over_different_settings():
    sweep = [result(variant=variant, time_s=value, parameters={"next_weight": weight})
             for weight, value in ((0.0, 90.0), (2.0, 96.0)) for variant in TEN[:2]]  # fmt: skip
    errors = [result(scene="turn", variant="quiet", time_s=value, changes={"faults.grasp_delay": level})
              for level, value in ((0.0, 10.0), (5.0, 16.0))]  # fmt: skip
    store = Store({**MIXED, "sweep_next_weight": sweep, "grasp_delay": errors})
    found = {name: report._experiment(results)["methods"] for name, results in store.trials.items()}
    assert found["exp1"]["irm"]["mean_s"] == 120.0
    for experiment in ("exp1", "exp2", "sweep_next_weight", "grasp_delay"):
        assert "mean_s" not in found[experiment]["motm"], experiment
    means = {name: {group: each["mean_s"] for group, each in methods["motm"]["groups"].items()}
             for name, methods in found.items()}  # fmt: skip
    assert means == {
        "exp1": {"1, published arrangements": 80.0, "1, random": 100.0, "1, trial 1, other seeds": 70.0},
        "exp2": {"2, four Temis": 110.0, "2, one Temi": 82.0},
        "sweep_next_weight": {"1, published arrangements, next_weight=0": 90.0,
                              "1, published arrangements, next_weight=2": 96.0},
        "grasp_delay": {"turn, quiet, faults.grasp_delay=0": 10.0, "turn, quiet, faults.grasp_delay=5": 16.0},
    }  # fmt: skip
    assert found["exp1"]["motm"]["trials"] == 18


def test_success_is_counted_over_trials_not_over_their_objects():
    trials = ten()
    trials[3] |= {"places_done": 5, "success": False}
    trials[4] = result(variant=TEN[4], hits=2)
    part = drawn(tables.draw_results(Store({"exp1": trials})))
    index = next(k for k, row in enumerate(part.rows) if row["experiment"] == "1, published arrangements")
    cells = part.cells[index]
    share = proportion(8, 10)
    assert cells["Trials with success [95 % CI]"] == f"8/10 [{100 * share.low:.0f}, {100 * share.high:.0f}] %"
    assert cells["Objects placed"] == "59/60"
    assert cells["Trials completed"] == "9 of 10"
    assert (part.rows[index]["success_low"], part.rows[index]["success_high"]) == (share.low, share.high)


def test_completed_is_the_same_in_bench_and_in_the_report_and_both_captions_say_what_it_is():
    touched = result(time_s=77.0, hits=3)
    (row,) = summary.rows([touched])
    assert row.time.value == data.mean_time([touched]).value == 77.0
    assert (row.success.value, row.contacts) == (0.0, 0)
    assert data.completed is summary.completed
    store = Store({"exp1": [touched, result("irm")]})
    draws = (tables.draw_results, time_figures.draw_reductions, time_figures.draw_box_plots)
    captions = [summary.CAPTION, *(drawn(draw(store)).caption for draw in draws)]
    for caption in captions:
        assert summary.COMPLETED in caption
        assert summary.TOUCHED in caption


def test_what_was_given_up_has_no_time_whatever_it_says_of_success():
    (row,) = summary.rows([result(places_done=5, time_s=9.0)])
    assert row.time.n == 0


def marks(part):
    """Face of every mark that is drawn at a rival, by its place on the axis."""
    axes = part.figure.axes[0]
    lines = [line for line in axes.lines if len(line.get_xdata()) == 1 and line.get_marker() in "ov*s<^X"]
    return {round(float(line.get_xdata()[0]), 3): line.get_markerfacecolor() for line in lines}


def test_a_reduction_against_a_rival_with_contacts_is_open_and_said_to_compare_with_nothing():
    rivals = [*ten("motm2022", time_s=200.0, hits=8), *ten("irm", time_s=100.0)]
    part = drawn(time_figures.draw_reductions(Store({"exp1": [*ten(), *rivals]})))
    rows = {row["rival"]: row for row in part.rows}
    assert (rows["motm2022"]["contacts"], rows["motm2022"]["comparable"]) == (80, False)
    assert (rows["irm"]["contacts"], rows["irm"]["comparable"]) == (0, True)
    cells = {each["Rival"]: each for each in part.cells}
    assert cells[data.title("motm2022")]["Reduction, mean [95 % CI]"].endswith("with contacts")
    assert cells[data.title("motm2022")]["Contacts caused by the rival, by ours"] == "80, 0"
    assert not cells[data.title("irm")]["Reduction, mean [95 % CI]"].endswith("with contacts")
    faces = marks(part)
    assert faces[60.0] == "white"
    assert faces[20.0] != "white"
    assert summary.TOUCHED in part.notes[0]
    assert data.title("motm2022") in part.notes[0]
    assert data.title("irm") not in part.notes[0]


def test_contacts_of_our_own_and_only_those_in_the_trials_compared_make_a_mark_open():
    part = drawn(
        time_figures.draw_reductions(Store({"exp1": [*ten()[:9], result(variant="trial10", hits=1), *ten("irm")]}))
    )
    assert (part.rows[0]["own_contacts"], part.rows[0]["comparable"]) == (1, False)
    lost = result("irm", "trial10", hits=4, places_done=0)
    part = drawn(time_figures.draw_reductions(Store({"exp1": [*ten(), *ten("irm")[:9], lost]})))
    assert (part.rows[0]["pairs"], part.rows[0]["contacts"], part.rows[0]["comparable"]) == (9, 0, True)
    assert summary.TOUCHED not in part.notes[0]


def test_reductions_are_within_a_group():
    rival = [result("fast", variant="random", seed=seed, time_s=125.0) for seed in range(5)]
    part = drawn(
        time_figures.draw_reductions(Store({**MIXED, "exp1": [*MIXED["exp1"], *ten("fast", time_s=160.0), *rival]}))
    )
    shares = {(row["experiment"], row["rival"]): row["reduction"] for row in part.rows}
    assert shares["1, published arrangements", "fast"] == pytest.approx(0.5)
    assert shares["1, random", "fast"] == pytest.approx(0.2)


def test_a_trial_with_contacts_is_an_open_point_among_the_boxes():
    rival = [result("irm", variant, time_s=90.0, hits=int(variant == "trial2")) for variant in TEN]
    part = drawn(time_figures.draw_box_plots(Store({"exp1": [*ten(), *rival]})))
    assert [row["variant"] for row in part.rows if row["with_contacts"]] == ["trial2"]
    clouds = [points.get_facecolors() for points in part.figure.axes[0].collections]
    assert sum(len(faces) for faces in clouds) == 20
    assert sum(faces[:, 3].sum() for faces in clouds) == 19


def watched_trial(distances=(1.0,) * 100, **measures):
    moments = [moment(k, (1.0, 0.02 * k, 0.0), distance=each) for k, each in enumerate(distances)]
    return episode(moments, **measures)


def test_the_distance_figure_says_what_is_cut_off_and_what_is_not_seen():
    caption = drawn(watched.draw_distance(watched_trial([1.0] * 50 + [3.0] * 30 + [None] * 20))).caption
    assert "Distances above 2 m are cut off (30 % of the time)" in caption
    assert "where no obstacle is seen there is no line (20 %)" in caption
    caption = drawn(watched.draw_distance(watched_trial([1.0] * 50 + [3.0] * 50))).caption
    assert "no obstacle is seen" not in caption


def test_the_region_below_d_s_is_red_and_differs_from_the_orange_one_in_grey_too():
    part = drawn(watched.draw_distance(watched_trial()))
    below, influence = part.figure.axes[0].patches[:2]
    shown = [_on_white(patch) for patch in (below, influence)]
    red, green, blue = shown[0]
    assert red > 0.7
    assert max(green, blue) < 0.4
    assert _grey(shown[1]) - _grey(shown[0]) > 0.3
    assert below.get_hatch()
    assert influence.get_facecolor()[:3] == to_rgb(ORANGE)


def _on_white(patch):
    *colour, alpha = patch.get_facecolor()
    return [alpha * each + 1.0 - alpha for each in colour]


def _grey(colour):
    return sum(weight * each for weight, each in zip((0.299, 0.587, 0.114), colour, strict=True))


CUTS = [
    {"time": 3.0, "agent": "temi_1", "gap_m": 0.59, "gap_s": 1.4, "least_gap_m": 0.50},
    {"time": 4.0, "agent": "temi_1", "gap_m": 0.60, "gap_s": 1.5, "least_gap_m": 0.20},
]


def test_the_cut_in_that_came_nearest_is_drawn_a_second_before_it_began():
    part = drawn(watched.draw_cutting_in(watched_trial(cut_ins=CUTS), watched_trial(cut_ins=CUTS[:1])))
    assert part.facts["shown"] == {"time_s": pytest.approx(3.0), "agent": "temi_1"}
    assert "at 4.00 s would touch the robot in 0.60 m and 1.5 s" in part.caption
    assert [row["least_gap_m"] for row in part.rows] == [0.50, 0.20, 0.50]


def test_beside_it_stands_the_meeting_with_the_same_agent_of_the_method_that_predicts():
    away = watched_trial(cut_ins=CUTS[:1])
    part = drawn(watched.draw_cutting_in(watched_trial(cut_ins=CUTS), away))
    nearest = min(away.moments, key=lambda each: math.dist(each.pose[:2], each.agents[0][1:3]))
    assert part.facts["after"]["time_s"] == pytest.approx(max(0.0, nearest.time - 1.0), abs=0.5)
    assert part.n == "two trials, 2 and 1 cut-ins"
    assert len(part.figure.axes) == 2


def test_where_nobody_was_cut_in_on_the_report_says_so():
    part = watched.draw_cutting_in(watched_trial(), watched_trial())
    assert isinstance(part, Missing)
    assert "in none of the completed trials" in part.reason
    assert part.larger


def test_what_is_static_is_said_as_the_loop_has_it():
    text = report.body()
    assert f"has rested for {MoverParameters().waits:g} s" in text
    assert "been in the same place for 3 s" in text
    assert "stood for 3 s" not in text


def test_the_caption_of_the_global_path_spells_the_search_as_its_authors_do():
    caption = planning_figures.draw_global_path().caption
    assert "Without (STAA*): " in caption
    assert "With rotation cost: " in caption


def _letters(box):
    """Without the fifth below the base line: no name has a letter that reaches there."""
    return Bbox.from_extents(box.x0, box.y0 + 0.2 * box.height, box.x1, box.y1)


def test_names_of_places_lie_on_no_edge_and_on_no_other_name():
    part = drawn(planning_figures.draw_layout())
    axes, places = part.figure.axes[0], planning_figures.slots()
    with styled():
        canvas = FigureCanvasAgg(part.figure)
        canvas.draw()
        names = [text for text in axes.texts if text.get_text() in places]
        boxes = {text.get_text(): _letters(text.get_window_extent().transformed(axes.transData.inverted()))
                 for text in names}  # fmt: skip
    assert set(boxes) == set(places)
    for name in places:
        box = boxes[name]
        if not name.startswith("B"):
            assert 3.0 < box.x0 < box.x1 < 5.4
            assert 1.37 < box.y0 < box.y1 < 2.17
        assert not [other for other in boxes if other != name and box.overlaps(boxes[other])]
        covered = [slot for slot, (x, y) in places.items() if box.contains(x, y)]
        assert not covered, name
    row = [boxes[f"B{k}"] for k in range(1, 6)]
    assert all(b.x0 > a.x1 for a, b in pairwise(row))
