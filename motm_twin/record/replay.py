"""Repeats a session: the same scene, edits and searches give the same state, bit for bit."""

import math
from collections.abc import Iterator

import msgspec

from motm_twin.completion import Completion
from motm_twin.control.method import Method
from motm_twin.control.tick import Tick
from motm_twin.methods.registry import METHODS
from motm_twin.model.names import hint
from motm_twin.model.state import state_hash
from motm_twin.model.twin_plant import ExternalPlant
from motm_twin.sessions.branches import Log
from motm_twin.sessions.session import Session, SessionError, differences, made_with
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
    """A twin at the start of the session, of another than the simulated robot when one is given.

    ``method``: of a user's file, for a session that was made with one. Raises SessionError when a parameter cannot be,
    or the method is not here: a name in a session is never a file to run.
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
    """Run a session again and compare; ``method`` as of `begin`. Raises SessionError when it cannot be run."""
    tracker, finish, twin, time = Tracker(), Completion(), None, 0.0
    for twin, tick in player(session, method=method):  # noqa: B007 - the last one is used
        tracker.add(tick)
        finish.add(tick)
        time = tick.time
    twin = twin or begin(session, method=method)
    now, parts = twin.state_hash(), part_hashes(twin)
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


def part_hashes(twin: Twin) -> dict[str, str]:
    """The first digits of the hash of every part of a twin."""
    return {name: state_hash(part.snapshot())[:PART_DIGITS] for name, part in twin.parts().items()}


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
