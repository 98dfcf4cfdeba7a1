import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sim_scenes import box, experiment, least_gap, scene, temis, track_of

from motm_twin.model.geometry import rectangle
from motm_twin.model.scene import Agent
from motm_twin.sim.agent_kernels import free_cells
from motm_twin.sim.kernels import clearance
from motm_twin.sim.plant import SimulatedPlant


def run(plant, seconds):
    return track_of(plant, seconds, step=0.1)


def ways(track):
    return np.hypot(*np.diff(track, axis=0).T).sum(axis=1)


def test_a_free_agent_drives_its_round_at_its_speed():
    ring = ((2.0, 0.0), (2.0, 2.0), (-2.0, 2.0), (-2.0, 0.0))
    plant = SimulatedPlant(
        scene(start=(0.0, -3.0, 0.0), agents=(Agent(name="a", start=(0.0, 0.0, 0.0), waypoints=ring),))
    )
    track = run(plant, 60.0)
    assert ways(track)[0] > 0.8 * 0.4 * 60.0
    assert np.hypot(*np.diff(track[:, 0], axis=0).T).max() <= 0.4 * 0.1 + 1e-9


def test_yielding_agents_never_touch_a_robot_that_stands_in_their_lane():
    plant = SimulatedPlant(experiment(start=(4.2, 0.6, 0.0), agents=temis()))
    track = run(plant, 120.0)
    assert plant.truth().contacts == ()
    assert least_gap(track, 0.25) > 0.0
    assert ways(track).min() > 3.0  # they go round it


@pytest.mark.parametrize("aside", [0.0, 0.1, -0.2])
def test_two_agents_head_on_pass_each_other(aside):
    a = Agent(name="a", start=(0.0, 0.0, 0.0), waypoints=((4.0, 0.0), (0.0, 0.0)))
    b = Agent(name="b", start=(4.0, aside, math.pi), waypoints=((0.0, aside), (4.0, aside)))
    plant = SimulatedPlant(scene(start=(-2.0, -3.0, 0.0), agents=(a, b)))
    track = run(plant, 60.0)
    assert least_gap(track, 0.25) > 0.0
    for i in range(2):
        assert track[:, i, 0].min() < 0.5
        assert track[:, i, 0].max() > 3.5
    assert ways(track).min() > 10.0


def test_an_agent_goes_round_a_box_in_its_lane_after_some_waiting():
    agent = Agent(name="a", start=(0.0, 0.0, 0.0), waypoints=((5.0, 0.0), (0.0, 0.0)))
    crate = box("crate", (2.5, 0.0), (0.6, 0.6), 0.5, mapped=False)
    plant = SimulatedPlant(scene(start=(-2.0, -3.0, 0.0), agents=(agent,), solids=(crate,)))
    track = run(plant, 40.0)[:, 0]
    assert track[:, 0].max() > 4.8
    outside = np.hypot(np.maximum(np.abs(track[:, 0] - 2.5) - 0.3, 0.0), np.maximum(np.abs(track[:, 1]) - 0.3, 0.0))
    assert outside.min() > 0.25


def test_an_agent_walled_in_waits_for_ever_without_touching():
    agent = Agent(name="a", start=(0.0, 0.0, 0.0), waypoints=((5.0, 0.0),))
    walls = tuple(
        box(f"wall{i}", centre, size, 1.0)
        for i, (centre, size) in enumerate(
            (((1, 0), (0.1, 2)), ((-1, 0), (0.1, 2)), ((0, 1), (2.1, 0.1)), ((0, -1), (2.1, 0.1)))
        )
    )
    plant = SimulatedPlant(scene(start=(-2.0, -3.0, 0.0), agents=(agent,), solids=walls))
    track = run(plant, 20.0)[:, 0]
    assert np.abs(track).max() < 0.95 - 0.25


