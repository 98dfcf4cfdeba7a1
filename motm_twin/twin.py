"""The twin: one scene with its plant and control loop, and everything needed to copy and rerun it."""

import math
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from motm_twin.control.announcements import Announcements, check_announce
from motm_twin.control.arm.controller import Manipulator, NoArm
from motm_twin.control.arm.parameters import ArmParameters
from motm_twin.control.loop import ControlLoop, Settings
from motm_twin.control.method import ArmParts, Method, PlannerParts, Rehearsed, Timed
from motm_twin.control.parameters import Parameters
from motm_twin.control.targets import world_in_odometry
from motm_twin.control.task_list import TaskList, edited
from motm_twin.control.tick import Tick
from motm_twin.control.tuning import check, parameter, tuned
from motm_twin.dry_run import dry_run
from motm_twin.methods.registry import FAST
from motm_twin.model.edits import (
    Announce,
    Drive,
    Edit,
    InsertTask,
    MoveBody,
    MoveObject,
    ParameterValue,
    ReleaseBody,
    SetParameter,
    TaskEdit,
    WorldEdit,
)
from motm_twin.model.exact import norm
from motm_twin.model.geometry import Array, from_frame
from motm_twin.model.known import KnownWorld
from motm_twin.model.plant import PERIOD, ExternalPlant, TwinPlant, WorldRehearsal
from motm_twin.model.scene import Pick, PlanarPose, Scene
from motm_twin.model.state import HasState, state_hash
from motm_twin.planning.global_path import GraphCache
from motm_twin.planning.parameters import PlanningParameters
from motm_twin.planning.planner import BasePlanner
from motm_twin.planning.types import SearchBudget
from motm_twin.plants import make_plant
from motm_twin.sessions.session import Cut, LoggedEdit, Session, made_with, plain

POINTED_AT = 0.15  # [m] error of a believed position above which adding the object to the task list corrects it


