"""Keeping to a plan: it is replaced by a better one, not by merely another one.

A search that starts anew every period finds another plan of about the same cost each time; where these begin in
different directions, the robot follows none of them. Here a plan is kept, period after period, as long as it keeps
clear of the obstacles seen now and gets the job done, and until a new plan is cheaper than the rest of it. That rest
falls by the time spent, so that the robot arrives. A search that is cut short gives a plan that only comes nearer; the
robot keeps to that one in the same way, until one is found that gets there.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import msgspec
import numpy as np

from motm_twin.model.geometry import Array, frozen
from motm_twin.model.motion import kernel, step
from motm_twin.model.profile import BaseLimits
from motm_twin.model.reason import Kind
from motm_twin.model.state import Stateful
from motm_twin.perception.world_map import WorldMap
from motm_twin.planning.braking import stopping_clearance
from motm_twin.planning.collision import Body, Field, clearance
from motm_twin.planning.encounters import WORTH
from motm_twin.planning.lattice import NO_LATTICE, cannot_turn, half_width, settle_lattice
from motm_twin.planning.parameters import CommitmentParameters, Room, StaaParameters
from motm_twin.planning.prediction import HIDES, at_half_steps, gap_to
from motm_twin.planning.reach import MANIPULATE, Job, in_reach
from motm_twin.planning.search_memory import CellVisibility, LatticeCosts, Memory, Settings, World
from motm_twin.planning.types import BasePlan, BaseProblem, Mode, Placement, PlanStatus, Target

TINY = 1e-6  # [s]


@dataclass(frozen=True, kw_only=True)
class Kept:
    """A plan that is followed."""

    targets: tuple[str, str]  # this one and the next
    place: tuple[float, float]  # of the target [m]
    arrives: bool  # the plan gets the job done
    informed: bool  # its search had lattice costs, which exist only in a tight place
    begins: float  # [s]
    times: Array  # [s] of its nodes from the beginning on, shape (n,)
    states: Array  # x, y, heading, v, w at the nodes, shape (n, 5)
    accelerations: Array  # [m/s^2, rad/s^2] between the nodes, shape (n - 1, 2)
    to_go: Array  # [s] remaining cost at each node, without the cost of dynamic obstacles, shape (n,)


@dataclass
class CommitmentState:
    """State between periods."""

    kept: Kept | None = None


class Rest(NamedTuple):
    """The rest of a plan that is followed."""

    kept: Kept
    states: Array  # x, y, heading, v, w of its nodes from now on, shape (n, 5)
    times: Array  # [s] of the nodes from now on, shape (n,)
    to_go: Array  # [s] remaining cost at each node, shape (n,)
    among: Array  # [s] share of `to_go` due to dynamic obstacles, shape (n,)
    job: Job

    @property
    def bound(self) -> float:
        """Cost [s] that a new plan must undercut; inf when the kept plan does not arrive."""
        return float(self.to_go[0]) if self.kept.arrives else math.inf

    def instead_of(self, found: BasePlan) -> BasePlan:
        """The plan of a period in which the search found nothing better."""
        states, times, arrives = self.states, self.times, self.kept.arrives
        return msgspec.structs.replace(
            found,
            acceleration=frozen((states[1, 3:] - states[0, 3:]) / times[1]),
            status=PlanStatus.GOAL if arrives else PlanStatus.ABORTED,
            local_poses=frozen(states),
            local_times=frozen(times),
            local_to_go=frozen(self.to_go),
            local_among=self.among,
            time_to_range=_time_to_range(states, times, self.job) if arrives else found.time_to_range,
        )


class BaseSearch(Protocol):
    """The base controller whose plans are kept, as a commitment uses it."""

    limits: BaseLimits
    parameters: StaaParameters
    body: Body

    def ahead(self, problem: BaseProblem) -> tuple[Field, Field, Array]:
        """Distance field and grid of static obstacles, and discs of dynamic ones."""
        ...

    def among(self, problem: BaseProblem, states: Array, times: Array) -> Array:
        """Cost [s] due to dynamic obstacles from each of the states (n, 5) on, at times [s] (n,); shape (n,)."""
        ...

    def room(self, problem: BaseProblem) -> Room:
        """Growth of obstacles and clearances for the plans of this period."""
        ...

    def job(self, problem: BaseProblem, target: Target) -> Job:
        """The target as the search knows it."""
        ...


class Commitment(Protocol):
    """A policy for keeping the plan of the last period."""

    def rest(self, problem: BaseProblem, placement: Placement, base: BaseSearch) -> Rest | None:
        """The rest of the kept plan; None: no plan is kept."""
        ...

    def lattice(
        self, problem: BaseProblem, s: Settings, world: World, cells: CellVisibility, memory: Memory
    ) -> LatticeCosts:
        """The costs of leaving the robot's present place, if those of PathRTR do not hold there."""
        ...

    def choose(self, problem: BaseProblem, found: BasePlan, rest: Rest | None, *, informed: bool) -> BasePlan:
        """The plan of this period. ``informed``: the plan found now had the costs of the lattice."""
        ...


