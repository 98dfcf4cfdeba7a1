"""Measures of a trial from its Ticks: time by activity, smoothness, gripper-obstacle distance; and their report."""

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import shapely

from motm_twin.control.arm.parameters import AvoidanceParameters
from motm_twin.control.arm.types import Phase
from motm_twin.control.tick import Tick
from motm_twin.measures.agents import AmongPeople, Encounters
from motm_twin.measures.interval import STANDS, Interval, Sampler, finite
from motm_twin.model.geometry import Array
from motm_twin.model.scene import Scene
from motm_twin.model.scene_shapes import outline
from motm_twin.perception.mapper import MapSettings
from motm_twin.perception.tracks import TrackParameters

STATIC_AFTER = MapSettings().static_after  # [s] in one place, after which a body that never moved is static (Sec. V)
RESTS = TrackParameters().rests  # [s] the same for a body that has moved
CREEPS = 0.05  # [m] from its place of rest, beyond which a body has moved


@dataclass(frozen=True)
class Neighbour:
    """An unmapped obstacle relative to the gripper centre at the start of an interval."""

    name: str
    distance: float  # [m] in the plane, mean over the interval
    own: float  # [m/s] of the gripper towards the obstacle
    other: float  # [m/s] of the obstacle towards the gripper
    static: bool  # it cannot move, or has rested long enough, see `Rest`


@dataclass
class Rest:
    """Time that an agent has been in the same place; the loop's rule of static obstacles, applied to ground truth.

    An agent that has never moved is static after 3 s, one that has moved after `TrackParameters.rests`. It moves when
    it is `CREEPS` away from its place of rest. The loop knows only what it has seen: an agent that moved out of sight
    counts as moved here, and thus as moving for longer than in the loop.
    """

    place: Array  # [m], shape (2,)
    since: float  # [s]
    moved: bool = False

    def at(self, place: Array, time: float) -> bool:
        """Note the agent's position; True when it is static."""
        if math.dist(place, self.place) > CREEPS:
            self.place, self.since, self.moved = place, time, True
        return time - self.since >= (RESTS if self.moved else STATIC_AFTER)


@dataclass
class _Stretch:
    """Time during which the gripper is nearer than d_s to an obstacle."""

    time: float
    last: float
    least: float  # [m]
    other: str = ""
    static: bool = False
    own_moved: float = 0.0  # [m] of the gripper towards the other, until the least distance
    other_moved: float = 0.0
    _own: float = 0.0  # [m] the same until now
    _other: float = 0.0

    def add(self, interval: Interval, distance: float, nearest: Neighbour | None) -> None:
        self.last = interval.end.time
        if nearest is not None:
            self._own += nearest.own * interval.dt
            self._other += nearest.other * interval.dt
        if distance < self.least or not self.other:
            self.least = min(self.least, distance)
            self.own_moved, self.other_moved = self._own, self._other
            if nearest is not None:
                self.other, self.static = nearest.name, nearest.static

    def report(self) -> dict[str, Any]:
        return {
            "time": round(self.time, 2), "duration_s": round(self.last - self.time, 2), "min_m": round(self.least, 4),
            "other": self.other, "static": self.static, "gripper_moved_m": round(self.own_moved, 4),
            "other_moved_m": round(self.other_moved, 4),
            "cause": "gripper" if self.own_moved >= self.other_moved else self.other,
        }  # fmt: skip


