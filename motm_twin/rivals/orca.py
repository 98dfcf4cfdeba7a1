"""ORCA as base controller: the velocity nearest to the desired one outside the velocity obstacles of all tracks.

Each dynamic obstacle is a disc with the velocity of its track; walls are the outlines of the map without them. ORCA's
holonomic velocity (u, u') is that of the effective centre, a point ahead of the wheels (Snape et al., Smooth and
collision-free navigation for multiple robots under differential-drive constraints, IROS 2010):

    v = u cos(heading) + u' sin(heading),  w = (u' cos(heading) - u sin(heading)) / D,

with a disc about that point that contains the whole footprint.
"""

import itertools
import math
from dataclasses import dataclass

import msgspec
import numpy as np

from motm_twin.control.method import BaseChoices, Materials, Method, PlannerParts, Policies
from motm_twin.model.geometry import Array, frozen, wrap_angle
from motm_twin.model.known import KnownWorld
from motm_twin.model.motion import drive
from motm_twin.model.names import MethodError
from motm_twin.model.profile import Footprint
from motm_twin.model.reason import Kind, Reason
from motm_twin.model.rvo import Neighbours, require_pyrvo
from motm_twin.model.state import HasState
from motm_twin.perception.still_map import StaticMap
from motm_twin.planning.global_path import GraphCache, shortest_path
from motm_twin.planning.parameters import PlanningParameters, room_for
from motm_twin.planning.reach import ReachModel
from motm_twin.planning.types import (
    NO_PATH,
    BaseController,
    BasePlan,
    BaseProblem,
    Placement,
    PlanStatus,
    SearchBudget,
    Target,
)


@dataclass(frozen=True, kw_only=True)
class OrcaParameters:
    """Parameters of the differential drive that tracks a holonomic velocity."""

    ahead: float = 0.15  # [m] D, from the wheels to the effective centre: shorter turns faster, longer needs more room
    look: float = 0.6  # [m] along the global path to the point that the base heads for
    arrived: float = 0.05  # [m] from a goal with a heading, within which the base turns on the spot
    gain: float = 2.0  # [1/s] of that turn
    horizon: float = 1.0  # [s] of the predicted motion that is shown


def effective_radius(foot: Footprint, ahead: float) -> float:
    """Radius [m] of the disc about the effective centre that contains the footprint."""
    return math.hypot(0.5 * foot.length + abs(foot.offset_x - ahead), 0.5 * foot.width)


def twist_of(velocity: Array, heading: float, ahead: float) -> Array:
    """Speed and yaw rate (2,) that give the effective centre this velocity [m/s]."""
    c, s = math.cos(heading), math.sin(heading)
    return np.array([c * velocity[0] + s * velocity[1], (c * velocity[1] - s * velocity[0]) / ahead])


class WithoutMovers:
    """View of the map without dynamic obstacles, which are known by their tracks."""

    def __init__(self, parts: PlannerParts) -> None:
        self._still = StaticMap(parts.known, parts.tracks)

    def of(self, problem: BaseProblem) -> BaseProblem:
        """The problem with that map."""
        return msgspec.structs.replace(problem, world=self._still.of(problem.world))

    def memory(self) -> dict[str, HasState]:
        """The parts with a state: the map."""
        return {"still": self._still}


