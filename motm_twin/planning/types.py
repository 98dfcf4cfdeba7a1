"""Problems and answers of base placement and base control."""

import math
from enum import IntEnum, StrEnum
from typing import Protocol

import msgspec
import numpy as np
from numpy.typing import NDArray

from motm_twin.model.geometry import Array, frozen
from motm_twin.model.reason import Kind, Reason
from motm_twin.perception.world_map import NO_TRACKS, WorldMap


class PastWalls(IntEnum):
    """Ways for the arm to reach its target past the walls beside it."""

    AROUND = 0
    OVER_NEAR = 1  # over the low walls, from within `Target.reach_over`
    OVER = 2  # over the low walls, from anywhere in reach


class Target(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Something to be done at a point of the world frame."""

    kind: str  # "pick" | "place" | "drive"
    name: str
    position: Array  # [m], shape (2,)
    heading: float | None = None  # [rad], drive targets only
    tolerance: float = 0.15  # [m], drive targets only
    walls: Array = frozen(np.zeros((0, 4)))  # [m] edges x, y, x, y that the arm does not reach over, shape (k, 4)
    tall: Array | None = None  # walls that the arm never reaches over, shape (j, 4); None: all of `walls`
    dwell: float = 0.0  # [s] uninterrupted time in reach that the job still needs from now (0 for drive)
    reach: float = math.inf  # [m] of the arm at the target's height, horizontally from its mount
    reach_over: float = math.inf  # [m] the same for an arm that reaches over the low walls beside the target

    def past_walls(self, how: PastWalls) -> "Target":
        """The target with the walls and the reach that apply when the arm passes walls in the way ``how``."""
        if self.tall is None or how == PastWalls.AROUND:
            return self
        reach = min(self.reach, self.reach_over) if how == PastWalls.OVER_NEAR else self.reach
        return msgspec.structs.replace(self, walls=self.tall, reach=reach)


class Recovery(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Recovery measures for a base that has made no progress for some time."""

    back_off: bool = False  # a standing base may back off to where it has more clearance
    attempt: int = 0  # number of the back-off motion for a base that stands although it has a plan, from 1; 0: none
    look: bool = False  # a standing base may turn to see what is outside the field of view of its lidar
    tightness: float = 0.0  # 0: usual clearances, 1: the least ones, see `parameters.room_for`
    avoid: Array = frozen(np.zeros((0, 3)))  # base poses that the base failed to get to, shape (k, 3)


NO_RECOVERY = Recovery()


class BaseProblem(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """One period's question to the base: where to stand, and how to accelerate."""

    time: float  # [s]
    world: WorldMap
    pose: Array  # base pose from which the next command acts (lag compensated), shape (3,)
    twist: Array  # base speed and yaw rate commanded now [m/s, rad/s], shape (2,)
    target: Target | None  # None: nothing to do, come to rest
    next_target: Target | None
    engaged: bool  # the arm is at the object (final approach to lift): keep it in reach until done
    period: float = 0.05  # [s] for which the answer is applied
    stuck_at: Array = frozen(np.zeros((0, 3)))  # base poses from which the arm did not get to the target, (k, 3)
    recovery: Recovery = NO_RECOVERY
    yielding: Array = NO_TRACKS  # moving tracks expected to yield; `world.tracks` then has only the others, (k, 7)


class SearchBudget(msgspec.Struct, frozen=True, kw_only=True):
    """Bounds of one search: expansions always; `seconds` only where real time counts."""

    expansions: int = 300  # more does not shorten the trials; 1,000 cost three times the period
    seconds: float | None = None  # [s]; None: only expansions count (deterministic)


class Mode(StrEnum):
    """Kinds of candidate base poses."""

    RING = "ring"  # round the target
    REACH = "reach"  # any free pose, of any heading, from which the arm reaches the target
    CLOSEST = "closest"  # the free place closest to the target
    DRIVE = "drive"
    WHOLE_BODY = "whole body"
    TANGENT = "tangent"
    NONE = "none"


class PlanStatus(StrEnum):
    """Status of the plan of a period: the result of the search, or what the base does instead."""

    GOAL = "goal"  # a node ends the search
    ABORTED = "aborted"  # the search was cut off: the best node so far
    BRAKING = "braking"  # no candidate, no path, nothing found, or the base gives way
    ESCAPING = "escaping"  # the base leaves an overlap, backs off, turns to look, or evades
    IDLE = "idle"
    BY_HAND = "by hand"
    AGENT = "agent"


class Placement(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """All candidates of a period with their costs, and the choice."""

    mode: Mode
    radius: float  # [m] of the ring or circle of candidates, the smallest of several; 0 when there is none
    poses: Array  # candidate base poses, shape (n, 3)
    cost_current: Array  # C_iC [s], inf when rejected, shape (n,)
    cost_next: Array  # C_iN [s], shape (n,)
    cost: Array  # C_i [s], shape (n,)
    rejected: tuple[str, ...]  # "" when viable, else the reason, length n
    chosen: int  # index into poses; -1: there is none, and the base brakes
    goal: Array  # pose to drive to, shape (3,)
    past_walls: PastWalls = PastWalls.AROUND  # how the arm gets to its target from the goal
    goal_has_heading: bool
    why: Reason  # of the choice of this goal
    next_goal: Array | None  # pose or point of the next target used for C_iN, shape (3,) or (2,)
    next_goals: Array | None = None  # best poses of the next target, cheapest first; nan: free, (k, 3)

    @property
    def reason(self) -> str:
        """Reason for this goal, in one sentence."""
        return str(self.why)


NO_COSTS = frozen(np.zeros(0))
NO_PATH = frozen(np.zeros((0, 2)))


class Yields(StrEnum):
    """Party that gives way in an encounter."""

    NOBODY = ""  # neither has to give way
    ROBOT = "robot"
    OTHER = "other"


class Passes(StrEnum):
    """Side on which the base passes a dynamic obstacle whose way it crosses."""

    NEITHER = ""  # the base does not cross its way
    BEHIND = "behind"
    IN_FRONT = "in front"


class Encounter(msgspec.Struct, frozen=True, kw_only=True):
    """A dynamic obstacle that the base comes near to while it follows the plan, and who gives way."""

    track: int  # identity of its track
    yields: Yields
    passes: Passes
    time: float  # [s] from now until both are nearest to each other
    gap: float  # [m] between them then
    speed: float  # [m/s] of the dynamic obstacle
    courtesy: float  # [s] that the plan costs it: time of the base in its stopping path, weighted by nearness

    @property
    def why(self) -> Reason:
        """Typed reason that says who gives way, and how."""
        kind = _GIVES_WAY.get((self.yields, self.passes), Kind.KEEPS_CLEAR)
        return Reason(kind=kind, subject=f"track {self.track}", value=self.speed, limit=self.time, unit="m/s")


_GIVES_WAY = {
    (Yields.ROBOT, Passes.BEHIND): Kind.PASSES_BEHIND,
    (Yields.ROBOT, Passes.NEITHER): Kind.GIVES_WAY,
    (Yields.ROBOT, Passes.IN_FRONT): Kind.GIVES_WAY,
    (Yields.OTHER, Passes.BEHIND): Kind.IS_GIVEN_WAY,
    (Yields.OTHER, Passes.NEITHER): Kind.IS_GIVEN_WAY,
    (Yields.OTHER, Passes.IN_FRONT): Kind.IS_GIVEN_WAY,
    (Yields.NOBODY, Passes.BEHIND): Kind.PASSES_BEHIND,
    (Yields.NOBODY, Passes.IN_FRONT): Kind.PASSES_IN_FRONT,
}


class BasePlan(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """The acceleration of the base in this period, and the plan behind it."""

    acceleration: Array  # (a, b) [m/s^2, rad/s^2] held for the period, shape (2,)
    status: PlanStatus
    why: Reason | None = None  # whenever the robot brakes, waits or idles
    global_path: Array = NO_PATH  # robot to goal, shape (m, 2)
    next_path: Array = NO_PATH  # goal to next target, shape (k, 2)
    intermediate_goal: Array  # shape (3,)
    local_poses: Array  # x, y, heading, v, w at each node of the local plan, shape (j, 5)
    local_times: Array  # [s] from now, shape (j,)
    local_to_go: Array = NO_COSTS  # [s] cost in the search from each node on, penalties included, (j,) or (0,)
    local_among: Array = NO_COSTS  # [s] share of `local_to_go` due to dynamic obstacles nearby, (j,) or (0,)
    bezier: Array = NO_PATH  # sampled Bezier of the chosen branch's last node, shape (b, 2); may be empty
    expansions: int = 0
    cut_by_clock: bool = False
    t_h: float  # [s] estimated time until the goal is achieved
    k: float = 1.0  # proximity penalty scale max(0.1, min(t_h/3, 1))
    time_to_range: float  # [s] estimated until the target is in reach of the arm; 0 when it is, inf when unknown
    encounters: tuple[Encounter, ...] = ()  # with dynamic obstacles, the soonest first; of methods with foresight
    courtesy: float = 0.0  # [s] that the plan costs dynamic obstacles: the sum over its encounters

    @property
    def reason(self) -> str:
        """`why` in one sentence; "" for none."""
        return "" if self.why is None else str(self.why)


class PlacementStrategy(Protocol):
    """Chooses where the base should stand for the target."""

    def place(self, problem: BaseProblem) -> Placement:
        """The candidates for this period's target, with their costs, and the choice."""
        ...


class BaseController(Protocol):
    """Chooses how the base accelerates in this period."""

    def plan(self, problem: BaseProblem, placement: Placement, budget: SearchBudget) -> BasePlan:
        """This period's acceleration on the way to the chosen place, and the plan behind it."""
        ...


def empty_path() -> Array:
    """A path without points, shape (0, 2)."""
    return np.zeros((0, 2))


def bare_plan(problem: "BaseProblem", acceleration: Array, status: PlanStatus, why: Reason | None) -> BasePlan:
    """A plan of this acceleration (2,) without paths, from a controller that plans no further ahead."""
    return BasePlan(
        acceleration=frozen(acceleration), status=status, why=why, intermediate_goal=frozen(problem.pose),
        local_poses=frozen([[*problem.pose, *problem.twist]]), local_times=frozen([0.0]), t_h=0.0,
        time_to_range=math.inf,
    )  # fmt: skip


def no_placement(pose: Array) -> Placement:
    """The placement of a robot at a pose (3,) that has no target."""
    none = frozen(np.zeros(0))
    return Placement(
        mode=Mode.NONE, radius=0.0, poses=frozen(np.zeros((0, 3))), cost_current=none, cost_next=none, cost=none,
        rejected=(), chosen=-1, goal=frozen(pose), goal_has_heading=False, next_goal=None,
        why=Reason(kind=Kind.NO_TARGET),
    )  # fmt: skip


BoolArray = NDArray[np.bool_]
