"""Base placement: the rule of the paper on hand-worked cases, rejections, fallbacks, memory."""

import itertools
import math

import msgspec
import numpy as np
import pytest
import shapely
import shapely.affinity
from idealised import polygons, rectangle, world_of

from motm_twin.model.profile import Lidar, RobotProfile
from motm_twin.model.state import state_hash
from motm_twin.perception.world_map import WorldMap
from motm_twin.planning.candidates import PlacementState, ring, rings
from motm_twin.planning.every_ring import every_ring
from motm_twin.planning.parameters import PlacementParameters, PlanningParameters, ReachParameters
from motm_twin.planning.placement import NextTargetPlacement
from motm_twin.planning.rejections import in_sight
from motm_twin.planning.types import BaseProblem, Placement, Recovery, Target

W_MAX = RobotProfile().base.yaw_rate


def target(kind: str, x: float, y: float, name: str = "it", **more: float) -> Target:
    """A target at a point."""
    return Target(kind=kind, name=name, position=np.array([x, y]), **more)


def problem(
    world: WorldMap, now: Target | None, after: Target | None = None, pose: tuple = (0.0, 0.0, 0.0)
) -> BaseProblem:
    """A robot at rest."""
    return BaseProblem(
        time=0.0, world=world, pose=np.array(pose), twist=np.zeros(2), target=now, next_target=after, engaged=False
    )


def place(world: WorldMap, now: Target | None, after: Target | None = None, **where: tuple) -> Placement:
    """One placement with the default robot."""
    return NextTargetPlacement(RobotProfile(), PlanningParameters()).place(problem(world, now, after, **where))


def test_there_are_36_positions_with_two_tangential_headings() -> None:
    poses, places, place_of = ring(np.array([1.0, 2.0]), 0.6, 36)
    assert poses.shape == (72, 3)
    assert places.shape == (36, 2)
    assert np.allclose(np.hypot(*(poses[:, :2] - (1.0, 2.0)).T), 0.6)
    outward = poses[:, :2] - (1.0, 2.0)
    along = np.column_stack((np.cos(poses[:, 2]), np.sin(poses[:, 2])))
    assert np.allclose((outward * along).sum(axis=1), 0.0, atol=1e-9)
    steps = np.diff(np.unwrap(np.arctan2(places[:, 1] - 2.0, places[:, 0] - 1.0)))
    assert np.allclose(steps, math.radians(10.0))
    assert np.array_equal(place_of, np.repeat(np.arange(36), 2))


def test_rings_are_one_ring_after_the_other() -> None:
    centre, radii = np.array([1.0, 2.0]), np.array([0.6, 0.65, 0.8])
    poses, places, place_of = rings(centre, radii, 36)
    each = [ring(centre, radius, 36) for radius in radii]
    assert np.array_equal(poses, np.concatenate([one[0] for one in each]))
    assert np.array_equal(places, np.concatenate([one[1] for one in each]))
    assert np.array_equal(places[place_of], poses[:, :2])


def test_the_costs_of_a_candidate_in_the_open_are_those_worked_out_by_hand() -> None:
    """Robot at the origin facing x; target (4, 0.6); the candidate at (4, 0) facing x lies straight ahead.

    C_iC = 4 m / 0.5 m/s = 8 s. Next target: drive to (8, 0), heading free: C_iN = 4 / 0.5 = 8 s.
    """
    placement = place(world_of((), (-2, -4, 10, 4)), target("pick", 4.0, 0.6), target("drive", 8.0, 0.0, "there"))
    ahead = int(np.argmin(np.abs(placement.poses - (4.0, 0.0, 0.0)).sum(axis=1)))
    assert np.allclose(placement.poses[ahead], (4.0, 0.0, 0.0), atol=1e-9)
    assert placement.cost_current[ahead] == pytest.approx(8.0)
    assert placement.cost_next[ahead] == pytest.approx(8.0)
    assert placement.cost[ahead] == pytest.approx(8.0 + 1.05 * 8.0)
    assert placement.chosen == ahead
    assert placement.mode == "ring"
    assert placement.radius == pytest.approx(0.6)
    facing_back = ahead + 1 if ahead % 2 == 0 else ahead - 1
    # In reverse at 0.25 m/s with half a turn more would be slower than turning round at the end: 8 + pi / w.
    assert placement.cost_current[facing_back] == pytest.approx(8.0 + math.pi / W_MAX)


