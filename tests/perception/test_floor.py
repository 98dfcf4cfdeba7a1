"""Floor that the robot knows to be free: what it has seen, and lately."""

import math

import numpy as np
import pytest
import shapely

from motm_twin.model.geometry import from_frame
from motm_twin.perception.floor import FRESH, SEEN_LASTS, STALE, UNSEEN, sight_radius
from motm_twin.perception.mapper import Mapper

from .small_world import LIDAR, look

PERIOD = 0.05


@pytest.fixture
def mapper(known):
    return Mapper(known)


def state_at(world, x, y):
    floor = world.floor
    row = math.floor((y - floor.corner[1]) / floor.resolution)
    column = math.floor((x - floor.corner[0]) / floor.resolution)
    return floor.seen[row, column]


def test_what_the_lidar_does_not_see_is_unknown_not_free(mapper):
    """A lidar of 270 degrees sees nothing behind it, and nothing behind a box."""
    world = look(mapper, 0.0, [shapely.box(0.6, -0.2, 0.8, 0.2)])
    assert LIDAR.field_of_view < 1.6 * math.pi
    assert state_at(world, 0.5, 0.0) == FRESH
    assert state_at(world, 0.3, 0.6) == FRESH
    assert state_at(world, 0.95, 0.0) == UNSEEN  # behind the box
    assert state_at(world, -0.6, 0.0) == UNSEEN  # behind the robot
    assert state_at(world, -0.3, 0.0) == FRESH  # under it
    assert state_at(world, -0.40, 0.0) == FRESH  # where it turns: it was put down with room for that


def test_floor_that_was_seen_goes_stale(mapper):
    look(mapper, 0.0, [])
    for turn in range(1, 30):
        world = look(mapper, turn * PERIOD, [], pose=(0.02 * turn, 0.0, 0.0))
    assert state_at(world, -0.2, 0.0) == FRESH
    later = look(mapper, 29 * PERIOD + SEEN_LASTS + 1.0, [], pose=(0.58, 0.0, 0.0))
    assert state_at(later, -0.2, 0.0) == STALE
    assert state_at(later, 0.9, 0.0) == FRESH


def test_the_floor_is_kept_as_far_as_a_stop_needs(known):
    radius = sight_radius(known.robot)
    base = known.robot.base
    stop = base.forward_speed * base.velocity_lag + base.forward_speed**2 / (2 * base.linear_acceleration)
    front = from_frame(np.zeros(3), np.array([0.5 * known.robot.footprint.length + stop, 0.0]))
    assert np.hypot(*front) < radius
