"""Holistic control: one quadratic program moves base and arm to bring the hand to the target; no base planner.

Haviland, Suenderhauf and Corke, "A Holistic Approach to Reactive Mobile Manipulation" (RA-L 2022), with the numbers of
their published example. With the hand's error ``e = |dx| + |dy| + |dz|``, the direction ``theta`` of the hand in the
base frame, and the arm's manipulability m:

    min 1/2 x' diag(0.01 / e, 0.01, 1 / e) x - k_eps theta w - grad m' qdot     s.t.  J u + slack = nu

over base twist, arm rates and slack; ``nu`` is 1.5 times the hand's error, its angular part 1.3 times that. The base
has no goal of its own, ignores obstacles and the next target, and stops because the hand does.
"""

import math
from dataclasses import dataclass

import msgspec
import numpy as np

from motm_twin.control.arm.controller import ArmWays, Manipulator
from motm_twin.control.arm.geometry import rotation_error, tilt_for, tool_rotation
from motm_twin.control.arm.motion import Motion, hand_motion
from motm_twin.control.arm.parameters import ArmParameters, Numbers
from motm_twin.control.arm.program import ARM, BASE, SLACK
from motm_twin.control.arm.qp import Program
from motm_twin.control.arm.types import ArmInputs, Phase
from motm_twin.control.arm.view import ManipulatorState, View
from motm_twin.control.method import ArmParts, BaseChoices, Materials, Method, Policies
from motm_twin.model.arm_kernels import manipulability_gradient
from motm_twin.model.exact import norm
from motm_twin.model.geometry import Array, from_frame, frozen
from motm_twin.model.profile import RobotProfile
from motm_twin.model.reason import Kind, Reason
from motm_twin.planning.candidates import Rule
from motm_twin.planning.parameters import PlanningParameters
from motm_twin.planning.reach import ReachModel
from motm_twin.planning.types import (
    BaseController,
    BasePlan,
    BaseProblem,
    Mode,
    Placement,
    PlacementStrategy,
    PlanStatus,
    SearchBudget,
    Target,
    bare_plan,
    no_placement,
)
from motm_twin.rivals.motm2022 import TangentController, TangentParameters, TangentPlacement, TangentState

_RESTING = (Phase.STOW, Phase.CARRY)  # phases in which the arm has no target: the base stands, too
_STEPS = 6.0  # arm steps of acceleration by which the twist may differ from the monitor's last output


@dataclass(frozen=True, kw_only=True)
class HolisticParameters:
    """Numbers of the authors' example of a differential drive (robotics-toolbox-python, MIT)."""

    base_weight: float = 0.01  # over e
    rate_weight: float = 0.01
    slack_weight: float = 1.0  # over e
    k_eps: float = 0.5  # turns the base towards the hand
    gain: float = 1.5  # [1/s]
    angular_gain: float = 1.3  # times the gain
    far: float = 0.5  # [m] of error beyond which speeds are scaled by `cruise / e`, else by `near_scale`
    cruise: float = 0.7  # [m]
    near_scale: float = 1.4
    arrived: float = 0.02  # [m] smallest error that divides
    damper_gain: float = 1.0  # [rad/s] eta, joint-limit damper
    damper_start: float = 0.9  # [rad] rho_i
    damper_stop: float = 0.1  # [rad] rho_s

    def scale(self, error: float) -> float:
        """Factor of all speeds at an error [m] of the hand; applied before the program, in the original after it."""
        return self.cruise / error if error > self.far else self.near_scale


class AtOnce:
    """Timing by which the hand starts as soon as there is a target, and takes the base with it."""

    def transit_duration(self, distance: float, speed: float, time_to_range: float) -> float:
        """Time [s] to the target; never None: the hand leaves at once."""
        return time_to_range


