"""Goals of the hand, and what stands in its way to them."""

import math

import msgspec
import numpy as np
import pytest

from motm_twin.control.arm.geometry import reach_radius
from motm_twin.control.arm.parameters import ArmParameters
from motm_twin.control.targets import Targets, world_in_odometry
from motm_twin.model.known import known_world
from motm_twin.model.scene import Pick, Place
from motm_twin.model.scene_file import load_scene
from motm_twin.perception.objects import ObjectTracker
from motm_twin.planning.parameters import ReachParameters
from motm_twin.planning.reach import ReachModel
from motm_twin.planning.types import PastWalls
from motm_twin.sim.plant import SimulatedPlant

TILT = ArmParameters().pick_tilt


@pytest.mark.parametrize(("side", "over"), [(0.04, 0.0), (0.05, 0.0), (0.06, 0.006), (0.065, 0.008)])
def test_a_tall_object_is_grasped_over_its_middle_for_the_palm_is_tilted(tmp_path, side, over):
    path = tmp_path / "tall.yaml"
    path.write_text(
        "format: motm-scene/1\ntitle: tall\nstart: {x: 0.0, y: 0.0, heading_deg: 0}\nfurniture:\n"
        "  table: {shape: box, centre: [2.0, 0.0], size: [0.8, 1.6], z: [0.0, 0.6], style: table}\n"
        f"objects:\n  cube: {{surface: table, at: [2.1, 0.0], yaw_deg: 0, side: {side}}}\ntasks:\n  - pick: cube\n"
    )
    scene = load_scene(str(path), None, 0)
    known, observation = known_world(scene), SimulatedPlant(scene).observe()
    tracker = ObjectTracker(known)
    targets, frame = Targets(known, tracker, ReachParameters(), ArmParameters()), world_in_odometry(observation)
    goal = targets.arm_goal(Pick(object="cube"), "", observation, frame)
    middle = float(tracker.belief("cube", observation)[0][2])
    assert goal.position[2] - middle == pytest.approx(over, abs=1e-3)
    corner = 0.5 * side * (math.cos(TILT) + math.sqrt(2.0) * math.sin(TILT))  # along the hand's axis
    assert corner < 0.0374 + over  # where the palm begins


@pytest.mark.parametrize(
    ("height", "sd", "aside", "higher"),
    [
        (0.06, 0.005, 0.0, 0.08),  # a pile: its top counts
        (-0.04, 0.005, 0.0, 0.0),  # below the rim
        (0.06, 0.05, 0.0, 0.0),  # only believed to be somewhere in the bin
        (0.06, 0.005, 0.3, 0.0),  # beside the bin
    ],
)
def test_an_object_is_let_go_over_the_rim_or_over_what_was_seen_to_lie_higher(height, sd, aside, higher):
    scene = load_scene("shelf_run", "one_trolley")
    known = known_world(scene)
    tracker, observation = ObjectTracker(known), SimulatedPlant(scene).observe()
    targets, frame = Targets(known, tracker, ReachParameters(), ArmParameters()), world_in_odometry(observation)
    place = next(each for each in known.bins if each.name == "order_2")
    seen = np.array([place.centre[0] + aside, place.centre[1], place.rim_z + height])
    lies = known.objects[0]
    tracker.move_belief(lies.name, np.array([*seen]), observation, sd)
    assert np.allclose(frame, 0.0, atol=0.1)  # odometry begins in the world
    here = msgspec.structs.replace(observation, odometry=np.array([place.centre[0], place.centre[1] - 0.9, 0.0]))
    goal = targets.arm_goal(Place(bin="order_2"), known.objects[1].name, here, frame)
    assert goal.position[2] == pytest.approx(place.rim_z + higher)
    inside = [] if aside else [[*seen, 0.0, lies.side, float(sd < 0.05)]]
    np.testing.assert_allclose(goal.neighbours, np.reshape(inside, (-1, 6)))
    crossed = [[*seen, 0.0, lies.side, 1.0]] if aside else []
    np.testing.assert_allclose(goal.others[:, :3], np.reshape(crossed, (-1, 6))[:, :3])
    assert lies.side == pytest.approx(0.04)


def behind(tmp_path, piece):
    """The cube at (2.1, 0.0) on a table of 0.6 m, behind a piece of furniture, as the base sees it."""
    path = tmp_path / "scene.yaml"
    path.write_text(
        "format: motm-scene/1\ntitle: a piece\nstart: {x: 0.0, y: 0.0, heading_deg: 0}\nfurniture:\n"
        "  table: {shape: box, centre: [2.0, 0.0], size: [0.8, 1.6], z: [0.0, 0.6], style: table}\n"
        f"  piece: {{shape: box, {piece}}}\n"
        "objects:\n  cube: {surface: table, at: [2.1, 0.0], yaw_deg: 0}\ntasks:\n  - pick: cube\n"
    )
    scene = load_scene(str(path), None, 0)
    known = known_world(scene)
    targets = Targets(known, ObjectTracker(known), ReachParameters(), ArmParameters())
    return targets.base_target(Pick(object="cube"), SimulatedPlant(scene).observe(), None)


