"""Where a local search is to go, and the numbers that it works with."""

from typing import NamedTuple

from motm_twin.model.geometry import Array
from motm_twin.model.profile import BaseLimits
from motm_twin.planning import staa, stuck
from motm_twin.planning.collision import Body
from motm_twin.planning.cost_to_go import Table
from motm_twin.planning.parameters import StaaParameters
from motm_twin.planning.search_memory import Settings
from motm_twin.planning.types import BaseProblem, Placement

FREE = (
    0.25  # [m] of clearance at the end of a node, from which on it is free half way: no point of Frankie moves so far
)


class LocalGoal(NamedTuple):
    """Where the local search is to go."""

    pose: Array  # (3,), heading nan: free
    remaining: float  # [s] from there to the goal
    table: Table  # costs to it, with `after` [s] added
    after: float  # [s] counted after the goal: the weighted way to the next target
    global_path: Array
    heading: float  # [rad] at the end of the global path, nan: free
    path_found: bool
    is_goal: bool


def search_settings(
    p: StaaParameters, limits: BaseLimits, body: Body, problem: BaseProblem, placement: Placement, goal: LocalGoal, *,
    has_next: bool, next_weight: float, bound: float, margin: float,
) -> Settings:  # fmt: skip
    """The numbers of one search. ``bound`` [s]: a plan that costs as much is of no use; ``margin`` [m] is kept."""
    by_job = p.termination == "task" and not stuck.here(problem.pose, problem.stuck_at)
    goal_test = staa.END_TEST if p.termination == "reach_goal" else staa.PASS_TEST
    if placement.mode == "closest" and goal.is_goal:
        goal_test = staa.END_TEST
    elif by_job and goal.is_goal:
        goal_test = staa.NO_GOAL_TEST
    return Settings(
        v_f=limits.forward_speed,
        v_r=limits.reverse_speed,
        w_max=limits.yaw_rate,
        a_max=limits.linear_acceleration,
        b_max=limits.yaw_acceleration,
        node_duration=p.node_duration,
        notches=p.notches,
        cell=p.cell,
        heading_bins=p.heading_bins,
        speed_bins=p.speed_bins,
        yaw_rate_bins=p.yaw_rate_bins,
        epsilon=p.epsilon,
        margin=margin,
        margin_floor=p.margin_floor,
        margin_cost=p.margin_cost,
        brake_depth=p.brake_depth,
        free=max(FREE, 0.5 * p.node_duration * (limits.forward_speed + body.reach * limits.yaw_rate)),
        grid_weight=p.grid_weight,
        grid_range=p.grid_range,
        grid_map=p.penalty == "grid",
        k_min=p.k_min,
        k_time=p.k_time,
        scale_penalty=p.scale_penalty,
        bezier=p.bezier,
        bezier_offset=p.bezier_offset,
        goal_test=goal_test,
        pass_distance=p.pass_distance,
        pass_heading=p.pass_heading,
        goal_x=float(goal.pose[0]),
        goal_y=float(goal.pose[1]),
        goal_heading=float(goal.pose[2]),
        after_goal=goal.after,
        by_job=by_job,
        drive_on=p.drive_on,
        next_weight=next_weight,
        has_next=has_next,
        keep_reach=problem.engaged,
        region_x=float(problem.pose[0]),
        region_y=float(problem.pose[1]),
        region_radius=p.local_radius + 1.0,
        bound=bound,
        moving_weight=p.moving_weight,
        steadiness=p.steadiness,
    )
