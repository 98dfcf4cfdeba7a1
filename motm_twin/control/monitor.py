"""The monitor: the last check before the plant. It reads scan points, seen floor, tracks and trust, but no plans.

It limits an actuation, and slows or stops it for a reason: sensors not finite, scan or state too old, a finding of the
self-check, or a stop from the commanded speed that would meet scan points, unseen floor or a dynamic obstacle.
"""

import math
from dataclasses import dataclass, field
from typing import Annotated, NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from motm_twin.control.arm.parameters import Numbers, numbers
from motm_twin.control.self_check import FULL_TRUST, Trust
from motm_twin.model.compiler import njit
from motm_twin.model.geometry import Array
from motm_twin.model.motion import arc, lag_share, step
from motm_twin.model.number import OWN, Number, Slider
from motm_twin.model.passive_safety import (
    BRAKES_BOTH,
    HOLDS_SPEED,
    HOLDS_TURN,
    NO_ARM,
    STANDS,
    Stop,
    braked,
    followed,
    met_in_stop,
    overhang,
    stop_of,
)
from motm_twin.model.plant import PERIOD, SLOW_AGE, Actuation, Observation, Scan
from motm_twin.model.profile import DQ_MAX, RobotProfile
from motm_twin.model.reason import Kind, Reason
from motm_twin.model.state import Stateful
from motm_twin.perception.floor import STALE, UNSEEN, Floor
from motm_twin.perception.world_map import WorldMap

_MARGIN_OF_REACH = 0.1  # [m] beyond the stopping distance and the footprint: nothing further off can be met
_SAME_BODY = 0.15  # [m] between the points of neighbouring beams that show the same body
_ROUNDING = 1e-6  # [m] more than the rounding error of sums of lengths
_STANDS = 0.01  # [m/s], [rad/s] below which the braked one of speed and yaw rate counts as 0: the held one brakes next
_NOISE = 0.004  # [m/s], [rad/s] of a measured twist: a stop does not react to it
_SENSORS = Reason(kind=Kind.NOT_FINITE, subject="sensors are")
_NO_SCAN = Scan(
    stamp=0.0, ranges=np.empty(0), angle_min=0.0, angle_step=0.0, origin=np.zeros(2), range_min=0.0, range_max=0.0,
    pose=np.zeros(3),
)  # fmt: skip


class _Reported(NamedTuple):
    """The robot's report, as `_examine` reads it."""

    pose: Array
    odometry: Array
    twist: Array
    q: Array
    dq: Array


class _Asked(NamedTuple):
    """The command that is asked for, and the shares of it that are kept."""

    twist: Array
    rates: Array
    last: Array  # twist commanded before
    dt: float  # [s]
    share: float  # of the base
    arm_share: float


class _Beams(NamedTuple):
    """A scan, and the motion of the robot since then: from ``pose``, or with its measured twist for ``age``."""

    ranges: Array
    angle_min: float
    angle_step: float
    origin: Array
    pose: Array
    age: float  # [s]; negative: ``pose`` is used


class _InWay(NamedTuple):
    """Size of the footprint; margin and number of scan points from which its way counts as blocked."""

    corner: float  # [m] the furthest from the base's centre
    margin: float  # [m]
    enough: int  # points: fewer may be noise


