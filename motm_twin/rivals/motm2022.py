"""MotM of 2022: the base drives along a tangent to a circle round the target, then round it until the job is done.

Burgess-Limerick, Lehnert, Leitner and Corke, "An Architecture for Reactive Mobile Manipulation On-The-Move"
(2212.06991). The base ignores obstacles. With the base at a distance d from the target, the tangent point xi_C is
``rho = sqrt(d^2 - r_C^2)`` away, and the base of constant forward speed v turns at

    w = (k_alpha alpha + k_beta beta) v / rho,

alpha the bearing error to xi_C and beta the angle from the direction towards the next target to the line to xi_C.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from motm_twin.control.method import BaseChoices, Materials, Method, Policies
from motm_twin.model.geometry import Array, frozen, wrap_angle
from motm_twin.model.motion import drive
from motm_twin.model.profile import RobotProfile
from motm_twin.model.reason import Kind, Reason
from motm_twin.model.state import Stateful
from motm_twin.planning.candidates import Rule
from motm_twin.planning.parameters import PlanningParameters
from motm_twin.planning.reach import ReachModel
from motm_twin.planning.types import (
    NO_PATH,
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

_STEP = 0.1  # [s] of the prediction
_NODE = 3  # steps between two nodes of the plan that is shown and that the arm reads
_HORIZON = 80  # steps
_AFTER = 18  # steps predicted after the target comes into reach: a whole job
SIDES = (1.0, -1.0)  # target on the left (counter-clockwise round it), or on the right


@dataclass(frozen=True, kw_only=True)
class TangentParameters:
    """Gains and lengths of the base controller."""

    radius: float = 0.6  # [m] r_C, MotM: closest approach of the base to the target
    k_alpha: float = 4.0  # MotM
    k_beta: float = 2.2  # MotM
    swing: float = 0.4  # [rad] own: limit of the turn away from xi_C by beta; more only costs time
    near: float = 0.25  # [m] own: rho below which the base follows the circle, and smallest divisor rho
    loyalty: float = 0.2  # [rad] own: the other tangent must be this much nearer to the heading


class Tangent(NamedTuple):
    """One of the two tangents from the base to the circle."""

    point: tuple[float, float]  # xi_C [m]
    heading: float  # [rad] of the line to it
    rho: float  # [m]


def tangent(pose: Array, centre: Array, radius: float, side: float) -> Tangent:
    """The tangent from a base pose (3,) that passes with the centre (2,) to the left (side 1) or right (-1).

    Inside the circle: the heading that leads out of it and round it, with rho 0.
    """
    dx, dy = float(centre[0] - pose[0]), float(centre[1] - pose[1])
    distance, bearing = math.hypot(dx, dy), math.atan2(dy, dx)
    if distance <= radius:
        outwards = bearing - side * (0.5 * math.pi + min(1.0, 2.0 * (radius - distance) / max(radius, 1e-6)))
        return Tangent((float(pose[0]), float(pose[1])), wrap_angle(outwards), 0.0)
    rho = math.sqrt(distance * distance - radius * radius)
    heading = wrap_angle(bearing - side * math.asin(radius / distance))
    point = (float(pose[0]) + rho * math.cos(heading), float(pose[1]) + rho * math.sin(heading))
    return Tangent(point, heading, rho)


def departure(centre: Array, radius: float, side: float, onward: Array) -> float | None:
    """Angle [rad] on the circle at which its tangent leads to ``onward`` (2,); None: that point is inside."""
    dx, dy = float(onward[0] - centre[0]), float(onward[1] - centre[1])
    distance = math.hypot(dx, dy)
    return None if distance <= radius else math.atan2(dy, dx) - side * math.acos(radius / distance)


def _radius(target: Target, p: TangentParameters) -> float:
    """Radius [m] of the circle round a target; 0 for a drive."""
    return 0.0 if target.kind == "drive" else p.radius


@dataclass(kw_only=True)
class TangentState:
    """State between periods: the side on which the target is passed."""

    target: tuple[str, str] | None = None
    side: int = 0  # index into SIDES


class TangentPlacement(Stateful[TangentState]):
    """The two tangent points of the circle round the target; the one nearer to the heading is taken."""

    def __init__(self, profile: RobotProfile, parameters: TangentParameters) -> None:
        self._limits = profile.base
        self._p = parameters
        self._state = TangentState()

    def place(self, problem: BaseProblem) -> Placement:
        """Both tangent points with their costs [s], and the choice."""
        target = problem.target
        if target is None:
            self._state = TangentState()
            return no_placement(problem.pose)
        radius = _radius(target, self._p)
        sides = SIDES if radius > 0.0 else SIDES[:1]
        lines = [tangent(problem.pose, target.position, radius, side) for side in sides]
        swing = [abs(wrap_angle(line.heading - float(problem.pose[2]))) for line in lines]
        chosen = self._choose(target, swing)
        poses = np.array([[*line.point, line.heading] for line in lines])
        if target.heading is not None:
            poses[:, 2] = target.heading
        current = [a / self._limits.yaw_rate + line.rho / self._limits.forward_speed
                   for a, line in zip(swing, lines, strict=True)]  # fmt: skip
        onward = [self._onward(line, target, radius, side, problem.next_target)
                  for line, side in zip(lines, sides, strict=True)]  # fmt: skip
        return Placement(
            mode=Mode.DRIVE if target.kind == "drive" else Mode.RING,
            radius=radius,
            poses=frozen(poses),
            cost_current=frozen(current),
            cost_next=frozen(onward),
            cost=frozen(current),
            rejected=("",) * len(lines),
            chosen=chosen,
            goal=frozen(poses[chosen]),
            goal_has_heading=target.kind != "drive" or target.heading is not None,
            why=Reason(
                kind=Kind.TANGENT, value=float(lines[chosen].rho), limit=math.degrees(swing[chosen]), unit="m"
            ),
            next_goal=None if problem.next_target is None else frozen(problem.next_target.position[:2]),
        )  # fmt: skip

    def _choose(self, target: Target, swing: list[float]) -> int:
        state, name = self._state, (target.kind, target.name)
        known = state.target == name and state.side < len(swing)
        preferred = [a - (self._p.loyalty if known and k == state.side else 0.0) for k, a in enumerate(swing)]
        chosen = int(np.argmin(preferred))
        self._state = TangentState(target=name, side=chosen)
        return chosen

    def _onward(self, line: Tangent, target: Target, radius: float, side: float, following: Target | None) -> float:
        """Time [s] round the circle and straight on to the next target; 0 without one."""
        if following is None:
            return 0.0
        way = np.vstack([path_round(line, target.position, radius, side, following.position), following.position[:2]])
        return float(np.hypot(*np.diff(way, axis=0).T).sum()) / self._limits.forward_speed


def path_round(line: Tangent, centre: Array, radius: float, side: float, onward: Array | None) -> Array:
    """Path (m, 2) [m] from xi_C round the circle to the `departure` for ``onward``; xi_C alone without one."""
    leaves = None if onward is None or radius <= 0.0 else departure(centre, radius, side, onward)
    if leaves is None:
        return np.array([line.point])
    begins = math.atan2(line.point[1] - centre[1], line.point[0] - centre[0])
    sweep = math.fmod(side * (leaves - begins), 2.0 * math.pi)
    sweep += 2.0 * math.pi if sweep < 0.0 else 0.0
    angle = begins + side * np.linspace(0.0, sweep, 2 + int(sweep / 0.2))
    return np.asarray(centre)[:2] + radius * np.column_stack((np.cos(angle), np.sin(angle)))


class TangentController:
    """Constant forward speed and the yaw rate of the law above, regardless of braking distances."""

    def __init__(
        self, profile: RobotProfile, planning: PlanningParameters, parameters: TangentParameters | None = None
    ) -> None:
        self.limits = profile.base
        self._p = parameters or TangentParameters()
        self.reach = ReachModel(profile, planning.reach)

    def plan(self, problem: BaseProblem, placement: Placement, budget: SearchBudget) -> BasePlan:
        """Acceleration of this period, and the predicted motion; ``budget`` is unused: nothing is searched."""
        target = problem.target
        if target is None:
            braking = self.limits.within(-problem.twist / problem.period)
            return bare_plan(problem, braking, PlanStatus.IDLE, Reason(kind=Kind.NOTHING_TO_DO))
        side = SIDES[placement.chosen]
        acceleration = self._acceleration(
            problem.pose, problem.twist, target, problem.next_target, side, problem.period
        )
        nodes, to_range = self._predicted(problem, target, side)
        radius = _radius(target, self._p)
        line = tangent(problem.pose, target.position, radius, side)
        onward = None if problem.next_target is None else problem.next_target.position
        circle = path_round(line, target.position, radius, side, onward)
        return BasePlan(
            acceleration=frozen(acceleration),
            status=PlanStatus.GOAL,
            global_path=frozen(np.vstack([problem.pose[:2], circle])),
            next_path=NO_PATH if onward is None else frozen(np.vstack([circle[-1], onward[:2]])),
            intermediate_goal=frozen([*line.point, line.heading]),
            local_poses=frozen(nodes),
            local_times=frozen(np.arange(len(nodes)) * _NODE * _STEP),
            t_h=float(placement.cost_current[placement.chosen]),
            time_to_range=to_range,
        )

    def _acceleration(
        self, pose: Array, twist: Array, target: Target, following: Target | None, side: float, period: float
    ) -> Array:
        """Acceleration (2,) towards the speeds of the law, within the limits."""
        limits = self.limits
        yaw_rate = self._curvature(pose, target, following, side) * limits.forward_speed
        yaw_rate = min(max(yaw_rate, -limits.yaw_rate), limits.yaw_rate)
        return limits.within((np.array([limits.forward_speed, yaw_rate]) - twist) / period)

    def _curvature(self, pose: Array, target: Target, following: Target | None, side: float) -> float:
        """Curvature w / v [1/m] of the law."""
        p, radius = self._p, _radius(target, self._p)
        line = tangent(pose, target.position, radius, side)
        alpha = wrap_angle(line.heading - float(pose[2]))
        round_it = max(0.0, 1.0 - line.rho / p.near) / radius if radius > 0.0 else 0.0
        if line.rho <= p.near:
            return side * round_it + p.k_alpha * alpha / p.near
        desired = _leaving(line, target, following)
        beta = 0.0 if desired is None else wrap_angle(line.heading - desired)
        turning = min(max(p.k_beta * beta, -p.k_alpha * p.swing), p.k_alpha * p.swing)
        return (p.k_alpha * alpha + turning) / line.rho

    def _predicted(self, problem: BaseProblem, target: Target, side: float) -> tuple[Array, float]:
        """Predicted poses and twists (j, 5), and time [s] until the target comes into reach."""
        nodes, to_range, left = [], math.inf, _HORIZON
        pose, twist = np.array(problem.pose), np.array(problem.twist)
        for k, (pose, twist) in enumerate(self._steps(problem, target, side)):
            if k % _NODE == 0:
                nodes.append([*pose, *twist])
            if math.isinf(to_range) and self.reach.contains(pose, twist, target):
                to_range, left = k * _STEP, k + _AFTER
            if k >= left:
                break
        if math.isinf(to_range):  # beyond the horizon: straight on
            rho = tangent(pose, target.position, _radius(target, self._p), side).rho
            to_range = _HORIZON * _STEP + rho / self.limits.forward_speed
        return np.array(nodes), to_range

    def _steps(self, problem: BaseProblem, target: Target, side: float) -> Iterator[tuple[Array, Array]]:
        pose, twist = np.array(problem.pose), np.array(problem.twist)
        for _ in range(_HORIZON + 1):
            yield pose, twist
            faster = self._acceleration(pose, twist, target, problem.next_target, side, _STEP) * _STEP
            mean = twist + 0.5 * faster
            pose, twist = drive(pose, float(mean[0]), float(mean[1]), _STEP), twist + faster


def _leaving(line: Tangent, target: Target, following: Target | None) -> float | None:
    """Heading [rad] that the base should have at xi_C: that of a drive, else towards the next target."""
    if target.heading is not None:
        return target.heading
    if following is None:
        return None
    return math.atan2(following.position[1] - line.point[1], following.position[0] - line.point[0])


def tangent_placement(materials: Materials, candidates: Rule) -> PlacementStrategy:
    """Placement at tangent points; the tuned smallest ring and next weight apply to the paper's rule only."""
    return TangentPlacement(materials.parts.known.robot, TangentParameters())


