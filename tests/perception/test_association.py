"""Detections without a name get that of their object; a false one moves nothing, a missed one loses nothing."""

import msgspec
import numpy as np
import pytest

from motm_twin.model.plant import Detection
from motm_twin.perception.association import (
    MOST_CANDIDATES,
    AssociationSettings,
    AssociationState,
    Places,
    disproved,
    missed,
    names_of,
    unexplained,
)

SETTINGS = AssociationSettings()
A, B = np.array([1.0, 0.0, 0.8]), np.array([1.0, 0.3, 0.8])
SEEN, NEVER = 0.003, 0.05  # [m] sd of what is believed
PERIOD = 0.05


class Sight:
    """Objects that are believed somewhere, and a camera that looks everywhere unless it is told otherwise."""

    def __init__(self, sd=SEEN, hidden=(), bins=(), **places):
        self.at, self.sd, self.hidden, self.bins = places, sd, hidden, bins

    def places(self):
        count = len(self.at)
        return Places(
            names=tuple(self.at), positions=np.array(list(self.at.values())).reshape(-1, 3),
            variances=np.full(count, self.sd**2), seen=np.full(count, self.sd < NEVER), gate=4.0,
            gate_floor=0.01, agreeing=3,
        )  # fmt: skip

    def in_view(self, point):
        return not any(np.array_equal(point, place) for place in self.hidden)

    def in_bin(self, point):
        return any(np.abs(point - place).max() < 0.2 for place in self.bins)


def picture(stamp, *places, sd=0.003):
    return tuple(
        Detection(
            stamp=stamp, name="", p_base=np.array(at), yaw_base=0.0, position_sd=sd, odometry=np.zeros(3)
        )
        for at in places
    )  # fmt: skip


class Camera:
    """Pictures one after the other."""

    def __init__(self, sight):
        self.sight, self.state, self.now = sight, AssociationState(), 0.0

    def shows(self, *places, times=1, held=None):
        names = ()
        for _ in range(times):
            self.now += PERIOD
            names = names_of(self.state, picture(self.now, *places), self.now, held, self.sight, SETTINGS)
        return names


def test_each_detection_is_of_the_object_that_is_believed_there_in_whatever_order():
    camera = Camera(Sight(a=A, b=B))
    assert camera.shows(B + 0.004, A - 0.004) == ("b", "a")
    assert camera.shows(A) == ("a",)


def test_objects_that_stand_near_each_other_are_matched_together_and_not_one_after_the_other():
    """Both are seen 3 cm to the left: nearest first would take b's detection for a's."""
    near = A + np.array([0.0, 0.05, 0.0])
    camera = Camera(Sight(sd=0.02, a=A, b=near))
    left = np.array([0.0, 0.03, 0.0])
    assert camera.shows(A + left, near + left, times=2) == ("a", "b")


def test_the_same_picture_is_gone_through_once():
    camera = Camera(Sight(a=A))
    camera.shows(A + 0.5)
    for _ in range(5):
        again = picture(camera.now, A + 0.5)
        assert names_of(camera.state, again, camera.now, None, camera.sight, SETTINGS) == ("",)
    assert [one.count for one in camera.state.candidates] == [1]


def test_one_detection_is_too_little_for_an_object_that_is_believed_there_vaguely():
    camera = Camera(Sight(sd=0.03, a=A))
    assert camera.shows(A + 0.08) == ("",)
    assert camera.shows(A - 0.05) == ("",)
    assert camera.shows(A - 0.05) == ("a",)


def test_something_that_is_detected_once_is_nothing_even_while_an_object_is_missed():
    camera = Camera(Sight(a=A))
    camera.shows(A, times=5)
    assert camera.shows(A + 0.4) == ("",)
    assert camera.shows(A + np.array([0.0, 0.5, 0.0])) == ("",)
    assert camera.shows(A) == ("a",)


def test_what_is_detected_again_and_again_is_the_object_that_is_missing():
    camera = Camera(Sight(a=A, b=B))
    camera.shows(A, B, times=3)
    moved = A + np.array([0.4, 0.0, 0.0])
    names = [camera.shows(moved, B)[0] for _ in range(8)]
    assert names[:2] == ["", ""] and names[-1] == "a"
    assert not unexplained(camera.state, camera.sight)


