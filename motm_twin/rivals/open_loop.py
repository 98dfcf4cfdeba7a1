"""Open loop: the paper's method plans the whole task beforehand, and the plan is executed blindly.

The base tracks the planned trajectory by its localised pose, the arm the planned joint positions, the gripper the
planned times. With the error (e_x, e_y, e_h) of the pose in the robot's frame and the planned twist (v_r, w_r):

    v = v_r cos e_h + k_x e_x,    w = w_r + k_y v_r sin(e_h) / e_h e_y + k_h e_h

(Kanayama et al., "A stable tracking control method for an autonomous mobile robot", ICRA 1990, in the form of Samson).
No camera, no lidar, no replanning; the monitor stops this robot like any other. Errors of localisation, of believed
cube positions, and any deviation from the rehearsal end up in the grasp.
"""

import math
from dataclasses import dataclass, field

import numpy as np

from motm_twin.control.arm.controller import Decision, Manipulator
from motm_twin.control.arm.types import ArmInputs, ArmStep, Phase, ProgramStatus
from motm_twin.control.arm.view import ManipulatorState
from motm_twin.control.method import ArmParts, Method, PlannerParts, Rehearse, Rehearsed, Timed
from motm_twin.model.edits import TaskEdit
from motm_twin.model.geometry import Array, frozen, to_frame, wrap_angle
from motm_twin.model.names import MethodError
from motm_twin.model.plant import ARM_STEPS
from motm_twin.model.profile import DQ_MAX, RobotProfile
from motm_twin.model.reason import Kind, Reason
from motm_twin.model.state import Stateful
from motm_twin.planning.planner import BasePlanner
from motm_twin.planning.types import BasePlan, BaseProblem, Mode, Placement, PlanStatus, SearchBudget, Target

K_X, K_Y, K_H = 1.0, 4.0, 2.0  # [1/s], [1/m^2], [1/s]: critically damped at 0.5 m/s
K_Q = 5.0  # [1/s] of the joints to their planned positions
DOCKED = 0.04  # [m] from the end of a plan that is over
SHOWN, STRIDE = 60, 3  # periods ahead of the plan that a Tick shows, and the step between two of them


@dataclass
class ScriptState:
    """The plan and its progress."""

    at: int = 0  # next period, or arm step
    plan: Rehearsed | None = None
    edits: Timed = ()  # of the task list so far
    refused: Reason | None = None  # why the plan was kept although the task list changed


