"""The base among agents: near misses, evasive manoeuvres, cut-ins; discomfort, freezing, and who made way.

Measures from social navigation: the comfort distance is that of CrowdNav (Chen et al., 2019); who made way is decided
by counterfactuals, in which one of the two keeps the motion that it had when the conflict began.
"""

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from motm_twin.measures.interval import Interval, finite
from motm_twin.model.compiler import njit
from motm_twin.model.geometry import Array, wrap_angle
from motm_twin.model.motion import arc
from motm_twin.model.profile import Footprint
from motm_twin.model.scene import AGENT_MOVES, Scene

APART = 0.5  # [s] after which a conflict with the same agent counts as new
NEAR, NEAR_END = 0.10, 0.20  # [m] gap that is a near miss, and gap at which it has ended
HORIZON, STEP = 2.0, 0.1  # [s] of prediction
CONFLICT = 0.30  # [m] predicted gap below which a reaction is needed
SLOWED = 0.15  # [m/s] by which the base slows when it gives way
TURNED = math.radians(15.0)  # [rad] turn off its former course by which the base gives way
TURNS = math.radians(10.0)  # [rad/s] a base that turns this fast is still turning away
FAR = 3.5  # [m] between base and agent, beyond which they are not predicted

Body = tuple[float, float, float]  # base body: offset of its centre, length, width [m]


@njit(cache=True)
def base_gap(body: Body, pose: Array | tuple[float, float, float], x: float, y: float, radius: float) -> float:
    """Gap [m] between the base body and a disc about (x, y), 0 when they overlap."""
    offset_x, length, width = body
    c, s = math.cos(pose[2]), math.sin(pose[2])
    dx, dy = x - pose[0], y - pose[1]
    along, across = c * dx + s * dy - offset_x, -s * dx + c * dy
    return max(math.hypot(max(abs(along) - 0.5 * length, 0.0), max(abs(across) - 0.5 * width, 0.0)) - radius, 0.0)


def body_of(foot: Footprint) -> Body:
    """The base body for the kernels."""
    return foot.offset_x, foot.length, foot.width


@njit(cache=True)
def predicted_gap(body: Body, pose: Array, twist: tuple[float, float], agent: Array, radius: float) -> float:
    """Smallest gap [m] over the next 2 s at constant velocities; ``agent``: x, y, and its velocity, shape (4,)."""
    v, w = twist
    least = np.inf
    for i in range(round(HORIZON / STEP) + 1):
        time = i * STEP
        there = arc(pose[0], pose[1], pose[2], v, w, time)
        least = min(least, base_gap(body, there, agent[0] + time * agent[2], agent[1] + time * agent[3], radius))
    return least


def compile_gaps() -> None:
    """Compile the kernels now instead of at the first encounter."""
    base_gap((0.0, 1.0, 1.0), np.zeros(3), 1.0, 1.0, 0.1)
    predicted_gap((0.0, 1.0, 1.0), np.zeros(3), (0.1, 0.1), np.ones(4), 0.1)
    in_front(np.ones((1, 2)), np.zeros(3), np.zeros(3), 0.1)
    time_to_collision((0.0, 1.0, 1.0), np.zeros(3), (0.1, 0.1), np.ones(4), 0.1)


@dataclass
class _Conflict:
    """A predicted close encounter with an agent, and the motion of the base at its beginning."""

    time: float
    heading: float
    twist: tuple[float, float]
    last: float  # last time at which it was predicted
    gave_way: float | None = None  # time at which the base gave way

    def evasion(self, name: str, end: float) -> list[dict[str, Any]]:
        """The evasive manoeuvre, if the base gave way."""
        if self.gave_way is None:
            return []
        duration = round(max(0.0, end - self.gave_way), 2)
        return [{"time": round(self.gave_way, 2), "duration_s": duration, "agent": name}]


