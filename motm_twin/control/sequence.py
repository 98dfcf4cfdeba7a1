"""The task sequence: the active task, the next target for the placement, and the consequences of failures.

A held object goes into a bin before another one is picked. The paper has no rule for a bin that does not take it; here
the place is tried again, then the nearest other bin takes the object, and the task stays failed. When every bin has
refused, or a user has removed the place task from the list, the robot keeps the object and waits for a place task.
"""

import math
from dataclasses import dataclass, field
from typing import Annotated

import msgspec

from motm_twin.control.task_list import TaskList, edited, kind_of, name_of
from motm_twin.control.tick import Event, TaskState
from motm_twin.model.edits import TaskEdit
from motm_twin.model.geometry import Array, wrap_angle
from motm_twin.model.known import KnownWorld
from motm_twin.model.number import OWN, Number, Slider
from motm_twin.model.reason import Kind, Reason
from motm_twin.model.scene import HEADING_TOLERANCE, DriveTo, Pick, Place, Task
from motm_twin.model.state import Stateful


class SequenceParameters(msgspec.Struct, frozen=True, kw_only=True):
    """Limits after which a task is tried again, put off or given up."""

    most_attempts: Annotated[int, Number("", OWN, "grasps of one object before its task is given up")] = 8
    place_attempts: Annotated[
        int,
        Number(
            "",
            OWN,
            "tries of stall_limit at a bin before what is held goes to another: whoever is in the way may leave",
        ),
    ] = 3
    stall_limit: Annotated[
        float, Number("s", OWN, "time with the target in reach and no result before the task is given up")
    ] = 30.0
    out_of_reach: Annotated[
        float,
        Number("s", OWN, "time out of reach after which stall_limit counts anew; a base that swings keeps it running"),
    ] = 5.0
    closest_limit: Annotated[
        float, Number("s", OWN, "time as near as the base gets before a target outside the map, or taken, is given up")
    ] = 10.0
    other_order: Annotated[
        float,
        Number("s", OWN, "time without progress of the base after which another task comes first"),
        Slider("Patience before another task", "Base control",
            "Time without progress after which the robot puts the task off and takes the next one first.",
            (3.0, 30.0, 1.0)),
    ] = 25.0  # fmt: skip
    no_progress: Annotated[
        float, Number("s", OWN, "time without progress of the base after which the task is given up")
    ] = 45.0


@dataclass
class SequenceState:
    """State of the list while it is worked through."""

    index: int = 0
    tasks: list[Task] = field(default_factory=list)
    status: list[str] = field(default_factory=list)
    attempts: list[int] = field(default_factory=list)
    held: str = ""  # object that the gripper believes it holds
    in_reach_since: float | None = None
    waits: dict[tuple[str, ...], tuple[int, Reason]] = field(default_factory=dict)  # counts by reason to wait
    out_of_reach_since: float | None = None
    outside_since: float | None = None
    failures: list[str] = field(default_factory=list)
    postponed: tuple[str, ...] = ()  # tasks that were put off once: next time they are given up
    refused: tuple[str, ...] = ()  # bins whose place task was given up for the object held now


