"""Passive safety: the base stands before anything that moves on as it does can reach it, or else moves away from it.

The rule is that of Bouraine, Fraichard and Salhi (Autonomous Robots 32, 2012): a state is safe when braking from it
leads to rest before a collision. Every dynamic obstacle goes on straight at the velocity that the lidar has measured,
for as long as the base needs to stop: no prediction is needed beyond that.
"""

import math
from typing import NamedTuple

from motm_twin.model.geometry import Array
from motm_twin.model.motion import kernel
from motm_twin.model.period import PERIOD
from motm_twin.model.profile import RobotProfile

ROUNDING = 1e-6  # [m]


State = tuple[float, float, float, float, float]  # x, y [m], heading [rad], v [m/s], w [rad/s]


class Stop(NamedTuple):
    """Deceleration and size of a base that stops, and the room that it keeps."""

    linear: float  # deceleration [m/s^2]
    turning: float  # [rad/s^2]
    lag: float  # [s] of constant twist before
    half_length: float  # of the footprint [m]
    half_width: float
    offset: float  # of its centre [m]
    margin: float  # [m]


def stop_of(robot: RobotProfile, margin: float) -> Stop:
    """The stop of a robot, ``margin`` [m] away from what moves."""
    base, body = robot.base, robot.footprint
    return Stop(
        base.linear_acceleration, base.yaw_acceleration, base.velocity_lag, 0.5 * body.length, 0.5 * body.width,
        body.offset_x, margin,
    )  # fmt: skip


@kernel
def met_in_stop(state: State, hold_yaw_rate: bool, time: float, movers: Array, stop: Stop) -> int:
    """Index of the first of the movers that a base which stops from a state moves towards within the margin; -1: none.

    ``movers``: x, y [m], velocity [m/s], radius [m], shape (k, 5 or more), ``time`` [s] before this state. With
    ``hold_yaw_rate`` the turn goes on until the base has come to rest. What comes nearer to a base that stands, or that
    moves away from it, is not met.
    """
    x, y, heading, v, w = state
    passed = 0.0
    while True:
        x_before, y_before, heading_before = x, y, heading
        if passed >= stop.lag:
            v = math.copysign(max(abs(v) - stop.linear * PERIOD, 0.0), v)
            if not hold_yaw_rate or v == 0.0:
                w = math.copysign(max(abs(w) - stop.turning * PERIOD, 0.0), w)
        if v == 0.0 and (w == 0.0 or hold_yaw_rate):
            return -1
        heading += w * PERIOD
        x += v * PERIOD * math.cos(heading)
        y += v * PERIOD * math.sin(heading)
        passed += PERIOD
        for k in range(movers.shape[0]):
            ahead = time + passed
            px, py = movers[k, 0] + ahead * movers[k, 2], movers[k, 1] + ahead * movers[k, 3]
            gap = _gap(px, py, x, y, heading, stop)
            if gap - movers[k, 4] < stop.margin:
                if gap < _gap(px, py, x_before, y_before, heading_before, stop) - ROUNDING:
                    return k


@kernel
def _gap(px: float, py: float, x: float, y: float, heading: float, stop: Stop) -> float:
    """Distance [m] from a point to the footprint at a pose; negative inside, by the nearest side."""
    c, s = math.cos(heading), math.sin(heading)
    dx, dy = px - x, py - y
    along = abs(c * dx + s * dy - stop.offset) - stop.half_length
    across = abs(c * dy - s * dx) - stop.half_width
    if along <= 0.0 and across <= 0.0:
        return max(along, across)
    return math.sqrt(max(along, 0.0) ** 2 + max(across, 0.0) ** 2)
