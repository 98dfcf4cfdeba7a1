"""A what-if: a session as it was and with other parameters from a period on, in two processes at once.

As a program, ``python -m motm_twin.record.what_if FILE --set next_weight=0 --from 12.5`` writes JSON lines: samples
``{"run", "time", "pose", "q", "gripper"}`` of the runs "as it was" and "changed", and for each a last line
``{"run", "done": true, "time_s", "picks", "places", "contacts", "all_contacts", "path_length", "success", "reason",
"skipped", "forecast_from_s"}``: the time is a forecast from that time on, where the recording ends or the change
begins; null when the run ended as recorded. What cannot be run gives one line ``{"error"}`` and exit code 2. The
program ends with whoever started it: when its standard input is a pipe that closes, or nobody reads its output.
"""

import argparse
import contextlib
import math
import multiprocessing
import os
import stat
import sys
import traceback
from collections.abc import Iterable, Iterator
from multiprocessing.connection import Connection, wait
from typing import Any

import msgspec
import numpy as np

from motm_twin.control.method import Method
from motm_twin.control.tick import Completion, Tick, all_placed
from motm_twin.control.tuning import check, parameter
from motm_twin.methods.registry import find_method
from motm_twin.model.edits import Edit, InsertTask, ParameterValue, SetParameter
from motm_twin.model.names import MethodError
from motm_twin.model.plant import PERIODS_PER_SECOND
from motm_twin.planning.types import SearchBudget
from motm_twin.processes import at_end_of_input, end_with_parent, interrupt_deferred
from motm_twin.program import BAD_INPUT, FAILED, OK, THREADS
from motm_twin.record.replay import begin
from motm_twin.record.what_if_lines import AS_IT_WAS, CHANGED, Outcome, Sample
from motm_twin.sessions.branches import Log
from motm_twin.sessions.session import Session, SessionError, decode_session, encode_session, load_session
from motm_twin.trial import objection
from motm_twin.twin import Twin
from motm_twin.warm_up import compile_kernels, parts_of

_SWITCH = {"true": True, "on": True, "yes": True, "false": False, "off": False, "no": False}
Changes = dict[str, ParameterValue]
MOVERS = ("temi", "person")  # kinds of bodies that move by themselves
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
    """The period of the session that begins at this time [s]. Raises SessionError when there is none."""
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
        with contextlib.suppress(ValueError):  # `check`, which knows the range, refuses a text that is no number
            value = float(text)
    return check(name, value)


def run_one(
    session: Session, *, changes: Changes, start: int, method: Method | None = None
) -> Iterator[Sample | Outcome]:
    """Samples at 10 Hz, then the Outcome. Without changes the recorded run is repeated. Raises SessionError.

    The run goes on after the recorded periods until its tasks are done, its time is over, or nothing is achieved for
    30 s. That part, and the changed run from the change on, is a forecast: every search may use all its expansions,
    whereas the clock may have cut those of a live run. Work that was done within the recorded periods is done at
    exactly the recorded time. Edits that the recorded run accepted but this one cannot are left out and named in the
    Outcome.
    """
    side = _WhatIfRun(session, changes, start, method)
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


class _WhatIfRun:
    """The twin of one run, its edits and its progress."""

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
        self._finish = Completion()

    def advance(self, index: int) -> Tick:
        """Compute one period, with its logged edits and changes."""
        free = bool(self._changes) and index >= self._start
        if self._changes and index == self._start:
            for name, value in self._changes.items():
                self._twin.post(SetParameter(name=name, value=value))
        for edit in self._log.edits(index):
            if not (free and isinstance(edit, SetParameter) and edit.name in self._changes):
                self._post(edit, index, free=free)
        tick = self._twin.advance(SearchBudget() if free else self._log.budget(index))
        assert tick.truth is not None
        progress = (tick.truth.picks, tick.truth.places, *((task.target, task.status) for task in tick.tasks))
        if progress != self._progress:
            self._progress, self._progress_time = progress, tick.time
        self._finish.add(tick)
        return tick

    def _post(self, edit: Edit, index: int, *, free: bool) -> None:
        try:
            self._twin.post(edit)
        except ValueError as error:
            refusal = f"{index / PERIODS_PER_SECOND:.2f} s: {type(edit).__name__}: {error}"
            if not free:
                raise SessionError(f"an edit is refused: {refusal}") from error
            self._skipped.append(refusal)

    def ended(self, tick: Tick) -> tuple[bool, str]:
        """True when this was the last period, and the reason unless all tasks are done."""
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
        reason = reason or objection(tick, all_placed(tick) and not truth.dropped, caused)
        time, known = self._finish.time_s, self._session.periods  # the first ``known`` periods repeat the recording
        known = min(self._start, known) if self._changes else known
        return Outcome(
            run=self.name,
            time_s=time,
            forecast_from_s=round(known / PERIODS_PER_SECOND, 3) if round(time * PERIODS_PER_SECOND) >= known else None,
            picks=truth.picks,
            places=truth.places,
            contacts=caused,
            all_contacts=len(truth.contacts),
            path_length=round(truth.path_length, 3),
            success=not reason,
            reason=reason,
            skipped=tuple(self._skipped),
        )


def _doing(tick: Tick) -> str:
    if tick.task_index >= len(tick.tasks):
        return "the last task"
    task = tick.tasks[tick.task_index]
    why = tick.stop_reason or tick.arm[-1].reason or tick.plan.reason
    return f"{task.kind} {task.target}" + (f": {why}" if why else "")


