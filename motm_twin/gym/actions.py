"""Base and arm controllers that follow an agent's actions, the method of each action mode, and a forecast of the base.

The arm of MotM starts towards its target shortly before the target is in reach. A plan tells it when; an agent has no
plan, so the forecast assumes that its twist is kept.
"""

import math
from dataclasses import dataclass, field
from functools import partial

import msgspec
import numpy as np

from motm_twin.control.arm.controller import Decision, Manipulator
from motm_twin.control.arm.parameters import ArmParameters, numbers
from motm_twin.control.arm.phases import enter
from motm_twin.control.arm.program import anchor, base_bounds, joint_bounds
from motm_twin.control.arm.types import ArmInputs, ArmStep, Phase, ProgramStatus
from motm_twin.control.arm.view import ManipulatorState, View
from motm_twin.control.by_hand import ByHand
from motm_twin.control.method import ArmParts, Method, PlannerParts
from motm_twin.model.edits import Drive
from motm_twin.model.exact import norm
from motm_twin.model.geometry import Array, frozen, to_frame
from motm_twin.model.known import KnownWorld
from motm_twin.model.motion import kernel, step
from motm_twin.model.plant import PERIOD
from motm_twin.model.profile import RobotProfile
from motm_twin.model.reason import Kind, Reason
from motm_twin.model.state import Stateful
from motm_twin.planning.parameters import PlanningParameters
from motm_twin.planning.planner import BasePlanner
from motm_twin.planning.reach import Job, ReachModel, in_reach
from motm_twin.planning.rtr import turn
from motm_twin.planning.types import BasePlan, BaseProblem, Placement, PlanStatus, SearchBudget, Target, no_placement

STEP = 0.1  # [s] between two poses of the forecast
STEPS = 30  # 3 s: about the longest time before arrival at which the arm starts


class Forecast:
    """Predicts the motion of a base that keeps a commanded twist, and its time to range."""

    def __init__(self, profile: RobotProfile, parameters: PlanningParameters) -> None:
        self._limits = profile.base
        self._reach = ReachModel(profile, parameters.reach)
        self._staa = parameters.staa

    def motion(self, pose: Array, twist: Array, desired: Array) -> tuple[Array, Array]:
        """Times [s] from now, shape (31,), and x, y, heading, v, w then, shape (31, 5), if ``desired`` is kept."""
        poses, (dv, dw) = np.empty((STEPS + 1, 5)), (self._limits.accelerations * STEP).tolist()
        follow(*(np.asarray(one, dtype=float) for one in (pose, twist, desired)), dv, dw, poses)
        return frozen(STEP * np.arange(STEPS + 1)), poses

    def time_to_range(self, times: Array, poses: Array, target: Target | None) -> float:
        """Time [s] until the target is in reach; 0 when it already is, inf without a target.

        For a target that stays out of reach: the length of the forecast, or the time to turn and drive
        straight to it if that is longer, so that the arm does not start too early.
        """
        if target is None:
            return math.inf
        job = self._reach.job(target, self._staa)
        first = first_in_reach(poses, job)
        if first >= 0:
            return float(times[first])
        return max(float(times[-1]), self._straight(poses[0], job))

    def _straight(self, pose: Array, job: Job) -> float:
        """Time [s] to turn to the target and drive straight until it is in reach, without regard to obstacles."""
        dx, dy = job.x - pose[0], job.y - pose[1]
        way = max(0.0, math.hypot(dx, dy) - job.mount_x - job.r_max)
        turning = float(turn(float(pose[2]), math.atan2(dy, dx)))
        return turning / self._limits.yaw_rate + way / self._limits.forward_speed


@kernel
def follow(pose: Array, twist: Array, desired: Array, dv: float, dw: float, out: Array) -> None:
    """Fill ``out`` (n, 5) with x, y, heading, v, w every `STEP`; the twist changes by at most dv, dw per step."""
    x, y, heading, v, w = pose[0], pose[1], pose[2], twist[0], twist[1]
    for i in range(out.shape[0]):
        out[i, 0], out[i, 1], out[i, 2], out[i, 3], out[i, 4] = x, y, heading, v, w
        next_v = v + min(max(desired[0] - v, -dv), dv)
        next_w = w + min(max(desired[1] - w, -dw), dw)
        x, y, heading = step(x, y, heading, v, w, next_v, next_w, STEP)
        v, w = next_v, next_w


@kernel
def first_in_reach(poses: Array, job: Job) -> int:
    """Index of the first pose (n, 5) from which the job's target is in reach; -1: none."""
    for i in range(poses.shape[0]):
        if in_reach(poses[i, 0], poses[i, 1], poses[i, 2], poses[i, 3], poses[i, 4], job):
            return i
    return -1


