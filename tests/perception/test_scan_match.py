"""Scan and map: by how much localisation is off."""

import math

import msgspec
import numpy as np
import pytest

from motm_twin.model.known import known_world
from motm_twin.model.plant import Observation, Scan
from motm_twin.model.scene_file import load_scene
from motm_twin.perception.scan_match import MatchSettings, MatchState, corrected, follow, match
from motm_twin.perception.sweeps import expected_ranges, map_segments

PERIOD, SETTINGS = 0.05, MatchSettings()
KNOWN = known_world(load_scene("exp1", "trial1"))
SEGMENTS, LIDAR = map_segments(KNOWN), KNOWN.robot.lidar
STEP = 2.0 * math.pi / LIDAR.beams
POSE = np.array([0.3, -0.2, 0.4])


def sweep(pose, localised, stamp, rng=None, noise=0.01):
    """A sweep made at a pose, and the pose that is reported for it."""
    origin = np.array([LIDAR.x, LIDAR.y])
    ranges = expected_ranges(pose, origin, -math.pi, STEP, LIDAR.beams, SEGMENTS, LIDAR.range_max)
    if rng is not None:
        ranges = ranges + noise * rng.standard_normal(LIDAR.beams)
    return Scan(
        stamp=stamp, ranges=ranges, angle_min=-math.pi, angle_step=STEP, origin=origin, range_min=0.05,
        range_max=LIDAR.range_max, pose=localised,
    )  # fmt: skip


def seen(time, localised, odometry, scan):
    return Observation(
        time=time, pose=localised, odometry=odometry, twist=np.zeros(2), q=np.zeros(7), dq=np.zeros(7),
        gripper_width=0.08, gripper_moving=False, scan=scan, detections=(),
    )  # fmt: skip


def run(state, error, periods, rng, *, begin=0, change=lambda scan: scan, segments=SEGMENTS):
    """Stand for some periods with this error of localisation; error of the corrected pose."""
    localised = POSE + error
    for k in range(begin, begin + periods):
        scan = change(sweep(POSE, localised, k * PERIOD, rng))
        follow(state, seen(k * PERIOD, localised, np.zeros(3), scan), SETTINGS)
        match(state, scan, segments, SETTINGS)
    return corrected(state, localised) - POSE


@pytest.mark.parametrize("error", [(0.05, -0.04, 0.02), (-0.06, 0.0, -0.02), (0.0, 0.0, 0.0)])
def test_the_furniture_in_sight_tells_by_how_much_localisation_is_off(error):
    left = run(MatchState(), np.array(error), 20, np.random.default_rng(1))
    assert math.hypot(*left[:2]) < 0.006
    assert abs(left[2]) < 0.004


def test_after_a_leap_of_localisation_one_sweep_tells_most():
    state, rng = MatchState(), np.random.default_rng(2)
    run(state, np.zeros(3), 40, rng)
    left = run(state, np.array([0.05, 0.0, 0.0]), 1, rng, begin=40)
    assert math.hypot(*left[:2]) < 0.02
    left = run(state, np.array([0.05, 0.0, 0.0]), 10, rng, begin=41)
    assert math.hypot(*left[:2]) < 0.006


def test_what_is_not_on_the_map_does_not_draw_the_pose_away():
    def boxes(scan):  # before a third of the furniture, 0.2 m nearer
        hit = np.flatnonzero(np.isfinite(scan.ranges))
        ranges = scan.ranges.copy()
        ranges[hit[: len(hit) // 3]] -= 0.2
        return msgspec.structs.replace(scan, ranges=ranges)

    left = run(MatchState(), np.array([0.03, 0.03, 0.01]), 20, np.random.default_rng(3), change=boxes)
    assert math.hypot(*left[:2]) < 0.012
    assert abs(left[2]) < 0.006


def test_where_nothing_mapped_is_in_sight_localisation_counts_again():
    state, rng = MatchState(), np.random.default_rng(4)
    error = np.array([0.04, 0.0, 0.0])
    assert abs(run(state, error, 20, rng)[0]) < 0.006
    blind = run(state, error, 400, rng, begin=20, segments=np.zeros((0, 4)))
    assert blind[0] == pytest.approx(0.04, abs=0.002)


def test_one_wall_tells_nothing_along_itself():
    wall = np.array([[-50.0, 2.0, 50.0, 2.0]])
    state, error = MatchState(), np.array([0.04, 0.04, 0.0])
    origin = np.array([LIDAR.x, LIDAR.y])
    ranges = expected_ranges(POSE, origin, -math.pi, STEP, LIDAR.beams, wall, LIDAR.range_max)
    for k in range(20):
        scan = msgspec.structs.replace(sweep(POSE, POSE + error, k * PERIOD), ranges=ranges)
        follow(state, seen(k * PERIOD, POSE + error, np.zeros(3), scan), SETTINGS)
        match(state, scan, wall, SETTINGS)
    left = corrected(state, POSE + error) - POSE
    assert abs(left[1]) < 0.003
    assert left[0] == pytest.approx(0.04, abs=0.003)