class SearchAnew:
    """Every period searches anew (Paper)."""

    def rest(self, problem: BaseProblem, placement: Placement, base: BaseSearch) -> Rest | None:
        """Keep nothing."""
        return None

    def lattice(
        self, problem: BaseProblem, s: Settings, world: World, cells: CellVisibility, memory: Memory
    ) -> LatticeCosts:
        """No lattice: the paper turns on the spot everywhere."""
        return NO_LATTICE

    def choose(self, problem: BaseProblem, found: BasePlan, rest: Rest | None, *, informed: bool) -> BasePlan:
        """The plan that was found."""
        return found


class KeepPlans(Stateful[CommitmentState]):
    """A plan that gets the job done is kept until a better one is found."""

    def __init__(self, parameters: CommitmentParameters | None = None) -> None:
        self._parameters = parameters or CommitmentParameters()
        self._state = CommitmentState()
        self._loaded = False  # True once the kernels of the lattice are loaded

    def rest(self, problem: BaseProblem, placement: Placement, base: BaseSearch) -> Rest | None:
        """The rest of the kept plan, when it is still possible."""
        kept, target = self._state.kept, problem.target
        if (
            kept is None
            or target is None
            or kept.targets != _targets(problem)
            or placement.mode in (Mode.CLOSEST, Mode.NONE)
        ):
            return None
        if math.dist(kept.place, target.position[:2]) > self._parameters.moved:
            return None
        since = problem.time - kept.begins
        node = int(np.searchsorted(kept.times, since + TINY)) - 1
        if node + 1 >= len(kept.times) or not _followed(kept, problem, since, base.limits, self._parameters):
            return None
        to_go = float(np.interp(since, kept.times, kept.to_go))
        times = np.concatenate(([0.0], kept.times[node + 1 :] - since))
        job, limits, p = base.job(problem, target), base.limits, base.parameters
        states = np.empty((len(times), 5))
        states[0] = (*problem.pose, *problem.twist)
        field, _, moving = base.ahead(problem)
        free, done = follow(
            states, np.diff(times), kept.accelerations[node:], time_left(target), problem.engaged,
            Bounds(limits.forward_speed, limits.reverse_speed, limits.yaw_rate, limits.linear_acceleration,
                   limits.yaw_acceleration, base.room(problem).margin, p.margin_floor,
                   p.brake_depth * p.node_duration, 0.5 * p.node_duration, self._parameters.late),
            field, moving, base.body, job,
        )  # fmt: skip
        if not done if kept.arrives else not free:
            return None
        among = base.among(problem, states, times)
        if among[0] > WORTH:  # a dynamic obstacle is expected on the plan now
            return None
        return Rest(kept, states, times, np.concatenate(([to_go], kept.to_go[node + 1 :])) + among, among, job)

    def lattice(
        self, problem: BaseProblem, s: Settings, world: World, cells: CellVisibility, memory: Memory
    ) -> LatticeCosts:
        """The costs round a robot that creeps where it cannot turn, with a plan that does not arrive."""
        pose, kept = np.array(problem.pose, dtype=np.float64), self._state.kept
        held_up = kept is not None and not kept.arrives and kept.targets == _targets(problem)
        inside = (
            held_up
            and abs(problem.twist[0]) < self._parameters.creeps * s.v_f
            and cannot_turn(pose, s, world)
            and _for_good(problem.world, pose, half_width(world.body) + HIDES)
        )
        if self._loaded and not inside:
            return NO_LATTICE
        self._loaded = True  # load the kernels in the first period, not when the robot is in a tight place
        found = settle_lattice(pose, s, world, cells, memory.scratch)
        return found if inside else NO_LATTICE

    def choose(self, problem: BaseProblem, found: BasePlan, rest: Rest | None, *, informed: bool) -> BasePlan:
        """The plan found in this period, or the rest of the kept one if that costs no more."""
        gives_way = found.why is not None and found.why.kind == Kind.GIVES_WAY
        if gives_way or found.status in (PlanStatus.IDLE, PlanStatus.ESCAPING) or problem.target is None:
            self._state = CommitmentState()
            return found
        if rest is not None and not _better(found, rest, informed):
            return rest.instead_of(found)
        self._state = CommitmentState(
            _kept(problem, problem.target, found, informed) if len(found.local_poses) > 1 else None
        )
        return found


def time_left(target: Target) -> float:
    """Time [s] in reach that the job at a target still needs, as searches count it."""
    return max(target.dwell, 0.05) if target.kind != "drive" else 1.0


def _followed(kept: Kept, problem: BaseProblem, since: float, limits: BaseLimits, p: CommitmentParameters) -> bool:
    """Test that the robot is where the plan says, and drives as it says.

    A robot that was stopped, slowed or pushed is off the plan, and the rest of the plan no longer applies.
    """
    speeds = (p.follows_speed * limits.forward_speed, p.follows_speed * limits.yaw_rate)
    most = np.array([p.follows, p.follows, p.follows, *speeds])
    off = [np.interp(since, kept.times, column) for column in kept.states.T]
    off = np.array(off) - (*problem.pose, *problem.twist)
    off[2] = math.remainder(off[2], 2.0 * math.pi)
    return bool((np.abs(off) <= most).all())