def test_nothing_is_missing_where_the_camera_does_not_look():
    camera = Camera(Sight(a=A, hidden=(A,)))
    assert camera.shows(A + 0.4, times=20) == ("",)
    assert unexplained(camera.state, camera.sight)


@pytest.mark.parametrize(("looked", "name"), [(50, "a"), (3, "")])
def test_what_was_not_where_it_was_believed_is_what_is_found_beside_it_though_that_is_out_of_view(looked, name):
    """A cube put 0.3 m aside was seen there, and left out as unknown: its old place was not in that picture."""
    camera = Camera(Sight(a=A))
    camera.shows(times=looked)
    assert disproved(camera.state, camera.now, SETTINGS) == (("a",) if name else ())
    camera.sight.hidden = (A,)
    assert camera.shows(A + np.array([0.3, 0.0, 0.0]), times=5) == (name,)
    assert camera.state.lost == []


def test_what_is_seen_while_an_object_begins_to_be_missing_is_not_called_unknown():
    camera = Camera(Sight(a=A, hidden=(A,)))
    camera.shows(A + 0.4, times=4)
    assert unexplained(camera.state, camera.sight)
    camera.sight.hidden = ()
    camera.shows(A + 0.4)
    assert not unexplained(camera.state, camera.sight)


def test_a_second_one_like_an_object_that_is_where_it_should_be_is_told_of_and_left_out():
    camera = Camera(Sight(a=A))
    assert camera.shows(A, A + 0.3, times=10) == ("a", "")
    assert unexplained(camera.state, camera.sight)


def test_an_object_that_a_finger_has_pushed_is_known_in_the_next_picture():
    camera = Camera(Sight(a=A, b=B, hidden=(A, B)))
    camera.shows(A, B, times=3)
    assert camera.shows(A + np.array([0.05, 0.0, 0.0]), B) == ("a", "b")


def test_a_held_object_is_never_what_is_detected():
    camera = Camera(Sight(a=A))
    assert camera.shows(A, times=10, held="a") == ("",)


def test_an_object_that_was_never_seen_is_believed_when_it_is_detected_twice():
    camera = Camera(Sight(sd=NEVER, a=A))
    assert [camera.shows(A + 0.05)[0] for _ in range(2)] == ["", "a"]
    camera = Camera(Sight(sd=NEVER, a=A))
    camera.shows(A + 0.05)
    assert camera.shows(A - 0.1) == ("",)


def test_which_of_two_that_were_never_seen_it_is_stays_open_until_the_other_ones_place_is_in_view():
    middle = 0.5 * (A + A + np.array([0.0, 0.1, 0.0]))
    near = A + np.array([0.0, 0.1, 0.0])
    camera = Camera(Sight(sd=NEVER, a=A, b=near, hidden=(near,)))
    assert camera.shows(middle, times=10) == ("",)
    camera = Camera(Sight(sd=NEVER, a=A, b=near))
    assert camera.shows(middle - np.array([0.0, 0.01, 0.0]), times=10) == ("a",)


def test_a_picture_of_one_of_two_is_not_of_the_other_because_its_place_looks_empty():
    """The other one came into view two pictures later, when each had the name of the other."""
    shift, mate = np.array([-0.04, 0.0, 0.0]), A + np.array([0.08, 0.0, 0.0])
    camera = Camera(Sight(sd=NEVER, a=A, b=mate, hidden=(A,)))
    assert camera.shows(mate + shift - np.array([0.001, 0.0, 0.0]), times=2) == ("",)
    pictures = [camera.shows(A + shift, mate + shift) for _ in range(4)]
    assert {first for first, _ in pictures} == {"", "a"}
    assert {second for _, second in pictures} == {"", "b"}


def test_of_two_side_by_side_the_one_that_is_named_first_does_not_take_the_other_s_picture():
    """Seen 4 cm apart, with errors of 3 cm; one had a name, and the next picture fitted as well the other way round."""
    first, second = np.array([0.0, 0.0, 0.67]), np.array([0.04, 0.0, 0.68])
    sight = Sight(sd=NEVER, a=np.array([0.015, 0.015, 0.67]), b=np.array([0.07, 0.035, 0.68]))
    state = AssociationState()
    names_of(state, picture(0.05, first - [0.03, -0.02, 0.0], sd=0.013), 0.05, None, sight, SETTINGS)
    assert names_of(state, picture(0.1, first, second, sd=0.013), 0.1, None, sight, SETTINGS) == ("a", "")
    places = sight.places()
    positions, variances = np.array([first, places.positions[1]]), np.array([0.012**2, places.variances[1]])
    known = msgspec.structs.replace(places, positions=positions, variances=variances, seen=np.array([True, False]))
    sight.places = lambda: known
    found = picture(0.15, np.array([-0.017, 0.011, 0.7]), np.array([0.02, -0.009, 0.676]), sd=0.013)
    assert names_of(state, found, 0.15, None, sight, SETTINGS) == ("", "b")