@dataclass
class GripperObstacles:
    """Distance of the gripper centre to unmapped obstacles, all taken as tall (Paper, Sec. V).

    A stretch is the time in which the referee's distance is below d_s. Its cause is the one that approached more, from
    the interval in which d_s was crossed until the least distance: the gripper (arm and base together) or the other.
    "static": the other cannot move, or rests (`Rest`), so that a grasp beside it is allowed (d_s is then smaller).

    The gripper's own approach speed is its true velocity along the line to the other, over 50 ms; the damper line is
    xi (d - d_s) / (d_i - d_s) at the mean distance d of that time. Static obstacles do not count.
    """

    scene: Scene
    avoidance: AvoidanceParameters
    stretches: list[dict[str, Any]] = field(default_factory=list)
    least: float = math.inf
    excess: float = -math.inf  # [m/s] over the damper line
    advance_excess: float = -math.inf  # [m/s] over the line, or over 0 where the line demands a retreat
    _open: _Stretch | None = None
    _rests: dict[str, Rest] = field(default_factory=dict)  # by agent

    def __post_init__(self) -> None:
        solids = [solid for solid in self.scene.solids if not solid.mapped]
        self._solids = {solid.name: outline(solid.shape) for solid in solids}

    def add(self, interval: Interval) -> None:
        """Take an interval into account."""
        distance = interval.end.ee_obstacle
        below = distance < self.avoidance.d_s
        neighbours = self._agents(interval, any_distance=below)
        if below:
            neighbours += self._furniture(interval)
        self.least = min(self.least, distance)
        p = self.avoidance
        for neighbour in neighbours:
            if not neighbour.static and neighbour.distance < p.d_i:
                line = p.xi * (neighbour.distance - p.d_s) / (p.d_i - p.d_s)
                self.excess = max(self.excess, neighbour.own - line)
                self.advance_excess = max(self.advance_excess, neighbour.own - max(0.0, line))
        if below:
            self._open = self._open or _Stretch(interval.end.time, interval.end.time, distance)
            self._open.add(interval, distance, min(neighbours, key=lambda other: other.distance, default=None))
        elif self._open is not None:
            self.stretches.append(self._open.report())
            self._open = None

    def report(self) -> dict[str, Any]:
        """Least distance [m], stretches below d_s, largest excess of the approach speed [m/s]; None: nothing near."""
        stretches = [*self.stretches, *([self._open.report()] if self._open is not None else [])]
        return {
            "min_gripper_obstacle_m": finite(self.least, 4),
            "d_s_m": self.avoidance.d_s,
            "below_d_s": stretches,
            "approach_excess_mps": finite(self.excess, 4),
            "advance_excess_mps": finite(self.advance_excess, 4),
        }

    def _agents(self, interval: Interval, *, any_distance: bool) -> list[Neighbour]:
        """Agents nearer than d_i; ``any_distance``: also those farther away."""
        found = []
        for name, (x, y, radius) in interval.start.agents.items():
            velocity = interval.velocity(name)
            before = math.hypot(x - interval.start.gripper[0], y - interval.start.gripper[1])
            at = np.array([x, y]) + velocity * interval.dt
            rest = self._rests.setdefault(name, Rest(np.array([x, y]), interval.start.time))
            static = rest.at(at, interval.end.time)
            after = float(np.hypot(*(at - interval.end.gripper)))
            distance = max(0.0, 0.5 * (before + after) - radius)
            if distance >= self.avoidance.d_i and not any_distance:
                continue
            middle = 0.5 * (interval.start.gripper + interval.end.gripper)
            towards = np.array([x, y]) + 0.5 * velocity * interval.dt - middle
            normal = towards / max(float(np.hypot(*towards)), 1e-6)
            own, other = float(normal @ interval.gripper_velocity), -float(normal @ velocity)
            found.append(Neighbour(name, distance, own, other, static))
        return found

    def _furniture(self, interval: Interval) -> list[Neighbour]:
        """Solids of the scene that are not in the map."""
        middle = shapely.Point(0.5 * (interval.start.gripper + interval.end.gripper))
        found = []
        for name, polygon in self._solids.items():
            to = shapely.get_coordinates(shapely.shortest_line(middle, polygon))
            distance = float(np.hypot(*(to[1] - to[0])))
            normal: Array = (to[1] - to[0]) / max(distance, 1e-6)
            found.append(Neighbour(name, distance, float(normal @ interval.gripper_velocity), 0.0, True))
        return found


AT_LIMIT = 0.95  # share of the speed limit from which the base counts as driving at it
TURNING = math.radians(10.0)  # [rad/s] from which a slower base counts as turning
AT_REST = (Phase.STOW, Phase.CARRY)  # phases in which the arm has nothing to do
PHASES = ("driving", "waiting_for_arm", "stationary", "closing")
PARTS = ("at_limit", "below_limit", "turning", "reversing", "waiting_for_arm", "evading", "standing")


def waits_for_arm(interval: Interval) -> bool:
    """True when the base stands, and the arm is at work or its target is in reach."""
    step = interval.tick.arm[-1]
    return not interval.moving and (step.phase not in AT_REST or interval.tick.plan.time_to_range == 0.0)


def part_of(interval: Interval, v_f: float, *, evading: bool) -> str:
    """The one of `PARTS` to which an interval belongs; ``v_f`` [m/s] is the speed limit.

    In this order: evading (during an evasive manoeuvre, see `Encounters`), waiting for the arm, standing,
    reversing, at the limit (forward with at least 95 % of it; a curve at full speed costs its length only), turning
    (slower, with at least 10 deg/s), below the limit.
    """
    v, w = interval.twist
    if evading:
        return "evading"
    if not interval.moving:
        return "waiting_for_arm" if waits_for_arm(interval) else "standing"
    if v < -STANDS:
        return "reversing"
    if v >= AT_LIMIT * v_f:
        return "at_limit"
    return "turning" if abs(w) >= TURNING else "below_limit"


