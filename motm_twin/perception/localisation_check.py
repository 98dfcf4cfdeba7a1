"""Check of localisation, odometry and scan against each other: of these three, two that agree are believed.

Odometry is smooth and drifts, localisation is right on average and may jump, and the scan fits the map at the true
pose. A dead-reckoned pose follows localisation slowly; when localisation departs from it by more than noise explains,
the scan decides which of the two is right.
"""

import math
from dataclasses import dataclass, field
from typing import Annotated

import msgspec
import numpy as np

from motm_twin.model.geometry import Array, compose, inverse, wrap_angle
from motm_twin.model.motion import drive
from motm_twin.model.number import OWN, Number
from motm_twin.model.plant import Observation, Scan
from motm_twin.model.profile import BaseLimits
from motm_twin.model.reason import Kind, Reason
from motm_twin.perception.finding import HALF, Finding
from motm_twin.perception.sweeps import REACH, map_fit


class LocalisationSettings(msgspec.Struct, frozen=True, kw_only=True):
    """Limits of the checks of localisation and odometry."""

    follow: Annotated[
        float, Number("s", OWN, "time constant with which the dead-reckoned pose follows localisation")
    ] = 2.0
    floor: Annotated[
        float,
        Number(
            "m",
            OWN,
            "distance from dead reckoning at which localisation is doubted: 5 sd of this project's noise; no healthy "
            "run gets there",
        ),
    ] = 0.05
    scale: Annotated[
        float, Number("", OWN, "error of odometry as a share of the way, added to `floor`: 4 sd of its scale")
    ] = 0.012
    heading: Annotated[
        float,
        Number(
            "rad",
            OWN,
            "turn from dead reckoning at which localisation is doubted: 6 sd of heading, and of the scale while "
            "turning",
        ),
    ] = 0.12
    least: Annotated[int, Number("", OWN, "beams that must meet mapped furniture before the scan can decide")] = 10
    better: Annotated[
        float, Number("", OWN, "difference of fit to the scan by which one pose must be better than the other")
    ] = 0.1
    fit_sd: Annotated[float, Number("m", OWN, "range error of a beam at which it fits badly")] = 0.1
    looks: Annotated[int, Number("", OWN, "sweeps that are compared with the map before localisation is judged")] = 2
    suspect: Annotated[
        float, Number("", OWN, "share of the distance that casts doubt, from which scan and map are compared")
    ] = 0.6
    enough: Annotated[
        float,
        Number(
            "", OWN, "share of the distance that casts doubt, from which the scan alone may find localisation wrong"
        ),
    ] = 0.8
    patience: Annotated[
        float,
        Number(
            "s",
            OWN,
            "time until doubted localisation is believed, nothing mapped in sight; a leap within half of it is a push",
        ),
    ] = 0.3
    reported_for: Annotated[
        float,
        Number(
            "s",
            OWN,
            "time for which a push, or leap of odometry, is reported; longest wait while the scan fits both poses",
        ),
    ] = 1.0
    blind_way: Annotated[
        float,
        Number(
            "m", OWN, "distance driven by odometry alone after which the robot stands: 1 % of it is more than a gap"
        ),
    ] = 10.0
    leap: Annotated[
        float, Number("m", OWN, "distance by which odometry may move more than the wheels can, before it is a leap")
    ] = 0.04


@dataclass
class LocalisationState:
    """Memory of the checks of localisation and odometry."""

    time: float | None = None
    raw: Array = field(default_factory=lambda: np.zeros(3))  # odometry as reported last
    odometry: Array = field(default_factory=lambda: np.zeros(3))  # the same, without jumps that no wheel can make
    pose: Array = field(default_factory=lambda: np.zeros(3))  # dead-reckoned
    localised: Array = field(default_factory=lambda: np.zeros(3))  # as reported last
    mode: str = ""  # "" | suspect | doubt | off | slip
    since: float = 0.0  # [s] start of the mode
    within: float | None = None  # [s] since when localisation has been near the dead-reckoned pose again
    leaps: list[tuple[float, float, float]] = field(default_factory=list)  # recent: [s], and leap [m], [rad]
    leapt: bool = False  # localisation departed in one leap
    votes: list[float] = field(default_factory=list)  # of each sweep: fit at localisation less that at dead reckoning
    slipped: float = 0.0  # [m] of localisation from dead reckoning when slip was decided
    way: float = 0.0  # [m] driven by odometry alone
    before: Array = field(default_factory=lambda: np.zeros(3))  # the world in the odometry frame when slip was decided
    notice: Finding | None = None  # reported before `until`
    until: float = 0.0  # [s]


