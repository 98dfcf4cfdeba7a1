"""Bins are in the map of the base as in that of the arm: what is known is not discovered."""

import msgspec
import numpy as np
import pytest
import shapely

from motm_twin.control.arm.bodies import mapped_solids
from motm_twin.model.known import known_solids
from motm_twin.model.scene import Bin
from motm_twin.perception.base_map import base_map
from motm_twin.perception.mapper import Mapper

from .small_world import look

TUB = Bin(name="tub", centre=(2.0, -0.8), side=0.4, rim_z=0.25, floor_z=0.02)
TRAY = Bin(name="tray", centre=(3.0, 1.5), side=0.4, rim_z=0.85, floor_z=0.79)  # on the table


def with_bins(world, *bins):
    return msgspec.structs.replace(world, bins=bins)


def test_every_map_is_made_from_one_list(known):
    world = with_bins(known, TUB, TRAY)
    names = [solid.group or solid.name for solid in known_solids(world)]
    assert names[-2:] == ["tub", "tray"]
    assert list(mapped_solids(world).names) == names


def test_a_bin_on_the_floor_is_occupied_where_it_stands(known):
    made = base_map(with_bins(known, TUB), 0.05)
    assert len(made.polygons) == len(base_map(known, 0.05).polygons) + 1
    row, column = made.grid.cell_of(np.array(TUB.centre))
    assert made.occupied[row, column]
    assert made.distance[row, column] == pytest.approx(-0.175)


def test_a_bin_on_a_table_changes_nothing_for_the_base(known):
    without, made = base_map(known, 0.05), base_map(with_bins(known, TRAY), 0.05)
    np.testing.assert_array_equal(made.occupied, without.occupied)
    np.testing.assert_array_equal(made.distance, without.distance)
    assert [p.tolist() for p in made.polygons] == [p.tolist() for p in without.polygons]


def test_a_bin_that_stands_out_over_the_edge_is_one_outline_with_its_table(known):
    edge = msgspec.structs.replace(TRAY, centre=(3.0, 1.1))
    made = base_map(with_bins(known, edge), 0.05)
    assert len(made.polygons) == len(base_map(known, 0.05).polygons)
    assert min(polygon[:, 1].min() for polygon in made.polygons if polygon[:, 1].max() > 1.0) < 0.91


def test_a_rim_that_the_lidar_sees_is_no_obstacle_that_nobody_knows(known):
    mapper = Mapper(with_bins(known, TUB))
    half = 0.5 * TUB.side
    x, y = TUB.centre
    for k in range(5):
        seen = look(mapper, 0.1 * k, [shapely.box(x - half, y - half, x + half, y + half)])
    assert len(seen.seen_points) == 0