class OrcaController:
    """Base controller: the differential drive tracks a velocity chosen by ORCA. No state."""

    def __init__(self, known: KnownWorld, planning: PlanningParameters, graphs: GraphCache) -> None:
        """Raises MethodError without pyrvo."""
        require_pyrvo(MethodError)
        self._limits, self._foot = known.robot.base, known.robot.footprint
        self._planning, self._graphs, self._p = planning, graphs, OrcaParameters()
        self._reach = ReachModel(known.robot, planning.reach)
        self._radius = effective_radius(self._foot, self._p.ahead)

    def plan(self, problem: BaseProblem, placement: Placement, budget: SearchBudget) -> BasePlan:
        """This period's acceleration; ``budget`` is unused: nothing is searched."""
        target = problem.target
        if target is None or placement.chosen < 0:
            why = Reason(kind=Kind.NOTHING_TO_DO) if target is None else placement.why
            status = PlanStatus.IDLE if target is None else PlanStatus.BRAKING
            return self._answer(problem, np.zeros(2), status, why, NO_PATH, math.inf, math.inf)
        growth = room_for(self._planning, self._foot, problem.recovery.tightness).growth
        path = shortest_path(self._graphs.graph(problem.world, growth), problem.pose, placement.goal, self._limits)
        left = float(np.hypot(*np.diff(path, axis=0).T).sum()) if len(path) > 1 else 0.0
        desired = self._wanted_twist(problem, placement, path, left)
        time = left / self._limits.forward_speed
        return self._answer(problem, desired, PlanStatus.GOAL, None, path, time, self._to_range(problem, target, time))

    def _wanted_twist(self, problem: BaseProblem, placement: Placement, path: Array, left: float) -> Array:
        """Desired speed and yaw rate (2,), before the limits of acceleration."""
        heading, p = float(problem.pose[2]), self._p
        if placement.goal_has_heading and left < p.arrived:
            return np.array([0.0, p.gain * wrap_angle(float(placement.goal[2]) - heading)])
        to = _along(path, p.look) - problem.pose[:2] if len(path) > 1 else placement.goal[:2] - problem.pose[:2]
        distance = math.hypot(*to)
        stops = math.sqrt(2.0 * 0.5 * self._limits.linear_acceleration * max(left, distance))
        speed = min(self._limits.forward_speed, stops)
        preferred = to * (speed / distance) if distance > 0.0 else np.zeros(2)
        return twist_of(self._choice(problem, preferred), heading, p.ahead)

    def _choice(self, problem: BaseProblem, preferred: Array) -> Array:
        """ORCA's velocity [m/s] of the effective centre, shape (2,)."""
        (x, y, heading), (v, w), ahead = problem.pose.tolist(), problem.twist.tolist(), self._p.ahead
        c, s = math.cos(heading), math.sin(heading)
        around = Neighbours(problem.period)
        velocity = (v * c - ahead * w * s, v * s + ahead * w * c)
        around.add((x + ahead * c, y + ahead * s), velocity, self._radius, self._limits.forward_speed)
        around.prefer(0, preferred.tolist())
        for track in problem.world.tracks.tolist():
            around.add(track[:2], track[2:4], track[4], math.hypot(*track[2:4]))
        around.stand(problem.world.polygons)
        return around.chosen(1)[0]

    def _to_range(self, problem: BaseProblem, target: Target, time: float) -> float:
        """Time [s] until the target is in reach: 0 if it is, else ``time`` of the whole way; inf for a drive."""
        if target.kind == "drive":
            return math.inf
        return 0.0 if self._reach.contains(problem.pose, problem.twist, target) else max(time, problem.period)

    def _answer(
        self, problem: BaseProblem, desired: Array, status: PlanStatus, why: Reason | None, path: Array, time: float,
        to_range: float,
    ) -> BasePlan:  # fmt: skip
        """The plan that tracks this twist (2,) within the limits."""
        limits = self._limits
        top = np.array([limits.forward_speed, limits.yaw_rate])
        desired = np.clip(desired, [-limits.reverse_speed, -limits.yaw_rate], top)
        most = limits.accelerations
        rows = [np.array([*problem.pose, *problem.twist])]
        for _ in range(round(self._p.horizon / problem.period)):
            pose, twist = rows[-1][:3], rows[-1][3:]
            after = twist + np.clip(desired - twist, -most * problem.period, most * problem.period)
            mean = 0.5 * (twist + after)
            rows.append(np.array([*drive(pose, float(mean[0]), float(mean[1]), problem.period), *after]))
        return BasePlan(
            acceleration=frozen(limits.within((desired - problem.twist) / problem.period)),
            status=status,
            why=why,
            global_path=frozen(path),
            intermediate_goal=frozen(rows[-1][:3]),
            local_poses=frozen(rows),
            local_times=frozen(np.arange(len(rows)) * problem.period),
            t_h=time,
            time_to_range=to_range,
        )


def _along(path: Array, way: float) -> Array:
    """Point at a distance ``way`` [m] along a path (m, 2); its end when it is shorter."""
    for start, end in itertools.pairwise(path):
        step = math.dist(start.tolist(), end.tolist())
        if step >= way:
            return start + (end - start) * (way / step)
        way -= step
    return path[-1]


def orca_control(materials: Materials, policies: Policies) -> BaseController:
    """Base controller by ORCA."""
    parts = materials.parts
    return OrcaController(parts.known, parts.parameters, materials.graphs)


ORCA = Method(
    name="orca",
    title="ORCA, velocity obstacles",
    summary="Drives at the velocity nearest to the desired one that reciprocal velocity obstacles (ORCA) allow.",
    source="van den Berg et al., Reciprocal n-Body Collision Avoidance; Snape et al., for differential drives",
    known="ORCA itself, by pyrvo, with the horizon of 5 s, the 10 neighbours and the range of CrowdNav.",
    chosen=(
        "An effective centre 0.15 m ahead of the wheels; walls are expected for 1 s; heads for a point 0.6 m along the "
        "global path in the map without what moves. Made for driving to a place: it does not slow down for the arm."
    ),
    planner=BaseChoices(view=WithoutMovers, controller=orca_control),
)
