"""One of the two runs of a what-if: a session as it was, or with other parameters from a period on, to its end.

Changed parameters are read as a person writes them: ``--set next_weight=0 --set bezier=off``.
"""

import contextlib
import math
from collections.abc import Iterable, Iterator
from typing import Any

import msgspec
import numpy as np

from motm_twin.control.method import Method
from motm_twin.control.tick import Tick
from motm_twin.control.tuning import check, parameter
from motm_twin.finish import Finish, all_placed
from motm_twin.model.edits import Edit, InsertTask, ParameterValue, SetParameter
from motm_twin.model.period import PERIOD
from motm_twin.planning.types import SearchBudget
from motm_twin.record.replay import begin
from motm_twin.sessions.branches import Log
from motm_twin.sessions.session import Session, SessionError
from motm_twin.twin import Twin

PERIODS_PER_SECOND = round(1.0 / PERIOD)
_SWITCH = {"true": True, "on": True, "yes": True, "false": False, "off": False, "no": False}
Changes = dict[str, ParameterValue]
MOVERS = ("temi", "person")  # kinds of bodies that drive or walk by themselves
AS_IT_WAS, CHANGED = "as it was", "changed"
SAMPLE_PERIODS = 2  # 10 Hz of simulated time
PATIENCE = 30.0  # [s] without progress in the tasks, after the last recorded period


def parse_changes(texts: Iterable[str]) -> Changes:
    """Names and checked values of ``name=value`` texts. Raises SessionError with what is allowed."""
    changes: Changes = {}
    for text in texts:
        name, sign, value = text.partition("=")
        if not sign:
            raise SessionError(f"--set {text[:80]}: write name=value, for instance next_weight=0.5")
        if name.strip() in changes:
            raise SessionError(f"--set {text[:80]}: {name.strip()} is set twice, once is enough")
        try:
            changes[name.strip()] = _value(name.strip(), value.strip())
        except ValueError as error:
            raise SessionError(f"--set {text[:80]}: {error}") from error
    if not changes:
        raise SessionError("nothing is changed: give at least one --set name=value")
    return changes


def start_period(session: Session, seconds: float) -> int:
    """The period that begins at this time of the session. Raises SessionError when it has none."""
    recorded = session.periods / PERIODS_PER_SECOND
    if not (math.isfinite(seconds) and 0.0 <= seconds <= recorded):
        raise SessionError(f"--from {seconds:g}: the session has 0 to {recorded:g} s, choose a time in it")
    return round(seconds * PERIODS_PER_SECOND)


def _value(name: str, text: str) -> ParameterValue:
    entry = parameter(name)
    value: ParameterValue = text
    if entry.kind == "switch":
        value = _SWITCH.get(text.lower(), text)
    elif entry.kind == "number":
        with contextlib.suppress(ValueError):  # what is no number is refused by `check`, which knows the range
            value = float(text)
    return check(name, value)


class Sample(msgspec.Struct, frozen=True, kw_only=True):
    """Pose of the robot at one time."""

    run: str  # "as it was" | "changed"
    time: float  # [s] simulated
    pose: tuple[float, ...]  # true base pose x, y, heading, world
    q: tuple[float, ...]  # arm joints [rad], 7
    gripper: float  # [m] between the finger pads
    movers: tuple[tuple[float, float, float, float], ...] = ()  # Temis and persons: x, y, radius, height [m]


class Outcome(msgspec.Struct, frozen=True, kw_only=True):
    """The end of a run."""

    run: str
    done: bool = True  # the last line of this run
    time_s: float  # [s] of the work, as of `motm-twin run`: until it was done, or until the run ended without that
    picks: int
    places: int
    contacts: int  # caused by the robot
    all_contacts: int = 0  # whoever caused them
    path_length: float  # [m] driven by the base
    success: bool
    reason: str  # why not, one sentence; "" after success
    skipped: tuple[str, ...] = ()  # recorded edits that the changed run could not take, and why
    forecast_from_s: float | None = None  # [s] `time_s` is a forecast that begins here; None: it is as recorded


def run_one(
    session: Session, *, changes: Changes, start: int, method: Method | None = None
) -> Iterator[Sample | Outcome]:
    """Samples at 10 Hz, then the Outcome. Without changes it is the run as it was. Raises SessionError.

    The run goes on after the recorded periods until its tasks are done, its time is over, or nothing is achieved for
    30 s. From there on, and in the changed run from the change on, it is a forecast: every search may use all its
    expansions, where a clock may have cut those of a live run. What was done within the recorded periods is done at
    the recorded time, exactly. Edits that the recorded run took and this one cannot are left out and named in the
    Outcome.
    """
    side = _Side(session, changes, start, method)
    index = 0
    while True:
        tick = side.advance(index)
        ended, why = side.ended(tick)
        if index % SAMPLE_PERIODS == 0 or ended:
            yield _sample(side.name, tick)
        if ended:
            yield side.outcome(tick, why)
            return
        index += 1