def test_a_false_detection_does_not_take_the_object_of_one_that_came_before():
    """The cube in the middle was named as its neighbour, which was not in view yet, for as long as the run took."""
    middle, west = np.array([2.1, 1.07, 0.87]), np.array([2.0, 1.07, 0.87])
    sight = Sight(sd=NEVER, a=middle - [0.01, 0.0, 0.0], b=west - [0.01, 0.0, 0.0])
    sight.hidden = (sight.at["b"],)
    camera = Camera(sight)
    camera.shows(middle)
    assert camera.shows(middle, middle + np.array([0.03, -0.03, 0.04])) == ("", "")
    assert camera.shows(middle) == ("",)  # it may be the other one, the place of which is not in view


def test_what_comes_into_view_later_may_be_what_the_others_are_taken_for():
    """Of three in a row the third came a picture later, and got the name that was left."""
    there = [np.array([x, 0.0, 0.87]) for x in (0.0, 0.1, 0.2)]
    off = np.array([[0.03, 0.0, 0.0], [0.03, -0.04, 0.0], [-0.07, 0.07, 0.0]])
    camera = Camera(Sight(sd=NEVER, **dict(zip("abc", there + off, strict=True))))
    assert "a" not in camera.shows(*there[1:], times=3)
    camera.shows(*there)
    assert camera.shows(*there) == ("a", "b", "c")


def test_what_the_fingers_missed_twice_at_one_place_is_the_other_one_beside_it():
    """A smaller cube 11 cm away had been taken for what was wanted: the fingers closed on it in vain, ten times."""
    beside = A + np.array([0.0, 0.11, 0.0])
    camera = Camera(Sight(a=A, b=beside))
    assert camera.shows(A, beside) == ("a", "b")
    assert missed(camera.state, "a", A, camera.sight.places(), SETTINGS) == ""
    assert missed(camera.state, "a", A + 0.005, camera.sight.places(), SETTINGS) == "b"
    camera.sight = Sight(a=beside, b=A)  # as the tracker has exchanged them
    assert camera.shows(A, beside, times=3) == ("b", "a")
    camera.sight = Sight(a=A, b=beside)
    assert camera.shows(A, beside)[0] != "a", "it is never taken for that again"


@pytest.mark.parametrize("apart", [0.05, 0.4])
def test_what_slips_from_the_fingers_is_not_another_object(apart):
    """It lies elsewhere the second time, or nothing else is near."""
    camera = Camera(Sight(a=A, b=A + np.array([0.0, apart, 0.0])))
    camera.shows(A, A + np.array([0.0, apart, 0.0]))
    again = A if apart > SETTINGS.pushed else A + np.array([0.04, 0.0, 0.0])
    for place in (A, again):
        assert missed(camera.state, "a", place, camera.sight.places(), SETTINGS) == ""
    assert camera.state.denied == []


def test_what_lies_in_a_bin_is_what_was_dropped_there_first():
    bin_at = np.array([2.0, 2.0, 0.66])
    camera = Camera(Sight(a=A, b=bin_at, bins=(bin_at,)))
    camera.shows(A, bin_at, times=2)
    rolled = bin_at + np.array([0.18, 0.1, 0.0])
    assert camera.shows(A, rolled, times=4) == ("a", "b")


@pytest.mark.parametrize("count", [0, 60])
def test_a_picture_may_have_nothing_or_many_things_in_it(count):
    camera = Camera(Sight(a=A))
    places = [A + np.array([0.0, 0.0, 1.0 + k]) for k in range(count)]
    assert camera.shows(*places, times=4) == ("a", *[""] * (count - 1))[:count]  # `a` is missing: the nearest is it
    assert len(camera.state.candidates) <= MOST_CANDIDATES
