"""Grid and lidar against exact geometry; what is seen, forgotten, kept and called static."""

import numpy as np
import pytest
import shapely
import shapely.affinity

from motm_twin.model.profile import RobotProfile
from motm_twin.model.state import state_hash
from motm_twin.perception.clusters import growth_of
from motm_twin.perception.mapper import Mapper, MapSettings

from .small_world import box, cast, degrees, look, observe, scan_of

PERIOD = 0.05


@pytest.fixture
def mapper(known):
    return Mapper(known)


def occupied_near(world, body, within=0.08):
    """How many seen cells lie within a distance of a body."""
    return (
        int((shapely.distance(body, shapely.points(world.seen_points)) < within).sum()) if len(world.seen_points) else 0
    )


def test_seen_cells_are_exactly_those_in_which_beams_end(mapper):
    body = box(2.0, -0.5)
    world = look(mapper, 0.0, [body])
    pose = np.zeros(3)
    ranges = np.minimum(cast(pose, [body]), 1e6)
    bearings = -degrees(135) + degrees(270) / 360 * np.arange(361)
    ends = (ranges[:, None] * np.column_stack([np.cos(bearings), np.sin(bearings)]))[ranges < 1e6]
    cells = {tuple(cell) for cell in mapper.base.grid.cell_of(ends)}
    assert {tuple(cell) for cell in mapper.base.grid.cell_of(world.seen_points)} == cells
    assert all(world.occupied[cell] for cell in cells)


def test_distance_is_right_within_the_stated_bound_next_to_a_seen_box(mapper):
    body = box(2.0, 0.0)
    for turn in range(10):
        world = look(mapper, turn * PERIOD, [body])
    rows, columns = mapper.base.grid.cell_of(np.column_stack([np.linspace(0.2, 1.6, 15), np.zeros(15)])).T
    centres = mapper.base.grid.centre_of(np.column_stack([rows, columns]))
    exact = shapely.distance(body, shapely.points(centres))
    assert np.abs(world.distance[rows, columns] - exact).max() < 0.061


def test_a_box_is_occupied_after_one_scan_and_gone_within_300_ms_of_being_seen_free(mapper):
    body = box(2.0, -0.5)
    assert occupied_near(look(mapper, 0.0, [body]), body) > 3
    for turn in range(1, 40):
        look(mapper, turn * PERIOD, [body])
    for turn in range(40, 46):
        world = look(mapper, turn * PERIOD, [box(1.0, 2.5)])
    assert occupied_near(world, body) == 0


def test_a_map_is_the_same_after_a_month(known):
    """Its times were kept in 32 bits of milliseconds, which are over after 24.9 days."""
    month, body = 30.0 * 86400.0, box(2.0, -0.5)
    first, second = Mapper(known), Mapper(known)
    for turn in range(45):
        bodies = [body] if turn < 40 else [box(1.0, 2.5)]
        now, later = look(first, turn * PERIOD, bodies), look(second, month + turn * PERIOD, bodies)
        np.testing.assert_array_equal(now.occupied, later.occupied)


def test_the_mapped_table_is_never_cleared_though_beams_pass_under_it(mapper):
    for turn in range(60):
        world = look(mapper, turn * PERIOD, [], pose=(1.0, 1.5, 0.0))
    np.testing.assert_array_equal(world.occupied, mapper.base.occupied)
    np.testing.assert_array_equal(world.distance, mapper.base.distance)


def test_mapped_furniture_is_not_seen_a_second_time_despite_noise_and_localisation_error(mapper):
    rng = np.random.default_rng(2)
    cabinet = shapely.box(-1.0, -2.2, 1.0, -1.8)
    for turn in range(60):
        error = np.array([0.02, -0.02, degrees(1.0)]) * np.sin(turn)
        pose = np.array([0.5, 0.0, -1.0])
        ranges = cast(pose, [shapely.Point(2.5, 1.5).buffer(0.05), shapely.Point(3.5, 1.5).buffer(0.05), cabinet], rng)
        world = mapper.update(observe(turn * PERIOD, scan_of(ranges, pose + error, turn * PERIOD)))
        assert len(world.seen_points) == 0