def correct(
    state: LocalisationState, now: Observation, base: BaseLimits, settings: LocalisationSettings
) -> Observation:
    """The observation with the pose and odometry that are believed; the same object when nothing is wrong."""
    if state.time is None:
        state.raw, state.odometry = now.odometry.copy(), now.odometry.copy()
        state.pose, state.localised = now.pose.copy(), now.pose.copy()
        state.time = now.time
        return now
    dt = now.time - state.time
    way = _odometry(state, now, dt, base, settings)
    _reckon(state, now, dt, way, base, settings)
    state.time, state.localised = now.time, now.pose.copy()
    if state.notice is not None and now.time >= state.until:
        state.notice = None
    pose = now.pose
    if state.mode in ("doubt", "off"):
        pose = state.pose.copy()
    odometry = state.odometry.copy()
    if state.mode == "slip":
        odometry = compose(state.before, pose)
    if pose is now.pose and np.array_equal(odometry, now.odometry):
        return now
    return msgspec.structs.replace(now, pose=pose, odometry=odometry)


def carried(state: LocalisationState, scan: Scan, now: Observation) -> Scan:
    """The sweep with the pose that is believed; ``now`` as reported."""
    if state.mode not in ("doubt", "off"):
        return scan
    return msgspec.structs.replace(scan, pose=compose(compose(state.pose, inverse(now.pose)), scan.pose))


def vote(
    state: LocalisationState, scan: Scan, now: Observation, segments: Array, settings: LocalisationSettings
) -> None:
    """Compare the fit of a new sweep at localised and dead-reckoned pose; ``now`` and ``scan`` as reported."""
    if state.mode not in ("suspect", "doubt", "off") or not len(segments) or scan.stamp <= state.since:
        return
    believed = compose(compose(state.pose, inverse(now.pose)), scan.pose)
    reach = min(REACH, scan.range_max)
    fits = [
        map_fit(pose, scan.ranges, scan.angle_min, scan.angle_step, scan.origin, segments, reach, settings.fit_sd)
        for pose in (scan.pose, believed)
    ]
    if min(count for count, _ in fits) >= settings.least:
        state.votes = [*state.votes[1 - settings.looks :], fits[0][1] - fits[1][1]]
        if state.mode == "doubt":
            _decide(state, now, settings, away=True)


def finding(state: LocalisationState, settings: LocalisationSettings, limit: float) -> Finding | None:
    """Present finding about localisation or odometry; None if there is none. ``limit`` [m]: from `limit_of`."""
    if state.mode == "off":
        away = _apart(state.localised, state.pose)[0]
        lost = state.way > settings.blind_way
        kind, limit = (Kind.POSE_LOST, state.way) if lost else (Kind.POSE_OFF, limit)
        why = Reason(kind=kind, subject="localisation", value=away, limit=limit, unit="m")
        return Finding(reason=why, base=0.0 if lost else 1.0)
    if state.mode == "slip":
        away = max(state.slipped, _apart(state.localised, state.pose)[0])
        return Finding(reason=Reason(kind=Kind.SLIP, subject="wheels", value=away, limit=limit, unit="m"), base=HALF)
    return state.notice


def slips_since(state: LocalisationState) -> float:
    """Time [s] at which the wheels were found to slip; -inf while they grip."""
    return state.since if state.mode == "slip" else -math.inf


def limit_of(base: BaseLimits, settings: LocalisationSettings, now: Observation | None = None) -> float:
    """Distance [m] of localisation from dead reckoning that noise may explain; more if the report ``now`` is late."""
    late = 0.0 if now is None else now.ahead + now.age
    return settings.floor + base.forward_speed * (settings.scale * settings.follow + 0.2 * late)


def _odometry(
    state: LocalisationState, now: Observation, dt: float, base: BaseLimits, settings: LocalisationSettings
) -> Array:
    """Follow odometry, except for jumps that no wheel can make; returns the motion since the last observation, (3,)."""
    way = compose(inverse(state.raw), now.odometry)
    same = np.array_equal(state.odometry, state.raw)
    late = now.ahead + now.age
    fastest = base.full_speed
    most = 1.5 * fastest * max(dt, 0.0) + settings.leap + fastest * late
    leap = math.hypot(way[0], way[1])
    state.raw = now.odometry.copy()
    if leap > most:
        v, w = float(now.twist[0]), float(now.twist[1])
        way = drive(np.zeros(3), v, w, max(dt, 0.0))
        same = False
        state.notice = Finding(
            reason=Reason(kind=Kind.ODOMETRY_OFF, subject="odometry", value=leap, limit=most, unit="m")
        )
        state.until = now.time + settings.reported_for
    state.odometry = now.odometry.copy() if same else compose(state.odometry, way)
    return way