def test_a_blind_agent_drives_on_whatever_stands_there():
    agent = Agent(name="a", start=(2.0, 0.0, math.pi), waypoints=((-3.0, 0.0),), behaviour="blind")
    plant = SimulatedPlant(scene(agents=(agent,)))
    assert run(plant, 15.0)[-1, 0, 0] < -2.5


def test_an_agent_without_waypoints_stands():
    plant = SimulatedPlant(scene(agents=(Agent(name="a", start=(2.0, 0.0, 0.0)),)))
    np.testing.assert_array_equal(run(plant, 2.0)[:, 0], [(2.0, 0.0)] * 20)
    assert plant.truth().agents[0].state == "standing"


def test_an_agent_stops_well_before_a_standing_robot():
    agent = Agent(name="a", start=(3.0, 0.0, math.pi), waypoints=((-3.0, 0.0),))
    plant = SimulatedPlant(scene(agents=(agent,), start=(0.0, 0.0, math.pi)))
    track = run(plant, 6.0)[:, 0]
    assert track[:, 0].min() - 0.25 - 0.35 > 0.25
    assert plant.truth().agents[0].state == "waiting"


@pytest.mark.parametrize("aside", [0.0, 0.01, 0.13])
def test_an_agent_that_heads_straight_for_a_wall_stops_at_its_margin_and_goes_round(aside):
    """At each look it came 2 cm nearer, at 3 cm/s, until it stood 2.5 cm from the wall."""
    agent = Agent(name="a", start=(0.0, aside, 0.0), waypoints=((5.0, aside),))
    wall = box("wall", (2.5, 0.0), (0.1, 4.0), 1.0, mapped=False)
    plant = SimulatedPlant(scene(start=(-2.0, -3.0, 0.0), agents=(agent,), solids=(wall,)))
    track = run(plant, 40.0)[:, 0]
    outside = np.hypot(np.maximum(np.abs(track[:, 0] - 2.5) - 0.05, 0.0), np.maximum(np.abs(track[:, 1]) - 2.0, 0.0))
    assert outside.min() > 0.25 + 0.09
    assert track[-1, 0] > 4.8


@pytest.mark.parametrize("turned", [0.3, 0.5 * math.pi])
def test_an_agent_that_heads_for_the_side_of_a_standing_robot_keeps_away_from_it(turned):
    """It came as near as 2.6 cm to the robot's flat side."""
    agent = Agent(name="a", start=(3.0, 0.0, math.pi), waypoints=((-3.0, 0.0),))
    plant = SimulatedPlant(scene(agents=(agent,), start=(0.0, 0.0, turned)))
    run(plant, 9.0)
    assert plant.truth().min_base_clearance > 0.28


CELL, HALF = 0.1, 12
place = st.floats(-1.5, 1.5)
boxes = st.lists(st.tuples(place, place, st.floats(-3.0, 3.0), st.floats(0.05, 2.0), st.floats(0.05, 2.0)), max_size=4)
discs = st.lists(st.tuples(place, place, st.floats(0.0, 0.6)), max_size=4)


@given(start=st.tuples(place, place), boxes=boxes, discs=discs, radius=st.floats(0.1, 0.5))
@settings(deadline=None, max_examples=60)
def test_cells_well_clear_of_everything_are_free_and_others_only_where_they_lead_away(start, boxes, discs, radius):
    corners = np.vstack([np.zeros((0, 2)), *(rectangle((x, y, turn), size) for x, y, turn, *size in boxes)])
    first, round_ones = 4 * np.arange(len(boxes) + 1), np.array(discs).reshape(-1, 3)
    found = free_cells(np.array(start), radius, CELL, HALF, corners, first, round_ones)
    here = clearance(*start, corners, first, round_ones)
    for i, j in np.ndindex(found.shape):
        x, y = start[0] + (i - HALF) * CELL, start[1] + (j - HALF) * CELL
        gap, away = clearance(x, y, corners, first, round_ones), np.hypot(x - start[0], y - start[1])
        assert found[i, j] == (gap >= radius or (away < 0.4 and gap >= here + 0.3 * away))
