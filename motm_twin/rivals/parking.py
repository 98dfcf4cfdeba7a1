"""The base and arm of a robot that stops to manipulate: parameters, the way to a pose, and the stand there."""

import dataclasses
import math

import msgspec
import numpy as np

from motm_twin.control.arm.controller import ArmWays, Manipulator
from motm_twin.control.arm.phases import PhaseRules
from motm_twin.control.arm.types import ArmInputs
from motm_twin.control.method import ArmParts, PlannerParts
from motm_twin.model.geometry import Array, frozen
from motm_twin.model.motion import drive
from motm_twin.model.profile import DEG
from motm_twin.model.state import Stateful
from motm_twin.perception.still_map import StillMap
from motm_twin.planning.braking import stopping_clearance
from motm_twin.planning.collision import field_of
from motm_twin.planning.controller import StaaController
from motm_twin.planning.global_path import GraphCache
from motm_twin.planning.parameters import PlanningParameters
from motm_twin.planning.types import BasePlan, BaseProblem, Placement, PlanStatus, SearchBudget, Target
from motm_twin.rivals.reachability import TargetReach


@dataclasses.dataclass(frozen=True, kw_only=True)
class StationaryParameters:
    """Parameters of standing poses: candidates, costs, and when a pose is close enough."""

    manipulability_weight: float = 5.0  # [s] more for no manipulability: no value from 0 to 40 s is faster
    onward_weight: float = 1.0  # of the way on to the next target, in `sequential`: a second is a second on both ways
    arm_clearance: float = 0.13  # [m] to either side of the arm: 0.07 m of forearm, and where it begins to be slowed
    over_cost: float = 100.0  # [s] of a pose with less, to an obstacle outside the map: only when there is no other
    directions: int = 36  # of candidates about the target, as many as the paper's ring has
    headings: int = 16  # at each position, as many as `motm` has where it tries any heading
    radius_step: float = 0.05  # [m] between rings of candidates, as the paper's rings have here
    next_headings: int = 8  # of a next target's poses, at the best position of each direction: half, to save time
    equal_share: float = 0.01  # of the best manipulability: smaller differences are ignored
    fixed_poses: int = 7  # Paper, Sec. VI, after Reister et al.
    fixed_inset: float = 0.10  # [m] from the edge of a table: where objects to be reached stand
    moved: float = 0.15  # [m] motion of the target that triggers a new choice: beliefs are off by 0.1
    park_distance: float = 0.15  # [m] from the chosen pose at which the base may rest: as near as STAA* comes here
    park_share: float = 0.90  # of the manipulability of the chosen pose that it must have there: or it drives on
    park_slack: float = 0.02  # [m] inside the reach, because localisation errs by 1 cm
    goal_distance: float = 0.06  # [m] to which the search must come, and
    goal_heading: float = 10.0 * DEG  # [rad], once the base has become slow too far away: it would stay there otherwise
    slow_v: float = 0.10  # [m/s] and
    slow_w: float = 0.30  # [rad/s] below which a base near its pose creeps
    patience: float = 3.0  # [s] standing on the way, where the map shows one and there is none, until another pose,
    refused_distance: float = 0.20  # [m] this far away at least, is chosen
    stands_v: float = 0.01  # [m/s] and
    stands_w: float = 0.02  # [rad/s] below which the base stands: fingers neither close nor open above


DRIVING, STOPPING, PARKED = "driving", "stopping", "parked"


@dataclasses.dataclass(kw_only=True)
class ParkingState:
    """Phase of the base, and its target."""

    target: tuple[str, str] | None = None
    phase: str = DRIVING
    exact: bool = False  # the base has become slow at the pose without reaching the target: it must come closer


def stopping_base(parameters: PlanningParameters) -> PlanningParameters:
    """The same base controller, with a search that ends at the chosen pose instead of passing it."""
    return dataclasses.replace(
        parameters, staa=dataclasses.replace(parameters.staa, termination="reach_goal", drive_on=False)
    )


class ParkingController(Stateful[ParkingState]):
    """STAA* towards the chosen pose, then the shortest possible stop, as soon as it ends close enough."""

    def __init__(
        self, parts: PlannerParts, graphs: GraphCache, *, overlap: bool, parameters: StationaryParameters | None = None,
        still: StillMap | None = None,
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
        self._asked = self._usual  # only to explain the last period
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
        return self._standing(problem, placement)

    def staa_path(self) -> Array:
        """The path of unmodified STAA* in the last period, shape (m, 2) [m]; empty when there was no target."""
        return self._asked.staa_path()

    def _search(self, problem: BaseProblem, placement: Placement, budget: SearchBudget) -> BasePlan:
        self._asked = self._base
        return self._base.plan(problem, placement, budget)

    @property
    def _base(self) -> StaaController:
        """The controller with the tolerances of the state."""
        return self._exact if self._state.exact else self._usual

    def _advance(self, problem: BaseProblem, placement: Placement, target: Target) -> None:
        """Drive, stop, or stand."""
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
        """Does the shortest stop from here end near enough to the chosen pose, and with as good a reach?

        A base that has become slow close enough accepts any reach: creeping takes longer than a longer arm motion.
        """
        p, goal = self.stationary, np.asarray(placement.goal)
        ahead = p.park_distance + problem.twist[0] ** 2 / (2.0 * self._limits.linear_acceleration) + 0.05
        if math.hypot(*(problem.pose[:2] - goal[:2])) > ahead:
            return False
        end = self._stop_ends(problem)[-1, :3]
        if math.hypot(*(end[:2] - goal[:2])) > p.park_distance:
            return False
        if not self._reach.reached_from(end[None], target, slack=p.park_slack)[0]:
            return False
        share = self._arm_reach.share(np.array([end, goal]), target)
        wanted = 1e-6 if self._slow(problem.twist) else p.park_share * share[1]
        good = share[0] >= wanted or share[1] == 0.0  # the paper's own candidates may be where the map ends
        return bool(good) and self._stop_is_free(problem)

    def _stop_ends(self, problem: BaseProblem) -> Array:
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
        """With the margin of the search: it ends with another heading than the chosen one, which has room enough."""
        p = self._usual.parameters
        wanted = p.margin_floor if self._slow(problem.twist) else p.margin
        pose, twist, most = problem.pose.tolist(), problem.twist.tolist(), self._limits.accelerations.tolist()
        free = stopping_clearance(*pose, *twist, *most, wanted, field_of(problem.world), self._body)
        return free >= wanted

    def _standing(self, problem: BaseProblem, placement: Placement) -> BasePlan:
        """Come to rest, and stay."""
        rows = self._stop_ends(problem)
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
        """The plan of an approaching base, with the time until it stands instead of the time to reach."""
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
