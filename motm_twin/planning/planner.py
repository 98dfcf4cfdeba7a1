"""Placement and control of the base in one call, on one visibility graph."""

from collections.abc import Callable

from motm_twin.model.profile import RobotProfile
from motm_twin.planning.controller import StaaController
from motm_twin.planning.global_path import GraphCache
from motm_twin.planning.parameters import PlanningParameters
from motm_twin.planning.placement import NextTargetPlacement, PlacementState
from motm_twin.planning.types import BaseController, BasePlan, BaseProblem, Placement, PlacementStrategy, SearchBudget


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
    ) -> None:
        parameters = parameters or PlanningParameters()
        graphs = GraphCache()
        self.parameters = parameters
        self.placement = placement or NextTargetPlacement(profile, parameters, graphs)
        self.controller = controller or StaaController(profile, parameters, clock=clock, graphs=graphs)

    def plan(self, problem: BaseProblem, budget: SearchBudget) -> tuple[Placement, BasePlan]:
        """Where to stand, and how to accelerate now."""
        placement = self.placement.place(problem)
        return placement, self.controller.plan(problem, placement, budget)

    def snapshot(self) -> PlacementState | None:
        """A deep copy of everything that changes between periods."""
        return self.placement.snapshot() if hasattr(self.placement, "snapshot") else None

    def restore(self, state: PlacementState | None) -> None:
        """Continue from a snapshot."""
        if hasattr(self.placement, "restore"):
            self.placement.restore(state)
