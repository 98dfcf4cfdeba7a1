"""Repeats a session, and every run of a recording: the same scene, edits and searches give the same state, bit for bit.

A rerun of a recording compares every recorded period. A `RecordedPlant` repeats the reports of an external robot.
"""

import math
from collections.abc import Iterable, Iterator
from typing import Any

import msgspec

from motm_twin.bus.encode import seconds, tick_message
from motm_twin.bus.messages import ObservationsMessage, Sample
from motm_twin.bus.plant_messages import from_message
from motm_twin.control.method import Method
from motm_twin.control.tick import Completion, Tick
from motm_twin.methods.registry import METHODS
from motm_twin.model.edits import Announce
from motm_twin.model.names import hint, scene_name
from motm_twin.model.plant import Detection, ExternalPlant, Observation, Scan
from motm_twin.model.scene import Scene
from motm_twin.model.state import state_hash
from motm_twin.record.recording import Recording, Run, observations_of, ticks_of
from motm_twin.sessions.branches import Log
from motm_twin.sessions.session import Session, SessionError, check_session, differences, made_with
from motm_twin.twin import Twin

TRACK_PERIODS = 20  # periods between two poses of a track: one second
PART_DIGITS = 12

Track = tuple[tuple[float, float, float], ...]


class Rerun(msgspec.Struct, frozen=True, kw_only=True):
    """The result of running a session again."""

    ok: bool  # the state is the recorded one, bit for bit
    state_hash: str  # now
    recorded_hash: str  # "": nothing to compare with
    periods: int
    time: float  # [s] simulated, at the begin of the last period
    time_s: float  # [s] of the work, as of `motm-twin run`: until it was done, or that of the last period
    parts: dict[str, str]  # part of the twin: first digits of its own hash
    track: Track  # true base pose after each second
    first_sign: str  # where the rerun parted from the recording, one sentence; "" when it did not
    differences: tuple[str, ...]  # differences from the origin of the session


def begin(session: Session, plant: ExternalPlant | None = None, method: Method | None = None) -> Twin:
    """A twin at the start of the session; ``plant``: a robot instead of the simulated one.

    ``method``: a user's own method, for a session that was made with it. Raises SessionError when a parameter is
    impossible, or when the method is neither shipped nor given: a name in a session is never a file to run.
    """
    if method is not None and method.name != session.method:
        raise SessionError(f"it was made with the method {session.method!r}, not with {method.name!r}")
    method = method or METHODS.get(session.method)
    if method is None:
        known = hint(session.method, METHODS)
        raise SessionError(
            f"it was made with the method {session.method!r}, which is not shipped: give its file, --method ({known})"
        )
    try:
        return Twin(session.scene, method=method, parameters=session.parameters, plant=plant)
    except ValueError as error:
        raise SessionError(f"the run cannot be started: {error}") from error


def player(session: Session, *, until: int | None = None, method: Method | None = None) -> Iterator[tuple[Twin, Tick]]:
    """The twin and its Tick after each period of the session, or of the periods before ``until``.

    Edits are posted at the periods they were logged with; where the clock cut a search, it ends after as many
    expansions. Raises SessionError for an edit that the run refuses.
    """
    twin, log = begin(session, method=method), Log(session.edits, session.cuts)
    for index in range(session.periods if until is None else min(until, session.periods)):
        tick = log.advance(twin, index)
        yield twin, tick


def rerun(session: Session, method: Method | None = None) -> Rerun:
    """Run a session again and compare; ``method`` as for `begin`. Raises SessionError when it cannot be run."""
    tracker, finish, twin, time = Tracker(), Completion(), None, 0.0
    for twin, tick in player(session, method=method):  # noqa: B007 - the last one is used
        tracker.add(tick)
        finish.add(tick)
        time = tick.time
    twin = twin or begin(session, method=method)
    parts = {name: state_hash(part.snapshot())[:PART_DIGITS] for name, part in twin.parts().items()}
    now = twin.state_hash()
    ok = now == session.state_hash
    return Rerun(
        ok=ok,
        state_hash=now,
        recorded_hash=session.state_hash,
        periods=session.periods,
        time=time,
        time_s=finish.time_s,
        parts=parts,
        track=tracker.track,
        first_sign="" if ok else _first_sign(session, tracker.track, parts),
        differences=differences(session.made_with),
    )