AT_OBJECT = 0.03  # [m] largest distance of the tool centre point from the believed object for a grasp
MODES = ("base", "whole_body")


@dataclass
class BaseActionState:
    """Twist requested by the agent."""

    twist: Array = field(default_factory=lambda: np.zeros(2))  # [m/s, rad/s]


class BaseAction(Stateful[BaseActionState]):
    """A `BaseController` that follows the last requested twist, within the accelerations of the base."""

    def __init__(self, profile: RobotProfile, parameters: PlanningParameters, *, guard: bool = False) -> None:
        """``guard``: slow the base so that it can stop clear of mapped obstacles, as in driving by hand."""
        self._guard = ByHand(profile, PERIOD) if guard else None
        self._limits = profile.base
        self.forecast = Forecast(profile, parameters)
        self._state = BaseActionState()

    @property
    def twist(self) -> Array:
        """Requested twist, shape (2,) [m/s, rad/s]."""
        return self._state.twist.copy()

    def take(self, twist: Array) -> None:
        """Request this twist from the next period on, shape (2,) [m/s, rad/s]."""
        self._state.twist = np.array(twist, dtype=float)

    def plan(self, problem: BaseProblem, placement: Placement, budget: SearchBudget) -> BasePlan:
        """A plan that accelerates towards the requested twist; its poses and time to range are the forecast's."""
        del placement, budget  # there is nothing to search
        desired = self._state.twist
        acceleration, why = self._acceleration(problem)
        times, poses = self.forecast.motion(problem.pose, problem.twist, desired)
        return BasePlan(
            acceleration=frozen(acceleration),
            status=PlanStatus.AGENT,
            why=why,
            intermediate_goal=frozen(np.full(3, math.nan)),
            local_poses=frozen(poses),
            local_times=frozen(times),
            t_h=math.inf,
            time_to_range=self.forecast.time_to_range(times, poses, problem.target),
        )

    def _acceleration(self, problem: BaseProblem) -> tuple[Array, Reason | None]:
        """Acceleration towards the requested twist, and the reason when it is limited; shape (2,) [m/s^2, rad/s^2]."""
        asked = self._limits.within((self._state.twist - problem.twist) / problem.period)
        if self._guard is None:
            return asked, None
        v, w = self._state.twist.tolist()
        self._guard.take(Drive(v=v, w=w))
        guarded = self._guard.plan(problem)
        assert guarded is not None  # a twist was taken just before
        slowed = not np.allclose(guarded.acceleration, asked)
        return guarded.acceleration, Reason(kind=Kind.GUARDED, subject="base") if slowed else None


class NoPlacement:
    """A `PlacementStrategy` without candidates: the agent places the base."""

    def place(self, problem: BaseProblem) -> Placement:
        """No candidates; the goal is the present pose of the base."""
        return msgspec.structs.replace(no_placement(problem.pose), why=Reason(kind=Kind.BY_AGENT))


@dataclass
class ArmActionState(ManipulatorState):
    """State of a manipulator, with the joint rates and the gripper command requested by the agent."""

    phase: Phase = Phase.TRANSIT
    asked_rates: Array = field(default_factory=lambda: np.zeros(7))  # [rad/s]
    asked_gripper: str = "open"
    over_bin: bool = False  # the hand was over the bin when it released the object


