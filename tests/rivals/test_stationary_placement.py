"""Each strategy chooses what it is named for, and keeps its choice as long as it serves."""

import dataclasses
import math

import msgspec
import numpy as np
import pytest

from motm_twin.control.method import PlannerParts
from motm_twin.control.tick import Tick
from motm_twin.methods.registry import find_method
from motm_twin.model.known import KnownWorld
from motm_twin.model.profile import Footprint
from motm_twin.model.scene_file import load_scene
from motm_twin.model.state import state_hash
from motm_twin.perception.world_map import WorldMap
from motm_twin.planning.collision import body_of, clearances, field_of
from motm_twin.planning.global_path import GraphCache
from motm_twin.planning.parameters import PlanningParameters
from motm_twin.planning.types import BaseProblem, Placement, SearchBudget, Target
from motm_twin.rivals.stationary import (
    ALL_TERMS,
    DRIVING,
    FIXED_TERMS,
    GREEDY_TERMS,
    IRM,
    MANIPULABILITY,
    PARKED,
    STOPPING,
    ParkingController,
)
from motm_twin.rivals.stationary_placement import FixedPoses, StationaryPlacement, Terms
from motm_twin.twin import Twin

COLUMNS = (3.1, 3.65, 4.2, 4.75, 5.3)
SLOTS = [*((x, y) for x in COLUMNS for y in (1.47, 2.07)), (3.1, 1.77), (5.3, 1.77)]
CUBE = (4.2, 1.47)


@dataclasses.dataclass(frozen=True)
class Room:
    """Experiment 1 as the robot knows it."""

    parts: PlannerParts
    world: WorldMap
    graphs: GraphCache

    @property
    def known(self) -> KnownWorld:
        """The prior knowledge."""
        return self.parts.known

    def problem(
        self, now: Target, after: Target | None = None, *, pose: tuple[float, float, float] = (4.2, 0.0, 1.57)
    ) -> BaseProblem:
        """A robot at rest."""
        return BaseProblem(
            time=0.0, world=self.world, pose=np.array(pose), twist=np.zeros(2), target=now, next_target=after,
            engaged=False,
        )  # fmt: skip

    def cube(self, at: tuple[float, float] = CUBE) -> Target:
        """A cube of the scene, wherever it is wanted on the table."""
        return Target(kind="pick", name=self.known.objects[0].name, position=np.array(at), dwell=1.3)

    def bin(self, index: int) -> Target:
        """A bin."""
        item = self.known.bins[index]
        return Target(kind="place", name=item.name, position=np.array(item.centre), dwell=0.5)

    def placement(self, terms: Terms) -> StationaryPlacement:
        """A strategy without a memory."""
        return StationaryPlacement(self.parts, self.graphs, terms)


@pytest.fixture(scope="module")
def room() -> Room:
    """The first period of Experiment 1."""
    twin = Twin(load_scene("exp1", "trial1"), method=IRM)
    world = twin.advance().map
    return Room(PlannerParts(known=twin.loop.known, parameters=PlanningParameters()), world, GraphCache())


def seconds(placement: Placement, onward: bool = True) -> float:
    """What the ways of a choice cost."""
    i = placement.chosen
    return float(placement.cost_current[i] + (placement.cost_next[i] if onward else 0.0))


def test_irm_takes_the_most_manipulability_there_is_and_does_not_mind_the_way(room: Room) -> None:
    strategy = room.placement(MANIPULABILITY)
    placement = strategy.place(room.problem(room.cube()))
    poses, _ = strategy.dense(room.cube())
    free = clearances(poses, 0.06, field_of(room.world), body_of(room.known.robot.footprint)) >= 0.06
    reach = strategy.arm_reach
    best = reach.share(poses[free], room.cube()).max()
    assert reach.share(placement.goal[None], room.cube())[0] >= best - 0.011
    from_elsewhere = room.placement(MANIPULABILITY).place(room.problem(room.cube(), pose=(0.0, 0.0, 0.0)))
    assert np.array_equal(placement.goal, from_elsewhere.goal)


