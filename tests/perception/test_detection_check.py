"""Detections that cannot be are left out and named; those that can are kept."""

import math

import msgspec
import numpy as np
import pytest

from motm_twin.model.geometry import to_frame
from motm_twin.model.known import KnownWorld
from motm_twin.model.plant import Detection, Observation
from motm_twin.model.profile import READY, RobotProfile
from motm_twin.model.scene import Bin, Box, Cylinder, Solid
from motm_twin.perception.detection_check import (
    DetectionSettings,
    DetectionState,
    Screens,
    _screened,
    checked,
    findings,
    lens,
)

PROFILE, SETTINGS = RobotProfile(), DetectionSettings()
EYE, AXIS = lens(READY, PROFILE)
BELOW = EYE + 0.5 * AXIS  # what the camera looks at


class Beliefs:
    def __init__(self, places, sd=0.005):
        self.places, self.sd = places, sd

    def get(self, name):
        return (self.places[name], self.sd) if name in self.places else None

    def other_at(self, name, point, within):
        near = (other for other, place in self.places.items() if other != name and math.dist(place, point) < within)
        return next(near, "")

    def in_bin(self, point):
        return False

    def screened(self, point):
        return False


def report(name, place, stamp=1.0):
    return Detection(
        stamp=stamp, name=name, p_base=np.array(place, dtype=float), yaw_base=0.0, position_sd=0.005,
        odometry=np.zeros(3),
    )  # fmt: skip


def seen(*detections, time=1.0):
    return Observation(
        time=time, pose=np.zeros(3), odometry=np.zeros(3), twist=np.zeros(2), q=READY, dq=np.zeros(7),
        gripper_width=0.08, gripper_moving=False, scan=None, detections=detections,
    )  # fmt: skip


def judge(now, beliefs, state=None, held=None):
    state = state or DetectionState()
    kept = checked(state, now, beliefs, held, PROFILE, SETTINGS)
    found = findings(state, now, beliefs, held, PROFILE, SETTINGS)
    return [one.name for one in kept], [one.kind for one in found]


@pytest.mark.parametrize(("z", "screened"), [(0.05, True), (0.6, False)])
def test_the_wall_of_a_bin_hides_what_lies_in_it(z, screened):
    """Whenever a cube had been let go into a deep bin, the camera was said to have lost it."""
    place = Bin(name="tub", centre=(1.0, 0.0), side=0.4, floor_z=0.0, rim_z=0.6)
    known = KnownWorld(
        robot=PROFILE, start=(0.0, 0.0, 0.0), solids=(), objects=(), object_sd=0.03, bins=(place,), tasks=(),
        bounds=(-2.0, -2.0, 2.0, 2.0),
    )  # fmt: skip
    eye, point = np.array([0.4, 0.0, 0.9]), np.array([1.0, 0.0, z])
    assert _screened(eye, point, SETTINGS.above, *Screens.of(known)) == screened


@pytest.mark.parametrize(
    ("name", "shape", "low", "high", "screened"),
    [
        ("box", Box(centre=(0.5, 0.0), size=(0.1, 0.4)), 0.7, 0.9, True),
        ("can", Cylinder(centre=(0.6, 0.06), radius=0.03), 0.7, 0.9, True),  # an edge
        ("low", Box(centre=(0.5, 0.0), size=(0.1, 0.4)), 0.7, 0.72, False),
        ("table", Box(centre=(0.5, 0.0), size=(2.0, 2.0)), 0.67, 0.7, False),
        ("lamp", Box(centre=(0.5, 0.0), size=(0.1, 0.4)), 1.1, 1.2, False),
        ("aside", Box(centre=(0.5, 0.3), size=(0.1, 0.1)), 0.7, 1.9, False),
    ],
)
def test_mapped_furniture_between_camera_and_object_hides_it(name, shape, low, high, screened):
    """A cube behind a box was said to be lost although in view."""
    solid = Solid(name=name, shape=shape, z_min=low, z_max=high, mapped=True)
    known = KnownWorld(
        robot=PROFILE, start=(0.0, 0.0, 0.0), solids=(solid,), objects=(), object_sd=0.03, bins=(), tasks=(),
        bounds=(-3.0, -3.0, 3.0, 3.0),
    )  # fmt: skip
    eye, point = np.array([0.0, 0.0, 1.0]), np.array([0.8, 0.0, 0.72])
    assert _screened(eye, point, SETTINGS.above, *Screens.of(known)) == screened


