"""Figures of the report: what is compared, what a contact does to a time, the numbers of the paper, how it is drawn."""

import math
from itertools import pairwise

import numpy as np
import pytest
from fake_twin import fake_server
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_rgb
from matplotlib.transforms import Bbox
from waiting import until

from motm_twin.bus.client import TwinClient
from motm_twin.bus.commands import STEPS
from motm_twin.measures.agents import NEAR
from motm_twin.methods.registry import METHODS
from motm_twin.model.bounds import Between
from motm_twin.studies import catalogue, statistics
from motm_twin.studies.paper import data, planning_figures, sweep_figures, tables, time_figures
from motm_twin.studies.paper import episode as episodes
from motm_twin.studies.paper.data import Store
from motm_twin.studies.paper.drawing import ORANGE, styled
from motm_twin.studies.paper.episode import draw_cutting_in, draw_distance
from motm_twin.studies.paper.planning_figures import first_period

from .made_results import drawn, episode, result, seeds, trials

OURS = trials("motm", [80.0, 82.0, 84.0, 86.0, 88.0, 90.0])
THEIRS = trials("sequential", [160.0, 164.0, 168.0, 172.0, 176.0, 180.0])
SLOWER = trials("no_bezier", [90.0, 91.0, 95.0, 96.0, 97.0, 101.0])


def reductions(*results):
    return drawn(time_figures.draw_reductions(Store({"exp1": [each for these in results for each in these]})))


def test_the_caption_of_the_measures_says_what_each_of_them_is():
    caption = drawn(tables.draw_measures(Store({"exp1": OURS}))).caption
    near = f"Near miss: an agent is less than {NEAR:.2f} m"
    words = ("Cut-in: by its own motion", "1 m and 1.5 s", near, "Evasive manoeuvre: had both gone on", "Retries: ")
    for said in (*words, "Phases of a trial: ", "docs/results.md"):
        assert said in caption
    assert "measures." not in caption


def test_box_plots_show_published_numbers_only_where_there_are_any():
    boxes = [each | {"scene": "exp1a"} for each in (*OURS, *THEIRS)]
    part = drawn(time_figures.draw_box_plots(Store({"exp1": [*OURS, *THEIRS], "exp1a": boxes})))
    diamonds = [
        [tuple(line.get_xdata()) for line in axes.lines if line.get_marker() == "D" and len(line.get_xdata())]
        for axes in part.figure.axes
    ]
    assert diamonds == [[(95.9,), (172.3,)], []]
    assert len(part.rows) == 24


def test_a_trial_with_contacts_is_an_open_point_among_the_boxes():
    rival = trials("irm", [90.0] * 10)
    rival[1] = result("irm", "trial2", 90.0, hits=1)
    part = drawn(time_figures.draw_box_plots(Store({"exp1": [*trials(), *rival]})))
    assert [row["variant"] for row in part.rows if row["with_contacts"]] == ["trial2"]
    clouds = [points.get_facecolors() for points in part.figure.axes[0].collections]
    assert sum(len(faces) for faces in clouds) == 20
    assert sum(faces[:, 3].sum() for faces in clouds) == 19


def test_reductions_are_paired_and_the_published_one_stands_beside_them():
    part = reductions(OURS, THEIRS)
    (row,) = part.rows
    assert row["reduction"] == pytest.approx(0.5, abs=1e-9)
    assert row["saved_s"] == pytest.approx(85.0)
    assert row["published_reduction"] == pytest.approx(0.43)
    assert row["pairs"] == 6
    assert any("172.3" in note for note in part.notes)


def test_reductions_are_within_a_group():
    random = [*seeds([100.0] * 5), *seeds([125.0] * 5, "fast")]
    rows = reductions(trials(), random, trials("fast", [160.0] * 10)).rows
    shares = {(row["experiment"], row["rival"]): row["reduction"] for row in rows}
    assert shares["1, published arrangements", "fast"] == pytest.approx(0.5)
    assert shares["1, random", "fast"] == pytest.approx(0.2)


def test_a_reduction_against_a_rival_with_contacts_is_open_and_said_to_compare_with_nothing():
    part = reductions(trials(), trials("motm2022", [200.0] * 10, hits=8), trials("irm", [100.0] * 10))
    rows = {row["rival"]: row for row in part.rows}
    assert (rows["motm2022"]["contacts"], rows["motm2022"]["comparable"]) == (80, False)
    assert (rows["irm"]["contacts"], rows["irm"]["comparable"]) == (0, True)
    touching, clean = (data.title(name) for name in ("motm2022", "irm"))
    cells = {each["Rival"]: each for each in part.cells}
    assert cells[touching]["Reduction, mean [95 % CI]"].endswith("with contacts")
    assert cells[touching]["Contacts caused by the rival, by ours"] == "80, 0"
    assert not cells[clean]["Reduction, mean [95 % CI]"].endswith("with contacts")
    marks = [line for line in part.figure.axes[0].lines
             if len(line.get_xdata()) == 1 and line.get_marker() in "ov*s<^X"]  # fmt: skip
    faces = {round(float(line.get_xdata()[0]), 3): line.get_markerfacecolor() for line in marks}
    assert faces[60.0] == "white" != faces[20.0]
    assert statistics.TOUCHED in part.notes[0]
    assert touching in part.notes[0]
    assert clean not in part.notes[0]