@pytest.mark.parametrize(
    ("low", "high", "walls", "tall"),
    [
        (0.6, 0.67, 0, 0),
        (0.6, 0.82, 4, 0),
        (0.6, 1.22, 4, 4),
        (0.9, 0.92, 4, 0),
        (1.2, 1.22, 0, 0),  # a board over the arm: the base found no place in front of it
    ],
)
def test_what_stands_higher_than_the_hand_comes_in_is_a_wall(tmp_path, low, high, walls, tall):
    target = behind(tmp_path, f"centre: [1.8, 0.0], size: [0.1, 1.6], z: [{low}, {high}], style: shelf")
    assert (len(target.walls), len(target.tall)) == (walls, tall)


@pytest.mark.parametrize(("jar", "reach", "wide"), [(0.7, math.inf, False), (0.76, 0.83, True), (0.95, 0.68, True)])
def test_a_jar_before_a_cube_is_as_wide_as_the_hand_and_the_arm_reaches_less_far_over_it(tmp_path, jar, reach, wide):
    """Through gaps of 6 cm between jars the base saw its cube, and stood where no hand comes over them to it."""
    target = behind(tmp_path, f"centre: [1.95, 0.0], size: [0.1, 0.1], z: [0.6, {jar}], style: plain")
    assert target.reach_over == pytest.approx(reach, abs=0.02)
    if wide:
        assert np.ptp(target.walls[:, 1]) == pytest.approx(0.2)
        assert target.past_walls(PastWalls.OVER_NEAR).reach == min(target.reach, target.reach_over)


@pytest.mark.parametrize(("top", "reach"), [(0.75, 0.80), (0.95, 0.70), (1.05, 0.60)])
def test_the_base_goes_nearer_to_what_is_high_for_the_hand_reaches_less_far_there(tmp_path, top, reach):
    """Beside a bin with its rim at 0.98 m the base stood 0.8 m away, and the hand hovered short of it for ever."""
    path = tmp_path / "high.yaml"
    path.write_text(
        "format: motm-scene/1\ntitle: high\nstart: {x: 0.0, y: 0.0, heading_deg: 0}\nfurniture:\n"
        f"  table: {{shape: box, centre: [2.0, 0.0], size: [0.8, 1.6], z: [0.0, {top}], style: table}}\n"
        "objects:\n  cube: {surface: table, at: [2.1, 0.0], yaw_deg: 0, side: 0.04}\ntasks:\n  - pick: cube\n"
    )
    scene = load_scene(str(path), None, 0)
    known, observation = known_world(scene), SimulatedPlant(scene).observe()
    targets = Targets(known, ObjectTracker(known), ReachParameters(), ArmParameters())
    target = targets.base_target(Pick(object="cube"), observation, None)
    model = ReachModel(known.robot, ReachParameters())
    assert target.reach == pytest.approx(reach, abs=0.015)
    assert model.r_max(target) == min(ReachParameters().r_max_pick, target.reach)


@pytest.mark.parametrize(("side", "nearer"), [(0.4, 0.06), (0.24, 0.035), (0.17, 0.0)])
def test_the_base_goes_nearer_to_a_bin_that_is_so_narrow_that_all_falls_into_its_middle(tmp_path, side, nearer):
    """Before a bin of 17 cm it stood 5 cm too far for 30 s, and the hand waited at the end of its reach."""
    path = tmp_path / "narrow.yaml"
    path.write_text(
        "format: motm-scene/1\ntitle: narrow\nstart: {x: 0.0, y: 0.0, heading_deg: 0}\nfurniture:\n"
        "  table: {shape: box, centre: [2.0, 0.0], size: [0.8, 1.6], z: [0.0, 0.6], style: table}\n"
        "objects:\n  cube: {surface: table, at: [2.1, 0.0], yaw_deg: 0, side: 0.04}\n"
        f"bins:\n  narrow: {{at: [0.0, 3.0], side: {side}, rim_z: 0.72, floor_z: 0.6}}\n"
        "tasks:\n  - pick: cube\n  - {place: narrow}\n"
    )
    scene, p = load_scene(str(path), None, 0), ArmParameters()
    known, observation = known_world(scene), SimulatedPlant(scene).observe()
    targets = Targets(known, ObjectTracker(known), ReachParameters(), p)
    hover = reach_radius(0.72 + p.release_height - known.robot.arm.mount_z, p.place_tilt, p.stretch)
    assert targets.base_target(Place(bin="narrow"), observation, None).reach == pytest.approx(hover + nearer)