def _reckon(
    state: LocalisationState, now: Observation, dt: float, way: Array, base: BaseLimits, settings: LocalisationSettings
) -> None:
    """Move the dead-reckoned pose on, and change the mode when localisation departs from it or comes back."""
    state.pose = compose(state.pose, way)
    left, turned = _apart(now.pose, state.pose)
    step, turn = _apart(compose(inverse(state.localised), now.pose), way)
    state.leaps = [
        *(entry for entry in state.leaps if entry[0] > now.time - 0.5 * settings.patience),
        (now.time, step, turn),
    ]
    limit = limit_of(base, settings, now)
    away = left > limit or turned > settings.heading + 0.2 * base.yaw_rate * (now.ahead + now.age)
    if state.mode == "doubt":
        _decide(state, now, settings, away=away)
    elif state.mode == "off":
        state.way += math.hypot(way[0], way[1])
        _return(state, now, left < 0.8 * limit and turned < 0.8 * settings.heading, settings)
    elif state.mode in ("", "suspect") and away:
        votes = state.votes
        _change(state, "doubt", now.time)
        state.votes = votes
        state.leapt = any(step > 0.5 * limit or turn > 0.5 * settings.heading for _, step, turn in state.leaps)
    elif state.mode == "" and left > settings.suspect * limit:
        _change(state, "suspect", now.time)
    elif state.mode == "suspect" and left > settings.enough * limit and _verdict(state, settings) < 0:
        _change(state, "off", now.time)
        state.way = 0.0
    elif state.mode == "suspect" and left < 0.8 * settings.suspect * limit:
        _change(state, "", now.time)
    if state.mode in ("", "suspect", "slip"):
        _follow(state, now, 1.0 - math.exp(-max(dt, 0.0) / settings.follow))
    if state.mode == "slip":
        near = left < 0.5 * limit and turned < 0.5 * settings.heading
        state.within = (now.time if state.within is None else state.within) if near else None
        if state.within is not None and now.time - state.within > settings.reported_for:
            state.odometry = compose(state.before, now.pose)
            _change(state, "", now.time)


def _decide(state: LocalisationState, now: Observation, settings: LocalisationSettings, *, away: bool) -> None:
    """Decide why localisation departed: it is wrong, the robot was pushed, or its wheels slip."""
    left, _ = _apart(now.pose, state.pose)
    votes, waited = state.votes, now.time - state.since
    verdict = _verdict(state, settings)
    over = waited > (settings.reported_for if votes else settings.patience)
    if not away and waited > settings.patience:
        _change(state, "", now.time)
    elif verdict < 0:
        _change(state, "off", now.time)
        state.way = 0.0
    elif verdict > 0 or over:
        state.before = compose(state.odometry, inverse(state.pose))
        state.pose, state.slipped = now.pose.copy(), left
        if state.leapt:
            why = Reason(kind=Kind.PUSHED, subject="localisation", value=left, limit=settings.floor, unit="m")
            state.notice = Finding(reason=why)
            state.until = now.time + settings.reported_for
        _change(state, "" if state.leapt else "slip", now.time)


def _verdict(state: LocalisationState, settings: LocalisationSettings) -> int:
    """Verdict of the scan: 1 for localisation, -1 for dead reckoning, 0 undecided."""
    votes, total = state.votes, sum(state.votes)
    sure = len(votes) >= settings.looks and abs(total) > settings.better * len(votes)
    return int(math.copysign(1.0, total)) if sure else 0


def _return(state: LocalisationState, now: Observation, near: bool, settings: LocalisationSettings) -> None:
    """Believe localisation again once it stays near the dead-reckoned pose, or fits the scan better."""
    state.within = (now.time if state.within is None else state.within) if near else None
    votes = state.votes
    better = len(votes) >= settings.looks and min(votes) > settings.better
    if better or (state.within is not None and now.time - state.within > 0.5 * settings.patience):
        state.pose = now.pose.copy()
        _change(state, "", now.time)


def _change(state: LocalisationState, mode: str, time: float) -> None:
    state.mode, state.since, state.within, state.votes = mode, time, None, []


def _follow(state: LocalisationState, now: Observation, gain: float) -> None:
    dx, dy = now.pose[0] - state.pose[0], now.pose[1] - state.pose[1]
    turn = wrap_angle(float(now.pose[2] - state.pose[2]))
    state.pose = state.pose + gain * np.array([dx, dy, turn])
    state.pose[2] = wrap_angle(float(state.pose[2]))


def _apart(a: Array, b: Array) -> tuple[float, float]:
    """Distance [m] and angle [rad] between two poses (3,)."""
    return math.hypot(a[0] - b[0], a[1] - b[1]), abs(wrap_angle(float(a[2] - b[2])))