def test_contacts_of_our_own_and_only_those_in_the_trials_compared_make_a_mark_open():
    (row,) = reductions(trials()[:9], [result(variant="trial10", hits=1)], trials("irm")).rows
    assert (row["own_contacts"], row["comparable"]) == (1, False)
    part = reductions(trials(), trials("irm")[:9], [result("irm", "trial10", hits=4, places_done=0)])
    assert [part.rows[0][key] for key in ("pairs", "contacts", "comparable")] == [9, 0, True]
    assert statistics.TOUCHED not in part.notes[0]


def test_a_modification_without_a_shown_effect_is_said_to_have_none():
    same = trials("no_arm_avoidance", [81.0, 81.0, 85.0, 85.0, 89.0, 89.0])
    part = drawn(sweep_figures.draw_ablations(Store({"exp1": OURS, "ablations": [*SLOWER, *same]})))
    verdicts = {row["method"]: row["verdict"] for row in part.rows}
    assert verdicts == {"no_bezier": "saves time", "no_arm_avoidance": "no effect on time shown"}
    assert any(METHODS["no_arm_avoidance"].title in note for note in part.notes)


def test_modifications_are_compared_within_published_and_within_random_arrangements():
    ours, quicker = seeds([80.0, 81.0, 82.0]), seeds([70.0, 71.0, 72.0], "no_bezier")
    part = drawn(sweep_figures.draw_ablations(Store({"exp1": [*OURS, *ours], "ablations": [*SLOWER, *quicker]})))
    said = [(row["experiment"], row["pairs"], row["verdict"]) for row in part.rows]
    assert said == [("1, published arrangements", 6, "saves time"), ("1, random", 3, "costs time here")]
    assert part.rows[1]["slower_s"] == pytest.approx(-10.0)


def test_the_time_split_adds_up_to_the_mean_time():
    assert sum(time_figures.split(Store({"exp1": OURS}), "exp1", "motm").values()) == pytest.approx(85.0)


def pick(method, time_s, picked=1, seed=0, **changes):
    small = {"scene": "turn", "seed": seed, "picks_done": picked, "picks_total": 1, "places_done": 0,
             "places_total": 0}  # fmt: skip
    return result(method, "quiet", time_s, success=bool(picked), changes=changes, **small)


def test_a_world_without_errors_stands_at_zero_in_every_sweep():
    picks = [pick("motm", 10.0, a=0.0), pick("motm", 11.0, a=1.0), pick("motm", 12.0, b=2.0)]
    rows = sweep_figures.error_points(picks, success=False)
    assert [(row["sweep"], row["value"], row["estimate"]) for row in rows] == [
        ("turn: a", 0.0, 10.0), ("turn: a", 1.0, 11.0), ("turn: b", 0.0, 10.0), ("turn: b", 2.0, 12.0),
    ]  # fmt: skip


def test_a_missed_grasp_has_no_time_and_counts_against_success():
    picks = [pick("open_loop", 9.0, picked, **{"faults.grasp_delay": delay}) for picked, delay in ((1, 0.0), (0, 5.0))]
    part = drawn(sweep_figures.draw_grasp_delay(Store({"grasp_delay": picks})))
    assert [row["value"] for row in part.rows] == [0.0]
    assert [row["estimate"] for row in sweep_figures.error_points(picks, success=True)] == [1.0, 0.0]


def test_success_with_errors_is_compared_by_seed_and_every_error_has_a_label_for_people():
    picks = [pick(method, 10.0, picked=int(method == "motm" or value < 2.0 + seed), seed=seed, a=value)
             for method in ("motm", "open_loop") for seed in range(2) for value in (0.0, 1.0, 2.0)]  # fmt: skip
    ours, theirs = drawn(sweep_figures.draw_robustness(Store({"robustness": picks}))).notes
    assert "4 of 4 trials with an error" in ours
    assert "3 of 4 trials with an error" in theirs
    assert "by seed 25 percentage points [" in theirs
    assert {*catalogue.ERRORS, *catalogue.GRASP_FAULTS} <= set(sweep_figures.LABELS)


def test_the_distance_figure_says_what_is_cut_off_and_what_is_not_seen():
    caption = drawn(draw_distance(episode([1.0] * 50 + [3.0] * 30 + [None] * 20))).caption
    assert "Distances above 2 m are cut off (30 % of the time)" in caption
    assert "where no obstacle is seen there is no line (20 %)" in caption
    assert "no obstacle is seen" not in drawn(draw_distance(episode([1.0] * 50 + [3.0] * 50))).caption


