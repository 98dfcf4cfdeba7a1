"""Encounters of a plan with dynamic obstacles: who gives way, on which side, and what it costs the other."""

import math

import numpy as np
import pytest

from motm_twin.model.profile import RobotProfile
from motm_twin.model.reason import Kind
from motm_twin.planning.collision import body_of
from motm_twin.planning.encounters import STEP, encounters
from motm_twin.planning.prediction import SPREAD, ellipses, probability_taken
from motm_twin.planning.types import Passes, Yields

BODY = body_of(RobotProfile().footprint)
CROSSING = (2.0, -1.5, 0.0, 0.5, 0.25, 0.03, 7.0)  # at x = 2 m, and on the line y = 0 after 3 s


def straight(speed, seconds=4.0, x=0.0):
    times = np.arange(round(seconds / STEP) + 1) * STEP
    return np.array([(x + speed * t, 0.0, 0.0, speed, 0.0) for t in times])


def one(states, track=CROSSING):
    (found,) = encounters(states, np.array([track]), BODY)
    return found


def test_a_base_that_is_over_before_the_other_passes_in_front():
    found = one(straight(1.5))
    assert found.passes == Passes.IN_FRONT and found.yields == Yields.NOBODY
    assert found.why.kind == Kind.PASSES_IN_FRONT and found.why.subject == "track 7"


def test_a_base_that_comes_later_passes_behind_and_costs_nothing():
    found = one(straight(0.3, 8.0))
    assert found.passes == Passes.BEHIND and found.yields == Yields.ROBOT
    assert found.courtesy == 0.0
    assert found.why.kind == Kind.PASSES_BEHIND


def test_standing_where_the_other_has_to_pass_costs_its_time():
    found = one(straight(0.0, 2.5, x=2.0))
    assert found.yields == Yields.OTHER and found.gap < 0.1
    assert found.courtesy > 0.4
    assert found.why.kind == Kind.IS_GIVEN_WAY


def test_cutting_in_costs_more_the_nearer_it_is():
    near = one(straight(0.95))
    far = one(straight(1.5))
    assert near.courtesy > far.courtesy > 0.0


def test_the_robot_yields_to_those_that_the_driven_motion_stays_clear_of():
    planned = encounters(straight(0.0, 2.5, x=2.0), np.array([CROSSING]), BODY)
    (found,) = encounters(straight(-0.4, 2.5, x=2.0), np.array([CROSSING]), BODY, planned)
    assert found.yields == Yields.ROBOT and found.why.kind == Kind.GIVES_WAY


def test_who_is_far_away_is_no_encounter():
    assert encounters(straight(0.5), np.array([(2.0, 3.0, 0.5, 0.0, 0.25, 0.03, 1.0)]), BODY) == ()


def test_an_ellipse_grows_more_along_the_way_than_across():
    first, last = ellipses(np.array(CROSSING), (1.0, 3.0))
    assert last[1:3] == pytest.approx((2.0, 0.0))
    assert last[3] > last[4] > 0.25
    assert last[3] > first[3] and last[5] == pytest.approx(0.5 * math.pi)


@pytest.mark.parametrize(("time", "taken"), [(0.0, 0.0), (3.0, 1.0), (8.0, 0.0)])
def test_a_place_is_taken_while_somebody_is_expected_there(time, taken):
    found = probability_taken(2.0, 0.0, 1.0, 0.0, time, np.array(CROSSING), SPREAD, BODY)
    assert found == pytest.approx(taken, abs=0.1)
