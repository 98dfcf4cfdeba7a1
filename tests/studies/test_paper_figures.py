"""Figures of the report: the numbers of the paper in those of the method, and photographs of the page."""

import numpy as np
import pytest
from fake_twin import fake_server
from waiting import until

from motm_twin.bus.client import TwinClient
from motm_twin.bus.commands import STEPS
from motm_twin.model.bounds import Between
from motm_twin.studies.paper import planning_figures, snapshots
from motm_twin.studies.paper.ground import first_period


def test_the_bezier_figure_has_the_numbers_of_the_paper():
    found = planning_figures.numbers()
    assert round(found["bezier_length_m"], 2) == 4.35
    assert round(found["bezier_time_s"], 1) == 8.7
    assert round(found["path_rtr_s"], 1) == 9.2
    assert planning_figures.draw_bezier().figure is not None


def test_with_rotation_cost_the_global_path_takes_the_other_side_and_turns_less():
    here = first_period("exp1", "trial1")
    ours, staa = (planning_figures.measured(path, here) for path in planning_figures.paths(here).values())
    assert staa["length_m"] < ours["length_m"]
    assert ours["turning_deg"] < staa["turning_deg"] - 180.0
    assert ours["path_rtr_s"] < staa["path_rtr_s"]


def test_another_drop_location_changes_the_chosen_base_pose():
    here = first_period("exp1", "trial1")
    (one, _), (two, _) = (planning_figures.placed(here, drop) for drop in ("drop1", "drop2"))
    assert np.hypot(*(one.goal[:2] - two.goal[:2])) > 0.5
    assert len(one.poses) == 72
    for placement in (one, two):
        assert placement.cost[placement.chosen] == pytest.approx(np.nanmin(placement.cost))


def test_the_layout_has_the_twelve_slots_and_both_boxes():
    rows = planning_figures.draw_layout().rows
    assert sum(row["what"] == "slot" for row in rows) == 12
    assert {(row["x_m"], row["y_m"]) for row in rows if row["what"] == "box of 1a"} == {(2.7, 1.7), (3.9, 0.96)}


def test_a_twin_is_stepped_beyond_what_one_command_allows(monkeypatch) -> None:
    assert snapshots.STEPS is STEPS
    monkeypatch.setattr(snapshots, "STEPS", Between(1, 15))  # fewer, to be quick
    late = 40
    with fake_server() as server, TwinClient(server.endpoint) as client:
        until(lambda: client.tick() and client.status(), "nothing was received")
        snapshots._rewind(client)
        snapshots._step_to(client, late)
        tick, status = client.tick(), client.status()
    assert tick is not None
    assert status is not None
    assert (tick.index, status.state) == (late, "paused")
