"""The base controller: global path, intermediate goal, STAA* search, and what to do when it finds nothing."""

import math
from collections.abc import Callable

import msgspec
import numpy as np

from motm_twin.model.geometry import Array, frozen
from motm_twin.model.profile import RobotProfile
from motm_twin.perception.floor import FRESH
from motm_twin.perception.still_map import StillMap
from motm_twin.planning import search_memory, staa
from motm_twin.planning.bezier import bezier_curve
from motm_twin.planning.braking import best_braking
from motm_twin.planning.collision import Field, body_of, clearances
from motm_twin.planning.cost_to_go import Table
from motm_twin.planning.escape import Escape, depth_of, find_escape, find_room, find_turn, overlapping_cells
from motm_twin.planning.global_path import GraphCache, leaves_disc, path_to_goal, rates_of, shortest_path
from motm_twin.planning.parameters import PlanningParameters, fitted
from motm_twin.planning.pocket import NO_POCKET
from motm_twin.planning.prediction import NOBODY, expected
from motm_twin.planning.reach import Job, ReachModel, first_in_reach, first_node_in_reach, in_reach
from motm_twin.planning.room import Room, room_for
from motm_twin.planning.rtr import path_rtr, turn
from motm_twin.planning.search_settings import LocalGoal, search_settings
from motm_twin.planning.types import BasePlan, BaseProblem, Placement, SearchBudget, Target, empty_path
from motm_twin.planning.visibility import Graph

CLOCK_CHUNK = 32  # expansions between two looks at the clock
STILL_V = 1e-3  # [m/s]
ESCAPING = "escaping"  # status of a plan that leaves an overlap