def test_every_cost_is_the_sum_of_both_parts_with_the_weight_of_the_paper() -> None:
    placement = place(world_of(polygons()), target("pick", 4.2, 1.47), target("place", 4.25, -1.29, "bin"))
    viable = np.array([why == "" for why in placement.rejected])
    assert 0 < viable.sum() < 72
    assert np.allclose(placement.cost[viable], placement.cost_current[viable] + 1.05 * placement.cost_next[viable])
    assert np.isinf(placement.cost[~viable]).all()
    assert placement.cost[placement.chosen] == placement.cost.min()


def test_a_rejected_candidate_says_why() -> None:
    placement = place(world_of(polygons()), target("pick", 4.2, 1.47))
    reasons = {why for why in placement.rejected if why}
    assert "collision with mapped furniture" in reasons
    over_table = [i for i, pose in enumerate(placement.poses) if pose[1] > 1.5]
    assert all(placement.rejected[i] for i in over_table)
    at_border = place(world_of((), (-2, -2, 4, 2)), target("pick", 3.9, 0.0))
    assert "outside the map" in at_border.rejected


def test_a_candidate_blocked_by_what_only_the_lidar_saw_says_so() -> None:
    shapes = (rectangle(1.5, -0.6, 2.0, -0.3),)
    world = world_of(shapes, (-2, -3, 6, 3))
    seen = WorldMap(
        stamp=0.0, resolution=world.resolution, origin=world.origin, occupied=world.occupied, distance=world.distance,
        proximity=world.proximity, polygons=shapes, seen_points=np.array([[1.6, -0.45], [1.9, -0.45]]),
        seen_static=np.zeros(2, dtype=bool),
    )  # fmt: skip
    placement = place(seen, target("pick", 1.75, 0.2))
    assert "collision with a seen obstacle" in placement.rejected


def test_a_candidate_behind_a_closed_wall_has_no_path() -> None:
    wall = rectangle(2.0, -5.0, 2.2, 5.0)
    placement = place(world_of((wall,), (-2, -4, 8, 4)), target("pick", 2.1, 0.0), pose=(0.0, 0.0, 0.0))
    beyond = [why for why, pose in zip(placement.rejected, placement.poses, strict=True) if pose[0] > 2.6]
    assert beyond
    assert "no path" in beyond
    assert "" not in beyond
    assert placement.goal[0] < 2.0


def test_the_ring_grows_only_until_a_candidate_is_free() -> None:
    disc = 0.32 * np.column_stack((np.cos(np.arange(24) * math.pi / 12), np.sin(np.arange(24) * math.pi / 12)))
    grown = place(world_of((disc * 1.18,), (-3, -3, 3, 3)), target("pick", 0.0, 0.0), pose=(-2.0, 0.0, 0.0))
    assert grown.mode == "ring"
    assert grown.radius == pytest.approx(0.70)
    small = place(world_of((disc * 0.7,), (-3, -3, 3, 3)), target("pick", 0.0, 0.0), pose=(-2.0, 0.0, 0.0))
    assert small.radius == pytest.approx(0.60)


def test_a_tangential_pose_from_which_the_arm_does_not_reach_is_rejected() -> None:
    disc = 0.5 * np.column_stack((np.cos(np.arange(24) * math.pi / 12), np.sin(np.arange(24) * math.pi / 12)))
    placement = place(world_of((disc * 0.96,), (-3, -3, 3, 3)), target("pick", 0.0, 0.0), pose=(-2.0, 0.0, 0.0))
    assert "arm cannot reach" in placement.rejected
    assert placement.mode != "ring"


@pytest.mark.parametrize("slot", [(3.65, 1.47), (4.2, 1.47)])
def test_in_the_pockets_of_experiment_1a_the_robot_noses_in(slot: tuple[float, float]) -> None:
    world = world_of(polygons(boxes=True))
    placement = place(world, target("pick", *slot))
    assert placement.mode == "reach"
    assert placement.goal_has_heading
    mount = placement.goal[:2] + 0.15 * np.array([math.cos(placement.goal[2]), math.sin(placement.goal[2])])
    assert 0.35 <= math.dist(mount, slot) <= 0.75
    assert placement.rejected.count("collision with mapped furniture") > 0