def test_the_region_below_d_s_is_red_and_differs_from_the_orange_one_in_grey_too():
    below, influence = drawn(draw_distance(episode())).figure.axes[0].patches[:2]
    shown = [np.array(patch.get_facecolor()) for patch in (below, influence)]
    red, orange = (each[3] * each[:3] + 1.0 - each[3] for each in shown)  # on white
    assert red[0] > 0.7
    assert max(red[1:]) < 0.4
    assert np.dot((0.299, 0.587, 0.114), orange - red) > 0.3
    assert below.get_hatch()
    assert influence.get_facecolor()[:3] == to_rgb(ORANGE)


def test_the_cut_in_that_came_nearest_is_drawn_a_second_before_beside_the_meeting_with_prediction():
    cuts = [
        {"time": 3.0, "agent": "temi_1", "gap_m": 0.59, "gap_s": 1.4, "least_gap_m": 0.50},
        {"time": 4.0, "agent": "temi_1", "gap_m": 0.60, "gap_s": 1.5, "least_gap_m": 0.20},
    ]
    predicted = episode(cut_ins=cuts[:1])
    part = drawn(draw_cutting_in(episode(cut_ins=cuts), predicted))
    assert part.facts["shown"] == {"time_s": pytest.approx(3.0), "agent": "temi_1"}
    assert "at 4.00 s would touch the robot in 0.60 m and 1.5 s" in part.caption
    assert [row["least_gap_m"] for row in part.rows] == [0.50, 0.20, 0.50]
    nearest = min(predicted.moments, key=lambda each: math.dist(each.pose[:2], each.agents[0][1:3]))
    assert part.facts["after"]["time_s"] == pytest.approx(max(0.0, nearest.time - 1.0), abs=0.5)
    assert part.n == "two trials, 2 and 1 cut-ins"
    assert len(part.figure.axes) == 2


def test_the_bezier_figure_has_the_numbers_of_the_paper():
    found = planning_figures.numbers()
    assert round(found["bezier_length_m"], 2) == 4.35
    assert round(found["bezier_time_s"], 1) == 8.7
    assert round(found["path_rtr_s"], 1) == 9.2
    assert planning_figures.draw_bezier().figure is not None


def test_with_rotation_cost_the_global_path_takes_the_other_side_and_turns_less():
    part = planning_figures.draw_global_path()
    ours, staa = part.rows
    assert staa["length_m"] < ours["length_m"]
    assert ours["turning_deg"] < staa["turning_deg"] - 180.0
    assert ours["path_rtr_s"] < staa["path_rtr_s"]
    assert "Without (STAA*): " in part.caption  # the search is spelled as its authors do
    assert "With rotation cost: " in part.caption


def test_another_drop_location_changes_the_chosen_base_pose():
    here = first_period("exp1", "trial1")
    (one, _), (two, _) = (planning_figures.placed(here, drop) for drop in ("drop1", "drop2"))
    assert np.hypot(*(one.goal[:2] - two.goal[:2])) > 0.5
    assert len(one.poses) == 72
    for placement in (one, two):
        assert placement.cost[placement.chosen] == pytest.approx(np.nanmin(placement.cost))


def test_the_layout_has_the_twelve_slots_with_names_on_no_edge_and_on_no_other_name_and_both_boxes():
    part = drawn(planning_figures.draw_layout())
    assert sum(row["what"] == "slot" for row in part.rows) == 12
    assert {(row["x_m"], row["y_m"]) for row in part.rows if row["what"] == "box of 1a"} == {(2.7, 1.7), (3.9, 0.96)}
    axes, places = part.figure.axes[0], planning_figures.slots()
    with styled():
        FigureCanvasAgg(part.figure).draw()
        shown = {text.get_text(): text.get_window_extent().transformed(axes.transData.inverted())
                 for text in axes.texts if text.get_text() in places}  # fmt: skip
    # without the fifth below the base line: no name has a letter that reaches there
    boxes = {name: Bbox.from_extents(box.x0, box.y0 + 0.2 * box.height, box.x1, box.y1) for name, box in shown.items()}
    assert set(boxes) == set(places)
    for name, box in boxes.items():
        if not name.startswith("B"):
            assert 3.0 < box.x0 < box.x1 < 5.4
            assert 1.37 < box.y0 < box.y1 < 2.17
        assert not [other for other in boxes if other != name and box.overlaps(boxes[other])]
        assert not [slot for slot, (x, y) in places.items() if box.contains(x, y)], name
    row = [boxes[f"B{k}"] for k in range(1, 6)]
    assert all(b.x0 > a.x1 for a, b in pairwise(row))


def test_a_twin_is_stepped_beyond_what_one_command_allows(monkeypatch) -> None:
    assert episodes.STEPS is STEPS
    monkeypatch.setattr(episodes, "STEPS", Between(1, 15))  # fewer, to be quick
    with fake_server() as server, TwinClient(server.endpoint) as client:
        until(lambda: client.tick() and client.status(), "nothing was received")
        episodes._rewind(client)
        episodes._step_to(client, 40)
        assert (client.tick().index, client.status().state) == (40, "paused")
