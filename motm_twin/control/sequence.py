"""The task sequence: which task is active, which target feeds the placement next, and what a failure leads to."""

from dataclasses import dataclass, field

from motm_twin.control.tick import Event, TaskState
from motm_twin.model.geometry import Array, wrap_angle
from motm_twin.model.known import KnownWorld
from motm_twin.model.scene import DriveTo, Pick, Place, Task
from motm_twin.model.state import Stateful

MAX_ATTEMPTS = 8  # grasps of one object before its task is given up
STALL_LIMIT = 30.0  # [s] with the target in reach and no progress before the task is given up
HEADING_TOLERANCE = 0.35  # [rad] (20 deg) of a drive_to pose


@dataclass
class SequenceState:
    """What changes while the list is worked through."""

    index: int = 0
    status: list[str] = field(default_factory=list)
    attempts: list[int] = field(default_factory=list)
    held: str = ""  # object that the gripper believes it holds
    in_reach_since: float | None = None
    failures: list[str] = field(default_factory=list)


class TaskSequence(Stateful[SequenceState]):
    """Works through the task list in order; a failed pick takes its place task with it."""

    def __init__(self, known: KnownWorld) -> None:
        self.known = known
        count = len(known.tasks)
        self._state = SequenceState(status=["waiting"] * count, attempts=[0] * count)
        self._activate()

    @property
    def index(self) -> int:
        """Index of the active task; the number of tasks when all have ended."""
        return self._state.index

    @property
    def held(self) -> str:
        """Name of the object that is believed to be in the gripper, or ''."""
        return self._state.held

    @property
    def done(self) -> bool:
        """Every task has ended, well or badly."""
        return self._state.index >= len(self.known.tasks)

    @property
    def failures(self) -> tuple[str, ...]:
        """One sentence for each task that was given up."""
        return tuple(self._state.failures)

    @property
    def active(self) -> Task | None:
        """The task being worked on."""
        return self._task(self._state.index)

    @property
    def following(self) -> Task | None:
        """The task after the active one: its target feeds the placement."""
        return self._task(self._state.index + 1)

    def report(self) -> tuple[TaskState, ...]:
        """The whole list, for the Tick."""
        state = self._state
        return tuple(
            TaskState(kind=kind_of(task), target=name_of(task), status=status, attempts=attempts)
            for task, status, attempts in zip(self.known.tasks, state.status, state.attempts, strict=True)
        )

    def apply(self, outcome: str, time: float) -> tuple[Event, ...]:
        """Take the outcome of an arm step into account ('' | picked | placed | missed | lost)."""
        task = self.active
        if not outcome or task is None:
            return ()
        state = self._state
        if outcome == "picked" and isinstance(task, Pick):
            state.held = task.object
            return self._finish(time, "picked", f"picked {task.object}")
        if outcome == "placed" and isinstance(task, Place):
            text = f"placed {state.held} in {task.bin}"
            state.held = ""
            return self._finish(time, "placed", text)
        if outcome == "missed" and isinstance(task, Pick):
            state.attempts[state.index] += 1
            state.in_reach_since = None
            if state.attempts[state.index] >= MAX_ATTEMPTS:
                return self._give_up(time, f"{task.object}: {MAX_ATTEMPTS} grasps failed")
            return (Event(time=time, kind="missed", text=f"missed {task.object}, trying again"),)
        if outcome == "lost":
            return self._lost(time)
        return ()

    def watch(self, time: float, in_reach: bool, pose: Array) -> tuple[Event, ...]:
        """Once per period: end drive_to tasks on arrival, and give up a task that makes no progress in reach."""
        task = self.active
        if task is None:
            return ()
        if isinstance(task, DriveTo):
            return self._finish(time, "arrived", f"arrived at {name_of(task)}") if arrived(task, pose) else ()
        state = self._state
        if not in_reach:
            state.in_reach_since = None
        elif state.in_reach_since is None:
            state.in_reach_since = time
        elif time - state.in_reach_since > STALL_LIMIT:
            return self._give_up(time, f"{kind_of(task)} {name_of(task)}: in reach for {STALL_LIMIT:.0f} s, not done")
        return ()

    def _task(self, index: int) -> Task | None:
        return self.known.tasks[index] if index < len(self.known.tasks) else None

    def _activate(self) -> None:
        state = self._state
        state.in_reach_since = None
        if state.index < len(state.status):
            state.status[state.index] = "active"
            state.attempts[state.index] = max(1, state.attempts[state.index])

    def _finish(self, time: float, kind: str, text: str) -> tuple[Event, ...]:
        state = self._state
        state.status[state.index] = "done"
        state.index += 1
        self._activate()
        return (Event(time=time, kind=kind, text=text),)

    def _give_up(self, time: float, text: str) -> tuple[Event, ...]:
        state = self._state
        state.failures.append(text)
        state.status[state.index] = "failed"
        state.index += 1
        if isinstance(self.active, Place) and not state.held:
            state.status[state.index] = "failed"
            state.index += 1
        self._activate()
        return (Event(time=time, kind="failed", text=text),)

    def _lost(self, time: float) -> tuple[Event, ...]:
        """The held object is gone: go back to picking it, as often as grasps are allowed."""
        state = self._state
        lost, state.held = state.held, ""
        pick = next(
            (i for i, task in enumerate(self.known.tasks) if isinstance(task, Pick) and task.object == lost), None
        )
        if pick is None:
            return ()
        state.attempts[pick] += 1
        if state.attempts[pick] >= MAX_ATTEMPTS:
            return self._give_up(time, f"{lost}: lost {MAX_ATTEMPTS} times")
        for i in range(pick, state.index + 1):
            state.status[i] = "waiting"
        state.index = pick
        self._activate()
        return (Event(time=time, kind="lost", text=f"lost {lost}, going back for it"),)


def kind_of(task: Task) -> str:
    """Name of the kind of a task, as in scene files."""
    return str(task.__struct_config__.tag)


def name_of(task: Task) -> str:
    """What the task is about: object, bin or point."""
    if isinstance(task, Pick):
        return task.object
    if isinstance(task, Place):
        return task.bin
    return f"({task.point[0]:.2f}, {task.point[1]:.2f})"


def arrived(task: DriveTo, pose: Array) -> bool:
    """Is the base within the task's tolerance?"""
    dx, dy = pose[0] - task.point[0], pose[1] - task.point[1]
    close = dx * dx + dy * dy <= task.tolerance**2
    return close and (task.heading is None or abs(wrap_angle(task.heading - pose[2])) <= HEADING_TOLERANCE)