def test_a_detection_in_view_is_kept_as_it_is():
    now = seen(report("a", BELOW))
    state = DetectionState()
    assert checked(state, now, Beliefs({"a": BELOW}), None, PROFILE, SETTINGS) is now.detections
    assert findings(state, now, Beliefs({"a": BELOW}), None, PROFILE, SETTINGS) == []


@pytest.mark.parametrize("place", [EYE - 0.5 * AXIS, EYE + 2.0 * AXIS, BELOW + np.array([1.0, 0.0, 0.0])])
def test_an_object_where_the_camera_cannot_look_is_a_ghost(place):
    assert judge(seen(report("a", place)), Beliefs({"a": BELOW})) == ([], ["camera_ghost"])


def test_of_an_object_that_is_reported_twice_the_believed_one_is_kept():
    now = seen(report("a", BELOW + np.array([0.0, 0.2, 0.0])), report("a", BELOW))
    state = DetectionState()
    (kept,) = checked(state, now, Beliefs({"a": BELOW}), None, PROFILE, SETTINGS)
    np.testing.assert_array_equal(kept.p_base, BELOW)


def test_an_object_at_another_ones_place_is_swapped_and_a_moved_one_is_not():
    there = BELOW + np.array([0.0, 0.2, 0.0])
    beliefs = Beliefs({"a": BELOW, "b": there})
    assert judge(seen(report("a", there)), beliefs) == ([], ["camera_swap"])
    assert judge(seen(report("a", BELOW + np.array([0.0, -0.2, 0.0]))), beliefs)[0] == ["a"]
    assert judge(seen(report("a", there)), beliefs, held="a")[0] == ["a"]


def test_objects_that_are_swapped_again_after_a_while_are_not_believed():
    """Swapped 20 s before and not seen since, it was believed where the other one stands, 1.1 m from its place."""
    there, state = BELOW + np.array([0.0, 0.2, 0.0]), DetectionState()
    beliefs = Beliefs({"a": BELOW, "b": there})
    for stamp in (1.0, 21.0, 21.05):
        assert checked(state, seen(report("a", there, stamp), time=stamp), beliefs, None, PROFILE, SETTINGS) == ()


def test_three_objects_whose_names_go_round_are_swapped():
    """None of two is at the other's place, which was taken for a robot that errs."""
    places = [BELOW, BELOW + np.array([0.0, 0.2, 0.0]), BELOW + np.array([0.2, 0.0, 0.0])]
    beliefs = Beliefs(dict(zip("abc", places, strict=True)))
    now = seen(report("a", places[1]), report("b", places[2]), report("c", places[0]))
    assert judge(now, beliefs) == ([], ["camera_swap"])


def test_objects_that_somebody_has_really_swapped_are_believed_after_a_while():
    beliefs, state = Beliefs({"a": BELOW, "b": BELOW + np.array([0.0, 0.2, 0.0])}), DetectionState()
    kept = []
    for k in range(300):
        now = seen(report("a", BELOW + np.array([0.0, 0.2, 0.0]), stamp=0.05 * k), time=0.05 * k)
        kept.append(len(checked(state, now, beliefs, None, PROFILE, SETTINGS)))
    assert kept[100] == 0 and kept[-1] == 1


