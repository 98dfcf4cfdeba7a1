"""Expectation of who goes on, though the robot is in the way."""

import numpy as np
import pytest
from test_evasion import KNOWN, problem, world_with

from motm_twin.methods.registry import FAST, FORESIGHT, expect_tracks
from motm_twin.model.scene_file import load_scene
from motm_twin.perception.tracks import PACE
from motm_twin.planning.heed import Heed
from motm_twin.twin import Twin

SLOW, QUICK = (1.7, 0.0, -0.4, 0.0, 0.25), (2.5, 1.0, -1.0, 0.0, 0.25)
TOO_NEAR = (0.85, 0.0, -0.55, 0.0, 0.25)


def test_slow_ones_are_trusted_to_yield_and_quick_ones_are_not():
    others = Heed(KNOWN).of(problem(world_with(SLOW, QUICK)))
    assert others.yields[:, 0] == pytest.approx([SLOW[0]])
    assert others.go_on[:, 0] == pytest.approx([QUICK[0]])
    assert not others.wary


def test_a_speed_counts_once_it_was_kept():
    """As somebody comes out from behind another its middle jumps."""
    world = world_with(QUICK, TOO_NEAR)
    world.tracks[:, PACE] = 0.4
    others = Heed(KNOWN).of(problem(world))
    assert len(others.yields) == 2
    assert not others.wary


def test_nobody_is_trusted_for_a_while_after_somebody_did_not_brake():
    heed = Heed(KNOWN)
    assert heed.of(problem(world_with(TOO_NEAR), 1.0)).wary
    kept = heed.snapshot()
    later = heed.of(problem(world_with(SLOW), 30.0))
    assert later.wary
    assert len(later.go_on) == 1
    assert not heed.of(problem(world_with(SLOW), 62.0)).wary
    heed.restore(kept)
    assert heed.of(problem(world_with(SLOW), 60.0)).wary


def test_who_yields_stays_an_obstacle_and_who_goes_on_is_met_where_he_will_be():
    seen = expect_tracks(KNOWN).of(problem(world_with(SLOW, QUICK)))
    assert seen.world.tracks[:, 0] == pytest.approx([QUICK[0]])
    assert seen.yielding[:, 0] == pytest.approx([SLOW[0]])


def test_where_nobody_moves_foresight_drives_as_fast_does():
    poses = []
    for method in (FAST, FORESIGHT):
        twin = Twin(load_scene("exp1", "trial1"), method=method)
        poses.append([twin.advance().observation.pose for _ in range(200)])
    assert np.array_equal(*np.array(poses))
