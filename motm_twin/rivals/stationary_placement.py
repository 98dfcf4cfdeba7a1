"""Base placement of a robot that stops to manipulate: once per target, by manipulability and path cost.

    C_i = w_m (1 - m_i / m_max) + C_iC + w_N C_iN

`irm` has the first term only, `greedy` the first two, `sequential` all three; `fixed_set` chooses from seven poses.
"""

import dataclasses
import math
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from shapely.geometry import Point as ShapelyPoint
from shapely.geometry import Polygon
from shapely.geometry.base import BaseGeometry
from shapely.ops import unary_union

from motm_twin.control.method import PlannerParts
from motm_twin.model.geometry import Array, frozen
from motm_twin.model.known import known_solids
from motm_twin.model.profile import DEG
from motm_twin.model.reason import Kind, Reason
from motm_twin.model.scene import Bin, Solid
from motm_twin.model.scene_shapes import base_outline, outline, rectangle
from motm_twin.model.state import Stateful
from motm_twin.perception.world_map import WorldMap
from motm_twin.planning.candidates import Candidates, PlacementState, Survey, costs_of, next_poses, spokes
from motm_twin.planning.collision import clearances, field_of
from motm_twin.planning.cost_to_go import Table
from motm_twin.planning.global_path import GraphCache, goal_table
from motm_twin.planning.placement import NextTargetPlacement, Searched
from motm_twin.planning.rejections import Rejection, rejections
from motm_twin.planning.types import BaseProblem, Mode, Placement, Target
from motm_twin.rivals.reachability import TargetReach

IntArray = NDArray[np.integer[Any]]


@dataclasses.dataclass(frozen=True, kw_only=True)
class StationaryParameters:
    """Parameters of standing poses: candidates, costs, and when a pose is close enough."""

    manipulability_weight: float = 5.0  # [s] cost of no manipulability: no value from 0 to 40 s is faster
    onward_weight: float = 1.0  # weight of the way to the next target, `sequential`: a second counts alike on both ways
    arm_clearance: float = 0.13  # [m] room to either side of the arm: 0.07 m of forearm, and where it begins to slow
    over_cost: float = 100.0  # [s] added to a pose with an unmapped obstacle beside the arm: only if there is no other
    directions: int = 36  # directions of candidates about the target, as many as the paper's ring has
    headings: int = 16  # headings at each position, as many as `motm` has where it tries any heading
    radius_step: float = 0.05  # [m] between rings of candidates, as between the paper's rings here
    next_headings: int = 8  # headings at the best position of each direction about the next target: half, to save time
    equal_share: float = 0.01  # share of the best manipulability: smaller differences are ignored
    fixed_poses: int = 7  # poses of `fixed_set` about a table or bin: Paper, Sec. VI, after Reister et al.
    fixed_inset: float = 0.10  # [m] from the edge of a table to the line on which `fixed_set` expects objects
    moved: float = 0.15  # [m] motion of the target that triggers a new choice: beliefs are off by 0.1
    park_distance: float = 0.15  # [m] from the chosen pose at which the base may rest: as near as STAA* comes here
    park_share: float = 0.90  # share of the chosen pose's manipulability that a resting pose needs, or it drives on
    park_slack: float = 0.02  # [m] by which a resting pose is inside the reach, because localisation errs by 1 cm
    goal_distance: float = 0.06  # [m] tolerance of the search for a base that is slow too far away: it would stay there
    goal_heading: float = 10.0 * DEG  # [rad] heading tolerance of the search for a base that is slow too far away
    slow_v: float = 0.10  # [m/s] speed below which a base is slow: near its pose it creeps
    slow_w: float = 0.30  # [rad/s] yaw rate below which a base is slow
    patience: float = 3.0  # [s] for which a slow base away from its pose waits for another one: the map may be wrong
    refused_distance: float = 0.20  # [m] least distance of the new choice from a pose that was not reached
    stands_v: float = 0.01  # [m/s] speed below which the base stands: fingers neither close nor open above
    stands_w: float = 0.02  # [rad/s] yaw rate below which the base stands: fingers neither close nor open above


class Terms(NamedTuple):
    """Terms of the cost that count."""

    current: bool
    onward: bool
    nearest_at_bins: bool = False  # at a bin only the path counts


PoseSet = tuple[Array, IntArray, str]  # poses (m, 3), their directions about the target, and how they are called
PoseRule = Callable[[Target], Iterator[PoseSet]]  # sets of poses in the order in which they are wanted


