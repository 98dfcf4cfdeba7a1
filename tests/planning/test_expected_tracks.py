"""Those of whom `foresight` expects that they yield, and those who go on though the robot is in the way."""

import numpy as np
import pytest
from test_evasion import KNOWN, problem, world_with

from motm_twin.control.method import PlannerParts
from motm_twin.methods.registry import FAST, FORESIGHT, expect_tracks
from motm_twin.model.scene_file import load_scene
from motm_twin.planning.parameters import PlanningParameters
from motm_twin.twin import Twin

SLOW, QUICK = (1.7, 0.0, -0.4, 0.0, 0.25), (2.5, 1.0, -1.0, 0.0, 0.25)


def test_who_yields_stays_an_obstacle_and_who_goes_on_is_met_where_he_will_be():
    seen = expect_tracks(PlannerParts(known=KNOWN, parameters=PlanningParameters())).of(
        problem(world_with(SLOW, QUICK))
    )
    assert seen.world.tracks[:, 0] == pytest.approx([QUICK[0]])
    assert seen.yielding[:, 0] == pytest.approx([SLOW[0]])


def test_where_nobody_moves_foresight_drives_as_fast_does():
    poses = []
    for method in (FAST, FORESIGHT):
        twin = Twin(load_scene("exp1", "trial1"), method=method)
        poses.append([twin.advance().observation.pose for _ in range(200)])
    assert np.array_equal(*np.array(poses))
