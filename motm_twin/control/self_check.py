"""Self-check: plausibility of the sensor data, and motion of the robot's parts against their commands.

Each check is a small function of its own (`perception.sweeps`, `perception.localisation_check`,
`perception.detection_check`, `control.motion_check`). Here they are run in order, and their findings become the inputs
of the loop: an observation without implausible data, and the share of its speed that the robot keeps.
"""

import math
from dataclasses import dataclass, field

import msgspec
import numpy as np

from motm_twin.control import motion_check
from motm_twin.control.motion_check import MotionSettings, MotionState
from motm_twin.control.reasons import STANDSTILL
from motm_twin.control.tick import Event
from motm_twin.model.geometry import Array, compose, inverse
from motm_twin.model.known import KnownWorld
from motm_twin.model.plant import Actuation, Detection, Observation, Scan
from motm_twin.model.reason import Kind, Reason
from motm_twin.model.state import Stateful
from motm_twin.perception import association, detection_check, localisation_check, scan_match
from motm_twin.perception.blind_sector import Outline, SectorSettings, SectorState, check_sector
from motm_twin.perception.detection_check import Beliefs, DetectionSettings, DetectionState, Screens
from motm_twin.perception.finding import Finding
from motm_twin.perception.localisation_check import LocalisationSettings, LocalisationState
from motm_twin.perception.objects import ObjectTracker
from motm_twin.perception.scan import RefusedScan, check_scan
from motm_twin.perception.scan_match import MatchSettings, MatchState
from motm_twin.perception.sweeps import SweepSettings, SweepState, check_sweep, map_segments


