"""A method: everything that decides how the base drives and the arm reaches, under one name.

Methods share all code that is the same. Most differ by parameters only; the others bring a placement strategy, a base
controller, or an arm of their own.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from motm_twin.control.arm.controller import Manipulator
from motm_twin.control.arm.parameters import ArmParameters
from motm_twin.methods.rehearsal import Rehearse
from motm_twin.model.edits import ParameterValue
from motm_twin.model.known import KnownWorld
from motm_twin.perception.still_map import StillMap
from motm_twin.planning.global_path import GraphCache
from motm_twin.planning.parameters import PlanningParameters
from motm_twin.planning.planner import BasePlanner


@dataclass(frozen=True, kw_only=True)
class PlannerParts:
    """What the planner of a method is made of."""

    known: KnownWorld  # the robot, and the world as it knows it beforehand
    parameters: PlanningParameters
    clock: Callable[[], float] | None = None  # [s]; only where real time bounds a search
    graphs: GraphCache | None = None  # of the planner before, when parameters change during a run
    rehearse: Rehearse | None = None  # for methods that plan the whole task beforehand; a Twin gives it


@dataclass(frozen=True, kw_only=True)
class ArmParts:
    """What the arm side of a method is made of."""

    known: KnownWorld
    parameters: ArmParameters
    rehearse: Rehearse | None = None  # as in `PlannerParts`: the same rehearsal for both


def map_ahead(parts: PlannerParts) -> StillMap | None:
    """The map without what moves, for a controller that is to expect that on its course; None: it is not."""
    return StillMap(parts.known) if parts.parameters.staa.prediction > 0.0 else None


def paper_planner(parts: PlannerParts) -> BasePlanner:
    """Next-target-aware placement and modified STAA* (Paper, Sec. III and IV)."""
    return BasePlanner(
        parts.known.robot, parts.parameters, clock=parts.clock, graphs=parts.graphs, still=map_ahead(parts)
    )


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
