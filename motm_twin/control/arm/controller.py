"""The arm side of the control period: phases, reference, QP and obstacle avoidance (Paper, Sec. V)."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import msgspec
import numpy as np

from motm_twin.control.arm.bodies import IntArray
from motm_twin.control.arm.geometry import nearest_static, planar_joints
from motm_twin.control.arm.grasp_room import GraspRoom
from motm_twin.control.arm.limits import Limit
from motm_twin.control.arm.motion import Motion, hand_motion
from motm_twin.control.arm.overlap import ArmOverlap
from motm_twin.control.arm.parameters import ArmParameters, Numbers, numbers
from motm_twin.control.arm.phases import PhaseRules, advance, dwell, engaged, fingers_at_work, start_over
from motm_twin.control.arm.program import ARM, BASE, FURNITURE_ELASTIC, SLACK, ActiveRows, ArmProgram, lag_factor
from motm_twin.control.arm.qp import Program, load, solve
from motm_twin.control.arm.types import ArmInputs, ArmStep, ArmTiming, Overlap, Phase, ProgramStatus, TransitRule
from motm_twin.control.arm.view import ManipulatorState, View, look
from motm_twin.model.edits import TaskEdit
from motm_twin.model.geometry import Array, frozen
from motm_twin.model.known import KnownWorld
from motm_twin.model.plant import PERIOD, Actuation
from motm_twin.model.reason import Kind, Reason
from motm_twin.model.state import Stateful

_BOUND_NAMES = ("base speed", "base yaw rate", *(f"joint {k}" for k in range(1, 8)))
_WRONG_HIT = 0.3  # [s] longest time that a spurious hit stays in the map
_GONE = 0.2  # share of `overlap_stands` after which an overlap that is no longer seen has ended
_REST, _NO_SLACK = frozen(np.zeros(7)), frozen(np.zeros(6))
_GRASPING = (Phase.TRANSIT, Phase.FINAL, Phase.CLOSING, Phase.LIFT, Phase.RETRY)


class Decision(NamedTuple):
    """Decision of one step; the arrays are read-only."""

    twist: Array  # of the base, shape (2,)
    rates: Array  # of the joints, shape (7,)
    program: ProgramStatus
    outcome: str = ""
    why: Reason | None = None
    motion: Motion | None = None  # None: the hand had no reference
    slack: Array = _NO_SLACK
    active: tuple[str, ...] = ()
    limiter: str = ""
    allowed: float = math.inf


def _as_it_is(state: ManipulatorState, view: View, motion: Motion, program: Program) -> Program:
    return program


@dataclass(frozen=True, kw_only=True)
class ArmWays:
    """Functions of one step that a method's arm may replace; the defaults are those of the paper's arm."""

    inputs: Callable[[ManipulatorState, ArmInputs], ArmInputs] = lambda state, inputs: inputs
    rules: Callable[[PhaseRules, ArmInputs], PhaseRules] = lambda usual, inputs: usual  # of the phases
    motion: Callable[[ManipulatorState, View, ArmInputs, ArmParameters, Numbers], Motion] = hand_motion
    program: Callable[[ManipulatorState, View, Motion, Program], Program] = _as_it_is  # may change the program


PAPER_WAYS = ArmWays()


class Manipulator(Stateful[ManipulatorState]):
    """Picks and places while the base drives; one `step` per arm period (100 Hz)."""

    def __init__(
        self,
        known: KnownWorld,
        parameters: ArmParameters | None = None,
        timing: ArmTiming | None = None,
        limits: Sequence[Limit] = (),
        ways: ArmWays = PAPER_WAYS,
    ) -> None:
        """Arm side for one robot and its mapped furniture.

        ``timing`` replaces the transit rule of MotM; ``limits`` are added after the usual ones; ``ways`` replace
        functions of a step.
        """
        self._ways = ways
        self.parameters = parameters or ArmParameters()
        self.profile = known.robot
        p = self.parameters
        load(p.qp.solver)
        arm = known.robot.arm
        self._usual = self._rules = PhaseRules(
            parameters=p,
            profile=known.robot,
            timing=timing or TransitRule(k_A=p.k_A, base_speed=p.transit_base_speed, hand_speed=p.hand_speed),
            mount=np.array([arm.mount_x, arm.mount_y, arm.mount_z]),
            room=GraspRoom(known, p.avoidance),
        )
        self._numbers = numbers(p)
        self._programs = ArmProgram(known, p, limits)
        self._stow_joints = planar_joints(p.stow_radius, p.stow_height, p.stow_tilt)
        self._overlap = ArmOverlap(known.robot, self._stow_joints, self.parameters)
        self._state = ManipulatorState()

    @property
    def holding(self) -> bool:
        """True while the gripper believes that it holds an object."""
        return self._state.holding

    @property
    def busy(self) -> bool:
        """True while the fingers close on an object, lift it, or let go of it."""
        return fingers_at_work(self._state)

    def retasked(self, edit: TaskEdit) -> None:
        """Take note of a user's change to the task list; only an arm that plans beyond its present goal needs it."""

    def step(self, inputs: ArmInputs) -> ArmStep:
        """Decide base twist, joint rates and gripper for the next ``inputs.dt``."""
        inputs = self._ways.inputs(self._state, inputs)
        self._rules = self._ways.rules(self._usual, inputs)
        view = self.look(inputs) if inputs.dt > 0.0 else None
        if view is None or not view.finite:
            bad = _not_finite(inputs)
            if view is None or bad:
                return self.damped_stop(inputs, None, f"{bad} is not finite")
        held_side = self._state.side if self._state.holding else 0.0
        overlap = self._inside(view, inputs, held_side)
        if overlap is not None:
            return self._stand_clear(view, inputs, overlap)
        outcome, why = advance(self._state, view, inputs, self._rules)
        motion = self._ways.motion(self._state, view, inputs, self.parameters, self._numbers)
        program, rows = self._program(view, inputs, motion)
        answer = solve(program, solver=self.parameters.qp.solver, residual=self.parameters.qp.residual)
        if answer.reason:
            return self.damped_stop(inputs, view, answer.reason, outcome=outcome)
        x = answer.x
        x.setflags(write=False)
        twist, rates = x[BASE], x[ARM]
        self._state.twist, self._state.rates, self._state.stop_rates = twist.copy(), rates.copy(), None
        active = self._active(rows, answer.active)
        gave = _gave_way(x[FURNITURE_ELASTIC], active, rows.hard, self.parameters.qp.gives_way)
        return self.report(
            view,
            inputs,
            Decision(
                twist=twist,
                rates=rates,
                motion=motion,
                slack=x[SLACK],
                active=active,
                limiter=rows.limiter,
                allowed=rows.allowed,
                program=ProgramStatus.SOLVED if gave is None else ProgramStatus.GAVE_WAY,
                outcome=outcome,
                why=gave or why,
            ),
        )

    def look(self, inputs: ArmInputs) -> View:
        """The view of this step."""
        return look(inputs, self._rules.mount, lag_factor(inputs.dt, self.profile), self.parameters)

    def _active(self, rows: ActiveRows, active: IntArray) -> tuple[str, ...]:
        """Names of the active rows, and of the active bounds of base twist and arm rates."""
        names, which, count = rows.names, rows.which.item, len(rows.which)
        found: dict[str, None] = {}
        for k in active.tolist():
            if k < count:
                found[names[which(k)]] = None
            elif k < count + ARM.stop:
                found[_BOUND_NAMES[k - count]] = None
        return tuple(found)

    def _relaxing(self, view: View, inputs: ArmInputs) -> Array:
        """Grasps for which static obstacles give way: the one under way, and the last until the gripper has left."""
        state = self._state
        if len(state.relaxed):
            away = nearest_static(view.p, inputs.obstacles.points, inputs.obstacles.static)
            if away >= self.parameters.avoidance.d_s and state.phase != Phase.LIFT:
                state.relaxed = np.zeros((0, 2))
        if view.goal.kind == "pick" and not state.holding and state.phase in _GRASPING:
            state.relaxed = view.target[None, :2].copy()
        elif view.goal.kind == "place" and state.phase in (Phase.TRANSIT, Phase.RELEASE):
            return np.vstack([state.relaxed, view.target[None, :2]])
        return state.relaxed

    def _program(self, view: View, inputs: ArmInputs, motion: Motion) -> tuple[Program, ActiveRows]:
        """The program of this step."""
        state = self._state
        program, rows = self._programs.fill(view, state, inputs, self._relaxing(view, inputs), motion)
        if state.phase in (Phase.STOW, Phase.CARRY) and view.time - state.since > self.parameters.stuck_time:
            program = self._free_return(view, program)
        return self._ways.program(state, view, motion, program), rows

    def _free_return(self, view: View, program: Program) -> Program:
        """The program with a joint-space return to the stow pose; unchanged when the arm is near that pose."""
        p = self.parameters
        error = self._stow_joints - view.q
        if float(np.abs(error[[1, 2, 3, 4]]).max()) < p.stowed_error and abs(error[0]) < p.bent:
            return program
        free, c = program.P.copy(), program.c.copy()
        free[SLACK] = p.qp.free_weight
        free[ARM] = 1.0
        c[ARM] = -p.qp.free_gain * error
        return msgspec.structs.replace(program, P=free, c=c)

    def _inside(self, view: View, inputs: ArmInputs, held_side: float) -> Overlap | None:
        """Current overlap of the arm with a seen obstacle; flickering beams do not end it at once."""
        state = self._state
        found = self._overlap.find(view.arm, inputs, held_side, lasts=state.inside is not None)
        if found is None or not found.alone:
            state.glimpsed = None
        elif state.glimpsed is None:
            state.glimpsed = view.time
        if found is not None and (state.glimpsed is None or view.time - state.glimpsed > _WRONG_HIT):
            state.inside, state.inside_at = found, view.time
        elif view.time - state.inside_at > _GONE * self.parameters.overlap_stands:
            state.inside, state.inside_since = None, None
        return state.inside

    def _stand_clear(self, view: View, inputs: ArmInputs, overlap: Overlap) -> ArmStep:
        """The step during an overlap: the arm stops, and returns to its stow pose when the overlap lasts."""
        state = self._state
        if state.inside_since is None:
            state.inside_since = view.time
        withdraws = view.time - state.inside_since > self.parameters.overlap_stands
        outcome = start_over(state, view, self.parameters) if withdraws else ""
        state.twist, state.rates = self._overlap.way_out(view.arm, inputs, state.twist, withdraws=withdraws)
        state.stop_rates = None
        kind = Kind.ARM_WITHDRAWS if withdraws else Kind.ARM_STANDS
        decided = Decision(
            twist=frozen(state.twist),
            rates=frozen(state.rates),
            outcome=outcome,
            program=ProgramStatus.WITHDRAWING if withdraws else ProgramStatus.STANDING,
            why=Reason(kind=kind, subject=overlap.body, value=overlap.depth, unit="m"),
        )
        return self.report(view, inputs, decided)

    def damped_stop(self, inputs: ArmInputs, view: View | None, why: str, *, outcome: str = "") -> ArmStep:
        """Arm rates to zero within one control period, the base as fast as it may brake."""
        state, limits, dt = self._state, self.profile.base, _safe_step(inputs.dt)
        if state.stop_rates is None:
            state.stop_rates = state.rates.copy()
        share = dt / PERIOD
        step = np.abs(state.stop_rates) * share
        state.rates = np.sign(state.rates) * np.maximum(np.abs(state.rates) - step - 1e-12, 0.0)
        brake = np.array([limits.linear_acceleration, limits.yaw_acceleration]) * dt
        state.twist = np.sign(state.twist) * np.maximum(np.abs(state.twist) - brake, 0.0)
        decided = Decision(
            twist=frozen(state.twist),
            rates=frozen(state.rates),
            program=ProgramStatus.DAMPED_STOP,
            outcome=outcome,
            why=Reason(kind=Kind.ARM_STOPPED, subject="arm", other=why),
        )
        return self.report(view, inputs, decided)

    def report(self, view: View | None, inputs: ArmInputs, decided: Decision) -> ArmStep:
        """The step for the Tick."""
        state, motion = self._state, decided.motion
        if motion is not None:
            there, error = motion.reference, motion.error
            there.setflags(write=False)
        else:
            there, error = frozen(np.zeros(3) if view is None else view.p), 0.0
        return ArmStep(
            time=inputs.observation.time,
            phase=state.phase,
            actuation=Actuation(
                twist=decided.twist, joint_velocity=decided.rates, gripper=state.gripper, opening=state.opening
            ),
            reference=there,
            error=error,
            tilt=0.0 if view is None else view.tilt,
            slack=decided.slack,
            manipulability=0.0 if view is None else view.manipulability,
            active=decided.active,
            limiter=decided.limiter,
            obstacle_distance=math.inf if view is None else view.nearest,
            allowed_approach=decided.allowed,
            program=decided.program,
            holding=state.holding,
            engaged=engaged(state),
            dwell=0.0 if view is None else dwell(state, view, self._rules),
            outcome=decided.outcome,
            why=decided.why,
        )


