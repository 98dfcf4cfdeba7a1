"""Edits of the task list while it is worked through: which tasks may be inserted, removed or moved, and where to.

Tasks that have ended stay. A pick and its place belong together, with any drive between them. The task that the arm is
at work on (final approach to lift, release) is finished first: a task put before it comes after it instead.
"""

import math
from collections.abc import Collection
from dataclasses import dataclass, replace
from typing import cast

from motm_twin.model.edits import InsertTask, MoveTask, RemoveTask, TaskEdit
from motm_twin.model.known import KnownWorld
from motm_twin.model.names import hint
from motm_twin.model.scene import DriveTo, Pick, Place, Task
from motm_twin.model.scene_format import MOST_TASKS

TOLERANCE = (0.05, 2.0)  # [m] of a drive_to


@dataclass(frozen=True)
class TaskList:
    """The list, the index of the active task, and the object in the gripper."""

    tasks: tuple[Task, ...]
    status: tuple[str, ...]
    attempts: tuple[int, ...]
    index: int  # of the active task
    held: str


def edited(now: TaskList, edit: TaskEdit, known: KnownWorld, *, engaged: bool) -> TaskList:
    """The list after an edit; ``engaged``: the arm is at work on the active task.

    Raises ValueError, which says what to do instead, when the robot could not work through the new list.
    """
    if isinstance(edit, InsertTask):
        return _inserted(now, edit, known, engaged=engaged)
    if isinstance(edit, RemoveTask):
        return _removed(now, edit.index, engaged=engaged)
    return _moved(now, edit, engaged=engaged)


def kind_of(task: Task) -> str:
    """Name of the kind of a task, as in scene files."""
    return str(task.__struct_config__.tag)


def name_of(task: Task) -> str:
    """Subject of a task: object, bin or point."""
    if isinstance(task, Pick):
        return task.object
    if isinstance(task, Place):
        return task.bin
    return f"({task.point[0]:.2f}, {task.point[1]:.2f})"


def titled(task: Task) -> str:
    """A task in words: "pick cube_F3", "place in drop1", "drive to (1.00, 2.00)"."""
    return {"pick": "pick ", "place": "place in ", "drive_to": "drive to "}[kind_of(task)] + name_of(task)


def homeless(tasks: tuple[Task, ...], index: int, held: str) -> bool:
    """Test that the gripper holds an object, and the next task that is not a drive does not place it."""
    if not held:
        return False
    following = next((task for task in tasks[index:] if not isinstance(task, DriveTo)), None)
    return not isinstance(following, Place)


def _inserted(now: TaskList, edit: InsertTask, known: KnownWorld, *, engaged: bool) -> TaskList:
    if not edit.tasks:
        raise ValueError("no task to insert: give at least one")
    left = len(now.tasks) - now.index
    if left + len(edit.tasks) > MOST_TASKS:
        raise ValueError(f"{left} tasks are still to do, and may be {MOST_TASKS}: remove some first")
    for task in edit.tasks:
        if not (known.robot.has_arm or isinstance(task, DriveTo)):
            raise ValueError(f"{titled(task)}: the robot has no arm, it can only drive")
        _check_task(task, known)
    at = _open_place(now, len(now.tasks) if edit.index is None else edit.index)
    if engaged and at == now.index < len(now.tasks):
        only_drives = all(isinstance(task, DriveTo) for task in edit.tasks)
        at = now.index + 1 if only_drives else _job(now, now.index)[-1] + 1
    count = len(edit.tasks)
    after = replace(
        now,
        tasks=(*now.tasks[:at], *edit.tasks, *now.tasks[at:]),
        status=(*now.status[:at], *("waiting",) * count, *now.status[at:]),
        attempts=(*now.attempts[:at], *(0,) * count, *now.attempts[at:]),
    )
    if not (homeless(now.tasks, now.index, now.held) and all(isinstance(task, DriveTo) for task in edit.tasks)):
        _check_order(after)
    return after


def _removed(now: TaskList, index: int, *, engaged: bool) -> TaskList:
    _check_waiting(now, index, "removed", engaged=engaged)
    job = _job(now, index)
    ends = {job[0], job[-1]}  # drives between a pick and its place stay
    keep = [i for i in range(len(now.tasks)) if i not in ends]
    return _picked(now, keep)


