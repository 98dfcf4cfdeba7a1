"""Bad scans never reach the map."""

import math

import msgspec
import numpy as np
import pytest

from motm_twin.model.profile import Lidar
from motm_twin.perception.mapper import Mapper
from motm_twin.perception.scan import CheckedScan, RefusedScan, check_scan

from .small_world import LIDAR, box, look, observe, scan_of

GOOD = scan_of(np.full(LIDAR.beams, 4.0), np.zeros(3), 1.0)


def altered(**changes):
    return msgspec.structs.replace(GOOD, **changes)


BAD = {
    "nan": altered(ranges=np.where(np.arange(LIDAR.beams) % 8 == 7, np.nan, 4.0)),
    "neighbouring": altered(ranges=np.where(np.arange(LIDAR.beams) // 12 == 20, np.nan, 4.0)),
    "negative": altered(ranges=np.full(LIDAR.beams, -1.0)),
    "360": altered(ranges=np.full(LIDAR.beams - 1, 4.0)),
    "pose": altered(pose=np.array([0.0, np.inf, 0.0])),
    "sensor position": altered(origin=np.zeros(3)),
    "finite": altered(angle_min=np.nan),
    "limits": altered(range_min=3.0, range_max=2.0),
    "angle step": altered(angle_step=1.0),
    "later than now": altered(stamp=2.0),
    "old": altered(stamp=0.2),
}


@pytest.mark.parametrize("word", BAD)
def test_a_bad_scan_is_refused_with_a_reason_and_the_map_is_kept(word, known):
    assert isinstance(check_scan(BAD[word], LIDAR, 1.0), RefusedScan)
    mapper = Mapper(known)
    before = look(mapper, 0.95, [box(1.5, 0.0)])
    after = mapper.update(observe(1.0, BAD[word]))
    assert word in str(mapper.refusal)
    assert after.distance is before.distance
    np.testing.assert_array_equal(after.seen_points, before.seen_points)


def test_a_good_scan_is_checked_and_the_refusal_is_forgotten(known):
    assert isinstance(check_scan(GOOD, LIDAR, 1.0), CheckedScan)
    mapper = Mapper(known)
    mapper.update(observe(1.0, BAD["nan"]))
    mapper.update(observe(1.0, GOOD))
    assert mapper.refusal is None


@pytest.mark.parametrize("value", [np.nan, -1.0])
@pytest.mark.parametrize("wrong", [[7], [3, 90, 200], list(range(0, LIDAR.beams, 40))])
def test_a_few_bad_beams_are_left_out_and_the_others_count(known, value, wrong):
    ranges = np.full(LIDAR.beams, 4.0)
    ranges[wrong] = value
    mapper = Mapper(known)
    mapper.update(observe(1.0, altered(ranges=ranges)))
    assert mapper.refusal is None and mapper.scan_stamp == 1.0


def test_bad_beams_on_both_sides_of_where_a_sweep_all_round_begins_are_neighbours():
    """A blind sector straight behind the base counted as two that were narrow enough."""
    lidar = Lidar(beams=360, field_of_view=math.radians(359.0))
    ranges = np.full(360, 4.0)
    ranges[:5] = ranges[-5:] = np.nan
    scan = altered(ranges=ranges, angle_min=-0.5 * lidar.field_of_view, angle_step=math.radians(1.0))
    assert "neighbouring" in str(check_scan(scan, lidar, 1.0).reason)
    narrow = msgspec.structs.replace(scan, ranges=np.where(np.arange(360) < 5, np.nan, 4.0))
    assert isinstance(check_scan(narrow, lidar, 1.0), CheckedScan)


def test_a_checked_scan_cannot_be_built_by_hand():
    with pytest.raises(TypeError, match="check_scan"):
        CheckedScan(object(), GOOD)


def test_beams_below_the_least_range_say_nothing(known):
    mapper = Mapper(known)
    mapper.update(observe(1.0, altered(ranges=np.full(LIDAR.beams, 0.01))))
    assert mapper.refusal is None
    assert len(mapper.update(observe(1.05)).seen_points) == 0
