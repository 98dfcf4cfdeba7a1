"""The running twin, its messages, and previews of waiting edits. Knows no pacing, persons or transport.

A preview gives the state of the running plant and the edits to a second plant of the same scene: cubes ride on their
table, fall into a bin or are taken out of the fingers. The running plant is not touched.
"""

import traceback
from collections import deque
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, Protocol

import msgspec

from motm_twin.bus.commands import AddObstacle, Inspect, Refused
from motm_twin.bus.encode import bodies, numbers, tick_message
from motm_twin.bus.library import MakeTwin
from motm_twin.bus.messages import InspectedMessage, SessionInfo, TaskMessage, TickMessage
from motm_twin.control.tick import Tick
from motm_twin.model.edits import (
    Edit,
    FreezeBody,
    InsertTask,
    MoveTask,
    ParameterValue,
    RemoveTask,
    SendAgent,
    SetParameter,
    WorldEdit,
)
from motm_twin.model.plant import PERIOD, BodyTruth, ExternalPlant, Truth
from motm_twin.model.scene import Scene
from motm_twin.planning.types import SearchBudget
from motm_twin.plants import make_plant
from motm_twin.sessions.session import LoggedEdit

if TYPE_CHECKING:
    from motm_twin.control.loop import ControlLoop
    from motm_twin.control.method import Method
    from motm_twin.sessions.branches import Branches
    from motm_twin.twin import Twin

FROZEN = "frozen"  # state of an agent


class Preview:
    """Applies edits to a copy of the state. Edits of the robot's knowledge have no visible effect."""

    def __init__(self, scene: Scene) -> None:
        self._plant = make_plant(scene)
        self._of: TickMessage | None = None
        self._applied = 0
        self._frozen: dict[str, bool] = {}  # by these edits, which the plant reports only after its next step

    def show(self, message: TickMessage, state: Callable[[], Any], edits: Sequence[Edit]) -> TickMessage:
        """The message of the last period with the edits; ``state`` gives the snapshot of the plant after it."""
        if message is not self._of or len(edits) < self._applied:
            self._plant.restore(state())
            self._of, self._applied, self._frozen = message, 0, {}
        for edit in edits[self._applied :]:
            if isinstance(edit, WorldEdit):
                self._plant.apply(edit)
                if isinstance(edit, FreezeBody | SendAgent):  # SendAgent releases an agent
                    self._frozen[edit.name] = isinstance(edit, FreezeBody) and edit.frozen
            self._applied += 1
        truth = self._with_frozen_agents(self._plant.truth())
        robot = msgspec.structs.replace(message.robot, true_pose=truth.pose.tolist())
        return msgspec.structs.replace(message, robot=robot, preview=True, **bodies(truth))

    def _with_frozen_agents(self, truth: Truth) -> Truth:
        """The truth with agents frozen or released by the edits."""

        def shown(body: BodyTruth) -> BodyTruth:
            still = self._frozen.get(body.name)
            if still is None or still == (body.state == FROZEN):
                return body
            return msgspec.structs.replace(body, state=FROZEN if still else "standing")

        agents, obstacles = (tuple(map(shown, group)) for group in (truth.agents, truth.obstacles))
        return msgspec.structs.replace(truth, agents=agents, obstacles=obstacles)


def tasks_previewed(
    message: TickMessage, loop: "ControlLoop", edits: Sequence[InsertTask | RemoveTask | MoveTask]
) -> TickMessage:
    """The message with the task list after these waiting edits."""
    from motm_twin.control.task_list import edited, kind_of, name_of  # slow to import: only once the server listens

    now = loop.sequence.listed()
    for edit in edits:
        now = edited(now, edit, loop.known, engaged=loop.engaged)
    tasks = [
        TaskMessage(kind=kind_of(task), target=name_of(task), status=status, attempts=attempts)
        for task, status, attempts in zip(now.tasks, now.status, now.attempts, strict=True)
    ]
    return msgspec.structs.replace(message, tasks=tasks, task_index=now.index)


MAX_ADDED = 30
SESSION_INTERVAL = 0.25  # [s] between two sessions while playing: each costs the loop 2 ms, mostly for the hash
MOST_ASKERS = 1000  # requests that may wait