@dataclass
class Encounters:
    """Counts encounters of the base with moving agents.

    Cut-in: see `CutIns`.

    Near miss: the gap between the base, while it moves, and an agent is less than 0.10 m; it ends at 0.20 m.

    Evasive manoeuvre: at constant velocities the gap would have fallen below 0.30 m within 2 s; and within
    these 2 s the base slowed by 0.15 m/s (not for an arm that is engaged with an object), or turned 15 deg away
    from its course. It lasts while the base is still that much slower or turns at 10 deg/s, and such a gap is
    predicted for its present motion, or, while it is slower, for its former speed; and 0.5 s more.
    """

    footprint: Footprint
    near_misses: list[dict[str, Any]] = field(default_factory=list)
    evasions: list[dict[str, Any]] = field(default_factory=list)
    _near: dict[str, dict[str, Any]] = field(default_factory=dict)  # agent: its near miss, until it has ended
    _conflicts: dict[str, _Conflict] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._body = body_of(self.footprint)
        self._cut_ins = CutIns(self.footprint)

    @property
    def evading(self) -> bool:
        """True during an evasive manoeuvre."""
        return any(conflict.gave_way is not None for conflict in self._conflicts.values())

    def add(self, interval: Interval) -> None:
        """Take an interval into account."""
        pose = interval.start.pose
        for name, (x, y, radius) in interval.start.agents.items():
            if math.hypot(x - pose[0], y - pose[1]) > FAR:
                self._end(name, interval.start.time)
                self._cut_ins.forget(name)
                continue
            agent = np.array([x, y, *interval.velocity(name).tolist()])
            gap = base_gap(self._body, pose, x, y, radius)
            self._cut_ins.add(interval, name, agent, radius, gap)
            self._near_miss(interval, name, gap)
            self._evade(interval, name, agent, radius)

    def report(self) -> dict[str, Any]:
        """Cut-ins, near misses and evasive manoeuvres, each with its time [s] and agent."""
        going_on = [each for name, open_ in self._conflicts.items() for each in open_.evasion(name, open_.last)]
        whole = [*self.evasions, *going_on]
        return {"cut_ins": self._cut_ins.found, "near_misses": self.near_misses, "evasive_manoeuvres": whole}

    def _near_miss(self, interval: Interval, name: str, gap: float) -> None:
        if gap > NEAR_END:
            self._near.pop(name, None)
        elif gap < NEAR and interval.moving:
            if name not in self._near:
                self._near[name] = {"time": round(interval.start.time, 2), "agent": name, "gap_m": round(gap, 3)}
                self.near_misses.append(self._near[name])
            self._near[name]["gap_m"] = min(self._near[name]["gap_m"], round(gap, 3))

    def _evade(self, interval: Interval, name: str, agent: Array, radius: float) -> None:
        time, pose, twist = interval.start.time, interval.start.pose, interval.twist
        near = predicted_gap(self._body, pose, twist, agent, radius) < CONFLICT
        conflict = self._conflicts.get(name)
        if conflict is None:
            if near and interval.moving:
                self._conflicts[name] = _Conflict(time, float(pose[2]), twist, time)
            return
        v, w = conflict.twist
        slowed = abs(v) - abs(twist[0]) > SLOWED and not interval.tick.arm[-1].engaged
        if conflict.gave_way is None and time - conflict.time <= HORIZON:
            off = abs(wrap_angle(float(pose[2]) - conflict.heading - w * (time - conflict.time)))
            if slowed or off > TURNED:
                conflict.gave_way = time
        if conflict.gave_way is not None and not slowed and abs(twist[1]) < TURNS:
            near = False  # it drives on beside the agent, as fast as before
        elif slowed and not near:
            near = predicted_gap(self._body, pose, (v, 0.0), agent, radius) < CONFLICT
        if near:
            conflict.last = time
        elif time - conflict.last > APART:
            self._end(name, time)

    def _end(self, name: str, time: float) -> None:
        conflict = self._conflicts.pop(name, None)
        if conflict is not None:
            self.evasions += conflict.evasion(name, time)


