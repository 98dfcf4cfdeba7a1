"""Content of sweeps: frozen, blind and noisy ones are found, good ones of any world are not."""

import math

import msgspec
import numpy as np
import pytest

from motm_twin.model.plant import Scan
from motm_twin.perception.sweeps import SweepSettings, SweepState, check_sweep, expected_ranges, map_fit

BEAMS = 361
STEP = 2.0 * math.pi / (BEAMS - 1)
SETTINGS = SweepSettings()
ROOM = np.array([[-4.0, -3.0, 5.0, -3.0], [5.0, -3.0, 5.0, 3.0], [5.0, 3.0, -4.0, 3.0], [-4.0, 3.0, -4.0, -3.0]])
EMPTY = np.zeros((0, 4))
NOWHERE = np.zeros(2)


def sweep(ranges, stamp):
    return Scan(
        stamp=stamp, ranges=ranges, angle_min=-math.pi, angle_step=STEP, origin=NOWHERE, range_min=0.05,
        range_max=15.0, pose=np.zeros(3),
    )  # fmt: skip


def seen(pose, segments=ROOM, sd=0.0, seed=0):
    ranges = expected_ranges(np.array(pose, dtype=float), NOWHERE, -math.pi, STEP, BEAMS, segments, 15.0)
    return ranges + sd * np.random.default_rng(seed).standard_normal(BEAMS)


def run(frames, segments=ROOM, state=None):
    """Findings of frames (pose, ranges), one every 50 ms."""
    state = state or SweepState()
    return [
        check_sweep(state, sweep(ranges, 0.05 * k), np.array(pose), np.array(pose), segments, SETTINGS)
        for k, (pose, ranges) in enumerate(frames)
    ]


def kinds(findings):
    return [None if one is None else one.kind for one in findings]


def driving(count, sd=0.0):
    return [((0.025 * k, 0.0, 0.01 * k), seen((0.025 * k, 0.0, 0.01 * k), sd=sd, seed=k)) for k in range(count)]


@pytest.mark.parametrize("sd", [0.0, 0.01, 0.02])
def test_a_robot_that_drives_through_a_room_finds_nothing(sd):
    assert kinds(run(driving(40, sd))) == [None] * 40


def test_noise_that_stands_still_is_a_frozen_lidar_even_while_the_robot_stands():
    frames = [((0.0, 0.0, 0.0), seen((0, 0, 0), sd=0.01, seed=min(k, 10))) for k in range(20)]
    assert kinds(run(frames)) == [None] * 12 + ["scan_frozen"] * 8


def test_a_standing_robot_without_noise_sees_the_same_for_ever_and_that_is_right():
    assert kinds(run([((0.0, 0.0, 0.0), seen((0, 0, 0)))] * 60)) == [None] * 60


@pytest.mark.parametrize("pose", [(0.025, 0.0, 0.0), (0.0, 0.025, 0.0), (0.0, 0.0, 0.05)])
def test_without_noise_a_frozen_lidar_is_found_by_the_motion(pose):
    still = seen((0, 0, 0))
    found = kinds(run([(tuple(k * value for value in pose), still) for k in range(8)]))
    assert found[0] is None and found[-1] == "scan_frozen"


def test_along_a_straight_wall_without_noise_the_same_sweep_again_is_right():
    wall = np.array([[-1000.0, 2.0, 1000.0, 2.0], [1000.0, -2.0, -1000.0, -2.0]])
    frames = [((0.05 * k, 0.0, 0.0), seen((0, 0, 0), wall)) for k in range(40)]
    assert kinds(run(frames, EMPTY)) == [None] * 40


def test_a_sweep_that_moves_again_is_good_again():
    frames = [*driving(10, 0.01), *[(driving(10)[-1][0], seen((0, 0, 0), sd=0.01, seed=9))] * 6, *driving(10, 0.01)]
    assert kinds(run(frames))[-9:] == [None] * 9


def test_no_return_where_the_map_has_walls_is_a_blind_lidar_at_once():
    blind = np.full(BEAMS, np.inf)
    found = run([*driving(5, 0.01), *[((0.1, 0.0, 0.0), blind)] * 3, *driving(5, 0.01)])
    assert kinds(found) == [None] * 5 + ["scan_blind"] * 3 + [None] * 5
    assert found[5].base == 0.0 and found[5].reason.limit > 300


def test_no_return_on_an_empty_floor_is_right():
    nothing = np.full(BEAMS, np.inf)
    assert kinds(run([((0.02 * k, 0.0, 0.0), nothing) for k in range(60)], EMPTY)) == [None] * 60


def test_all_returns_that_go_at_once_are_missed_and_a_few_of_one_thing_only_for_a_while():
    one, many, nothing = seen((0, 0, 0), np.array([[2.0, -0.3, 2.0, 0.3]])), seen((0, 0, 0)), np.full(BEAMS, np.inf)
    for before, still_missed in ((one, False), (many, True)):
        found = kinds(run([((0.0, 0.0, 0.0), before)] * 3 + [((0.0, 0.0, 0.0), nothing)] * 100, EMPTY))
        assert found[3] == "scan_blind"
        assert (found[-1] == "scan_blind") is still_missed


def test_a_thing_that_goes_out_of_sight_slowly_is_not_missed():
    frames = []
    for k in range(60):
        ranges = np.full(BEAMS, np.inf)
        ranges[100 : 160 - k] = 3.0
        frames.append(((0.0, 0.0, 0.0), ranges))
    assert kinds(run(frames, EMPTY)) == [None] * 60


@pytest.mark.parametrize(("sd", "share"), [(0.01, None), (0.03, None), (0.06, 0.5), (0.3, 0.0)])
def test_more_scatter_than_margins_bear_slows_and_much_more_stops(sd, share):
    found = run(driving(3, sd))[-1]
    assert (None if found is None else found.base) == share


def test_a_scan_fits_the_map_where_it_was_made_and_worse_elsewhere():
    ranges = seen((0.5, 0.3, 0.2), sd=0.01)
    fits = [
        map_fit(np.array(pose), ranges, -math.pi, STEP, NOWHERE, ROOM, 8.0, 0.1)
        for pose in ((0.5, 0.3, 0.2), (0.8, 0.3, 0.2), (0.5, 0.3, 0.4))
    ]
    assert fits[0][0] > 300 and fits[0][1] > 0.95
    assert max(fits[1][1], fits[2][1]) < fits[0][1] - 0.2


def test_beams_that_say_nothing_do_not_count_as_returns():
    ranges = np.full(BEAMS, np.nan)
    scan = msgspec.structs.replace(sweep(ranges, 0.0), ranges=ranges)
    assert check_sweep(SweepState(), scan, np.zeros(3), np.zeros(3), ROOM, SETTINGS).kind == "scan_blind"
