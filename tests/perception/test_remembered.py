"""What was seen where the arm is stays until beams have passed through its place."""

import math

import numpy as np
import pytest
import shapely

from motm_twin.model.plant import Scan
from motm_twin.perception.remembered import bodies, looked_at_again, remember

from .small_world import LIDAR, cast

HERE = np.zeros(3)
BOX = shapely.box(0.85, -0.15, 1.15, 0.15)
FRONT = np.column_stack((np.full(7, 0.875), np.linspace(-0.15, 0.15, 7)))


def scan(stamp, *solids, noise=None):
    return Scan(
        stamp=stamp, ranges=cast(HERE, list(solids), noise), angle_min=-LIDAR.field_of_view / 2,
        angle_step=LIDAR.field_of_view / (LIDAR.beams - 1), origin=np.zeros(2), range_min=LIDAR.range_min,
        range_max=LIDAR.range_max, pose=HERE,
    )  # fmt: skip


def after(solids, scans, noise=None):
    """What is left of the front after so many scans."""
    left = remember(None, FRONT, 0.0)
    for k in range(scans):
        left = looked_at_again(left, scan(0.05 * (k + 1), *solids, noise=noise), HERE)
    return left.points


def test_what_stands_there_is_never_forgotten():
    """A box before a desk was seen in a flickering row of cells, and was forgotten after a second."""
    assert len(after([BOX], 200, np.random.default_rng(0))) >= 5


def test_what_is_hidden_stays():
    assert len(after([shapely.box(0.3, -0.5, 0.4, 0.5)], 100)) == len(FRONT)


def test_what_beams_pass_through_is_gone_after_three_scans():
    assert len(after([], 2)) == len(FRONT)
    assert len(after([], 3)) == 0


def test_furniture_right_behind_does_not_look_like_it():
    assert len(after([shapely.box(0.94, -1.0, 1.5, 1.0)], 3)) == 0


def test_the_same_scan_counts_once():
    left = remember(None, FRONT, 0.0)
    for _ in range(10):
        left = looked_at_again(left, scan(0.05), HERE)
    assert len(left.points) == len(FRONT)


def test_a_point_that_is_known_is_not_remembered_twice():
    twice = remember(remember(None, FRONT, 0.0), FRONT + 0.01, 0.05)
    assert len(twice.points) == len(FRONT)


def test_a_body_is_as_deep_as_it_is_wide():
    found = bodies(FRONT, np.zeros(2))
    assert found.middle[0] == pytest.approx([1.0, 0.0], abs=0.04)
    assert found.radius[0] == pytest.approx(0.15, abs=0.04)


def test_points_far_apart_are_two_bodies():
    found = bodies(np.concatenate((FRONT, FRONT + np.array([0.0, 1.0]))), np.zeros(2))
    assert len(found.radius) == 2
    assert math.dist(*found.middle) > 0.8