def test_a_target_that_no_pose_reaches_makes_the_robot_wait_at_the_closest_free_position() -> None:
    world = world_of((rectangle(1.0, -2.0, 5.0, 2.0),), (-3, -4, 8, 4))
    placement = place(world, target("pick", 3.0, 0.0))
    assert placement.mode == "closest"
    assert not placement.goal_has_heading
    distance = math.dist(placement.goal[:2], (3.0, 0.0))
    assert 2.25 < distance < 2.6
    assert "closest free place" in placement.reason


def _beside_a_stranger(standing: bool) -> tuple[Placement, np.ndarray]:
    """A target on an island that the arm cannot reach across, with something seen at the side where the robot is."""
    stranger = rectangle(0.4, 0.4, 0.8, 0.8)
    x, y = np.meshgrid(np.arange(0.425, 0.8, 0.05), np.arange(0.425, 0.8, 0.05))
    points = np.column_stack((x.ravel(), y.ravel()))
    world = msgspec.structs.replace(
        world_of((rectangle(1.0, -2.0, 5.0, 2.0), stranger), (-3, -4, 8, 4)),
        seen_points=points,
        seen_static=np.full(len(points), standing),
    )
    return place(world, target("pick", 1.9, 0.0), pose=(-1.5, 0.0, 0.0)), points


def _distance_to_footprint(pose: np.ndarray, points: np.ndarray) -> float:
    """Of the nearest point [m], by shapely."""
    foot = RobotProfile().footprint
    box = shapely.box(foot.offset_x - foot.length / 2, -foot.width / 2, foot.offset_x + foot.length / 2, foot.width / 2)
    there = shapely.affinity.rotate(box, float(pose[2]), origin=(0.0, 0.0), use_radians=True)
    there = shapely.affinity.translate(there, *pose[:2].tolist())
    return float(shapely.distance(there, shapely.points(points)).min())


def test_where_it_waits_it_leaves_room_to_what_may_be_moving_and_none_to_what_stands() -> None:
    room = PlacementParameters().room
    moving, points = _beside_a_stranger(standing=False)
    static, _ = _beside_a_stranger(standing=True)
    assert moving.mode == static.mode == "closest"
    viable = [pose for pose, why in zip(moving.poses, moving.rejected, strict=True) if not why]
    assert all(_distance_to_footprint(pose, points) >= room for pose in (moving.goal, *viable))
    assert _distance_to_footprint(static.goal, points) < room
    assert math.dist(static.goal[:2], (1.9, 0.0)) < math.dist(moving.goal[:2], (1.9, 0.0))


def test_where_there_is_no_room_it_waits_at_the_closest_free_position_all_the_same() -> None:
    """Strangers all over the floor, one every 0.8 m: nothing is 0.5 m away from all of them."""
    walls, away = [rectangle(1.0, -2.0, 5.0, 2.0)], []
    for x, y in itertools.product(np.arange(-2.8, 8.0, 0.8), np.arange(-3.8, 4.0, 0.8)):
        if not (0.9 < x < 5.1 and -2.1 < y < 2.1) and math.dist((x, y), (-1.2, 0.1)) > 0.7:
            walls.append(rectangle(x - 0.02, y - 0.02, x + 0.02, y + 0.02))
            away.append((x, y))
    world = msgspec.structs.replace(
        world_of(tuple(walls), (-3, -4, 8, 4)), seen_points=np.array(away), seen_static=np.zeros(len(away), bool)
    )
    placement = place(world, target("pick", 2.9, 0.0), pose=(-1.2, 0.1, 0.0))
    assert placement.mode == "closest"
    assert _distance_to_footprint(placement.goal, np.array(away)) < PlacementParameters().room


def test_the_next_target_turns_the_choice_towards_itself() -> None:
    world = world_of(polygons())
    right = place(world, target("pick", 4.2, 1.47), target("place", 7.0, 0.0, "bin"), pose=(4.2, -0.5, 1.57))
    left = place(world, target("pick", 4.2, 1.47), target("place", 1.0, 0.0, "bin"), pose=(4.2, -0.5, 1.57))
    assert math.cos(right.goal[2]) > 0.5
    assert math.cos(left.goal[2]) < -0.5


def test_drive_targets_keep_their_heading_or_leave_it_free() -> None:
    world = world_of(polygons())
    fixed = place(world, target("drive", 2.0, 0.0, heading=1.0, tolerance=0.1))
    assert fixed.mode == "drive"
    assert np.allclose(fixed.goal, (2.0, 0.0, 1.0))
    assert fixed.goal_has_heading
    free = place(world, target("drive", 2.0, 0.0), target("drive", 2.0, -0.9, "then"))
    assert not free.goal_has_heading
    assert free.cost.shape == free.cost_current.shape