CUT_TIME, CUT_DISTANCE = 1.5, 1.0  # [s], [m] in front of an agent within which passing counts as cutting in
SIDEWAYS = 0.05  # [m/s] across the agent's way from which the base is crossing it
OWN_SHARE = 0.5  # least own share of the way into the strip; the rest is due to the agent's turning
PARTED = 1.2  # [m] gap beyond which a further cut-in counts
EDGE = 0.05  # [m] between points on the outline


def outline(footprint: Footprint) -> Array:
    """Points on the outline of the base body, 5 cm apart, base frame [m], shape (n, 2)."""
    half = 0.5 * np.array([footprint.length, footprint.width])
    x, y = (np.linspace(-h, h, max(2, math.ceil(2 * h / EDGE) + 1)) for h in half)
    sides = [np.column_stack([x, np.full_like(x, side)]) for side in (-half[1], half[1])]
    sides += [np.column_stack([np.full_like(y, side), y]) for side in (-half[0], half[0])]
    return np.concatenate(sides) + np.array([footprint.offset_x, 0.0])


@njit(cache=True)
def in_front(body: Array, pose: Array, line: Array, radius: float) -> tuple[float, float]:
    """Position of the base relative to the strip that an agent sweeps going straight on.

    The gap [m] between base and strip, negative inside, inf when no part of the base is ahead; and the distance [m]
    that the agent can go before it touches the base at its present pose, inf when it passes. ``body`` [m]: outline in
    the base frame, shape (n, 2); ``line``: x, y and course of the agent, shape (3,).
    """
    c, s = math.cos(pose[2]), math.sin(pose[2])
    along_x, along_y = math.cos(line[2]), math.sin(line[2])
    gap, way = np.inf, np.inf
    for i in range(body.shape[0]):
        dx = pose[0] + c * body[i, 0] - s * body[i, 1] - line[0]
        dy = pose[1] + s * body[i, 0] + c * body[i, 1] - line[1]
        ahead, aside = along_x * dx + along_y * dy, abs(along_x * dy - along_y * dx)
        if ahead > 0.0:
            gap = min(gap, aside - radius)
            if aside <= radius:
                way = min(way, max(ahead - math.sqrt(radius * radius - aside * aside), 0.0))
    return gap, way


@dataclass(frozen=True)
class _Before:
    """One agent in the period before, and its relation to the base."""

    line: Array  # x, y and course
    gap: float  # [m] between base and strip
    crossed: Array | None  # the agent's line when the base entered by its own motion; None: not crossing


@dataclass
class CutIns:
    """Counts how often the base passes closely in front of an agent that moves (0.1 m/s or more).

    The agent sweeps a strip when it goes straight on. A cut-in needs all of these:

    - the base entered the strip by its own motion: in the period of its entry more than half of the way was
      its own, less than half came from the agent's turning; and the agent's course of that time still leads to it;
    - it has been crossing the strip ever since, with more than 0.05 m/s across;
    - at constant velocity, the agent would touch the standing base within 1 m and 1.5 s; and they approach: along the
      agent's course the base is slower than the agent. A base that leaves as fast as the agent follows cuts nobody off.

    Each agent counts once, until the gap between them is 1.2 m.
    """

    footprint: Footprint
    found: list[dict[str, Any]] = field(default_factory=list)
    _before: dict[str, _Before] = field(default_factory=dict)
    _counted: dict[str, dict[str, Any]] = field(default_factory=dict)  # agent: its cut-in, until they have parted

    def __post_init__(self) -> None:
        self._outline = outline(self.footprint)

    def add(self, interval: Interval, name: str, agent: Array, radius: float, gap: float) -> None:
        """Take an interval into account; ``agent``: x, y and velocity, ``gap`` [m] between it and the base."""
        if gap > PARTED:
            self._counted.pop(name, None)
        speed = math.hypot(agent[2], agent[3])
        if speed < AGENT_MOVES:
            self._before.pop(name, None)
            return
        pose, line = interval.start.pose, np.array([agent[0], agent[1], math.atan2(agent[3], agent[2])])
        aside, way = in_front(self._outline, pose, line, radius)
        along, across = _speeds(interval, agent[2:] / speed)
        crossed = self._crossed(name, pose, line, aside, radius) if abs(across) > SIDEWAYS else None
        self._before[name] = _Before(line, aside, crossed)
        if crossed is not None and speed > along and way <= min(CUT_DISTANCE, CUT_TIME * speed):
            self._count(interval.start.time, name, way, speed)

    def forget(self, name: str) -> None:
        """Forget an agent that is far away."""
        self._before.pop(name, None)
        self._counted.pop(name, None)

    def _crossed(self, name: str, pose: Array, line: Array, aside: float, radius: float) -> Array | None:
        """The agent's line when the base entered its strip by its own motion; None otherwise, or outside."""
        before = self._before.get(name)
        if aside > 0.0 or before is None:
            return None
        if before.gap > 0.0:
            own = before.gap - in_front(self._outline, pose, before.line, radius)[0]
            return line if own > OWN_SHARE * (before.gap - aside) else None
        if before.crossed is None or in_front(self._outline, pose, before.crossed, radius)[0] > 0.0:
            return None  # the agent has since turned towards the base
        return before.crossed

    def _count(self, time: float, name: str, way: float, speed: float) -> None:
        cut = self._counted.get(name)
        if cut is None:
            cut = {"time": round(time, 2), "agent": name, "gap_m": round(way, 3), "gap_s": round(way / speed, 3)}
            self._counted[name] = cut | {"least_gap_m": round(way, 3)}
            self.found.append(self._counted[name])
        else:
            cut["least_gap_m"] = min(cut["least_gap_m"], round(way, 3))


