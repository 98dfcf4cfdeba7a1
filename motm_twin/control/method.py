"""A method: everything that decides how the base drives and the arm reaches, under one name.

Methods share all common code. Most differ by parameters only; the others have their own placement strategy, base
controller or arm. A method that plans the whole task in advance asks for a rehearsal (`PlannerParts.rehearse`): a run
of a simulated plant, period by period (`motm_twin.dry_run`).
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from motm_twin.control.arm.controller import Manipulator
from motm_twin.control.arm.parameters import ArmParameters
from motm_twin.model.edits import ParameterValue, TaskEdit
from motm_twin.model.geometry import Array
from motm_twin.model.known import KnownWorld
from motm_twin.perception.still_map import StaticMap
from motm_twin.perception.tracks import TrackParameters
from motm_twin.planning.candidates import Rule, smallest_ring
from motm_twin.planning.commitment import Commitment, SearchAnew
from motm_twin.planning.controller import StaaController
from motm_twin.planning.evasion import Evasion, MakesWay, StandsItsGround
from motm_twin.planning.global_path import GraphCache
from motm_twin.planning.parameters import PlanningParameters
from motm_twin.planning.placement import NextTargetPlacement
from motm_twin.planning.planner import BasePlanner, View
from motm_twin.planning.types import BaseController, BoolArray, PlacementStrategy


@dataclass(frozen=True, kw_only=True, eq=False)
class Rehearsed:
    """A run of the world as known in advance: p periods, 5 p arm steps. Read-only, so copies share it."""

    poses: Array  # of the base at the start of each period, where its commands act; world, shape (p, 3)
    twists: Array  # base twist commanded at the end of each period [m/s, rad/s], shape (p, 2)
    in_range: BoolArray  # the target was in range of the arm, shape (p,)
    blocked: BoolArray  # the base stood at the closest free place, shape (p,)
    q: Array  # arm joints before each step [rad], shape (5 p, 7)
    rates: Array  # commanded joint rates [rad/s], shape (5 p, 7)
    closed: BoolArray  # the gripper was told to close, shape (5 p,)
    phases: tuple[str, ...]  # of the arm, length 5 p
    outcomes: tuple[tuple[int, str], ...]  # arm step, and its outcome: picked, placed, missed, lost
    failures: tuple[str, ...]  # tasks that were given up in rehearsal

    def __deepcopy__(self, memo: dict[int, Any]) -> "Rehearsed":
        return self

    @property
    def periods(self) -> int:
        """Length of the run."""
        return len(self.poses)


Timed = tuple[tuple[int, TaskEdit], ...]  # edits of the task list, each with the period at whose start it applies
Rehearse = Callable[[Timed], Rehearsed]  # raises ValueError when the rehearsal cannot apply an edit


@dataclass(frozen=True, kw_only=True)
class PlannerParts:
    """Parts from which a method makes its planner."""

    known: KnownWorld  # the robot, and the world as it knows it in advance
    parameters: PlanningParameters
    tracks: TrackParameters = field(default_factory=TrackParameters)
    clock: Callable[[], float] | None = None  # [s]; only where real time bounds a search
    graphs: GraphCache | None = None  # of the previous planner, when parameters change during a run
    rehearse: Rehearse | None = None  # for methods that plan the whole task in advance; set by the Twin


@dataclass(frozen=True, kw_only=True)
class ArmParts:
    """Parts from which a method makes its arm."""

    known: KnownWorld
    parameters: ArmParameters
    rehearse: Rehearse | None = None  # as in `PlannerParts`: the same rehearsal for both


def map_ahead(parts: PlannerParts) -> StaticMap | None:
    """The map without dynamic obstacles, for a controller that predicts them; None for one that does not."""
    return StaticMap(parts.known, parts.tracks) if parts.parameters.staa.prediction > 0.0 else None


class Materials(NamedTuple):
    """Parts that the choices of a planner share."""

    parts: PlannerParts
    graphs: GraphCache
    ahead: StaticMap | None  # of `map_ahead`
    view: View | None


class Policies(NamedTuple):
    """Policies of a base controller: keeping earlier plans, and evading dynamic obstacles that come near."""

    commitment: Commitment
    evasion: Evasion


def paper_candidates(materials: Materials) -> Rule:
    """The smallest ring that has a viable candidate (Paper, Sec. IV)."""
    return smallest_ring


def next_target_placement(materials: Materials, candidates: Rule) -> PlacementStrategy:
    """The candidate with the lowest C_iC + 1.05 C_iN (Paper, Sec. IV)."""
    parts = materials.parts
    return NextTargetPlacement(parts.known.robot, parts.parameters, materials.graphs, candidates)


def search_anew(materials: Materials) -> Commitment:
    """Keep nothing: every period starts a new search (Paper)."""
    return SearchAnew()


def stand_ground(materials: Materials) -> Evasion:
    """No evasion: dynamic obstacles are obstacles at their present place (Paper)."""
    return StandsItsGround()


def make_way(materials: Materials) -> Evasion:
    """The base moves out of the way of dynamic obstacles that would reach it."""
    return MakesWay(materials.parts.known, materials.parts.parameters)


def staa_control(materials: Materials, policies: Policies) -> BaseController:
    """STAA* with the paper's modifications, as the parameters say (Paper, Sec. III)."""
    parts = materials.parts
    return StaaController(
        parts.known.robot, parts.parameters, clock=parts.clock, graphs=materials.graphs, still=materials.ahead,
        commitment=policies.commitment, evasion=policies.evasion,
    )  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class BaseChoices:
    """Choices that make up the planner of a method, listed so that methods compare line by line.

    The defaults are the paper's. Differences in numbers only (termination, penalty, Bezier heuristic, ...) are in
    `Method.parameters`.
    """

    view: Callable[[PlannerParts], View | None] = lambda parts: None  # the map used for planning: as perceived
    candidates: Callable[[Materials], Rule] = paper_candidates
    placement: Callable[[Materials, Rule], PlacementStrategy] = next_target_placement
    commitment: Callable[[Materials], Commitment] = search_anew  # what is kept of earlier plans
    evasion: Callable[[Materials], Evasion] = stand_ground  # reaction to a dynamic obstacle that comes too near
    controller: Callable[[Materials, Policies], BaseController] = staa_control

    def __call__(self, parts: PlannerParts) -> BasePlanner:
        """The planner."""
        materials = Materials(parts, parts.graphs or GraphCache(), map_ahead(parts), self.view(parts))
        return BasePlanner(
            parts.known.robot,
            parts.parameters,
            placement=self.placement(materials, self.candidates(materials)),
            controller=self.controller(materials, Policies(self.commitment(materials), self.evasion(materials))),
            graphs=materials.graphs,
            still=materials.ahead,
            view=materials.view,
        )


paper_planner = BaseChoices()  # next-target-aware placement and modified STAA* (Paper, Sec. III and IV)


def paper_arm(parts: ArmParts) -> Manipulator:
    """The arm of MotM with obstacle avoidance (Paper, Sec. V)."""
    return Manipulator(parts.known, parts.parameters)


@dataclass(frozen=True, kw_only=True)
class Method:
    """A way to do the task, selectable by its name in `run`, `serve` and `bench`."""

    name: str
    title: str  # a few words, for tables and figures
    summary: str  # one sentence: how it differs from the paper's method
    source: str  # "Paper, Sec. ...", an article, or "own"
    known: str = ""  # the published details
    chosen: str = ""  # our choices for details that are not published
    parameters: Mapping[str, ParameterValue] = field(default_factory=dict)  # of `control.tuning`, if not the default
    planner: Callable[[PlannerParts], BasePlanner] = paper_planner
    arm: Callable[[ArmParts], Manipulator] = paper_arm