class ArmAction(Manipulator):
    """A `Manipulator` that follows the last requested joint rates, within the limits of the robot."""

    def __init__(self, known: KnownWorld, parameters: ArmParameters | None = None) -> None:
        super().__init__(known, parameters)
        self._base, self._lag = numbers(known.robot.base), known.robot.arm.velocity_lag
        self._state: ArmActionState = ArmActionState()

    def take(self, rates: Array, gripper: str) -> None:
        """Joint rates (7,) [rad/s] and gripper ("open" | "close") from the next arm step on."""
        self._state.asked_rates, self._state.asked_gripper = np.array(rates, dtype=float), gripper

    def step(self, inputs: ArmInputs) -> ArmStep:
        """Base twist, joint rates and gripper for the next ``inputs.dt``: those requested, clipped to their limits."""
        state, p = self._state, self.parameters
        view = self.look(inputs)
        outcome = self._fingers(view)
        anchor(state.twist, state.rates, (view.arm.desired, view.arm.dq), self._base, inputs.dt, self._lag)
        state.twist = np.clip(inputs.base_twist, *base_bounds(state.twist, inputs.dt, self.profile))
        low, high = joint_bounds(view.q, state.rates, inputs.dt, p.qp)
        state.rates = np.clip(state.asked_rates, low, high)
        at_limit = np.flatnonzero((state.asked_rates < low) | (state.asked_rates > high))
        decided = Decision(
            twist=frozen(state.twist),
            rates=frozen(state.rates),
            active=tuple(f"joint {k + 1}" for k in at_limit),
            program=ProgramStatus.COMMANDED,
            outcome=outcome,
            why=Reason(kind=Kind.ARM_COMMANDED, subject="arm", other=ProgramStatus.COMMANDED),
        )
        return self.report(view, inputs, decided)

    def _fingers(self, view: View) -> str:
        """Update the phase from the gripper's command and measured width; returns the outcome of the task, or ""."""
        state = self._state
        if state.phase == Phase.RELEASE:
            open_now = self._over(self.profile.gripper.opening_time, view)
            return self._drop(view, "placed" if state.over_bin else "lost") if open_now else ""
        if state.holding:
            return self._hold(view)
        state.gripper = state.asked_gripper
        if state.gripper == "open":
            state.phase = Phase.TRANSIT
        elif state.phase == Phase.TRANSIT:
            enter(state, Phase.CLOSING, view.time)
        elif state.phase == Phase.CLOSING and self._over(self.profile.gripper.closing_time, view):
            self._closed(view)
        return ""

    def _over(self, duration: float, view: View) -> bool:
        """True when the phase has lasted ``duration`` [s] and the fingers have stopped."""
        return view.time - self._state.since >= duration - 0.5 * view.dt and not view.gripper_moving

    def _closed(self, view: View) -> None:
        """Judge the closed fingers: they hold the object if their width and the hand's position fit; else retry."""
        state, goal = self._state, view.goal
        fits = abs(view.width - goal.side) <= self.parameters.held_tolerance
        if goal.kind == "pick" and fits and norm(view.p - view.target) <= AT_OBJECT:
            state.holding, state.reported, state.side, state.anchor = True, False, goal.side, view.p.copy()
            enter(state, Phase.LIFT, view.time)
        else:
            enter(state, Phase.RETRY, view.time)

    def _hold(self, view: View) -> str:
        state, p = self._state, self.parameters
        if view.width < state.side - p.held_tolerance:
            return self._drop(view, "lost")
        if state.asked_gripper == "open":
            state.gripper, state.released, state.over_bin = "open", view.time, _over_bin(view)
            enter(state, Phase.RELEASE, view.time)
        elif state.phase == Phase.LIFT and view.p[2] - state.anchor[2] >= p.picked_height:
            state.reported = True
            enter(state, Phase.CARRY, view.time)
            return "picked"
        return ""

    def _drop(self, view: View, outcome: str) -> str:
        """Note that nothing is held any more; returns the outcome, or "" if the object was never lifted."""
        state = self._state
        reported = state.reported
        state.holding, state.reported, state.released = False, False, None
        state.gripper = state.asked_gripper
        enter(state, Phase.TRANSIT, view.time)
        return outcome if reported else ""


def _over_bin(view: View) -> bool:
    """True when the hand is over the release square of the target bin."""
    goal = view.goal
    if goal.kind != "place" or view.p[2] < goal.position[2]:
        return False
    frame = np.array([goal.position[0], goal.position[1], goal.yaw])
    return bool(np.abs(to_frame(frame, view.p[:2])).max() <= goal.release_half_width)


def agent_planner(parts: PlannerParts, *, guard: bool) -> BasePlanner:
    """A planner that follows the twist requested by the agent; ``guard``: see `BaseAction`."""
    robot, parameters = parts.known.robot, parts.parameters
    controller = BaseAction(robot, parameters, guard=guard)
    return BasePlanner(robot, parameters, placement=NoPlacement(), controller=controller, graphs=parts.graphs)


def agent_arm(parts: ArmParts) -> ArmAction:
    """An arm that follows the joint rates requested by the agent."""
    return ArmAction(parts.known, parts.parameters)


def agent_method(mode: str, arm: Method, *, guard: bool = False) -> Method:
    """The method of an action mode; ``arm``: the method whose arm is used in the mode "base". Raises ValueError."""
    if mode not in MODES:
        raise ValueError(f"action mode {mode!r}: use {' or '.join(map(repr, MODES))}")
    whole = mode == "whole_body"
    if not whole:
        check_fits(arm, whole_body=False)
    return Method(
        name=f"gym_{mode}",
        title="an agent, whole body" if whole else f"an agent drives, the arm of {arm.name}",
        summary="What `motm_twin.gym` runs: the actions come from outside.",
        source="own",
        parameters={} if whole else arm.parameters,
        planner=partial(agent_planner, guard=guard),
        arm=agent_arm if whole else arm.arm,
    )


def check_fits(method: Method, *, whole_body: bool) -> None:
    """Raise ValueError for a method that the action mode "whole_body", or else "base", cannot use."""
    if method.name == "open_loop":
        raise ValueError("open_loop rehearses the whole task beforehand: no action mode can use it")
    if method.name == "holistic" and not whole_body:
        raise ValueError("holistic decides about base and arm together: only actions='whole_body' takes both")
