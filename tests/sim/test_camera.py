import math

import msgspec
import numpy as np
import pytest
from sim_hands import DOWN, START, act, hand_pose, over_a_cube, tcp
from sim_scenes import QUIET, box, scene

from motm_twin.model.geometry import to_frame
from motm_twin.model.profile import RobotProfile
from motm_twin.model.scene import Agent, Mismatch, Noise, SceneObject
from motm_twin.sim.plant import SimulatedPlant

EYE, LOOK = hand_pose(START, DOWN)


def seen(point, **changes):
    """Detections of one cube centred at a point, with the camera looking straight down."""
    cube = SceneObject(name="cube", position=tuple(float(v) for v in point), yaw=0.3)
    plant = SimulatedPlant(scene(objects=(cube,), **changes), arm_start=DOWN)
    return plant.observe().detections


def below(depth, sideways=0.0):
    return EYE + np.array([0.0, sideways, -depth])


def test_without_noise_position_and_yaw_are_exact_in_the_base_frame():
    start = (1.0, -0.5, 0.8)
    hand, _ = hand_pose(start, DOWN)
    (item,) = seen(hand - [0.0, 0.0, 0.5], start=start)
    np.testing.assert_allclose(item.p_base, to_frame(np.array(start), hand - [0.0, 0.0, 0.5]), atol=1e-12)
    assert item.yaw_base == pytest.approx(0.3 - 0.8)
    assert item.position_sd == 0.0


@pytest.mark.parametrize(("degrees", "visible"), [(0, True), (44, True), (46, False)])
def test_the_view_is_a_cone(degrees, visible):
    assert bool(seen(below(0.5, 0.5 * math.tan(math.radians(degrees))))) == visible


@pytest.mark.parametrize(("distance", "visible"), [(0.05, True), (0.6, True)])
def test_the_view_has_a_range(distance, visible):
    assert bool(seen(below(distance))) == visible


def test_what_is_beyond_the_range_is_not_seen():
    q = DOWN.copy()
    q[5] += 1.2  # looks ahead
    hand, rotation = hand_pose(START, q)
    for distance, visible in ((1.15, True), (1.25, False)):
        point = hand + distance * rotation[:, 2]
        cube = SceneObject(name="cube", position=tuple(float(v) for v in point))
        plant = SimulatedPlant(scene(objects=(cube,)), arm_start=q)
        assert bool(plant.observe().detections) == visible


def test_furniture_between_hides_it_and_furniture_under_it_does_not():
    shelf = box("shelf", (EYE[0], EYE[1]), (0.3, 0.3), EYE[2] - 0.2, z_min=EYE[2] - 0.25)
    assert not seen(below(0.5), solids=(shelf,))
    assert seen(below(0.18), solids=(shelf,))


def test_an_agent_between_hides_it():
    assert seen(below(0.5))
    agent = Agent(name="low", start=(float(EYE[0]), float(EYE[1]), 0.0), radius=0.05, height=float(EYE[2]) - 0.2)
    assert not seen(below(0.5), agents=(agent,))


def test_the_arm_itself_can_hide_it():
    folded = np.array([0.0, -1.2, 0.0, -2.9, 0.0, 1.0, 0.7])
    eye, rotation = hand_pose(START, folded)
    plant = SimulatedPlant(scene(), arm_start=folded)
    frames = plant._frames(START, folded)
    elbow = frames[4, :3, 3]
    behind = eye + 1.4 * (elbow - eye)
    T = frames[9].copy()
    T[:3, 2] = (behind - eye) / np.linalg.norm(behind - eye)  # a lens that looks at the elbow
    agents = np.zeros((0, 4))
    assert plant._camera.sees(T, frames, behind, plant._scenery.solids, agents) is None
    assert rotation.shape == (3, 3)


def test_a_held_cube_is_not_reported():
    plant = over_a_cube()
    assert plant.observe().detections
    plant.command(act(gripper="close"))
    plant.step(1.0)
    assert plant.observe().detections == ()


