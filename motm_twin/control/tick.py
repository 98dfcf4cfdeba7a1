"""The Tick: the one immutable record of what a control period saw, decided and why, and how long its stages took.

`Completion` tells from the Ticks of a run when its tasks are complete.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

import msgspec

from motm_twin.control.arm.types import ArmStep
from motm_twin.model.edits import Edit
from motm_twin.model.geometry import Array
from motm_twin.model.plant import Observation, Truth
from motm_twin.model.reason import Reason
from motm_twin.perception.world_map import WorldMap
from motm_twin.planning.types import BasePlan, Placement


class TaskState(msgspec.Struct, frozen=True, kw_only=True):
    """One entry of the task list."""

    kind: str  # pick | place | drive_to
    target: str  # object, bin, or "(x, y)"
    status: str  # waiting | active | done | failed
    attempts: int


class ObjectBelief(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Belief about an object, world frame."""

    name: str
    position: Array  # [m], shape (3,)
    yaw: float
    position_sd: float  # [m]
    seen: bool
    held: bool


class Event(msgspec.Struct, frozen=True, kw_only=True):
    """Something worth telling: picked, placed, missed, lost, arrived, postponed, failed, fault, contact."""

    time: float
    kind: str
    text: str


class Tick(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """One control period (20 Hz), from observation to command."""

    index: int
    time: float  # [s] at the observation
    observation: Observation
    map: WorldMap
    tasks: tuple[TaskState, ...]
    task_index: int  # of the active task; len(tasks) when all is done
    beliefs: tuple[ObjectBelief, ...]
    placement: Placement
    plan: BasePlan
    arm: tuple[ArmStep, ...]  # the arm steps of this period, oldest first
    why: Reason | None  # whenever the robot stands, is slowed, or does without something
    events: tuple[Event, ...]
    edits: tuple[Edit, ...]  # applied at the start of this period
    stage_ms: dict[str, float]  # wall time of each stage [ms]; not part of any hash
    truth: Truth | None  # simulated plants only
    done: bool
    success: bool
    samples: tuple[Observation, ...] = ()  # observation of each arm step of this period, oldest first
    reported: tuple[Observation, ...] = ()  # the same as reported by the robot, before any correction
    restarted: bool = False  # control had paused: the base is taken to move as measured, not as commanded last

    @property
    def stop_reason(self) -> str:
        """Reason why the robot stands, is slowed, or does without something, in one sentence; "" for none."""
        return "" if self.why is None else str(self.why)


OURS = ("map", "place", "plan", "arm", "monitor")  # the plant's own time is not counted in the period


class Stages:
    """Adds up the time that is spent in each stage; the clock [s] may be one that stands still."""

    def __init__(self, clock: Callable[[], float]) -> None:
        self._clock = clock
        self._seconds: dict[str, float] = dict.fromkeys(("observe", *OURS), 0.0)

    @contextmanager
    def measure(self, stage: str) -> Iterator[None]:
        """Count the time of the block for a stage."""
        began = self._clock()
        yield
        self._seconds[stage] += self._clock() - began

    def milliseconds(self) -> dict[str, float]:
        """Each stage [ms], and their sum without the plant's as "period"."""
        times = {stage: 1e3 * seconds for stage, seconds in self._seconds.items()}
        return {**times, "period": sum(times[stage] for stage in OURS)}


SETTLE_PERIODS = 40  # 2 s after the last task, for a falling cube to land and the robot to stop


class Completion:
    """Follows the Ticks of a run until its last task is done and all cubes lie in their bins, or 2 s have passed."""

    def __init__(self) -> None:
        self._settle = SETTLE_PERIODS
        self._over_at: float | None = None
        self._time = 0.0

    def add(self, tick: Tick) -> None:
        """Take the next Tick into account. Tasks that a person adds revoke the completion."""
        self._time = tick.time
        if not tick.done:
            self._settle, self._over_at = SETTLE_PERIODS, None
            return
        if self._over_at is None and (all_placed(tick) or self._settle == 0):
            self._over_at = tick.time
        self._settle -= 1

    @property
    def over(self) -> bool:
        """True once the tasks are complete."""
        return self._over_at is not None

    @property
    def time_s(self) -> float:
        """Task time [s]: until completion, or else until the last Tick."""
        return round(self._time if self._over_at is None else self._over_at, 3)


def all_placed(tick: Tick) -> bool:
    """Test that the referee counts as many cubes in their bins as there are place tasks."""
    return tick.truth is not None and tick.truth.places >= sum(task.kind == "place" for task in tick.tasks)