def updated(session: Session, again: Rerun) -> Session:
    """The session with the results of its rerun, to be saved when a change of behaviour is intended."""
    return msgspec.structs.replace(
        session, state_hash=again.state_hash, parts=again.parts, track=again.track, made_with=made_with()
    )


class Tracker:
    """Collects the track of a run."""

    def __init__(self) -> None:
        self.track: Track = ()  # poses so far

    def add(self, tick: Tick) -> None:
        """Take a Tick into account."""
        if (tick.index + 1) % TRACK_PERIODS == 0 and tick.truth is not None:
            x, y, heading = (float(value) for value in tick.truth.pose)
            self.track += ((x, y, heading),)


def _first_sign(session: Session, track: Track, parts: dict[str, str]) -> str:
    if not session.state_hash:
        return "the session has no state hash to compare with (the period after its last one broke off, or it was cut)"
    if not session.track:
        return "the session was saved without a track, so where the runs part is not known"
    for second, (then, now) in enumerate(zip(session.track, track, strict=False), start=1):
        if then != now:
            away = 1e3 * math.dist(then[:2], now[:2])
            turned = math.degrees(abs(math.remainder(then[2] - now[2], math.tau)))
            return f"after {second} s the base is {away:.3g} mm and {turned:.3g} deg from where it was recorded"
    if len(session.track) != len(track):
        return f"the track has {len(session.track)} poses, the rerun {len(track)}"
    differ = [name for name, now in parts.items() if session.parts.get(name) != now]
    return f"the base drove the same way; what differs at the end is the state of {', '.join(differ)}"


# Fields that are no part of the run itself: of the wall clock, of the server, of requested explanations, or already
# known from the edits.
_NOT_COMPARED = (
    "server_time", "run", "began", "first", "past", "ended", "stage_ms", "inspected", "preview", "announced",
)  # fmt: skip
_NOT_COMPARED_OF_PLAN = ("cut_by_clock", "staa_path")
_ADDED = ("tracks", "encounters", "courtesy")  # older recordings do not have them
_OF_TRUTH = ("objects", "agents", "obstacles", "furniture", "removed", "faults", "score")  # recorded robots have none
MOST_FIELDS = 5
Json = dict[str, Any]


class RecordedPlant:
    """A robot that repeats recorded reports. Commands and edits of the world have no effect."""

    mirror = False
    shared = True

    def __init__(self, messages: Iterable[ObservationsMessage]) -> None:
        """``messages``: of one run, from its first period on. Raises ValueError for a gap."""
        self.periods = 0  # number of reported periods
        self._samples: list[Observation] = []
        self._restarts: set[int] = set()  # first sample of each period after an interruption of control
        scan, detections = None, ()
        for expected, message in enumerate(messages):
            if message.index != expected:
                raise ValueError(f"the observations of period {expected} are missing: they go on with {message.index}")
            if message.restarted:
                self._restarts.add(len(self._samples))
            for sample in message.samples:
                _check(sample, expected)
                scan = scan if sample.scan is None else from_message(sample.scan, Scan)
                if sample.detections is not None:
                    detections = tuple(from_message(one, Detection) for one in sample.detections)
                self._samples.append(from_message(sample, Observation, scan=scan, detections=detections))
            self.periods = expected + 1
        self._at = 0

    def begin(self, scene: Scene) -> None:
        """Go back to the first sample."""
        self._at = 0

    def observe(self) -> Observation:
        """The present sample. Raises ValueError after the last one."""
        if self._at >= len(self._samples):
            raise ValueError(f"the recording has {len(self._samples)} samples: there is no other")
        return self._samples[self._at]

    def command(self, *_: object, **__: object) -> None:
        """No effect: the recorded motion includes the effects of commands and edits. The truth is unknown."""

    truth = accept = apply = expect_tasks = expect_map = command

    def step(self, dt: float) -> None:
        """Go to the next sample."""
        self._at += 1

    def rehearsal(self) -> "RecordedPlant":
        """A rehearsal that accepts every edit: this plant itself."""
        return self

    def ready(self) -> bool:
        """True when there is another sample."""
        return self._at < len(self._samples)

    def text(self) -> str:
        """A short description of the robot."""
        return f"a recorded robot: {len(self._samples)} samples"

    def interrupted(self) -> bool:
        """True when control was interrupted before the period that begins now."""
        return self._at in self._restarts


