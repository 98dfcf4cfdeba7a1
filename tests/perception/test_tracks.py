"""Tracks of dynamic obstacles: where they are, how fast, and who is who, from scans alone."""

import math

import msgspec
import numpy as np
import pytest
import shapely

from motm_twin.model.known import KnownWorld
from motm_twin.model.plant import Observation
from motm_twin.model.profile import RobotProfile
from motm_twin.model.state import state_hash
from motm_twin.perception.mapper import Mapper
from motm_twin.perception.track_kernels import is_hidden, passed
from motm_twin.perception.tracks import IDENTITY, RADIUS, SD, VX, VY, DynamicTracker
from motm_twin.perception.world_map import WorldMap

from .small_world import LIDAR, cast, scan_of

STEP = 0.05  # [s]
FLOOR = KnownWorld(
    robot=RobotProfile(lidar=LIDAR), start=(0.0, 0.0, 0.0), solids=(), objects=(), object_sd=0.0, bins=(), tasks=(),
    bounds=(-6.0, -6.0, 6.0, 6.0),
)  # fmt: skip


def follow(seconds, *discs, drive=0.0, walls=(), seed=1, at_one_second=lambda tracker: None):
    """Maps while discs ((x, y), (vx, vy), radius) go straight on past a robot that drives along x, and its tracker.

    Instead of (x, y) a function of the time [s] may tell where it is.
    """
    mapper, tracker = Mapper(FLOOR), DynamicTracker(FLOOR)
    rng, maps = np.random.default_rng(seed), []
    for k in range(round(seconds / STEP)):
        time = k * STEP
        if k == 20:
            at_one_second(tracker)
        pose = np.array([drive * time, 0.0, 0.0])
        bodies = [
            shapely.Point(place(time) if callable(place) else np.array(place) + time * np.array(velocity)).buffer(
                radius, quad_segs=32
            )
            for place, velocity, radius in discs
        ]
        observation = Observation(
            time=time, pose=pose, odometry=pose, twist=np.zeros(2), q=np.zeros(7), dq=np.zeros(7), gripper_width=0.08,
            gripper_moving=False, detections=(), scan=scan_of(cast(pose, [*bodies, *walls], rng), pose, time),
        )  # fmt: skip
        world = mapper.update(observation)
        maps.append(tracker.update(mapper.taken, world, pose))
    return maps, tracker


@pytest.mark.parametrize(
    ("start", "velocity"), [((3.0, -1.5), (-0.3, 0.4)), ((2.5, 1.0), (0.1, -0.6)), ((4.5, 0.5), (-1.2, 0.0))]
)
@pytest.mark.parametrize("radius", [0.2, 0.25, 0.3])
def test_a_disc_is_tracked_to_a_few_centimetres(start, velocity, radius):
    maps, _ = follow(2.0, (start, velocity, radius), drive=0.2)
    (row,) = maps[-1].tracks
    at = np.array(start) + maps[-1].stamp * np.array(velocity)
    assert math.dist(row[:2], at) < 0.06
    assert math.dist(row[2:4], velocity) < 0.12
    assert row[RADIUS] == pytest.approx(radius, abs=0.06)
    assert 0.0 < row[SD] < 0.06


def test_two_side_by_side_stay_two():
    """One cluster of cells was one wide thing, and no mover, for as long as they stood beside each other."""
    maps, _ = follow(3.0, ((4.0, 0.45), (-0.5, -0.15), 0.25), ((2.5, -0.45), (0.5, 0.15), 0.25))
    names = [sorted(row[IDENTITY] for row in world.tracks) for world in maps[20:]]
    assert names == [names[0]] * len(names)
    assert len(names[0]) == 2


def test_the_number_survives_being_hidden():
    """Somebody walks behind somebody else who comes nearer."""
    maps, _ = follow(5.0, ((3.5, -1.6), (0.0, 0.6), 0.2), ((2.6, 0.1), (-0.12, 0.0), 0.25))
    seen = [{row[IDENTITY]: row[:2] for row in world.tracks} for world in maps]
    walker = [name for name, place in seen[25].items() if place[1] < -0.4]
    assert len(walker) == 1
    at = np.array([3.5, -1.6 + maps[-1].stamp * 0.6])
    assert math.dist(seen[-1][walker[0]], at) < 0.1