class Trust(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Share of its speed that the robot keeps, and the reason."""

    base: float = 1.0
    joints: Array | None = None  # shares of the joints' rates, shape (7,); None: all of them
    reason: Reason | None = None  # why the robot is slowed or stopped, or else why it does without some data
    scan: Reason | None = None  # why the newest sweep was not used
    lag: float = 0.0  # [s] by which the base follows its commands later than its profile says


FULL_TRUST = Trust()


class SelfCheckSettings(msgspec.Struct, frozen=True, kw_only=True):
    """Limits of all checks."""

    sweeps: SweepSettings = SweepSettings()
    sector: SectorSettings = SectorSettings()
    localisation: LocalisationSettings = LocalisationSettings()
    match: MatchSettings = MatchSettings()
    detections: DetectionSettings = DetectionSettings()
    motion: MotionSettings = MotionSettings()


@dataclass
class SelfCheckState:
    """Memory of all checks."""

    sector: SectorState
    sweep: SweepState = field(default_factory=SweepState)
    localisation: LocalisationState = field(default_factory=LocalisationState)
    match: MatchState = field(default_factory=MatchState)
    detection: DetectionState = field(default_factory=DetectionState)
    motion: MotionState = field(default_factory=MotionState)
    time: float | None = None
    of_scan: Finding | None = None  # about the newest sweep
    good: Scan | None = None  # newest sweep that is used
    waiting: Scan | None = None  # a sweep not used until the pose at which it was made is known
    findings: tuple[Finding, ...] = ()
    reported: tuple[tuple[str, str], ...] = ()  # kind and subject of the findings of the last period


class SelfCheck(Stateful[SelfCheckState]):
    """Turns reports of the robot into observations that control can rely on."""

    def __init__(
        self, known: KnownWorld, tracker: ObjectTracker, settings: SelfCheckSettings, *, slow_age: float
    ) -> None:
        """``tracker`` has the beliefs; ``slow_age`` [s] of a sweep or state from which the monitor slows the robot."""
        self._known, self._tracker = known, tracker
        self._settings, self._slow_age = settings, slow_age
        self._segments, self._screens = map_segments(known), Screens.of(known)
        self.outline = Outline.of(self._segments, self._settings.sector.bin)
        self._state = SelfCheckState(SectorState.of(known.robot.lidar.beams, int(self.outline.first[-1])))

    def adopt(self, state: SelfCheckState) -> None:
        """Go on from the state of a check with another map."""
        self.restore(state)
        self._state.sector.move_to(int(self.outline.first[-1]))

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Present findings, the worst first."""
        return self._state.findings

    def observed(self, now: Observation, held: str | None) -> Observation:
        """The trustworthy part of an observation, at the pose at which the scan fits the map."""
        if not _finite(now):
            return now  # the monitor stops the robot, and says so
        state, settings, robot = self._state, self._settings, self._known.robot
        local = state.localisation
        believed = localisation_check.correct(local, now, robot.base, settings.localisation)
        dt = 0.0 if state.time is None else max(0.0, now.time - state.time)
        state.time = now.time
        if now.age > self._slow_age:
            motion_check.skip(state.motion)
        else:
            motion_check.check_base(state.motion, now, dt, robot.base, settings.motion)
            motion_check.check_joints(state.motion, now, dt, settings.motion)
            motion_check.check_fingers(state.motion, now, robot, settings.motion)
        scan = self._usable_scan(now, believed)
        believed, scan = self._matched(believed, scan)
        seen = _shifted(now, believed)  # with detections in the odometry that is believed
        if state.detection.association.stamp > -math.inf:  # a camera that gives no names
            self._tracker.reconsider(seen, held)
        beliefs = Beliefs(self._tracker, seen, robot, settings.detections, self._known.bins, self._screens)
        detections = detection_check.checked(state.detection, seen, beliefs, held, robot, settings.detections)
        self._gather(now, seen, beliefs, held, detections)
        self._forget(now)
        if scan is seen.scan and detections is seen.detections:
            return seen
        return msgspec.structs.replace(seen, scan=scan, detections=detections)

    def _matched(self, believed: Observation, scan: Scan | None) -> tuple[Observation, Scan | None]:
        """The observation, and the sweep, at the pose that the map agrees with."""
        state, settings = self._state.match, self._settings.match
        scan_match.follow(state, believed, settings)
        if scan is not None:
            scan_match.match(state, scan, self._segments, settings)
            scan = msgspec.structs.replace(scan, pose=scan_match.corrected(state, scan.pose))
        pose = scan_match.corrected(state, believed.pose)
        return msgspec.structs.replace(believed, pose=pose, pose_sd=scan_match.sd(state)), scan

    def missed(self, name: str, place: Array, now: Observation) -> None:
        """Take note that the fingers closed on an object at a place (3,) [m], odometry frame, and held nothing."""
        found, settings = self._state.detection.association, self._settings.detections.association
        other = association.missed(found, name, place, self._tracker.places(now), settings)
        if other:
            self._tracker.exchange(name, other)

    def _forget(self, now: Observation) -> None:
        """Forget the sightings of objects that have long been in view without being reported."""
        found, settings = self._state.detection.association, self._settings.detections.association
        for name in association.disproved(found, now.time - now.ahead, settings):
            self._tracker.forget(name)

    def trust(self) -> Trust:
        """The share of its speed that the robot keeps, and the reason of the worst finding."""
        state = self._state
        if not state.findings:
            return FULL_TRUST
        motion, worst = state.motion, state.findings[0]
        stands = bool((np.abs(motion.expected) < STANDSTILL).all())
        joints = motion_check.joint_shares(motion, stands=stands)
        bad = state.of_scan
        return Trust(
            base=worst.base, joints=joints, reason=worst.consequence,
            scan=None if bad is None or bad.kind != Kind.SCAN_BAD else bad.reason, lag=motion_check.lag_of(motion),
        )  # fmt: skip

    @property
    def stuck_joint(self) -> int | None:
        """The joint that does not follow its commands, or lately went astray, counted from 0; None: all follow."""
        return motion_check.failing_joint(self._state.motion)

    @property
    def slips_since(self) -> float:
        """Time [s] at which the wheels were found to slip; -inf while they grip."""
        return localisation_check.slips_since(self._state.localisation)

    @property
    def astray(self) -> Array:
        """Joint rates that no recent command explains: their distance to those commanded [rad/s], shape (7,)."""
        return self._state.motion.astray

    def note_command(self, actuation: Actuation, now: Observation) -> None:
        """Remember a command, to compare the motion of the robot with it."""
        motion_check.note_command(self._state.motion, actuation, now)

    def events(self, time: float) -> list[Event]:
        """Findings that are new since the last period, and those that are over."""
        state = self._state
        now = {(one.kind, one.subject): one for one in state.findings}
        events = [
            Event(time=time, kind="fault", text=str(one.consequence))
            for key, one in now.items()
            if key not in state.reported
        ]
        ended = [(kind.replace("_", " "), subject) for kind, subject in state.reported if (kind, subject) not in now]
        events += [Event(time=time, kind="fault", text=f"ended: {kind} ({subject})") for kind, subject in ended]
        state.reported = tuple(now)
        return events

    def begin_from(self, twist: Array) -> None:
        """Expect this twist (2,) of a base that was not commanded for a while."""
        self._state.motion.expected = twist.copy()
        self._state.motion.commanded = twist.copy()

    def _usable_scan(self, now: Observation, believed: Observation) -> Scan | None:
        """The newest sweep that can be used, with the pose that is believed."""
        state, settings, scan = self._state, self._settings, now.scan
        local = state.localisation
        if scan is not None and scan.stamp != state.sweep.stamp:
            checked = check_scan(scan, self._known.robot.lidar, now.time)
            if isinstance(checked, RefusedScan):
                state.of_scan, state.sweep.stamp = Finding(reason=checked.reason), scan.stamp
            else:
                scan = _without_negative(scan)
                localisation_check.vote(local, scan, now, self._segments, settings.localisation)
                pose = localisation_check.carried(local, scan, now).pose
                odometry = believed.odometry
                state.of_scan = check_sweep(state.sweep, scan, pose, odometry, self._segments, settings.sweeps)
                sure = state.of_scan is None and local.mode == ""  # else the pose may be why the sweep misses the map
                at = pose if sure else None
                scan, half_blind = check_sector(state.sector, scan, at, self.outline, settings.sector)
                state.of_scan = state.of_scan or half_blind
                state.waiting = scan if state.of_scan is None or state.of_scan.base > 0.0 else None
        if state.waiting is not None and local.mode != "doubt":
            state.good, state.waiting = state.waiting, None
        return None if state.good is None else localisation_check.carried(local, state.good, now)

    def _old(self, now: Observation) -> list[Finding]:
        """Findings of an old sweep or state, for which the monitor slows and stops the robot."""
        state, found, limit = self._state, [], self._slow_age
        heard = 0.0 if state.good is None else now.time - now.ahead - state.good.stamp
        bad = state.of_scan is not None or state.localisation.mode == "doubt"
        ages = ((Kind.SCAN_OLD, "lidar", 0.0 if bad else heard), (Kind.STATE_OLD, "robot", now.age))
        for kind, subject, age in ages:
            if age > limit:
                found.append(Finding(reason=Reason(kind=kind, subject=subject, value=age, limit=limit, unit="s")))
        return found

    def _gather(
        self, now: Observation, seen: Observation, beliefs: Beliefs, held: str | None, kept: tuple[Detection, ...]
    ) -> None:
        """Collect the findings, the worst first; ``now`` as reported, ``seen`` in the odometry that is believed."""
        state, settings, base = self._state, self._settings, self._known.robot.base
        limit = localisation_check.limit_of(base, settings.localisation)
        local = localisation_check.finding(state.localisation, settings.localisation, limit)
        found = [one for one in (state.of_scan, local, *self._old(now)) if one is not None]
        found += motion_check.findings(state.motion, now, base, settings.motion)
        robot = self._known.robot
        found += detection_check.findings(state.detection, seen, beliefs, held, robot, settings.detections, kept)
        state.findings = tuple(sorted(found, key=lambda one: one.base))


def _shifted(now: Observation, believed: Observation) -> Observation:
    """The observation as it is believed, with its detections in the odometry that is believed."""
    if believed.odometry is now.odometry or not now.detections:
        return believed
    shift = compose(believed.odometry, inverse(now.odometry))
    moved = tuple(msgspec.structs.replace(one, odometry=compose(shift, one.odometry)) for one in now.detections)
    return msgspec.structs.replace(believed, detections=moved)


def _without_negative(scan: Scan) -> Scan:
    """The sweep with nan for beams that are out of order (negative ranges)."""
    bad = scan.ranges < 0.0
    return msgspec.structs.replace(scan, ranges=np.where(bad, np.nan, scan.ranges)) if bad.any() else scan


def _finite(now: Observation) -> bool:
    parts = (now.pose, now.odometry, now.twist, now.q, now.dq)
    return math.isfinite(now.time + sum(float(part.sum()) for part in parts))