class WholeBody:
    """Functions of the paper's arm for a program that moves the base as well; the grasp phases stay."""

    def __init__(self, profile: RobotProfile, parameters: ArmParameters, holistic: HolisticParameters) -> None:
        """``parameters``: of the grasp phases and of the arm's obstacle avoidance."""
        self._base, self._p, self._h = profile.base, parameters, holistic

    def inputs(self, state: ManipulatorState, inputs: ArmInputs) -> ArmInputs:
        """Inputs that ask for the last twist of the base; without a goal, for the requested one, within the limits."""
        room = inputs.dt * np.array([self._base.linear_acceleration, self._base.yaw_acceleration])
        last = np.clip(state.twist, inputs.base_twist - _STEPS * room, inputs.base_twist + _STEPS * room)
        desired = np.clip(inputs.base_twist, last - room, last + room) if inputs.goal.kind == "none" else last
        return msgspec.structs.replace(inputs, base_twist=desired)

    def motion(
        self, state: ManipulatorState, view: View, inputs: ArmInputs, parameters: ArmParameters, numbers: Numbers
    ) -> Motion:
        """Velocity of the hand; in transit straight towards the point above the target, at any distance."""
        if state.phase != Phase.TRANSIT:
            return hand_motion(state, view, inputs, parameters, numbers)
        h, point = self._h, self._hover(view)
        error = point - view.p
        scale = h.scale(float(np.abs(error).sum()))
        angular = h.gain * h.angular_gain * rotation_error(view.R, self._rotation(state, view))
        return Motion(point, norm(error), scale * np.concatenate([h.gain * error, angular]))

    def _hover(self, view: View) -> Array:
        p, point = self._p, view.target.copy()
        if view.distance > p.sink_distance:
            point[2] += p.transit_clearance if view.goal.kind == "pick" else p.rim_clearance
        elif view.goal.kind == "pick":
            point[2] += p.hover_height
        return point

    def _rotation(self, state: ManipulatorState, view: View) -> Array:
        """Rotation of the tool, shape (3, 3): pointing down, tilted outwards where the reach requires it."""
        p = self._p
        outward = math.atan2(view.target[1] - view.mount[1], view.target[0] - view.mount[0])
        reach, largest = (p.place_reach, p.place_tilt) if view.goal.kind == "place" else (p.pick_reach, p.pick_tilt)
        tilt = 0.0
        if view.radius <= reach:
            tilt = tilt_for(view.radius, view.p[2] - view.mount[2], p.stretch, largest)
        return tool_rotation(outward if state.yaw is None else state.yaw, tilt, outward)

    def program(self, state: ManipulatorState, view: View, motion: Motion, program: Program) -> Program:
        """The arm's program with the holistic cost of the base; in transit also with that of arm and slack."""
        if view.goal.kind == "none":
            return program
        P, c, h = program.P.copy(), program.c.copy(), self._h
        if state.phase in _RESTING:
            c[BASE] = 0.0
            return msgspec.structs.replace(program, c=c)
        error = max(float(np.abs(motion.reference - view.p).sum()), h.arrived)
        scale = h.scale(error)
        P[BASE] = h.base_weight / error
        c[BASE] = 0.0, -self._turning(scale * h.k_eps, float(P[BASE][1]), _direction(view))
        if state.phase == Phase.TRANSIT:
            P[ARM], P[SLACK] = h.rate_weight, h.slack_weight / error
            c[ARM] = -scale * manipulability_gradient(view.q)
        return msgspec.structs.replace(program, P=P, c=c)

    def _turning(self, gain: float, weight: float, theta: float) -> float:
        """Linear cost of the yaw rate: ``gain theta``, reduced where the base could not stop turning within theta."""
        b, lag = self._base.yaw_acceleration, self._base.velocity_lag
        stoppable = b * (math.sqrt(lag * lag + 2.0 * abs(theta) / b) - lag)
        return math.copysign(min(gain * abs(theta), weight * stoppable), theta)


def _direction(view: View) -> float:
    """Direction theta [rad] of the hand in the base frame."""
    dx, dy, heading = view.p[0] - view.pose[0], view.p[1] - view.pose[1], view.pose[2]
    c, s = math.cos(heading), math.sin(heading)
    return math.atan2(-s * dx + c * dy, c * dx + s * dy)


