"""The stop-then-manipulate methods of Reister et al. on this robot, and a stronger form of the best of them.

First the base controller that drives to a pose and stands there, and the arm that waits for it; then the methods.
"""

import dataclasses
import math
from collections.abc import Callable
from functools import partial

import msgspec
import numpy as np

from motm_twin.control.arm.controller import ArmWays, Manipulator
from motm_twin.control.arm.phases import PhaseRules
from motm_twin.control.arm.types import ArmInputs
from motm_twin.control.method import ArmParts, BaseChoices, Materials, Method, PlannerParts, Policies
from motm_twin.model.geometry import Array, frozen
from motm_twin.model.motion import drive
from motm_twin.model.state import Stateful
from motm_twin.perception.still_map import StaticMap
from motm_twin.planning.braking import stopping_clearance
from motm_twin.planning.candidates import Rule
from motm_twin.planning.collision import field_of
from motm_twin.planning.controller import StaaController
from motm_twin.planning.global_path import GraphCache
from motm_twin.planning.parameters import PlanningParameters
from motm_twin.planning.types import (
    BaseController,
    BasePlan,
    BaseProblem,
    Placement,
    PlacementStrategy,
    PlanStatus,
    SearchBudget,
    Target,
)
from motm_twin.rivals.reachability import TargetReach
from motm_twin.rivals.stationary_placement import FixedPoses, PoseRule, StationaryParameters, StationaryPlacement, Terms

DRIVING, STOPPING, PARKED = "driving", "stopping", "parked"


@dataclasses.dataclass(kw_only=True)
class ParkingState:
    """Phase of the base, and its target."""

    target: tuple[str, str] | None = None
    phase: str = DRIVING
    exact: bool = False  # the base became slow at the pose but may not stop there: it must come closer


def stopping_base(parameters: PlanningParameters) -> PlanningParameters:
    """Parameters for the same search, but ending at the chosen pose instead of passing it."""
    return dataclasses.replace(
        parameters, staa=dataclasses.replace(parameters.staa, termination="reach_goal", drive_on=False)
    )


