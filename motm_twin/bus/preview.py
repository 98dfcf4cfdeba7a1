"""Places of bodies once the waiting edits are applied: what a standing twin shows while somebody drags.

A second plant of the same scene takes the state of the running one and the edits, so that what is shown is what will
be: cubes ride on their table, fall into a bin or are taken out of the fingers. The running plant is not touched.
"""

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import msgspec

from motm_twin.bus.encode import bodies
from motm_twin.bus.messages import TaskMessage, TickMessage
from motm_twin.model.edits import Edit, FreezeBody, InsertTask, MoveTask, RemoveTask, SendAgent, WorldEdit
from motm_twin.model.plant import BodyTruth, Truth
from motm_twin.model.scene import Scene

if TYPE_CHECKING:
    from motm_twin.control.loop import ControlLoop

FROZEN = "frozen"  # state of an agent


class Preview:
    """Applies edits to a copy of one state after another. Edits of what the robot knows show nothing."""

    def __init__(self, scene: Scene) -> None:
        from motm_twin.sim.plant import SimulatedPlant  # slow to import: only once the server listens

        self._plant = SimulatedPlant(scene)
        self._of: TickMessage | None = None
        self._applied = 0
        self._frozen: dict[str, bool] = {}  # by these edits: the plant itself says so after its next step

    def show(self, message: TickMessage, state: Callable[[], Any], edits: Sequence[Edit]) -> TickMessage:
        """The message of the last period with the edits; ``state`` gives the snapshot of the plant after it."""
        if message is not self._of or len(edits) < self._applied:
            self._plant.restore(state())
            self._of, self._applied, self._frozen = message, 0, {}
        for edit in edits[self._applied :]:
            if isinstance(edit, WorldEdit):
                self._plant.apply(edit)
                self._note(edit)
            self._applied += 1
        truth = self._thawed(self._plant.truth())
        robot = msgspec.structs.replace(message.robot, true_pose=truth.pose.tolist())
        return msgspec.structs.replace(message, robot=robot, preview=True, **bodies(truth))

    def _note(self, edit: WorldEdit) -> None:
        """Keep who is made to stand still, or to go on."""
        if isinstance(edit, FreezeBody):
            self._frozen[edit.name] = edit.frozen
        elif isinstance(edit, SendAgent):
            self._frozen[edit.name] = False

    def _thawed(self, truth: Truth) -> Truth:
        """The truth with the agents frozen, or no longer, as the edits want it."""

        def shown(body: BodyTruth) -> BodyTruth:
            wanted = self._frozen.get(body.name)
            if wanted is None or wanted == (body.state == FROZEN):
                return body
            return msgspec.structs.replace(body, state=FROZEN if wanted else "standing")

        agents, obstacles = (tuple(map(shown, group)) for group in (truth.agents, truth.obstacles))
        return msgspec.structs.replace(truth, agents=agents, obstacles=obstacles)


def tasks_previewed(
    message: TickMessage, loop: "ControlLoop", edits: Sequence[InsertTask | RemoveTask | MoveTask]
) -> TickMessage:
    """The message with the task list as these waiting edits leave it."""
    from motm_twin.control.task_list import edited, kind_of, name_of  # as above

    now = loop.sequence.listed()
    for edit in edits:
        now = edited(now, edit, loop.known, engaged=loop.engaged)
    tasks = [
        TaskMessage(kind=kind_of(task), target=name_of(task), status=status, attempts=attempts)
        for task, status, attempts in zip(now.tasks, now.status, now.attempts, strict=True)
    ]
    return msgspec.structs.replace(message, tasks=tasks, task_index=now.index)
