"""What is believed of an object."""

import math

import msgspec
import numpy as np
import pytest

from motm_twin.model.geometry import compose, from_frame, inverse, to_frame
from motm_twin.model.plant import Detection
from motm_twin.model.scene import SceneObject
from motm_twin.model.state import state_hash
from motm_twin.perception.objects import ObjectTracker

from .small_world import observe

TRUE = np.array([2.23, 1.17, 0.80])  # odometry frame
NOW = observe(9.0)


@pytest.fixture
def tracker(known):
    return ObjectTracker(known)


def detection(stamp, at=TRUE, sd=0.005, yaw=0.1, odometry=(0.3, 0.2, 0.4), name="cube"):
    odometry = np.array(odometry)
    return Detection(
        stamp=stamp, name=name, p_base=to_frame(odometry, np.array(at)), yaw_base=yaw - odometry[2], position_sd=sd,
        odometry=odometry,
    )  # fmt: skip


def feed(tracker, time, **changes):
    tracker.update(observe(time, detections=(detection(time, **changes),)))


def test_before_it_is_seen_an_object_is_where_the_prior_says_through_the_present_localisation(tracker):
    pose, odometry = np.array([1.0, 0.5, 0.3]), np.array([0.9, 0.6, 0.25])
    position, yaw, sd, last_seen = tracker.belief("cube", observe(0.0, pose=pose, odometry=odometry))
    T_odom_world = compose(odometry, inverse(pose))
    np.testing.assert_allclose(position, from_frame(T_odom_world, np.array([2.2, 1.2, 0.8])), atol=1e-12)
    assert yaw == pytest.approx(0.1 - 0.05)
    assert (sd, last_seen) == (0.03, None)
    world = tracker.world_position("cube", observe(0.0, pose=pose, odometry=odometry))
    np.testing.assert_allclose(world, [2.2, 1.2, 0.8])


TWO = np.array([[2.549, 1.475, 0.80], [2.684, 1.416, 0.80]])  # priors of a and b
HERE = np.array([[2.62, 1.40, 0.80], [2.685, 1.40, 0.80]])  # a and b


@pytest.fixture
def pair(known):
    """Believes two cubes, of which b is the nearer one to where a is."""
    priors = tuple(SceneObject(name=name, position=tuple(at), yaw=0.0) for name, at in zip("ab", TWO, strict=True))
    return ObjectTracker(msgspec.structs.replace(known, objects=priors, object_sd=0.03))


@pytest.mark.parametrize(("moved", "right"), [(False, True), (True, False)])
def test_two_that_were_named_the_wrong_way_round_are_exchanged_when_both_are_seen(pair, moved, right):
    """The first in view took the name of the nearer prior; the other one went into its bin."""
    for k, (name, at) in enumerate([("b", HERE[0]), ("a", HERE[1])]):
        feed(pair, 0.1 * k, name=name, at=at)
        if moved and name == "b":
            pair.move_belief("b", HERE[0], NOW, 0.005)
        pair.reconsider(NOW, None)
    seen = HERE if right else HERE[::-1]
    for name, at in zip("ab", seen, strict=True):
        np.testing.assert_allclose(pair.belief(name, NOW)[0], at, atol=0.006)


@pytest.mark.parametrize("turn", [0.0, math.pi / 4])
def test_a_neighbour_that_was_not_seen_yet_is_one_however_odometry_is_turned(known, turn):
    """In a corner of the square about a cube it was left out when odometry was turned against the world."""
    odometry = np.array([0.0, 0.0, turn])
    first, corner = np.array([2.0, 0.0]), np.array([0.09, 0.09])  # the second is that far along the axes of odometry
    second = first + to_frame(odometry, corner)
    priors = tuple(
        SceneObject(name=name, position=(*place.tolist(), 0.8), yaw=0.0)
        for name, place in zip("ab", (first, second), strict=True)
    )
    tracker = ObjectTracker(msgspec.structs.replace(known, objects=priors))
    assert tracker.beside("a", 0.1, observe(0.0, pose=np.zeros(3), odometry=odometry))[0] == ("b",)


def test_what_was_carried_away_with_its_furniture_is_not_exchanged_for_where_it_stood(pair):
    feed(pair, 0.0, name="b", at=HERE[0])
    pair.carry(lambda at: True, np.array([0.0, 0.0, 0.0]), NOW, held="", before=1.0)
    feed(pair, 0.1, name="a", at=HERE[1])
    pair.reconsider(NOW, None)
    np.testing.assert_allclose(pair.belief("b", NOW)[0], HERE[0], atol=0.006)


def test_two_that_were_named_the_right_way_round_stay(pair):
    for name, at in zip("ab", HERE, strict=True):
        feed(pair, 0.1, name=name, at=at)
    for held in (None, "a"):
        pair.reconsider(NOW, held)
    np.testing.assert_allclose(pair.belief("a", NOW)[0], HERE[0], atol=0.006)


