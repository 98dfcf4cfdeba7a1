"""Elbow, forearm and wrist keep away from what the lidar sees."""

import math

import numpy as np
import pytest

from motm_twin.control.arm.bodies import BODIES, HAND_BODY, arm_balls, placed
from motm_twin.control.arm.limits import seen_distances
from motm_twin.control.arm.parameters import AvoidanceParameters
from motm_twin.model.arm_kernels import fk_arm
from motm_twin.model.profile import READY

MOUNT = np.array([0.15, 0.0, 0.38])
BALLS = arm_balls()


def distances(points, heading=0.0, reach=0.35, q=READY):
    frames = fk_arm(np.asarray(q, dtype=float))
    return seen_distances(frames, placed(BALLS, 0.08, 0.0), HAND_BODY, reach, np.array(points), MOUNT, heading)


def test_a_point_beside_the_elbow_is_measured_from_its_surface():
    distance, normal, ball = distances([[0.15, 0.30]])
    elbow = BODIES.index("elbow")
    _, centre, radius, _ = placed(BALLS, 0.08, 0.0)
    frame = fk_arm(np.asarray(READY, dtype=float))[BALLS.frame[ball[elbow, 0]]]
    here = MOUNT + (frame @ np.append(centre[ball[elbow, 0]], 1.0))[:3]
    expected = math.hypot(here[0] - 0.15, here[1] - 0.30) - radius[ball[elbow, 0]] - 0.025
    assert distance[elbow, 0] == pytest.approx(expected)
    assert normal[elbow, 0, 1] < -0.9, "away from the point, which is to the left"


def test_a_point_out_of_reach_gives_no_row():
    assert np.isinf(distances([[3.0, 3.0]])[0]).all()


def test_turning_robot_and_point_together_changes_nothing():
    point = np.array([0.2, 0.32])
    turn = 1.1
    c, s = math.cos(turn), math.sin(turn)
    offset = point - MOUNT[:2]
    turned = MOUNT[:2] + np.array([c * offset[0] - s * offset[1], s * offset[0] + c * offset[1]])
    assert np.allclose(distances([point])[0], distances([turned], heading=turn)[0])


def test_a_moving_obstacle_is_kept_further_away_than_a_static_one():
    p = AvoidanceParameters()
    assert p.link_d_s > p.furniture_d_s > 0.0
    assert p.link_d_i > p.furniture_d_i