def _moved(now: TaskList, edit: MoveTask, *, engaged: bool) -> TaskList:
    _check_waiting(now, edit.index, "moved", engaged=engaged)
    job, to = _job(now, edit.index), _open_place(now, edit.to)
    if engaged and to == now.index:
        to = _job(now, now.index)[-1] + 1
    if job[0] <= to <= job[-1] + 1:
        return now
    rest = [i for i in range(len(now.tasks)) if i not in job]
    cut = sum(i < to for i in rest)
    after = _picked(now, [*rest[:cut], *job, *rest[cut:]])
    _check_order(after)
    return after


def _picked(now: TaskList, order: list[int]) -> TaskList:
    return replace(
        now,
        tasks=tuple(now.tasks[i] for i in order),
        status=tuple(now.status[i] for i in order),
        attempts=tuple(now.attempts[i] for i in order),
    )


def _job(now: TaskList, index: int) -> range:
    """Indices of the tasks that belong to one: from a pick that is still to be done to its place; a drive is alone."""
    task = now.tasks[index]
    if isinstance(task, Pick):
        places = [i for i in range(index, len(now.tasks)) if isinstance(now.tasks[i], Place)]
        return range(index, places[0] + 1 if places else index + 1)
    if isinstance(task, Place):
        picks = [i for i in range(now.index, index) if isinstance(now.tasks[i], Pick)]
        return range(picks[-1] if picks else index, index + 1)
    return range(index, index + 1)


def _open_place(now: TaskList, at: int) -> int:
    """Check that a task can be put before an index; returns the index."""
    if not 0 <= at <= len(now.tasks):
        raise ValueError(f"there are {len(now.tasks)} tasks: an index is 0 to {len(now.tasks)}, not {at}")
    if at < now.index:
        raise ValueError(f"'{titled(now.tasks[at])}' has ended: put the task at index {now.index} or later")
    return at


def _check_waiting(now: TaskList, index: int, what: str, *, engaged: bool) -> None:
    if not 0 <= index < len(now.tasks):
        raise ValueError(f"there is no task {index}: the list has {len(now.tasks)}, counted from 0")
    task = now.tasks[index]
    if index < now.index:
        raise ValueError(f"'{titled(task)}' has ended and cannot be {what}")
    if engaged and now.index in _job(now, index):
        active = titled(now.tasks[now.index])
        raise ValueError(f"'{titled(task)}' cannot be {what} now: the arm is at work on '{active}'; wait until it ends")


def _check_order(now: TaskList) -> None:
    """Raise ValueError unless the tasks still to be done alternate between picks and places."""
    carried, open_pick = now.held, ""
    picked: set[str] = set()
    for task in now.tasks[now.index :]:
        if isinstance(task, Pick):
            if carried:
                raise ValueError(f"'{titled(task)}' would come while {carried} is held: put it after the place task")
            if task.object == now.held:
                raise ValueError(
                    f"{task.object} is in the gripper already: put it into another bin instead of picking it"
                )
            if task.object in picked:
                raise ValueError(f"{task.object} is picked by another task of the list already: remove that one first")
            carried = open_pick = task.object
            picked.add(task.object)
        elif isinstance(task, Place):
            if not carried:
                raise ValueError(f"'{titled(task)}' would come with nothing held: put a pick together with its place")
            carried = open_pick = ""
    if open_pick:
        raise ValueError(f"'pick {open_pick}' has no place: put both into the list together")


def _check_task(task: Task, known: KnownWorld) -> None:
    if isinstance(task, Pick):
        _check_name(task.object, [item.name for item in known.objects], "object")
    elif isinstance(task, Place):
        _check_name(task.bin, [item.name for item in known.bins], "bin")
    else:
        _check_drive(cast(DriveTo, task), known.bounds)


def _check_name(name: str, names: Collection[str], kind: str) -> None:
    if name not in names:
        raise ValueError(f"there is no {kind} {name!r}; {hint(name, sorted(names))}")


def _check_drive(task: DriveTo, bounds: tuple[float, float, float, float]) -> None:
    numbers = (*task.point, task.tolerance, 0.0 if task.heading is None else task.heading)
    if not all(math.isfinite(value) for value in numbers):
        raise ValueError(f"{titled(task)}: point, heading and tolerance must be finite numbers")
    x_min, y_min, x_max, y_max = bounds
    if not (x_min <= task.point[0] <= x_max and y_min <= task.point[1] <= y_max):
        raise ValueError(
            f"{titled(task)} is outside the map: x {x_min:.2f} to {x_max:.2f} m, y {y_min:.2f} to {y_max:.2f} m"
        )
    if not TOLERANCE[0] <= task.tolerance <= TOLERANCE[1]:
        raise ValueError(f"{titled(task)}: tolerance {task.tolerance:g} m; use {TOLERANCE[0]:g} to {TOLERANCE[1]:g} m")
