"""Measures of a run among people, on made-up motions."""

import math

import pytest

from .made_ticks import RADIUS, measured

HALF = 0.35  # [m] of the base, from its centre to its front


def among(seconds, pose, agents, **more):
    return measured(seconds, pose, agents=agents, **more)["among_people"]


def test_distance_and_time_to_collision_are_those_of_two_who_meet_head_on():
    found = among(2.0, lambda t: (0.4 * t, 0.0, 0.0), {"a": lambda t: (4.0 - 0.6 * t, 0.0)})
    gap = 4.0 - 2.0 * 1.0 - HALF - RADIUS
    assert found["least_gap_m"] == pytest.approx(gap, abs=0.06)
    assert found["least_time_to_collision_s"] == pytest.approx(gap / 1.0, abs=0.11)
    assert found["discomfort_s"] == 0.0


def test_discomfort_is_the_time_within_20_cm():
    found = among(4.0, lambda t: (0.0, 0.0, 0.0), {"a": lambda t: (0.5 * t - 1.0, 0.25 + RADIUS + 0.1)})
    sideways = math.sqrt((RADIUS + 0.2) ** 2 - (RADIUS + 0.1) ** 2)
    assert found["discomfort_s"] == pytest.approx(2.0 * (HALF + sideways) / 0.5, abs=0.15)
    assert found["least_gap_m"] == pytest.approx(0.1, abs=0.01)


@pytest.mark.parametrize(
    ("robot", "agent", "who"), [(1, 0, "robot"), (0, 1, "agent"), (1, 1, "both"), (0, 0, "nobody")]
)
def test_who_turns_aside_made_way(robot, agent, who):
    def base(t):  # turns left on a circle, or goes straight on
        return (math.sin(0.5 * t), 1.0 - math.cos(0.5 * t), 0.5 * t) if robot and t > 0.3 else (0.5 * t, 0.0, 0.0)

    def other(t):
        return 2.6 - 0.5 * t, -0.5 * agent * max(0.0, t - 0.3)

    found = among(2.5, base, {"a": other})
    first = found["conflicts"][0]
    assert first["made_way"] == who
    assert first["predicted_gap_m"] < 0.3
    assert (first["gained_by_robot_m"] > 0.05) == bool(robot)
    assert (first["gained_by_agent_m"] > 0.05) == bool(agent)


def test_two_who_pass_far_apart_have_no_conflict_and_no_time_to_collision():
    found = among(3.0, lambda t: (0.4 * t, 0.0, 0.0), {"a": lambda t: (3.0 - 0.4 * t, 2.0)})
    assert found["conflicts"] == []
    assert found["least_time_to_collision_s"] is None


def test_a_base_that_stands_freezes_but_not_while_it_waits_for_its_arm():
    still = (0.0, 0.0, 0.0)
    assert among(2.0, lambda t: still, {})["freezing_s"] == pytest.approx(2.0)
    assert among(2.0, lambda t: still, {}, in_reach=lambda t: True)["freezing_s"] == 0.0
    assert among(2.0, lambda t: (0.4 * t, 0.0, 0.0), {})["freezing_s"] == 0.0