def test_a_base_too_wide_for_the_arm_to_reach_over_it_has_no_poses_of_its_own(room: Room) -> None:
    """No circle about the target was near enough and far enough: to join the poses of none of them was an error."""
    wide = msgspec.structs.replace(room.known.robot, footprint=Footprint(length=2.2, width=2.2))
    parts = dataclasses.replace(room.parts, known=msgspec.structs.replace(room.known, robot=wide))
    strategy = StationaryPlacement(parts, room.graphs, ALL_TERMS)
    poses, direction = strategy.dense(room.cube())
    assert poses.shape == (0, 3) and direction.shape == (0,)
    problem = room.problem(room.cube(), room.bin(0))
    assert np.array_equal(strategy.place(problem).goal, strategy.paper.place(problem).goal)


def test_greedy_goes_a_shorter_way_than_irm_and_knows_nothing_of_the_next_target(room: Room) -> None:
    near = room.problem(room.cube(), pose=(5.2, 0.4, math.pi))
    greedy = room.placement(GREEDY_TERMS).place(near)
    irm = room.placement(MANIPULABILITY).place(near)
    assert seconds(greedy, onward=False) < seconds(irm, onward=False)
    for bin_ in (0, 1):
        other = room.placement(GREEDY_TERMS).place(msgspec.structs.replace(near, next_target=room.bin(bin_)))
        assert np.array_equal(other.goal, greedy.goal)


def test_sequential_pays_on_the_way_there_what_it_saves_on_the_way_on(room: Room) -> None:
    start = room.problem(room.cube(), room.bin(1), pose=(5.2, 0.4, math.pi / 2))
    sequential = room.placement(ALL_TERMS).place(start)
    greedy = room.placement(GREEDY_TERMS).place(start)
    same = int(np.argmin(np.abs(sequential.poses - greedy.goal).sum(axis=1)))
    if np.allclose(sequential.poses[same], greedy.goal):
        assert sequential.cost[sequential.chosen] <= sequential.cost[same]
    other = room.placement(ALL_TERMS).place(msgspec.structs.replace(start, next_target=room.bin(0)))
    assert not np.array_equal(sequential.goal, other.goal)
    assert seconds(sequential, onward=False) >= seconds(greedy, onward=False) - 1e-9


def test_costs_are_the_sum_of_their_terms_and_what_is_rejected_says_why(room: Room) -> None:
    strategy = room.placement(ALL_TERMS)
    placement = strategy.place(room.problem(room.cube(), room.bin(0)))
    viable = np.array([not why for why in placement.rejected])
    assert 5 < viable.sum() < len(viable) <= 36
    assert {why for why in placement.rejected if why} == {"collision with mapped furniture"}
    share = strategy.arm_reach.share(placement.poses, room.cube())
    weight = strategy.stationary.manipulability_weight
    whole = weight * (1.0 - share) + placement.cost_current + placement.cost_next
    assert np.allclose(placement.cost[viable], whole[viable])
    assert np.isinf(placement.cost[~viable]).all()
    assert placement.cost[placement.chosen] == placement.cost.min()


def test_the_seven_fixed_poses_serve_every_slot_and_face_the_table(room: Room) -> None:
    strategy = StationaryPlacement(room.parts, room.graphs, FIXED_TERMS, first=FixedPoses(room.parts))
    poses = FixedPoses(room.parts).round(room.cube())
    assert poses.shape == (7, 3)
    free = clearances(poses, 0.06, field_of(room.world), body_of(room.known.robot.footprint)) >= 0.06
    for slot in SLOTS:
        assert (strategy.arm_reach.good_share(poses[free], room.cube(slot)) > 0.5).any(), slot
    nose = poses[:, :2] + 0.8 * np.column_stack((np.cos(poses[:, 2]), np.sin(poses[:, 2])))
    assert ((nose > (3.0, 1.37)) & (nose < (5.4, 2.17))).all()


def test_the_fixed_set_takes_the_best_of_the_seven_at_a_table_and_the_nearest_at_a_bin(room: Room) -> None:
    strategy = StationaryPlacement(room.parts, room.graphs, FIXED_TERMS, first=FixedPoses(room.parts))
    placement = strategy.place(room.problem(room.cube()))
    assert len(placement.poses) == 7
    assert any(why == "arm cannot reach" for why in placement.rejected)
    share = strategy.arm_reach.good_share(placement.poses, room.cube())
    assert share[placement.chosen] >= share.max() - 0.011
    placement = strategy.place(room.problem(room.bin(0)))
    assert placement.cost_current[placement.chosen] == placement.cost_current.min()


