"""The list of tasks on a panel: what is done, what comes next, and buttons to put it in another order."""

import html
from collections.abc import Sequence
from dataclasses import dataclass

import viser
from msgspec.structs import replace

from motm_twin.bus.commands import InsertTask, MoveTask, RemoveTask
from motm_twin.bus.messages import TaskMessage, TickMessage
from motm_twin.model.scene import Pick, Place
from motm_twin.ui.hub import Hub, Shown, Visitor
from motm_twin.ui.widgets import Changing, Html, buttons

UP, DOWN, DELETE = "▲", "▼", "✕"
_SIGNS = {"done": ("✓", "#15803d"), "active": ("▶", "#1d4ed8"), "failed": ("✗", "#b91c1c")}
_WAITING = ("○", "#9ca3af")
HOW = (
    '<div class="motm-wide" style="font-size:12px;color:#6b7280;padding:0 12px 4px 12px">Click a cube, then a bin. '
    "Click the floor to send the robot there.</div>"
)


@dataclass(frozen=True)
class Job:
    """Tasks that belong together: a pick with its place and any drive between them, or one task alone."""

    text: str  # as plain text
    status: str
    first: int  # index in the list of tasks
    count: int
    attempts: int = 1
    now: int = -1  # index of the first of them that has not ended

    @property
    def ended(self) -> bool:
        """Whether nothing can be done about it any more."""
        return self.status in ("done", "failed")


def jobs(tasks: Sequence[TaskMessage]) -> list[Job]:
    """The list of tasks as jobs, in order."""
    found, index = [], 0
    while index < len(tasks):
        count = _length(tasks, index)
        group = tasks[index : index + count]
        text = " → ".join(task_name(task) + _left_out(task, group) for task in group)
        attempts = max(task.attempts for task in group)
        going = (i for i, task in enumerate(group, index) if task.status not in ("done", "failed"))
        found.append(Job(text, _status(group), index, count, attempts, next(going, index)))
        index += count
    return found


def in_hand(tick: TickMessage) -> list[TaskMessage]:
    """The tasks of a tick, of which that in hand is active, also where time stands and another was put before it."""
    if not tick.preview:
        return tick.tasks
    tasks = [replace(task, status="waiting") if task.status == "active" else task for task in tick.tasks]
    if tick.task_index < len(tasks) and tasks[tick.task_index].status == "waiting":
        tasks[tick.task_index] = replace(tasks[tick.task_index], status="active")
    return tasks


def _length(tasks: Sequence[TaskMessage], index: int) -> int:
    """How many tasks from a pick to its place; 1 for anything else."""
    if tasks[index].kind != "pick":
        return 1
    for last in range(index + 1, len(tasks)):
        if tasks[last].kind == "place":
            return last - index + 1
        if tasks[last].kind == "pick":
            break
    return 1


def _status(group: Sequence[TaskMessage]) -> str:
    """Of a delivery it is that of pick and place, whatever became of a drive between them."""
    states = [task.status for task in group if not _between(task, group)]
    if "failed" in states:
        return "failed"
    if all(state == "done" for state in states):
        return "done"
    return "active" if any(state in ("active", "done") for state in states) else "waiting"


def _between(task: TaskMessage, group: Sequence[TaskMessage]) -> bool:
    return len(group) > 1 and task.kind.startswith("drive")


def _left_out(task: TaskMessage, group: Sequence[TaskMessage]) -> str:
    return " (given up)" if task.status == "failed" and _between(task, group) else ""


def task_name(task: TaskMessage) -> str:
    """A task in a word or two."""
    return f"drive to {task.target}" if task.kind.startswith("drive") else task.target


def moved(listed: Sequence[Job], job: Job, up: bool) -> MoveTask | None:
    """The command that moves a job one place up or down; None at the end of the list."""
    number = next((i for i, other in enumerate(listed) if other.first == job.first), None)
    if number is None:
        return None
    if up:
        before = listed[number - 1] if number > 0 else None
        return None if before is None or before.ended else MoveTask(index=job.now, to=before.now)
    after = listed[number + 1] if number + 1 < len(listed) else None
    return None if after is None else MoveTask(index=job.now, to=after.first + after.count)


def ended_lines(listed: Sequence[Job]) -> str:
    """Jobs that have ended, two a row, as HTML."""
    cells = [f'<div style="overflow-wrap:anywhere">{_signed(job)}</div>' for job in listed if job.ended]
    if not cells:
        return "" if listed else '<div style="padding:0 12px;font-size:13px;color:#6b7280">no tasks yet</div>'
    return (
        '<div style="display:grid;grid-template-columns:1fr 1fr;gap:1px 10px;padding:0 12px 4px 12px;font-size:12px">'
        + "".join(cells)
        + "</div>"
    )


