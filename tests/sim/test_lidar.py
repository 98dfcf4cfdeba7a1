import math

import numpy as np
import pytest
from shapely.geometry import LineString, Point, Polygon
from shapely.ops import unary_union
from sim_scenes import box, furniture, scene, table

from motm_twin.model.profile import Lidar, RobotProfile
from motm_twin.model.scene import Agent, Cylinder, Noise, Prism, Solid
from motm_twin.sim.plant import SimulatedPlant
from motm_twin.sim.solids import convex_parts, fixed_parts, with_obstacles


def shape(solid):
    match solid.shape:
        case Cylinder(centre=centre, radius=radius):
            return Point(centre).buffer(radius, quad_segs=2000)
        case Prism(corners=corners):
            return Polygon(corners)
    return Polygon(with_obstacles(fixed_parts([solid], []), []).corners)


def test_ranges_equal_an_independent_geometry_library():
    ell = Solid(
        name="ell",
        shape=Prism(corners=((-2.0, 0.5), (-1.0, 0.5), (-1.0, 1.0), (-1.5, 1.0), (-1.5, 2.0), (-2.0, 2.0))),
        z_min=0.0,
        z_max=0.5,
        mapped=False,
    )
    solids = (*furniture(), ell, box("turned", (1.8, -0.4), (0.5, 0.3), 0.4, yaw=0.7))
    agent = Agent(name="temi", start=(2.0, 1.5, 0.0))
    plant = SimulatedPlant(scene(solids=solids, agents=(agent,), start=(0.2, 0.1, 0.4)))
    scan = plant.observe().scan
    seen = [shape(solid) for solid in solids if solid.z_min <= 0.2 <= solid.z_max]
    everything = unary_union([*seen, Point(2.0, 1.5).buffer(0.25, quad_segs=2000)])
    eye = np.array([0.2, 0.1])
    for i in range(0, len(scan.ranges), 9):
        angle = 0.4 + scan.angle_min + i * scan.angle_step
        far = eye + 15.0 * np.array([math.cos(angle), math.sin(angle)])
        hit = LineString([eye, far]).intersection(everything)
        expected = math.inf if hit.is_empty else Point(eye).distance(hit)
        assert scan.ranges[i] == pytest.approx(expected, abs=1e-5)


def test_of_the_table_only_the_posts_are_seen():
    plant = SimulatedPlant(scene(solids=table(), start=(4.2, 0.0, math.pi / 2)))
    scan = plant.observe().scan
    assert np.isfinite(scan.ranges).sum() < 20
    hits = np.flatnonzero(np.isfinite(scan.ranges))
    angles = math.pi / 2 + scan.angle_min + hits * scan.angle_step
    x = 4.2 + scan.ranges[hits] * np.cos(angles)
    y = scan.ranges[hits] * np.sin(angles)
    to_posts = np.minimum(np.hypot(x - 3.6, y - 1.77), np.hypot(x - 4.8, y - 1.77))
    np.testing.assert_allclose(to_posts, 0.05, atol=1e-9)


@pytest.mark.parametrize(("height", "seen"), [(0.1, False), (0.19, False), (0.2, True), (0.6, True)])
def test_a_box_is_seen_only_when_it_reaches_the_height_of_the_lidar(height, seen):
    plant = SimulatedPlant(scene(solids=(box("low", (1.5, 0.0), (0.4, 0.4), height, mapped=False),)))
    assert np.isfinite(plant.observe().scan.ranges).any() == seen


def test_ranges_carry_noise_of_the_given_sd():
    noisy = Noise(localisation_position_sd=0.0, localisation_heading_sd=0.0, lidar_range_sd=0.01)
    wall = box("wall", (3.0, 0.0), (0.1, 20.0), 1.0)
    plant = SimulatedPlant(scene(solids=(wall,), noise=noisy))
    exact = SimulatedPlant(scene(solids=(wall,))).observe().scan.ranges
    errors = []
    for _ in range(20):
        plant.step(0.05)
        errors.append(plant.observe().scan.ranges[np.isfinite(exact)] - exact[np.isfinite(exact)])
    assert np.std(np.concatenate(errors)) == pytest.approx(0.01, rel=0.05)


def test_scans_come_at_the_rate_of_the_lidar_with_their_own_stamp():
    profile = RobotProfile(lidar=Lidar(rate=10.0, beams=11))
    plant = SimulatedPlant(scene(robot=profile))
    stamps = []
    for _ in range(50):
        plant.step(0.01)
        stamps.append(plant.observe().scan.stamp)
    np.testing.assert_allclose(sorted(set(stamps)), [0.0, 0.1, 0.2, 0.3, 0.4, 0.5], atol=1e-9)


def test_a_polygon_with_a_dent_is_cut_into_convex_pieces_of_the_same_area():
    corners = np.array([(0, 0), (3, 0), (3, 3), (2, 3), (2, 1), (1, 1), (1, 3), (0, 3)], dtype=float)
    parts = [Polygon(part) for part in convex_parts(corners)]
    assert unary_union(parts).symmetric_difference(Polygon(corners)).area < 1e-12
    assert sum(part.area for part in parts) == pytest.approx(Polygon(corners).area)
