"""Comparisons (what if): a run repeated in other processes, unchanged and with other parameters, for all visitors.

``python -m motm_twin.record.what_if`` computes both and writes JSON lines, which are read and kept here.
"""

import bisect
import contextlib
import math
import subprocess
import sys
import tempfile
import threading
import time as clock
import traceback
from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from operator import attrgetter
from pathlib import Path

import msgspec

from motm_twin.model.edits import ParameterValue
from motm_twin.model.plant import PERIOD
from motm_twin.record.what_if_lines import RUNS, Mover, Outcome, Sample

ERROR_LINES = 12  # lines of the process's standard error that are kept
WATCH_SPEED = 3.0  # times real time
WATCH_END = 3.0  # [s] for which the ends are shown before both follow the twin again
BEHIND = 0.3  # [s] lag of the computed runs beyond which the labels of their robots show their time
EARLIER = " (run before)"  # label of robots whose comparison began before a branch or reset
MOST_SAMPLES = 72_000  # samples of one run, two hours; later ones are dropped
Values = Mapping[str, ParameterValue]
OwnMethod = tuple[str, str]  # name of a method that is not shipped, and its FILE.py:NAME from the command line


class _Driven(msgspec.Struct):
    """The field of a session that names the method."""

    method: str = ""


class _Line(msgspec.Struct, frozen=True, kw_only=True):
    run: str = ""
    done: bool = False
    error: str = ""


@dataclass(frozen=True)
class Other:
    """A robot of a compared run, at one moment."""

    label: str
    pose: tuple[float, float, float]
    q: tuple[float, ...]
    gripper: float
    movers: tuple[Mover, ...] = ()  # dynamic bodies of that run


@dataclass(frozen=True, kw_only=True)
class State:
    """The state of the comparison."""

    phase: str = "idle"  # idle | starting | running | done | failed
    text: str = ""  # why it failed
    run: int = -1  # run of the twin in which it began
    start: float = 0.0  # [s] from which on the runs may differ
    values: Values = field(default_factory=dict)  # of the changed run
    reached: dict[str, float] = field(default_factory=dict)  # [s] simulated, by run
    outcomes: dict[str, Outcome] = field(default_factory=dict)

    @property
    def busy(self) -> bool:
        """True while something is being computed."""
        return self.phase in ("starting", "running")


class Runs:
    """The samples of both runs."""

    def __init__(self) -> None:
        self._samples: dict[str, list[Sample]] = {run: [] for run in RUNS}
        self.outcomes: dict[str, Outcome] = {}

    def add(self, line: bytes) -> str:
        """Take one line of the process; the text of an error, else "". Raises ValueError for any other line."""
        kind = msgspec.json.decode(line, type=_Line)
        if kind.error:
            return kind.error
        if kind.run not in self._samples:
            raise ValueError(f"the run {kind.run!r} is unknown; there are {', '.join(RUNS)}")
        if kind.done:
            self.outcomes[kind.run] = msgspec.json.decode(line, type=Outcome)
            return ""
        sample, samples = msgspec.json.decode(line, type=Sample), self._samples[kind.run]
        if len(samples) < MOST_SAMPLES and (not samples or samples[-1].time < sample.time):
            samples.append(sample)
        return ""

    def reached(self) -> dict[str, float]:
        """Time [s] that each run has reached."""
        return {run: samples[-1].time for run, samples in self._samples.items() if samples}

    def common(self) -> float:
        """Time [s] up to which both runs can be shown: an ended run keeps its last pose."""
        open_runs = [run for run in RUNS if run not in self.outcomes]
        reached = self.reached()
        return min((reached.get(run, 0.0) for run in open_runs), default=max(reached.values(), default=0.0))

    def at(self, time: float) -> list[Other]:
        """The robots of both runs at a time [s]; they stand still before the first and after the last sample."""
        found = []
        for run, samples in self._samples.items():
            number = bisect.bisect_right(samples, time, key=attrgetter("time"))
            if samples:
                before, after = samples[max(0, number - 1)], samples[min(number, len(samples) - 1)]
                outcome = self.outcomes.get(run)
                label = run if outcome is None or time < outcome.time_s else f"{run}: {outcome.clock}"
                found.append(_between(label, before, after, time))
        return found


def _between(label: str, a: Sample, b: Sample, time: float) -> Other:
    part = 0.0 if b.time <= a.time else min(1.0, max(0.0, (time - a.time) / (b.time - a.time)))

    def mix(x: Sequence[float], y: Sequence[float]) -> tuple[float, ...]:
        return tuple(one + part * (other - one) for one, other in zip(x, y, strict=True))

    turn = math.remainder(b.pose[2] - a.pose[2], 2 * math.pi)
    movers = a.movers  # interpolated unless the number of bodies changes between the samples
    if len(a.movers) == len(b.movers):
        movers = tuple((*mix(one[:2], other[:2]), *one[2:]) for one, other in zip(a.movers, b.movers, strict=True))
    pose = (*mix(a.pose[:2], b.pose[:2]), a.pose[2] + part * turn)
    return Other(label, pose, mix(a.q, b.q), *mix([a.gripper], [b.gripper]), movers)  # type: ignore[arg-type]