def test_a_drive_target_inside_furniture_becomes_the_closest_free_position() -> None:
    placement = place(world_of(polygons()), target("drive", 4.2, 1.77))
    assert placement.mode == "closest"
    assert "collision with mapped furniture" not in placement.reason


def test_without_a_target_there_is_nothing_to_place() -> None:
    placement = place(world_of(polygons()), None)
    assert placement.mode == "none"
    assert placement.chosen == -1


def test_a_choice_is_kept_until_another_is_clearly_cheaper() -> None:
    world = world_of((), (-4, -4, 4, 4))
    profile = RobotProfile()

    def switches(hysteresis: float) -> int:
        parameters = PlanningParameters(placement=PlacementParameters(hysteresis=hysteresis))
        strategy = NextTargetPlacement(profile, parameters)
        goals = []
        for i in range(40):
            pose = (-2.5, 0.08 * (-1) ** i, 0.0)
            goals.append(strategy.place(problem(world, target("pick", 0.0, 0.0), pose=pose)).goal)
        return sum(bool(np.abs(a - b).sum() > 1e-6) for a, b in itertools.pairwise(goals))

    assert switches(0.0) > 10
    assert switches(0.3) <= 1


def test_restored_memory_gives_the_same_choice_and_hash() -> None:
    world = world_of(polygons())
    strategy = NextTargetPlacement(RobotProfile(), PlanningParameters())
    ask = problem(world, target("pick", 4.2, 1.47), target("place", 4.25, -1.29, "bin"))
    strategy.place(ask)
    saved = strategy.snapshot()
    first = strategy.place(ask)
    strategy.place(problem(world, target("pick", 3.1, 1.47, "other")))
    strategy.restore(saved)
    assert state_hash(strategy.snapshot()) == state_hash(saved)
    assert np.array_equal(strategy.place(ask).goal, first.goal)


def test_reach_can_be_set_for_another_arm() -> None:
    world = world_of((), (-4, -4, 4, 4))
    short = PlanningParameters(reach=ReachParameters(r_max_pick=0.60))
    placement = NextTargetPlacement(RobotProfile(), short).place(
        problem(world, target("pick", 0.0, 0.0), pose=(-2, 0, 0))
    )
    assert placement.mode == "reach"
    with pytest.raises(ValueError, match="ring radii"):
        PlacementParameters(radius_min=0.9)


@pytest.mark.parametrize(("x", "words"), [(20.0, "can be reached"), (3.5, "closest free place")])
def test_a_target_outside_the_map_is_said_to_be_outside_with_coordinates(x: float, words: str) -> None:
    reason = place(world_of((), (-2, -2, 2, 2)), target("place", x, 0.0, "bin")).reason
    assert f"bin at ({x:.2f}, 0.00) is outside the map, x -2.00 to 2.00 m" in reason
    assert words in reason
    assert "obstacles" not in reason


def test_what_hides_a_place_hides_it_from_the_lidar_and_not_from_the_middle_of_the_base() -> None:
    """A post between the middle of the base and a place hid it from a lidar that sees past the post."""
    post = msgspec.structs.replace(world_of(()), seen_points=np.array([[0.8, 0.1]]), seen_static=np.ones(1, bool))
    there, free = np.array([[2.0, 0.0, 0.0]]), []
    for y in (0.0, 1.0):
        robot = RobotProfile(lidar=Lidar(y=y))
        here = NextTargetPlacement(robot, PlanningParameters()).survey(problem(post, None), PlacementState()).here
        free += in_sight(there, here).tolist()
    assert free == [False, True]


def test_a_robot_that_finds_no_way_may_stand_with_less_clearance() -> None:
    """Rings of `fast` and `foresight` kept their usual clearance while the robot stood without progress."""
    box = world_of((rectangle(-0.3, -0.3, 0.3, 0.3),))
    counts = []
    for tightness in (0.0, 1.0):
        asked = msgspec.structs.replace(problem(box, target("pick", 0.0, 0.0)), recovery=Recovery(tightness=tightness))
        survey = NextTargetPlacement(RobotProfile(), PlanningParameters()).survey(asked, PlacementState())
        counts.append(every_ring(asked.target, survey).rejected.count(""))
    assert 0 < counts[0] < counts[1]
