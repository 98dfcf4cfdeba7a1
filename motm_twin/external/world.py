"""The world of an external robot, as far as that robot can be asked about it: only a simulated one can."""

from collections.abc import Mapping, Sequence

from motm_twin.bus.plant_messages import VERSION, EditRequest, Info, TaskNotice
from motm_twin.external.convert import truth_of
from motm_twin.external.robot_link import RobotLink
from motm_twin.model.edits import WorldEdit
from motm_twin.model.plant import Truth
from motm_twin.model.scene import PlanarPose, Task


class NotPossible(ValueError):
    """This robot can not do that; the message says what and why."""


class RemoteRehearsal:
    """Edits that wait to be applied, tried by the robot."""

    def __init__(self, link: RobotLink) -> None:
        self._link, self._accepted = link, list[WorldEdit]()

    def accept(self, edit: WorldEdit) -> None:
        """Take an edit after those that were accepted before; raises ValueError when the world will not take it."""
        request = EditRequest(version=VERSION, check=True, before=tuple(self._accepted), edit=edit)
        answer = self._link.ask(self._link.keys.edit, request)
        if not answer.ok:
            raise ValueError(answer.reason)
        self._accepted.append(edit)


class RemoteWorld:
    """Ground truth and edits."""

    def __init__(self, link: RobotLink) -> None:
        self.link, self.mirror = link, link.listen_only
        self._info: Info | None = None

    def truth(self) -> Truth | None:
        """Ground truth of a robot that tells it."""
        data = self.link.newest("truth")
        return None if data is None else truth_of(data)

    def rehearsal(self) -> "RemoteRehearsal":
        """Asks the robot about edits, one after another. Raises NotPossible."""
        self._require("edit", "its world can not be changed from here: move the real things")
        return RemoteRehearsal(self.link)

    def apply(self, edit: WorldEdit) -> None:
        """Change the world of a simulated robot; raises ValueError when it can not be."""
        self._require("edit", "its world can not be changed from here: move the real things")
        answer = self.link.ask(self.link.keys.edit, EditRequest(version=VERSION, check=False, edit=edit))
        if not answer.ok:
            raise ValueError(answer.reason)

    def expect_tasks(self, tasks: Sequence[Task]) -> None:
        """Tell the referee of a simulated robot the task list of now."""
        if self._info is not None and "truth" in self._info.can and not self.mirror:
            self.link.ask(self.link.keys.tasks, TaskNotice(version=VERSION, tasks=tuple(tasks)))

    def expect_map(self, announced: Mapping[str, PlanarPose]) -> None:
        """Tell the referee of a simulated robot where furniture was announced."""
        if self._info is not None and "truth" in self._info.can and not self.mirror:
            self.link.ask(self.link.keys.tasks, TaskNotice(version=VERSION, announced=dict(announced)))

    def _require(self, capability: str, why: str) -> None:
        if self.mirror:
            raise NotPossible("a mirror only shows the robot: it changes nothing")
        if self._info is None or capability not in self._info.can:
            name = "there is no robot" if self._info is None else f"robot {self._info.name!r} is not simulated"
            raise NotPossible(f"{name}: {why}")
