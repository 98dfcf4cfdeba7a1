"""Compile the kernels of this room before they are needed. Each part can run in a process of its own, at the same time.

Numba stores what it compiled, so that this takes time only once per installation.
"""

from dataclasses import replace

import msgspec
import numpy as np

from motm_twin.model.geometry import frozen
from motm_twin.model.known import KnownWorld
from motm_twin.model.profile import RobotProfile
from motm_twin.model.reason import Kind, Reason
from motm_twin.perception.world_map import WorldMap
from motm_twin.planning.collision import body_of
from motm_twin.planning.commitment import KeepPlans
from motm_twin.planning.controller import StaaController
from motm_twin.planning.evasion import MakesWay
from motm_twin.planning.every_ring import EveryRing
from motm_twin.planning.in_time import InTime
from motm_twin.planning.parameters import PlanningParameters
from motm_twin.planning.placement import NextTargetPlacement
from motm_twin.planning.types import (
    BasePlan,
    BaseProblem,
    Mode,
    Placement,
    PlanStatus,
    SearchBudget,
    Target,
    no_placement,
)


def warm_up_placement() -> Placement:
    """Compile the kernels of base placement and global paths, also those for places beside obstacles that may move."""
    problem = _problem()
    placement = NextTargetPlacement(RobotProfile(), PlanningParameters())
    crowd = np.array([[x, y] for x in np.arange(0.8, 3.2, 0.2) for y in np.arange(-1.2, 1.3, 0.2)])
    distance = np.zeros_like(problem.world.distance)
    distance[:, :20] = 1.0
    crowded = msgspec.structs.replace(
        problem.world, seen_points=frozen(crowd), seen_static=np.zeros(len(crowd), dtype=bool), distance=distance
    )
    placement.place(msgspec.structs.replace(problem, world=crowded))
    return placement.place(problem)


def warm_up_search() -> None:
    """Compile the local search."""
    problem = _problem()
    goal = np.array([2.0, -0.6, 0.0])
    one = np.ones(1)
    placement = Placement(
        mode=Mode.RING, radius=0.6, poses=goal[None], cost_current=one, cost_next=one, cost=one, chosen=0,
        rejected=("",),
        goal=goal, goal_has_heading=True, next_goal=goal + 1.0, next_goals=goal[None] + 1.0,
        why=Reason(kind=Kind.DRIVE),
    )  # fmt: skip
    controller = StaaController(RobotProfile(), PlanningParameters())
    controller.plan(problem, placement, SearchBudget(expansions=8))
    too_fast = msgspec.structs.replace(problem, pose=np.array([1.25, 0.0, 0.0]), twist=np.array([0.5, 0.0]))
    assert controller.plan(too_fast, placement, SearchBudget(expansions=8)).status == PlanStatus.BRAKING
    away = msgspec.structs.replace(placement, goal=np.array([-1.0, 0.0, 0.0]))
    before_the_box = msgspec.structs.replace(problem, pose=np.array([1.25, 0.0, 0.0]))
    committed = StaaController(RobotProfile(), PlanningParameters(), commitment=KeepPlans())
    for _ in range(2):  # in a tight place; the second call keeps the first plan, which does not arrive
        committed.plan(before_the_box, away, SearchBudget(expansions=4))


def warm_up_foresight() -> BasePlan:
    """Compile the kernels for planning among dynamic obstacles: candidates in time, the longer search, and waiting."""
    robot, parameters = RobotProfile(), PlanningParameters()
    staa = replace(parameters.staa, risk_weight=10.0, courtesy_weight=2.0)
    parameters = replace(parameters, staa=staa)
    problem = _problem()
    rows = [[0.8, 0.5, 0.0, -0.5, 0.25, 0.03, 1.0], [2.0, 0.9, 0.0, -0.3, 0.25, 0.03, 2.0]]
    crossing = frozen(np.array(rows))
    problem = msgspec.structs.replace(problem, world=msgspec.structs.replace(problem.world, tracks=crossing))
    in_time = InTime(EveryRing(), robot.base.velocity_lag)
    placement = NextTargetPlacement(robot, parameters, candidates=in_time).place(problem)
    controller = StaaController(robot, parameters, commitment=KeepPlans())
    controller.plan(problem, placement, SearchBudget(expansions=300))
    return controller.plan(problem, placement, SearchBudget(expansions=300))  # keeps to the first plan


def warm_up_evasion() -> BasePlan:
    """Compile the kernels for evading dynamic obstacles."""
    robot = RobotProfile()
    known = KnownWorld(
        robot=robot, start=(0.0, 0.0, 0.0), solids=(), objects=(), object_sd=0.0, bins=(), tasks=(),
        bounds=(-2.0, -2.0, 4.0, 2.0),
    )  # fmt: skip
    tracks = frozen(np.array([[0.9, 0.1, -0.5, 0.0, 0.25, 0.03, 1.0]]))
    problem = _problem()
    problem = msgspec.structs.replace(problem, world=msgspec.structs.replace(problem.world, tracks=tracks))
    target = msgspec.structs.replace(problem, target=None)
    idle = StaaController(robot, PlanningParameters()).plan(target, no_placement(problem.pose), SearchBudget())
    found = MakesWay(known).instead(problem, idle, body_of(robot.footprint), robot.base)
    assert found.status == PlanStatus.ESCAPING
    return found


def _problem() -> BaseProblem:
    x, y = np.meshgrid(np.arange(-2.0, 4.0, 0.05), np.arange(-2.0, 2.0, 0.05))
    distance = np.hypot(np.maximum(np.abs(x - 2.0) - 0.3, 0.0), np.maximum(np.abs(y) - 0.3, 0.0)).astype(np.float32)
    world = WorldMap(
        stamp=0.0,
        resolution=0.05,
        origin=np.array([-2.025, -2.025]),
        occupied=(distance == 0.0).astype(np.uint8),
        distance=distance,
        proximity=np.clip(1.0 - distance, 0.0, 1.0),
        polygons=(np.array([[1.7, -0.3], [2.3, -0.3], [2.3, 0.3], [1.7, 0.3]]),),
        seen_points=frozen(np.zeros((0, 2))),
        seen_static=np.zeros(0, dtype=bool),
    )
    target = Target(kind="pick", name="cube", position=np.array([2.0, 0.0]), dwell=1.0)
    after = Target(kind="place", name="bin", position=np.array([0.0, 1.0]), dwell=1.0)
    return BaseProblem(
        time=0.0, world=world, pose=np.zeros(3), twist=np.zeros(2), target=target, next_target=after, engaged=False
    )