class Sink(Protocol):
    """Receiver of the loop's results; called from the loop's thread."""

    def tick(self, message: TickMessage, tick: Tick, last: bool) -> None:
        """Take a new period; ``last``: no other follows for now."""
        ...

    def scene(self, scene: Scene, run: int) -> None:
        """Take a newly loaded scene, whose first run will be ``run``."""
        ...

    def status(self) -> None:
        """Note that the status has changed."""
        ...

    def event(self, *, run: int, index: int, time: float, kind: str, text: str) -> None:
        """Take an event that belongs to no period."""
        ...


class LiveTwin:
    """One scene with its twin. Every load, reset and branch begins a new run."""

    def __init__(self, make_twin: MakeTwin, server_time: Callable[[], float], plant: str = "simulated") -> None:
        """``plant``: simulated, zenoh or mirror, as the twins that ``make_twin`` makes will be."""
        self._make_twin, self._server_time, self._plant = make_twin, server_time, plant
        self.run = 0
        self._began, self._first = 0.0, 0  # server time [s] of the load or reset, first period of the run
        self._past, self._aside_run = -1, -1  # run whose past this one shares, and run that is set aside
        self._ended: float | None = None  # [s] completion time
        self._aside_ended: float | None = None  # [s] completion time of the run that is set aside
        self.scene: Scene | None = None
        self.twin: Twin | None = None
        self.message: TickMessage | None = None  # of the last period
        self.tick: Tick | None = None
        self.parameters: dict[str, ParameterValue] = {}  # a copy: other threads read it
        self.recorded = 0
        self.oldest = 0  # first period that `branch` can go back to
        self.aside: float | None = None  # [s] end of the run that `undo_branch` brings back
        self._branches: Branches | None = None
        self._pending: list[Edit] = []
        self._preview: Preview | None = None
        self._inspect, self._asked = Inspect(), False  # requested explanations, and whether they are new
        self._session: tuple[tuple[int, int, int], bytes] | None = None
        self._robot: ExternalPlant | None = None
        self._here = True  # last result of `ready`

    @property
    def mirror(self) -> bool:
        """True when the external robot is only shown, never commanded."""
        return self._robot is not None and self._robot.mirror

    @property
    def simulated(self) -> bool:
        """True when the robot is computed here."""
        return self._robot is None

    @property
    def real_time(self) -> bool:
        """True when time passes by itself: the robot's clock is not simulated."""
        return self._robot is not None and not self._robot.shared

    @property
    def commands_at_once(self) -> bool:
        """True when a period commands a robot whose time passes by itself."""
        return self.real_time and not self.mirror

    @property
    def waiting(self) -> str:
        """Reason why there is no robot; "" when there is one."""
        return "" if self._here or self._robot is None else self._robot.text()

    def ready(self) -> bool:
        """True when there is a robot; call it from the loop's thread."""
        self._here = self._robot is None or self._robot.ready()
        return self._here

    def require_commanded(self) -> None:
        """Raise Refused when the robot is only shown."""
        if self.mirror:
            raise Refused("a mirror only shows the robot: nothing can be changed from here")

    def require_speed(self, factor: float) -> None:
        """Raise Refused for an impossible speed."""
        if self.real_time and factor != 1.0:
            raise Refused("the time of this robot runs by itself: its speed is 1")

    def status(self) -> dict[str, Any]:
        """Fields of the status about the run and the robot; from any thread."""
        robot = self._robot
        return {
            "run": self.run,
            "time": self.time,
            "parameters": self.parameters,
            "oldest": self.oldest,
            "aside": self.aside,
            "recorded": self.recorded,
            "plant": self._plant,
            "plant_text": "" if robot is None else robot.text(),
        }

    @property
    def index(self) -> int:
        """Last period that was computed; -1 before the first."""
        return self.message.index if self.message is not None else -1

    @property
    def time(self) -> float:
        """Simulated time [s]."""
        return self.message.time if self.message is not None else 0.0

    @property
    def task_index(self) -> int:
        """Index of the active task; the number of tasks when all have ended."""
        return 0 if self.message is None else min(self.message.task_index, len(self.message.tasks))

    def clear(self, scene: Scene) -> None:
        """Take another scene, still without a twin."""
        self.scene, self.twin, self.message, self.tick, self._preview = scene, None, None, None, None
        self.aside = None

    def build(self, scene: Scene, method: "Method") -> None:
        """Make the twin of a scene under a method."""
        from motm_twin.sessions.branches import Branches  # imports the twin: slow, only once the server listens

        self.twin, self._branches = self._make_twin(scene, method=method), Branches()
        self._robot = getattr(self.twin, "external", None)
        self._begin(self._server_time(), 0)

    def reset(self) -> None:
        """Back to the start of the scene."""
        twin, branches = self._made()
        twin.reset()
        branches.clear()
        self._begin(self._server_time(), 0)

    def require_branch(self, index: int) -> None:
        """Raise Refused when `branch` can not go back to the start of this period."""
        if self._robot is not None:
            raise Refused("a robot in another program can not go back in time")
        last = -1 if self.twin is None else self.twin.index
        if not self.oldest <= index <= last:
            raise Refused(f"period {index} is not kept: choose one from {self.oldest} to {last}")

    def branch(self, index: int) -> list[LoggedEdit]:
        """Go back to the start of a period, after `require_branch`; returns its edits until then."""
        twin, branches = self._made()
        branches.branch(twin, index)
        past, self._aside_run = self.run, self.run
        ended = self._aside_ended = self._ended
        self._begin(self._began, index, past)
        self._ended = ended if ended is not None and ended <= index * PERIOD else None
        return list(twin.edits)

    def require_aside(self) -> None:
        """Raise Refused when no run is set aside."""
        if self.aside is None:
            raise Refused("there is no branch to undo: none was made since the scene was loaded or reset")

    def undo_branch(self) -> list[LoggedEdit]:
        """Resume the run that is set aside, after `require_aside`; returns its edits."""
        twin, branches = self._made()
        branches.undo(twin)
        past, self._aside_run = self._aside_run, self.run
        ended, self._aside_ended = self._aside_ended, self._ended
        self._begin(self._began, twin.index, past)
        self._ended = ended
        return list(twin.edits)

    def post(self, edit: Edit) -> None:
        """Take an edit for the next period. Raises Refused."""
        twin, _ = self._made()
        self.require_commanded()
        if isinstance(edit, AddObstacle):
            added = sum(isinstance(edit, AddObstacle) for edit in self._pending)
            if added + (len(self.message.obstacles) if self.message is not None else 0) >= MAX_ADDED:
                raise Refused(f"{MAX_ADDED} obstacles were added already; remove one first")
        try:
            twin.post(edit)
        except ValueError as error:
            raise Refused(str(error)) from error
        self._pending.append(edit)
        if isinstance(edit, SetParameter):  # readers see new values even while paused
            self.parameters = twin.next_parameters

    def advance(self, *, by_the_clock: bool) -> tuple[TickMessage, Tick]:
        """Compute one period. The clock bounds a search only while playing: single steps repeat bit for bit."""
        twin, branches = self._made()
        if self._robot is None:
            branches.note(twin, twin.index)
        self.oldest = branches.oldest
        self.tick = twin.advance(None if by_the_clock else SearchBudget())
        self._pending = []
        self.parameters, self.recorded = dict(twin.parameters), len(twin.edits)
        self._asked = False
        places = sum(task.kind == "place" for task in self.tick.tasks)
        if not self.tick.done or (self.tick.truth is not None and self.tick.truth.places < places):
            self._ended = None  # not before every task has ended, and every object to be placed is in its bin
        elif self._ended is None:
            self._ended = round(self.tick.time, 6)
        now = self._server_time()
        message = tick_message(
            self.tick, self.run, now, began=self._began, first=self._first, past=self._past, ended=self._ended,
            announced=twin.announced,
        )  # fmt: skip
        self.message = self._explained(message)
        return self.message, self.tick

    def tell_refused(self, sink: Sink) -> None:
        """Report accepted edits that the robot refused in their period."""
        for text in () if self.twin is None else self.twin.refused:
            sink.event(run=self.run, index=self.index, time=self.time, kind="refused", text=text)

    def inspect(self, command: Inspect) -> None:
        """Add the requested explanations to all ticks from now on."""
        self._asked = self._asked or command != self._inspect
        self._inspect = command

    def shown(self) -> tuple[TickMessage, Tick] | None:
        """Preview of a paused twin: its last period, with the waiting edits applied."""
        if self.message is None or self.tick is None:
            return None
        if self._asked:
            self._asked, self.message = False, self._explained(self.message)
        message = self._previewed(self.message) if self._pending and self._robot is None else self.message
        return msgspec.structs.replace(message, server_time=self._server_time()), self.tick

    def session(self) -> bytes:
        """The run so far as a Session in JSON. Raises Refused."""
        if self._robot is not None:
            raise Refused("a robot in another program does not do the same again: record the run instead")
        if self.twin is None or self.message is None:
            raise Refused("no period was computed yet")
        now = (self.run, self.message.index, len(self.twin.edits))
        if self._session is None or self._session[0] != now:
            self._session = now, msgspec.json.encode(self.twin.session())
        return self._session[1]

    def session_info(self) -> bytes:
        """The run of the session, as a SessionInfo in JSON."""
        return msgspec.json.encode(SessionInfo(run=self.run, began=self._began))

    def _made(self) -> "tuple[Twin, Branches]":
        assert self.twin is not None and self._branches is not None
        return self.twin, self._branches

    def _begin(self, began: float, first: int, past: int = -1) -> None:
        assert self._branches is not None
        self.run, self._began, self._first, self._past = self.run + 1, began, first, past
        aside = self._branches.aside
        self.aside = None if aside is None else round(aside * PERIOD, 3)
        self._pending, self._inspect, self.message, self.tick, self._ended = [], Inspect(), None, None, None

    def _previewed(self, message: TickMessage) -> TickMessage:
        twin, _ = self._made()
        if self._preview is None:
            assert self.scene is not None
            self._preview = Preview(self.scene)
        shown = self._preview.show(message, lambda: twin.snapshot()["plant"], self._pending)
        edits = [edit for edit in self._pending if isinstance(edit, InsertTask | RemoveTask | MoveTask)]
        return tasks_previewed(shown, twin.loop, edits) if edits else shown

    def _explained(self, message: TickMessage) -> TickMessage:
        """The message with the explanations that `inspect` requested. A failure here must not stop the robot."""
        wish = self._inspect
        if wish == Inspect() and message.inspected is None and not message.plan.staa_path:
            return message
        try:
            inspected, staa_path = self._paths(wish, len(message.placement.poses))
        except Exception:
            traceback.print_exc()
            self._inspect, inspected, staa_path = Inspect(), None, []
        plan = msgspec.structs.replace(message.plan, staa_path=staa_path)
        return msgspec.structs.replace(message, plan=plan, inspected=inspected)

    def _paths(self, wish: Inspect, candidates: int) -> tuple[InspectedMessage | None, list[list[float]]]:
        twin, _ = self._made()
        staa_path = numbers(twin.staa_path()) if wish.staa_path else []
        paths = twin.candidate_paths(wish.candidate) if 0 <= wish.candidate < candidates else None
        if paths is None:
            return None, staa_path
        path, next_path = (numbers(points) for points in paths)
        return InspectedMessage(candidate=wish.candidate, path=path, next_path=next_path), staa_path


