"""A base that drives to its place, brakes at full deceleration, and stands there until the task has moved on."""

import dataclasses
import math

import msgspec
import numpy as np

from motm_twin.methods.method import PlannerParts
from motm_twin.methods.stationary.parameters import StationaryParameters
from motm_twin.methods.stationary.reach_of import TargetReach
from motm_twin.model.geometry import Array, drive, frozen
from motm_twin.model.state import Stateful
from motm_twin.perception.still_map import StillMap
from motm_twin.planning.braking import stopping_clearance
from motm_twin.planning.collision import field_of
from motm_twin.planning.controller import StaaController
from motm_twin.planning.global_path import GraphCache
from motm_twin.planning.parameters import PlanningParameters
from motm_twin.planning.types import BasePlan, BaseProblem, Placement, SearchBudget, Target, empty_path

DRIVING, STOPPING, PARKED = "driving", "stopping", "parked"


@dataclasses.dataclass(kw_only=True)
class ParkingState:
    """What the base is about, and for which target."""

    target: tuple[str, str] | None = None
    phase: str = DRIVING
    exact: bool = False  # the base has become slow at the pose and still does not serve: it has to come nearer


def stopping_base(parameters: PlanningParameters) -> PlanningParameters:
    """The same base controller, but one whose search ends at the chosen pose instead of passing it."""
    return dataclasses.replace(
        parameters, staa=dataclasses.replace(parameters.staa, termination="reach_goal", drive_on=False)
    )


class ParkingController(StaaController, Stateful[ParkingState]):
    """STAA* to the chosen pose, then the shortest stop there is, as soon as that ends near enough to it."""

    def __init__(
        self, parts: PlannerParts, graphs: GraphCache, *, overlap: bool, parameters: StationaryParameters | None = None,
        still: StillMap | None = None,
    ) -> None:  # fmt: skip
        """``overlap``: the arm is told how soon the base will stand, and moves already while it arrives."""
        self.stationary = parameters or StationaryParameters()
        super().__init__(
            parts.known.robot, stopping_base(parts.parameters), clock=parts.clock, graphs=graphs, still=still
        )
        self._usual = self._p
        self._exact = dataclasses.replace(
            self._p,
            pass_distance=min(self._p.pass_distance, self.stationary.goal_distance),
            pass_heading=min(self._p.pass_heading, self.stationary.goal_heading),
        )
        self._overlap = overlap
        self._arm_reach = TargetReach(parts.known, parts.parameters)
        self._state = ParkingState()

    def plan(self, problem: BaseProblem, placement: Placement, budget: SearchBudget) -> BasePlan:
        """How to accelerate in this period."""
        target = problem.target
        if target is None or target.kind == "drive" or placement.mode not in ("ring", "reach"):
            self._state, self._p = ParkingState(), self._usual
            return self._without_arm(super().plan(problem, placement, budget))
        if self._state.target != (target.kind, target.name):
            self._state = ParkingState(target=(target.kind, target.name))
        self._tighten()
        self._advance(problem, placement, target)
        self._tighten()
        if self._state.phase == DRIVING:
            return self._arriving(super().plan(problem, placement, budget))
        return self._standing(problem, placement)

    def _tighten(self) -> None:
        """Search with the tolerances of the state."""
        self._p = self._exact if self._state.exact else self._usual

    def _advance(self, problem: BaseProblem, placement: Placement, target: Target) -> None:
        """Drive, stop, or stand."""
        state = self._state
        if state.phase == STOPPING and self._stands(problem.twist):
            state.phase = PARKED
        if state.phase == PARKED and not problem.engaged and not self._serves(problem.pose, target):
            state.phase = DRIVING
        if state.phase == DRIVING and placement.chosen >= 0 and self._may_stop(problem, placement, target):
            state.phase = PARKED if self._stands(problem.twist) else STOPPING
        if state.phase != DRIVING:
            state.exact = False
        elif self._slow(problem.twist) and placement.chosen >= 0 and self._at(problem.pose, placement):
            state.exact = True

    def _stands(self, twist: Array) -> bool:
        return abs(twist[0]) < self.stationary.stands_v and abs(twist[1]) < self.stationary.stands_w

    def _slow(self, twist: Array) -> bool:
        return abs(twist[0]) < self.stationary.slow_v and abs(twist[1]) < self.stationary.slow_w

    def _serves(self, pose: Array, target: Target) -> bool:
        """Does a base that stands have the target in reach?"""
        return self._reach.contains(pose, np.zeros(2), target, self._p)

    def _may_stop(self, problem: BaseProblem, placement: Placement, target: Target) -> bool:
        """Does the shortest stop from here end near enough to the chosen pose, and with as good a reach?

        A base that has become slow near enough is content with any reach: creeping takes longer than a longer arm.
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
        most = self._most() * problem.period
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
        wanted = self._p.margin_floor if self._slow(problem.twist) else self._p.margin
        most, (x, y, heading), (v, w) = self._most(), problem.pose, problem.twist
        free = stopping_clearance(
            float(x), float(y), float(heading), float(v), float(w), float(most[0]), float(most[1]), wanted,
            field_of(problem.world), self._body,
        )  # fmt: skip
        return free >= wanted

    def _most(self) -> Array:
        return np.array([self._limits.linear_acceleration, self._limits.yaw_acceleration])

    def _standing(self, problem: BaseProblem, placement: Placement) -> BasePlan:
        """Come to rest, and stay."""
        rows = self._stop_ends(problem)
        times = np.arange(len(rows)) * problem.period
        most = self._most()
        left = float(times[-1]) if self._state.phase == STOPPING else 0.0
        return BasePlan(
            acceleration=frozen(np.clip(-problem.twist / problem.period, -most, most)),
            status="goal",
            reason="",
            global_path=empty_path(),
            next_path=empty_path(),
            intermediate_goal=frozen(placement.goal),
            local_poses=frozen(rows),
            local_times=frozen(times),
            bezier=empty_path(),
            expansions=0,
            cut_by_clock=False,
            t_h=left,
            k=self._k(left),
            time_to_range=left if self._overlap or self._state.phase == PARKED else math.inf,
        )

    def _arriving(self, plan: BasePlan) -> BasePlan:
        """The plan of a base on its way, with the time until it stands instead of that until it is in reach."""
        if not self._overlap or not math.isfinite(plan.t_h):
            return self._without_arm(plan)
        brake = self._limits.forward_speed / (2.0 * self._limits.linear_acceleration)
        on_the_way = float(plan.local_times[-1]) if plan.status == "goal" else plan.t_h
        return msgspec.structs.replace(plan, time_to_range=max(on_the_way + brake, 0.05))

    def _without_arm(self, plan: BasePlan) -> BasePlan:
        return msgspec.structs.replace(plan, time_to_range=math.inf)
