"""Base placement that knows the next target (Paper, Sec. IV)."""

import dataclasses
import math
from typing import NamedTuple

import numpy as np

from motm_twin.model.exact import angle_of, turn_between
from motm_twin.model.geometry import Array, frozen
from motm_twin.model.profile import RobotProfile
from motm_twin.model.state import Stateful
from motm_twin.planning import stuck
from motm_twin.planning.collision import Field, body_of, clearances
from motm_twin.planning.cost_to_go import Table
from motm_twin.planning.global_path import (
    GraphCache,
    Poses,
    costs_on,
    costs_to,
    grouped,
    path_to_goal,
    poses_at,
    rates_of,
    robot_table,
)
from motm_twin.planning.parameters import PlanningParameters
from motm_twin.planning.reach import ReachModel
from motm_twin.planning.rejections import (
    HIDDEN,
    NO_PATH,
    OUTSIDE,
    REASONS,
    Here,
    in_sight,
    leaves_room,
    may_move,
    rejections,
)
from motm_twin.planning.rings import ring, spokes
from motm_twin.planning.room import room_for
from motm_twin.planning.types import BaseProblem, Placement, Target, empty_path
from motm_twin.planning.visibility import Graph

SAME_PLACE, SAME_HEADING = 0.06, 0.15  # [m], [rad] a candidate this near to the last choice is the same choice
CLEARLY_CLOSER = 0.5  # [m] by which a free place must be closer to the target to take the place of the one chosen
CLOSEST_STEP, CLOSEST_MAX = 0.1, 4.0  # [m] rings searched for the closest free position: what stands about is as large,
CLOSEST_ROUND = 3.5  # [m] and a base that is larger than Frankie needs this much round itself


@dataclasses.dataclass(kw_only=True)
class PlacementState:
    """What is remembered between periods: the last choice, for hysteresis."""

    target: tuple[str, str] | None = None
    goal: Array | None = None
    closest: bool = False  # it was the free place closest to the target, not one from which that is served


class Candidates(NamedTuple):
    """Poses (m, 3) at places (p, 2) and why each is rejected ("" when it is not)."""

    mode: str
    radius: float
    pose: Array
    place: Array
    place_of: Array
    rejected: list[str]

    def viable(self) -> Array:
        """Which are not rejected, shape (m,) of bool."""
        return np.array([not why for why in self.rejected], dtype=bool)


class Searched(NamedTuple):
    """What the costs of the last period were read from."""

    graph: Graph
    from_robot: Table
    to_next: Table | None
    pose: Array  # candidates, (m, 3)
    viable: Array  # (m,) of bool


