"""The reachability map: every posture in it is one that the arm can take, and what is out of reach is zero."""

import math

import numpy as np
import pytest

from motm_twin.control.arm.geometry import stretch, tilt_of
from motm_twin.control.arm.parameters import ArmParameters
from motm_twin.model.arm_kernels import TCP, fk_arm, manipulability
from motm_twin.model.profile import Q_MAX, Q_MIN
from motm_twin.rivals.reachability import (
    AZIMUTHS,
    POSTURES,
    RADII,
    YAWS,
    ReachabilityMap,
    Task,
    hand_rotation,
    reachability_map,
    solve_arm,
)

PICK = Task("pick", 0.42, 0.40)  # a cube on a table of 0.78 m
PLACE = Task("place", 0.40, 0.34)  # over a rim of 0.72 m


@pytest.fixture(scope="module")
def pick() -> ReachabilityMap:
    """The map for a cube on the table."""
    return reachability_map(PICK)


def test_every_posture_found_for_a_pose_of_the_hand_reaches_it_and_the_one_it_came_from_is_among_them() -> None:
    rng = np.random.default_rng(3)
    found = np.empty((POSTURES, 7))
    for q in rng.uniform(Q_MIN, Q_MAX, (200, 7)):
        q[3] = min(q[3], -0.6)  # the elbow is not searched beyond straight
        T = fk_arm(q)[TCP]
        count = solve_arm(T[:3, :3].copy(), T[:3, 3].copy(), float(q[6]), found)
        assert count > 0
        for posture in found[:count]:
            assert np.allclose(fk_arm(posture)[TCP], T, atol=1e-9)
        away = np.abs(np.angle(np.exp(1j * (found[:count] - q)))).max(axis=1)
        assert away.min() < 1e-6


@pytest.mark.parametrize("task", [PICK, PLACE])
def test_every_stored_posture_reaches_its_cell_within_the_limits_with_the_stored_manipulability(task: Task) -> None:
    cells = reachability_map(task)
    stored = np.argwhere(cells.value > 0.0)
    elbow = ArmParameters().qp.elbow_limit
    for i, j, k in stored[np.random.default_rng(1).choice(len(stored), 300, replace=False)]:
        q = cells.posture[i, j, k]
        azimuth = -math.pi + 2.0 * math.pi * k / AZIMUTHS
        T = fk_arm(q)[TCP]
        where = [float(RADII[i]) * math.cos(azimuth), float(RADII[i]) * math.sin(azimuth), task.height]
        assert np.allclose(T[:3, 3], where, atol=1e-9)
        assert (q >= Q_MIN).all()
        assert (q <= Q_MAX).all()
        assert q[3] <= elbow
        assert manipulability(q) == pytest.approx(cells.value[i, j, k])
        straight = hand_rotation(float(RADII[i]), 0.0, task)
        assert straight is not None
        assert tilt_of(T[:3, :3]) == pytest.approx(tilt_of(straight), abs=1e-6)


def test_a_posture_holds_a_face_of_the_cube(pick: ReachabilityMap) -> None:
    for i, j, k in np.argwhere(pick.value > 0.0)[::997]:
        if stretch(float(RADII[i]), PICK.height, 0.0) > ArmParameters().stretch:
            continue  # tilted: the yaw is that before the tilt
        azimuth = -math.pi + 2.0 * math.pi * k / AZIMUTHS
        x = fk_arm(pick.posture[i, j, k])[TCP][:2, 0]
        yaw = math.atan2(x[1], x[0]) - azimuth
        assert math.remainder(yaw - j * 0.5 * math.pi / YAWS, 0.5 * math.pi) == pytest.approx(0.0, abs=1e-6)


def test_the_map_is_the_same_to_both_sides_of_the_arm(pick: ReachabilityMap) -> None:
    mirrored = pick.value[:, (-np.arange(YAWS)) % YAWS][:, :, (-np.arange(AZIMUTHS)) % AZIMUTHS]
    both = (pick.value > 0.0) & (mirrored > 0.0)
    assert both.mean() > 0.5
    assert np.abs(pick.value - mirrored)[both].max() < 0.1 * pick.best  # the links' capsules are not quite symmetric
    assert np.abs(pick.value - mirrored)[both].mean() < 0.01 * pick.best


def test_out_of_reach_is_zero_and_the_best_is_where_the_arm_is_neither_folded_nor_stretched(
    pick: ReachabilityMap,
) -> None:
    arm = ArmParameters()
    for i, radius in enumerate(RADII):
        if stretch(float(radius), PICK.height, arm.pick_tilt) > arm.stretch + 1e-3:
            assert not pick.value[i].any()
    ahead = pick.at(np.array([0.1, 0.6, 0.85, 2.0]), np.zeros(4), np.zeros(4))
    assert ahead[1] > 0.8 * pick.best
    assert not ahead[[0, 2, 3]].any()
    best = RADII[np.unravel_index(int(np.argmax(pick.value)), pick.value.shape)[0]]
    assert 0.5 < best < 0.68


def test_between_cells_the_value_is_between_theirs_and_turning_the_cube_by_a_face_changes_nothing(
    pick: ReachabilityMap,
) -> None:
    rng = np.random.default_rng(5)
    radius, azimuth, yaw = rng.uniform(0.4, 0.7, 50), rng.uniform(-2.0, 2.0, 50), rng.uniform(-3.0, 3.0, 50)
    value = pick.at(radius, azimuth, yaw)
    assert (value > 0.0).all()
    assert (value <= pick.best).all()
    assert np.allclose(value, pick.at(radius, azimuth, yaw + 0.5 * math.pi))


def test_the_map_of_a_task_is_computed_once() -> None:
    assert reachability_map(PICK) is reachability_map(Task("pick", 0.42, 0.40))