class WhatIf:
    """At most one comparison at a time. ``session`` gives the run so far as JSON."""

    def __init__(
        self,
        session: Callable[[], bytes],
        now: Callable[[], float] = clock.monotonic,
        own_method: OwnMethod | None = None,
    ) -> None:
        self._session, self._own_method, self._now = session, own_method, now
        self._watch_from: float | None = None  # on the clock ``now``
        self._lock = threading.Lock()
        self._runs, self.state, self._job = Runs(), State(), 0
        self._process: subprocess.Popen[bytes] | None = None

    def others(self, time: float, run: int = -1) -> list[Other]:
        """The robots to show beside the twin's at a time [s] of its run with this number, at most two.

        Both are shown at one common time, even when one run has been computed further. Their dynamic bodies are shown
        only while both runs are watched alone.
        """
        with self._lock:
            if self.state.phase in ("idle", "failed"):
                return []
            watched = self._watched()
            known = self._runs.common()
            found = self._runs.at(min(known, time if watched is None else watched))
            late = watched is None and self.state.busy and time - known > BEHIND
            earlier = EARLIER if run > self.state.run >= 0 else ""
            words = earlier + (f" at {known:.0f} s" if late else "")
            found = [replace(other, label=other.label + words) for other in found]
            return found if watched is not None else [replace(other, movers=()) for other in found]

    def watch(self) -> None:
        """Show both runs alone, from where they part to their ends, faster than real time."""
        with self._lock:
            self._watch_from = self._now()

    @property
    def watched(self) -> float | None:
        """The time [s] of both runs that is watched; None while they follow the twin."""
        with self._lock:
            return self._watched()

    def _watched(self) -> float | None:
        if self._watch_from is None:
            return None
        time, common = self.state.start + WATCH_SPEED * (self._now() - self._watch_from), self._runs.common()
        if time > common + WATCH_SPEED * WATCH_END:
            self._watch_from = None
        return None if self._watch_from is None else min(time, common)

    def start(self, values: Values, from_index: int, run: int = -1) -> None:
        """Compare the run, continued to its end, with the same run under these values from period ``from_index`` on.

        ``run``: number of the twin's run, to tell it from later ones. Returns at once; `state` shows the progress.
        Raises ValueError while another comparison runs.
        """
        with self._lock:
            if self.state.busy:
                raise ValueError("another comparison is being computed: stop it first")
            self._job += 1
            self._runs, self._watch_from = Runs(), None
            self.state = State(phase="starting", run=run, start=from_index * PERIOD, values=dict(values))
            job = (self._job, dict(values), from_index)
        threading.Thread(target=self._compute, args=job, name="what if", daemon=True).start()

    def stop(self) -> None:
        """End the computation and hide the comparison."""
        with self._lock:
            self._job += 1
            self.state, self._runs, self._watch_from = State(), Runs(), None
            process, self._process = self._process, None
        _end(process)

    def _compute(self, job: int, values: Values, from_index: int) -> None:
        try:
            data = self._session()
            with tempfile.TemporaryDirectory(prefix="motm-what-if-") as folder:
                file = Path(folder) / "session.json"
                file.write_bytes(data)
                self._run(job, [str(file), *arguments(values, from_index), *self._method_of(data)])
        except Exception as error:
            if not isinstance(error, (OSError, ValueError, RuntimeError)):
                traceback.print_exc()
            self._set(job, phase="failed", text=f"{error}" or type(error).__name__)

    def _method_of(self, session: bytes) -> list[str]:
        """The option that locates the method of a session, when it is not shipped."""
        own = self._own_method
        shipped = own is None or msgspec.json.decode(session, type=_Driven).method != own[0]
        return [] if shipped else ["--method", own[1]]

    def _run(self, job: int, options: list[str]) -> None:
        with self._lock:
            if job != self._job:
                return
            process = subprocess.Popen(  # noqa: S603 - our own module; names and values are checked there
                [sys.executable, "-m", "motm_twin.record.what_if", *options],
                stdin=subprocess.PIPE,  # closes when this process ends, which ends the other one
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
            )
            self._process = process
        assert process.stdout is not None and process.stderr is not None
        stderr_end: deque[bytes] = deque(maxlen=ERROR_LINES)
        listener = threading.Thread(
            target=stderr_end.extend, args=(process.stderr,), name="what if, errors", daemon=True
        )
        listener.start()
        try:
            self._read(job, process.stdout)
            process.wait()
            listener.join(1.0)
        finally:
            _end(process)
        if self._set(job) and self.state.busy:
            last = stderr_end[-1].decode(errors="replace").strip() if stderr_end else f"exit code {process.returncode}"
            self._set(job, phase="failed", text=f"the comparison ended early: {last}")

    def _read(self, job: int, lines: Iterable[bytes]) -> None:
        for line in lines:
            with self._lock:
                if job != self._job:
                    return
                error = self._runs.add(line)
                outcomes, reached = dict(self._runs.outcomes), self._runs.reached()
            if error:
                self._set(job, phase="failed", text=error)
                return
            phase = "done" if len(outcomes) == len(RUNS) else "running"
            self._set(job, phase=phase, outcomes=outcomes, reached=reached)

    def _set(self, job: int, **changes: object) -> bool:
        """Change the state of a job; False, without a change, when another job has taken its place."""
        with self._lock:
            if job != self._job:
                return False
            self.state = State(**{**vars(self.state), **changes})  # type: ignore[arg-type]
            return True


def arguments(values: Values, from_index: int) -> list[str]:
    """The options of ``motm-twin what-if`` for these values."""
    options = ["--from", f"{from_index * PERIOD:.3f}", "--stream"]
    for name, value in values.items():
        text = ("on" if value else "off") if isinstance(value, bool) else str(value)
        options += ["--set", f"{name}={text}"]
    return options


def _end(process: subprocess.Popen[bytes] | None) -> None:
    if process is None:
        return
    with contextlib.suppress(OSError):
        process.terminate()
    try:
        process.wait(1.0)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
    if process.stdin is not None:
        with contextlib.suppress(OSError):
            process.stdin.close()
