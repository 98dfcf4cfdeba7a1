"""Obstacles of the arm: what the lidar sees, and where it will be."""

import numpy as np
import pytest

from motm_twin.control.arm.types import ArmObstacles
from motm_twin.perception.world_map import WorldMap

PERSON, POST = (1.0, 0.5), (1.6, 0.5)
NOTHING = np.zeros((1, 1))
WORLD = WorldMap(
    stamp=0.0, resolution=0.05, origin=np.zeros(2), occupied=NOTHING.astype(np.uint8), distance=NOTHING,
    proximity=NOTHING, polygons=(), seen_points=np.array([PERSON, POST]), seen_static=np.array([False, True]),
    tracks=np.array([(0.8, 0.5, 0.2, -0.6, 0.25, 0.03, 1.0, 0.6)]),
)  # fmt: skip


def test_without_prediction_the_arm_keeps_from_what_is_seen():
    points, static = ArmObstacles.of(WORLD, np.zeros(3)).kept_from()
    assert points.tolist() == [list(PERSON), list(POST)]
    assert static.tolist() == [False, True]


def test_with_prediction_it_also_keeps_from_where_a_moving_one_will_be():
    found = ArmObstacles.of(WORLD, np.zeros(3), 0.5)
    points, static = found.kept_from()
    assert points == pytest.approx(np.array([PERSON, POST, (1.1, 0.2)]))
    assert static.tolist() == [False, True, False]
    assert found.points.tolist() == [list(PERSON), list(POST)]  # nothing is there now: the arm is in nothing