@dataclasses.dataclass(kw_only=True)
class StationaryState(PlacementState):
    """The choice that stays until its target is done."""

    decided: Placement | None = None
    at: Array | None = None  # [m] position of the target at the choice
    over: bool = False  # the arm had to be over a seen obstacle already at the choice
    still_since: float | None = None  # [s] time since which the base stands away from the chosen pose
    refused: Array = dataclasses.field(default_factory=lambda: np.zeros((0, 2)))  # [m] poses that were not reached


class Rated(NamedTuple):
    """Candidates with their manipulability and costs."""

    candidates: Candidates
    direction: IntArray  # index of the direction about the target, shape (m,)
    share: Array  # manipulability as a share of the best there is, shape (m,)
    current: Array  # C_iC [s], inf when rejected
    onward: Array  # C_iN [s]
    cost: Array  # C_i [s]


class StationaryPlacement(Stateful[StationaryState]):
    """Base poses from the inverse reachability map; candidates of the paper's rule where none of them is free."""

    def __init__(
        self, parts: PlannerParts, graphs: GraphCache, terms: Terms, parameters: StationaryParameters | None = None,
        first: PoseRule | None = None,
    ) -> None:  # fmt: skip
        """``first``: poses that are tried before all others."""
        self.stationary = parameters or StationaryParameters()
        self.paper = NextTargetPlacement(parts.known.robot, parts.parameters, graphs)
        self.model = self.paper.model
        self.arm_reach = TargetReach(parts.known, parts.parameters)
        self._terms, self._first = terms, first
        self._state = StationaryState()
        self._last: Searched | None = None  # only to explain the choice; None: chosen by the paper's rule

    def place(self, problem: BaseProblem) -> Placement:
        """The earlier choice while it still serves, else a new one."""
        target = problem.target
        if target is None or target.kind == "drive":
            return self._by_paper_rule(problem)
        if not self._state.of(target):
            self._state = StationaryState(target=(target.kind, target.name))
        state = self._state
        if state.decided is not None:
            if self._stands_away(state, state.decided, problem, target):
                state.refused = np.vstack((state.refused, state.decided.goal[:2]))
            elif self._still_serves(state.decided, problem, target):
                return state.decided
        state.still_since, state.at = None, np.array(target.position[:2])
        state.decided = self._decide(problem, target, state.refused)
        if state.decided is None and len(state.refused):
            state.refused = np.zeros((0, 2))
            state.decided = self._decide(problem, target, state.refused)
        if state.decided is None:
            return self._by_paper_rule(problem)
        state.goal = np.array(state.decided.goal)
        state.over = bool(self._over_seen(state.goal[None], target, problem.world)[0])
        return state.decided

    def paths(self, index: int) -> tuple[Array, Array] | None:
        """Paths (m, 2) [m] of a candidate of the last choice: from the robot to it, and on to the next target."""
        return self.paper.paths(index) if self._last is None else self._last.paths(index)

    def _over_seen(self, poses: Array, target: Target, world: WorldMap) -> NDArray[np.bool_]:
        """True at poses (m, 3) with the arm over an obstacle outside the map, which counts as tall; shape (m,)."""
        points = world.seen_points[world.seen_static]
        return self.arm_reach.clear_of(poses, target, points) < self.stationary.arm_clearance

    def _stands_away(self, state: StationaryState, decided: Placement, problem: BaseProblem, target: Target) -> bool:
        """True when the base has long stood away from its pose: the map may show a path where there is none."""
        p = self.stationary
        there = np.hypot(*(problem.pose[:2] - decided.goal[:2])) <= p.park_distance + p.park_slack
        parked = there and self.model.reach.reached_from(problem.pose[None], target)[0]
        if parked or problem.engaged or abs(problem.twist[0]) > p.slow_v or abs(problem.twist[1]) > p.slow_w:
            state.still_since = None
        elif state.still_since is None:
            state.still_since = problem.time
        return state.still_since is not None and problem.time - state.still_since > p.patience

    def _by_paper_rule(self, problem: BaseProblem) -> Placement:
        """The paper's placement, with its hysteresis for the last choice."""
        placement, chosen = self.paper.decide(problem, self._chosen())
        self._state, self._last = StationaryState(target=chosen.target, goal=chosen.goal), None
        return placement

    def _chosen(self) -> PlacementState:
        """The last choice, as a state of the paper's rule."""
        return PlacementState(target=self._state.target, goal=self._state.goal)

    def _still_serves(self, decided: Placement, problem: BaseProblem, target: Target) -> bool:
        """True while the target is unmoved and in reach of the chosen pose, and base and arm are free there."""
        at = self._state.at
        if at is None or np.hypot(*(target.position[:2] - at)) > self.stationary.moved:
            return False
        goal = decided.goal[None]
        if not (self.model.reach.reached_from(goal, target)[0] and self.arm_reach.share(goal, target)[0] > 0.0):
            return False
        if not self._state.over and self._over_seen(goal, target, problem.world)[0]:
            return False
        margin = self.model.parameters.staa.margin
        return bool(clearances(goal, margin, field_of(problem.world), self.model.body)[0] >= margin)

    def _decide(self, problem: BaseProblem, target: Target, refused: Array) -> Placement | None:
        """The cheapest candidate, with those of the other directions; None when none is free."""
        survey = self.paper.survey(problem, self._chosen())
        survey = survey._replace(to_next=self._to_next(problem.next_target, survey))
        for pose, direction, mode in self._pose_sets(target):
            rated = self._rate(pose, direction, target, survey, refused)
            if np.isfinite(rated.cost).any():
                return self._shown(rated, mode, target, survey)
        return None

    def _pose_sets(self, target: Target) -> Iterator[PoseSet]:
        """Sets of poses in the order in which they are tried."""
        called = "pose"
        if self._first is not None:
            yield from self._first(target)
            called = "none of the fixed poses is free and near enough: pose"
        yield *self.dense(target), called

    def dense(self, target: Target) -> tuple[Array, IntArray]:
        """Poses (m, 3) of a polar grid about a target from which the arm reaches it, and their directions (m,)."""
        p = self.stationary
        poses = [np.zeros((0, 3))]  # a wide base may not get near enough at all
        direction: list[Any] = [np.zeros(0, np.int32)]
        for radius in np.arange(self.model.body.inner, self.model.farthest(target), p.radius_step):
            pose, _, place_of = spokes(target.position, radius, p.directions, p.headings)
            poses.append(pose)
            direction.append(place_of)
        pose, about = np.concatenate(poses), np.concatenate(direction)
        reached = self.arm_reach.good_share(pose, target) > 0.0
        return pose[reached], about[reached]

    def _rate(self, pose: Array, direction: IntArray, target: Target, survey: Survey, refused: Array) -> Rated:
        needed, here = self.model.placement.clearance, survey.here
        free = clearances(pose, needed, here.field, here.body) >= needed
        share = self.arm_reach.share(pose, target)
        place, place_of = np.unique(pose[:, :2], axis=0, return_inverse=True)
        reached = self.arm_reach.good_share(pose, target) > 0.0
        rejected = [
            ("" if ok else Rejection.NO_REACH) if fits else Rejection.NOT_FREE
            for fits, ok in zip(free, reached, strict=True)
        ]
        for place_refused in refused:
            for i in np.flatnonzero(np.hypot(*(pose[:, :2] - place_refused).T) <= self.stationary.refused_distance):
                rejected[i] = rejected[i] or Rejection.REFUSED
        of_place: Any = place_of.reshape(-1).astype(np.int32)
        judged = costs_of(Candidates(Mode.REACH, 0.0, pose, place, of_place, rejected), survey)
        candidates, current, onward = judged.candidates, judged.current, judged.onward
        cost = self._cost(target, share, self.arm_reach.azimuth(pose, target), current, onward)
        cost = cost + self.stationary.over_cost * self._over_seen(pose, target, here.world)
        return Rated(candidates, direction, share, current, onward, cost)

    def _cost(self, target: Target, share: Array, azimuth: Array, current: Array, onward: Array) -> Array:
        """Costs C_i [s], shape (m,); inf when rejected."""
        if self._terms.nearest_at_bins and target.kind == "place":
            return current
        p, viable = self.stationary, np.isfinite(current)
        cost = p.manipulability_weight * (1.0 - share)
        if not self._terms.current:  # of equal manipulability (the heading hardly matters): the robot faces it
            cost = p.manipulability_weight * (p.equal_share * np.floor((1.0 - share) / p.equal_share))
            cost += p.manipulability_weight * p.equal_share * (0.9 * azimuth / np.pi + 0.05 * (1.0 - share))
        if self._terms.current:
            cost = cost + np.where(viable, current, 0.0)
        if self._terms.onward:
            cost = cost + p.onward_weight * np.where(viable, onward, 0.0)
        return np.where(viable, cost, np.inf)

    def _to_next(self, target: Target | None, survey: Survey) -> Table | None:
        """Costs to the poses of the next target, with those of manipulability; None when they do not count.

        The poses are at the best position of each direction, with some headings.
        """
        if target is None or not self._terms.onward:
            return None
        here, rates = survey.here, self.model.rates
        if target.kind == "drive":
            return goal_table(here.graph, next_poses(target, survey), rates)
        needed = self.model.placement.clearance
        for pose, direction, _ in self._pose_sets(target):
            free = clearances(pose, needed, here.field, here.body) >= needed
            if free.any():
                share = self.arm_reach.share(pose[free], target)
                keep = _best_positions(pose[free], direction[free], share, self.stationary.next_headings)
                offsets = self.stationary.manipulability_weight * (1.0 - share[keep])
                return goal_table(here.graph, pose[free][keep], rates, offsets)
        return None

    def _shown(self, rated: Rated, mode: str, target: Target, survey: Survey) -> Placement:
        """Placement of the best pose of every direction, with the choice and the reasons of rejections."""
        keep = _best_of_directions(rated)
        pose = rated.candidates.pose[keep]
        current, onward, cost = rated.current[keep], rated.onward[keep], rated.cost[keep]
        chosen = int(np.argmin(cost))
        why = [rated.candidates.rejected[i] for i in keep]
        reasons = rejections(pose, self.model.placement.clearance, survey.here)
        why = [reason if text == Rejection.NOT_FREE else text for text, reason in zip(why, reasons, strict=True)]
        self._last = Searched(survey.here.graph, survey.from_robot, survey.to_next, pose, np.isfinite(cost))
        return Placement(
            mode=Mode.REACH,
            radius=float(np.hypot(*(pose[chosen, :2] - target.position[:2]))),
            poses=frozen(pose),
            cost_current=frozen(current),
            cost_next=frozen(onward),
            cost=frozen(cost),
            rejected=tuple(why),
            chosen=chosen,
            goal=frozen(pose[chosen]),
            goal_has_heading=True,
            why=Reason(kind=Kind.STATIONARY, other=self._reason(rated, keep[chosen], mode)),
            next_goal=None,
        )

    def _reason(self, rated: Rated, i: int, mode: str) -> str:
        text = f"{mode} with {100.0 * rated.share[i]:.0f} % of the best manipulability"
        if self._terms.current:
            text += f", {rated.current[i]:.1f} s to get there"
        if self._terms.onward:
            text += f" and {rated.onward[i]:.1f} s on to the next target"
        return text


