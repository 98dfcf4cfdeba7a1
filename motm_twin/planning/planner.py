"""Placement and control of the base in one call, on one visibility graph."""

from collections.abc import Callable
from typing import Any, Protocol, runtime_checkable

import msgspec

from motm_twin.model.edits import TaskEdit
from motm_twin.model.geometry import Array
from motm_twin.model.profile import RobotProfile
from motm_twin.model.state import HasState
from motm_twin.perception.still_map import StaticMap
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


class View(Protocol):
    """The world as a method sees it."""

    def of(self, problem: BaseProblem) -> BaseProblem:
        """The problem of a period as the method solves it."""
        ...

    def memory(self) -> dict[str, HasState]:
        """Parts that remember something between periods, by name."""
        ...


@runtime_checkable
class HasPaths(Protocol):
    """A placement strategy that knows the paths behind its costs."""

    def paths(self, index: int) -> tuple[Array, Array] | None:
        """Paths of a candidate of the last period: from the robot to it, and on to the next target."""
        ...


@runtime_checkable
class HasStaaPath(Protocol):
    """A controller that knows the path of unmodified STAA*."""

    def staa_path(self) -> Array:
        """The path of STAA* in the last period, shape (m, 2) [m]."""
        ...


@runtime_checkable
class TaskListener(Protocol):
    """A controller that plans beyond the next target."""

    def retasked(self, edit: TaskEdit) -> None:
        """Take note of a user's change to the task list."""
        ...


class BasePlanner:
    """Base placement and base control of a period. Strategies other than the paper's can be passed in."""

    def __init__(
        self,
        profile: RobotProfile,
        parameters: PlanningParameters | None = None,
        *,
        clock: Callable[[], float] | None = None,
        placement: PlacementStrategy | None = None,
        controller: BaseController | None = None,
        graphs: GraphCache | None = None,
        still: StaticMap | None = None,
        view: View | None = None,
    ) -> None:
        """``graphs``: cache of another planner, to go on with the visibility graph that it has built.

        ``still``: gives the map without dynamic obstacles, for a controller that predicts their motion. ``view``: the
        world as placement and controller see it; None: as it is.
        """
        parameters = parameters or PlanningParameters()
        self.graphs = graphs or GraphCache()
        self.parameters = parameters
        self.placement = placement or NextTargetPlacement(profile, parameters, self.graphs)
        self.ahead = still  # None without prediction
        self.controller = controller or StaaController(
            profile, parameters, clock=clock, graphs=self.graphs, still=still
        )
        self.view = view
        self._seen: tuple[BaseProblem, BaseProblem] | None = None  # problem of this period, as given and as solved

    def plan(self, problem: BaseProblem, budget: SearchBudget) -> tuple[Placement, BasePlan]:
        """Choose where to stand, and how to accelerate now."""
        placement = self.place(problem)
        return placement, self.drive(problem, placement, budget)

    def place(self, problem: BaseProblem) -> Placement:
        """Choose where to stand."""
        return self.placement.place(self._viewed(problem))

    def drive(self, problem: BaseProblem, placement: Placement, budget: SearchBudget) -> BasePlan:
        """Choose how to accelerate now."""
        seen = self._viewed(problem)
        if placement.past_walls and seen.target is not None:
            seen = msgspec.structs.replace(seen, target=seen.target.past_walls(placement.past_walls))
        return self.controller.plan(seen, placement, budget)

    def _viewed(self, problem: BaseProblem) -> BaseProblem:
        """The problem as the method solves it, the same for placement and controller."""
        if self.view is None:
            return problem
        if self._seen is None or self._seen[0] is not problem:
            self._seen = problem, self.view.of(problem)
        return self._seen[1]

    def retasked(self, edit: TaskEdit) -> None:
        """Pass on a user's change to the task list to a controller that plans beyond the next target."""
        if isinstance(self.controller, TaskListener):
            self.controller.retasked(edit)

    def candidate_paths(self, index: int) -> tuple[Array, Array] | None:
        """Paths (m, 2) [m] behind the costs of a candidate of the last period: robot to it, and it to the next target.

        None for a rejected candidate, for an index out of range, and before the first period. The second path is
        empty when there is no next target.
        """
        placement = self.placement
        return placement.paths(index) if isinstance(placement, HasPaths) else None

    def staa_path(self) -> Array:
        """Global path (m, 2) [m] of unmodified STAA* in the last period; empty when there was none."""
        controller = self.controller
        return controller.staa_path() if isinstance(controller, HasStaaPath) else empty_path()

    def snapshot(self) -> dict[str, Any]:
        """A deep copy of everything that changes between periods."""
        return {name: part.snapshot() for name, part in self._stateful().items()}

    def restore(self, state: dict[str, Any]) -> None:
        """Continue from a snapshot; a part that a parameter has added since (`still`) begins anew."""
        for name, part in self._stateful().items():
            if name in state or part is not self.ahead:
                part.restore(state[name])

    def _stateful(self) -> dict[str, HasState]:
        """The strategies that remember something between periods; for `StaaController`, its policies."""
        controller = self.controller
        parts: dict[str, object] = {"placement": self.placement, "controller": controller, "ahead": self.ahead}
        if isinstance(controller, StaaController):
            parts |= {"controller": controller.commitment, "evasion": controller.evasion}
        found = {name: part for name, part in parts.items() if isinstance(part, HasState)}
        return found if self.view is None else {**found, **self.view.memory()}