def test_one_that_is_gone_is_forgotten_at_once_where_the_beams_pass():
    maps, tracker = follow(2.0, ((2.0, 0.0), (0.3, 0.0), 0.25))
    assert len(maps[-1].tracks) == 1
    world, mapper, empty = maps[-1], Mapper(FLOOR), np.full(LIDAR.beams, np.inf)
    for k in range(10):
        time = 2.0 + k * STEP
        observation = Observation(
            time=time, pose=np.zeros(3), odometry=np.zeros(3), twist=np.zeros(2), q=np.zeros(7), dq=np.zeros(7),
            gripper_width=0.08, gripper_moving=False, detections=(), scan=scan_of(empty, np.zeros(3), time),
        )  # fmt: skip
        mapper.update(observation)
        world = tracker.update(mapper.taken, world, np.zeros(3))
    assert len(world.tracks) == 0


def test_what_stands_is_no_track_and_what_starts_is_one():
    wall = shapely.box(3.0, -2.0, 3.2, 2.0)
    maps, _ = follow(3.0, ((2.0, 1.0), (0.0, 0.0), 0.25), drive=0.3, walls=(wall,))
    assert all(len(world.tracks) == 0 for world in maps)


@pytest.mark.parametrize("course", [0.0, 0.5 * math.pi, math.pi, -0.5 * math.pi])
def test_who_has_moved_and_stood_for_long_is_seen_to_set_off_within_a_second(course):
    """Its points were those of furniture after 12 s: it was a new track then, 1.2 to 2.1 s after it had set off."""
    sets_off, along = 18.5, np.array([math.cos(course), math.sin(course)])

    def place(time):
        since = max(0.0, time - sets_off)
        way = 0.25 * since**2 if since < 0.8 else 0.16 + 0.4 * (since - 0.8)
        return np.array([1.6, -1.0 + 0.4 * min(time, 2.5)]) + way * along

    maps, _ = follow(sets_off + 1.0, (place, None, 0.25))
    assert not any(len(world.tracks) for world in maps if 16.0 < world.stamp <= sets_off)
    (row,) = maps[-1].tracks
    assert math.dist(row[:2], place(maps[-1].stamp)) < 0.06
    assert row[VX : VY + 1] @ along > 0.2


def test_somebody_who_comes_into_sight_at_speed_counts_at_once():
    """Passive safety has no time to wait until they have left the place where they were seen first."""
    maps, _ = follow(0.3, ((3.0, 0.5), (-1.0, 0.0), 0.25))
    assert len(maps[-1].tracks) == 1


def test_somebody_who_comes_out_from_behind_another_keeps_his_speed():
    """More of him is seen in each scan: his middle moved by as much, and he seemed to stand, or to run."""
    maps, _ = follow(4.0, ((3.4, -0.8), (0.0, 0.4), 0.25), ((2.6, 0.6), (0.0, -0.4), 0.25))
    seen = np.array([np.hypot(row[VX], row[VY]) for world in maps[20:] for row in world.tracks])
    assert len(seen) > 40
    assert seen.min() > 0.2
    assert seen.max() < 0.6


def test_somebody_who_goes_behind_another_stays_as_wide():
    """He is passed by while something nearer hides a part of him; what is not seen of him is there."""
    post = shapely.Point(1.5, 0.0).buffer(0.15)
    maps, _ = follow(2.5, ((3.0, 0.8), (0.0, -0.3), 0.25), walls=(post,))
    assert min(row[RADIUS] for world in maps[20:] for row in world.tracks) > 0.2


def test_a_track_covers_all_points_that_are_seen_of_it():
    """Two who stand close together may be one track, and neither is in its middle."""
    maps, _ = follow(2.0, ((3.0, 0.2), (-0.4, 0.0), 0.2), ((3.2, -0.2), (-0.4, 0.0), 0.2))
    (row,) = maps[-1].tracks
    for x, y in ((2.8, 0.2), (3.0, -0.2)):  # what is nearest of each
        assert math.dist(row[:2], (x - 0.4 * maps[-1].stamp, y)) < row[RADIUS] + 0.01


@pytest.mark.parametrize("speeds", [((-0.3, 0.2), (-0.3, -0.2)), ((0.0, 0.4), (-0.4, 0.0)), ((0.0, 0.5), (0.0, -0.5))])
def test_two_who_were_one_track_are_two_when_they_part(speeds):
    """The one track stayed for both, 1.7 m wide at last; its speed jumped by 0.9 m/s though both drove steadily."""
    together = np.array([-0.4, 0.0])

    def way(start, later):
        return lambda time: np.array(start) + min(time, 1.0) * together + max(time - 1.0, 0.0) * np.array(later)

    ways = [way((3.0, 0.2), speeds[0]), way((3.2, -0.2), speeds[1])]
    maps, _ = follow(3.0, *((one, (0.0, 0.0), 0.2) for one in ways))
    assert [len(world.tracks) for world in maps[20:24]] == [1, 1, 1, 1]
    assert [len(world.tracks) for world in maps[40:]] == [2] * 20
    for world in maps[40:]:
        rows = sorted(world.tracks, key=lambda row: -row[1])
        for row, one, speed in zip(rows, ways, speeds, strict=True):
            assert math.dist(row[:2], one(world.stamp)) < 0.06
            assert math.dist(row[2:4], speed) < 0.12


