"""Next-target-aware base placement (Paper, Sec. IV)."""

import math
from typing import NamedTuple

import numpy as np

from motm_twin.model.exact import turn_between
from motm_twin.model.geometry import Array, from_frame, frozen
from motm_twin.model.profile import RobotProfile
from motm_twin.model.reason import Kind, Reason
from motm_twin.model.state import Stateful
from motm_twin.planning.candidates import (
    Candidates,
    Judged,
    PlacementModel,
    PlacementState,
    Rule,
    Survey,
    next_poses,
    smallest_ring,
    times_avoided,
)
from motm_twin.planning.collision import Field
from motm_twin.planning.cost_to_go import Table
from motm_twin.planning.global_path import GraphCache, Poses, costs_to, grouped, path_to_goal, poses_at, robot_table
from motm_twin.planning.parameters import PlacementParameters, PlanningParameters, room_for
from motm_twin.planning.rejections import Here, Rejection
from motm_twin.planning.types import (
    BaseProblem,
    Mode,
    PastWalls,
    Placement,
    Target,
    empty_path,
    no_placement,
)
from motm_twin.planning.visibility import Graph


class Searched(NamedTuple):
    """Tables from which the costs of the last period were read."""

    graph: Graph
    from_robot: Table
    to_next: Table | None
    pose: Array  # candidates, (m, 3)
    viable: Array  # (m,) of bool

    def paths(self, index: int) -> tuple[Array, Array] | None:
        """Paths (m, 2) [m] of a candidate: from the robot to it, and on to the next target."""
        if not 0 <= index < len(self.pose) or not self.viable[index]:
            return None
        pose = self.pose[index]
        to_robot, _ = path_to_goal(self.graph, self.from_robot, pose + np.array([0.0, 0.0, math.pi]))
        onward = empty_path() if self.to_next is None else path_to_goal(self.graph, self.to_next, pose)[0]
        return frozen(to_robot[::-1]), frozen(onward)