_LENGTHS = {"pose": 3, "odometry": 3, "twist": 2, "q": 7, "dq": 7}
_LENGTHS_SEEN = {"p_base": 3, "odometry": 3}
_LARGEST = 1e6  # bound of the numbers in poses, joints and rates: a larger one cannot be measured


def _check(sample: Sample, period: int) -> None:
    """Raise ValueError for impossible numbers: a recording may come from anybody. Control itself checks scans."""
    seen = [(part, _LENGTHS_SEEN) for part in sample.detections or ()]
    for part, lengths in [(sample, _LENGTHS), *seen]:
        for name, length in lengths.items():
            values = getattr(part, name)
            if len(values) != length or any(abs(value) > _LARGEST for value in values):
                raise ValueError(f"period {period}: {name} has {len(values)} numbers, or an impossible one")
    if not abs(sample.time) <= _LARGEST or not abs(sample.gripper_width) <= 1.0:
        raise ValueError(f"period {period}: its time or the width of the gripper is impossible")


class RunReport(msgspec.Struct, frozen=True, kw_only=True):
    """The result of running one recorded run again."""

    run: int
    scene: str
    periods: int  # computed again
    compared: int  # periods that were compared with recorded ones
    hashes: int  # states that were compared by their hash
    ok: bool
    period: int = -1  # first period that differs; -1: none
    fields: list[str] = []  # fields that differ in it: "plan.expansions: recorded 12, now 14"
    state_hash: str  # at the end
    differences: tuple[str, ...] = ()  # differences from the origin of the session
    text: str = ""  # what could not be compared


def rerun_run(recording: Recording, run: Run, method: Method | None = None) -> RunReport:
    """Compute one run again; ``method``: from a user's file, for runs that were made with it.

    Raises SessionError when no part of it can be computed and compared with the data in the file.
    """
    robot = _robot_of(recording, run)
    session = recording.session_of(run)
    check_session(session)
    end, why = _known_end(session, robot)
    _require_comparable(run, end)
    own = method if method and method.name == session.method else None
    twin, log = begin(session, robot, own), Log(session.edits, session.cuts)
    recorded = ticks_of(recording.path, run.key)
    waiting = next(recorded, None)
    compared, hashes, period, fields = 0, 0, -1, []
    for index in range(end):
        try:
            tick = log.advance(twin, index)
        except SessionError as error:  # refused now, though accepted when the run was recorded
            period, fields = index, [error.problem]
            break
        while waiting is not None and waiting[0] < index:
            waiting = next(recorded, None)
        if waiting is not None and waiting[0] == index:
            fields, compared = _differing(waiting[1], tick, of_truth=robot is None), compared + 1
        original = run.hashes.get(index + 1)
        if not fields and original is not None:
            hashes, now = hashes + 1, twin.state_hash()
            fields = [] if now == original else [f"state hash: recorded {original[:12]}, now {now[:12]}"]
        if fields:
            period = index
            break
    made_with = {} if run.session is None else run.session.made_with
    return RunReport(
        run=run.key[1],
        scene=f"{scene_name(session.scene.name, session.scene.variant)}, seed {session.scene.seed}",
        periods=twin.index,
        compared=compared,
        hashes=hashes,
        ok=period < 0,
        period=period,
        fields=fields,
        state_hash=twin.state_hash(),
        differences=differences(made_with) if made_with and period >= 0 else (),
        text=_not_compared(run, end, why),
    )


def _robot_of(recording: Recording, run: Run) -> RecordedPlant | None:
    """The external robot of a run, up to the first missing report; None for a simulated robot.

    Raises SessionError when not even its first period is known.
    """
    if run.plant == "simulated":
        return None
    if run.plant == "recording":
        raise SessionError("a recording was played, no robot was driven: the file that was played can be computed")
    try:
        robot = RecordedPlant(_from_the_start(observations_of(recording.path, run)))
        first = next(observations_of(recording.path, run), None)
    except RecursionError as error:
        raise SessionError("what its robot saw is nested too deeply") from error
    except (msgspec.MsgspecError, UnicodeDecodeError, ValueError) as error:
        problem = error.problem if isinstance(error, SessionError) else f"what its robot saw is broken: {error}"
        raise SessionError(problem) from error
    if robot.ready():
        return robot
    rest = "nothing of what that saw" if first is None else f"what that saw only from period {first.index} on"
    raise SessionError(f"its robot was in another program, and the file tells {rest}")