class Twin:
    """A running scene: `advance` runs one control period; `post` queues an edit for the start of the next one."""

    def __init__(
        self,
        scene: Scene,
        *,
        method: Method = FAST,
        parameters: dict[str, ParameterValue] | None = None,
        budget: SearchBudget | None = None,
        numbers: Parameters | None = None,
        clock: Callable[[], float] | None = None,
        plant: ExternalPlant | None = None,
    ) -> None:
        """Set up a scene at its start.

        Args:
            scene: From `load_scene`.
            method: From `methods.find`.
            parameters: Values by name (`control.tuning`), on top of the method's and of ``numbers``.
            budget: Limits of a search of the base: expansions, and seconds of ``clock``.
            numbers: All parameters as one tree.
            clock: [s] Bounds the searches when the budget has seconds, and measures the stages of a period.
            plant: A robot in another program instead of the simulated one; such a run cannot be copied or rerun.

        Raises:
            ValueError: A parameter is unknown or out of range.
        """
        self.scene, self.method = scene, method
        start = {**method.parameters, **(parameters or {})}
        self._start = {name: check(name, value) for name, value in start.items()}
        self._start = {name: value for name, value in self._start.items() if value != parameter(name).default}
        self._given = numbers is not None
        self._numbers = numbers or Parameters()
        self._budget = budget or SearchBudget()
        self._clock = clock
        self._queue: list[Edit] = []
        self._external = plant
        self.reset()

    def reset(self) -> None:
        """Go back to the start of the scene and to its initial parameters; queued edits are dropped."""
        if self._external is not None:
            self._external.begin(self.scene)
        self.plant: TwinPlant = self._external or make_plant(self.scene)
        self._announcements = Announcements(self.scene, self._start)
        self.edits: list[LoggedEdit] = []
        self.cuts: list[Cut] = []
        self.refused: list[str] = []  # accepted edits that an external robot refused in the last period
        self._broken: int | None = None  # index of the period that raised
        self._build()
        self._forget_queue()

    @property
    def done(self) -> bool:
        """True when all tasks have ended."""
        return self.loop.sequence.done

    @property
    def external(self) -> ExternalPlant | None:
        """The robot in another program; None for the simulated one."""
        return self._external

    @property
    def index(self) -> int:
        """Number of the next period."""
        return self.loop.index

    @property
    def parameters(self) -> dict[str, ParameterValue]:
        """Parameters of `control.tuning` that now differ from their defaults."""
        return self._announcements.parameters

    @property
    def next_parameters(self) -> dict[str, ParameterValue]:
        """`parameters` after the queued edits."""
        announced = Announcements(self.scene, self.parameters)
        for edit in self._queue:
            if isinstance(edit, SetParameter):
                self._set_parameter(announced, edit)
        return announced.parameters

    @property
    def announced(self) -> dict[str, PlanarPose]:
        """Poses of announced pieces of furniture by name: reference point x, y [m], turn [rad]."""
        return self._announcements.map[0]

    def post(self, edit: Edit) -> None:
        """Queue an edit for the next period. Raises ValueError if it is not possible; then nothing changes."""
        edit = plain(edit)
        if isinstance(edit, WorldEdit):
            self._rehearsal = self._rehearsal or self.plant.rehearsal()
            self._rehearsal.accept(edit)
        elif isinstance(edit, SetParameter):
            if edit.value is None:
                parameter(edit.name)
            else:
                check(edit.name, edit.value)
        elif isinstance(edit, Announce):
            check_announce(self.scene, edit.name)
            if self.plant.truth() is None:
                raise ValueError("this robot does not tell where furniture stands: its map stays as the scene has it")
        elif isinstance(edit, Drive):
            self._check_twist(edit)
        else:
            self._check_tasks(edit)
        self._queue.append(edit)

    def advance(self, budget: SearchBudget | None = None) -> Tick:
        """Apply queued edits, run one period, and return its Tick; ``budget`` repeats a search that the clock had cut.

        After a period that raised, the world is between two periods: only `reset` and `restore` are possible.
        """
        if self._broken is not None:
            raise RuntimeError(f"period {self._broken} has broken off: reset the twin, or restore a snapshot")
        edits = self._forget_queue()
        index, logged = self.loop.index, len(self.edits)
        try:
            tick = self._period(edits, budget)
        except BaseException:
            del self.edits[logged:]  # the log only has edits of whole periods
            self._broken = index
            raise
        if tick.plan.cut_by_clock:
            self.cuts.append(Cut(index=index, expansions=tick.plan.expansions))
        elif (used := budget or self._budget).expansions != SearchBudget().expansions:
            self.cuts.append(Cut(index=index, expansions=used.expansions))
        return tick

    def ticks(self) -> Iterator[Tick]:
        """Every period to the end of the task list, or to the time limit of the scene."""
        while True:
            tick = self.advance()
            yield tick
            if tick.done or tick.time >= self.scene.time_limit:
                return

    def _period(self, edits: tuple[Edit, ...], budget: SearchBudget | None) -> Tick:
        index, before = self.loop.index, self.parameters
        restarted = self._external is not None and self._external.interrupted()
        applied: list[Edit] = []
        self.refused = []
        for edit in edits:
            if self._apply_or_refuse(edit):
                self.edits.append(LoggedEdit(index=index, edit=edit))
                applied.append(edit)
        if self.parameters != before:
            self._retune()
        if self._announcements.lag != self.loop.response.lag:
            self._announcements.lag = self.loop.response.lag
            self._rebuild()
        return self.loop.period(tuple(applied), budget, restarted=restarted)

    def _apply_or_refuse(self, edit: Edit) -> bool:
        """Apply an edit; False when an external robot refuses it, whose world has changed since the edit was posted."""
        if self._external is None:
            self._apply(edit)
            return True
        try:
            self._apply(edit)
        except ValueError as error:
            what = f"{edit.__struct_config__.tag} {getattr(edit, 'name', '')}".rstrip()
            self.refused.append(f"the robot has refused {what}: {error}")
            return False
        return True

    def session(self, title: str = "") -> Session:
        """The run so far as a session; raises ValueError with an external robot or with given ``numbers``.

        After a failed period the session has the run until then, without a state hash: that state is lost.
        """
        if self._external is not None:
            raise ValueError("a robot in another program does not do the same again: record the run instead")
        if self._given:
            raise ValueError("a session keeps named parameters only: build the twin with parameters={...}")
        whole = self._broken is None
        return Session(
            title=title if whole else f"{title} (until period {self._broken}, which broke off: no state hash)".lstrip(),
            made_with=made_with(physics=self.scene.physics is not None),
            scene=self.scene,
            method=self.method.name,
            parameters=dict(self._start),
            edits=tuple(self.edits),
            cuts=tuple(self.cuts),
            periods=self.loop.index if self._broken is None else self._broken,
            state_hash=self.state_hash() if whole else "",
        )

    def candidate_paths(self, index: int) -> tuple[Array, Array] | None:
        """Paths [m], (m, 2), behind a candidate's costs in the last Tick: to the candidate, and on to the next target.

        None for a rejected candidate or an unknown index; the second path is empty without a next target.
        """
        return self.loop.planner.candidate_paths(index)

    def staa_path(self) -> Array:
        """Global path [m] of unmodified STAA* to the goal of the last Tick, shape (m, 2); empty without a goal."""
        return self.loop.planner.staa_path()

    def parts(self) -> dict[str, HasState]:
        """All parts with state, by name; an external robot keeps its own state."""
        if not isinstance(self.plant, HasState):
            return {"announcements": self._announcements, **self.loop.parts()}
        return {"plant": self.plant, "announcements": self._announcements, **self.loop.parts()}

    def snapshot(self) -> dict[str, Any]:
        """A copy of the whole state with random generators and the log of edits, without queued edits."""
        state = {name: part.snapshot() for name, part in self.parts().items()}
        # The lists only grow: a list and its length are enough, and the snapshots of a run share the lists.
        log = tuple((entries, len(entries)) for entries in (self.edits, self.cuts))
        return {**state, "log": log, "broken": self._broken}

    def restore(self, state: dict[str, Any]) -> None:
        """Continue from a snapshot of the same scene; queued edits are forgotten."""
        if self._external is not None:
            raise ValueError("a robot in another program can not go back in time")
        known, parameters = (self._announcements.map, self._announcements.lag), self.parameters
        self._announcements.restore(state["announcements"])
        if (self._announcements.map, self._announcements.lag) != known or self._broken is not None:
            self._build()
        elif self.parameters != parameters:
            self._retune()
        for name, part in self.parts().items():
            part.restore(state[name])
        self.edits, self.cuts = (entries[:count] for entries, count in state["log"])  # copies: snapshots share them
        self._broken = state["broken"]
        self._forget_queue()

    def state_hash(self) -> str:
        """SHA-256 over the whole state: equal for equal runs."""
        return state_hash({name: part.snapshot() for name, part in self.parts().items()})

    def _build(self) -> None:
        """Build the control loop at its start from the current announcements and parameters."""
        known = self._announcements.known()
        numbers = self._tuned()
        self.loop = ControlLoop(
            known,
            self.plant,
            self._planner(known, numbers.planning),
            self._arm_side(known, numbers.arm),
            settings=Settings(budget=self._budget, parameters=numbers),
            profile=self.scene.robot,
            truth=self.plant.truth,
            clock=self._clock or (lambda: 0.0),
        )

    def _tuned(self) -> Parameters:
        """All parameters with their current values."""
        return tuned(self.parameters, self._numbers)

    def _rebuild(self) -> None:
        """Build a control loop from the robot's current knowledge and carry over the state of the old one."""
        old = self.loop
        self._build()
        for part, state in old.parts().items():
            self.loop.parts()[part].restore(state.snapshot())
        self.loop.mapper.adopt(old.mapper.snapshot())
        self.loop.self_check.adopt(old.self_check.snapshot())

    def _planner(
        self, known: KnownWorld, planning: PlanningParameters, graphs: GraphCache | None = None
    ) -> BasePlanner:
        parts = PlannerParts(
            known=known, parameters=planning, tracks=self._tuned().tracks, clock=self._search_clock(), graphs=graphs,
            rehearse=self._rehearse,
        )  # fmt: skip
        return self.method.planner(parts)

    def _arm_side(self, known: KnownWorld, arm: ArmParameters) -> Manipulator:
        if not known.robot.has_arm:
            return NoArm(known, arm)
        return self.method.arm(ArmParts(known=known, parameters=arm, rehearse=self._rehearse))

    def _rehearse(self, edits: Timed) -> Rehearsed:
        """Dry run of the task from its start, with the robot's current knowledge and parameters."""
        return dry_run(Twin, self._announcements.known(), self._tuned(), edits)

    def _search_clock(self) -> Callable[[], float] | None:
        return self._clock if self._budget.seconds is not None else None

    def _retune(self) -> None:
        """Give all parts the current parameters and keep their states, which hold no parameters."""
        numbers = self._tuned()
        loop, planner, manipulator = self.loop, self.loop.planner, self.loop.manipulator
        if numbers.planning != planner.parameters:
            loop.planner = self._planner(loop.known, numbers.planning, planner.graphs)
            loop.planner.restore(planner.snapshot())
        if numbers.arm != manipulator.parameters:
            loop.manipulator = self._arm_side(loop.known, numbers.arm)
            loop.manipulator.restore(manipulator.snapshot())
        loop.retune(numbers)

    def _apply(self, edit: Edit) -> None:
        if isinstance(edit, WorldEdit):
            self.plant.apply(edit)
        elif isinstance(edit, SetParameter):
            self._set_parameter(self._announcements, edit)
        elif isinstance(edit, Announce):
            self._announce(edit.name)
        elif isinstance(edit, Drive):
            self.loop.by_hand.take(edit)
        else:
            if isinstance(edit, InsertTask):
                self._correct_beliefs([task.object for task in edit.tasks if isinstance(task, Pick)])
            self.loop.edit_tasks(edit)
            self.plant.expect_tasks(self.loop.sequence.tasks)

    def _set_parameter(self, announced: Announcements, edit: SetParameter) -> None:
        """Set a parameter in ``announced``; an edit without a value restores that of the start."""
        default = parameter(edit.name).default
        value = self._start.get(edit.name, default) if edit.value is None else check(edit.name, edit.value)
        announced.set_parameter(edit.name, value, default)

    def _forget_queue(self) -> tuple[Edit, ...]:
        """Empty the queue and return its edits; results of checking them in advance are dropped."""
        edits = tuple(self._queue)
        self._queue = []
        self._rehearsal: WorldRehearsal | None = None  # of queued world edits
        self._listed: TaskList | None = None  # after the queued task edits
        return edits

    def _check_twist(self, edit: Drive) -> None:
        """Raise ValueError unless the twist is finite; remove older twists from the queue."""
        if not (math.isfinite(edit.v) and math.isfinite(edit.w)):
            raise ValueError(f"a twist of {edit.v:g} m/s and {edit.w:g} rad/s: it has to be finite")
        self._queue = [queued for queued in self._queue if not isinstance(queued, Drive)]

    def _check_tasks(self, edit: TaskEdit) -> None:
        """Raise ValueError unless this edit is possible on the task list after the queued edits."""
        loop = self.loop
        tasks = edited(self._listed or loop.sequence.listed(), edit, loop.known, engaged=loop.engaged)
        if isinstance(edit, InsertTask):
            moving = {earlier.name for earlier in self._queue if isinstance(earlier, MoveObject)}
            truth = self.plant.truth()
            objects = () if truth is None else truth.objects
            binned = {body.name: body.state for body in objects if body.state.startswith("binned:")}
            for task in edit.tasks:
                if isinstance(task, Pick) and task.object in binned and task.object not in moving:
                    where = binned[task.object].removeprefix("binned:")
                    raise ValueError(f"{task.object} lies in {where}: the arm does not reach into bins, move it first")
        self._listed = tasks

    def _correct_beliefs(self, names: list[str]) -> None:
        """Correct the believed positions of objects that a user adds to the task list, if they are off."""
        truth = self.plant.truth()
        if truth is None:
            return
        loop, observation = self.loop, self.loop.tracker.as_believed(self.plant.observe())
        for body in truth.objects:
            if body.name not in names or body.state == "held":
                continue
            at = np.array(body.position)
            if norm(loop.tracker.world_position(body.name, observation) - at) > POINTED_AT:
                in_odometry = from_frame(world_in_odometry(observation), at)
                loop.tracker.move_belief(body.name, in_odometry, observation, loop.known.object_sd)

    def _announce(self, name: str) -> None:
        """Move a piece of furniture in the map to its true pose, with the bins and believed objects on it."""
        on_piece, truth = self._announcements.on_piece(name), self.plant.truth()
        if truth is None:
            return
        motion = self._announcements.place_piece(name, truth)
        self.plant.expect_map(self.announced)
        if motion is None:
            return
        self._rebuild()
        moves = [
            entry.index
            for entry in self.edits
            if isinstance(entry.edit, MoveBody | ReleaseBody) and entry.edit.name == name
        ]
        since = PERIOD * moves[-1] if moves else np.inf
        tracker = self.loop.tracker
        now = tracker.as_believed(self.plant.observe())
        tracker.carry(on_piece, motion, now, held=self.loop.sequence.held, before=since + PERIOD)
