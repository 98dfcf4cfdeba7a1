"""PathRTR and the Bezier curve: the paper's figure, and their properties."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from motm_twin.planning.bezier import bezier_curve, curve_length, curve_time
from motm_twin.planning.rtr import path_rtr, path_rtr_both, turn
from motm_twin.planning.staa import proximity_scale

DEG = math.pi / 180.0
LIMITS = {"v_f": 0.5, "v_r": 0.25, "w_max": 100.0 * DEG}
angles = st.floats(-10.0, 10.0)


def test_the_bezier_figure_of_the_paper_takes_9_2_s_by_path_rtr() -> None:
    path = np.array([[0.0, 0.0], [4.0, 0.0]])
    assert path_rtr(path, -30.0 * DEG, 90.0 * DEG, **LIMITS) == pytest.approx(9.2, abs=0.005)


def test_the_bezier_figure_of_the_paper_is_4_35_m_long_and_takes_8_7_s() -> None:
    start, goal = np.array([0.0, 0.0, -30.0 * DEG]), np.array([4.0, 0.0, 90.0 * DEG])
    curve = bezier_curve(start, goal, offset=0.25, samples=200)
    assert curve_length(curve) == pytest.approx(4.35, abs=0.005)
    assert curve_time(curve, start[2], goal[2], 0.5, 100.0 * DEG) == pytest.approx(8.7, abs=0.02)


def test_path_rtr_forwards_and_in_reverse_of_a_bent_path_by_hand() -> None:
    path = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 2.0]])
    front, back = path_rtr_both(path, 45.0 * DEG, 60.0 * DEG, 0.5, 0.25, 100.0 * DEG)
    assert front == pytest.approx((45 + 90 + 30) / 100 + 3.0 / 0.5)
    assert back == pytest.approx((135 + 90 + 150) / 100 + 3.0 / 0.25)


def test_close_behind_the_robot_reversing_is_cheaper_than_turning_round() -> None:
    path = np.array([[0.0, 0.0], [-0.2, 0.0]])
    assert path_rtr(path, 0.0, 0.0, **LIMITS) == pytest.approx(0.2 / 0.25)


def test_a_path_without_length_costs_the_turn_to_the_goal_heading() -> None:
    assert path_rtr(np.zeros((2, 2)), 0.0, math.pi / 2, **LIMITS) == pytest.approx(0.9)
    assert path_rtr(np.zeros((1, 2)), 0.0, None, **LIMITS) == 0.0


@given(angles, angles)
def test_turn_is_the_smallest_angle_between_directions(a: float, b: float) -> None:
    assert turn(a, b) == pytest.approx(abs(math.remainder(a - b, 2.0 * math.pi)), abs=1e-9)
    assert turn(a, b) == pytest.approx(turn(b, a), abs=1e-9)


@given(angles, angles, st.floats(-3.0, 3.0), st.floats(0.1, 3.0))
def test_a_path_costs_the_same_in_the_other_direction_with_turned_headings(
    a: float, b: float, x: float, y: float
) -> None:
    path = np.array([[0.0, 0.0], [0.5, y], [x + 4.0, y]])
    there = path_rtr(path, a, b, **LIMITS)
    back = path_rtr(path[::-1].copy(), b + math.pi, a + math.pi, **LIMITS)
    assert there == pytest.approx(back, abs=1e-9)


@given(st.floats(-3.0, 3.0), st.floats(-3.0, 3.0), angles, angles)
def test_the_bezier_time_is_never_below_the_straight_drive_nor_its_own_turning(
    x: float, y: float, a: float, b: float
) -> None:
    curve = bezier_curve(np.array([0.0, 0.0, a]), np.array([x, y, b]), samples=32)
    time = curve_time(curve, a, b, 0.5, 100.0 * DEG)
    assert time >= math.hypot(x, y) / 0.5 - 1e-9
    assert time >= turn(a, b) / (100.0 * DEG) - 1e-9


@pytest.mark.parametrize(("t_h", "k"), [(0.0, 0.1), (0.2, 0.1), (0.3, 0.1), (1.5, 0.5), (3.0, 1.0), (12.0, 1.0)])
def test_k_is_the_papers_scale_of_the_proximity_penalty(t_h: float, k: float) -> None:
    assert proximity_scale(t_h, 0.1, 3.0) == pytest.approx(k)
