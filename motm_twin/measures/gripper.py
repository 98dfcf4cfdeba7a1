"""The gripper and unmapped obstacles: distances, stretches below d_s and their cause, and the damper line."""

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import shapely

from motm_twin.control.arm.parameters import AvoidanceParameters
from motm_twin.measures.interval import Interval, finite
from motm_twin.model.geometry import Array
from motm_twin.model.scene import Scene
from motm_twin.model.scene_shapes import outline
from motm_twin.perception.mapper import MapSettings
from motm_twin.perception.movers import MoverParameters

STATIC_AFTER = MapSettings().static_after  # [s] in the same place: then what never moved is static (Paper, Sec. V)


@dataclass(frozen=True)
class Neighbour:
    """An unmapped obstacle relative to the gripper centre at the start of an interval."""

    name: str
    distance: float  # [m] in the plane, mean over the interval
    own: float  # [m/s] of the gripper towards it
    other: float  # [m/s] of it towards the gripper
    static: bool  # it cannot move, or has been in the same place for long enough, see `Rest`


@dataclass
class Rest:
    """Time that an agent has been in the same place; the loop's rule of static obstacles, applied to the truth.

    What has never moved is static after 3 s, what has moved after `MoverParameters.waits`. It moves when it is
    `MoverParameters.creeps` away from where it rested. The loop knows only what it saw: what moved out of its sight
    counts as moved here, and is judged as moving for longer than the loop takes it for.
    """

    place: Array  # [m], shape (2,)
    since: float  # [s]
    moved: bool = False

    def at(self, place: Array, time: float, movers: MoverParameters) -> bool:
        """Note its position; True when it is static."""
        if math.dist(place, self.place) > movers.creeps:
            self.place, self.since, self.moved = place, time, True
        return time - self.since >= (movers.waits if self.moved else STATIC_AFTER)


@dataclass
class _Stretch:
    """Time during which the gripper is nearer than d_s to something."""

    time: float
    last: float
    least: float  # [m]
    other: str = ""
    static: bool = False
    own_moved: float = 0.0  # [m] towards it, until the least distance
    other_moved: float = 0.0
    _own: float = 0.0  # the same until now
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

    A stretch is the time in which the referee's distance is below d_s. Its cause is whoever came nearer by more, from
    the interval in which d_s was crossed until the least distance: the gripper (arm and base together) or the other.
    "static": the other cannot move, or rests (`Rest`), so that a grasp beside it is allowed (its d_s shrinks then).

    The gripper's own approach speed is its true velocity along the line to the other, over 50 ms; the damper line is
    xi (d - d_s) / (d_i - d_s) at the mean distance d of that time. Only others that are not static count.
    """

    scene: Scene
    avoidance: AvoidanceParameters
    stretches: list[dict[str, Any]] = field(default_factory=list)
    least: float = math.inf
    excess: float = -math.inf  # [m/s] over the damper line
    advance_excess: float = -math.inf  # [m/s] over the line, or over 0 where it asks to retreat
    _open: _Stretch | None = None
    _movers: MoverParameters = field(default_factory=MoverParameters)
    _rests: dict[str, Rest] = field(default_factory=dict)  # of each agent

    def __post_init__(self) -> None:
        solids = [solid for solid in self.scene.solids if not solid.mapped]
        self._solids = {solid.name: outline(solid.shape) for solid in solids}

    def add(self, interval: Interval) -> None:
        """Take an interval into account."""
        distance = interval.end.ee_obstacle
        below = distance < self.avoidance.d_s
        neighbours = self._agents(interval, whatever=below)
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

    def _agents(self, interval: Interval, *, whatever: bool) -> list[Neighbour]:
        """Agents nearer than d_i; ``whatever``: those farther away, too."""
        found = []
        for name, (x, y, radius) in interval.start.agents.items():
            velocity = interval.velocity(name)
            before = math.hypot(x - interval.start.gripper[0], y - interval.start.gripper[1])
            at = np.array([x, y]) + velocity * interval.dt
            rest = self._rests.setdefault(name, Rest(np.array([x, y]), interval.start.time))
            static = rest.at(at, interval.end.time, self._movers)
            after = float(np.hypot(*(at - interval.end.gripper)))
            distance = max(0.0, 0.5 * (before + after) - radius)
            if distance >= self.avoidance.d_i and not whatever:
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