def _best_of_directions(rated: Rated) -> list[int]:
    """Index of the cheapest candidate of each direction; of a direction without one, that of best manipulability."""
    order = np.lexsort((-rated.share, rated.cost, rated.direction))
    first = np.ones(len(order), dtype=bool)
    first[1:] = rated.direction[order][1:] != rated.direction[order][:-1]
    return [int(i) for i in order[first]]


def _best_positions(pose: Array, direction: IntArray, share: Array, headings: int) -> IntArray:
    """Indices of the best position of each direction, each with at most ``headings`` headings."""
    chosen = []
    for one in np.unique(direction):
        of_it = np.flatnonzero(direction == one)
        best = of_it[int(np.argmax(share[of_it]))]
        same = of_it[(pose[of_it, :2] == pose[best, :2]).all(axis=1)]
        chosen.append(same[:: max(1, -(-len(same) // headings))])
    return np.concatenate(chosen)


_PHASES = 32  # offsets of the equally spaced poses, of which the best is taken
_RIM_POINTS = 48  # of the line that the poses must serve
_OFFSETS = 5  # distances from the table that are tried
_STEP, _BIN_STEP = 0.05, 0.02  # [m] between them, at a table and at a bin
_FARTHEST = 1.1  # [m] from a bin
_NEAR, _BELOW = 0.10, 0.08  # [m] beside and above what carries an object


class FixedPoses:
    """Fixed poses at tables and bins, from the furniture that is known beforehand, by one rule for all.

    Objects stand along a line `fixed_inset` inside the edge of a table. The poses are equally spaced along that line,
    each at right angles to the edge and facing it. Their distance from the edge and their start on the line maximise
    the manipulability at the point of the line that is reached worst.
    """

    def __init__(self, parts: PlannerParts) -> None:
        known, self._p = parts.known, StationaryParameters()
        self._known, self._reach = known, TargetReach(known, parts.parameters)
        self._clearance = parts.parameters.placement.clearance + 0.01
        self._obstacles = unary_union([outline(solid.shape) for solid in known_solids(known)])
        self._bins = {item.name: item for item in known.bins}
        self._found: dict[tuple[str, ...], Array] = {}  # cache; a pure function of the names

    def __call__(self, target: Target) -> Iterator[PoseSet]:
        """The poses for a target as the one set; none for an object that stands on no furniture of the map."""
        poses = self.round(target)
        if len(poses):
            yield poses, np.arange(len(poses)), "fixed pose"

    def round(self, target: Target) -> Array:
        """The poses for a target, shape (7, 3); (0, 3) for an object that stands on no furniture of the map."""
        if target.kind == "place":
            key = ("bin", target.name)
            if key not in self._found:
                self._found[key] = self._round_bin(self._bins[target.name], target)
            return self._found[key]
        table = self._carrier(target)
        if table is None:
            return np.zeros((0, 3))
        key = ("table", table.name, target.name)
        if key not in self._found:
            self._found[key] = self._round_table(outline(table.shape), target)
        return self._found[key]

    def _carrier(self, target: Target) -> Solid | None:
        """The highest furniture below an object."""
        item = next(item for item in self._known.objects if item.name == target.name)
        at, bottom = ShapelyPoint(*target.position[:2]), item.position[2] - 0.5 * item.side
        below = [
            solid
            for solid in self._known.solids
            if abs(solid.z_max - bottom) <= _BELOW and outline(solid.shape).distance(at) <= _NEAR
        ]
        return max(below, key=lambda solid: (solid.z_max, solid.name), default=None)

    def _round_table(self, table: Polygon, target: Target) -> Array:
        rim, foot = self._along(table, np.arange(_RIM_POINTS) / _RIM_POINTS), self._known.robot.footprint
        if not len(rim):
            return np.zeros((0, 3))
        nose = 0.5 * foot.length + foot.offset_x + self._clearance
        sets = [self._spaced(table, nose + k * _STEP, j / _PHASES) for k in range(_OFFSETS) for j in range(_PHASES)]
        share = np.array([self._shares(np.concatenate(sets), target, point) for point in rim])
        worst = share.reshape(len(share), len(sets), -1).max(axis=2).min(axis=0)
        return sets[int(np.argmax(worst))]

    def _spaced(self, table: Polygon, distance: float, phase: float) -> Array:
        """Poses with the base's centre at a distance [m] from the edge; ``phase``: start, as a share of the spacing."""
        count, edge = self._p.fixed_poses, table.exterior
        poses = []
        for at in self._along(table, (np.arange(count) + phase) / count):
            nearest = edge.interpolate(edge.project(ShapelyPoint(*at)))
            out = np.array([nearest.x, nearest.y]) - at
            out /= np.hypot(*out)
            poses.append((nearest.x + distance * out[0], nearest.y + distance * out[1], math.atan2(-out[1], -out[0])))
        return np.array(poses)

    def _along(self, table: Polygon, shares: Array) -> Array:
        """Points (k, 2) at shares of the line inside the edge; none when the table is too narrow for one."""
        inside = table.buffer(-self._p.fixed_inset)
        if not isinstance(inside, Polygon) or inside.is_empty:
            return np.zeros((0, 2))
        points = [inside.exterior.interpolate(float(share), normalized=True) for share in shares]
        return np.array([(point.x, point.y) for point in points])

    def _shares(self, poses: Array, like: Target, point: Array) -> Array:
        return self._reach.good_share(poses, Target(kind=like.kind, name=like.name, position=point))

    def _round_bin(self, item: Bin, target: Target) -> Array:
        """Poses in equal directions about a bin, each as near as the furniture lets it, facing the bin."""
        sets, centre = [], np.array(item.centre)
        obstacles = unary_union([self._obstacles, rectangle((*item.centre, item.yaw), (item.side, item.side))])
        for j in range(_PHASES):
            angles = 2.0 * math.pi * (np.arange(self._p.fixed_poses) + j / _PHASES) / self._p.fixed_poses
            sets.append(np.array([self._nearest(centre, angle, obstacles) for angle in angles]))
        share = self._shares(np.concatenate(sets), target, centre).reshape(len(sets), -1)
        return sets[int(np.argmax(share.max(axis=1)))]

    def _nearest(self, centre: Array, angle: float, obstacles: BaseGeometry) -> tuple[float, float, float]:
        heading = math.remainder(angle + math.pi, 2.0 * math.pi)
        pose = (0.0, 0.0, 0.0)
        for distance in np.arange(0.4, _FARTHEST, _BIN_STEP):
            x, y = centre[0] + distance * math.cos(angle), centre[1] + distance * math.sin(angle)
            pose = (float(x), float(y), heading)
            if base_outline(pose, self._known.robot.footprint).distance(obstacles) >= self._clearance:
                break
        return pose