def _signed(job: Job) -> str:
    sign, colour = _SIGNS.get(job.status, _WAITING)
    return f'<span style="color:{colour}">{sign}</span> {html.escape(label(job)[2:])}'


def label(job: Job) -> str:
    """A job with the sign of its state, as plain text."""
    again = f" ({job.attempts}.)" if job.attempts > 1 else ""
    return f"{_SIGNS.get(job.status, _WAITING)[0]} {job.text}{again}"


def waiting_job(tasks: list[TaskMessage], cube: str) -> tuple[int, str] | None:
    """Index of a waiting pick of this cube, and the bin it is to be placed in; None when there is none."""
    for index, task in enumerate(tasks):
        if task.kind == "pick" and task.target == cube and task.status == "waiting":
            place = next((later for later in tasks[index:] if later.kind == "place"), None)
            return index, "" if place is None else place.target
    return None


class TaskBlock:
    """The list of tasks of one visitor's panel."""

    def __init__(self, gui: viser.GuiApi, hub: Hub, visitor: Visitor) -> None:
        self._gui, self._hub, self._visitor = gui, hub, visitor
        self._changing = Changing()
        self._listed: list[Job] = []
        self._open: list[Job] = []  # as the rows show them
        self._names: tuple = ()
        self._tasks: list[TaskMessage] = []
        with gui.add_folder("Tasks") as self._folder:
            self._ended = Html(gui)
            self._rows_at = gui.add_folder(None)
            self._rows: list[viser.GuiButtonGroupHandle] = []
            gui.add_html(HOW)
            with gui.add_folder("Add by name", expand_by_default=False):
                self._cube: viser.GuiDropdownHandle[str] = self._changing(gui.add_dropdown("Cube", ("",)))
                self._bin: viser.GuiDropdownHandle[str] = self._changing(gui.add_dropdown("Into bin", ("",)))
                self._add = self._changing(gui.add_button("Add to the tasks", icon=viser.Icon.PLUS))
        self._add.on_click(hub.driving(lambda *_: self._insert()))

    def enable(self, driving: bool) -> None:
        """Grey while somebody else drives."""
        self._changing.enable(driving)

    def update(self, shown: Shown) -> None:
        """Show this."""
        self._tasks = shown.newest.tasks if shown.newest is not None else []
        if shown.tick is not None:
            self._show(jobs(in_hand(shown.tick)))
        if shown.scene is not None:
            names = (tuple(o.name for o in shown.scene.objects), tuple(box.name for box in shown.scene.bins))
            if names != self._names:
                self._names = names
                self._cube.options, self._bin.options = names[0] or ("",), names[1] or ("",)

    def _show(self, listed: list[Job]) -> None:
        if listed == self._listed:
            return
        self._listed = listed
        self._ended.set(ended_lines(listed))
        self._open = [job for job in listed if not job.ended]
        while len(self._rows) < len(self._open):
            self._rows.append(self._row(len(self._rows)))
        for number, row in enumerate(self._rows):
            row.visible = number < len(self._open)
            if row.visible:
                row.label = label(self._open[number])

    def _row(self, number: int) -> viser.GuiButtonGroupHandle:
        with self._rows_at:
            act = self._hub.driving(lambda event, _: self._act(number, event.target.value))
            hint = "do it earlier, later, or not at all"
            return self._changing(buttons(self._gui, (UP, DOWN, DELETE), act, label="-", hint=hint))

    def _act(self, number: int, what: str) -> None:
        if number >= len(self._open) or not self._hub.live(self._visitor):
            return
        job = self._open[number]
        command = RemoveTask(index=job.now) if what == DELETE else moved(self._listed, job, what == UP)
        if command is None:
            end = "first that is left" if what == UP else "last"
            self._hub.tell(self._visitor, f"{job.text} is the {end} already", "Task")
        else:
            self._hub.send(self._visitor, command)

    def _insert(self) -> None:
        if self._cube.value and self._bin.value and self._hub.live(self._visitor):
            self._deliver(self._cube.value, self._bin.value)

    def _deliver(self, cube: str, box: str) -> None:
        """At the end of the list; a cube that waits in it already goes to this bin instead."""
        index, planned = None, waiting_job(self._tasks, cube)
        if planned is not None:
            index, before = planned
            if before == box:
                self._hub.tell(self._visitor, f"{cube} goes to {box} already", "Task")
                return
            self._hub.send(self._visitor, RemoveTask(index=index))
        self._hub.send(self._visitor, InsertTask(tasks=(Pick(object=cube), Place(bin=box)), index=index))