class NextTargetPlacement(Stateful[PlacementState]):
    """C_i = C_iC + 1.05 C_iN over 36 x 2 candidates on the smallest ring, 0.6 to 0.8 m, that has a viable one."""

    def __init__(self, profile: RobotProfile, parameters: PlanningParameters, graphs: GraphCache | None = None) -> None:
        self._body = body_of(profile.footprint)
        self._footprint = profile.footprint
        self._mount_offset = math.hypot(profile.arm.mount_x, profile.arm.mount_y)
        self._parameters = parameters
        self._reach = ReachModel(profile, parameters.reach)
        self._graphs = graphs or GraphCache()
        self._rates = rates_of(profile.base)
        self._state = PlacementState()
        p = parameters.placement
        steps = max(1, round((p.radius_max - p.radius_min) / p.radius_step))
        self._radii = np.linspace(p.radius_min, p.radius_max, steps + 1)
        self._kept: tuple[Graph, Field, tuple[object, ...], Array | None] | None = None  # of `_next_poses`
        self._served: tuple[Graph, Array, Poses] | None = None  # the poses of the next target, and what they see
        self._room = room_for(parameters, profile.footprint, 0.0)
        self._last: Searched | None = None  # only to explain the last period: no decision reads it

    def place(self, problem: BaseProblem) -> Placement:
        """Where the base should stand for the target, with the costs of all candidates."""
        self._last = None
        if problem.target is None:
            self._state = PlacementState()
            return _nothing_to_do(problem.pose)
        target = problem.target
        self._room = room_for(self._parameters, self._footprint, problem.recovery.tightness)
        graph = self._graphs.graph(problem.world, self._room.growth)
        here = Here(problem.world, self._graphs.field(problem.world), self._body, graph, problem.pose)
        from_robot = robot_table(graph, problem.pose, self._rates)
        next_poses = self._next_poses_kept(problem.next_target, here)
        to_next = self._graphs.table(graph, next_poses, self._rates) if next_poses is not None else None
        candidates, current, onward = self._evaluate(target, here, from_robot, to_next)
        if len(problem.stuck_at):
            current = current + stuck.COST * stuck.near(candidates.pose, problem.stuck_at)
        if len(problem.recovery.avoid):
            current = current + stuck.COST * stuck.near(candidates.pose, problem.recovery.avoid)
        viable = np.isfinite(current)  # an infinite cost times a weight of 0 would be no number
        cost = current + self._parameters.placement.next_weight * np.where(viable, onward, 0.0)
        preferred = cost - self._parameters.placement.hysteresis * self._chosen_before(target, candidates.pose)
        chosen = int(np.argmin(preferred)) if np.isfinite(preferred).any() else -1
        goal = candidates.pose[chosen] if chosen >= 0 else problem.pose
        closest = candidates.mode == "closest" and chosen >= 0
        self._state = PlacementState(target=(target.kind, target.name), goal=np.array(goal), closest=closest)
        next_goals = self._best_next(goal, next_poses, graph) if next_poses is not None else None
        self._last = Searched(graph, from_robot, to_next, candidates.pose, viable)
        return Placement(
            mode=candidates.mode,
            radius=candidates.radius,
            poses=frozen(candidates.pose),
            cost_current=frozen(current),
            cost_next=frozen(onward),
            cost=frozen(cost),
            rejected=tuple(candidates.rejected),
            chosen=chosen,
            goal=frozen(goal),
            goal_has_heading=candidates.mode in ("ring", "reach") or (
                candidates.mode == "drive" and target.heading is not None
            ),
            reason=self._why(candidates, chosen, current, onward, target, here),
            next_goal=None if next_goals is None else frozen(next_goals[0]),
            next_goals=None if next_goals is None else frozen(next_goals),
        )  # fmt: skip

    def paths(self, index: int) -> tuple[Array, Array] | None:
        """Paths (m, 2) [m] of a candidate of the last period: from the robot to it, and on to the next target."""
        last = self._last
        if last is None or not 0 <= index < len(last.pose) or not last.viable[index]:
            return None
        pose = last.pose[index]
        to_robot, _ = path_to_goal(last.graph, last.from_robot, pose + np.array([0.0, 0.0, math.pi]))
        onward = empty_path() if last.to_next is None else path_to_goal(last.graph, last.to_next, pose)[0]
        return frozen(to_robot[::-1]), frozen(onward)

    def _evaluate(
        self, target: Target, here: Here, from_robot: Table, to_next: Table | None
    ) -> tuple[Candidates, Array, Array]:
        """The first set of candidates of which one is free, in reach and has a path: with C_iC and C_iN.

        The candidates that were wanted in the first place stay in the list, with the reasons of their rejection.
        """
        first: Candidates | None = None
        for wanted in self._sets(target, here):
            other = first is not None and first.mode != wanted.mode
            candidates = joined(first, wanted) if other else wanted
            current, onward = self._costs(candidates, here.graph, from_robot, to_next)
            if np.isfinite(current).any():
                return candidates, current, onward
            first = first if first is not None and first.mode != candidates.mode else candidates
        assert first is not None
        return first, np.full(len(first.pose), np.inf), np.full(len(first.pose), np.inf)

    def _sets(self, target: Target, here: Here):
        """Candidate sets in the order in which they are wanted."""
        if target.kind == "drive":
            yield self._drive(target, here)
        else:
            yield from self._rings(target, here)
            yield from self._reach_sets(target, here)
        yield from self._closest_sets(target, here)

    def _rings(self, target: Target, here: Here):
        p = self._parameters.placement
        for radius in self._radii:
            pose, place, place_of = ring(target.position, radius, p.positions)
            reached = self._reach.reached_from(pose, target)
            rejected = rejections(pose, self._room.clearance, here)
            rejected = [why or ("" if ok else "arm cannot reach") for why, ok in zip(rejected, reached, strict=True)]
            candidates = Candidates("ring", float(radius), pose, place, place_of, rejected)
            if candidates.viable().any() or radius == p.radius_max:
                yield candidates

    def _reach_sets(self, target: Target, here: Here):
        """Free poses of any heading from which the arm reaches, the closest rings first, two at a time."""
        p = self._parameters.placement
        largest = self._parameters.reach.r_max(target.kind) + self._mount_offset
        previous: Candidates | None = None
        for radius in np.arange(self._body.inner, largest, p.reach_step):
            pose, place, place_of = spokes(target.position, radius, p.positions, p.reach_headings)
            reached = self._reach.reached_from(pose, target, slack=p.reach_slack)
            keep = reached.copy()
            keep[reached] = (
                clearances(pose[reached], self._room.clearance, here.field, here.body) >= self._room.clearance
            )
            if not keep.any():
                continue
            found = Candidates("reach", float(radius), pose[keep], place, place_of[keep], [""] * int(keep.sum()))
            if previous is not None:
                yield joined(previous, found)
            previous = found
        if previous is not None:
            yield previous

    def _closest_sets(self, target: Target, here: Here):
        """Free places, the closest first; those in sight that leave room to what may be moving before all others.

        A place that was chosen stays the closest until it is not free, or one is seen that is clearly closer.
        """
        sets = self._in_sight_first(target, here)
        first = next(sets, None)
        kept = self._kept_closest(target, here)
        if kept is not None and (first is None or first.radius > kept.radius - CLEARLY_CLOSER):
            yield kept
        if first is not None:
            yield first
        yield from sets

    def _in_sight_first(self, target: Target, here: Here):
        for room in self._rooms(here):
            yield from self._closest(target, here, room, sight=True)
        yield from self._closest(target, here, 0.0)

    def _kept_closest(self, target: Target, here: Here) -> Candidates | None:
        """The place of the last period as the only candidate, while it is free."""
        state = self._state
        if not state.closest or state.goal is None or state.target != (target.kind, target.name):
            return None
        pose = state.goal[None]
        if clearances(pose, 1.0, here.field, here.body)[0] < 0.0:
            return None
        away = math.dist(state.goal[:2], target.position[:2])
        return Candidates("closest", away, pose, pose[:, :2], np.zeros(1, np.int32), [""])

    def _rooms(self, here: Here) -> tuple[float, ...]:
        """Rooms [m] to be left where the base waits, the wanted one first."""
        return (self._parameters.placement.room, 0.0) if len(may_move(here.world)) else (0.0,)

    def _closest(self, target: Target, here: Here, room: float, within: float = math.inf, *, sight: bool = False):
        p = self._parameters.placement
        for radius in np.arange(0.0, max(CLOSEST_MAX, self._body.reach + CLOSEST_ROUND), CLOSEST_STEP):
            if radius > within:
                return
            pose, place, place_of = spokes(target.position, radius, p.positions, 4)
            keep = clearances(pose, self._room.clearance, here.field, here.body) >= self._room.clearance
            if room > 0.0:
                keep &= leaves_room(pose, room, here)
            if sight and keep.any():
                keep[keep] = in_sight(pose[keep], here)
            if keep.any():
                yield Candidates("closest", float(radius), pose[keep], place, place_of[keep], [""] * int(keep.sum()))

    def _drive(self, target: Target, here: Here) -> Candidates:
        p = self._parameters.placement
        count = p.drive_headings if target.heading is None else 1
        pose = np.empty((count, 3))
        pose[:, :2] = target.position[:2]
        pose[:, 2] = 0.0 if target.heading is None else target.heading
        pose[:, 2] += np.arange(count) * (2.0 * math.pi / count)
        pose[:, 2] = angle_of(np.sin(pose[:, 2]), np.cos(pose[:, 2]))
        rejected = rejections(pose, self._room.clearance, here)
        if self._state.closest and self._state.target == (target.kind, target.name):
            # It was not free: what hides it now may have been seen there before, and forgotten.
            seen = in_sight(pose, here)
            rejected = [why or ("" if ok else HIDDEN) for why, ok in zip(rejected, seen, strict=True)]
        return Candidates("drive", 0.0, pose, pose[:1, :2], np.zeros(count, np.int32), rejected)

    def _costs(
        self, candidates: Candidates, graph: Graph, from_robot: Table, to_next: Table | None
    ) -> tuple[Array, Array]:
        """C_iC and C_iN [s]; inf for rejected candidates. A candidate without a path is rejected here."""
        n = len(candidates.pose)
        current, onward = np.full(n, np.inf), np.full(n, np.inf)
        viable = candidates.viable()
        if not viable.any():
            return current, onward
        place_of = candidates.place_of[viable]
        used = np.zeros(len(candidates.place), dtype=bool)
        used[place_of] = True
        number = np.cumsum(used, dtype=np.int32) - np.int32(1)
        poses = poses_at(graph, candidates.pose[viable], candidates.place[used], number[place_of])
        current[viable] = costs_to(graph, from_robot, poses)
        onward[viable] = costs_on(graph, to_next, poses) if to_next is not None else 0.0
        blocked = viable & ~np.isfinite(current)
        for i in np.flatnonzero(blocked):
            candidates.rejected[i] = NO_PATH
        onward[~np.isfinite(onward) & viable & ~blocked] = _no_way_on(onward)
        onward[blocked] = np.inf
        return current, onward

    def _next_poses_kept(self, target: Target | None, here: Here) -> Array | None:
        """`_next_poses`, from the last call when neither the target nor the map has changed since."""
        if target is None:
            return None
        asked = (target.kind, target.name, target.position.tobytes(), target.heading)
        kept = self._kept
        if kept is None or kept[0] is not here.graph or kept[1] is not here.field or kept[2] != asked:
            kept = self._kept = (here.graph, here.field, asked, self._next_poses(target, here))
        return kept[3]

    def _next_poses(self, target: Target | None, here: Here) -> Array | None:
        """Where the next target can be served from, shape (m, 3)."""
        if target is None:
            return None
        for candidates in self._sets(target, here):
            viable = candidates.viable()
            if viable.any():
                poses = candidates.pose[viable]
                if target.kind == "drive" and target.heading is None:
                    poses = np.array([[*poses[0, :2], math.nan]])
                most = self._parameters.placement.next_poses
                if len(poses) > most:
                    poses = poses[:: 1 + len(poses) // most]
                return poses[np.lexsort((poses[:, 1], poses[:, 0]))]
        return np.array([[target.position[0], target.position[1], math.nan]])

    def _best_next(self, goal: Array, next_poses: Array, graph: Graph) -> Array:
        """The poses of the next target that are cheapest from the goal, cheapest first, shape (k, 3)."""
        reverse = self._graphs.table(graph, np.array([[goal[0], goal[1], goal[2] + math.pi]]), self._rates)
        served = self._served
        if served is None or served[0] is not graph or served[1] is not next_poses:
            place, first = grouped(next_poses)
            place_of = np.repeat(np.arange(len(place), dtype=np.int32), np.diff(first))
            asked = np.where(np.isnan(next_poses), 0.0, next_poses)
            served = self._served = (graph, next_poses, poses_at(graph, asked, place, place_of))
        cost = costs_to(graph, reverse, served[2])
        order = np.argsort(cost, kind="stable")[: self._parameters.placement.next_goals]
        return next_poses[order]

    def _why(
        self, candidates: Candidates, chosen: int, current: Array, onward: Array, target: Target, here: Here
    ) -> str:
        outside = _outside(target, here)
        if chosen < 0:
            if outside:
                return f"{outside}: no pose from which it is served can be reached"
            return f"no pose from which {target.name} is served can be reached: obstacles close every way"
        cost = f"{current[chosen]:.1f} s to it and {onward[chosen]:.1f} s from it to the next target"
        if candidates.mode == "ring":
            return f"cheapest candidate at {candidates.radius:.2f} m: {cost}"
        if candidates.mode == "drive":
            return f"drive target: {cost}"
        p = self._parameters.placement
        if candidates.mode == "reach":
            return f"no free candidate within {p.radius_max:.2f} m of {target.name}: closest pose in reach, {cost}"
        away = math.hypot(*(candidates.pose[chosen, :2] - target.position[:2]))
        if target.kind == "drive":
            what = outside or f"{target.name} is {_not_free(candidates)}"
            return f"{what}: driving to the closest free place, {away:.2f} m from it"
        what = outside or f"no free candidate within {p.radius_max:.2f} m of {target.name}"
        return f"{what}: driving to the closest free place, {away:.2f} m from it"

    def _chosen_before(self, target: Target, pose: Array) -> Array:
        """1 for the candidate that was chosen in the last period, else 0; shape (m,)."""
        same = np.zeros(len(pose))
        goal = self._state.goal
        if goal is None or self._state.target != (target.kind, target.name):
            return same
        distance = np.hypot(pose[:, 0] - goal[0], pose[:, 1] - goal[1])
        swing = turn_between(pose[:, 2], goal[2])
        nearest = int(np.argmin(distance + swing))
        if distance[nearest] <= SAME_PLACE and swing[nearest] <= SAME_HEADING:
            same[nearest] = 1.0
        return same


def _no_way_on(onward: Array) -> float:
    finite = onward[np.isfinite(onward)]
    return float(finite.max()) if len(finite) else 0.0


def joined(first: Candidates, second: Candidates) -> Candidates:
    """Two sets as one; mode and radius of the second, or of the first when both have the same mode."""
    lead = first if first.mode == second.mode else second
    return Candidates(
        lead.mode,
        lead.radius,
        np.concatenate((first.pose, second.pose)),
        np.concatenate((first.place, second.place)),
        np.concatenate((first.place_of, second.place_of + len(first.place))).astype(np.int32),
        first.rejected + second.rejected,
    )


def _outside(target: Target, here: Here) -> str:
    """That the target is outside the map, with coordinates; "" when it is inside."""
    x_min, y_min = here.field.x, here.field.y
    rows, columns = here.world.distance.shape
    x_max, y_max = x_min + columns * here.world.resolution, y_min + rows * here.world.resolution
    x, y = (float(value) for value in target.position[:2])
    if x_min <= x <= x_max and y_min <= y <= y_max:
        return ""
    where = "" if target.kind == "drive" else f" at ({x:.2f}, {y:.2f})"  # the name of a drive is its point
    return f"{target.name}{where} is outside the map, x {x_min:.2f} to {x_max:.2f} m, y {y_min:.2f} to {y_max:.2f} m"


def _not_free(candidates: Candidates) -> str:
    """Why the base cannot stand at a point of the map with any heading."""
    reasons = {why for why in candidates.rejected if why}
    if NO_PATH in reasons:
        return "free, but there is no way to it that is wide enough"
    return "too close to the edge of the map" if reasons == {REASONS[OUTSIDE]} else "not free"


def _nothing_to_do(pose: Array) -> Placement:
    none = frozen(np.zeros(0))
    return Placement(
        mode="none", radius=0.0, poses=frozen(np.zeros((0, 3))), cost_current=none, cost_next=none, cost=none,
        rejected=(), chosen=-1, goal=frozen(pose), goal_has_heading=False, reason="there is no target", next_goal=None,
    )  # fmt: skip
