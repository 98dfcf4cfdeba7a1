"""The arm side of the control period: phases, reference, QP and obstacle avoidance (Paper, Sec. V)."""

import math

import numpy as np
from numba import njit

from motm_twin.control.arm_avoidance import nearest_distance, nearest_static
from motm_twin.control.arm_motion import Motion, hand_motion
from motm_twin.control.arm_phases import PhaseRules, advance, dwell, engaged, fingers_at_work
from motm_twin.control.arm_reference import planar_joints, tilt_of
from motm_twin.control.arm_view import ManipulatorState, View, look
from motm_twin.control.furniture import IntArray
from motm_twin.control.parameters import ArmParameters, numbers
from motm_twin.control.qp import Program, load, solve
from motm_twin.control.qp_rows import (
    ARM,
    BASE,
    SIZE,
    SLACK,
    anchor,
    fill_program,
    joint_limits,
    lag_factor,
    weights,
)
from motm_twin.control.speed_limits import Rows, SpeedLimits
from motm_twin.control.task_list import TaskEdit
from motm_twin.control.transit import TransitRule
from motm_twin.control.types import ArmInputs, ArmStep, ArmTiming
from motm_twin.model.exact import norm
from motm_twin.model.geometry import Array, frozen
from motm_twin.model.kinematics import manipulability
from motm_twin.model.known import KnownWorld
from motm_twin.model.plant import Actuation
from motm_twin.model.state import Stateful

_STOWED = 0.25  # [rad] joints this near to the stow pose are there
_TURNED = 0.8  # [rad] and joint 1, which may turn a little towards the target
_SLACKS = SLACK.start, SLACK.stop - SLACK.start
_BOUND_NAMES = ("base speed", "base yaw rate", *(f"joint {k}" for k in range(1, 8)))
_LIMITERS = ("moving obstacle", "static obstacle", "")  # by `Rows.tightest`
_SWINGING = ("stow", "carry", "transit")
_GRASPING = ("transit", "final", "closing", "lift", "retry")


