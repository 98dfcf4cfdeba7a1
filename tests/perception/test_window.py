"""Of a large map a period sees a part, as exact as if that were all."""

import msgspec
import numpy as np
import pytest

from motm_twin.model.scene import Box, Solid
from motm_twin.perception.base_map import FAR
from motm_twin.perception.grid import AROUND, STEP
from motm_twin.perception.mapper import Mapper

from .small_world import box, look, observe

FLOOR = (-30.0, -20.0, 70.0, 20.0)  # [m] 100 x 40 m: 1.6 million cells


@pytest.fixture
def floor(known):
    """The small room's furniture on a large floor, and a crate every 10 m."""
    crates = tuple(
        Solid(name=f"crate{x}", shape=Box(centre=(x, 6.0), size=(1.0, 1.0)), z_min=0.0, z_max=1.0, mapped=True)
        for x in range(-25, 70, 10)
    )
    return msgspec.structs.replace(known, bounds=FLOOR, solids=(*known.solids, *crates))


def corners_of(world):
    """The rectangle that the map covers: low, high (2,)."""
    return world.origin, world.origin + world.resolution * np.array(world.distance.shape[::-1])


def floor_cells(known):
    """How many cells all of the map has."""
    return round((known.bounds[2] - known.bounds[0]) / 0.05) * round((known.bounds[3] - known.bounds[1]) / 0.05)


def test_a_room_on_a_large_floor_is_seen_as_it_is_in_a_small_map(known, floor):
    small, large = Mapper(known), Mapper(floor)
    assert large.large
    assert not small.large
    seen = [box(2.01, -0.51)]  # no side along the border of cells
    for turn in range(5):
        one, other = (look(mapper, 0.05 * turn, seen) for mapper in (small, large))
    assert other.distance.size < floor_cells(floor)
    left, low = np.round((one.origin - other.origin) / one.resolution).astype(int)
    part = slice(low, low + one.distance.shape[0]), slice(left, left + one.distance.shape[1])
    room = one.distance < 1.0  # what is near in the room, no crate is nearer to
    np.testing.assert_array_equal(other.occupied[part], one.occupied)
    np.testing.assert_allclose(other.distance[part][room], one.distance[room], atol=1e-6)
    assert other.distance.max() <= FAR
    np.testing.assert_allclose(other.seen_points, one.seen_points)


def test_the_part_goes_along_with_the_robot_in_steps_and_holds_what_is_near(floor):
    mapper, seen = Mapper(floor), []
    for turn in range(100):
        x = 0.5 * turn
        world = look(mapper, 0.05 * turn, [], pose=(x, 0.0, 0.0))
        low, high = corners_of(world)
        assert (low <= np.maximum(np.array([x, 0.0]) - AROUND, FLOOR[:2])).all()
        assert (high >= np.minimum(np.array([x, 0.0]) + AROUND, FLOOR[2:])).all()
        near = [middle for middle in range(-25, 70, 10) if low[0] <= middle + 0.5 and middle - 0.5 <= high[0]]
        crates = [corners.mean(axis=0)[0] for corners in world.polygons if corners.mean(axis=0)[1] > 5.0]
        assert sorted(crates) == pytest.approx(near)
        seen.append(tuple(low))
    assert len(set(seen)) == pytest.approx(49.5 / STEP, abs=1.5)


def test_a_target_far_away_is_in_the_part_too(floor):
    mapper = Mapper(floor)
    look(mapper, 0.0, [])
    low, high = corners_of(mapper.update(observe(0.05), [np.array([40.0, 1.0])]))
    assert low[0] <= -AROUND
    assert high[0] >= 40.0 + AROUND
    low, high = corners_of(mapper.update(observe(0.1), []))
    assert high[0] < 40.0