def _speeds(interval: Interval, direction: Array) -> tuple[float, float]:
    """Mean speed [m/s] of the base along and across this direction."""
    x, y = ((interval.end.pose[:2] - interval.start.pose[:2]) / interval.dt).tolist()
    along_x, along_y = direction.tolist()
    return along_x * x + along_y * y, along_x * y - along_y * x


DISCOMFORT = 0.2  # [m] gap below which people feel uncomfortable (CrowdNav)
COLLISION_WITHIN, COLLISION_STEP = 5.0, 0.05  # [s] search for a collision at constant velocities
CLEAR_SHARE = 2.0 / 3.0  # share of the gained gap from which one of the two alone made way
GAINED = 0.05  # [m] gained by both together, below which nobody made way


@njit(cache=True)
def time_to_collision(body: Body, pose: Array, twist: tuple[float, float], agent: Array, radius: float) -> float:
    """Time [s] until base and agent touch at constant velocities; inf beyond 5 s.

    ``agent``: x, y, and its velocity, shape (4,).
    """
    v, w = twist
    for i in range(round(COLLISION_WITHIN / COLLISION_STEP) + 1):
        time = i * COLLISION_STEP
        there = arc(pose[0], pose[1], pose[2], v, w, time)
        if base_gap(body, there, agent[0] + time * agent[2], agent[1] + time * agent[3], radius) <= 0.0:
            return time
    return np.inf


@dataclass
class _Counterfactual:
    """A predicted conflict: the actual gap, and the gaps had base or agent kept its motion at ``time``."""

    time: float
    pose: Array
    twist: tuple[float, float]
    agent: Array  # x, y, and its velocity, shape (4,)
    predicted: float  # [m] gap
    actual: float = math.inf  # [m] least gap since then
    robot_alone: float = math.inf  # [m] the same, had the agent kept its motion
    agent_alone: float = math.inf  # [m] the same, had the base kept its motion

    def add(self, body: Body, time: float, pose: Array, agent: tuple[float, float, float]) -> None:
        """Update the gaps with the present places of both."""
        (x, y, radius), since = agent, time - self.time
        kept_x, kept_y = (self.agent[:2] + since * self.agent[2:]).tolist()
        kept = np.array(arc(*self.pose.tolist(), *self.twist, since))
        self.actual = min(self.actual, base_gap(body, pose, x, y, radius))
        self.robot_alone = min(self.robot_alone, base_gap(body, pose, kept_x, kept_y, radius))
        self.agent_alone = min(self.agent_alone, base_gap(body, kept, x, y, radius))

    def report(self, name: str) -> dict[str, Any]:
        """The conflict with the gaps [m] that each of the two gained by its change of motion, and who made way."""
        robot, agent = (max(0.0, gap - self.predicted) for gap in (self.robot_alone, self.agent_alone))
        whole = robot + agent
        if whole < GAINED:
            who = "nobody"
        elif robot >= CLEAR_SHARE * whole:
            who = "robot"
        else:
            who = "agent" if agent >= CLEAR_SHARE * whole else "both"
        return {
            "time": round(self.time, 2),
            "agent": name,
            "predicted_gap_m": round(self.predicted, 3),
            "gap_m": round(self.actual, 3),
            "gained_by_robot_m": round(robot, 3),
            "gained_by_agent_m": round(agent, 3),
            "made_way": who,
        }


