"""The pre-made map against exact geometry."""

import copy

import msgspec
import numpy as np
import pytest
import shapely

from motm_twin.model.scene import Box, Cylinder, Prism, Solid
from motm_twin.perception.base_map import base_map
from motm_twin.perception.footprints import distance_to_shape, merged_outlines, outline
from motm_twin.planning.collision import Field, distance_at

from .small_world import table

SHAPES = [
    Box(centre=(0.3, -0.2), size=(1.4, 0.5), yaw=0.7),
    Prism(corners=((0.0, 0.0), (2.0, 0.0), (2.0, 0.5), (0.5, 0.5), (0.5, 1.5), (0.0, 1.5))),
]


@pytest.mark.parametrize("shape", SHAPES)
def test_distance_to_a_polygon_is_exact_and_zero_inside(shape):
    points = np.random.default_rng(1).uniform(-3, 3, (500, 2))
    expected = shapely.distance(shapely.Polygon(outline(shape)), shapely.points(points))
    np.testing.assert_allclose(distance_to_shape(shape, points), expected, atol=1e-12)


def test_distance_to_a_cylinder_is_that_to_the_true_circle():
    disc = Cylinder(centre=(1.0, 2.0), radius=0.4)
    points = np.array([[1.0, 2.1], [2.0, 2.0], [1.0, 1.0]])
    np.testing.assert_allclose(distance_to_shape(disc, points), [0.0, 0.6, 0.6])


def test_the_outline_of_a_cylinder_encloses_it():
    corners = shapely.Polygon(outline(Cylinder(centre=(1.0, 2.0), radius=0.4)))
    assert corners.buffer(1e-9).contains(shapely.Point(1.0, 2.0).buffer(0.4, quad_segs=64))
    assert len(corners.exterior.coords) == 17


def test_a_table_is_one_outline_and_every_outline_is_counter_clockwise():
    (corners,) = merged_outlines(table())
    assert sorted(map(tuple, corners.round(9))) == [(2.0, 1.1), (2.0, 1.9), (4.0, 1.1), (4.0, 1.9)]
    assert shapely.LinearRing(corners).is_ccw


def test_walls_round_a_room_stay_separate_so_that_the_room_is_not_filled():
    walls = tuple(
        Solid(name=f"w{i}", shape=Box(centre=c, size=s), z_min=0, z_max=2, mapped=True, group="room")
        for i, (c, s) in enumerate([((0, 2), (4, 0.1)), ((0, -2), (4, 0.1)), ((2, 0), (0.1, 4)), ((-2, 0), (0.1, 4))])
    )
    assert len(merged_outlines(walls)) == 4


def test_occupied_cells_are_those_that_a_footprint_meets(known):
    base = base_map(known, 0.05)
    solids = [s for s in known.solids if s.name != "lamp"]
    union = shapely.union_all([shapely.Polygon(outline(s.shape)) for s in solids])
    x, y = base.grid.centres()[..., 0], base.grid.centres()[..., 1]
    expected = shapely.area(shapely.intersection(union, shapely.box(x - 0.025, y - 0.025, x + 0.025, y + 0.025))) > 1e-9
    np.testing.assert_array_equal(base.occupied.astype(bool), expected)


def test_the_same_furniture_has_one_map_while_it_is_used_and_other_furniture_another(known):
    base = base_map(known, 0.05)
    same = copy.deepcopy(known)
    assert base_map(same, 0.05) is base
    coarse = base_map(known, 0.1)
    assert coarse.occupied.size < base.occupied.size
    fewer = msgspec.structs.replace(known, solids=known.solids[1:])
    assert base_map(fewer, 0.05).occupied.sum() < base.occupied.sum()


def test_a_robot_of_another_height_has_another_map(known):
    """A robot with an arm had the map of one without that came before it, and drove under tables."""
    low = msgspec.structs.replace(known, robot=msgspec.structs.replace(known.robot, has_arm=False))
    below = base_map(low, 0.05)
    assert known.robot.top > low.robot.top
    assert base_map(known, 0.05).occupied.sum() > below.occupied.sum()


def test_what_hangs_overhead_is_not_an_obstacle(known):
    base = base_map(known, 0.05)
    row, column = base.grid.cell_of(np.array([1.0, 2.5]))
    assert base.occupied[row, column] == 0
    assert base.distance[row, column] > 0.5


def test_distance_is_exact_at_cell_centres(known):
    base = base_map(known, 0.05)
    union = shapely.union_all([shapely.box(2.0, 1.1, 4.0, 1.9), shapely.box(-1.0, -2.2, 1.0, -1.8)])
    centres = shapely.points(base.grid.centres())
    inside = shapely.contains(union, centres)
    expected = np.where(inside, -shapely.distance(union.boundary, centres), shapely.distance(union, centres))
    np.testing.assert_allclose(base.distance, expected, atol=1e-6)


@pytest.mark.parametrize("edge", [2.0, 2.01, 2.025, 2.04])
def test_between_cells_the_distance_to_a_wall_is_exact(known, edge):
    """Cells inside it had 0: a base came up to 12 mm nearer to walls and their corners than planned."""
    wall = Solid(name="w", shape=Box(centre=(edge + 0.2, 0.0), size=(0.4, 2.0)), z_min=0, z_max=2, mapped=True)
    base = base_map(msgspec.structs.replace(known, solids=(wall,)), 0.05)
    field = Field(base.distance, *base.grid.origin, 1.0 / 0.05)
    for gap in (0.0, 0.004, 0.01, 0.02, 0.04):
        assert distance_at(edge - gap, 0.013, field) == pytest.approx(gap, abs=1e-6)
