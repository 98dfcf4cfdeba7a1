"""The local search does not back over floor that the lidar will not have seen by then."""

import math

import msgspec
import numpy as np

from motm_twin.model.profile import Lidar, RobotProfile
from motm_twin.model.reason import Kind, Reason
from motm_twin.perception.floor import FRESH, UNSEEN, Floor
from motm_twin.perception.world_map import WorldMap
from motm_twin.planning.controller import StaaController
from motm_twin.planning.parameters import PlanningParameters
from motm_twin.planning.types import NO_RECOVERY, BaseProblem, Placement, PlanStatus, Recovery, SearchBudget, Target


def plan_to(goal, profile, rear, recovery=NO_RECOVERY):
    """The plan on empty floor of which the part behind the robot is ``rear``."""
    distance = np.full((120, 120), 3.0, np.float32)
    seen = np.full((60, 60), FRESH, np.uint8)
    seen[:, :22] = rear  # behind x = -0.4 m
    world = WorldMap(
        stamp=0.0, resolution=0.05, origin=np.array([-3.0, -3.0]), occupied=np.zeros((120, 120), np.uint8),
        distance=distance, proximity=np.zeros_like(distance), polygons=(), seen_points=np.zeros((0, 2)),
        seen_static=np.zeros(0, bool), floor=Floor(corner=(-1.5, -1.5), resolution=0.05, seen=seen),
    )  # fmt: skip
    world.floor.seen.setflags(write=False)
    one = np.ones(1)
    placement = Placement(
        mode="drive", radius=0.0, poses=goal[None], cost_current=one, cost_next=one, cost=one, rejected=("",), chosen=0,
        goal=goal, goal_has_heading=False, why=Reason(kind=Kind.DRIVE), next_goal=None,
    )  # fmt: skip
    target = Target(kind="drive", name="goal", position=goal[:2])
    problem = BaseProblem(
        time=0.0, world=world, pose=np.zeros(3), twist=np.zeros(2), target=target, next_target=None, engaged=False,
        recovery=recovery,
    )  # fmt: skip
    return StaaController(profile, PlanningParameters()).plan(problem, placement, SearchBudget(expansions=300))


def test_a_base_with_a_lidar_in_front_does_not_plan_to_back_into_the_unknown():
    goal = np.array([-0.6, 0.0, math.nan])
    front = msgspec.structs.replace(RobotProfile(), lidar=Lidar(x=0.3, field_of_view=math.radians(270.0)))
    assert plan_to(goal, front, FRESH).local_poses[:, 3].min() < -0.05
    assert plan_to(goal, RobotProfile(), UNSEEN).local_poses[:, 3].min() < -0.05  # it sees all round
    poses = plan_to(goal, front, UNSEEN).local_poses
    backwards = poses[poses[:, 3] < -1e-9]
    assert (backwards[:, 0] - 0.35 * np.cos(backwards[:, 2]) > -0.45).all()


def test_a_base_that_stands_although_there_is_a_way_turns_to_see_it():
    """It turned only where the planner found no way, and not where the monitor held it: it stood until it gave up."""
    goal, held = np.array([2.0, 0.0, math.nan]), Recovery(look=True, attempt=1)
    narrow = msgspec.structs.replace(RobotProfile(), lidar=Lidar(field_of_view=math.radians(90.0)))
    looks = plan_to(goal, narrow, FRESH, held)
    assert looks.status == PlanStatus.ESCAPING and looks.why.kind == Kind.TURNS_TO_SEE
    assert looks.acceleration[0] == 0.0 and looks.acceleration[1] != 0.0
    assert plan_to(goal, narrow, FRESH, Recovery(look=True)).acceleration[0] > 0.0  # it does not stand
    assert plan_to(goal, RobotProfile(), FRESH, held).acceleration[0] > 0.0  # it sees all round
