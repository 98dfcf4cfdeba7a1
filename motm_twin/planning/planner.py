"""Placement and control of the base in one call, on one visibility graph."""

from collections.abc import Callable
from typing import Any

from motm_twin.model.edits import InsertTask, MoveTask, RemoveTask
from motm_twin.model.geometry import Array
from motm_twin.model.profile import RobotProfile
from motm_twin.model.state import HasState
from motm_twin.perception.still_map import StillMap
from motm_twin.planning.controller import StaaController
from motm_twin.planning.global_path import GraphCache
from motm_twin.planning.parameters import PlanningParameters
from motm_twin.planning.placement import NextTargetPlacement
from motm_twin.planning.types import (
    BaseController,
    BasePlan,
    BaseProblem,
    Placement,
    PlacementStrategy,
    SearchBudget,
    empty_path,
)


class BasePlanner:
    """The base's part of a period. Strategies other than the paper's can be handed in."""

    def __init__(
        self,
        profile: RobotProfile,
        parameters: PlanningParameters | None = None,
        *,
        clock: Callable[[], float] | None = None,
        placement: PlacementStrategy | None = None,
        controller: BaseController | None = None,
        graphs: GraphCache | None = None,
        still: StillMap | None = None,
    ) -> None:
        """``graphs``: of another planner, to go on with the visibility graph that it has built.

        ``still``: the map without what moves, for a controller that expects that on its course.
        """
        parameters = parameters or PlanningParameters()
        self.graphs = graphs or GraphCache()
        self.parameters = parameters
        self.placement = placement or NextTargetPlacement(profile, parameters, self.graphs)
        self.ahead = still  # only with a prediction
        self.controller = controller or StaaController(
            profile, parameters, clock=clock, graphs=self.graphs, still=still
        )

    def plan(self, problem: BaseProblem, budget: SearchBudget) -> tuple[Placement, BasePlan]:
        """Where to stand, and how to accelerate now."""
        placement = self.place(problem)
        return placement, self.drive(problem, placement, budget)

    def place(self, problem: BaseProblem) -> Placement:
        """Where to stand."""
        return self.placement.place(problem)

    def drive(self, problem: BaseProblem, placement: Placement, budget: SearchBudget) -> BasePlan:
        """How to accelerate now."""
        return self.controller.plan(problem, placement, budget)

    def retasked(self, edit: InsertTask | RemoveTask | MoveTask) -> None:
        """A person has changed the task list: of interest only to whoever plans beyond the next target."""

    def candidate_paths(self, index: int) -> tuple[Array, Array] | None:
        """Paths (m, 2) [m] behind the costs of a candidate of the last period: robot to it, and it to the next target.

        None for a candidate that was rejected, an index that is none, and before the first period. The second path is
        empty when there is no next target.
        """
        placement = self.placement
        return placement.paths(index) if isinstance(placement, NextTargetPlacement) else None

    def staa_path(self) -> Array:
        """Global path (m, 2) [m] of unmodified STAA* in the last period; empty when there was none."""
        controller = self.controller
        return controller.staa_path() if isinstance(controller, StaaController) else empty_path()

    def snapshot(self) -> dict[str, Any]:
        """A deep copy of everything that changes between periods."""
        return {name: part.snapshot() for name, part in self._stateful().items()}

    def restore(self, state: dict[str, Any]) -> None:
        """Continue from a snapshot; what parameters have added since it was made (`still`) begins anew."""
        for name, part in self._stateful().items():
            if name in state or part is not self.ahead:
                part.restore(state[name])

    def _stateful(self) -> dict[str, HasState]:
        """The strategies that remember something between periods."""
        parts = {"placement": self.placement, "controller": self.controller, "ahead": self.ahead}
        return {name: part for name, part in parts.items() if isinstance(part, HasState)}