SessionReply = Callable[[bytes, bytes, str], None]  # session and SessionInfo as JSON, reason of a refusal


class SessionDesk:
    """Takes requests for the session from any thread; the loop answers all waiting ones with the same session."""

    def __init__(self, write: Callable[[], tuple[bytes, bytes]], why_not: Callable[[Exception], str]) -> None:
        """``write`` gives the session and its SessionInfo as JSON; ``why_not`` words the errors that it raises."""
        self._write, self._why_not = write, why_not
        self._askers: deque[SessionReply] = deque()
        self._written = -1e9  # [s]

    def ask(self, reply: SessionReply) -> bool:
        """Request the session; ``reply`` is called once, from the loop's thread. Raises Refused when too many wait.

        Returns True when no other request was waiting, so that the loop must be woken.
        """
        if len(self._askers) >= MOST_ASKERS:
            raise Refused("too many are waiting for the session")
        first = not self._askers
        self._askers.append(reply)
        return first

    def serve(self, now: float, passing: bool) -> None:
        """Answer all requests; while time runs (``passing``), with `SESSION_INTERVAL` between two sessions."""
        if not self._askers or (passing and now < self._written + SESSION_INTERVAL):
            return
        self._written = now
        waiting = [self._askers.popleft() for _ in range(len(self._askers))]
        try:
            answer = (*self._write(), "")
        except Exception as error:
            answer = b"", b"", self._why_not(error)
        for reply in waiting:
            reply(*answer)