def test_a_choice_stays_until_the_target_moves_or_the_place_is_taken(room: Room) -> None:
    strategy = room.placement(ALL_TERMS)
    first = strategy.place(room.problem(room.cube(), room.bin(0)))
    nudged = room.cube((CUBE[0] + 0.02, CUBE[1]))
    assert strategy.place(room.problem(nudged, room.bin(0), pose=(4.0, -0.5, 0.0))) is first
    moved = strategy.place(room.problem(room.cube((CUBE[0] - 0.55, CUBE[1])), room.bin(0)))
    assert np.hypot(*(moved.goal - first.goal)[:2]) > 0.1
    again = strategy.place(room.problem(room.cube(), room.bin(0)))
    distance = room.world.distance.copy()
    column, row = ((again.goal[:2] - room.world.origin) / room.world.resolution).astype(int)
    distance[row - 3 : row + 4, column - 3 : column + 4] = 0.0
    taken = msgspec.structs.replace(room.problem(room.cube(), room.bin(0)), world=_with(room.world, distance))
    assert np.hypot(*(strategy.place(taken).goal - again.goal)[:2]) > 0.1


def _with(world: WorldMap, distance: np.ndarray) -> WorldMap:
    return msgspec.structs.replace(world, distance=distance.astype(np.float32))


def test_a_restored_strategy_goes_on_with_its_choice(room: Room) -> None:
    strategy, other = room.placement(ALL_TERMS), room.placement(ALL_TERMS)
    first = strategy.place(room.problem(room.cube(), room.bin(0)))
    other.restore(strategy.snapshot())
    assert state_hash(other.snapshot()) == state_hash(strategy.snapshot())
    again = other.place(room.problem(room.cube(), room.bin(0), pose=(0.0, 0.0, 0.0)))
    assert np.array_equal(again.goal, first.goal)


def test_the_base_brakes_as_hard_as_it_may_when_that_ends_at_the_pose_and_stays_there(room: Room) -> None:
    controller = ParkingController(room.parts, room.graphs, overlap=False)
    problem = room.problem(room.cube())
    placement = room.placement(MANIPULABILITY).place(problem)
    x, y, heading = placement.goal
    before = np.array([x - 0.25 * math.cos(heading), y - 0.25 * math.sin(heading), heading])
    plan = controller.plan(
        msgspec.structs.replace(problem, pose=before, twist=np.array([0.5, 0.0])), placement, SearchBudget()
    )
    assert controller.snapshot().phase == STOPPING
    assert plan.acceleration[0] == -room.known.robot.base.linear_acceleration
    assert plan.time_to_range == math.inf
    assert np.hypot(*(plan.local_poses[-1, :2] - placement.goal[:2])) < 0.01
    plan = controller.plan(msgspec.structs.replace(problem, pose=placement.goal), placement, SearchBudget())
    assert controller.snapshot().phase == PARKED
    assert plan.time_to_range == 0.0
    assert not plan.acceleration.any()


def test_a_base_that_stands_leaves_when_the_target_is_no_longer_in_reach(room: Room) -> None:
    controller = ParkingController(room.parts, room.graphs, overlap=False)
    strategy = room.placement(MANIPULABILITY)
    problem = room.problem(room.cube())
    placement = strategy.place(problem)
    here = msgspec.structs.replace(problem, pose=placement.goal)
    assert controller.plan(here, placement, SearchBudget()).time_to_range == 0.0
    moved = msgspec.structs.replace(here, target=room.cube((5.3, 1.47)))
    plan = controller.plan(moved, strategy.place(moved), SearchBudget())
    assert plan.time_to_range == math.inf
    assert plan.acceleration.any()