class ParkingController(Stateful[ParkingState]):
    """Base controller: STAA* towards the chosen pose, then the shortest stop, once that ends close enough."""

    def __init__(
        self, parts: PlannerParts, graphs: GraphCache, *, overlap: bool, parameters: StationaryParameters | None = None,
        still: StaticMap | None = None,
    ) -> None:  # fmt: skip
        """``overlap``: the arm is told how soon the base will stand, and moves already while it arrives."""
        p = self.stationary = parameters or StationaryParameters()
        stopping = stopping_base(parts.parameters)
        near = dataclasses.replace(
            stopping.staa,
            pass_distance=min(stopping.staa.pass_distance, p.goal_distance),
            pass_heading=min(stopping.staa.pass_heading, p.goal_heading),
        )
        self._usual, self._exact = (
            StaaController(parts.known.robot, each, clock=parts.clock, graphs=graphs, still=still)
            for each in (stopping, dataclasses.replace(stopping, staa=near))
        )
        self._asked = self._usual  # of the last period, only to explain it
        self._limits, self._body, self._reach = self._usual.limits, self._usual.body, self._usual.reach
        self._overlap = overlap
        self._arm_reach = TargetReach(parts.known, parts.parameters)
        self._state = ParkingState()

    def plan(self, problem: BaseProblem, placement: Placement, budget: SearchBudget) -> BasePlan:
        """Plan the acceleration of this period."""
        target = problem.target
        if target is None or target.kind == "drive" or placement.mode not in ("ring", "reach"):
            self._state = ParkingState()
            return msgspec.structs.replace(self._search(problem, placement, budget), time_to_range=math.inf)
        if self._state.target != (target.kind, target.name):
            self._state = ParkingState(target=(target.kind, target.name))
        self._advance(problem, placement, target)
        if self._state.phase == DRIVING:
            return self._arriving(self._search(problem, placement, budget))
        return self._come_to_rest(problem, placement)

    def staa_path(self) -> Array:
        """The path of unmodified STAA* in the last period, shape (m, 2) [m]; empty when there was no target."""
        return self._asked.staa_path()

    def _search(self, problem: BaseProblem, placement: Placement, budget: SearchBudget) -> BasePlan:
        self._asked = self._base
        return self._base.plan(problem, placement, budget)

    @property
    def _base(self) -> StaaController:
        """The controller with the usual tolerances, or the exact ones, by the state."""
        return self._exact if self._state.exact else self._usual

    def _advance(self, problem: BaseProblem, placement: Placement, target: Target) -> None:
        """Change the phase: driving, stopping or parked."""
        state = self._state
        if state.phase == STOPPING and _stands(problem.twist, self.stationary):
            state.phase = PARKED
        if state.phase == PARKED and not problem.engaged:
            serves = self._reach.contains(problem.pose, np.zeros(2), target)
            state.phase = PARKED if serves else DRIVING
        if state.phase == DRIVING and placement.chosen >= 0 and self._may_stop(problem, placement, target):
            state.phase = PARKED if _stands(problem.twist, self.stationary) else STOPPING
        if state.phase != DRIVING:
            state.exact = False
        elif self._slow(problem.twist) and placement.chosen >= 0 and self._base.at_goal(problem.pose, placement):
            state.exact = True

    def _slow(self, twist: Array) -> bool:
        return abs(twist[0]) < self.stationary.slow_v and abs(twist[1]) < self.stationary.slow_w

    def _may_stop(self, problem: BaseProblem, placement: Placement, target: Target) -> bool:
        """True when the shortest stop is free and ends near the chosen pose, with nearly its manipulability.

        A slow base near the pose accepts any manipulability: creeping takes longer than a longer arm motion.
        """
        p, goal = self.stationary, np.asarray(placement.goal)
        ahead = p.park_distance + problem.twist[0] ** 2 / (2.0 * self._limits.linear_acceleration) + 0.05
        if math.hypot(*(problem.pose[:2] - goal[:2])) > ahead:
            return False
        end = self._shortest_stop(problem)[-1, :3]
        if math.hypot(*(end[:2] - goal[:2])) > p.park_distance:
            return False
        if not self._reach.reached_from(end[None], target, slack=p.park_slack)[0]:
            return False
        share = self._arm_reach.share(np.array([end, goal]), target)
        needed = 1e-6 if self._slow(problem.twist) else p.park_share * share[1]
        good = share[0] >= needed or share[1] == 0.0  # candidates of the paper's rule may lie outside the map
        return bool(good) and self._stop_is_free(problem)

    def _shortest_stop(self, problem: BaseProblem) -> Array:
        """Poses and twists of the shortest stop, one per period, shape (n, 5)."""
        most = self._limits.accelerations * problem.period
        pose, twist = np.array(problem.pose, dtype=np.float64), np.array(problem.twist, dtype=np.float64)
        rows = [np.array([*pose, *twist])]
        while twist.any():
            after = np.sign(twist) * np.maximum(np.abs(twist) - most, 0.0)
            mean = 0.5 * (twist + after)
            pose, twist = drive(pose, mean[0], mean[1], problem.period), after
            rows.append(np.array([*pose, *twist]))
        return np.array(rows)

    def _stop_is_free(self, problem: BaseProblem) -> bool:
        """True when the stop keeps the margin of the search: unlike the chosen pose, its end may have no room."""
        p = self._usual.parameters
        needed = p.margin_floor if self._slow(problem.twist) else p.margin
        pose, twist, most = problem.pose.tolist(), problem.twist.tolist(), self._limits.accelerations.tolist()
        free = stopping_clearance(*pose, *twist, *most, needed, field_of(problem.world), self._body)
        return free >= needed

    def _come_to_rest(self, problem: BaseProblem, placement: Placement) -> BasePlan:
        """Plan to come to rest, and stay."""
        rows = self._shortest_stop(problem)
        times = np.arange(len(rows)) * problem.period
        left = float(times[-1]) if self._state.phase == STOPPING else 0.0
        return BasePlan(
            acceleration=frozen(self._limits.within(-problem.twist / problem.period)),
            status=PlanStatus.GOAL,
            intermediate_goal=frozen(placement.goal),
            local_poses=frozen(rows),
            local_times=frozen(times),
            t_h=left,
            k=self._usual.penalty_scale(left),
            time_to_range=left if self._overlap or self._state.phase == PARKED else math.inf,
        )

    def _arriving(self, plan: BasePlan) -> BasePlan:
        """The plan of an approaching base, with the time until it stands as the time to range."""
        if not self._overlap or not math.isfinite(plan.t_h):
            return msgspec.structs.replace(plan, time_to_range=math.inf)
        brake = self._limits.forward_speed / (2.0 * self._limits.linear_acceleration)
        on_the_way = float(plan.local_times[-1]) if plan.status == PlanStatus.GOAL else plan.t_h
        return msgspec.structs.replace(plan, time_to_range=max(on_the_way + brake, 0.05))


_NEVER = -1.0  # [m/s] no hand is this slow


def fingers_wait(usual: PhaseRules, inputs: ArmInputs) -> PhaseRules:
    """Rules of the phases by which fingers close on an object, and let go of it, only while the base stands."""
    if _stands(inputs.observation.twist, StationaryParameters()):
        return usual
    waiting = msgspec.structs.replace(usual.parameters, close_speed=_NEVER, release_speed=_NEVER)
    return dataclasses.replace(usual, parameters=waiting)


def _stands(twist: Array, p: StationaryParameters) -> bool:
    return abs(twist[0]) < p.stands_v and abs(twist[1]) < p.stands_w


def standing_arm(parts: ArmParts) -> Manipulator:
    """The arm of a robot that stops to manipulate."""
    return Manipulator(parts.known, parts.parameters, ways=ArmWays(rules=fingers_wait))


