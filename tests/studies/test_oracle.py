"""The oracle: a base that knows where the agents will be."""

import numpy as np
import pytest

from motm_twin.measures.agents import base_gap
from motm_twin.model.scene_file import load_scene
from motm_twin.studies.oracle import require_known_future, search
from motm_twin.studies.people import ORACLE, cases, meet

BODY = (0.0, 0.7, 0.5)
LIMITS = np.array([1.0, 0.5, 1.75, 1.0, 1.75])


def test_without_anybody_it_drives_straight_on():
    way, found = search(
        np.zeros(5), np.array([4.0, 0.0, 0.2]), np.zeros((400, 0, 2)), np.zeros(0), BODY, LIMITS, np.zeros(0)
    )
    assert found
    assert 4.0 <= 0.5 * len(way) <= 5.0
    assert np.abs(way[:, 1]).sum() <= 2.0 * 1.75


def test_it_waits_or_goes_round_one_who_crosses_its_way_just_then():
    times = 0.05 * np.arange(600)
    tracks = np.column_stack([np.full(600, 2.0), -2.0 + 0.8 * times])[:, None]
    way, found = search(np.zeros(5), np.array([4.0, 0.0, 0.2]), tracks, np.array([0.3]), BODY, LIMITS, np.array([0.1]))
    assert found
    state, least = np.zeros(5), np.inf
    for k, push in enumerate(np.repeat(way, 10, axis=0)):
        state[3] = np.clip(state[3] + 0.05 * push[0], -0.5, 1.0)
        state[4] = np.clip(state[4] + 0.05 * push[1], -1.75, 1.75)
        state[2] += 0.05 * state[4]
        state[:2] += 0.05 * state[3] * np.array([np.cos(state[2]), np.sin(state[2])])
        least = min(least, base_gap(BODY, state[:3], *tracks[k + 1, 0], 0.3))
    assert least > 0.0


def test_it_crosses_a_circle_of_people_who_do_not_see_it():
    (case,) = cases(["circle_invisible"], [ORACLE], 1)
    result = meet(case)
    assert result["method"] == ORACLE
    assert result["success"], result["reason"]
    assert result["least_gap_m"] > 0.0


def test_it_refuses_agents_whose_future_depends_on_the_robot_and_rooms_with_furniture():
    with pytest.raises(ValueError, match="do not see the robot"):
        require_known_future(load_scene("circle:0", "visible"))
    with pytest.raises(ValueError, match="only drives"):
        require_known_future(load_scene("exp2", "blind"))