def _gave_way(speed: float, active: tuple[str, ...], hard: frozenset[str], least: float) -> Reason | None:
    """Fault of a program whose hard rows gave way by a speed [m/s]; None below ``least``."""
    if speed < least:
        return None
    row = next((name for name in active if name in hard), "furniture")
    return Reason(kind=Kind.GAVE_WAY, subject=row, value=speed, unit="m/s")


def _not_finite(inputs: ArmInputs) -> str:
    """Name of the first input that is not finite, or a step that is not positive; "" for none."""
    observation, goal = inputs.observation, inputs.goal
    values = {
        "odometry": observation.odometry,
        "base twist": observation.twist,
        "arm joints": observation.q,
        "arm rates": observation.dq,
        "gripper width": observation.gripper_width,
        "time": observation.time,
        "step": inputs.dt,
        "wanted base twist": inputs.base_twist,
        "goal position": goal.position,
        "goal yaw": goal.yaw,
        "obstacles": inputs.obstacles.points,
        "plan": inputs.plan_poses,
        "localisation": inputs.T_odom_world,
    }
    for name, value in values.items():
        if not np.isfinite(value).all():
            return name
    return "step" if inputs.dt <= 0.0 else ""


def _safe_step(dt: float) -> float:
    return dt if math.isfinite(dt) and dt > 0.0 else 0.01


class NoArm(Manipulator):
    """Passes on the base twist of the plan; joints rest and the gripper stays open."""

    def step(self, inputs: ArmInputs) -> ArmStep:
        """The base twist as the plan asks for it: the monitor keeps it within the limits."""
        if not np.isfinite(inputs.base_twist).all():
            return self.damped_stop(inputs, None, "wanted base twist is not finite")
        self._state.twist = inputs.base_twist.copy()
        return self.report(
            None, inputs, Decision(twist=frozen(inputs.base_twist), rates=_REST, program=ProgramStatus.NONE)
        )