MANIPULABILITY = Terms(current=False, onward=False)
FIXED_TERMS = Terms(current=False, onward=False, nearest_at_bins=True)
GREEDY_TERMS = Terms(current=True, onward=False)
ALL_TERMS = Terms(current=True, onward=True)
_SOURCE = "Reister, Grotz and Asfour, RA-L 2022; Paper, Sec. VI"
_STANDING = (
    "It drives with the same base controller and limits as motm, whose search ends at the pose. As soon as a stop at "
    "full deceleration would end within 0.15 m of the pose and with 90 % of its manipulability, it does so: STAA* "
    "alone creeps towards a pose. The arm is stowed until the base is told to stand, the fingers wait until it does, "
    "and it leaves when the object is lifted 3 cm or let go. A pose that is no longer free or in reach is chosen anew."
)
_MAP = (
    "Manipulability is sqrt(det(J J^T)) from inverse kinematics of this arm at the height of the object or the bin's "
    "rim: the best over joint 7, both elbows and wrists and the faces of the cube, within joint limits and clear of "
    "the table. Their measure and weights are not known to us. "
)
_COST = "A pose without manipulability costs 5 s more than the best one; ways count their seconds, weight 1."


def stationary(
    terms: Terms,
    first: Callable[[PlannerParts], PoseRule] | None = None,
    parameters: StationaryParameters | None = None,
) -> Callable[[Materials, Rule], PlacementStrategy]:
    """Placement by these terms of the cost; ``first``: poses that are tried before all others."""

    def placement(materials: Materials, candidates: Rule) -> PlacementStrategy:
        parts = materials.parts
        return StationaryPlacement(parts, materials.graphs, terms, parameters, None if first is None else first(parts))

    return placement


def parking(
    materials: Materials, policies: Policies, *, overlap: bool = False,
    parameters: StationaryParameters | None = None,
) -> BaseController:  # fmt: skip
    """Base controller that stops at the pose; ``overlap``: the arm moves already while the base arrives."""
    return ParkingController(
        materials.parts, materials.graphs, overlap=overlap, parameters=parameters, still=materials.ahead
    )


IRM = Method(
    name="irm",
    title="IRM",
    summary="Stops at the pose with the highest manipulability, however far away it is.",
    source=_SOURCE,
    known="The pose is chosen by a manipulability metric only, without navigation costs; 192.9 s on their robot.",
    chosen=(
        "Of poses within 1 % of the best, the one that faces the target most: the heading hardly changes the measure. "
        f"{_MAP}{_STANDING}"
    ),
    planner=BaseChoices(placement=stationary(MANIPULABILITY), controller=parking),
    arm=standing_arm,
)

FIXED_SET = Method(
    name="fixed_set",
    title="Fixed set",
    summary="Stops at the one of seven fixed poses round the table with the highest manipulability.",
    source=_SOURCE,
    known="Seven fixed candidates spaced around and facing the object table, chosen among by manipulability.",
    chosen=(
        "The seven are equally spaced along a line 10 cm inside the table's edge, at right angles to the edge; their "
        "distance and first place are those with which the worst point of the line is served best. At a bin it takes "
        "the nearest of seven poses that face the bin. Where none is free and near enough, it does as irm; it measures "
        "and stops as irm does."
    ),
    planner=BaseChoices(placement=stationary(FIXED_TERMS, first=FixedPoses), controller=parking),
    arm=standing_arm,
)

GREEDY = Method(
    name="greedy",
    title="Greedy",
    summary="Stops at the pose with the best sum of manipulability and driving cost.",
    source=_SOURCE,
    known="Manipulability and the navigation cost to the candidate.",
    chosen=f"{_COST} It measures and stops as irm does.",
    planner=BaseChoices(placement=stationary(GREEDY_TERMS), controller=parking),
    arm=standing_arm,
)

SEQUENTIAL = Method(
    name="sequential",
    title="Sequential",
    summary="Stops at the pose with the best sum of manipulability and driving cost, there and on to the next target.",
    source=_SOURCE,
    known=(
        "A weighted cost of manipulability, navigation to the candidate and on to the next location; 172.3 s on their "
        "robot, of which 40 s are an allowance for grasps."
    ),
    chosen=(
        f"{_COST} The way on ends at the pose of the next target that is best by the same cost. It measures and stops "
        "as irm does."
    ),
    planner=BaseChoices(placement=stationary(ALL_TERMS), controller=parking),
    arm=standing_arm,
)

SEQUENTIAL_OVERLAP = Method(
    name="sequential_overlap",
    title="Sequential, arm early",
    summary="Like sequential, but the arm reaches out while the base arrives; the fingers close once it stands.",
    source="own, after Reister, Grotz and Asfour",
    known=(
        "The hand arrives as the base does, says the paper of Reister et al. (Sec. II); not how, nor in which times."
    ),
    chosen="The arm starts by the rule of motm, with the time until the base stands. All else is as in sequential.",
    planner=BaseChoices(placement=stationary(ALL_TERMS), controller=partial(parking, overlap=True)),
    arm=standing_arm,
)

STATIONARY = (FIXED_SET, IRM, GREEDY, SEQUENTIAL, SEQUENTIAL_OVERLAP)