class NextTargetPlacement(Stateful[PlacementState]):
    """C_i = C_iC + 1.05 C_iN over the candidates of a rule, with hysteresis in favour of the last choice.

    The paper's rule: 36 x 2 candidates on the smallest ring, 0.6 to 0.8 m, that has a viable one.
    """

    def __init__(
        self,
        profile: RobotProfile,
        parameters: PlanningParameters,
        graphs: GraphCache | None = None,
        candidates: Rule = smallest_ring,
    ) -> None:
        self.model = PlacementModel(profile, parameters)
        self.candidates = candidates
        self._graphs = graphs or GraphCache()
        self._state = PlacementState()
        self._next: tuple[Graph, Field, tuple[object, ...], Array] | None = None  # of `_next_poses`
        self._served: tuple[Graph, Array, Poses] | None = None  # poses of the next target, with the vertices they see
        self._last: Searched | None = None  # only to explain the last period: no decision reads it

    def place(self, problem: BaseProblem) -> Placement:
        """Choose where the base should stand for the target, with the costs of all candidates."""
        placement, self._state = self.decide(problem, self._state)
        return placement

    def paths(self, index: int) -> tuple[Array, Array] | None:
        """Paths (m, 2) [m] of a candidate of the last period: from the robot to it, and on to the next target."""
        return None if self._last is None else self._last.paths(index)

    def survey(self, problem: BaseProblem, last: PlacementState) -> Survey:
        """Inputs of the rule of candidates in this period, without the next target."""
        model, world = self.model, problem.world
        room = room_for(model.parameters, model.profile.footprint, problem.recovery.tightness)
        graph = self._graphs.graph(world, room.growth)
        lidar = model.profile.lidar
        eye = from_frame(problem.pose, np.array([lidar.x, lidar.y]))
        here = Here(world, self._graphs.field(world), model.body, graph, eye)
        return Survey(model, here, room, last, robot_table(graph, problem.pose, model.rates), None)

    def decide(self, problem: BaseProblem, last: PlacementState) -> tuple[Placement, PlacementState]:
        """The choice for a period, given that of the last one."""
        self._last = None
        target, p = problem.target, self.model.placement
        if target is None:
            return no_placement(problem.pose), PlacementState()
        survey = self.survey(problem, last)
        graph, poses = survey.here.graph, self._next_poses(problem.next_target, survey)
        if poses is not None:
            survey = survey._replace(to_next=self._graphs.table(graph, poses, self.model.rates))
        judged, how = self._judged(target, survey)
        judged = judged._replace(current=_avoiding(judged.current, judged.candidates.pose, problem, p.avoided_cost))
        viable = np.isfinite(judged.current)  # an infinite cost times a weight of 0 would be nan
        cost = judged.current + p.next_weight * np.where(viable, judged.onward, 0.0)
        candidates = judged.candidates
        preferred = cost - p.hysteresis * _chosen_before(last, target, candidates.pose, p)
        chosen = int(np.argmin(preferred)) if np.isfinite(preferred).any() else -1
        goal = candidates.pose[chosen] if chosen >= 0 else problem.pose
        next_goals = None if poses is None else frozen(self._best_next(goal, poses, graph))
        self._last = Searched(graph, survey.from_robot, survey.to_next, candidates.pose, viable)
        placement = Placement(
            mode=candidates.mode,
            radius=candidates.radius,
            poses=frozen(candidates.pose),
            cost_current=frozen(judged.current),
            cost_next=frozen(judged.onward),
            cost=frozen(cost),
            rejected=tuple(candidates.rejected),
            chosen=chosen,
            goal=frozen(goal),
            past_walls=how,
            goal_has_heading=candidates.mode in (Mode.RING, Mode.REACH)
            or (candidates.mode == Mode.DRIVE and target.heading is not None),
            why=_why(judged, chosen, target, survey),
            next_goal=None if next_goals is None else next_goals[0],
            next_goals=next_goals,
        )
        closest = candidates.mode == Mode.CLOSEST and chosen >= 0
        return placement, PlacementState(target=(target.kind, target.name), goal=np.array(goal), closest=closest)

    def _judged(self, target: Target, survey: Survey) -> tuple[Judged, PastWalls]:
        """The candidates of the rule, and how the arm gets to its target: over low walls only if no other serves."""
        judged = self.candidates(target, survey)
        if _serves(judged) or target.tall is None or len(target.tall) == len(target.walls):
            return judged, PastWalls.AROUND
        for how in (PastWalls.OVER_NEAR, PastWalls.OVER) if target.reach_over < target.reach else (PastWalls.OVER,):
            over = self.candidates(target.past_walls(how), survey)
            if _serves(over):
                return over, how
        return judged, PastWalls.AROUND

    def _next_poses(self, target: Target | None, survey: Survey) -> Array | None:
        """`next_poses`, from the last call when neither the target nor the map has changed since."""
        if target is None:
            return None
        asked, here = (target.kind, target.name, target.position.tobytes(), target.heading), survey.here
        kept = self._next
        if kept is None or kept[0] is not here.graph or kept[1] is not here.field or kept[2] != asked:
            kept = self._next = (here.graph, here.field, asked, next_poses(target, survey))
        return kept[3]

    def _best_next(self, goal: Array, poses: Array, graph: Graph) -> Array:
        """The poses of the next target (m, 3) that are cheapest from the goal, cheapest first, shape (k, 3)."""
        reverse = self._graphs.table(graph, np.array([[goal[0], goal[1], goal[2] + math.pi]]), self.model.rates)
        served = self._served
        if served is None or served[0] is not graph or served[1] is not poses:
            place, first = grouped(poses)
            place_of = np.repeat(np.arange(len(place), dtype=np.int32), np.diff(first))
            asked = np.where(np.isnan(poses), 0.0, poses)
            served = self._served = (graph, poses, poses_at(graph, asked, place, place_of))
        cost = costs_to(graph, reverse, served[2])
        order = np.argsort(cost, kind="stable")[: self.model.placement.next_goals]
        return poses[order]


def _serves(judged: Judged) -> bool:
    """Test that the target can be served from a candidate, at once or when a dynamic obstacle has gone."""
    closest = judged.candidates.mode == Mode.CLOSEST and not judged.waits
    return not closest and bool(np.isfinite(judged.current).any())