class Manipulator(Stateful[ManipulatorState]):
    """Picks and places while the base drives; one `step` per arm period (100 Hz)."""

    def __init__(
        self, known: KnownWorld, parameters: ArmParameters | None = None, timing: ArmTiming | None = None
    ) -> None:
        """Arm side for one robot and its mapped furniture; ``timing`` replaces the transit rule of MotM."""
        self.parameters = parameters or ArmParameters()
        self.profile = known.robot
        p = self.parameters
        load(p.qp.solver)
        arm = known.robot.arm
        self._mount = np.array([arm.mount_x, arm.mount_y, arm.mount_z])
        self._rules = PhaseRules(
            parameters=p,
            profile=known.robot,
            timing=timing or TransitRule(k_A=p.k_A, base_speed=p.transit_base_speed, hand_speed=p.hand_speed),
            mount=self._mount,
        )
        self._limits = SpeedLimits(known, p.avoidance)
        self._numbers, self._qp, self._base = numbers(p), numbers(p.qp), numbers(known.robot.base)
        self._weights = {swinging: weights(p.qp, swinging=swinging) for swinging in (False, True)}
        self._joint_limits = joint_limits(p.qp.elbow_limit)
        self._stow_joints = planar_joints(p.stow_radius, p.stow_height, p.stow_tilt)
        self._state = ManipulatorState()

    @property
    def holding(self) -> bool:
        """Does the gripper believe that it holds an object?"""
        return self._state.holding

    @property
    def busy(self) -> bool:
        """Are the fingers closing on an object, lifting it, or letting go of it?"""
        return fingers_at_work(self._state)

    def retasked(self, edit: TaskEdit) -> None:
        """A person has changed the task list: of interest only to an arm that plans beyond its goal of now."""

    def step(self, inputs: ArmInputs) -> ArmStep:
        """Decide base twist, joint rates and gripper for the next ``inputs.dt``."""
        bad = _not_finite(inputs)
        if bad:
            return self._damped_stop(inputs, None, f"{bad} is not finite")
        view = look(inputs, self._mount, lag_factor(inputs.dt, self.profile), self.parameters)
        outcome, reason = advance(self._state, view, inputs, self._rules)
        motion = self._motion(view, inputs)
        self._anchor_commands(inputs)
        rows = self._rows(view, inputs)
        program = self._program(view, inputs, motion, rows)
        answer = solve(program, solver=self.parameters.qp.solver, residual=self.parameters.qp.residual)
        if answer.reason:
            return self._damped_stop(inputs, view, answer.reason, outcome=outcome)
        x = answer.x
        x.setflags(write=False)
        self._state.twist, self._state.rates, self._state.stop_rates = x[BASE].copy(), x[ARM].copy(), None
        return self._report(
            view,
            inputs,
            twist=x[BASE],
            rates=x[ARM],
            reference=motion.reference,
            slack=x[SLACK],
            active=self._active(rows, answer.active),
            limiter=_LIMITERS[rows.tightest],
            allowed=rows.allowed,
            status="solved",
            outcome=outcome,
            reason=reason,
        )

    def _motion(self, view: View, inputs: ArmInputs) -> Motion:
        """What the hand should do in this step."""
        return hand_motion(self._state, view, inputs, self._mount, self.parameters, self._numbers)

    def _anchor_commands(self, inputs: ArmInputs) -> None:
        """Keep the remembered commands near what the robot does, should somebody else have commanded it."""
        state, limits, dt = self._state, self.profile.base, inputs.dt
        twist, rates = np.empty(2), np.empty(7)
        anchor(
            state.twist, state.rates, inputs.base_twist, np.asarray(inputs.observation.dq, dtype=float),
            2.0 * dt * limits.linear_acceleration, 2.0 * dt * limits.yaw_acceleration,
            self.profile.arm.velocity_lag + 3.0 * dt, twist, rates,
        )  # fmt: skip
        state.twist, state.rates = twist, rates

    def _rows(self, view: View, inputs: ArmInputs) -> Rows:
        """Speed limits towards lidar obstacles and furniture."""
        return self._limits.rows(view, self._state, inputs, self._relaxing(view, inputs))

    def _active(self, rows: Rows, active: IntArray) -> tuple[str, ...]:
        """Names of the active rows, and of the active bounds of base twist and arm rates."""
        names, which, count = self._limits.names, rows.which.tolist(), len(rows.h)
        found = [k for k in active.tolist() if k < count + ARM.stop]
        return tuple(dict.fromkeys(names[which[k]] if k < count else _BOUND_NAMES[k - count] for k in found))

    def _relaxing(self, view: View, inputs: ArmInputs) -> Array:
        """Grasps for which static obstacles give way: the one under way, and the last until the gripper has left."""
        state = self._state
        if len(state.relaxed):
            away = nearest_static(view.p, inputs.obstacles.points, inputs.obstacles.static)
            if away >= self.parameters.avoidance.d_s and state.phase != "lift":
                state.relaxed = np.zeros((0, 2))
        if view.goal.kind == "pick" and not state.holding and state.phase in _GRASPING:
            state.relaxed = view.target[None, :2].copy()
        elif view.goal.kind == "place" and state.phase in ("transit", "release"):
            return np.vstack([state.relaxed, view.target[None, :2]])
        return state.relaxed

    def _program(self, view: View, inputs: ArmInputs, motion: Motion, rows: Rows) -> Program:
        """min 1/2 x'Px + c'x: track v_B, small arm rates, manipulability, little slack; s.t. the hand's velocity."""
        swinging = self._state.phase in _SWINGING
        cost = self._weights[swinging]
        c, A, b = np.empty(SIZE), np.empty((6, SIZE)), np.empty(6)
        lower, upper = np.empty(SIZE), np.empty(SIZE)
        fill_program(
            view.q, view.p, view.pose, view.J, self._mount, motion.velocity, view.measured, inputs.base_twist,
            self._state.twist, self._state.rates, cost, self._joint_limits, view.beta, inputs.dt, swinging, self._qp,
            self._base, c, A, b, lower, upper,
        )  # fmt: skip
        cost = self._free_return(view, cost, c)
        return Program(P=cost, c=c, A=A, b=b, G=rows.G, h=rows.h, lower=lower, upper=upper, slack=_SLACKS)

    def _free_return(self, view: View, cost: Array, c: Array) -> Array:
        """When the way to the stow pose is stuck: the same program, but led by the joints. Returns the cost."""
        state, p = self._state, self.parameters
        if state.phase not in ("stow", "carry") or view.time - state.since <= p.stuck_time:
            return cost
        error = self._stow_joints - view.q
        if float(np.abs(error[[1, 2, 3, 4]]).max()) < _STOWED and abs(error[0]) < _TURNED:
            return cost
        free = cost.copy()
        free[SLACK] = p.qp.free_weight
        free[ARM] = 1.0
        c[ARM] = -p.qp.free_gain * error
        return free

    def _damped_stop(self, inputs: ArmInputs, view: View | None, why: str, *, outcome: str = "") -> ArmStep:
        """Arm rates to zero within one control period, the base as fast as it may brake."""
        state, limits, dt = self._state, self.profile.base, _safe_step(inputs.dt)
        if state.stop_rates is None:
            state.stop_rates = state.rates.copy()
        share = dt / self.parameters.qp.stop_time
        step = np.abs(state.stop_rates) * share
        state.rates = np.sign(state.rates) * np.maximum(np.abs(state.rates) - step - 1e-12, 0.0)
        brake = np.array([limits.linear_acceleration, limits.yaw_acceleration]) * dt
        state.twist = np.sign(state.twist) * np.maximum(np.abs(state.twist) - brake, 0.0)
        return self._report(
            view,
            inputs,
            twist=frozen(state.twist),
            rates=frozen(state.rates),
            reference=None,
            slack=frozen(np.zeros(6)),
            active=(),
            status=f"damped stop: {why}",
            outcome=outcome,
            reason=f"the arm was stopped: {why}",
        )

    def _report(
        self,
        view: View | None,
        inputs: ArmInputs,
        *,
        twist: Array,
        rates: Array,
        reference: Array | None,
        slack: Array,
        active: tuple[str, ...],
        limiter: str = "",
        allowed: float = math.inf,
        status: str,
        outcome: str,
        reason: str,
    ) -> ArmStep:
        """The step for the Tick; the arrays given are read-only."""
        state = self._state
        there, figures = np.zeros(3), (0.0, 0.0, 0.0, math.inf)
        if view is not None:
            there = view.p if reference is None else reference
            figures = _figures(there, view.p, view.R, view.q, inputs.obstacles.points)
        error, tilt, dexterity, nearest = figures
        there.setflags(write=False)
        return ArmStep(
            time=inputs.observation.time,
            phase=state.phase,
            actuation=Actuation(twist=twist, joint_velocity=rates, gripper=state.gripper),
            reference=there,
            error=error,
            tilt=tilt,
            slack=slack,
            manipulability=dexterity,
            active=active,
            limiter=limiter,
            obstacle_distance=nearest,
            allowed_approach=allowed,
            qp_status=status,
            holding=state.holding,
            engaged=engaged(state),
            dwell=0.0 if view is None else dwell(state, view, self._rules),
            outcome=outcome,
            reason=reason,
        )