def test_a_box_right_beside_the_table_is_seen_because_the_lidar_cannot_see_the_table_top(mapper):
    body = box(1.7, 1.5)  # 5 cm from the table's edge
    world = look(mapper, 0.0, [body])
    assert occupied_near(world, body) > 3


def test_a_box_becomes_static_after_3_s_in_spite_of_noise(mapper):
    rng = np.random.default_rng(5)
    body = box(2.0, -0.5)
    for turn in range(59):
        world = look(mapper, turn * PERIOD, [body], rng=rng)
    assert not world.seen_static.any()
    for turn in range(59, 75):
        world = look(mapper, turn * PERIOD, [body], rng=rng)
    assert world.seen_static.mean() > 0.9
    for turn in range(75, 140):
        world = look(mapper, turn * PERIOD, [body], rng=rng)
        assert world.seen_static.mean() > 0.85


def test_a_moving_agent_is_never_static_and_leaves_no_trail(mapper):
    for turn in range(140):
        agent = shapely.Point(1.5 + 0.3 * np.sin(turn * 0.02), -1.2 + 0.02 * turn).buffer(0.25)
        world = look(mapper, turn * PERIOD, [agent])
        assert not world.seen_static.any()
        assert occupied_near(world, agent, 0.16) == len(world.seen_points)


def test_a_static_box_out_of_sight_is_remembered_but_a_glimpse_of_an_agent_fades(mapper):
    body, agent = box(2.0, -0.5), shapely.Point(0.0, 2.0).buffer(0.25)
    for turn in range(70):
        look(mapper, turn * PERIOD, [body])
    world = look(mapper, 70 * PERIOD, [body, agent])
    assert occupied_near(world, agent) > 2
    for turn in range(71, 140):
        world = look(mapper, turn * PERIOD, [], pose=(-1.0, -1.0, np.pi))  # both are behind the robot
    assert occupied_near(world, body) > 3
    assert world.seen_static.all()
    assert occupied_near(world, agent) == 0


def test_cells_under_the_robot_are_free_once_beams_have_passed_through_them(mapper):
    body = box(2.0, -0.5)
    for turn in range(70):
        look(mapper, turn * PERIOD, [body])
    for turn in range(70, 70 + MapSettings().evidence_most):
        world = look(mapper, turn * PERIOD, [], pose=(1.9, -0.5, np.pi))
    inside = shapely.box(1.6, -0.7, 2.2, -0.3)
    assert occupied_near(world, inside, 1e-9) == 0


def test_a_box_that_the_robot_has_run_into_stays_in_the_map(mapper):
    """The footprint was cleared with every scan: the robot drove on through what it touched."""
    body = shapely.box(0.4, -0.6, 0.7, 0.6)
    look(mapper, 0.0, [body])
    for turn in range(1, 40):
        world = look(mapper, turn * PERIOD, [body], pose=(0.25, 0.0, 0.0))  # 0.2 m inside it
    assert occupied_near(world, body) > 10


def test_a_box_that_is_put_onto_the_robot_is_in_the_map_while_it_is_hit_and_gone_when_it_is_gone(mapper):
    body = shapely.box(0.2, -0.6, 0.5, 0.6)  # 0.15 m inside the footprint, never seen from outside
    for turn in range(10):
        world = look(mapper, turn * PERIOD, [body])
    assert occupied_near(world, body) > 10
    for turn in range(10, 10 + MapSettings().evidence_most):
        world = look(mapper, turn * PERIOD, [])
    assert not len(world.seen_points)