class MonitorParameters(msgspec.Struct, frozen=True, kw_only=True):
    """Limits at which the monitor acts."""

    slow_age: Annotated[
        float,
        Number(
            "s",
            OWN,
            "age of a scan or state at which the base halves its speed; of a state, the arm slows, too; twice as "
            "old, they stand",
        ),
    ] = SLOW_AGE
    stop_margin: Annotated[
        float, Number("m", OWN, "distance between the footprint of the stopped base and scan points")
    ] = 0.01
    creep_speed: Annotated[
        float,
        Number(
            "m/s", OWN, "largest speed over floor that was seen, but not lately: a touch at this speed does no harm"
        ),
    ] = 0.1
    minimum_points: Annotated[
        int,
        Number("", OWN, "scan points inside the stopping footprint from which it counts as blocked: one may be noise"),
    ] = 2
    passive_safety: Annotated[
        bool,
        Number("", OWN, "the base stands before an obstacle that keeps its velocity can be there; the paper relies on "
               "those who yield"),
        Slider("Passive safety", "Safety",
            "The base stops before anything that keeps moving as it does can reach it, or gets out of its way.",
            paper=False),
    ] = False  # fmt: skip
    passive_margin: Annotated[
        float,
        Number("m", OWN, "distance from dynamic obstacles until the base stands; it grows with time, as they may turn"),
    ] = 0.08