def test_a_base_that_stands_on_the_way_for_long_is_sent_elsewhere(room: Room) -> None:
    strategy = room.placement(MANIPULABILITY)
    problem = room.problem(room.cube())
    first = strategy.place(problem)
    assert strategy.place(msgspec.structs.replace(problem, time=0.5)) is first
    other = strategy.place(msgspec.structs.replace(problem, time=4.0))
    assert np.hypot(*(other.goal - first.goal)[:2]) > strategy.stationary.refused_distance
    assert strategy.place(msgspec.structs.replace(problem, time=4.05)) is other
    there = msgspec.structs.replace(problem, pose=other.goal, time=4.1)
    assert strategy.place(there) is other
    assert strategy.place(msgspec.structs.replace(there, time=20.0)) is other


def test_a_stop_that_would_end_with_a_corner_at_the_furniture_is_none(room: Room) -> None:
    """At the chosen heading there is room beside the desk; the base came with another, and touched it by 1 cm."""
    controller = ParkingController(room.parts, room.graphs, overlap=False)
    problem = room.problem(room.bin(1))
    placement = room.placement(ALL_TERMS).place(problem)
    placement = msgspec.structs.replace(placement, goal=np.array([0.71, 2.86, -1.88]))
    for end, phase in (((0.70, 2.89, -2.25), DRIVING), ((0.71, 2.86, -1.88), STOPPING)):
        x, y, heading = end
        before = np.array([x - 0.25 * math.cos(heading), y - 0.25 * math.sin(heading), heading])
        arriving = msgspec.structs.replace(problem, pose=before, twist=np.array([0.5, 0.0]))
        controller.plan(arriving, placement, SearchBudget())
        assert controller.snapshot().phase == phase


def test_the_arm_does_not_reach_over_a_seen_obstacle_when_there_is_another_place(room: Room) -> None:
    """Held back by a box beside the table, the arm tilted until a finger tip was 1 mm over the table."""
    strategy = room.placement(MANIPULABILITY)
    problem = room.problem(room.cube())
    first = strategy.place(problem)
    between = 0.5 * (first.goal[:2] + 0.15 * np.array([math.cos(first.goal[2]), math.sin(first.goal[2])]) + CUBE)
    seen = msgspec.structs.replace(room.world, seen_points=between[None], seen_static=np.ones(1, dtype=bool))
    second = strategy.place(msgspec.structs.replace(problem, world=seen))
    assert strategy.arm_reach.clear_of(second.goal[None], room.cube(), between[None])[0] > 0.13
    assert strategy.place(msgspec.structs.replace(problem, world=seen)) is second


LIMIT = 40.0  # [s]
SETTLE = 20  # periods until the last cube has fallen


def moves(tick: Tick) -> bool:
    """True when the base is seen to move."""
    v, w = tick.observation.twist
    return abs(v) > 0.02 or abs(w) > 0.04


@pytest.mark.parametrize("name", ["irm", "sequential_overlap"])
def test_a_cube_is_picked_and_placed_by_a_base_that_stands_meanwhile(name: str) -> None:
    scene = load_scene("exp1", "trial1")
    scene = msgspec.structs.replace(scene, tasks=scene.tasks[:2])
    twin = Twin(scene, method=find_method(name))
    early, hashes, snapshot = 0, [], None
    tick = twin.advance()
    while not tick.done and tick.time < LIMIT:
        phases = {step.phase for step in tick.arm}
        if "closing" in phases or ("release" in phases and tick.arm[-1].actuation.gripper == "open"):
            assert not moves(tick), tick.time
        early += "transit" in phases and moves(tick)
        if tick.index == 60:
            snapshot = twin.snapshot()
        if tick.index == 100:
            hashes.append(twin.state_hash())
        tick = twin.advance()
    assert tick.success
    for _ in range(SETTLE):
        tick = twin.advance()
    assert tick.truth is not None
    assert tick.truth.places == 1
    assert not [contact for contact in tick.truth.contacts if contact.caused_by_robot]
    assert (early > 10) == (name == "sequential_overlap")
    assert snapshot is not None
    twin.restore(snapshot)
    for _ in range(40):
        twin.advance()
    hashes.append(twin.state_hash())
    assert hashes[0] == hashes[1]
    assert hashes[0] != state_hash(snapshot)