class TimeSplit:
    """Adds up the time by `PHASES` and by `PARTS`, and the speed of the base while the fingers close."""

    def __init__(self, v_f: float) -> None:
        self._v_f = v_f
        self._phases: dict[str, float] = dict.fromkeys(PHASES, 0.0)
        self._parts: dict[str, float] = dict.fromkeys(PARTS, 0.0)
        self._moving = self._whole = 0.0
        self._closing: list[tuple[float, float]] = []  # speed [m/s], duration [s]

    def add(self, interval: Interval, *, evading: bool) -> str:
        """Take an interval into account; returns the one of `PARTS` to which it belongs."""
        dt, steps = interval.dt, interval.tick.arm
        share = sum(step.phase == Phase.CLOSING for step in steps) / len(steps)  # of the interval with closing fingers
        self._whole += dt
        self._moving += dt * interval.moving
        self._phases["closing"] += share * dt
        rest = "driving" if interval.moving else "waiting_for_arm" if waits_for_arm(interval) else "stationary"
        self._phases[rest] += (1.0 - share) * dt
        part = part_of(interval, self._v_f, evading=evading)
        self._parts[part] += dt
        if share:
            self._closing.append((abs(interval.twist[0]), share * dt))
        return part

    def report(self) -> dict[str, Any]:
        """Both splits [s], base speed while closing [m/s], share of the time with the base moving."""
        return {
            "phases_s": {name: round(seconds, 4) for name, seconds in self._phases.items()},
            "parts_s": {name: round(seconds, 4) for name, seconds in self._parts.items()},
            "closing_base_speed_mps": self._closing_speed(),
            "moving_share": round(self._moving / self._whole, 4) if self._whole else None,
        }

    def _closing_speed(self) -> dict[str, float] | None:
        if not self._closing:
            return None
        speeds = [speed for speed, _ in self._closing]
        mean = sum(speed * seconds for speed, seconds in self._closing) / sum(seconds for _, seconds in self._closing)
        return {"mean": round(mean, 4), "min": round(min(speeds), 4), "max": round(max(speeds), 4)}


STEADY = math.radians(1.0)  # [rad/s] up to which a yaw rate counts as 0


class Smoothness:
    """Acceleration at the foot of the arm, and sign changes of the yaw rate per metre of path.

    The acceleration is that of the true position of the arm's foot in the plane, over two periods (100 ms).
    Yaw rates below 1 deg/s have no sign: a change goes from more than that on one side to more on the other.
    """

    def __init__(self) -> None:
        self._velocity: Array | None = None
        self._dt = 0.0
        self._accelerations: list[float] = []
        self._sign = 0
        self._changes = 0
        self._path = 0.0

    def add(self, interval: Interval) -> None:
        """Take an interval into account."""
        velocity = (interval.end.mount - interval.start.mount) / interval.dt
        if self._velocity is not None:
            between = 0.5 * (interval.dt + self._dt)
            self._accelerations.append(float(np.hypot(*(velocity - self._velocity))) / between)
        self._velocity, self._dt = velocity, interval.dt
        self._path += interval.path
        w = interval.twist[1]
        if abs(w) > STEADY:
            sign = int(math.copysign(1, w))
            self._changes += self._sign == -sign
            self._sign = sign

    def report(self) -> dict[str, Any]:
        """Largest and p99 acceleration [m/s^2], sign changes per metre [1/m]; None if the base did not drive."""
        felt = self._accelerations
        return {
            "arm_base_acceleration_mps2": {
                "max": round(max(felt), 4) if felt else None,
                "p99": round(float(np.percentile(felt, 99)), 4) if felt else None,
            },
            "yaw_sign_changes": self._changes,
            "yaw_sign_changes_per_m": round(self._changes / self._path, 4) if self._path > 0.0 else None,
        }


class Measures:
    """Add every Tick of a trial in order; the report is JSON: numbers, texts, lists and mappings."""

    def __init__(self, scene: Scene, avoidance: AvoidanceParameters) -> None:
        """``avoidance``: of the method's arm, for d_s and the damper line."""
        self._sampler = Sampler(scene)
        self._split = TimeSplit(scene.robot.base.forward_speed)
        self._encounters = Encounters(scene.robot.footprint)
        self._people = AmongPeople(scene)
        self._gripper = GripperObstacles(scene, avoidance)
        self._smoothness = Smoothness()
        self._legs: dict[int, dict[str, float]] = {}  # task: seconds of each part
        self._paths: dict[int, float] = {}  # task: path length [m]
        self._last: Tick | None = None

    def add(self, tick: Tick) -> None:
        """Take the next Tick into account."""
        self._last = tick
        interval = self._sampler.interval(tick)
        if interval is not None:
            self._encounters.add(interval)
            self._people.add(interval, waits_for_arm=waits_for_arm(interval))
            part = self._split.add(interval, evading=self._encounters.evading)
            self._gripper.add(interval)
            self._smoothness.add(interval)
            index = interval.tick.task_index
            self._legs.setdefault(index, dict.fromkeys(PARTS, 0.0))[part] += interval.dt
            self._paths[index] = self._paths.get(index, 0.0) + interval.path

    def report(self) -> dict[str, Any]:
        """All measures; times [s] of both splits and of the legs add up to the time of the last Tick."""
        tasks = self._last.tasks if self._last is not None else ()
        names = [(task.kind, task.target) for task in tasks] + [("done", "")]
        legs = [
            {
                "index": index, "task": names[index][0], "target": names[index][1],
                "time_s": round(sum(parts.values()), 4), "path_m": round(self._paths[index], 4),
                "parts_s": {part: round(seconds, 4) for part, seconds in parts.items() if seconds},
            }
            for index, parts in sorted(self._legs.items())
        ]  # fmt: skip
        return {
            **self._split.report(), **self._encounters.report(), "among_people": self._people.report(),
            **self._gripper.report(), **self._smoothness.report(),
            "retries": sum(max(0, task.attempts - 1) for task in tasks), "legs": legs,
        }  # fmt: skip