class Verdict(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """The actuation that may be sent to the plant, and why it differs from the one asked for."""

    actuation: Actuation
    why: Reason | None

    @property
    def reason(self) -> str:
        """`why` in one sentence; "" for none."""
        return "" if self.why is None else str(self.why)


@dataclass
class MonitorState:
    """The last permitted twist, and the kind of stop before dynamic obstacles that was possible from it."""

    twist: Array = field(default_factory=lambda: np.zeros(2))
    kind: int = BRAKES_BOTH  # or `HOLDS_TURN`, `HOLDS_SPEED`: one is held until the other is 0


class Monitor(Stateful[MonitorState]):
    """Checks every actuation: finite numbers, limits, age of scan and state, and a stop in time."""

    def __init__(self, profile: RobotProfile, parameters: MonitorParameters | None = None) -> None:
        self.profile = profile
        self.parameters = parameters or MonitorParameters()
        body, self._base, p = profile.footprint, numbers(profile.base), self.parameters
        corner = float(np.hypot(0.5 * body.length + abs(body.offset_x), 0.5 * body.width))
        self._in_way = _InWay(corner, p.stop_margin, p.minimum_points)
        self._stop, self._mount = stop_of(profile, p.passive_margin), (profile.arm.mount_x, profile.arm.mount_y)
        self._state = MonitorState()

    @property
    def twist(self) -> Array:
        """The base twist commanded last, shape (2,)."""
        return self._state.twist.copy()

    def begin_from(self, twist: Array) -> None:
        """Begin from a measured twist (2,): the base was stopped while it was not commanded."""
        self._state.twist = twist.copy()

    def check(
        self, actuation: Actuation, observation: Observation, dt: float, *,
        scan_stamp: float | None, world: WorldMap | None = None, trust: Trust = FULL_TRUST,
    ) -> Verdict:  # fmt: skip
        """The actuation for the next dt [s], slowed where it must be.

        `scan_stamp` [s] is that of the newest scan found good; None: there was none yet, and the base stands. In a
        `world`, the base can always stop on floor that it has seen free, and, if passive safety is on, before dynamic
        obstacles; None: neither is known. `trust`: from the self-check.
        """
        share, reason = self._age(observation, scan_stamp, trust.scan)
        if trust.base < 1.0 and trust.base <= share:
            share, reason = trust.base, trust.reason
        now, scan = observation, observation.scan or _NO_SCAN
        twist, rates, stop = np.empty(2), np.empty(7), self._stop_with(trust.lag)
        asked = _Asked(
            actuation.twist, actuation.joint_velocity, self._state.twist, dt, share, self._arm_share(now.age)
        )
        healthy, turning, holding = _examine(
            _Reported(now.pose, now.odometry, now.twist, now.q, now.dq),
            asked,
            _beams_of(scan, now),
            self._base,
            stop,
            self._in_way,
            twist,
            rates,
        )
        if not healthy:
            return self._let_through(actuation, self._brake(dt, np.zeros(2)), np.zeros(7), _stopped(_SENSORS))
        if trust.joints is not None:
            rates *= trust.joints
        if share == 0.0 and trust.lag > 0.0:
            twist = self._brake(dt, observation.twist, trust.lag)
        if min(turning, holding) >= self.parameters.minimum_points:
            reason = self._braking(twist, observation)
            twist = self._brake(dt, observation.twist, trust.lag, twist[1] if holding < turning else 0.0)
        elif world is not None:
            twist, slower = self._in_seen_world(twist, world, observation, dt)
            reason = reason or slower  # a failing sensor is the cause of floor that it does not see
        verdict = self._let_through(actuation, twist, rates, reason)
        if trust.lag > 0.0:  # a command beyond zero only makes up for the lag: the next starts from zero
            self._state.twist = np.where(twist * observation.twist < 0.0, 0.0, twist)
        return verdict

    def _let_through(self, asked: Actuation, twist: Array, rates: Array, reason: Reason | None) -> Verdict:
        self._state.twist = twist
        return Verdict(actuation=msgspec.structs.replace(asked, twist=twist, joint_velocity=rates), why=reason)

    def _in_seen_world(
        self, twist: Array, world: WorldMap, observation: Observation, dt: float
    ) -> tuple[Array, Reason | None]:
        """The twist, slowed for unseen floor and for dynamic obstacles."""
        met = self._before_movers(twist, world, observation, dt)
        if met is not None:
            return met
        return (twist, None) if world.floor is None else self._on_seen_floor(twist, world.floor, observation, dt)

    def _before_movers(
        self, twist: Array, world: WorldMap, observation: Observation, dt: float
    ) -> tuple[Array, Reason] | None:
        """Next twist of a safe stop, and the reason; None while one of the three stops is still safe after ``twist``.

        The first stop that is safe now begins. If none is, because a dynamic obstacle has turned, the stop that was
        safe last begins: any other could lead anywhere.
        """
        if not self.parameters.passive_safety or not len(world.tracks) or not twist.any():
            self._state.kind = BRAKES_BOTH
            return None
        x, y, heading = observation.pose.tolist()
        state = x, y, heading, float(observation.twist[0]), float(observation.twist[1])
        since, tracks = observation.time - world.stamp, np.ascontiguousarray(world.tracks)
        arm = overhang(observation.q, self._mount, self._stop) if self.profile.has_arm else NO_ARM

        def met_by(commanded: Array, kind: int) -> int:
            return met_in_stop(state, (float(commanded[0]), float(commanded[1])), kind, since, tracks, arm, self._stop)

        met = met_by(twist, BRAKES_BOTH)
        if met < 0 or met_by(twist, HOLDS_TURN) < 0:
            self._state.kind = BRAKES_BOTH if met < 0 else HOLDS_TURN
            return None
        kinds = [BRAKES_BOTH, HOLDS_TURN]
        if self._has_room_to_hold_speed(world, observation):
            if met_by(twist, HOLDS_SPEED) < 0:
                self._state.kind = HOLDS_SPEED
                return None
            kinds.append(HOLDS_SPEED)
        there_x, there_y, vx, vy, radius = tracks[met, :5].tolist()
        away = math.hypot(there_x - x, there_y - y) - radius
        why = Reason(kind=Kind.MEETS_MOVER, subject="lidar", value=away, limit=math.hypot(vx, vy), unit="m")
        stops = {kind: self._stopping(observation.twist, dt, kind) for kind in kinds}
        kept = self._state.kind if self._state.kind in stops else BRAKES_BOTH
        self._state.kind = next((kind for kind, stop in stops.items() if met_by(stop, kind) < 0), kept)
        return stops[self._state.kind], why

    def _has_room_to_hold_speed(self, world: WorldMap, observation: Observation) -> bool:
        """Test that the base may hold its speed until it turns no more: on seen floor, and clear of scan points."""
        scan, base, enough = observation.scan, self.profile.base, self.parameters.minimum_points
        if scan is None or max(observation.ahead, observation.age) > 0.0:
            return False
        v, w = observation.twist.tolist()
        lasts = base.velocity_lag + abs(w) / base.yaw_acceleration
        reach = abs(v) * lasts + v * v / (2.0 * base.linear_acceleration) + self._in_way.corner + _MARGIN_OF_REACH
        points = _points_now(_beams_of(scan, observation), observation.pose, observation.twist, reach)
        poses = stopping_poses(observation.twist, observation.twist, HOLDS_SPEED, self._stop)
        if points_in_stop(points, poses, self._stop, self.parameters.stop_margin) >= enough:
            return False
        return world.floor is None or unseen_in_stop(observation.pose, poses, self._stop, world.floor)[0] < enough

    def _on_seen_floor(
        self, twist: Array, floor: Floor, observation: Observation, dt: float
    ) -> tuple[Array, Reason | None]:
        """The twist, slowed so that the base can stop on seen floor; on floor seen lately, unless it creeps."""
        enough, poses = (
            self.parameters.minimum_points,
            stopping_poses(observation.twist, twist, BRAKES_BOTH, self._stop),
        )
        unseen, stale = unseen_in_stop(observation.pose, poses, self._stop, floor)
        if unseen >= enough:
            return self._within_limits(np.zeros(2), dt), Reason(kind=Kind.FLOOR_UNSEEN, subject="lidar")
        creep = self.parameters.creep_speed
        fastest = max(abs(twist[0]), abs(twist[1]) * self._in_way.corner)
        if stale < enough or fastest <= creep:
            return twist, None
        why = Reason(kind=Kind.FLOOR_STALE, subject="lidar", value=fastest, limit=creep, unit="m/s")
        return self._within_limits(twist * (creep / fastest), dt), why

    def _age(
        self, observation: Observation, stamp: float | None, refused: Reason | None
    ) -> tuple[float, Reason | None]:
        """Share of its speed that the base keeps: less when the scan or the robot's own report is old.

        ``refused``: why the newest scan was not used; this is then the reason for an old scan.
        """
        if stamp is None:
            return 0.0, _stopped(refused or Reason(kind=Kind.NO_SCAN, subject="lidar"))
        scan_age = observation.time - observation.ahead - stamp
        p, age = self.parameters, max(scan_age, observation.age)
        if age <= p.slow_age:
            return 1.0, None
        limit = 2.0 * p.slow_age if age > 2.0 * p.slow_age else p.slow_age
        if observation.age > scan_age:
            why = Reason(kind=Kind.STATE_OLD, subject="robot", value=age, limit=limit, unit="s")
        else:
            why = refused or Reason(kind=Kind.SCAN_OLD, subject="lidar", value=age, limit=limit, unit="s")
        return (0.0, _stopped(why)) if age > 2.0 * p.slow_age else (0.5, _slowed(why, 0.5))

    def _arm_share(self, age: float) -> float:
        """Share of its speed that the arm keeps: it needs no scan, but its state.

        The share falls steadily while the state grows old. All joints slow down together, so the hand keeps to its way.
        """
        p = self.parameters
        return min(max(2.0 - age / p.slow_age, 0.0), 1.0)

    def _braking(self, twist: Array, observation: Observation) -> Reason:
        scan = observation.scan
        assert scan is not None
        ranges, v, base = scan.ranges, abs(float(twist[0])), self.profile.base
        points = near_points(ranges, scan.angle_min, scan.angle_step, scan.origin, self._in_way.corner)
        overlap = float(_depths(points, _bodies(points, self._stop), np.zeros(3), self._stop).max(initial=0.0))
        if overlap > 0.0:
            return Reason(kind=Kind.INSIDE_BASE, subject="lidar", value=overlap, unit="m")
        way = v * base.velocity_lag + v * v / (2.0 * base.linear_acceleration)
        nearest = float(ranges[ranges > scan.range_min].min(initial=math.inf))
        speeds = f"from {v:.2f} m/s and {abs(float(twist[1])):.1f} rad/s"
        return Reason(kind=Kind.IN_STOPPING_WAY, subject="lidar", other=speeds, value=nearest, limit=way, unit="m")

    def _within_limits(self, twist: Array, dt: float) -> Array:
        limited = np.empty(2)
        _limit(twist, self._state.twist, dt, self._base, limited)
        return limited

    def _stopping(self, twist: Array, dt: float, kind: int) -> Array:
        """The next command of a passively safe stop from a twist (2,), of a `kind`."""
        v, w = np.where(np.abs(twist) > _NOISE, twist, 0.0).tolist()
        (v_cmd, w_cmd), base = self._state.twist.tolist(), self.profile.base
        share = lag_share(base.velocity_lag, dt)
        back = base.reverse_speed if v > 0.0 else math.inf
        v_next, w_next = v_cmd, w_cmd
        if kind != HOLDS_SPEED or abs(w) <= _STANDS:
            v_next = braked(v_cmd, v, base.linear_acceleration * dt, back, share)
        if kind != HOLDS_TURN or abs(v) <= _STANDS:
            w_next = braked(w_cmd, w, base.yaw_acceleration * dt, math.inf, share)
        return self._within_limits(np.array([v_next, w_next]), dt)

    def _brake(self, dt: float, measured: Array, lag: float = 0.0, turn: float = 0.0) -> Array:
        """The next twist of a stop, which may hold a ``turn`` [rad/s].

        A base that is known to follow later by ``lag`` [s] is commanded to slow down as fast as its limits allow.
        """
        ramp, base = self._within_limits(np.array([0.0, turn]), dt), self.profile.base
        if lag == 0.0:
            return ramp
        speed, way = np.abs(measured), np.sign(measured)
        most = np.minimum(dt * np.array([base.linear_acceleration, base.yaw_acceleration]), speed)
        slower = speed - most / lag_share(base.velocity_lag + lag, dt)
        hard = np.where(speed > _STANDS, way * np.minimum(slower, np.maximum(way * ramp, 0.0)), 0.0)
        hard[0] = min(max(hard[0], -base.reverse_speed), base.forward_speed)
        hard[1] = ramp[1] if turn != 0.0 else min(max(hard[1], -base.yaw_rate), base.yaw_rate)
        return hard

    def _stop_with(self, lag: float) -> Stop:
        """The stop of a base that follows later by ``lag`` [s]."""
        if lag == 0.0:
            return self._stop
        return self._stop._replace(share=lag_share(self.profile.base.velocity_lag + lag, PERIOD))


def _stopped(why: Reason) -> Reason:
    return Reason(kind=Kind.STOPPED, subject=why.subject, cause=why)


def _slowed(why: Reason, share: float) -> Reason:
    return Reason(kind=Kind.SLOWED, subject=why.subject, value=share, cause=why)


def _beams_of(scan: Scan, now: Observation) -> _Beams:
    age = -1.0 if max(now.ahead, now.age) > 0.0 else max(now.time - scan.stamp, 0.0)
    return _Beams(scan.ranges, scan.angle_min, scan.angle_step, scan.origin, scan.pose, age)


@njit(cache=True)
def _examine(
    robot: _Reported,
    asked: _Asked,
    beams: _Beams,
    base: Numbers,
    stop: Stop,
    in_way: _InWay,
    twist: Array,
    rates: Array,
) -> tuple[bool, int, int]:
    """Fill in a share of the asked twist (2,) and rates (7,) within the limits; returns health and two counts.

    Health: True for sensors that are finite. Counts: `points_in_stop` of a scan, for a stop that brakes the turn, and
    for one that holds it. The second is computed only if the first has enough points: a base that turns away from an
    obstacle may have to keep turning while it brakes.
    """
    if not (
        _finite(robot.pose) and _finite(robot.odometry) and _finite(robot.twist) and _finite(robot.q)
        and _finite(robot.dq)
    ):  # fmt: skip
        return False, 0, 0
    for k in range(2):
        twist[k] = 0.0 if asked.share == 0.0 else asked.share * asked.twist[k]
    _limit(twist, asked.last, asked.dt, base, twist)
    for k in range(rates.shape[0]):
        rates[k] = asked.arm_share * min(max(asked.rates[k], -DQ_MAX[k]), DQ_MAX[k])
    if beams.ranges.shape[0] == 0 or (twist[0] == 0.0 and twist[1] == 0.0):
        return True, -1, -1
    v = max(abs(twist[0]), abs(robot.twist[0]))
    reach = v * PERIOD / stop.share + v * v / (2.0 * stop.linear) + in_way.corner + _MARGIN_OF_REACH
    points = _points_now(beams, robot.pose, robot.twist, reach)
    turning = points_in_stop(
        points, stopping_poses(robot.twist, twist, np.int64(BRAKES_BOTH), stop), stop, in_way.margin
    )
    if turning < in_way.enough:
        return True, turning, turning
    poses = stopping_poses(robot.twist, twist, np.int64(HOLDS_TURN), stop)
    return True, turning, points_in_stop(points, poses, stop, in_way.margin)


@njit(cache=True)
def _points_now(beams: _Beams, pose: Array, twist: Array, reach: float) -> Array:
    """Scan points within `reach` [m] of the base, in the frame of its present pose; shape (m, 2).

    Within a period of 50 ms a scan grows 40 ms old, in which a corner of a base that turns moves by centimetres.
    """
    then, now = beams.pose, pose
    if beams.age >= 0.0:
        then, now = np.zeros(3), np.array(arc(0.0, 0.0, 0.0, twist[0], twist[1], beams.age))
    farther = math.hypot(now[0] - then[0], now[1] - then[1])
    points = near_points(beams.ranges, beams.angle_min, beams.angle_step, beams.origin, reach + farther)
    _carry(points, then, now)
    return points


@njit(cache=True)
def _carry(points: Array, pose: Array, now: Array) -> None:
    """Transform points (m, 2), in place, from the frame of one base pose to that of another."""
    c, s, back_c, back_s = math.cos(pose[2]), math.sin(pose[2]), math.cos(now[2]), math.sin(now[2])
    for i in range(points.shape[0]):
        x, y = points[i, 0], points[i, 1]
        dx, dy = pose[0] + c * x - s * y - now[0], pose[1] + s * x + c * y - now[1]
        points[i, 0], points[i, 1] = back_c * dx + back_s * dy, -back_s * dx + back_c * dy


@njit(cache=True)
def _finite(values: Array) -> bool:
    for value in values:
        if not math.isfinite(value):
            return False
    return True


@njit(cache=True)
def _limit(twist: Array, last: Array, dt: float, base: Numbers, limited: Array) -> None:
    """Fill in a twist (2,) within one step's acceleration of the last one, and within the speed limits."""
    b = base[0]
    dv, dw = b.linear_acceleration * dt, b.yaw_acceleration * dt
    v = min(max(twist[0], last[0] - dv), last[0] + dv)
    w = min(max(twist[1], last[1] - dw), last[1] + dw)
    limited[0] = min(max(v, -b.reverse_speed), b.forward_speed)
    limited[1] = min(max(w, -b.yaw_rate), b.yaw_rate)


@njit(cache=True)
def near_points(ranges: Array, angle_min: float, angle_step: float, origin: Array, reach: float) -> Array:
    """Scan points within `reach` [m] of the base's centre, base frame, shape (m, 2)."""
    points = np.empty((ranges.shape[0], 2))
    count = 0
    farthest = reach + math.hypot(origin[0], origin[1]) + _ROUNDING
    for i in range(ranges.shape[0]):
        if not ranges[i] < farthest:
            continue
        angle = angle_min + i * angle_step
        x = origin[0] + ranges[i] * math.cos(angle)
        y = origin[1] + ranges[i] * math.sin(angle)
        if x * x + y * y < reach * reach:
            points[count, 0] = x
            points[count, 1] = y
            count += 1
    return points[:count]


@njit(cache=True)
def stopping_poses(twist: Array, commanded: Array, kind: int, stop: Stop) -> Array:
    """Poses of a base that begins to brake, every 50 ms, in its own frame; shape (k, 3).

    ``twist`` (2,): measured; ``commanded`` (2,): commanded last. It falls as fast as the limits allow. The base
    follows with its lag, from its measured speed if that is higher than commanded, else from the command. ``kind``:
    see `model.passive_safety.met_in_stop`.
    """
    v_cmd, w_cmd = commanded[0], commanded[1]
    v, w = _faster(twist[0], v_cmd), _faster(twist[1], w_cmd)
    x, y, heading = 0.0, 0.0, 0.0
    poses = [(x, y, heading)]
    while max(abs(v), abs(w)) >= STANDS or v_cmd != 0.0 or w_cmd != 0.0:
        brakes_v, brakes_w = kind != HOLDS_SPEED or w_cmd == 0.0, kind != HOLDS_TURN or v_cmd == 0.0
        if brakes_v:
            v_cmd = math.copysign(max(abs(v_cmd) - stop.linear * PERIOD, 0.0), v_cmd)
        if brakes_w:
            w_cmd = math.copysign(max(abs(w_cmd) - stop.turning * PERIOD, 0.0), w_cmd)
        v_now = followed(v, v_cmd, stop.linear * PERIOD, stop.share)
        w_now = followed(w, w_cmd, stop.turning * PERIOD, stop.share)
        x, y, heading = step(x, y, heading, v, w, v_now, w_now, PERIOD)
        v, w = v_now, w_now
        poses.append((x, y, heading))
    return np.array(poses)


@njit(cache=True)
def _faster(measured: float, commanded: float) -> float:
    """The measured or the commanded speed, whichever is higher in the direction of the command."""
    return measured if measured * commanded > 0.0 and abs(measured) > abs(commanded) + _NOISE else commanded


@njit(cache=True)
def points_in_stop(points: Array, poses: Array, stop: Stop, margin: float) -> int:
    """Largest number of points (m, 2) that the footprint comes too near to at one of the `stopping_poses` (k, 3).

    A point outside the margin [m] may not come inside it, one inside the margin no nearer. A body in the footprint may
    not get deeper into it; if it does, all points count.
    """
    allowed = np.empty(points.shape[0])
    for i in range(points.shape[0]):
        allowed[i] = min(margin, _room(points[i, 0], points[i, 1], stop) - _ROUNDING)
    body = _bodies(points, stop)
    deep = _depths(points, body, poses[0], stop) + _ROUNDING
    worst = 0
    for k in range(1, poses.shape[0]):
        if (_depths(points, body, poses[k], stop) > deep).any():
            return points.shape[0]
        c, s, count = math.cos(poses[k, 2]), math.sin(poses[k, 2]), 0
        for i in range(points.shape[0]):
            if body[i] >= 0:
                continue
            dx, dy = points[i, 0] - poses[k, 0], points[i, 1] - poses[k, 1]
            if _room(c * dx + s * dy, c * dy - s * dx, stop) < allowed[i]:
                count += 1
        worst = max(worst, count)
    return worst


def unseen_in_stop(pose: Array, poses: Array, stop: Stop, floor: Floor) -> tuple[int, int]:
    """Largest numbers of outline points of the footprint over unseen and stale floor at one of the poses (k, 3).

    ``poses``: `stopping_poses`; ``pose``: of the base now, shape (3,). Floor outside the kept grid is not tested.
    """
    return count_unseen(pose, poses, stop, floor.seen, np.array([*floor.corner, floor.resolution]))


@njit(cache=True)
def count_unseen(pose: Array, poses: Array, stop: Stop, seen: NDArray[np.uint8], frame: Array) -> tuple[int, int]:
    """Kernel of `unseen_in_stop`; ``frame``: corner of the floor (x, y) and its resolution [m]."""
    along, across = math.ceil(2.0 * stop.half_length / frame[2]), math.ceil(2.0 * stop.half_width / frame[2])
    outline = np.empty((2 * (along + across), 2))
    for i in range(along):
        shift = i * 2.0 * stop.half_length / along
        outline[2 * i, 0], outline[2 * i, 1] = stop.offset - stop.half_length + shift, stop.half_width
        outline[2 * i + 1, 0], outline[2 * i + 1, 1] = stop.offset + stop.half_length - shift, -stop.half_width
    for i in range(across):
        k, shift = 2 * (along + i), i * 2.0 * stop.half_width / across
        outline[k, 0], outline[k, 1] = stop.offset + stop.half_length, stop.half_width - shift
        outline[k + 1, 0], outline[k + 1, 1] = stop.offset - stop.half_length, shift - stop.half_width
    c0, s0 = math.cos(pose[2]), math.sin(pose[2])
    never, late = 0, 0
    for k in range(1, poses.shape[0]):
        x, y = pose[0] + c0 * poses[k, 0] - s0 * poses[k, 1], pose[1] + s0 * poses[k, 0] + c0 * poses[k, 1]
        c, s = math.cos(pose[2] + poses[k, 2]), math.sin(pose[2] + poses[k, 2])
        unseen, stale = 0, 0
        for i in range(outline.shape[0]):
            px, py = x + c * outline[i, 0] - s * outline[i, 1], y + s * outline[i, 0] + c * outline[i, 1]
            row, column = math.floor((py - frame[1]) / frame[2]), math.floor((px - frame[0]) / frame[2])
            if 0 <= row < seen.shape[0] and 0 <= column < seen.shape[1]:
                unseen += seen[row, column] == UNSEEN
                stale += seen[row, column] == STALE
        never, late = max(never, unseen), max(late, stale)
    return never, late


@njit(cache=True)
def _room(x: float, y: float, stop: Stop) -> float:
    """Room [m] between a point in the base frame and the footprint, by its nearest side; negative inside."""
    return max(abs(x - stop.offset) - stop.half_length, abs(y) - stop.half_width)


@njit(cache=True)
def _bodies(points: Array, stop: Stop) -> NDArray[np.int64]:
    """Index of the body in the footprint that each point (m, 2), in the order of the beams, belongs to; -1: none."""
    body = np.full(points.shape[0], -1)
    count = 0
    for i in range(points.shape[0]):
        if _room(points[i, 0], points[i, 1], stop) >= 0.0:
            continue
        same = i > 0 and body[i - 1] >= 0
        if same:
            same = math.hypot(points[i, 0] - points[i - 1, 0], points[i, 1] - points[i - 1, 1]) < _SAME_BODY
        if not same:
            count += 1
        body[i] = count - 1
    return body


@njit(cache=True)
def _depths(points: Array, body: NDArray[np.int64], pose: Array, stop: Stop) -> Array:
    """Least shift [m] of the footprint at a pose (3,), square to a side, that clears each body; shape (k,)."""
    c, s, length, width = math.cos(pose[2]), math.sin(pose[2]), stop.half_length, stop.half_width
    sides = np.zeros((max(body.max() + 1, 0) if body.shape[0] else 0, 4))
    for i in range(points.shape[0]):
        if body[i] < 0:
            continue
        dx, dy = points[i, 0] - pose[0], points[i, 1] - pose[1]
        along, across = c * dx + s * dy - stop.offset, c * dy - s * dx
        if abs(along) < length and abs(across) < width:
            side = sides[body[i]]
            side[0], side[1] = max(side[0], length - along), max(side[1], length + along)
            side[2], side[3] = max(side[2], width - across), max(side[3], width + across)
    depths = np.empty(sides.shape[0])
    for k in range(sides.shape[0]):
        depths[k] = sides[k].min()
    return depths