class Script:
    """The plan of a run: rehearsed on first use, and again when a user changes the task list."""

    def __init__(self, rehearse: Rehearse, steps: int) -> None:
        """``steps`` in a period, of those that `ScriptState.at` counts."""
        self._rehearse, self._steps = rehearse, steps

    def plan(self, state: ScriptState) -> Rehearsed:
        """The current plan."""
        if state.plan is None:
            state.plan = self._rehearse(state.edits)
        return state.plan

    def retasked(self, state: ScriptState, edit: TaskEdit) -> None:
        """Rehearse the whole run anew, with this edit now; the plan stays when the rehearsal refuses it."""
        edits = (*state.edits, (state.at // self._steps, edit))
        try:
            state.plan, state.edits = self._rehearse(edits), edits
        except ValueError as error:
            state.refused = Reason(kind=Kind.REHEARSAL_REFUSED, other=str(error))


class TrackingController(Stateful[ScriptState]):
    """Base controller that follows the rehearsed trajectory; it is its own placement strategy."""

    def __init__(self, profile: RobotProfile, rehearse: Rehearse) -> None:
        self._limits = profile.base
        self.script = Script(rehearse, steps=1)
        self._state = ScriptState()

    def place(self, problem: BaseProblem) -> Placement:
        """Planned base pose of the next pick or place; the last pose once the plan is over."""
        state, plan = self._state, self.script.plan(self._state)
        n = next((n // ARM_STEPS for n, _ in plan.outcomes if n >= ARM_STEPS * state.at), plan.periods - 1)
        goal, over = plan.poses[n], state.at >= plan.periods
        zero = frozen(np.zeros(1))
        return Placement(
            mode=Mode.CLOSEST if over or plan.blocked[state.at] else Mode.DRIVE,
            radius=0.0,
            poses=goal[None],
            cost_current=zero,
            cost_next=zero,
            cost=zero,
            rejected=("",),
            chosen=0,
            goal=goal,
            goal_has_heading=True,
            why=_over(plan) if over else Reason(kind=Kind.REHEARSED),
            next_goal=None,
        )

    def plan(self, problem: BaseProblem, placement: Placement, budget: SearchBudget) -> BasePlan:
        """The acceleration that brings the base to the tracking law's twist by the end of the period."""
        state, plan = self._state, self.script.plan(self._state)
        n, over = min(state.at, plan.periods - 1), state.at >= plan.periods
        desired = (
            docking_twist(problem.pose, _end(plan, problem.target))
            if over
            else tracking_twist(problem.pose, plan.poses[n], plan.twists[n])
        )
        ahead = slice(n, n + SHOWN, STRIDE)
        nodes = np.hstack([plan.poses[ahead], plan.twists[ahead]])
        idle = over or bool(plan.blocked[n])
        state.at += 1
        return BasePlan(
            acceleration=frozen(self._limits.within((desired - problem.twist) / problem.period)),
            status=PlanStatus.IDLE if idle else PlanStatus.GOAL,
            why=state.refused or (_over(plan) if over else None),
            global_path=plan.poses[n:, :2],
            intermediate_goal=placement.goal,
            local_poses=frozen(nodes),
            local_times=frozen(problem.period * STRIDE * np.arange(len(nodes))),
            t_h=problem.period * (plan.periods - n),
            time_to_range=0.0 if over or plan.in_range[n] else math.inf,
        )

    def retasked(self, edit: TaskEdit) -> None:
        """Rehearse anew: the task list has changed."""
        self.script.retasked(self._state, edit)


@dataclass
class OpenLoopState(ManipulatorState):
    """State of the arm, and of the plan that it follows."""

    script: ScriptState = field(default_factory=ScriptState)
    due: list[str] = field(default_factory=list)  # outcomes of the plan that the task list has not come to


class OpenLoopArm(Manipulator):
    """Arm that moves joints and gripper as rehearsed; it passes on the twist of the base controller."""

    _state: OpenLoopState

    def __init__(self, parts: ArmParts, rehearse: Rehearse) -> None:
        super().__init__(parts.known, parts.parameters)
        self.script = Script(rehearse, steps=ARM_STEPS)
        self._state = OpenLoopState()

    @property
    def busy(self) -> bool:
        """True while the fingers close, by the plan."""
        return self._state.phase == Phase.CLOSING

    def step(self, inputs: ArmInputs) -> ArmStep:
        """The planned joint rates, with feedback to the planned positions; outcomes at their planned times."""
        state = self._state
        plan, seen = self.script.plan(state.script), inputs.observation
        view = self.look(inputs)
        n, over = min(state.script.at, len(plan.q) - 1), state.script.at >= len(plan.q)
        planned = np.zeros(7) if over else plan.rates[n]
        rates = np.clip(planned + K_Q * (plan.q[n] - seen.q), -DQ_MAX, DQ_MAX)
        if plan.phases[n] != state.phase:
            state.phase, state.since = Phase(plan.phases[n]), seen.time
        state.gripper = "close" if plan.closed[n] else "open"
        outcome = self._outcome(plan, inputs.goal.kind, n, over=over)
        state.script.at += 1
        decided = Decision(
            twist=frozen(inputs.base_twist),
            rates=frozen(rates),
            program=ProgramStatus.OPEN_LOOP,
            outcome=outcome,
            why=state.script.refused or (_over(plan) if over else None),
        )
        return self.report(view, inputs, decided)

    def retasked(self, edit: TaskEdit) -> None:
        """Rehearse anew: a user has changed the task list."""
        self.script.retasked(self._state.script, edit)

    def _outcome(self, plan: Rehearsed, goal: str, n: int, *, over: bool) -> str:
        """Outcome that the plan has reached, once the task list has reached its task, too; "" for none."""
        state = self._state
        if not over:
            state.due += [outcome for at, outcome in plan.outcomes if at == n]
        if not state.due or {"picked": "pick", "missed": "pick", "placed": "place"}.get(state.due[0], goal) != goal:
            return ""
        outcome = state.due.pop(0)
        if outcome in ("picked", "placed", "lost"):
            state.holding = outcome == "picked"
            state.reported = state.holding
        return outcome


def tracking_twist(pose: Array, planned_pose: Array, planned_twist: Array) -> Array:
    """Twist (v, w) that leads from a pose (3,) to the plan's current pose, given its planned twist (2,)."""
    e_x, e_y = to_frame(pose, planned_pose[:2])
    e_h = wrap_angle(float(planned_pose[2] - pose[2]))
    v_r, w_r = planned_twist
    return np.array(
        [v_r * math.cos(e_h) + K_X * e_x, w_r + K_Y * v_r * float(np.sinc(e_h / math.pi)) * e_y + K_H * e_h]
    )


def docking_twist(pose: Array, end: Array) -> Array:
    """Twist (v, w) to the end of a plan (3,) that is over: straight to it, forwards or back, then turn on the spot."""
    e_x, e_y = to_frame(pose, end[:2])
    distance = math.hypot(e_x, e_y)
    if distance < DOCKED:
        return np.array([0.0, K_H * wrap_angle(float(end[2] - pose[2]))])
    off = math.atan2(e_y, e_x) if e_x >= 0.0 else wrap_angle(math.atan2(e_y, e_x) + math.pi)
    return np.array([math.copysign(K_X * distance * math.cos(off), e_x), K_H * off])


def _end(plan: Rehearsed, target: Target | None) -> Array:
    """Goal of a base whose plan is over: the middle of an unfinished drive target, else the end of the plan.

    A rehearsed drive needs only the edge of the target's tolerance, which a late base may miss.
    """
    end = np.array(plan.poses[-1])
    if target is not None and target.kind == "drive":
        end[:2] = target.position
        end[2] = end[2] if target.heading is None else target.heading
    return end


def _over(plan: Rehearsed) -> Reason:
    failures = f"; in rehearsal {'; '.join(plan.failures)}" if plan.failures else ""
    return Reason(kind=Kind.REHEARSAL_OVER, other=failures)


def _rehearsed_by(parts: PlannerParts | ArmParts) -> Rehearse:
    if parts.rehearse is None:
        raise MethodError("open_loop needs a rehearsal of the task: let a Twin build it")
    return parts.rehearse


def _planner(parts: PlannerParts) -> BasePlanner:
    tracking = TrackingController(parts.known.robot, _rehearsed_by(parts))
    return BasePlanner(parts.known.robot, parts.parameters, placement=tracking, controller=tracking)


def _arm(parts: ArmParts) -> Manipulator:
    return OpenLoopArm(parts, _rehearsed_by(parts))


OPEN_LOOP = Method(
    name="open_loop",
    title="Same plan, open loop",
    summary="Plans the whole run beforehand with the paper's method, then follows that plan by localisation.",
    source="own; for the paper's argument that reacting is what makes manipulation on the move robust",
    known="The paper and MotM name planned on-the-move manipulation as the rival, and no planner of it.",
    chosen=(
        "The plan is what the paper's method does without any noise, as good as it can be. It is tracked in pose, "
        "joints and time, which is more than open loop: only perception and planning are missing. The monitor stays."
    ),
    planner=_planner,
    arm=_arm,
)