@dataclass
class AmongPeople:
    """Measures of a base among agents; add every interval of a run in order.

    A conflict begins when at constant velocities the gap would fall below 0.30 m within 2 s, and lasts these 2 s. Base
    freezing: it stands during a task to drive, or during another task for a reason other than its arm.
    """

    scene: Scene
    conflicts: list[dict[str, Any]] = field(default_factory=list)
    _open: dict[str, _Counterfactual] = field(default_factory=dict)
    _least_gap: float = math.inf
    _least_time: float = math.inf
    _discomfort: float = 0.0
    _freezing: float = 0.0

    def __post_init__(self) -> None:
        self._body = body_of(self.scene.robot.footprint)

    def add(self, interval: Interval, *, waits_for_arm: bool) -> None:
        """Take an interval into account."""
        start, tick = interval.start, interval.tick
        drives = tick.task_index < len(tick.tasks) and tick.tasks[tick.task_index].kind == "drive_to"
        if not tick.done and not interval.moving and (drives or not waits_for_arm):
            self._freezing += interval.dt
        uneasy = False
        for name, (x, y, radius) in start.agents.items():
            gap = base_gap(self._body, start.pose, x, y, radius)
            self._least_gap = min(self._least_gap, gap)
            uneasy = uneasy or gap < DISCOMFORT
            self._conflict(interval, name)
            if gap > FAR:
                continue
            agent = np.array([x, y, *interval.velocity(name).tolist()])
            time = time_to_collision(self._body, start.pose, interval.twist, agent, radius)
            self._least_time = min(self._least_time, time)
        self._discomfort += interval.dt * uneasy

    def _conflict(self, interval: Interval, name: str) -> None:
        """Begin, follow or end the conflict with an agent."""
        start, known = interval.start, self._open.get(name)
        x, y, radius = start.agents[name]
        if known is not None:
            known.add(self._body, start.time, start.pose, start.agents[name])
            if start.time - known.time >= HORIZON - 1e-9:
                self.conflicts.append(self._open.pop(name).report(name))
            return
        if math.hypot(x - start.pose[0], y - start.pose[1]) > FAR:
            return
        agent = np.array([x, y, *interval.velocity(name).tolist()])
        moves = interval.moving or math.hypot(*agent[2:]) > 0.0
        gap = predicted_gap(self._body, start.pose, interval.twist, agent, radius)
        if moves and gap < CONFLICT:
            found = _Counterfactual(start.time, start.pose, interval.twist, agent, gap)
            found.add(self._body, start.time, start.pose, start.agents[name])
            self._open[name] = found

    def report(self) -> dict[str, Any]:
        """Least gap [m] and time to collision [s] (None: never within 5 s), seconds of discomfort and freezing."""
        going_on = [conflict.report(name) for name, conflict in self._open.items()]
        return {
            "least_gap_m": finite(self._least_gap, 3),
            "least_time_to_collision_s": finite(self._least_time, 3),
            "discomfort_s": round(self._discomfort, 2),
            "freezing_s": round(self._freezing, 2),
            "conflicts": [*self.conflicts, *going_on],
        }