class _Side:
    """The twin of one run, what it is told, and how far it got."""

    def __init__(self, session: Session, changes: Changes, start: int, method: Method | None) -> None:
        self.name = CHANGED if changes else AS_IT_WAS
        self._session, self._changes, self._start = session, changes, start
        self._twin: Twin = begin(session, method=method)
        self._log = Log(session.edits, session.cuts)
        self._last_insert = max((e.index for e in session.edits if isinstance(e.edit, InsertTask)), default=-1)
        self._recorded = session.periods / PERIODS_PER_SECOND
        self._skipped: list[str] = []
        self._progress: tuple[Any, ...] = ()
        self._progress_time = 0.0
        self._finish = Finish()

    def advance(self, index: int) -> Tick:
        """One period with what the log and the changes have for it."""
        free = bool(self._changes) and index >= self._start
        if self._changes and index == self._start:
            for name, value in self._changes.items():
                self._twin.post(SetParameter(name=name, value=value))
        for edit in self._log.edits(index):
            if not (free and isinstance(edit, SetParameter) and edit.name in self._changes):
                self._post(edit, index, free=free)
        tick = self._twin.advance(SearchBudget() if free else self._log.budget(index))
        self._note(tick)
        return tick

    def _post(self, edit: Edit, index: int, *, free: bool) -> None:
        try:
            self._twin.post(edit)
        except ValueError as error:
            said = f"{index / PERIODS_PER_SECOND:.2f} s: {type(edit).__name__}: {error}"
            if not free:
                raise SessionError(f"an edit is refused: {said}") from error
            self._skipped.append(said)

    def _note(self, tick: Tick) -> None:
        assert tick.truth is not None
        progress = (tick.truth.picks, tick.truth.places, *((task.target, task.status) for task in tick.tasks))
        if progress != self._progress:
            self._progress, self._progress_time = progress, tick.time
        self._finish.add(tick)

    def ended(self, tick: Tick) -> tuple[bool, str]:
        """True when this was the last period, and why if not because all is done."""
        if self._finish.over and tick.index >= self._last_insert:
            return True, ""
        limit = self._session.scene.time_limit
        if tick.time >= limit and tick.index + 1 >= self._session.periods:
            return True, f"the time limit of {limit:g} s was reached"
        if tick.time - max(self._progress_time, self._recorded) >= PATIENCE:
            return True, f"nothing was achieved for {PATIENCE:g} s"
        return False, ""

    def outcome(self, tick: Tick, why: str) -> Outcome:
        """The run in numbers."""
        truth = tick.truth
        assert truth is not None
        caused = sum(contact.caused_by_robot for contact in truth.contacts)
        reason = why and f"{why} during {_doing(tick)}"
        reason = reason or "; ".join(self._twin.loop.sequence.failures)
        if not reason and not all_placed(tick):
            reason = "the referee counts fewer cubes in their bins than the robot believes to have placed"
        if not reason and truth.dropped:
            reason = f"dropped, and not picked up and placed again: {', '.join(truth.dropped)}"
        if not reason and caused:
            reason = f"{caused} contact(s) caused by the robot"
        time = self._finish.time_s
        return Outcome(
            run=self.name,
            time_s=time,
            forecast_from_s=self._forecast_from(time),
            picks=truth.picks,
            places=truth.places,
            contacts=caused,
            all_contacts=len(truth.contacts),
            path_length=round(truth.path_length, 3),
            success=not reason,
            reason=reason,
            skipped=tuple(self._skipped),
        )

    def _forecast_from(self, time: float) -> float | None:
        """Time at which the repetition of the recording ended [s], if that was before the period at ``time`` [s]."""
        known = min(self._start, self._session.periods) if self._changes else self._session.periods
        return round(known / PERIODS_PER_SECOND, 3) if round(time * PERIODS_PER_SECOND) >= known else None


def _doing(tick: Tick) -> str:
    if tick.task_index >= len(tick.tasks):
        return "the last task"
    task = tick.tasks[tick.task_index]
    why = tick.stop_reason or tick.arm[-1].reason or tick.plan.reason
    return f"{task.kind} {task.target}" + (f": {why}" if why else "")


def _sample(name: str, tick: Tick) -> Sample:
    assert tick.truth is not None
    return Sample(
        run=name,
        time=round(tick.time, 3),
        pose=tuple(np.round(tick.truth.pose, 4).tolist()),
        q=tuple(np.round(tick.observation.q, 4).tolist()),
        gripper=round(float(tick.observation.gripper_width), 4),
        movers=tuple(
            (round(body.position[0], 3), round(body.position[1], 3), 0.5 * body.size[0], body.size[2])
            for body in (*tick.truth.agents, *tick.truth.obstacles)
            if body.kind in MOVERS
        ),
    )
