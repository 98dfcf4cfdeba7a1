"""A method: everything that decides how the base drives and the arm reaches, under one name.

Methods share all code that is the same. Most differ by parameters only; the others bring a placement strategy, a base
controller, or an arm of their own. A method that plans the whole task beforehand asks for a rehearsal
(`PlannerParts.rehearse`): a run of a simulated plant, period by period, which whoever builds the twin makes
(`motm_twin.dry_run`).
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from motm_twin.control.arm.controller import Manipulator
from motm_twin.control.arm.parameters import ArmParameters
from motm_twin.model.edits import ParameterValue, TaskEdit
from motm_twin.model.geometry import Array
from motm_twin.model.known import KnownWorld
from motm_twin.perception.still_map import StillMap
from motm_twin.planning.candidates import Rule, smallest_ring
from motm_twin.planning.commitment import Anew, Commitment
from motm_twin.planning.controller import StaaController
from motm_twin.planning.evasion import Evasion, MakesWay, StandsItsGround
from motm_twin.planning.global_path import GraphCache
from motm_twin.planning.parameters import PlanningParameters
from motm_twin.planning.placement import NextTargetPlacement
from motm_twin.planning.planner import BasePlanner, View
from motm_twin.planning.types import BaseController, BoolArray, PlacementStrategy


@dataclass(frozen=True, kw_only=True, eq=False)
class Rehearsed:
    """A run of the world as it is known beforehand: p periods, 5 p arm steps. Read only, so copies share it."""

    poses: Array  # base at the beginning of each period, from where the commands given act; world, shape (p, 3)
    twists: Array  # base twist commanded at the end of each period [m/s, rad/s], shape (p, 2)
    in_range: BoolArray  # the target was in range of the arm, shape (p,)
    blocked: BoolArray  # the base stood at the closest free place, shape (p,)
    q: Array  # arm joints before each step [rad], shape (5 p, 7)
    rates: Array  # commanded joint rates [rad/s], shape (5 p, 7)
    closed: BoolArray  # the gripper was told to close, shape (5 p,)
    phases: tuple[str, ...]  # of the arm, length 5 p
    outcomes: tuple[tuple[int, str], ...]  # arm step, and what the arm said in it: picked, placed, missed, lost
    failures: tuple[str, ...]  # tasks that were given up in rehearsal

    def __deepcopy__(self, memo: dict[int, Any]) -> "Rehearsed":
        return self

    @property
    def periods(self) -> int:
        """Length of the run."""
        return len(self.poses)


Timed = tuple[tuple[int, TaskEdit], ...]  # edits of the task list, each with the period at whose start it came
Rehearse = Callable[[Timed], Rehearsed]  # raises ValueError when the rehearsal can not take an edit


@dataclass(frozen=True, kw_only=True)
class PlannerParts:
    """Parts from which a method makes its planner."""

    known: KnownWorld  # the robot, and the world as it knows it beforehand
    parameters: PlanningParameters
    clock: Callable[[], float] | None = None  # [s]; only where real time bounds a search
    graphs: GraphCache | None = None  # of the planner before, when parameters change during a run
    rehearse: Rehearse | None = None  # for methods that plan the whole task beforehand; a Twin gives it


@dataclass(frozen=True, kw_only=True)
class ArmParts:
    """Parts from which a method makes its arm."""

    known: KnownWorld
    parameters: ArmParameters
    rehearse: Rehearse | None = None  # as in `PlannerParts`: the same rehearsal for both


def map_ahead(parts: PlannerParts) -> StillMap | None:
    """The map without what moves, for a controller that is to expect that on its course; None: it is not."""
    return StillMap(parts.known) if parts.parameters.staa.prediction > 0.0 else None


class Materials(NamedTuple):
    """Things that the choices of a planner are made from, and that they share."""

    parts: PlannerParts
    graphs: GraphCache
    ahead: StillMap | None  # of `map_ahead`
    view: View | None


class Policies(NamedTuple):
    """Policies of a base controller: what it keeps of earlier plans, and what it does about those who come too near."""

    commitment: Commitment
    evasion: Evasion


def paper_candidates(materials: Materials) -> Rule:
    """The smallest ring that has a viable candidate (Paper, Sec. IV)."""
    return smallest_ring


def next_target_placement(materials: Materials, candidates: Rule) -> PlacementStrategy:
    """The candidate with the least C_iC + 1.05 C_iN (Paper, Sec. IV)."""
    parts = materials.parts
    return NextTargetPlacement(parts.known.robot, parts.parameters, materials.graphs, candidates)


def search_anew(materials: Materials) -> Commitment:
    """Nothing: every period searches anew (Paper)."""
    return Anew()


def stand_ground(materials: Materials) -> Evasion:
    """Nothing: dynamic obstacles are obstacles where they are (Paper)."""
    return StandsItsGround()


def make_way(materials: Materials) -> Evasion:
    """The base moves out of the way of what would meet it."""
    return MakesWay(materials.parts.known, materials.parts.parameters.evasion)


def staa_control(materials: Materials, policies: Policies) -> BaseController:
    """STAA* with the paper's modifications, as the parameters say (Paper, Sec. III)."""
    parts = materials.parts
    return StaaController(
        parts.known.robot, parts.parameters, clock=parts.clock, graphs=materials.graphs, still=materials.ahead,
        commitment=policies.commitment, evasion=policies.evasion,
    )  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class BaseChoices:
    """Choices of which the planner of a method is made: a table whose lines are compared between methods.

    The values here are the paper's. What differs by numbers only (termination, penalty, Bezier heuristic, ...) is in
    `Method.parameters`.
    """

    view: Callable[[KnownWorld], View | None] = lambda known: None  # the map on which it plans: as it is seen
    candidates: Callable[[Materials], Rule] = paper_candidates
    placement: Callable[[Materials, Rule], PlacementStrategy] = next_target_placement
    commitment: Callable[[Materials], Commitment] = search_anew  # what is kept of earlier plans
    evasion: Callable[[Materials], Evasion] = stand_ground  # what is done about somebody who comes too near
    controller: Callable[[Materials, Policies], BaseController] = staa_control

    def __call__(self, parts: PlannerParts) -> BasePlanner:
        """The planner."""
        materials = Materials(parts, parts.graphs or GraphCache(), map_ahead(parts), self.view(parts.known))
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
    summary: str  # one sentence: what it does otherwise than the paper's method
    source: str  # "Paper, Sec. ...", an article, or "own"
    known: str = ""  # what has been published of it
    chosen: str = ""  # what is not, and what was chosen here
    parameters: Mapping[str, ParameterValue] = field(default_factory=dict)  # of `control.tuning`, other than shipped
    planner: Callable[[PlannerParts], BasePlanner] = paper_planner
    arm: Callable[[ArmParts], Manipulator] = paper_arm