class TaskSequence(Stateful[SequenceState]):
    """Works through the task list in order; a failed pick ends its place task, too, also past drives."""

    def __init__(self, known: KnownWorld, limits: SequenceParameters | None = None) -> None:
        self.known, self.limits = known, limits or SequenceParameters()
        count = len(known.tasks)
        self._state = SequenceState(tasks=list(known.tasks), status=["waiting"] * count, attempts=[0] * count)
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
        """True when every task has ended, well or badly."""
        return self._state.index >= len(self._state.tasks)

    @property
    def tasks(self) -> tuple[Task, ...]:
        """The whole list, with the tasks that have ended."""
        return tuple(self._state.tasks)

    @property
    def attempts(self) -> int:
        """Tries of the active task so far; 0 when there is none."""
        return 0 if self.done else self._state.attempts[self._state.index]

    @property
    def most_attempts(self) -> int:
        """Tries that the active task gets."""
        return self.limits.place_attempts if isinstance(self.active, Place) else self.limits.most_attempts

    @property
    def refused(self) -> tuple[str, ...]:
        """Bins that were given up for the held object."""
        return self._state.refused

    @property
    def failures(self) -> tuple[str, ...]:
        """One sentence for each task that was given up."""
        return tuple(self._state.failures)

    @property
    def active(self) -> Task | None:
        """The task being worked on; None also while a held object has to be placed before the next pick."""
        task = self._task(self._state.index)
        return None if self._state.held and isinstance(task, Pick) else task

    @property
    def following(self) -> Task | None:
        """The task after the active one: its target feeds the placement."""
        return None if self.active is None else self._task(self._state.index + 1)

    def report(self) -> tuple[TaskState, ...]:
        """The whole list, for the Tick."""
        state = self._state
        return tuple(
            TaskState(kind=kind_of(task), target=name_of(task), status=status, attempts=attempts)
            for task, status, attempts in zip(state.tasks, state.status, state.attempts, strict=True)
        )

    def listed(self) -> TaskList:
        """The list as `task_list.edited` changes it."""
        state = self._state
        return TaskList(self.tasks, tuple(state.status), tuple(state.attempts), state.index, state.held)

    def edit(self, edit: TaskEdit, known: KnownWorld, *, engaged: bool) -> bool:
        """Change the list; True if another task is active now. Raises ValueError when the edit is not possible."""
        state, before = self._state, self._task(self._state.index)
        after = edited(self.listed(), edit, known, engaged=engaged)
        state.tasks, state.status, state.attempts = list(after.tasks), list(after.status), list(after.attempts)
        if self._task(state.index) is before:
            return False
        state.status[state.index :] = ["waiting"] * (len(state.tasks) - state.index)
        self._activate()
        return True

    def apply(self, outcome: str, time: float, why: Reason | None = None) -> tuple[Event, ...]:
        """Take the outcome of an arm step into account ('' | picked | placed | missed | lost | stuck | no room)."""
        if outcome == "lost":
            return self._lost(time)
        task = self.active
        if not outcome or task is None:
            return ()
        state = self._state
        if outcome == "picked" and isinstance(task, Pick):
            state.held = task.object
            return self._complete(time, "picked", f"picked {task.object}")
        if outcome == "placed" and isinstance(task, Place):
            text = f"placed {state.held} in {task.bin}"
            state.held, state.refused = "", ()
            return self._complete(time, "placed", text)
        if outcome == "no room" and isinstance(task, Pick):
            return self._give_up(time, f"pick {task.object}: {why}")
        if outcome == "missed" and isinstance(task, Pick):
            state.attempts[state.index] += 1
            state.in_reach_since = None
            if state.attempts[state.index] >= self.limits.most_attempts:
                return self._give_up(time, f"{task.object}: {self.limits.most_attempts} grasps failed")
            return (Event(time=time, kind="missed", text=f"missed {task.object}, trying again"),)
        return ()

    def watch(
        self, time: float, in_reach: bool, pose: Array, *,
        blocked: str = "", outside: bool = False, busy: bool = False, why: Reason | None = None,
    ) -> tuple[Event, ...]:  # fmt: skip
        """Once per period: end drive_to tasks on arrival; give up what cannot be done or makes no progress in reach.

        ``blocked``: why the base stands at the free place closest to a point, and not at the point; ``outside``: the
        base gets no nearer to a target outside the map; ``busy``: the fingers close, lift or let go, which soon ends,
        so nothing is given up; ``why``: reason for which the arm waits. The most frequent reason is reported.
        """
        task, state = self.active, self._state
        if task is None or busy:
            return ()
        if isinstance(task, Place) and not state.held:
            return self._give_up(time, f"place in {task.bin}: nothing is held, there is nothing to place")
        if isinstance(task, DriveTo) and arrived(task, pose):
            return self._complete(time, "arrived", f"arrived at {name_of(task)}")
        if not outside:
            state.outside_since = None
        elif state.outside_since is None:
            state.outside_since = time
        elif time - state.outside_since > self.limits.closest_limit:
            text = f"{kind_of(task)} {name_of(task)}: outside the map for {self.limits.closest_limit:.0f} s"
            return self._give_up(time, text + self._elsewhere(pose))
        if isinstance(task, DriveTo):
            return self._watch_drive(task, time, blocked=blocked)
        return self._watch_reach(task, time, pose, in_reach, why)

    def _watch_drive(self, task: DriveTo, time: float, *, blocked: str) -> tuple[Event, ...]:
        state = self._state
        if not blocked:
            state.in_reach_since = None
        elif state.in_reach_since is None:
            state.in_reach_since = time
        elif time - state.in_reach_since > self.limits.closest_limit:
            return self._give_up(time, f"drive to {name_of(task)}: {blocked} for {self.limits.closest_limit:.0f} s")
        return ()

    def _watch_reach(
        self, task: Task, time: float, pose: Array, in_reach: bool, why: Reason | None
    ) -> tuple[Event, ...]:
        state = self._state
        if not in_reach:
            if state.out_of_reach_since is None:
                state.out_of_reach_since = time
            elif time - state.out_of_reach_since > self.limits.out_of_reach:
                state.in_reach_since = None
            return ()
        state.out_of_reach_since = None
        if state.in_reach_since is None:
            state.in_reach_since, state.waits = time, {}
        if why is not None and why.kind != Kind.STARTS_OVER:  # starting over is no cause
            state.waits[why.key] = state.waits.get(why.key, (0, why))[0] + 1, why
        if time - state.in_reach_since > self.limits.stall_limit:
            text = f"{kind_of(task)} {name_of(task)}: in reach for {self.limits.stall_limit:.0f} s, not done"
            text = f"{text}: {max(state.waits.values(), key=_count)[1]}" if state.waits else text
            if isinstance(task, Place) and state.attempts[state.index] < self.limits.place_attempts:
                state.attempts[state.index] += 1
                state.in_reach_since, state.waits = time, {}
                return (Event(time=time, kind="missed", text=f"{text}; trying again"),)
            return self._give_up(time, text + self._elsewhere(pose))
        return ()

    def hold_up(self, time: float, stalled: float, why: Reason | None, pose: Array) -> tuple[Event, ...]:
        """React to a base without progress for ``stalled`` [s]: put the task off, or give it up."""
        state, task = self._state, self.active
        if task is None or stalled < self.limits.other_order:
            return ()
        name = f"{kind_of(task)} {name_of(task)}"
        reason = "" if why is None else f": {why}"
        if name not in state.postponed and not state.held and self._put_off():
            state.postponed += (name,)
            text = f"{name}: no progress for {stalled:.0f} s, put off{reason}"
            return (Event(time=time, kind="postponed", text=text),)
        if stalled < self.limits.no_progress:
            return ()
        return self._give_up(time, f"{name}: no progress for {stalled:.0f} s{reason}" + self._elsewhere(pose))

    def _put_off(self) -> bool:
        """Move the active task (a pick with its place) to the end of the list; False when it is the last."""
        state, start = self._state, self._state.index
        end = start + 1
        if isinstance(state.tasks[start], Pick):
            places = (i for i in range(start, len(state.tasks)) if isinstance(state.tasks[i], Place))
            end = next(places, len(state.tasks) - 1) + 1
        if end >= len(state.tasks):
            return False
        state.tasks[start:] = [*state.tasks[end:], *state.tasks[start:end]]
        state.attempts[start:] = [*state.attempts[end:], *state.attempts[start:end]]
        state.status[start:] = ["waiting"] * (len(state.tasks) - start)
        self._activate()
        return True

    def _elsewhere(self, pose: Array) -> str:
        """Insert a place task for the held object at another bin, as the active one fails; text for the event."""
        state = self._state
        task = state.tasks[state.index]
        if not isinstance(task, Place) or not state.held:
            return ""
        state.refused = (*state.refused, task.bin)
        if isinstance(self._next_job(state.index + 1), Place):
            return ""
        others = [place for place in self.known.bins if place.name not in state.refused]
        if not others:
            return f"; {state.held} stays in the gripper: there is no other bin"
        x, y = float(pose[0]), float(pose[1])
        other = min(others, key=lambda place: (math.hypot(place.centre[0] - x, place.centre[1] - y), place.name))
        at = state.index + 1
        state.tasks.insert(at, Place(bin=other.name))
        state.status.insert(at, "waiting")
        state.attempts.insert(at, 0)
        return f"; {state.held} goes to {other.name} instead"

    def _task(self, index: int) -> Task | None:
        return self._state.tasks[index] if index < len(self._state.tasks) else None

    def _activate(self) -> None:
        state = self._state
        state.in_reach_since = state.out_of_reach_since = state.outside_since = None
        if state.index < len(state.status):
            state.status[state.index] = "active"
            state.attempts[state.index] = max(1, state.attempts[state.index])

    def _complete(self, time: float, kind: str, text: str) -> tuple[Event, ...]:
        state = self._state
        state.status[state.index] = "done"
        state.index += 1
        self._activate()
        return (Event(time=time, kind=kind, text=text),)

    def _give_up(self, time: float, text: str) -> tuple[Event, ...]:
        state = self._state
        picks = isinstance(state.tasks[state.index], Pick)
        state.status[state.index] = "failed"
        state.index += 1
        if picks and not state.held:
            self._fail_place()
        return self._failed(time, text)

    def _fail_place(self) -> None:
        """End the next place task, for which nothing is held; drives before it stay, and come after it."""
        state = self._state
        if not isinstance(self._next_job(state.index), Place):
            return
        at = next(i for i in range(state.index, len(state.tasks)) if isinstance(state.tasks[i], Place))
        state.tasks.insert(state.index, state.tasks.pop(at))
        state.attempts.insert(state.index, state.attempts.pop(at))
        del state.status[at]
        state.status.insert(state.index, "failed")
        state.index += 1

    def _failed(self, time: float, text: str) -> tuple[Event, ...]:
        self._state.failures.append(text)
        self._activate()
        return (Event(time=time, kind="failed", text=text),)

    def _lost(self, time: float) -> tuple[Event, ...]:
        """The held object is gone: go back to picking it, as often as grasps are allowed."""
        state = self._state
        lost, state.held, state.refused = state.held, "", ()
        picks = [
            i for i, task in enumerate(state.tasks[: state.index]) if isinstance(task, Pick) and task.object == lost
        ]
        if not picks or not isinstance(self._next_job(state.index), Place):
            return (Event(time=time, kind="lost", text=f"lost {lost}"),) if lost else ()
        pick = picks[-1]
        state.attempts[pick] += 1
        if state.attempts[pick] >= self.limits.most_attempts:
            self._fail_place()
            return self._failed(time, f"{lost}: lost {self.limits.most_attempts} times")
        self._go_back(pick)
        return (Event(time=time, kind="lost", text=f"lost {lost}, going back for it"),)

    def _go_back(self, pick: int) -> None:
        """Repeat the tasks since a pick, except those given up since then, which move before it in the list."""
        state = self._state
        since = range(pick, state.index + 1)
        failed = [i for i in since if state.status[i] == "failed"]
        order = [*failed, *(i for i in since if i not in failed)]
        state.tasks[pick : state.index + 1] = [state.tasks[i] for i in order]
        state.attempts[pick : state.index + 1] = [state.attempts[i] for i in order]
        state.status[pick : state.index + 1] = ["failed"] * len(failed) + ["waiting"] * (len(order) - len(failed))
        state.index = pick + len(failed)
        self._activate()

    def _next_job(self, start: int) -> Task | None:
        """The first task from an index on that is not a drive."""
        return next((task for task in self._state.tasks[start:] if not isinstance(task, DriveTo)), None)


def _count(wait: tuple[int, Reason]) -> int:
    return wait[0]


def arrived(task: DriveTo, pose: Array) -> bool:
    """Test that the base is within the task's tolerance."""
    dx, dy = pose[0] - task.point[0], pose[1] - task.point[1]
    close = dx * dx + dy * dy <= task.tolerance**2
    return close and (task.heading is None or abs(wrap_angle(task.heading - pose[2])) <= HEADING_TOLERANCE)