def _from_the_start(messages: Iterable[ObservationsMessage]) -> Iterator[ObservationsMessage]:
    """The messages from period 0 up to the first missing one."""
    for expected, message in enumerate(messages):
        if message.index != expected:
            return
        yield message


def _known_end(session: Session, robot: RecordedPlant | None) -> tuple[int, str]:
    """The first period with unknown inputs, and the reason."""
    unknown = [(session.periods, "some before them are missing in the file")]
    if robot is not None:
        unknown.append((robot.periods, f"what the robot saw in period {robot.periods} is missing in the file"))
        announced = (entry.index for entry in session.edits if isinstance(entry.edit, Announce))
        unknown += [
            (index, "where announced furniture stood is known to the robot's program only") for index in announced
        ]
    return min(unknown, key=lambda end: end[0])


def _require_comparable(run: Run, end: int) -> None:
    """Raise SessionError when no period before ``end``, which can be computed, was recorded."""
    if run.indices[0] >= end and not any(periods <= end for periods in run.hashes):
        known = f"only of the periods before {end}" if end else "nothing"
        raise SessionError(
            f"it was recorded from period {run.indices[0]} on, and of what was done before the file tells {known}"
        )


def _not_compared(run: Run, end: int, why: str) -> str:
    last = run.indices[-1]
    if last >= end:
        return f"periods {end} to {last} were not computed: {why}"
    return f"{run.missing} periods are missing in the file" if run.missing else ""


def _differing(payload: bytes, tick: Tick, *, of_truth: bool) -> list[str]:
    """The fields that differ from the recorded ones. ``of_truth``: also those of the ground truth."""
    now = msgspec.json.decode(msgspec.json.encode(tick_message(tick, 0, 0.0)))
    found: list[str] = []
    try:
        then = msgspec.json.decode(payload)
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:  # in fields that were not read before
        return [f"what was recorded of it cannot be read: {error}"]
    _compare(_bare(then, of_truth), _bare(now, of_truth), "", found)
    return found


def _bare(message: Json, of_truth: bool) -> Json:
    if not of_truth:
        robot = {name: value for name, value in _object(message, "robot").items() if name != "true_pose"}
        message = {**{name: value for name, value in message.items() if name not in _OF_TRUTH}, "robot": robot}
    plan = {name: value for name, value in _object(message, "plan").items() if name not in _NOT_COMPARED_OF_PLAN}
    return {**{name: value for name, value in message.items() if name not in _NOT_COMPARED}, "plan": plan}


def _object(message: Json, name: str) -> Json:
    found = message.get(name)
    return found if isinstance(found, dict) else {}


def _compare(then: Any, now: Any, place: str, found: list[str]) -> None:
    if then == now or len(found) >= MOST_FIELDS:
        return
    if isinstance(then, dict) and isinstance(now, dict):
        for name in {**then, **now}:
            if name in _ADDED and name not in then:
                continue
            inner = f"{place}.{name}" if place else name
            _compare(then.get(name), now.get(name), inner, found)
    elif isinstance(then, list) and isinstance(now, list) and len(then) == len(now):
        for index, (one, other) in enumerate(zip(then, now, strict=True)):
            _compare(one, other, f"{place}[{index}]", found)
    elif not _same_time(place, then, now):
        found.append(f"{place}: recorded {_short(then)}, now {_short(now)}")


def _same_time(place: str, then: Any, now: Any) -> bool:
    """True for equal times: older recordings have times that were not rounded."""
    both = isinstance(then, float) and isinstance(now, float)
    return both and place.rpartition(".")[2] == "time" and seconds(then) == now


def _short(value: Any) -> str:
    text = msgspec.json.encode(value).decode()
    return text if len(text) <= 60 else text[:57] + "..."
