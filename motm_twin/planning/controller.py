"""The base controller: global path, intermediate goal, STAA* search, and fallbacks when it finds nothing."""

import math
from collections.abc import Callable

import msgspec
import numpy as np

from motm_twin.model.geometry import Array, frozen
from motm_twin.model.profile import RobotProfile
from motm_twin.model.reason import Kind, Reason
from motm_twin.perception.floor import FRESH
from motm_twin.perception.still_map import StaticMap
from motm_twin.perception.tracks import IDENTITY
from motm_twin.planning import search_memory, staa
from motm_twin.planning.bezier import bezier_curve
from motm_twin.planning.collision import Field, body_of, clearances
from motm_twin.planning.commitment import Commitment, SearchAnew, time_left
from motm_twin.planning.cost_to_go import Table
from motm_twin.planning.encounters import GOES_ON, WORTH, costs_along, others_of
from motm_twin.planning.escape import Escape, depth_of, find_escape, find_turn, overlapping_cells, ways_to_room
from motm_twin.planning.evasion import Evasion, StandsItsGround
from motm_twin.planning.global_path import GraphCache, leaves_disc, path_to_goal, rates_of, shortest_path
from motm_twin.planning.lattice import NO_LATTICE
from motm_twin.planning.parameters import PlanningParameters, Room, fitted, longest_node, room_for
from motm_twin.planning.prediction import NOBODY, expected
from motm_twin.planning.reach import Job, ReachModel, first_in_reach, first_node_in_reach, in_reach
from motm_twin.planning.rtr import path_rtr, turn
from motm_twin.planning.search_settings import (
    LocalGoal,
    Question,
    far_sighted,
    search_settings,
    weights_among,
)
from motm_twin.planning.types import (
    BasePlan,
    BaseProblem,
    Mode,
    Placement,
    PlanStatus,
    SearchBudget,
    Target,
    empty_path,
)
from motm_twin.planning.visibility import Graph
from motm_twin.planning.waiting import Among, best_wait

CLOCK_CHUNK = 32  # expansions between two readings of the clock