def test_a_track_on_the_near_side_of_its_points_goes_behind_them():
    """The arc that is seen of somebody fits circles on both sides; who passes over the lidar leaves the wrong one."""

    def mirror(tracker):
        state = tracker.snapshot()
        state.tracks[0].state[0] -= 0.5
        tracker.restore(state)

    maps, _ = follow(1.5, ((3.0, 0.2), (-0.4, 0.0), 0.25), at_one_second=mirror)
    (row,) = maps[-1].tracks
    assert math.dist(row[:2], (3.0 - 0.4 * maps[-1].stamp, 0.2)) < 0.06
    assert math.dist(row[2:4], (-0.4, 0.0)) < 0.12


def test_nobody_is_where_no_scan_has_shown_him_for_long():
    """While no scan came, tracks went on for ever: one was expected 20 m away, and in the way meanwhile."""
    maps, tracker = follow(1.5, ((3.0, -0.8), (-0.4, 0.3), 0.25))
    for late, expected in ((1.9, 1), (2.1, 0), (20.0, 0)):
        later = msgspec.structs.replace(maps[-1], stamp=maps[-1].stamp + late)
        assert len(tracker.update(None, later, np.zeros(3)).tracks) == expected


def test_the_tracker_can_be_copied():
    maps, tracker = follow(1.5, ((3.0, -0.8), (-0.4, 0.3), 0.25))
    other = DynamicTracker(FLOOR)
    other.restore(tracker.snapshot())
    assert state_hash(other.snapshot()) == state_hash(tracker.snapshot())
    assert isinstance(maps[-1], WorldMap)


def test_beams_pass_a_place_only_when_all_near_it_do():
    """The heading may be off by 1.5 deg, and position and range by 8 cm: a box in sight has not left its place."""
    place, first, step, margin = np.array([[2.0, 0.0], [2.0, 0.5]]), -math.pi, math.radians(1.0), 0.08
    look = lambda ranges: passed(place, np.zeros(2), first, step, ranges, margin, 0.025)  # noqa: E731
    ranges = np.full(360, np.inf)
    assert look(ranges) == 2
    ranges[180] = 2.05  # of the beam at 0 deg: the place may still be met there
    assert look(ranges) == 1
    ranges[180] = np.nan  # says nothing
    assert look(ranges) == 1
    ranges[180] = 2.2
    assert look(ranges) == 2
    ranges[183] = 2.0  # 3 deg, 10 cm beside it
    assert look(ranges) == 1
    assert passed(place, np.zeros(2), first, step, np.full(90, np.inf), margin, 0.025) == 0  # out of view
    assert passed(place, np.array([4.0, 0.0]), first, step, np.full(360, np.inf), margin, 0.025) == 2  # across +-pi


@pytest.mark.parametrize(("ranges", "hidden"), [(2.0, False), (0.5, True), (math.nan, True), (math.inf, False)])
def test_beams_that_failed_may_have_ended_before_a_disc(ranges, hidden):
    """Somebody in a sector that had gone blind was forgotten after 0.3 s: failed beams counted as passing by."""
    bearings = np.linspace(-0.5, 0.5, 101)
    directions = np.column_stack([np.cos(bearings), np.sin(bearings)])
    assert is_hidden(np.full(101, ranges), directions, np.array([2.0, 0.0]), 0.25) == hidden


def test_who_waits_out_of_sight_is_still_there():
    """His cells were static as soon as his track was lost, 2 s after somebody had stopped in front of him."""

    def comes(time):
        return np.array([1.5, -1.6 + 0.8 * min(max(0.0, time - 3.0), 2.0)])

    def waits(time):
        return np.array([3.0, -0.6 + 0.4 * min(time, 1.5)])

    maps, tracker = follow(8.0, (waits, None, 0.2), (comes, None, 0.3))
    hidden = [track for track in tracker.snapshot().tracks if math.dist(track.state[:2], (3.0, 0.0)) < 0.2]
    assert len(hidden) == 1 and hidden[0].seen < 5.0
    theirs = np.hypot(*(maps[-1].seen_points - [3.0, 0.0]).T) < 0.3
    assert not maps[-1].seen_static[theirs].any()
    assert np.hypot(*(maps[-1].hidden - [3.2, 0.0]).T).min() < 0.1
    assert all(math.dist(row[:2], (3.0, 0.0)) > 0.5 for row in maps[-1].tracks)
