"""Cut-ins: the base passes closely in front of an agent that moves (Paper, Sec. VIII-1)."""

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numba import njit

from motm_twin.bench.measures.interval import Interval
from motm_twin.model.geometry import Array
from motm_twin.model.profile import Footprint

CUT_TIME, CUT_DISTANCE = 1.5, 1.0  # [s], [m] in front of an agent within which passing is cutting in
AGENT_MOVES = 0.1  # [m/s] from which an agent is one that can be cut in on
SIDEWAYS = 0.05  # [m/s] across the agent's way from which the base is crossing it
OWN_SHARE = 0.5  # of the way into the strip: more than this by its own motion, less by the agent's turning
PARTED = 1.2  # [m] of gap from which base and agent have parted, so that another cut-in counts
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
    """How the base stands to the strip that an agent sweeps when it goes straight on.

    The gap [m] between base and strip, negative inside, inf when no part of the base is ahead; and how far [m] the
    agent can go before it touches the base as it stands, inf when it passes. ``body`` [m]: its outline in the base
    frame, shape (n, 2); ``line``: x, y and course of the agent, shape (3,).
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


def compile_in_front() -> None:
    """Compile now, not at the first encounter."""
    in_front(np.ones((1, 2)), np.zeros(3), np.zeros(3), 0.1)


@dataclass(frozen=True)
class _Before:
    """One agent a period ago, and how the base stood to it."""

    line: Array  # x, y and course
    gap: float  # [m] between base and strip
    crossed: Array | None  # the line that the base got into by its own motion and is still crossing


@dataclass
class CutIns:
    """Counts how often the base passes closely in front of an agent that moves (0.1 m/s or more).

    The agent sweeps a strip when it goes straight on. A cut-in, all at once:

    - the base got into the strip by its own motion: in the period in which it got in, more than half of the way was
      its own, less than half came from the agent's turning; and the agent's course of then still leads to it;
    - it has been crossing the strip ever since, with more than 0.05 m/s across;
    - going on as it does, the agent would touch the base as it stands within 1 m and 1.5 s; and they close: along the
      agent's course the base is slower than it. One that leaves as fast as the agent follows cuts nobody off.

    Each agent counts once, until the gap between them is 1.2 m.
    """

    footprint: Footprint
    found: list[dict[str, Any]] = field(default_factory=list)
    _before: dict[str, _Before] = field(default_factory=dict)
    _counted: dict[str, dict[str, Any]] = field(default_factory=dict)  # agent: its cut-in, until they part

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
        """This agent is far away."""
        self._before.pop(name, None)
        self._counted.pop(name, None)

    def _crossed(self, name: str, pose: Array, line: Array, aside: float, radius: float) -> Array | None:
        """The agent's line when the base got into its strip by its own motion; None when it did not, or is outside."""
        before = self._before.get(name)
        if aside > 0.0 or before is None:
            return None
        if before.gap > 0.0:
            own = before.gap - in_front(self._outline, pose, before.line, radius)[0]
            return line if own > OWN_SHARE * (before.gap - aside) else None
        if before.crossed is None or in_front(self._outline, pose, before.crossed, radius)[0] > 0.0:
            return None  # the agent has turned after it since
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