class HolisticPlacement:
    """No base placement: the hand leads. Points to drive to are placed as by MotM of 2022."""

    def __init__(self, profile: RobotProfile) -> None:
        self._drives = TangentPlacement(profile, TangentParameters())

    def snapshot(self) -> TangentState:
        """The state of the placement of drives."""
        return self._drives.snapshot()

    def restore(self, state: TangentState) -> None:
        """Continue from a snapshot."""
        self._drives.restore(state)

    def place(self, problem: BaseProblem) -> Placement:
        """The target itself as the goal; a drive as by MotM of 2022."""
        target = problem.target
        if target is None or target.kind == "drive":
            return self._drives.place(problem)
        goal = frozen([*target.position[:2], problem.pose[2]])
        why = Reason(kind=Kind.WHOLE_BODY)
        return msgspec.structs.replace(no_placement(problem.pose), mode=Mode.WHOLE_BODY, goal=goal, why=why)


class HolisticBase:
    """Drives to points; while the hand leads it plans nothing and only reports the time to the target."""

    def __init__(self, profile: RobotProfile, planning: PlanningParameters) -> None:
        self._drives = TangentController(profile, planning)
        self._arm, self._limits = profile.arm, profile.base
        self._model = ReachModel(profile, planning.reach)

    def plan(self, problem: BaseProblem, placement: Placement, budget: SearchBudget) -> BasePlan:
        """Plan without acceleration towards a pick or a place: the arm's program moves the base."""
        target = problem.target
        if target is None or target.kind == "drive":
            return self._drives.plan(problem, placement, budget)
        time = self._time_to_range(problem, target)
        why = None if time == 0.0 else Reason(kind=Kind.HAND_HELD_UP, subject=target.name)
        way = frozen([problem.pose[:2], target.position[:2]])
        return msgspec.structs.replace(
            bare_plan(problem, np.zeros(2), PlanStatus.GOAL, why),
            global_path=way, intermediate_goal=placement.goal, t_h=time, time_to_range=time,
        )  # fmt: skip

    def _time_to_range(self, problem: BaseProblem, target: Target) -> float:
        """Time [s] straight to the reach of the target; 0 in reach."""
        if self._model.contains(problem.pose, problem.twist, target):
            return 0.0
        mount = from_frame(problem.pose, np.array([self._arm.mount_x, self._arm.mount_y]))
        away = float(np.hypot(*(target.position[:2] - mount))) - self._model.r_max(target)
        return max(away, 0.05) / self._limits.forward_speed


def whole_body_placement(materials: Materials, candidates: Rule) -> PlacementStrategy:
    """No base placement: the hand leads."""
    return HolisticPlacement(materials.parts.known.robot)


def whole_body_base(materials: Materials, policies: Policies) -> BaseController:
    """Base controller that plans drives to points only."""
    return HolisticBase(materials.parts.known.robot, materials.parts.parameters)


def holistic_arm(parts: ArmParts, holistic: HolisticParameters | None = None) -> Manipulator:
    """Arm whose program moves the base as well."""
    h = holistic or HolisticParameters()
    qp = msgspec.structs.replace(
        parts.parameters.qp, damper_gain=h.damper_gain, damper_start=h.damper_start, damper_stop=h.damper_stop
    )
    parameters = msgspec.structs.replace(parts.parameters, patience=math.inf, qp=qp)
    whole = WholeBody(parts.known.robot, parameters, h)
    ways = ArmWays(inputs=whole.inputs, motion=whole.motion, program=whole.program)
    return Manipulator(parts.known, parameters, AtOnce(), ways=ways)


HOLISTIC = Method(
    name="holistic",
    title="Holistic whole body",
    summary="One quadratic program moves base and arm together towards the target; no base planner, no next target.",
    source="Haviland et al., A Holistic Approach to Reactive Mobile Manipulation (RA-L 2022)",
    known=(
        "The program with all its weights, gains, dampers, k_eps = 0.5 and the scaling of speeds, from the authors' "
        "published example of a differential drive."
    ),
    chosen=(
        "Limits and accelerations of the base as of all methods, instead of 4.0 m/s and rad/s; speeds are scaled "
        "before the program instead of after it, so that these limits hold. The term of k_eps asks for no yaw rate "
        "from which the base cannot stop turning in time: the published gain is a switch, and a base with limited "
        "accelerations swings. Once the hand is over the target, the phases of a grasp and the weights of the hand "
        "are ours. The rows of the arm before furniture and obstacles stay; the base has none, as published."
    ),
    planner=BaseChoices(placement=whole_body_placement, controller=whole_body_base),
    arm=holistic_arm,
)
