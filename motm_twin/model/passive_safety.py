"""Passive safety: the base is at rest before a dynamic obstacle can reach it, or else is moving away from it.

The rule is that of Bouraine, Fraichard and Salhi (Autonomous Robots 32, 2012): a state is safe when braking from it
leads to rest before a collision. Every dynamic obstacle goes on straight at the velocity that the lidar has measured,
for as long as the base needs to stop: no prediction is needed beyond that. The margin grows with time, to allow for
turns. The arm counts where it reaches beyond the footprint in its present posture. A stop is predicted with the full
lag of the base, but driven with a slightly reversed last command (`braked`), so the base stops sooner than predicted.
"""

import math
from typing import NamedTuple

import numpy as np

from motm_twin.model.arm_kernels import CAPSULE_RADII, capsule_segments, fk_arm
from motm_twin.model.compiler import njit
from motm_twin.model.geometry import Array
from motm_twin.model.motion import kernel, lag_share, step
from motm_twin.model.plant import PERIOD
from motm_twin.model.profile import RobotProfile

ROUNDING = 1e-6  # [m]
VEERS = 0.2  # [m/s^2] acceleration with which obstacles may speed up or turn while the base stops
NO_ARM = np.empty((0, 3))
STANDS = 1e-3  # [m/s], [rad/s] below which a base stands


BRAKES_BOTH, HOLDS_TURN, HOLDS_SPEED = range(3)  # modes of a stop: turn or speed may be held until the other one is 0


State = tuple[float, float, float, float, float]  # x, y [m], heading [rad], v [m/s], w [rad/s]


class Stop(NamedTuple):
    """Deceleration and size of a base that stops, and its margin."""

    linear: float  # deceleration [m/s^2]
    turning: float  # [rad/s^2]
    share: float  # of the gap between speed and command, closed by the base in a period: first-order lag
    half_length: float  # of the footprint [m]
    half_width: float
    offset: float  # of its centre [m]
    margin: float  # [m]


def stop_of(robot: RobotProfile, margin: float) -> Stop:
    """The stop of a robot, with a ``margin`` [m] to dynamic obstacles."""
    base, body = robot.base, robot.footprint
    share = lag_share(base.velocity_lag, PERIOD)
    return Stop(
        base.linear_acceleration, base.yaw_acceleration, share, 0.5 * body.length, 0.5 * body.width,
        body.offset_x, margin,
    )  # fmt: skip


def braked(commanded: float, speed: float, most: float, back: float, share: float) -> float:
    """Next command of a stop, after ``commanded``; command and speed change by at most ``most`` per period.

    A base that closes a ``share`` of the gap to its command in each period creeps on for long after a command of zero.
    So the command goes beyond zero, by at most ``back``: as far as it can return from by the time the base stands.
    """
    if most <= 0.0:
        return commanded
    beyond, above, below = 0.0, 0.0, 0.0  # steps beyond zero; largest speeds that beyond + 1 and beyond steps can stop
    while True:
        above = below + min(most, share * (below + (beyond + 1.0) * most) / (1.0 - share)) if share < 1.0 else math.inf
        if above >= abs(speed) or beyond * most >= back:
            break
        beyond, below = beyond + 1.0, above
    beyond += (abs(speed) - below) / (above - below)
    beyond = min(beyond * most, abs(speed) * (1.0 - share) / share, back)
    return commanded + min(most, max(-most, math.copysign(beyond, -speed) - commanded))


@njit(cache=True)
def overhang(q: Array, mount: tuple[float, float], stop: Stop) -> Array:
    """Discs x, y, radius [m] in the base frame: parts of the arm beyond the footprint, from above; shape (k, 3).

    ``q`` [rad], shape (7,); ``mount``: x, y [m] of the arm. Each capsule is represented by three discs.
    """
    segments, found, count = capsule_segments(fk_arm(q)), np.empty((3 * CAPSULE_RADII.shape[0], 3)), 0
    for i in range(segments.shape[0]):
        radius = CAPSULE_RADII[i]
        for part in (0.0, 0.5, 1.0):
            x = mount[0] + (1.0 - part) * segments[i, 0, 0] + part * segments[i, 1, 0]
            y = mount[1] + (1.0 - part) * segments[i, 0, 1] + part * segments[i, 1, 1]
            if abs(x - stop.offset) + radius > stop.half_length or abs(y) + radius > stop.half_width:
                found[count, 0], found[count, 1], found[count, 2] = x, y, radius
                count += 1
    return found[:count]


