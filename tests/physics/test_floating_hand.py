import math

import pytest

from motm_twin.physics.floating_hand import Cell, cells, counts, outcome, physics_holds, random_cells, rule_holds
from motm_twin.sim.grasp import STRICT, SWEPT

HELD_BY_BOTH = Cell()
HELD_ON_THE_MOVE = Cell(closing_time=0.4, along=0.05)
PUSHED = Cell(closing_time=0.4, across=0.03, offset=0.015)
TURNED = Cell(yaw=math.radians(40.0))
OUT_OF_THE_PADS = Cell(closing_time=0.8, along=0.05)
BESIDE_THE_PADS = Cell(ahead=0.034)


@pytest.mark.parametrize("cell", [HELD_BY_BOTH, HELD_ON_THE_MOVE, PUSHED, TURNED])
def test_what_the_swept_rule_holds_physics_holds(cell: Cell):
    assert rule_holds(cell, SWEPT)
    assert physics_holds(cell)


@pytest.mark.parametrize("cell", [OUT_OF_THE_PADS, BESIDE_THE_PADS])
def test_a_cube_that_is_not_between_the_pads_in_the_end_is_lost(cell: Cell):
    assert not physics_holds(cell)
    assert not rule_holds(cell, SWEPT)
    assert not rule_holds(cell, STRICT)


def test_the_strict_rule_loses_a_cube_over_which_the_hand_moves_fast():
    assert rule_holds(HELD_BY_BOTH, STRICT)
    assert not rule_holds(HELD_ON_THE_MOVE, STRICT)


def test_a_sweep_counts_what_each_rule_gets_wrong():
    assert len(cells()) > len(cells(quick=True)) > 200
    found = counts([outcome(HELD_BY_BOTH), outcome(HELD_ON_THE_MOVE), outcome(BESIDE_THE_PADS)])
    assert found == {
        "cells": 3,
        "physics": 2,
        "strict holds what physics loses": 0,
        "strict loses what physics holds": 1,
        "swept holds what physics loses": 0,
        "swept loses what physics holds": 0,
        "slow: cells": 3,
        "slow: physics": 2,
        "slow: strict holds what physics loses": 0,
        "slow: strict loses what physics holds": 1,
        "slow: swept holds what physics loses": 0,
        "slow: swept loses what physics holds": 0,
    }
    assert random_cells(3) == random_cells(3) != random_cells(3, seed=1)


def test_a_turned_cube_that_one_pad_pushes_far_is_lost_and_so_says_the_rule():
    pushed = Cell(closing_time=0.79, along=0.004, across=0.137, offset=-0.011, ahead=0.011, yaw=-0.238, force=10.0)
    assert not physics_holds(pushed)
    assert not rule_holds(pushed, SWEPT)
