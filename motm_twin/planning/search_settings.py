"""Goal and settings of a local search, with the choice of its goal test (Paper, Sec. III-C)."""

import dataclasses
from typing import NamedTuple

from motm_twin.model.geometry import Array
from motm_twin.model.profile import BaseLimits
from motm_twin.planning import staa
from motm_twin.planning.candidates import is_avoided
from motm_twin.planning.collision import Body, Field
from motm_twin.planning.cost_to_go import Table
from motm_twin.planning.encounters import Weights
from motm_twin.planning.parameters import ForesightParameters, Room, StaaParameters
from motm_twin.planning.prediction import LONGEST, SPREAD
from motm_twin.planning.search_memory import Settings
from motm_twin.planning.types import BaseProblem, Mode, Placement, Target
from motm_twin.planning.visibility import Graph

# [m] A node with this clearance at its end is free half way, too: no point of Frankie moves so far in between.
FREE = 0.25
# Settings that are parameters, unchanged; the margin is that of the period's `Room`, which may be less.
_SHARED = {each.name for each in dataclasses.fields(StaaParameters)} & set(Settings._fields) - {"margin"}


# A search among dynamic obstacles looks farther ahead, with nodes that are longer by a factor, and fewer accelerations.
NOTCHES = 3


class LocalGoal(NamedTuple):
    """The goal of a local search, and of the global path beyond it."""

    pose: Array  # (3,), heading nan: free
    remaining: float  # [s] from there to the goal
    table: Table  # costs to it, with `after` [s] added
    after: float  # [s] counted after the goal: the weighted way to the next target
    global_path: Array
    heading: float  # [rad] at the end of the global path, nan: free
    path_found: bool
    is_goal: bool


class Question(NamedTuple):
    """Inputs of a local search: one period of the base controller that has a goal."""

    problem: BaseProblem
    placement: Placement
    target: Target
    field: Field
    room: Room
    graph: Graph
    goal: LocalGoal
    next_table: Table | None


def weights_among(p: StaaParameters) -> Weights:
    """Weights of the cost of a node among dynamic obstacles."""
    return Weights(p.risk_weight, p.courtesy_weight * p.node_duration, SPREAD)


def far_sighted(s: Settings, bound: float, foresight: ForesightParameters, longest: float) -> Settings:
    """The settings of a search that looks farther ahead, among dynamic obstacles at their predicted places.

    ``longest`` [s]: largest duration of a node.
    """
    node = min(foresight.longer * s.node_duration, longest)
    return s._replace(
        node_duration=node, free=foresight.longer * s.free, notches=NOTCHES, cell=foresight.longer**2 * s.cell,
        heading_bins=(s.heading_bins + 1) // 2, epsilon=1.0, layers=round(LONGEST / node), width=foresight.width,
        bound=bound,
    )  # fmt: skip


def search_settings(
    p: StaaParameters, limits: BaseLimits, body: Body, asked: Question, *, next_weight: float, bound: float,
    among: Weights,
) -> Settings:  # fmt: skip
    """The settings of one search, goal test included; ``bound`` [s]: a plan that costs as much is of no use."""
    problem, goal = asked.problem, asked.goal
    by_job = p.termination == "task" and not is_avoided(problem.pose, problem.stuck_at)
    goal_test = staa.END_TEST if p.termination == "reach_goal" else staa.PASS_TEST
    if asked.placement.mode == Mode.CLOSEST and goal.is_goal:
        goal_test = staa.END_TEST
    elif by_job and goal.is_goal:
        goal_test = staa.NO_GOAL_TEST
    return Settings(
        **{name: getattr(p, name) for name in _SHARED},
        v_f=limits.forward_speed,
        v_r=limits.reverse_speed,
        w_max=limits.yaw_rate,
        a_max=limits.linear_acceleration,
        b_max=limits.yaw_acceleration,
        margin=asked.room.margin,
        free=max(FREE, 0.5 * p.node_duration * (limits.full_speed + body.reach * limits.yaw_rate)),
        grid_map=p.penalty == "grid",
        goal_test=goal_test,
        goal_x=float(goal.pose[0]),
        goal_y=float(goal.pose[1]),
        goal_heading=float(goal.pose[2]),
        after_goal=goal.after,
        by_job=by_job,
        next_weight=next_weight,
        has_next=asked.next_table is not None,
        keep_reach=problem.engaged,
        region_x=float(problem.pose[0]),
        region_y=float(problem.pose[1]),
        region_radius=p.local_radius + 1.0,
        bound=bound,
        among=among,
        layers=0,
        width=0,
    )