def _for_good(world: WorldMap, pose: Array, around: float) -> bool:
    """Test that no mover is within ``around`` [m]: a tight place beside one opens up before the robot has left it."""
    return not len(world.movers) or bool(np.hypot(*(world.movers[:, :2] - pose[:2]).T).min() > around)


def _targets(problem: BaseProblem) -> tuple[str, str]:
    return tuple("" if target is None else target.name for target in (problem.target, problem.next_target))


def _better(found: BasePlan, rest: Rest, informed: bool) -> bool:
    """Test that a new plan replaces the rest of the kept one."""
    kept = rest.kept
    if found.status not in (PlanStatus.GOAL, PlanStatus.ABORTED):
        return False
    arrives = found.status == PlanStatus.GOAL
    if arrives != kept.arrives:
        return arrives
    if not arrives and informed != kept.informed:
        return informed
    return bool(found.local_to_go[0] < rest.to_go[0])


def _kept(problem: BaseProblem, target: Target, plan: BasePlan, informed: bool) -> Kept:
    return Kept(
        targets=_targets(problem),
        place=(float(target.position[0]), float(target.position[1])),
        arrives=plan.status == PlanStatus.GOAL,
        informed=informed,
        begins=problem.time,
        times=plan.local_times,
        states=plan.local_poses,
        accelerations=np.diff(plan.local_poses[:, 3:], axis=0) / np.diff(plan.local_times)[:, None],
        to_go=plan.local_to_go - plan.local_among if len(plan.local_among) else plan.local_to_go,
    )


def _time_to_range(states: Array, times: Array, job: Job) -> float:
    for state, time in zip(states, times, strict=True):
        if in_reach(*state, job):
            return float(time)
    return math.inf


class Bounds(NamedTuple):
    """Limits and margins of a plan that is followed."""

    v_f: float
    v_r: float
    w_max: float
    a_max: float
    b_max: float
    margin: float
    margin_floor: float
    braking: float  # [s] from now on, in which the robot must be able to stop
    half_node: float  # [s] between two tests along the plan, and between the discs of dynamic obstacles
    late: float  # [s] by which the job may end after the plan, the target being in reach


@kernel
def follow(
    states: Array, durations: Array, accelerations: Array, left: float, engaged: bool, bounds: Bounds, field: Field,
    moving: Array, body: Body, job: Job,
) -> tuple[bool, bool]:  # fmt: skip
    """Apply the accelerations from states[0] and fill in the other states: True if free, True if the job gets done.

    ``durations`` [s], shape (n,); ``accelerations``, shape (n, 2); ``states`` x, y, heading, v, w, shape (n + 1, 5).
    ``moving``: discs where dynamic obstacles are expected, of `prediction.expected`. ``left``: time [s] that the job
    still needs; ``engaged``: the target must stay in reach from now on.
    """
    x, y, heading, v, w = states[0, 0], states[0, 1], states[0, 2], states[0, 3], states[0, 4]
    root = clearance(x, y, heading, 1.0, field, body)
    root = min(root, gap_to(x, y, math.cos(heading), math.sin(heading), moving[0], body))
    allowed = bounds.margin if root >= bounds.margin else min(bounds.margin_floor, root - 0.001)
    hold = engaged and in_reach(x, y, heading, v, w, job)
    time = 0.0
    for i in range(durations.shape[0]):
        rest = durations[i]
        while rest > TINY:
            dt = min(rest, bounds.half_node)
            if job.kind == MANIPULATE and left > TINY:
                dt = min(dt, left)
            v_end = min(bounds.v_f, max(-bounds.v_r, v + accelerations[i, 0] * dt))
            w_end = min(bounds.w_max, max(-bounds.w_max, w + accelerations[i, 1] * dt))
            x, y, heading = step(x, y, heading, v, w, v_end, w_end, dt)
            v, w, time, rest = v_end, w_end, time + dt, rest - dt
            if clearance(x, y, heading, 0.25, field, body) < allowed:
                return False, False
            if moving.shape[1] > 0:
                discs = moving[at_half_steps(math.ceil(time / bounds.half_node - TINY), moving)]
                if gap_to(x, y, math.cos(heading), math.sin(heading), discs, body) < allowed:
                    return False, False
            if time <= bounds.braking + TINY:
                if stopping_clearance(x, y, heading, v, w, bounds.a_max, bounds.b_max, allowed, field, body) < allowed:
                    return False, False
            reached = in_reach(x, y, heading, v, w, job)
            if job.kind != MANIPULATE:
                left = 0.0 if reached else left
            elif left > TINY:
                if hold and not reached:
                    return False, False
                left = left - dt if reached else job.dwell
        states[i + 1, 0], states[i + 1, 1], states[i + 1, 2] = x, y, heading
        states[i + 1, 3], states[i + 1, 4] = v, w
    reached = in_reach(x, y, heading, v, w, job)
    return True, left <= (bounds.late if reached else TINY)
