"""The reference tour against the published figures and against tours that can be worked out by hand."""

import math

import msgspec
import numpy as np
import pytest

from motm_twin.measures.reference_tour import reference_tour, reference_tour_s
from motm_twin.model.known import KnownWorld
from motm_twin.model.profile import RobotProfile
from motm_twin.model.scene import Box, Cylinder, DriveTo, Pick, SceneObject, Solid
from motm_twin.model.scene_file import load_scene

from .published import TRIALS, world


def mean(reach, margin, boxes=False, exact=False):
    return np.mean([reference_tour_s(world(slots, boxes), reach, margin, exact=exact) for slots in TRIALS])


@pytest.mark.parametrize(("reach", "margin", "seconds"), [(0.80, 0.25, 66.2), (0.70, 0.25, 69.9), (0.75, 0.33, 69.6)])
def test_the_published_means_of_experiment_1_come_out(reach, margin, seconds):
    assert mean(reach, margin) == pytest.approx(seconds, abs=0.06)


def test_the_published_mean_of_experiment_1a_comes_out():
    assert mean(0.75, 0.33, boxes=True) == pytest.approx(75.5, abs=0.1)


@pytest.mark.parametrize(("reach", "margin", "seconds"), [(0.80, 0.25, 58.9), (0.75, 0.33, 61.4)])
def test_the_published_times_of_trial_1_come_out(reach, margin, seconds):
    assert reference_tour_s(world(TRIALS[0]), reach, margin) == pytest.approx(seconds, abs=0.06)


def test_the_exact_tour_is_a_little_shorter_than_the_one_over_36_points():
    difference = mean(0.80, 0.25) - mean(0.80, 0.25, exact=True)
    assert 0.0 < difference < 0.5


def small(tasks, solids=(), objects=(), start=(0.0, 0.0, 0.0)):
    return KnownWorld(
        robot=RobotProfile(), start=start, solids=solids, objects=objects, object_sd=0.0, bins=(), tasks=tasks,
        bounds=(-5.0, -5.0, 5.0, 5.0),
    )  # fmt: skip


def cube(x, y):
    return SceneObject(name="cube", position=(x, y, 0.8))


def test_on_open_floor_the_tour_is_straight_and_ends_at_the_disc():
    scene = small((Pick(object="cube"),), objects=(cube(3.0, 0.0),))
    assert reference_tour_s(scene, 0.8) == pytest.approx(2.2 / 0.5, abs=1e-9)


def test_a_place_in_reach_from_the_start_costs_nothing():
    scene = small((Pick(object="cube"),), objects=(cube(0.5, 0.3),))
    assert reference_tour_s(scene) == 0.0


def test_points_to_drive_to_count_as_discs_of_their_tolerance():
    scene = small((DriveTo(point=(2.0, 0.0), tolerance=0.15), DriveTo(point=(0.0, 0.0), tolerance=0.15)))
    assert reference_tour(scene)[0] == pytest.approx([1.85, 1.70], abs=1e-6)
    assert reference_tour_s(scene) == pytest.approx((1.85 + 1.70) / 0.5, abs=1e-6)


def test_the_way_round_a_disc_is_tangent_arc_tangent():
    pillar = Solid(name="p", shape=Cylinder(centre=(2.0, 0.0), radius=0.5), z_min=0.0, z_max=1.0, mapped=True)
    scene = small((DriveTo(point=(4.0, 0.0), tolerance=1e-6),), solids=(pillar,))
    r, d = 0.75, 2.0
    exact = 2.0 * math.sqrt(d * d - r * r) + r * (math.pi - 2.0 * math.acos(r / d))
    assert reference_tour_s(scene, exact=True) * 0.5 == pytest.approx(exact, abs=2e-3)


def test_a_place_walled_in_on_all_sides_is_infinitely_far():
    walls = tuple(
        Solid(name=f"w{i}", shape=Box(centre=c, size=s), z_min=0.0, z_max=1.0, mapped=False)
        for i, (c, s) in enumerate(
            [((3, 1.5), (3.2, 0.1)), ((3, -1.5), (3.2, 0.1)), ((1.5, 0), (0.1, 3.2)), ((4.5, 0), (0.1, 3.2))]
        )
    )
    scene = small((DriveTo(point=(3.0, 0.0)),), solids=walls)
    assert reference_tour_s(scene) == math.inf
    assert reference_tour(scene)[0].tolist() == [math.inf]


def test_every_touched_point_is_in_its_disc_and_outside_the_furniture():
    legs, touched = reference_tour(world(TRIALS[1], boxes=True), exact=True)
    assert (len(legs), len(touched)) == (12, 13)
    assert (legs > np.hypot(*np.diff(touched, axis=0).T) - 1e-9).all()


def test_a_start_inside_the_grown_furniture_is_moved_out_first():
    scene = msgspec.structs.replace(world(TRIALS[0]), start=(3.5, 1.2, 0.0))
    assert math.isfinite(reference_tour_s(scene))


def test_the_shipped_scene_has_the_published_tour():
    times = [reference_tour_s(load_scene("exp1", f"trial{number}")) for number in range(1, 11)]
    assert np.mean(times) == pytest.approx(66.2, abs=0.06)
    assert times[0] == pytest.approx(58.9, abs=0.06)


def test_boxes_that_the_map_does_not_know_count_as_furniture_in_experiment_1a():
    times = [reference_tour_s(load_scene("exp1a", f"trial{number}"), 0.75, 0.33) for number in range(1, 11)]
    assert np.mean(times) == pytest.approx(75.5, abs=0.1)
