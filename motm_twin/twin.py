"""The twin: one scene, the simulated plant under the control loop, and everything needed to copy and rerun it."""

from collections.abc import Callable
from typing import Any

from motm_twin.control.loop import ControlLoop, Settings
from motm_twin.control.manipulation import Manipulator
from motm_twin.control.parameters import ArmParameters
from motm_twin.control.tick import Tick
from motm_twin.model.edits import WorldEdit
from motm_twin.model.known import known_world
from motm_twin.model.scene import Scene
from motm_twin.model.state import HasState, state_hash
from motm_twin.planning.parameters import PlanningParameters
from motm_twin.planning.planner import BasePlanner
from motm_twin.planning.types import SearchBudget
from motm_twin.sim.plant import SimulatedPlant


class Twin:
    """A running scene. `advance` runs one period; `post` queues an edit for the start of the next one."""

    def __init__(
        self,
        scene: Scene,
        *,
        budget: SearchBudget | None = None,
        planning: PlanningParameters | None = None,
        arm: ArmParameters | None = None,
        clock: Callable[[], float] | None = None,
    ) -> None:
        self.scene = scene
        self._budget = budget or SearchBudget()
        self._planning = planning or PlanningParameters()
        self._arm = arm or ArmParameters()
        self._clock = clock
        self.reset()

    def reset(self) -> None:
        """Back to the start of the scene; queued edits are forgotten."""
        known = known_world(self.scene)
        self.plant = SimulatedPlant(self.scene)
        search_clock = self._clock if self._budget.seconds is not None else None
        self.loop = ControlLoop(
            known,
            self.plant,
            BasePlanner(self.scene.robot, self._planning, clock=search_clock),
            Manipulator(known, self._arm),
            settings=Settings(budget=self._budget),
            truth=self.plant.truth,
            clock=self._clock or (lambda: 0.0),
        )
        self._queue: list[WorldEdit] = []

    @property
    def done(self) -> bool:
        """The task list is worked through."""
        return self.loop.sequence.done

    def post(self, edit: WorldEdit) -> None:
        """Queue an edit; raises ValueError when the world has no such body or the edit is not possible."""
        self.plant.check(edit, self._queue)
        self._queue.append(edit)

    def advance(self, budget: SearchBudget | None = None) -> Tick:
        """Apply queued edits, run one period, return its Tick."""
        edits, self._queue = tuple(self._queue), []
        for edit in edits:
            self.plant.apply(edit)
        return self.loop.period(edits, budget)

    def parts(self) -> dict[str, HasState]:
        """Everything that has state."""
        return {"plant": self.plant, **self.loop.parts()}

    def snapshot(self) -> dict[str, Any]:
        """A copy of the whole state, random generators included."""
        return {name: part.snapshot() for name, part in self.parts().items()}

    def restore(self, state: dict[str, Any]) -> None:
        """Continue from a snapshot of the same scene."""
        for name, part in self.parts().items():
            part.restore(state[name])

    def state_hash(self) -> str:
        """SHA-256 over the whole state: equal for equal runs."""
        return state_hash({name: part.snapshot() for name, part in self.parts().items()})