def test_detections_bring_the_belief_to_the_true_place_from_any_base_pose(tracker):
    rng = np.random.default_rng(1)
    for k in range(40):
        odometry = (0.3 + 0.02 * k, 0.2, 0.4 - 0.01 * k)
        feed(tracker, 0.05 * k, at=TRUE + rng.normal(0, 0.005, 3), odometry=odometry)
    position, _, sd, last_seen = tracker.belief("cube", NOW)
    assert np.abs(position - TRUE).max() < 0.006
    assert sd < 0.004
    assert last_seen == pytest.approx(1.95)


@pytest.mark.parametrize(("seconds", "off"), [(1.0, 0.0), (20.0, 0.03)])
def test_a_place_is_kept_by_odometry_at_first_and_by_localisation_while_wheels_turn_2_percent_too_much(
    tracker, seconds, off
):
    """After a turn by 180 deg odometry has what stands 2 m away 13 cm from where it is."""
    rng, start, yaw = np.random.default_rng(2), np.array([0.3, 0.2, 0.4]), np.array([0.0, 0.0, 1.0])
    for k in range(10):
        pose = start + rng.normal(0.0, 0.005, 3)
        at = detection(0.05 * k, odometry=start)
        tracker.update(observe(0.05 * k, pose=pose, odometry=start, detections=(at,)))
    before = tracker.belief("cube", NOW)[0]
    for k in range(10, round(20.0 * seconds)):
        turn = math.pi * min(1.0, 0.05 * k / 10.0)
        pose = start + turn * yaw + rng.normal(0.0, 0.005, 3)
        odometry = start + 1.02 * turn * yaw
        tracker.update(observe(0.05 * k, pose=pose, odometry=odometry))
    T_odom_world = compose(odometry, inverse(start + turn * yaw))
    there = from_frame(T_odom_world, TRUE) if off else before
    assert math.dist(tracker.belief("cube", NOW)[0], there) <= off


def test_one_outlier_changes_nothing(tracker):
    for k in range(10):
        feed(tracker, 0.05 * k)
    before = tracker.belief("cube", NOW)[0]
    feed(tracker, 0.5, at=TRUE + np.array([0.5, 0, 0]))
    np.testing.assert_array_equal(tracker.belief("cube", NOW)[0], before)


def test_outliers_that_disagree_with_each_other_never_move_the_belief(tracker):
    feed(tracker, 0.0)
    before = tracker.belief("cube", NOW)[0]
    for k in range(1, 9):
        feed(tracker, 0.05 * k, at=TRUE + np.array([0.3 * k, 0, 0]))
    np.testing.assert_array_equal(tracker.belief("cube", NOW)[0], before)


def test_three_detections_at_another_place_mean_that_the_object_was_moved(tracker):
    for k in range(10):
        feed(tracker, 0.05 * k)
    moved = TRUE + np.array([0.4, -0.1, 0.0])
    for k in range(10, 13):
        feed(tracker, 0.05 * k, at=moved)
    np.testing.assert_allclose(tracker.belief("cube", NOW)[0], moved, atol=1e-6)


def test_the_same_detection_is_counted_once(tracker):
    one = detection(0.0, at=TRUE + np.array([0.3, 0.3, 0.0]))
    for k in range(5):
        tracker.update(observe(0.05 * k, detections=(one,)))
    assert tracker.belief("cube", NOW)[0] == pytest.approx([2.2, 1.2, 0.8])


def test_yaw_never_flips_by_90_degrees(tracker):
    rng = np.random.default_rng(4)
    yaws = []
    for k in range(60):
        feed(tracker, 0.05 * k, yaw=0.76 + rng.integers(4) * math.pi / 2 + rng.normal(0, 0.05))
        yaws.append(tracker.belief("cube", NOW)[1])
    assert np.abs(np.diff(yaws)).max() < 0.1
    assert abs(math.remainder(yaws[-1] - 0.76, math.pi / 2)) < 0.08


def test_a_held_object_is_not_tracked_and_one_put_down_is_believed_there(tracker):
    feed(tracker, 0.0)
    before = tracker.belief("cube", NOW)[0]
    tracker.update(observe(0.05, detections=(detection(0.05, at=TRUE + np.array([0.02, 0, 0])),)), held="cube")
    np.testing.assert_array_equal(tracker.belief("cube", NOW)[0], before)
    tracker.move_belief("cube", np.array([1.0, 1.0, 0.7]), NOW, 0.02)
    np.testing.assert_array_equal(tracker.belief("cube", NOW)[0], [1.0, 1.0, 0.7])


def test_numbers_that_are_not_finite_are_ignored(tracker):
    feed(tracker, 0.0, at=[np.nan, 0.0, 0.0])
    assert tracker.belief("cube", NOW)[3] is None


def test_an_unknown_object_is_refused_with_the_names_that_exist(tracker):
    with pytest.raises(KeyError, match="cube"):
        tracker.belief("ball", NOW)


def test_state_can_be_copied_and_hashed(tracker):
    feed(tracker, 0.0)
    saved, before = tracker.snapshot(), state_hash(tracker.snapshot())
    feed(tracker, 0.05)
    assert state_hash(tracker.snapshot()) != before
    tracker.restore(saved)
    assert state_hash(tracker.snapshot()) == before