class StaaController:
    """STAA* (Paper, Sec. III) from the robot's pose and twist towards the placement's goal, and on to the next."""

    def __init__(
        self,
        profile: RobotProfile,
        parameters: PlanningParameters,
        *,
        clock: Callable[[], float] | None = None,
        graphs: GraphCache | None = None,
        still: StaticMap | None = None,
        commitment: Commitment | None = None,
        evasion: Evasion | None = None,
    ) -> None:
        """``still`` gives the map without dynamic obstacles: needed if their motion is to be predicted.

        ``commitment``: policy for the plan of the last period; None: every period searches anew, as in the paper.
        ``evasion``: policy for dynamic obstacles that come too near; None: no evasion, as in the paper.
        """
        if parameters.staa.prediction > 0.0 and still is None:
            raise ValueError("to predict what moves, the controller needs the map without it: give `still`")
        self.profile, self.limits = profile, profile.base
        self.parameters = fitted(parameters.staa, profile)
        self.body = body_of(profile.footprint)
        self.reach = ReachModel(profile, parameters.reach)
        self.commitment: Commitment = commitment or SearchAnew()
        self.evasion: Evasion = evasion or StandsItsGround()
        self._all_parameters, self._next_weight = parameters, parameters.placement.next_weight
        self._still, self._clock = still, clock
        self._graphs = graphs or GraphCache()
        self._rates = rates_of(profile.base)
        self._global_rates = rates_of(profile.base, rotation_cost=parameters.staa.rotation_cost)
        self._asked: tuple[BaseProblem, Placement] | None = None  # only to explain the last period
        self._memory: search_memory.Memory | None = None
        self._far: search_memory.Memory | None = None  # of searches that look farther ahead
        self._cells: tuple[Graph, tuple[float, ...], search_memory.CellVisibility] | None = None

    def plan(self, problem: BaseProblem, placement: Placement, budget: SearchBudget) -> BasePlan:
        """Choose how to accelerate in this period."""
        rest = self.commitment.rest(problem, placement, self)
        found, informed = self._find(problem, placement, budget, math.inf if rest is None else rest.bound)
        plan = self.commitment.choose(problem, found, rest, informed=informed)
        return self.evasion.instead(problem, plan, self.body, self.limits)

    def _find(
        self, problem: BaseProblem, placement: Placement, budget: SearchBudget, bound: float
    ) -> tuple[BasePlan, bool]:
        """A plan that costs less than ``bound`` [s], and True if its search had the lattice costs of a tight place."""
        target = problem.target
        field = self._graphs.field(problem.world)
        self._asked = None
        if target is None or placement.mode == Mode.NONE:
            return self._idle(problem, Reason(kind=Kind.NOTHING_TO_DO)), False
        self._asked = (problem, placement)
        if self._overlap_depth(problem, field) > problem.world.resolution:
            return self._escape(problem, field), False
        room = self.room(problem)
        graph = self._graphs.graph(problem.world, room.growth)
        goal = self._local_goal(problem, placement, graph)
        if placement.chosen < 0:
            return self._brake(problem, field, placement.why, goal, 0), False
        if placement.mode == Mode.CLOSEST and self.at_goal(problem.pose, placement):
            return self._idle(problem, _arrived(placement.why)), False
        recovers = self._held_up(problem, target, field)
        if recovers is not None:
            return recovers, False
        next_table = self._next_table(graph, placement)
        asked = Question(problem, placement, target, field, room, graph, goal, next_table)
        return self._search(asked, budget, bound)

    def _search(self, asked: Question, budget: SearchBudget, bound: float) -> tuple[BasePlan, bool]:
        """Run the local search; returns its plan, or one that brakes or leaves an overlap."""
        problem, goal, field = asked.problem, asked.goal, asked.field
        settings = search_settings(
            self.parameters, self.limits, self.body, asked, next_weight=self._next_weight, bound=bound,
            among=weights_among(self.parameters),
        )  # fmt: skip
        still, proximity, moving = self.ahead(problem)
        job = self.job(problem, asked.target)
        world = search_memory.World(
            still, proximity, self.body, asked.graph, goal.table, asked.next_table or goal.table, job, NO_LATTICE,
            self._seen_floor(problem), moving, self.others(problem),
        )  # fmt: skip
        cells = self._cell_visibility(asked.graph, field)
        memory = self._memory_for(budget.expansions, asked.graph)
        lattice = self.commitment.lattice(problem, settings, world, cells, memory)
        informed, world = lattice is not NO_LATTICE, world._replace(lattice=lattice)
        pose, twist = np.array(problem.pose, dtype=np.float64), np.array(problem.twist, dtype=np.float64)
        staa.start_search(pose, twist, time_left(asked.target), memory)
        status, cut = self._run(budget, settings, world, cells, memory)
        expansions = int(memory.count[search_memory.EXPANSIONS])
        if not goal.path_found:
            widest = 2.0 * asked.room.growth
            why = Reason(kind=Kind.NO_WAY, subject=asked.target.name, limit=widest, unit="m")
            return self._brake(problem, field, why, goal, expansions, cut=cut), informed
        if int(memory.count[search_memory.SOLUTION]) < 0 and settings.bound == math.inf:
            if self._overlap_depth(problem, field) > 0.0:
                return self._escape(problem, field), informed
            why = self._no_motion(problem, asked.target, field, expansions)
            return self._brake(problem, field, why, goal, expansions, cut=cut), informed
        found = self._found(asked, settings, job, memory, arrives=status == staa.GOAL, cut=cut)
        return self._among_others(asked, found, settings, world, cells), informed

    def _among_others(
        self, asked: Question, found: BasePlan, settings: search_memory.Settings, world: search_memory.World,
        cells: search_memory.CellVisibility,
    ) -> BasePlan:  # fmt: skip
        """The plan, or, if it or the path beyond its end meets dynamic obstacles, one of a longer search or a wait."""
        arrives = found.status == PlanStatus.GOAL
        going = world.others[world.others[:, GOES_ON] > 0.0]
        if not len(going) or settings.bound < math.inf:
            return found
        among = Among(going, self.body, settings.among)
        if found.local_among[0] + self._after(asked, found, among) < WORTH:
            return found
        bound = float(found.local_to_go[0]) if arrives else math.inf
        s = far_sighted(settings, bound, self._all_parameters.foresight, longest_node(self.profile))
        if self._far is None or len(self._far.scratch) <= len(asked.graph.vertex):
            vertices = 2 * len(asked.graph.vertex)
            self._far = search_memory.make_memory(s.layers * s.width, s.notches, vertices, layered=True)
        pose, twist = (np.array(part, dtype=np.float64) for part in (asked.problem.pose, asked.problem.twist))
        staa.start_search(pose, twist, time_left(asked.target), self._far)
        status = staa.run_search(s.layers * s.width, s, world, cells, self._far)
        if int(self._far.count[search_memory.SOLUTION]) < 0:
            return found
        other = self._found(asked, s, world.job, self._far, arrives=status == staa.GOAL, cut=found.cut_by_clock)
        driven = found if arrives and found.local_to_go[0] <= other.local_to_go[0] else other
        return self._waits(asked, among, driven) or driven

    def _after(self, asked: Question, plan: BasePlan, among: Among) -> float:
        """Time [s] lost to dynamic obstacles on the path beyond the end of a plan; 0 for one that arrives."""
        if plan.status == PlanStatus.GOAL:
            return 0.0
        last = plan.local_poses[-1]
        onward, _ = path_to_goal(asked.graph, asked.goal.table, last[:3])
        return best_wait(last, onward, self.limits, among, float(plan.local_times[-1])).cost

    def _waits(self, asked: Question, among: Among, driven: BasePlan) -> BasePlan | None:
        """The plan to stand until dynamic obstacles have passed, if that is cheaper than the plan to be driven."""
        here = np.array([*asked.problem.pose, *asked.problem.twist])
        wait = best_wait(here, asked.goal.global_path, self.limits, among)
        to_go = float(driven.local_to_go[0]) + self._after(asked, driven, among)
        if wait.track < 0 or driven.t_h + asked.goal.after + wait.cost >= to_go:
            return None
        other = among.others[wait.track]
        why = Reason(
            kind=Kind.GIVES_WAY, subject=f"track {int(other[IDENTITY])}", value=math.hypot(other[2], other[3]),
            limit=wait.delay, unit="m/s",
        )  # fmt: skip
        return self._stop(asked.problem, PlanStatus.BRAKING, why, asked.goal, driven.expansions)

    def _found(
        self, asked: Question, settings: search_memory.Settings, job: Job, memory: search_memory.Memory, *,
        arrives: bool, cut: bool,
    ) -> BasePlan:  # fmt: skip
        """The plan that a search has found: to the node that ended the search, or to the best one."""
        goal, dt = asked.goal, settings.node_duration
        branch = search_memory.branch_to(memory, max(int(memory.count[search_memory.SOLUTION]), 0))
        poses = memory.state[branch]
        t_h = self._time_to_goal(asked.problem, job, settings, goal)
        return BasePlan(
            acceleration=frozen(search_memory.first_action(memory, branch, dt)),
            status=PlanStatus.GOAL if arrives else PlanStatus.ABORTED,
            global_path=frozen(goal.global_path),
            next_path=frozen(self._next_path(asked.placement, asked.graph, asked.next_table)),
            intermediate_goal=frozen(goal.pose),
            local_poses=frozen(poses),
            local_times=frozen(np.arange(len(branch)) * dt),
            local_to_go=frozen(search_memory.to_go(memory, branch)),
            local_among=self.among(asked.problem, poses, dt * np.arange(len(branch), dtype=np.float64)),
            bezier=frozen(self._bezier(poses[-1], settings, bool(memory.passed[branch[-1]]))),
            expansions=int(memory.count[search_memory.EXPANSIONS]),
            cut_by_clock=cut,
            t_h=t_h,
            k=self.penalty_scale(t_h),
            time_to_range=self._time_to_range(poses, dt, job, asked.graph, goal),
        )

    def ahead(self, problem: BaseProblem) -> tuple[Field, Field, Array]:
        """Distance field and STAA*'s grid of obstacles that the search treats as static; discs of predicted ones."""
        world, moving, grid = problem.world, NOBODY, self.parameters.penalty == "grid"
        proximity = world.proximity
        if self.parameters.prediction > 0.0 and self._still is not None and len(world.movers):
            moving = expected(world.movers, self.parameters.node_duration, self.parameters.prediction)
            world = self._still.of(world)
            proximity = self._still.proximity(world) if grid else proximity
        field = self._graphs.field(world)
        return field, field._replace(value=np.array(proximity, dtype=np.float32)) if grid else field, moving

    def others(self, problem: BaseProblem) -> Array:
        """Dynamic obstacles that cost the search something, see `others_of`; none if risk has no weight."""
        if self.parameters.risk_weight == 0.0:
            return np.zeros((0, 8))  # not a read-only one: kernels are compiled once
        return others_of(problem.world.tracks, problem.yielding, self.limits.velocity_lag)

    def among(self, problem: BaseProblem, states: Array, times: Array) -> Array:
        """Cost [s] due to dynamic obstacles from each of the states (n, 5) on, at times [s] (n,); shape (n,)."""
        others = self.others(problem)
        if not len(others):
            return frozen(np.zeros(len(states)))
        costs = costs_along(states, times, others, self.body, weights_among(self.parameters))
        return frozen(costs.sum() - np.cumsum(costs))

    def room(self, problem: BaseProblem) -> Room:
        """Growth of obstacles and clearances for the plans of this period."""
        return room_for(self._all_parameters, self.profile.footprint, problem.recovery.tightness)

    def _seen_floor(self, problem: BaseProblem) -> search_memory.SeenFloor:
        """The floor that has been seen, if the lidar does not see all round."""
        floor, lidar = problem.world.floor, self.profile.lidar
        if floor is None:
            return search_memory.SEES_ALL
        return search_memory.SeenFloor(
            floor.seen, *floor.corner, 1.0 / floor.resolution, FRESH, 0.5 * lidar.field_of_view, lidar.x, lidar.y
        )

    def staa_path(self) -> Array:
        """The path of `unmodified_path` in the last period, shape (m, 2) [m]; empty when there was no target."""
        return empty_path() if self._asked is None else self.unmodified_path(*self._asked)

    def unmodified_path(self, problem: BaseProblem, placement: Placement) -> Array:
        """The global path that unmodified STAA* would take to the same goal, shape (m, 2) [m]."""
        graph = self._graphs.graph(problem.world, self.room(problem).growth)
        return frozen(shortest_path(graph, problem.pose, placement.goal, self.limits))

    def _run(
        self,
        budget: SearchBudget,
        s: search_memory.Settings,
        world: search_memory.World,
        cells: search_memory.CellVisibility,
        memory: search_memory.Memory,
    ) -> tuple[int, bool]:
        """Run to the expansion limit or until the clock ends the search: status, and True if the clock did."""
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
        """The goal if the global path stays in the local region, else the pose where it leaves (Paper, Sec. III-A)."""
        goal = np.array(placement.goal, dtype=np.float64)
        if not (self.parameters.goal_orientation and placement.goal_has_heading):
            goal[2] = math.nan
        after = 0.0
        if self.parameters.drive_on and placement.chosen >= 0 and math.isfinite(placement.cost_next[placement.chosen]):
            after = self._next_weight * float(placement.cost_next[placement.chosen])
        table = self._graphs.table(graph, goal, self._global_rates)
        path, in_reverse = path_to_goal(graph, table, problem.pose)
        leaves = leaves_disc(path, self.parameters.local_radius)
        if leaves is None:
            local = self._graphs.table(graph, goal, self._rates, np.array([after]))
            return LocalGoal(goal, 0.0, local, after, path, float(goal[2]), len(path) > 1, True)
        segment, place = leaves
        step = path[segment + 1] - path[segment]
        heading = math.atan2(step[1], step[0]) + (math.pi if in_reverse else 0.0)
        rest = np.vstack((place, path[segment + 1 :]))
        remaining = path_rtr(
            rest, heading, None if math.isnan(goal[2]) else float(goal[2]),
            v_f=self.limits.forward_speed, v_r=self.limits.reverse_speed, w_max=self.limits.yaw_rate,
        )  # fmt: skip
        pose = np.array([place[0], place[1], heading if self.parameters.goal_orientation else math.nan])
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

    def _cell_visibility(self, graph: Graph, field: Field) -> search_memory.CellVisibility:
        grid = (field.x, field.y, field.inverse_cell, *field.value.shape)
        graph_of, grid_of, cells = self._cells or (None, None, None)
        if cells is None or len(cells.age) < field.value.size:
            cells = search_memory.make_cell_visibility(field.value.size)
        elif graph_of is graph and grid_of == grid:
            return cells
        search_memory.forget_visibility(cells, field)
        self._cells = (graph, grid, cells)
        return cells

    def _memory_for(self, expansions: int, graph: Graph) -> search_memory.Memory:
        needed = expansions * self.parameters.notches**2 + 2
        memory = self._memory
        if memory is None or len(memory.cost) < needed or len(memory.scratch) <= len(graph.vertex):
            memory = search_memory.make_memory(expansions, self.parameters.notches, 2 * len(graph.vertex))
            self._memory = memory
        return memory

    def job(self, problem: BaseProblem, target: Target) -> Job:
        """The target with a slightly reduced reach, or with the full one if only that has it in reach now."""
        whole = self.reach.job(target, self.parameters)
        inner = self.reach.job(target, self.parameters, slack=self.reach.parameters.plan_slack)
        now = [float(value) for value in (*problem.pose, *problem.twist)]
        return whole if in_reach(*now, whole) and not in_reach(*now, inner) else inner

    def _time_to_goal(self, problem: BaseProblem, job: Job, s: search_memory.Settings, goal: LocalGoal) -> float:
        """t_h [s]: PathRTR of the whole global path, 0 while the target is in reach."""
        if s.by_job and in_reach(*(float(value) for value in (*problem.pose, *problem.twist)), job):
            return 0.0
        return path_rtr(
            goal.global_path, float(problem.pose[2]), None if math.isnan(goal.heading) else goal.heading,
            v_f=self.limits.forward_speed, v_r=self.limits.reverse_speed, w_max=self.limits.yaw_rate,
        )  # fmt: skip

    def penalty_scale(self, t_h: float) -> float:
        """k of the proximity penalty t_h [s] before the goal; 1 where it does not fade."""
        p = self.parameters
        return staa.proximity_scale(t_h, p.k_min, p.k_time) if p.scale_penalty else 1.0

    def at_goal(self, pose: Array, placement: Placement) -> bool:
        """Test that the base is at its goal, within the tolerance of the search."""
        p, goal = self.parameters, placement.goal
        near = math.hypot(pose[0] - goal[0], pose[1] - goal[1]) <= p.pass_distance
        return near and (not placement.goal_has_heading or turn(pose[2], goal[2]) <= p.pass_heading)

    def _no_motion(self, problem: BaseProblem, target: Target, field: Field, expansions: int) -> Reason:
        if problem.engaged:
            return Reason(kind=Kind.LEAVES_REACH, subject=target.name)
        room = float(clearances(np.array(problem.pose, dtype=np.float64)[None], 1.0, field, self.body)[0])
        return Reason(kind=Kind.NO_MOTION, subject=target.name, value=room, limit=expansions, unit="m")

    def _overlap_depth(self, problem: BaseProblem, field: Field) -> float:
        """Depth [m] of the deepest occupied cell inside the footprint; negative or 0 when none is."""
        pose = np.array(problem.pose, dtype=np.float64)
        if clearances(pose[None], 1.0, field, self.body)[0] >= problem.world.resolution:
            return 0.0
        cells = overlapping_cells(problem.world, pose, self.body)
        return depth_of(cells, pose, self.body) + 0.5 * problem.world.resolution

    def _escape(self, problem: BaseProblem, field: Field) -> BasePlan:
        """Leave the obstacles that the footprint overlaps, or stand."""
        depth = self._overlap_depth(problem, field)
        pose, attempt = np.array(problem.pose, dtype=np.float64), problem.recovery.attempt
        found = find_escape(problem.world, pose, self.body, self.limits, attempt)
        if found is None:
            why = Reason(kind=Kind.OVERLAP_STANDS, subject="base", value=depth, unit="m")
            return self._stop(problem, PlanStatus.BRAKING, why, None, 0)
        why = Reason(kind=Kind.OVERLAP_LEAVES, subject="base", value=depth, unit="m")
        return self._along(problem, found, self._stop(problem, PlanStatus.ESCAPING, why, None, 0), why)

    def _along(self, problem: BaseProblem, found: Escape, plan: BasePlan, why: Reason) -> BasePlan:
        """A plan that holds the twist of an escape."""
        most = np.array([self.limits.linear_acceleration, self.limits.yaw_acceleration])
        twists = np.broadcast_to(found.twist, (len(found.poses), 2))
        return msgspec.structs.replace(
            plan,
            status=PlanStatus.ESCAPING,
            why=why,
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

    def _time_to_range(self, poses: Array, dt: float, job: Job, graph: Graph, goal: LocalGoal) -> float:
        """Time [s] until the target comes into reach: in the local plan, else on the path that follows it."""
        reached = first_node_in_reach(poses, dt, job)
        if reached < math.inf:
            return reached * dt
        start = (len(poses) - 1) * dt
        path, in_reverse = path_to_goal(graph, goal.table, poses[-1, :3])
        if not goal.is_goal:
            path = np.vstack((path, goal.global_path[-1:]))
        return start + self._time_along(path, float(poses[-1, 2]), in_reverse, job)

    def _time_along(self, path: Array, heading: float, in_reverse: bool, job: Job) -> float:
        """Time [s] along a path, with its turns, until the target is in reach, or else until its end."""
        time = 0.0
        speed = self.limits.reverse_speed if in_reverse else self.limits.forward_speed
        for i in range(1, len(path)):
            step = path[i] - path[i - 1]
            length = math.hypot(step[0], step[1])
            if length < 1e-9:
                continue
            facing = math.atan2(step[1], step[0]) + (math.pi if in_reverse else 0.0)
            time += turn(heading, facing) / self.limits.yaw_rate
            heading = facing
            way = first_in_reach(path[i - 1], step, length, facing, job)
            if way < math.inf:
                return time + way / speed
            time += length / speed
        return time

    def _idle(self, problem: BaseProblem, why: Reason) -> BasePlan:
        return self._stop(problem, PlanStatus.IDLE, why, None, 0)

    def _brake(
        self, problem: BaseProblem, field: Field, why: Reason, goal: LocalGoal, expansions: int, *, cut: bool = False
    ) -> BasePlan:
        plan = self._stop(problem, PlanStatus.BRAKING, why, goal, expansions, cut=cut)
        found = self._recovered(problem, field)
        if found is None:
            return plan
        return self._along(problem, found, plan, Reason(kind=_kind_of(found), subject=why.subject, cause=why))

    def _held_up(self, problem: BaseProblem, target: Target, field: Field) -> BasePlan | None:
        """The plan of a base that stands although it has a path: it backs off to more clearance, or turns to look.

        It is held back by something that planning leaves out, such as floor that the lidar has never seen.
        """
        attempt = problem.recovery.attempt
        found = self._recovered(problem, field, attempt - 1) if attempt else None
        if found is None:
            return None
        held = Reason(kind=Kind.HELD_BACK, subject=target.name)
        why = Reason(kind=_kind_of(found), subject=target.name, cause=held)
        return self._along(problem, found, self._stop(problem, PlanStatus.ESCAPING, why, None, 0), why)

    def _recovered(self, problem: BaseProblem, field: Field, way: int = 0) -> Escape | None:
        """A motion for a base that has stood without progress for some time; ``way``: index of the way to back off."""
        recovery, pose = problem.recovery, np.array(problem.pose, dtype=np.float64)
        if recovery.back_off:
            ways = ways_to_room(pose, field, self.body, self.limits, self.parameters.margin_floor)
            return ways[way % len(ways)] if ways else None
        if recovery.look and 0.5 * self.profile.lidar.field_of_view < staa.ALL_ROUND:
            return find_turn(pose, field, self.body, self.limits, self.parameters.margin_floor)
        return None

    def _stop(
        self, problem: BaseProblem, status: PlanStatus, why: Reason, goal: LocalGoal | None, expansions: int, *,
        cut: bool = False,
    ) -> BasePlan:  # fmt: skip
        """The plan that brakes both axes to rest."""
        pose, twist = np.array(problem.pose, dtype=np.float64), np.array(problem.twist, dtype=np.float64)
        most = np.array([self.limits.linear_acceleration, self.limits.yaw_acceleration])
        acceleration = np.clip(-twist / problem.period, -most, most)
        here = np.array([[*pose, *twist]])
        return BasePlan(
            acceleration=frozen(acceleration),
            status=status,
            why=why,
            global_path=frozen(empty_path() if goal is None else goal.global_path),
            intermediate_goal=frozen(pose if goal is None else goal.pose),
            local_poses=frozen(here),
            local_times=frozen(np.zeros(1)),
            expansions=expansions,
            cut_by_clock=cut,
            t_h=0.0 if status == PlanStatus.IDLE else math.inf,
            k=self.penalty_scale(0.0 if status == PlanStatus.IDLE else math.inf),
            time_to_range=math.inf,
        )


def _kind_of(found: Escape) -> Kind:
    return Kind.BACKS_OFF if found.twist[0] != 0.0 else Kind.TURNS_TO_SEE


_ARRIVED = {Kind.CLOSEST: Kind.WAITS_AT_CLOSEST, Kind.BESIDE_TAKEN: Kind.WAITS_BESIDE_TAKEN}


def _arrived(why: Reason) -> Reason:
    """The reason for a place, as it reads once the base stands there."""
    return msgspec.structs.replace(why, kind=_ARRIVED.get(why.kind, why.kind))