@njit(cache=True)
def _figures(there: Array, p: Array, R: Array, q: Array, points: Array) -> tuple[float, float, float, float]:
    """Error [m] of the hand, its tilt [rad], the arm's manipulability, distance [m] of the nearest seen obstacle."""
    return norm(there - p), tilt_of(R), manipulability(q), nearest_distance(p, points)


def _not_finite(inputs: ArmInputs) -> str:
    """Name of the first input that is not finite; points of obstacles that are not finite count too."""
    observation, goal = inputs.observation, inputs.goal
    if math.isfinite(_total(inputs)) and inputs.dt > 0.0:
        return ""
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


def _total(inputs: ArmInputs) -> float:
    """A sum of all numbers: finite when each is."""
    observation, goal = inputs.observation, inputs.goal
    total = observation.gripper_width + observation.time + inputs.dt + goal.yaw
    return total + _sum(
        observation.odometry, observation.twist, observation.q, observation.dq, inputs.base_twist, goal.position,
        inputs.T_odom_world, inputs.obstacles.points, inputs.plan_poses,
    )  # fmt: skip


@njit(cache=True)
def _sum(a: Array, b: Array, c: Array, d: Array, e: Array, f: Array, g: Array, one: Array, two: Array) -> float:
    """Of seven vectors and two matrices."""
    total = a.sum() + b.sum() + c.sum() + d.sum() + e.sum() + f.sum() + g.sum()
    for matrix in (one, two):
        for row in range(matrix.shape[0]):
            for column in range(matrix.shape[1]):
                total += matrix[row, column]
    return total


def _safe_step(dt: float) -> float:
    return dt if math.isfinite(dt) and dt > 0.0 else 0.01
