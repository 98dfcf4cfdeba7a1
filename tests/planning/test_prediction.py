"""What moves is expected on its course: discs, distances to them, and a search that goes where they will not be."""

import dataclasses
import math

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from motm_twin.model.known import KnownWorld
from motm_twin.model.profile import Footprint, RobotProfile
from motm_twin.perception.base_map import base_map
from motm_twin.perception.clusters import growth_of, seen_outlines
from motm_twin.perception.distance import proximity_cost, seen_distance, squared_cells
from motm_twin.perception.still_map import StaticMap
from motm_twin.perception.world_map import NO_MOVERS, WorldMap
from motm_twin.planning.collision import body_of
from motm_twin.planning.commitment import Bounds, follow
from motm_twin.planning.global_path import GraphCache
from motm_twin.planning.parameters import PlanningParameters, ReachParameters, StaaParameters
from motm_twin.planning.planner import BasePlanner
from motm_twin.planning.prediction import at_half_steps, expected, gap_to, way_to
from motm_twin.planning.reach import ReachModel
from motm_twin.planning.types import BasePlan, BaseProblem, SearchBudget, Target

FLOOR = KnownWorld(
    robot=RobotProfile(), start=(0.0, 0.0, 0.0), solids=(), objects=(), object_sd=0.0, bins=(), tasks=(),
    bounds=(-2.0, -3.0, 6.0, 3.0),
)  # fmt: skip
BASE = base_map(FLOOR, 0.05)
BUDGET = SearchBudget(expansions=300)
RADIUS = 0.25
coordinate = st.floats(-1.5, 1.5)


def seen(movers: list[tuple[float, float, float, float]]) -> WorldMap:
    """An empty floor on which the lidar sees these: x, y [m] and velocity [m/s], each a disc."""
    centres = BASE.grid.centres()
    covered = np.zeros(BASE.grid.shape, dtype=bool)
    for x, y, *_ in movers:
        covered |= np.hypot(centres[..., 0] - x, centres[..., 1] - y) <= RADIUS
    cells = np.argwhere(covered).astype(np.int32)
    occupied = BASE.occupied.copy()
    occupied[cells[:, 0], cells[:, 1]] = 1
    distance = np.minimum(BASE.distance, seen_distance(squared_cells(cells, *BASE.grid.shape), 0.05))
    origin = np.array(BASE.grid.origin)
    return WorldMap(
        stamp=0.0,
        resolution=0.05,
        origin=origin,
        occupied=occupied,
        distance=distance,
        proximity=proximity_cost(distance, 0.12, 1),
        polygons=tuple(seen_outlines(cells, 0.05, origin, growth_of(RobotProfile().footprint))),
        seen_points=BASE.grid.centre_of(cells),
        seen_static=np.zeros(len(cells), dtype=bool),
        movers=np.array([(*mover, RADIUS, 1.0) for mover in movers]) if movers else NO_MOVERS,
    )


def planner(prediction: float, **others: float | str) -> BasePlanner:
    """The paper's, with that much prediction."""
    staa = dataclasses.replace(StaaParameters(), prediction=prediction, **others)
    return BasePlanner(RobotProfile(), PlanningParameters(staa=staa), still=StaticMap(FLOOR))


def ask(world: WorldMap, x: float = 0.0, v: float = 0.5) -> BaseProblem:
    """A robot that drives along x towards a point behind what moves."""
    target = Target(kind="drive", name="there", position=np.array([4.0, 0.0]))
    pose, twist = np.array([x, 0.0, 0.0]), np.array([v, 0.0])
    return BaseProblem(time=0.0, world=world, pose=pose, twist=twist, target=target, next_target=None, engaged=False)


def plan(world: WorldMap, prediction: float, **others: float | str) -> BasePlan:
    """One period of the robot that drives."""
    return planner(prediction, **others).plan(ask(world), BUDGET)[1]


def gaps(found: BasePlan, mover: tuple[float, float, float, float], horizon: float) -> list[float]:
    """Distances [m] of the footprint to the disc on its course, at the nodes of a plan; with shapely."""
    half_l, half_w = RobotProfile().footprint.length / 2, RobotProfile().footprint.width / 2
    distances = []
    for (x, y, heading, *_), time in zip(found.local_poses, found.local_times, strict=True):
        box = shapely.affinity.rotate(
            shapely.box(x - half_l, y - half_w, x + half_l, y + half_w), heading, origin=(x, y), use_radians=True
        )
        t = min(time, horizon)
        distances.append(box.distance(shapely.Point(mover[0] + t * mover[2], mover[1] + t * mover[3])) - RADIUS)
    return distances


def test_discs_go_on_until_the_horizon_and_stand_after_it():
    movers = np.array([(1.0, 2.0, 0.4, -0.2, 0.3, 1.0), (0.0, 0.0, 0.0, 0.0, 0.2, 0.0)])
    discs = expected(movers, 0.3, 1.0)
    assert discs.shape == (9, 2, 3)
    assert np.allclose(discs[:, 0, 0], 1.0 + 0.4 * np.array([0.0, 0.15, 0.3, 0.45, 0.6, 0.75, 0.9, 1.0, 1.0]))
    assert np.allclose(discs[-1, 0], (1.4, 1.8, 0.3)) and np.allclose(discs[:, 1], (0.0, 0.0, 0.2))
    assert (at_half_steps(3, discs), at_half_steps(100, discs)) == (3, 8)
    assert expected(movers, 0.3, 0.9).shape == (7, 2, 3)