@pytest.mark.parametrize(("depth", "sd"), [(0.1, 0.002), (0.55, 0.011)])
def test_noise_grows_linearly_with_distance(depth, sd):
    noise = Noise(localisation_position_sd=0.0, localisation_heading_sd=0.0)
    point = below(depth)
    cube = SceneObject(name="cube", position=tuple(float(v) for v in point), yaw=0.0)
    stand = box("stand", (point[0], point[1]), (0.04, 0.04), float(point[2]) - 0.02)
    plant = SimulatedPlant(scene(objects=(cube,), solids=(stand,), noise=noise), arm_start=DOWN)
    errors = []
    for _ in range(400):
        plant.step(0.05)
        (item,) = plant.observe().detections
        assert item.position_sd == pytest.approx(sd, rel=1e-6)
        errors.append(item.p_base - point)
    assert np.std(errors) == pytest.approx(sd, rel=0.1)
    assert tcp()[0].shape == (3,)


def frames(plant, count):
    """Detections of so many pictures in a row, by the stamp of the picture that is newest."""
    found = []
    for _ in range(count):
        plant.step(0.05)
        found.append(plant.observe().detections)
    return found


def looking_down(noise, **changes):
    cube = SceneObject(name="cube", position=tuple(float(v) for v in below(0.5)))
    return SimulatedPlant(scene(objects=(cube,), noise=noise, **changes), arm_start=DOWN)


def test_a_camera_without_markers_gives_no_names():
    (named,), (nameless,) = seen(below(0.5)), seen(below(0.5), detections="anonymous")
    assert (named.name, nameless.name) == ("cube", "")
    np.testing.assert_array_equal(named.p_base, nameless.p_base)


def test_a_share_of_the_pictures_misses_the_object_and_the_same_ones_every_time():
    noise = msgspec.structs.replace(QUIET, camera_miss_probability=0.3)
    shown = [bool(found) for found in frames(looking_down(noise), 200)]
    assert 110 < sum(shown) < 170
    assert shown == [bool(found) for found in frames(looking_down(noise), 200)]


def test_what_is_falsely_detected_has_no_name_is_in_view_and_does_not_come_with_markers():
    noise = msgspec.structs.replace(QUIET, camera_false_probability=0.5)
    found = frames(looking_down(noise, detections="anonymous"), 100)
    false = [one for picture in found for one in picture[1:]]
    assert 30 < len(false) < 70
    for one in false:
        ray = one.p_base - to_frame(START, EYE)
        assert 0.1 <= np.linalg.norm(ray) <= RobotProfile().camera.range
        assert -ray[2] >= math.cos(RobotProfile().camera.half_cone) * np.linalg.norm(ray) - 1e-9
    assert all(len(picture) == 1 for picture in frames(looking_down(noise), 100))


def test_pictures_come_late_with_their_own_stamps_and_all_of_them():
    plant = looking_down(msgspec.structs.replace(QUIET, camera_latency=0.12))
    assert plant.observe().detections == ()
    stamps = []
    for _ in range(100):
        plant.step(0.01)
        stamps += [one.stamp for one in plant.observe().detections]
        if stamps:
            assert 0.12 - 1e-9 <= plant.time - stamps[-1] < 0.17
    assert sorted(set(stamps)) == pytest.approx(np.arange(0.0, 0.881, 0.05))


def test_a_camera_that_sits_elsewhere_on_the_hand_is_wrong_by_as_much_in_the_hands_frame():
    offs = []
    for start in ((0.0, 0.0, 0.0), (0.0, 0.0, 1.0)):
        cube = SceneObject(name="cube", position=tuple(float(v) for v in hand_pose(start, DOWN)[0]))
        cube = msgspec.structs.replace(cube, position=(*cube.position[:2], cube.position[2] - 0.5))
        plant = SimulatedPlant(scene(objects=(cube,), start=start, mismatch=Mismatch(hand_eye=0.01)), arm_start=DOWN)
        offs.append(plant.observe().detections[0].p_base - to_frame(np.array(start), np.array(cube.position)))
    assert np.linalg.norm(offs[0]) == pytest.approx(0.01)
    np.testing.assert_allclose(offs[0], offs[1], atol=1e-12)
