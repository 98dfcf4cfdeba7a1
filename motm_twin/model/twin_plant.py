"""Interface of a twin's robot beyond the three verbs: ground truth and edits, where the robot has them."""

from collections.abc import Mapping, Sequence
from typing import Protocol

from motm_twin.model.edits import WorldEdit
from motm_twin.model.plant import Plant, Truth
from motm_twin.model.scene import PlanarPose, Scene, Task


class WorldRehearsal(Protocol):
    """Edits that wait, tried one after another."""

    def accept(self, edit: WorldEdit) -> None:
        """Take an edit after those before; raises ValueError when the world will not take it."""
        ...


class TwinPlant(Plant, Protocol):
    """A twin's robot. Unsupported requests raise ValueError, and truth is None."""

    def truth(self) -> Truth | None:
        """Ground truth, if the robot has one."""
        ...

    def rehearsal(self) -> WorldRehearsal:
        """Try edits before they are applied."""
        ...

    def apply(self, edit: WorldEdit) -> None:
        """Change the world as a person does."""
        ...

    def expect_tasks(self, tasks: Sequence[Task]) -> None:
        """Give the referee, if there is one, the current task list."""
        ...

    def expect_map(self, announced: Mapping[str, PlanarPose]) -> None:
        """Give the referee, if there is one, the announced places of furniture."""
        ...


class ExternalPlant(TwinPlant, Protocol):
    """A robot in another program."""

    mirror: bool  # it is shown, and not commanded

    @property
    def shared(self) -> bool:
        """Its time passes only as granted."""
        ...

    def begin(self, scene: Scene) -> None:
        """Another run begins."""
        ...

    def ready(self) -> bool:
        """True when there is a robot to observe."""
        ...

    def text(self) -> str:
        """One sentence about the robot."""
        ...

    def interrupted(self) -> bool:
        """True when control was interrupted since the last call."""
        ...
