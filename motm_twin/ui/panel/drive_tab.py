"""The Drive tab: the list of tasks, camera, scene and method. Play, step and speed are below the scene."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import viser
from msgspec.structs import replace

from motm_twin.bus.commands import Load, MoveTask, Pause, Play, RemoveTask, Speed
from motm_twin.bus.messages import MethodChoice, SceneChoice, StatusMessage, TaskMessage, TickMessage
from motm_twin.methods import DEFAULT_METHOD
from motm_twin.ui.hub import Hub, Shown, Visitor
from motm_twin.ui.panel.explain import method_title
from motm_twin.ui.panel.numbers import progress
from motm_twin.ui.panel.why_tab import now_card
from motm_twin.ui.panel.widgets import BLUE, GREEN, RED, Block, note, text
from motm_twin.ui.scene.cameras import PRESETS
from motm_twin.ui.scene.picking import delivery
from motm_twin.ui.scene.scene_view import SceneView

SPEEDS = {"1/8": 0.125, "1/4": 0.25, "1/2": 0.5, "1x": 1.0, "2x": 2.0, "4x": 4.0, "8x": 8.0}
UP, DOWN, DELETE = "▲", "▼", "✕"
ROWS = 12  # rows for jobs that have not ended: a hundred make a browser slow
_SIGNS = {"done": ("✓", GREEN), "active": ("▶", BLUE), "failed": ("✗", RED)}
_HOW = "Click a cube, then a bin. Double-click the floor to send the robot there."


class DriveTab(Block):
    """Widgets that drive the twin."""

    def __init__(
        self, gui: viser.GuiApi, hub: Hub, visitor: Visitor, scene: SceneView, help_: Callable[[], object]
    ) -> None:
        super().__init__(gui, hub, visitor)
        self._choices: list[SceneChoice] = []
        self._methods: list[MethodChoice] = []
        self._loaded: tuple = ()  # scene, variant, seed and method
        self._filled: tuple = ("", "", 0, "")  # the same, as last filled in here or loaded by a press of Load
        self._speed = self._told_speed = 1.0  # requested by this visitor; reported by the twin
        self.parts = [TaskBlock(gui, hub, visitor)]
        hint = "the camera; keys 1 to 5"
        self.row(PRESETS, lambda preset: scene.cameras.choose(visitor.client, preset), anybody=True, hint=hint)
        with gui.add_folder("Scene", expand_by_default=False):
            self._scene = self.choice("Scene", ("",), lambda _: self._offer_variants())
            self._variant = self.choice("Variant", ("",))
            self._seed = self.driven(gui.add_number("Seed", 0, min=0, max=2**31 - 1, step=1))
            hint = "decides how the base drives and how the arm moves"
            self._method = self.choice("Method", ("",), hint=hint)
            self._about = gui.add_html("")
            self.button("Load", self._load_scene, icon=viser.Icon.REFRESH)
        self.row(("?  How to drive",), lambda _: help_(), anybody=True, hint="H: all keys")
        self._progress = gui.add_html("")  # at the end, because its height changes

    def enable(self, driving: bool) -> None:
        """Disable while somebody else drives; a choice that was not loaded is then dropped."""
        if not driving:
            self._filled, self._loaded = self._chosen(), ()
        super().enable(driving)

    def _refresh(self, shown: Shown) -> None:
        if shown.status is not None:
            self._show_status(shown.status)
        if shown.tick is not None:
            of = shown.tick, shown.scene, shown.status
            self._progress.content = now_card(*of) + progress(shown.tick, shown.status, shown.scene)

    def toggle(self) -> None:
        """Play or pause; a key press meant to pause does not restart a run that has just ended."""
        if self._state() == "done":
            self.tell("the run has ended: press play below the scene to start it again, or give the robot another task")
        else:
            self.press()

    def faster(self, steps: int) -> None:
        """Request a higher or lower speed."""
        factors = list(SPEEDS.values())
        number = factors.index(self._speed) + steps
        if 0 <= number < len(factors):
            self._speed = factors[number]  # now, so that the next press counts from here
            self.send(Speed(factor=factors[number]))

    def press(self) -> None:
        """Play or pause, or begin again after the end."""
        self.send(Pause() if self._state() == "playing" else Play())

    def _state(self) -> str:
        """State of the twin, newer than the panel when its status is known."""
        newest = self.hub.client.status() or self.shown
        return "" if newest is None else newest.state

    def _show_status(self, status: StatusMessage) -> None:
        choosing = self._chosen() != self._filled  # a late status of an earlier load must not undo a person's choice
        if status.scenes != self._choices:
            self._choices = status.scenes
            self._scene.options = tuple(choice.name for choice in status.scenes) or ("",)
        if status.methods != self._methods:
            self._methods = status.methods
            self._method.options = tuple(method_title(status, choice.name) for choice in status.methods) or ("",)
        loaded = (status.scene, status.variant, status.seed, status.method)
        if loaded != self._loaded and status.scene in self._scene.options:
            self._loaded = loaded
            if not choosing:
                self._fill(status)
        method = self._chosen_method()
        self._about.content = "" if method is None else note(text(method.summary))
        if status.speed in SPEEDS.values() and status.speed != self._told_speed:
            self._told_speed = self._speed = status.speed

    def _fill(self, status: StatusMessage) -> None:
        self._scene.value = status.scene
        self._offer_variants()
        if status.variant in self._variant.options:
            self._variant.value = status.variant
        self._seed.value = status.seed
        title = method_title(status, status.method)
        if title in self._method.options:
            self._method.value = title
        self._filled = self._chosen()

    def _chosen(self) -> tuple:
        return self._scene.value, self._variant.value, self._seed.value, self._method.value

    def _offer_variants(self) -> None:
        chosen = next((choice for choice in self._choices if choice.name == self._scene.value), None)
        self._variant.options = tuple(chosen.variants) if chosen and chosen.variants else ("",)

    def _chosen_method(self) -> MethodChoice | None:
        place = self._method.options.index(self._method.value)
        return self._methods[place] if place < len(self._methods) else None

    def _load_scene(self) -> None:
        self._seed.value = int(self._seed.value)  # only the whole part of a fraction counts
        self._filled = self._chosen()
        variant, chosen = self._variant.value or None, self._chosen_method()
        method = DEFAULT_METHOD if chosen is None else chosen.name
        self.send(Load(scene=self._scene.value, variant=variant, seed=int(self._seed.value), method=method))


@dataclass(frozen=True)
class Job:
    """Tasks that belong together: a pick with its place and any drive between them, or one task alone."""

    text: str  # as plain text
    status: str
    first: int  # index in the list of tasks
    count: int
    attempts: int = 1
    now: int = -1  # index of its first task that has not ended

    @property
    def ended(self) -> bool:
        """True when the job has ended."""
        return self.status in ("done", "failed")


def jobs(tasks: Sequence[TaskMessage]) -> list[Job]:
    """The list of tasks as jobs, in order."""
    found, index = [], 0
    while index < len(tasks):
        count = _length(tasks, index)
        group = tasks[index : index + count]
        name = " → ".join(_task_name(task, group) for task in group)
        attempts = max(task.attempts for task in group)
        going = (i for i, task in enumerate(group, index) if task.status not in ("done", "failed"))
        found.append(Job(name, _status(group), index, count, attempts, next(going, index)))
        index += count
    return found


def in_hand(tick: TickMessage) -> list[TaskMessage]:
    """The tasks of a tick with the current one active, even while paused with another inserted before it."""
    if not tick.preview:
        return tick.tasks
    tasks = [replace(task, status="waiting") if task.status == "active" else task for task in tick.tasks]
    if tick.task_index < len(tasks) and tasks[tick.task_index].status == "waiting":
        tasks[tick.task_index] = replace(tasks[tick.task_index], status="active")
    return tasks


def _length(tasks: Sequence[TaskMessage], index: int) -> int:
    """Number of tasks from a pick to its place; 1 for anything else."""
    after = ((count, task.kind) for count, task in enumerate(tasks[index + 1 :], 2) if task.kind in ("pick", "place"))
    count, kind = next(after, (1, ""))
    return count if tasks[index].kind == "pick" and kind == "place" else 1


def _status(group: Sequence[TaskMessage]) -> str:
    """Status of a job; that of a delivery ignores drives between pick and place."""
    states = [task.status for task in group if not _between(task, group)]
    if "failed" in states:
        return "failed"
    if all(state == "done" for state in states):
        return "done"
    return "active" if any(state in ("active", "done") for state in states) else "waiting"


def _between(task: TaskMessage, group: Sequence[TaskMessage]) -> bool:
    return len(group) > 1 and task.kind.startswith("drive")


def _task_name(task: TaskMessage, group: Sequence[TaskMessage]) -> str:
    """A task in a word or two; a failed drive within a delivery is marked as given up."""
    name = f"drive to {task.target}" if task.kind.startswith("drive") else task.target
    return f"{name} (given up)" if task.status == "failed" and _between(task, group) else name


def moved(listed: Sequence[Job], job: Job, up: bool) -> MoveTask | None:
    """The command that moves a job one place up or down; None when it cannot move further."""
    number = next((i for i, other in enumerate(listed) if other.first == job.first), None)
    if number is None:
        return None
    neighbour = (listed[:number][-1:] if up else listed[number + 1 : number + 2]) or [job]
    other = neighbour[0]
    if other is job or (up and other.ended):
        return None
    return MoveTask(index=job.now, to=other.now if up else other.first + other.count)


def ended_lines(listed: Sequence[Job]) -> str:
    """Jobs that have ended, two per row, as HTML."""
    cells = ""
    for job in (job for job in listed if job.ended):
        sign, colour = _SIGNS[job.status]
        cells += f'<div><span style="color:{colour}">{sign}</span> {text(label(job)[2:])}</div>'
    if not cells:
        return "" if listed else note("no tasks yet")
    return note(f'<div class="two">{cells}</div>', "inherit")


def label(job: Job) -> str:
    """A job with the sign of its state, as plain text."""
    again = f" (try {job.attempts})" if job.attempts > 1 else ""
    return f"{_SIGNS.get(job.status, '○')[0]} {job.text}{again}"


class TaskBlock(Block):
    """The task list: done, current and next tasks, and buttons to reorder them."""

    def __init__(self, gui: viser.GuiApi, hub: Hub, visitor: Visitor) -> None:
        super().__init__(gui, hub, visitor)
        self._listed: list[Job] = []
        self._open: list[Job] = []  # as the rows show them
        self._names: tuple = ()
        with gui.add_folder("Tasks"):
            self._ended = gui.add_html("")
            self._rows_at = gui.add_folder(None)
            self._rows: list[viser.GuiButtonGroupHandle] = []
            self._more = gui.add_html("")
            gui.add_html(f'<div class="motm-wide">{note(_HOW)}</div>')
            with gui.add_folder("Add by name", expand_by_default=False):
                self._cube, self._bin = self.choice("Cube", ("",)), self.choice("Into bin", ("",))
                self.button("Add to the tasks", self._insert, icon=viser.Icon.PLUS)

    def _refresh(self, shown: Shown) -> None:
        if shown.tick is not None:
            self._show(jobs(in_hand(shown.tick)))
        if shown.scene is not None:
            names = (tuple(item.name for item in shown.scene.objects), tuple(box.name for box in shown.scene.bins))
            if names != self._names:
                self._names = names
                self._cube.options, self._bin.options = names[0] or ("",), names[1] or ("",)

    def _show(self, listed: list[Job]) -> None:
        if listed == self._listed:
            return
        self._listed = listed
        self._ended.content = ended_lines(listed)
        self._open = [job for job in listed if not job.ended]
        more = len(self._open) - ROWS
        self._more.content = note(f"and {more} more") if more > 0 else ""
        for number in range(len(self._rows), min(len(self._open), ROWS)):
            with self._rows_at:
                hint = "do it earlier, later, or not at all"
                self._rows.append(self.row((UP, DOWN, DELETE), partial(self._act, number), label="-", hint=hint))
        for number, row in enumerate(self._rows):
            row.visible = number < len(self._open)
            if row.visible:
                row.label = label(self._open[number])

    def _act(self, number: int, what: str) -> None:
        if number >= len(self._open) or not self.hub.live(self.visitor):
            return
        job = self._open[number]
        command = RemoveTask(index=job.now) if what == DELETE else moved(self._listed, job, what == UP)
        if command is None:
            end = "first that is left" if what == UP else "last"
            self.tell(f"{job.text} is the {end} already", "Task")
        else:
            self.send(command)

    def _insert(self) -> None:
        cube, box, newest = self._cube.value, self._bin.value, None if self.shown is None else self.shown.newest
        if not (cube and box and self.hub.live(self.visitor)):
            return
        commands = delivery([] if newest is None else newest.tasks, cube, box)
        for command in commands:
            self.send(command)
        if not commands:
            self.tell(f"{cube} goes to {box} already", "Task")