def test_when_the_robot_errs_all_objects_are_elsewhere_and_none_is_swapped():
    shift = np.array([0.0, 0.15, 0.0])
    beliefs = Beliefs({"a": BELOW, "b": BELOW + shift})
    now = seen(report("a", BELOW + shift), report("b", BELOW + 2.0 * shift))
    assert judge(now, beliefs)[0] == ["a", "b"]


def frames(state, beliefs, reports, count, begin, held=None):
    found = []
    for k in range(count):
        time = begin + 0.05 * k
        now = seen(*(msgspec.structs.replace(one, stamp=time) for one in reports), time=time)
        checked(state, now, beliefs, held, PROFILE, SETTINGS)
        found.append([one.kind for one in findings(state, now, beliefs, held, PROFILE, SETTINGS)])
    return found


def test_an_object_that_is_in_view_and_no_longer_reported_is_missed_until_it_is_again():
    beliefs, state = Beliefs({"a": BELOW}), DetectionState()
    assert frames(state, beliefs, [report("a", BELOW)], 10, 0.0) == [[]] * 10
    lost = frames(state, beliefs, [], 20, 0.5)
    assert lost[4] == [] and lost[-1] == ["camera_lost"]
    assert frames(state, beliefs, [report("a", BELOW)], 3, 1.5) == [[]] * 3


def test_what_is_held_or_out_of_view_is_not_missed():
    state = DetectionState()
    frames(state, Beliefs({"a": BELOW}), [report("a", BELOW)], 5, 0.0)
    assert frames(state, Beliefs({"a": BELOW}), [], 20, 0.25, held="a")[-1] == []
    away = Beliefs({"a": EYE + np.array([0.0, 0.9, -0.4])})
    frames(state, Beliefs({"a": BELOW}), [report("a", BELOW)], 5, 2.0)
    assert frames(state, away, [], 20, 2.25)[-1] == []


@pytest.mark.parametrize(("age", "kinds"), [(0.1, []), (0.28, []), (0.4, ["camera_late"])])
def test_old_detections_are_told(age, kinds):
    assert judge(seen(report("a", BELOW, stamp=1.0 - age)), Beliefs({"a": BELOW}))[1] == kinds


def pictures(state, stamps):
    """Kinds found in periods with no detection, given the stamp of the newest picture in each."""
    found = []
    for k, stamp in enumerate(stamps):
        now = msgspec.structs.replace(seen(time=0.05 * k), camera_stamp=stamp)
        found.append(judge(now, Beliefs({}), state)[1])
    return found


def test_a_camera_that_sends_no_pictures_is_told_though_nothing_could_be_seen():
    """While the hand was over its cube, 11 of 72 cameras that were off were not noticed."""
    stamps = [0.0, 0.05, 0.1, *[0.1] * 20, 1.15]
    found = pictures(DetectionState(), stamps)
    assert found[:8] == [[]] * 8 and found[9:-1] == [["camera_late"]] * 14 and found[-1] == []
    assert pictures(DetectionState(), [None] * 24) == [[]] * 24  # a robot that does not tell


def test_without_pictures_no_object_is_seen_to_be_gone():
    state = DetectionState()
    pictures(state, [0.05 * k for k in range(5)])
    state.association.absent["a"] = 0.1
    pictures(state, [0.2] * 60)
    assert state.association.absent == {}


def test_the_frame_of_a_turned_robot_makes_no_difference():
    odometry = np.array([1.0, 2.0, 0.7])
    now = msgspec.structs.replace(
        seen(msgspec.structs.replace(report("a", BELOW), odometry=odometry)), odometry=odometry
    )
    place = to_frame(np.array([0.0, 0.0, 0.0]), BELOW)
    c, s = math.cos(0.7), math.sin(0.7)
    world = np.array([1.0 + c * place[0] - s * place[1], 2.0 + s * place[0] + c * place[1], place[2]])
    assert judge(now, Beliefs({"a": world})) == (["a"], [])