def _avoiding(cost: Array, pose: Array, problem: BaseProblem, dearer: float) -> Array:
    """The costs [s] of poses (m, 3), plus ``dearer`` [s] for each pose nearby at which the arm or the base failed."""
    for avoid in (problem.stuck_at, problem.recovery.avoid):
        if len(avoid):
            cost = cost + dearer * times_avoided(pose, avoid)
    return cost


def _chosen_before(last: PlacementState, target: Target, pose: Array, p: PlacementParameters) -> Array:
    """1 for the candidate that was chosen in the last period, else 0; shape (m,)."""
    same = np.zeros(len(pose))
    goal = last.goal
    if goal is None or not last.of(target):
        return same
    distance = np.hypot(pose[:, 0] - goal[0], pose[:, 1] - goal[1])
    swing = turn_between(pose[:, 2], goal[2])
    nearest = int(np.argmin(distance + swing))
    if distance[nearest] <= p.same_place and swing[nearest] <= p.same_heading:
        same[nearest] = 1.0
    return same


def _why(judged: Judged, chosen: int, target: Target, survey: Survey) -> Reason:
    """Reason of the choice."""
    candidates, current, onward, waits, waiting = judged
    name, largest = target.name, survey.model.placement.radius_max
    if waits:
        return Reason(kind=Kind.BESIDE_TAKEN, subject=name, value=float(onward[chosen]), unit="s")
    outside = _outside(target, survey.here)
    if chosen < 0:
        closed_in = Reason(kind=Kind.CLOSED_IN, subject=name)
        return closed_in if outside is None else Reason(kind=Kind.UNREACHABLE, subject=name, cause=outside)
    if waiting is not None and waiting[chosen] > 0.0:
        free = float(current[chosen] - waiting[chosen])
        return Reason(kind=Kind.SOON_FREE, subject=name, value=float(waiting[chosen]), limit=free, unit="s")
    costs = {"value": float(current[chosen]), "limit": float(onward[chosen]), "unit": "s"}
    if candidates.mode == Mode.RING:
        return Reason(kind=Kind.RING, subject=name, other=f"{candidates.radius:.2f} m", **costs)
    if candidates.mode == Mode.DRIVE:
        return Reason(kind=Kind.DRIVE, subject=name, **costs)
    no_candidate = Reason(kind=Kind.NO_CANDIDATE, subject=name, limit=largest, unit="m")
    if candidates.mode == Mode.REACH:
        return Reason(kind=Kind.IN_REACH, subject=name, cause=no_candidate, **costs)
    away = math.hypot(*(candidates.pose[chosen, :2] - target.position[:2]))
    not_free = Reason(kind=Kind.NOT_FREE, subject=name, other=_not_free(candidates))
    cause = outside or (not_free if target.kind == "drive" else no_candidate)
    return Reason(kind=Kind.CLOSEST, subject=name, value=away, unit="m", cause=cause)


def _outside(target: Target, here: Here) -> Reason | None:
    """Reason that the target is outside the map; None when it is inside."""
    x_min, y_min = here.field.x, here.field.y
    rows, columns = here.world.distance.shape
    x_max, y_max = x_min + columns * here.world.resolution, y_min + rows * here.world.resolution
    x, y = (float(value) for value in target.position[:2])
    if x_min <= x <= x_max and y_min <= y <= y_max:
        return None
    edges = f"x {x_min:.2f} to {x_max:.2f} m, y {y_min:.2f} to {y_max:.2f} m"
    if target.kind == "drive":  # its name is its point
        return Reason(kind=Kind.POINT_OUTSIDE_MAP, subject=target.name, other=edges)
    return Reason(kind=Kind.OUTSIDE_MAP, subject=target.name, other=edges, value=x, limit=y, unit="m")


def _not_free(candidates: Candidates) -> str:
    """Detail of the reason why the base cannot stand at a point of the map with any heading."""
    rejections = {why for why in candidates.rejected if why}
    if Rejection.NO_PATH in rejections:
        return "free, but there is no way to it that is wide enough"
    return "too close to the edge of the map" if rejections == {Rejection.OUTSIDE} else "not free"