@pytest.mark.parametrize(("movers", "horizon"), [(NO_MOVERS, 1.0), (np.ones((1, 6)), 0.0)])
def test_nothing_is_expected_of_nobody_or_for_no_time(movers: np.ndarray, horizon: float):
    discs = expected(movers, 0.3, horizon)
    assert discs.shape == (1, 0, 3)
    assert gap_to(0.0, 0.0, 1.0, 0.0, discs[0], body_of(Footprint())) == way_to(0.0, 0.0, discs[0]) == math.inf


@given(coordinate, coordinate, st.floats(-4.0, 4.0), coordinate, coordinate, st.floats(-0.2, 0.2))
def test_the_gap_is_that_of_rectangle_and_disc(
    x: float, y: float, heading: float, px: float, py: float, offset: float
) -> None:
    body = body_of(Footprint(length=0.7, width=0.5, offset_x=offset))
    box = shapely.affinity.rotate(
        shapely.box(offset - 0.35, -0.25, offset + 0.35, 0.25), heading, origin=(0.0, 0.0), use_radians=True
    )
    box = shapely.affinity.translate(box, x, y)
    discs = np.array([(9.0, 9.0, 0.2), (px, py, 0.3)])
    gap = gap_to(x, y, math.cos(heading), math.sin(heading), discs, body)
    assert gap == pytest.approx(box.distance(shapely.Point(px, py)) - 0.3, abs=1e-9)
    assert way_to(x, y, discs) == pytest.approx(max(0.0, math.hypot(px - x, py - y) - 0.3), abs=1e-9)


def test_the_way_of_who_leaves_it_is_free():
    leaving = (1.0, 0.3, 0.0, 0.8)  # beside the way in 0.6 s, the robot there in 1.1 s
    stands, goes = (plan(seen([leaving]), prediction) for prediction in (0.0, 1.0))
    assert np.abs(stands.local_poses[:, 1]).max() > 0.1  # round it
    assert np.abs(goes.local_poses[:, 1]).max() < 0.05  # straight on
    assert min(gaps(goes, leaving, 1.0)) >= 0.05 - 1e-9


def test_who_comes_is_made_room_for():
    coming = (1.5, -1.0, 0.0, 0.8)  # not on the way now, and 0.2 m beside its middle in 1 s
    stands, goes = (plan(seen([coming]), prediction) for prediction in (0.0, 1.0))
    assert min(gaps(stands, coming, 1.0)) < 0.05  # straight on, into it
    assert min(gaps(goes, coming, 1.0)) >= 0.05 - 1e-9


def test_the_penalty_of_what_is_expected_keeps_further_off():
    beside = (1.5, -0.75, 0.0, 0.0)
    near, far = (plan(seen([beside]), 1.0, moving_weight=weight) for weight in (0.0, 1.0))
    assert min(gaps(far, beside, 1.0)) > min(gaps(near, beside, 1.0)) + 0.05


def test_the_grid_of_the_penalty_forgets_what_moves_as_well():
    leaving = (1.0, 0.3, 0.0, 0.8)
    goes = plan(seen([leaving]), 1.0, penalty="grid", grid_weight=1.0)
    assert np.abs(goes.local_poses[:, 1]).max() < 0.05


def test_where_nothing_moves_a_prediction_changes_nothing():
    plain, with_it = (plan(seen([]), prediction) for prediction in (0.0, 1.0))
    assert np.array_equal(plain.local_poses, with_it.local_poses)


def test_a_plan_that_is_followed_must_keep_clear_of_who_comes():
    states = np.zeros((8, 5))
    states[0, 3] = 0.5  # straight on at 0.5 m/s, 0.15 m in a half node
    limits, body = Bounds(0.5, 0.25, 1.7, 0.5, 1.75, 0.05, 0.01, 0.6, 0.15, 0.1), body_of(Footprint())
    target = Target(kind="drive", name="there", position=np.array([1.05, 0.0]))
    job = ReachModel(RobotProfile(), ReachParameters()).job(target, StaaParameters())
    field = GraphCache().field(seen([]))

    def free(*mover: float) -> bool:
        discs = expected(np.array([(*mover, RADIUS)]), 0.3, 1.0)
        return follow(states, np.full(7, 0.3), np.zeros((7, 2)), 1.0, False, limits, field, discs, body, job)[0]

    # 0.8 s from now on it is within 0.30 m of the robot's front or side; standing it never would be
    assert free(1.5, -1.0, 0.0, 0.0) and not free(1.5, -1.0, 0.0, 0.8)
    assert free(1.0, 0.3, 0.0, 0.8) and not free(1.0, 0.3, 0.0, 0.0)


def test_without_the_map_that_it_needs_there_is_no_prediction():
    with pytest.raises(ValueError, match="needs the map without it"):
        BasePlanner(RobotProfile(), PlanningParameters(staa=StaaParameters(prediction=1.0)))
    with pytest.raises(ValueError, match="must not be negative"):
        StaaParameters(prediction=-1.0)