class StaaController:
    """STAA* (Paper, Sec. III) from the robot's pose and twist towards the placement's goal, and on to the next."""

    def __init__(
        self,
        profile: RobotProfile,
        parameters: PlanningParameters,
        *,
        clock: Callable[[], float] | None = None,
        graphs: GraphCache | None = None,
        still: StillMap | None = None,
    ) -> None:
        """``still`` gives the map without what moves: needed where that is to be expected on its course."""
        if parameters.staa.prediction > 0.0 and still is None:
            raise ValueError("to predict what moves, the controller needs the map without it: give `still`")
        self._still = still
        self._profile = profile
        self._limits = profile.base
        self._parameters, self._p = parameters, fitted(parameters.staa, profile)
        self._next_weight = parameters.placement.next_weight
        self._reach = ReachModel(profile, parameters.reach)
        self._body = body_of(profile.footprint)
        self._clock = clock
        self._graphs = graphs or GraphCache()
        self._rates = rates_of(profile.base)
        self._global_rates = rates_of(profile.base, rotation_cost=parameters.staa.rotation_cost)
        self._asked: tuple[BaseProblem, Placement] | None = None  # only to explain the last period
        self._memory: search_memory.Memory | None = None
        self._cells: tuple[Graph, tuple[float, ...], search_memory.CellSights] | None = None

    def plan(self, problem: BaseProblem, placement: Placement, budget: SearchBudget) -> BasePlan:
        """How to accelerate in this period."""
        target = problem.target
        field = self._graphs.field(problem.world)
        self._asked = None
        if target is None or placement.mode == "none":
            return self._idle(problem, field, "there is nothing to do")
        self._asked = (problem, placement)
        if self._overlap_depth(problem, field) > problem.world.resolution:
            return self._escape(problem, field)
        room = self._margins(problem)
        graph = self._graphs.graph(problem.world, room.growth)
        goal = self._local_goal(problem, placement, graph)
        if placement.chosen < 0:
            return self._brake(problem, field, placement.reason, goal, 0)
        if placement.mode == "closest" and self._at(problem.pose, placement):
            return self._idle(problem, field, placement.reason.replace("driving to", "waiting at"))
        next_table = self._next_table(graph, placement)
        settings = search_settings(
            self._p, self._limits, self._body, problem, placement, goal, has_next=next_table is not None,
            next_weight=self._next_weight, bound=self._bound(), margin=room.margin,
        )  # fmt: skip
        still, proximity, moving = self._ahead(problem)
        world = search_memory.World(
            still,
            proximity,
            self._body,
            graph,
            goal.table,
            next_table if next_table is not None else goal.table,
            self._job(problem, target),
            NO_POCKET,
            self._sight(problem),
            moving,
        )
        cells = self._cell_sights(graph, field)
        memory = self._room(budget.expansions, graph)
        world = world._replace(pocket=self._pocket(problem, settings, world, cells, memory))
        left = self._left(target)
        pose, twist = np.array(problem.pose, dtype=np.float64), np.array(problem.twist, dtype=np.float64)
        staa.start_search(pose, twist, left, memory)
        status, cut = self._search(budget, settings, world, cells, memory)
        solution = int(memory.count[search_memory.SOLUTION])
        expansions = int(memory.count[search_memory.EXPANSIONS])
        if not goal.path_found:
            why = f"no way to {target.name}: every gap on it is narrower than {2.0 * room.growth:.2f} m"
            return self._brake(problem, field, why, goal, expansions, cut=cut)
        if solution < 0 and settings.bound == math.inf:
            if self._overlap_depth(problem, field) > 0.0:
                return self._escape(problem, field)
            why = self._no_motion(problem, target, field, expansions)
            return self._brake(problem, field, why, goal, expansions, cut=cut)
        branch = search_memory.branch_to(memory, max(solution, 0))
        poses = memory.state[branch]
        t_h = self._time_to_goal(problem, world.job, settings, goal)
        return BasePlan(
            acceleration=frozen(search_memory.first_action(memory, branch, self._p.node_duration)),
            status="goal" if status == staa.GOAL else "aborted",
            reason="",
            global_path=frozen(goal.global_path),
            next_path=frozen(self._next_path(placement, graph, next_table)),
            intermediate_goal=frozen(goal.pose),
            local_poses=frozen(poses),
            local_times=frozen(np.arange(len(branch)) * self._p.node_duration),
            local_to_go=frozen(search_memory.to_go(memory, branch)),
            bezier=frozen(self._bezier(poses[-1], settings, bool(memory.passed[branch[-1]]))),
            expansions=expansions,
            cut_by_clock=cut,
            t_h=t_h,
            k=self._k(t_h),
            time_to_range=self._time_to_range(poses, world.job, graph, goal),
        )

    def _ahead(self, problem: BaseProblem) -> tuple[Field, Field, Array]:
        """What the search goes through: distances and STAA*'s grid of what stands, and discs of what moves."""
        world, moving, grid = problem.world, NOBODY, self._p.penalty == "grid"
        proximity = world.proximity
        if self._p.prediction > 0.0 and self._still is not None and len(world.movers):
            moving = expected(world.movers, self._p.node_duration, self._p.prediction)
            world = self._still.of(world)
            proximity = self._still.proximity(world) if grid else proximity
        field = self._graphs.field(world)
        return field, field._replace(value=np.array(proximity, dtype=np.float32)) if grid else field, moving

    def _margins(self, problem: BaseProblem) -> Room:
        """The room that plans of this period keep."""
        return room_for(self._parameters, self._profile.footprint, problem.recovery.tightness)

    def _sight(self, problem: BaseProblem) -> search_memory.Sight:
        """The floor that has been seen, for a lidar that does not see all round."""
        floor, lidar = problem.world.floor, self._profile.lidar
        if floor is None:
            return search_memory.SEES_ALL
        return search_memory.Sight(
            floor.seen, *floor.corner, 1.0 / floor.resolution, FRESH, 0.5 * lidar.field_of_view, lidar.x, lidar.y
        )

    def _bound(self) -> float:
        """What a plan must cost less than [s], to be of use. The paper knows none."""
        return math.inf

    def _pocket(
        self,
        problem: BaseProblem,
        s: search_memory.Settings,
        world: search_memory.World,
        cells: search_memory.CellSights,
        memory: search_memory.Memory,
    ) -> search_memory.Pocket:
        """The costs of leaving the place where the robot is, where PathRTR does not know them. The paper has none."""
        return NO_POCKET

    def staa_path(self) -> Array:
        """The path of `unmodified_path` in the last period, shape (m, 2) [m]; empty when there was no target."""
        return empty_path() if self._asked is None else self.unmodified_path(*self._asked)

    def unmodified_path(self, problem: BaseProblem, placement: Placement) -> Array:
        """The global path that unmodified STAA* would take to the same goal, shape (m, 2) [m]."""
        graph = self._graphs.graph(problem.world, self._margins(problem).growth)
        return frozen(shortest_path(graph, problem.pose, placement.goal, self._limits))

    def _search(
        self,
        budget: SearchBudget,
        s: search_memory.Settings,
        world: search_memory.World,
        cells: search_memory.CellSights,
        memory: search_memory.Memory,
    ) -> tuple[int, bool]:
        """Run to the expansion limit, or until the clock says stop: status and whether the clock did."""
        if budget.seconds is None or self._clock is None:
            return staa.run_search(budget.expansions, s, world, cells, memory), False
        end = self._clock() + budget.seconds
        limit = 0
        while True:
            limit = min(budget.expansions, limit + CLOCK_CHUNK)
            status = staa.run_search(limit, s, world, cells, memory)
            if status != staa.ABORTED or limit == budget.expansions:
                return status, False
            if self._clock() >= end:
                return status, True

    def _local_goal(self, problem: BaseProblem, placement: Placement, graph: Graph) -> LocalGoal:
        """The goal itself when it is in the local region, else where the global path leaves it."""
        goal = np.array(placement.goal, dtype=np.float64)
        if not (self._p.goal_orientation and placement.goal_has_heading):
            goal[2] = math.nan
        after = 0.0
        if self._p.drive_on and placement.chosen >= 0 and math.isfinite(placement.cost_next[placement.chosen]):
            after = self._next_weight * float(placement.cost_next[placement.chosen])
        table = self._graphs.table(graph, goal, self._global_rates)
        path, in_reverse = path_to_goal(graph, table, problem.pose)
        leaves = leaves_disc(path, self._p.local_radius)
        if leaves is None:
            local = self._graphs.table(graph, goal, self._rates, np.array([after]))
            return LocalGoal(goal, 0.0, local, after, path, float(goal[2]), len(path) > 1, True)
        segment, place = leaves
        step = path[segment + 1] - path[segment]
        heading = math.atan2(step[1], step[0]) + (math.pi if in_reverse else 0.0)
        rest = np.vstack((place, path[segment + 1 :]))
        remaining = path_rtr(
            rest, heading, None if math.isnan(goal[2]) else float(goal[2]),
            v_f=self._limits.forward_speed, v_r=self._limits.reverse_speed, w_max=self._limits.yaw_rate,
        )  # fmt: skip
        pose = np.array([place[0], place[1], heading if self._p.goal_orientation else math.nan])
        local = self._graphs.table(graph, pose, self._rates, np.array([after + remaining]))
        return LocalGoal(pose, remaining, local, after, path, float(goal[2]), True, False)

    def _next_table(self, graph: Graph, placement: Placement) -> Table | None:
        poses = placement.next_goals
        if poses is None:
            if placement.next_goal is None:
                return None
            given = placement.next_goal
            poses = np.array([[given[0], given[1], given[2] if len(given) > 2 else math.nan]])
        order = np.lexsort((poses[:, 1], poses[:, 0]))
        return self._graphs.table(graph, poses[order], self._rates)

    def _cell_sights(self, graph: Graph, field: Field) -> search_memory.CellSights:
        grid = (field.x, field.y, field.inverse_cell, *field.value.shape)
        graph_of, grid_of, cells = self._cells or (None, None, None)
        if cells is None or len(cells.age) < field.value.size:
            cells = search_memory.make_cell_sights(field.value.size)
        elif graph_of is graph and grid_of == grid:
            return cells
        search_memory.empty_sights(cells, field)
        self._cells = (graph, grid, cells)
        return cells

    def _room(self, expansions: int, graph: Graph) -> search_memory.Memory:
        needed = expansions * self._p.notches**2 + 2
        memory = self._memory
        if memory is None or len(memory.cost) < needed or len(memory.scratch) <= len(graph.vertex):
            memory = search_memory.make_memory(expansions, self._p.notches, 2 * len(graph.vertex))
            self._memory = memory
        return memory

    def _job(self, problem: BaseProblem, target: Target) -> Job:
        """The target, with a reach that is a little smaller unless the robot is at its limit already."""
        whole = self._reach.job(target, self._p, engaged=problem.engaged)
        inner = self._reach.job(target, self._p, engaged=problem.engaged, slack=self._reach.parameters.plan_slack)
        now = [float(value) for value in (*problem.pose, *problem.twist)]
        return whole if in_reach(*now, whole) and not in_reach(*now, inner) else inner

    def _left(self, target: Target) -> float:
        return max(target.dwell, 0.05) if target.kind != "drive" else 1.0

    def _time_to_goal(self, problem: BaseProblem, job: Job, s: search_memory.Settings, goal: LocalGoal) -> float:
        """t_h [s]: PathRTR of the whole global path, 0 while the target is in reach."""
        if s.by_job and in_reach(*(float(value) for value in (*problem.pose, *problem.twist)), job):
            return 0.0
        return path_rtr(
            goal.global_path, float(problem.pose[2]), None if math.isnan(goal.heading) else goal.heading,
            v_f=self._limits.forward_speed, v_r=self._limits.reverse_speed, w_max=self._limits.yaw_rate,
        )  # fmt: skip

    def _k(self, t_h: float) -> float:
        return proximity_scale(t_h, self._p.k_min, self._p.k_time) if self._p.scale_penalty else 1.0

    def _at(self, pose: Array, placement: Placement) -> bool:
        near = math.hypot(pose[0] - placement.goal[0], pose[1] - placement.goal[1]) <= self._p.pass_distance
        return near and (not placement.goal_has_heading or turn(pose[2], placement.goal[2]) <= self._p.pass_heading)

    def _no_motion(self, problem: BaseProblem, target: Target, field: Field, expansions: int) -> str:
        if problem.engaged:
            return f"no motion of the base keeps {target.name} in reach of the arm: braking"
        room = float(clearances(np.array(problem.pose, dtype=np.float64)[None], 1.0, field, self._body)[0])
        return (
            f"no collision-free motion towards {target.name} ({expansions} tried, {room:.2f} m of clearance): braking"
        )

    def _overlap_depth(self, problem: BaseProblem, field: Field) -> float:
        """Depth [m] of the deepest occupied cell inside the footprint; negative or 0 when none is."""
        pose = np.array(problem.pose, dtype=np.float64)
        if clearances(pose[None], 1.0, field, self._body)[0] >= problem.world.resolution:
            return 0.0
        cells = overlapping_cells(problem.world, pose, self._body)
        return depth_of(cells, pose, self._body) + 0.5 * problem.world.resolution

    def _escape(self, problem: BaseProblem, field: Field) -> BasePlan:
        """Leave what the footprint overlaps, or stand."""
        deep = f"the base overlaps what the map or the lidar shows by {self._overlap_depth(problem, field):.2f} m"
        found = find_escape(problem.world, np.array(problem.pose, dtype=np.float64), self._body, self._limits)
        if found is None:
            return self._stop(problem, field, "braking", f"{deep}, and no motion makes that less: standing", None, 0)
        return self._along(problem, found, self._stop(problem, field, ESCAPING, "", None, 0), f"{deep}: backing out")

    def _along(self, problem: BaseProblem, found: Escape, plan: BasePlan, reason: str) -> BasePlan:
        """A plan that holds the twist of an escape."""
        most = np.array([self._limits.linear_acceleration, self._limits.yaw_acceleration])
        twists = np.broadcast_to(found.twist, (len(found.poses), 2))
        return msgspec.structs.replace(
            plan,
            status=ESCAPING,
            reason=reason,
            acceleration=frozen(np.clip((found.twist - problem.twist) / problem.period, -most, most)),
            local_poses=frozen(np.column_stack((found.poses, twists))),
            local_times=frozen(found.times),
        )

    def _next_path(self, placement: Placement, graph: Graph, table: Table | None) -> Array:
        return empty_path() if table is None else path_to_goal(graph, table, placement.goal)[0]

    def _bezier(self, last: Array, s: search_memory.Settings, finished: bool) -> Array:
        if finished or not s.bezier or math.isnan(s.goal_heading):
            return empty_path()
        goal = np.array([s.goal_x, s.goal_y, s.goal_heading])
        return bezier_curve(last[:3], goal, offset=s.bezier_offset)

    def _time_to_range(self, poses: Array, job: Job, graph: Graph, goal: LocalGoal) -> float:
        """When the target comes into reach: in the local plan, else on the path that follows it [s]."""
        dt = self._p.node_duration
        reached = first_node_in_reach(poses, dt, job)
        if reached < math.inf:
            return reached * dt
        start = (len(poses) - 1) * dt
        path, in_reverse = path_to_goal(graph, goal.table, poses[-1, :3])
        if not goal.is_goal:
            path = np.vstack((path, goal.global_path[-1:]))
        return start + self._time_along(path, float(poses[-1, 2]), in_reverse, job)

    def _time_along(self, path: Array, heading: float, in_reverse: bool, job: Job) -> float:
        """Time [s] along a path, with its turns, until the target is in reach; inf when it never is."""
        time = 0.0
        speed = self._limits.reverse_speed if in_reverse else self._limits.forward_speed
        for i in range(1, len(path)):
            step = path[i] - path[i - 1]
            length = math.hypot(step[0], step[1])
            if length < 1e-9:
                continue
            facing = math.atan2(step[1], step[0]) + (math.pi if in_reverse else 0.0)
            time += turn(heading, facing) / self._limits.yaw_rate
            heading = facing
            way = first_in_reach(path[i - 1], step, length, facing, job)
            if way < math.inf:
                return time + way / speed
            time += length / speed
        return time

    def _idle(self, problem: BaseProblem, field: Field, reason: str) -> BasePlan:
        return self._stop(problem, field, "idle", reason, None, 0)

    def _brake(
        self, problem: BaseProblem, field: Field, reason: str, goal: LocalGoal, expansions: int, *, cut: bool = False
    ) -> BasePlan:
        plan = self._stop(problem, field, "braking", reason, goal, expansions, cut=cut)
        found = self._recovered(problem, field)
        if found is None:
            return plan
        what = "backing off to where there is more room" if found.twist[0] != 0.0 else "turning to see more"
        return self._along(problem, found, plan, f"{reason}; {what}")

    def _recovered(self, problem: BaseProblem, field: Field) -> Escape | None:
        """A motion of a robot that has made no progress for some time, and stands."""
        recovery, pose = problem.recovery, np.array(problem.pose, dtype=np.float64)
        if recovery.back_off:
            return find_room(pose, field, self._body, self._limits, self._p.margin_floor)
        if recovery.look and 0.5 * self._profile.lidar.field_of_view < staa.ALL_ROUND:
            return find_turn(pose, field, self._body, self._limits, self._p.margin_floor)
        return None

    def _stop(
        self, problem: BaseProblem, field: Field, status: str, reason: str, goal: LocalGoal | None, expansions: int,
        *, cut: bool = False,
    ) -> BasePlan:  # fmt: skip
        """Brake to rest; when the straight way to rest comes too near to something, steer to where it does not."""
        pose, twist = np.array(problem.pose, dtype=np.float64), np.array(problem.twist, dtype=np.float64)
        most = np.array([self._limits.linear_acceleration, self._limits.yaw_acceleration])
        acceleration = np.clip(-twist / problem.period, -most, most)
        if status == "braking" and abs(twist[0]) > STILL_V:
            acceleration[1], _ = best_braking(
                pose, twist, self._limits.yaw_rate, most[0], most[1], self._p.notches, field, self._body
            )
            if abs(twist[1]) < most[1] * problem.period and acceleration[1] * twist[1] < 0.0:
                acceleration[1] = -twist[1] / problem.period
        here = np.array([[*pose, *twist]])
        return BasePlan(
            acceleration=frozen(acceleration),
            status=status,
            reason=reason,
            global_path=frozen(empty_path() if goal is None else goal.global_path),
            next_path=empty_path(),
            intermediate_goal=frozen(pose if goal is None else goal.pose),
            local_poses=frozen(here),
            local_times=frozen(np.zeros(1)),
            bezier=empty_path(),
            expansions=expansions,
            cut_by_clock=cut,
            t_h=0.0 if status == "idle" else math.inf,
            k=self._k(0.0 if status == "idle" else math.inf),
            time_to_range=math.inf,
        )


def proximity_scale(t_h: float, k_min: float = 0.1, k_time: float = 3.0) -> float:
    """k = max(0.1, min(t_h / 3, 1)): scale of the proximity penalty t_h [s] before the goal (Paper, Sec. III-D)."""
    return max(k_min, min(t_h / k_time, 1.0))