def tangent_law(materials: Materials, policies: Policies) -> BaseController:
    """Base controller by the law of the tangent."""
    return TangentController(materials.parts.known.robot, materials.parts.parameters)


MOTM2022 = Method(
    name="motm2022",
    title="MotM 2022, tangent to a circle",
    summary="Drives along a tangent to a circle round the target at constant speed, without avoiding obstacles.",
    source="Burgess-Limerick et al., MotM (2212.06991)",
    known=(
        "r_C = 0.6 m; the tangent point of that circle that is nearer; w = (k_alpha alpha + k_beta beta) v / rho with "
        "k_alpha = 4, k_beta = 2.2 and a constant v; the arm leaves by the transit rule, k_A = 0.5. Gains and law are "
        "known from re-implementations, the full text was not available."
    ),
    chosen=(
        "v = 0.5 m/s, as of all methods. Nearer: to the heading. beta: from the direction xi_C - next target to the "
        "line to xi_C, the sign with which both angles vanish (as rho^1.3 and rho^1.7 for a fixed point); it "
        "turns the base away from xi_C by at most 0.4 rad, as more only costs time on the open floor. From "
        "rho = 0.25 m on the base goes round the circle until the job is done. Time to range: from the law itself, "
        "predicted with the limits of the base. In range: as of all methods, instead of a manipulability above 0.08."
    ),
    planner=BaseChoices(placement=tangent_placement, controller=tangent_law),
)