@kernel
def met_in_stop(
    state: State, commanded: tuple[float, float], kind: int, time: float, movers: Array, arm: Array, stop: Stop
) -> int:
    """Index of the first obstacle that the stopping base approaches by its own motion, within the margin; -1: none.

    ``commanded``: twist [m/s, rad/s] for one more period; then the command falls as fast as it may, and the base
    follows it with its lag. ``movers``: x, y [m], velocity [m/s], radius [m], shape (k, 5 or more), ``time`` [s] before
    this state; ``arm``: its `overhang`. ``kind`` of stop: with `HOLDS_TURN` the turn brakes only after the speed is
    zero, with `HOLDS_SPEED` the speed only after the turn has ended: a base that backs away in a turn keeps doing so.
    An obstacle that approaches a base at rest, or a base that moves away from it, does not count.
    """
    x, y, heading, v, w = state
    v_cmd, w_cmd = commanded
    passed, farthest = 0.0, _farthest(arm, stop)
    while True:
        x_before, y_before, heading_before = x, y, heading
        v_now = followed(v, v_cmd, stop.linear * PERIOD, stop.share)
        w_now = followed(w, w_cmd, stop.turning * PERIOD, stop.share)
        x, y, heading = step(x, y, heading, v, w, v_now, w_now, PERIOD)
        v, w = v_now, w_now
        passed += PERIOD
        for k in range(movers.shape[0]):
            for ahead in (time + passed - PERIOD, time + passed):  # a turning side may near only one of these
                px, py = movers[k, 0] + ahead * movers[k, 2], movers[k, 1] + ahead * movers[k, 3]
                room = movers[k, 4] + stop.margin + 0.5 * VEERS * ahead * ahead
                if math.hypot(px - x, py - y) > farthest + room:
                    continue
                gap = _gap(px, py, x, y, heading, arm, stop)
                if gap < room and gap < _gap(px, py, x_before, y_before, heading_before, arm, stop) - ROUNDING:
                    return k
        if max(abs(v), abs(w)) < STANDS and v_cmd == 0.0 == w_cmd:
            return -1
        if kind != HOLDS_SPEED or w_cmd == 0.0:
            v_cmd = math.copysign(max(abs(v_cmd) - stop.linear * PERIOD, 0.0), v_cmd)
        if kind != HOLDS_TURN or v_cmd == 0.0:
            w_cmd = math.copysign(max(abs(w_cmd) - stop.turning * PERIOD, 0.0), w_cmd)


@kernel
def followed(speed: float, commanded: float, most: float, share: float) -> float:
    """Speed after closing a share of the gap to the command ``commanded``; it changes by at most ``most``."""
    return speed + min(most, max(-most, share * (commanded - speed)))


@kernel
def _farthest(arm: Array, stop: Stop) -> float:
    """Distance [m] from the base's origin to the farthest point of footprint and arm."""
    most = math.hypot(stop.half_length + abs(stop.offset), stop.half_width)
    for i in range(arm.shape[0]):
        most = max(most, math.hypot(arm[i, 0], arm[i, 1]) + arm[i, 2])
    return most


@kernel
def _gap(px: float, py: float, x: float, y: float, heading: float, arm: Array, stop: Stop) -> float:
    """Distance [m] from a point to footprint and arm at a pose; inside footprint: minus that to its nearest side."""
    c, s = math.cos(heading), math.sin(heading)
    dx, dy = px - x, py - y
    ahead, left = c * dx + s * dy, c * dy - s * dx
    along, across = abs(ahead - stop.offset) - stop.half_length, abs(left) - stop.half_width
    if along <= 0.0 and across <= 0.0:
        return max(along, across)
    gap = math.sqrt(max(along, 0.0) ** 2 + max(across, 0.0) ** 2)
    for i in range(arm.shape[0]):
        gap = min(gap, math.hypot(ahead - arm[i, 0], left - arm[i, 1]) - arm[i, 2])
    return gap