def _sample(name: str, tick: Tick) -> Sample:
    assert tick.truth is not None
    x, y, heading = np.round(tick.truth.pose, 4).tolist()
    return Sample(
        run=name,
        time=round(tick.time, 3),
        pose=(x, y, heading),
        q=tuple(np.round(tick.observation.q, 4).tolist()),
        gripper=round(float(tick.observation.gripper_width), 4),
        movers=tuple(
            (round(body.position[0], 3), round(body.position[1], 3), 0.5 * body.size[0], body.size[2])
            for body in (*tick.truth.agents, *tick.truth.obstacles)
            if body.kind in MOVERS
        ),
    )


NICE = 10  # the live twin has priority


class _Broken(msgspec.Struct, frozen=True, kw_only=True):
    """Error that ended a run before its Outcome."""

    run: str
    error: str
    bad_input: bool


class RunBroke(RuntimeError):
    """A process of a what-if died, or the program failed in it."""


Line = Sample | Outcome


def compare(session: Session, changes: Changes, start: int, method: str | None = None) -> Iterator[Line]:
    """The lines of both runs as they are computed; ``start``: period from which the changes apply.

    ``method``: FILE.py:NAME of a user's method, for a session that was made with it.

    Raises SessionError when the session cannot be run, RunBroke when a process died. Ends its processes in any case.
    """
    for name in THREADS:
        os.environ.setdefault(name, "1")
    compile_kernels(parts_of(session.parameters, agents=True))
    context = multiprocessing.get_context("spawn")
    data, readers, processes = encode_session(session), {}, []
    try:
        for name, values in ((AS_IT_WAS, {}), (CHANGED, changes)):
            read, write = context.Pipe(duplex=False)
            process = context.Process(
                target=_work, args=(data, values, start, name, method, write), daemon=True, name=name
            )
            with interrupt_deferred():
                process.start()
                processes.append(process)
            write.close()
            readers[read] = name
        yield from _lines(readers)
    finally:
        for process in processes:
            process.kill()
        for process in processes:
            process.join()
        for read in readers:
            read.close()


def _lines(readers: dict[Connection, str]) -> Iterator[Line]:
    open_readers = dict(readers)
    while open_readers:
        for read in wait(list(open_readers)):
            assert isinstance(read, Connection)
            try:
                line = read.recv()
            except EOFError:
                raise RunBroke(f"the run {open_readers[read]!r} ended before it was done") from None
            if isinstance(line, _Broken):
                raise (
                    SessionError(line.error)
                    if line.bad_input
                    else RunBroke(f"the run {line.run!r} broke: {line.error}")
                )
            yield line
            if isinstance(line, Outcome):
                del open_readers[read]


def _work(data: bytes, changes: Changes, start: int, name: str, method: str | None, write: Connection) -> None:
    """One run, in its own process, which ends with its parent."""
    end_with_parent()
    os.nice(NICE)
    try:
        own = None if method is None else find_method(method)
        for line in run_one(decode_session(data), changes=changes, start=start, method=own):
            write.send(line)
    except (SessionError, MethodError) as error:
        write.send(_Broken(run=name, error=str(error), bad_input=True))
    except BrokenPipeError:
        return
    except Exception as error:
        traceback.print_exc()
        write.send(_Broken(run=name, error=f"{type(error).__name__}: {error}", bad_input=False))


def stream(file: str, changes: list[str], seconds: float, method: str | None = None) -> int:
    """Write the JSON lines of both runs to standard output; returns the exit code."""
    _end_with_input()
    try:
        session = load_session(file)
        values, start = parse_changes(changes), start_period(session, seconds)
        for line in compare(session, values, start, method):
            _print(line)
    except SessionError as error:
        _print({"error": str(error)})
        return BAD_INPUT
    except RunBroke as error:
        _print({"error": str(error)})
        return FAILED
    return OK


def _print(line: Line | dict[str, str]) -> None:
    try:
        sys.stdout.buffer.write(msgspec.json.encode(line) + b"\n")
        sys.stdout.buffer.flush()
    except BrokenPipeError:  # the reader has gone; the processes of the runs end with this one
        os._exit(OK)


def _end_with_input() -> None:
    """End when standard input closes, if it is a pipe or socket of the parent."""
    try:
        mode = os.fstat(0).st_mode
    except OSError:
        return
    if stat.S_ISFIFO(mode) or stat.S_ISSOCK(mode):
        at_end_of_input(lambda: os._exit(OK))


def main() -> None:
    """Entry point of ``python -m motm_twin.record.what_if``."""
    parser = argparse.ArgumentParser(prog="python -m motm_twin.record.what_if", description=__doc__)
    parser.add_argument("file", metavar="FILE", help="a saved session")
    parser.add_argument("--set", dest="changes", action="append", default=[], metavar="NAME=VALUE")
    parser.add_argument("--from", dest="seconds", type=float, default=0.0, metavar="SECONDS")
    parser.add_argument("--method", metavar="FILE.py:NAME", help="of the session, when it is not shipped")
    parser.add_argument("--stream", action="store_true", help="write JSON lines (always done)")
    options = parser.parse_args()
    sys.exit(stream(options.file, options.changes, options.seconds, options.method))


if __name__ == "__main__":
    main()