def test_the_outline_of_a_static_box_covers_what_was_seen_and_stays_calm(mapper):
    rng = np.random.default_rng(7)
    body = box(2.0, -0.6)
    changes, before = 0, ()
    for turn in range(100):
        world = look(mapper, turn * PERIOD, [body], pose=(0.0, 0.2 * np.sin(turn * 0.05), 0.0), rng=rng)
        seen = world.polygons[len(mapper.base.polygons) :]
        assert len(seen) <= 2  # a face each
        changes += turn > 20 and any(all(outline is not old for old in before) for outline in seen)
        before = seen
    outline = shapely.union_all([shapely.Polygon(corners) for corners in seen])
    assert all(shapely.Polygon(corners).exterior.is_ccw for corners in seen)
    assert shapely.distance(outline, shapely.points(world.seen_points)).max() < 0.08
    assert outline.difference(body.buffer(0.1)).area < 1e-3
    assert shapely.buffer(outline, growth_of(RobotProfile().footprint)).contains(body.centroid)  # no way through it
    assert changes <= 4


def test_two_walls_at_a_right_angle_do_not_fill_the_corner_between_them(mapper):
    walls = [shapely.box(2.0, -2.5, 2.1, 0.5), shapely.box(-0.5, 2.6, 2.1, 2.7), shapely.box(2.0, 0.5, 2.1, 2.7)]
    for turn in range(5):
        world = look(mapper, turn * PERIOD, walls)
    for corners in world.polygons[len(mapper.base.polygons) :]:
        assert shapely.Polygon(corners).distance(shapely.Point(1.2, 1.2)) > 0.2


def test_arrays_of_the_map_cannot_be_written(mapper):
    world = look(mapper, 0.0, [box(2.0, -0.5)])
    arrays = [world.occupied, world.distance, world.proximity, world.seen_points, world.seen_static, *world.polygons]
    assert not any(array.flags.writeable for array in arrays)


def test_a_restored_mapper_goes_on_exactly_as_the_first_time(mapper):
    def go_on():
        rng = np.random.default_rng(11)
        for turn in range(20, 40):
            world = look(mapper, turn * PERIOD, [box(2.0, -0.5 + 0.03 * turn)], rng=rng)
        return world, state_hash(mapper.snapshot())

    for turn in range(20):
        look(mapper, turn * PERIOD, [box(2.0, -0.5)])
    saved = mapper.snapshot()
    first, first_hash = go_on()
    mapper.restore(saved)
    second, second_hash = go_on()
    assert first_hash == second_hash
    np.testing.assert_array_equal(first.distance, second.distance)


def test_without_any_scan_the_map_is_the_pre_made_one(mapper):
    world = mapper.update(observe(0.0))
    np.testing.assert_array_equal(world.occupied, mapper.base.occupied)
    assert len(world.polygons) == 2
    assert world.seen_points.shape == (0, 2)


def test_an_agent_that_drives_straight_at_the_robot_leaves_no_trail_in_its_own_shadow(mapper):
    for turn in range(100):
        agent = shapely.Point(3.5 - 0.02 * turn, 0.0).buffer(0.25)
        world = look(mapper, turn * PERIOD, [agent])
        assert occupied_near(world, agent, 0.3) == len(world.seen_points)
        assert not world.seen_static.any()


def test_a_fence_round_the_robot_is_no_solid_block(mapper):
    """Its hull held the robot, which was then thought to stand outside, and saw a way through the fence."""
    fence = [shapely.affinity.rotate(shapely.box(0.95, -0.5, 1.1, 0.5), 45.0 * k, origin=(0.0, 0.0)) for k in range(8)]
    for turn in range(8):  # it looks all round
        world = look(mapper, turn * PERIOD, fence, pose=(0.0, 0.0, turn * np.pi / 4))
    seen = [shapely.Polygon(corners) for corners in world.polygons]
    assert not any(polygon.contains(shapely.Point(0.0, 0.0)) for polygon in seen)
    assert len(seen) > 8
