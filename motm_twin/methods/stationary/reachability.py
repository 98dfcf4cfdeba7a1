"""The reachability map of the arm: the best manipulability with which the hand gets to a point, by inverse kinematics.

Read the other way round, from a point to the base poses that serve it, it is an inverse reachability map. A cell holds
the largest sqrt(det(J J^T)) over all postures: joint 7 in steps, both elbows and wrists, and every face of the cube.
Turning the arm about joint 1 changes only that joint, so each posture counts for all azimuths that joint 1 can turn to.
"""

import functools
import math
from typing import NamedTuple

import numpy as np
from numba import njit

from motm_twin.control.arm_reference import stretch, tilt_for, tool_rotation
from motm_twin.control.furniture import FINGERS, HAND_BODY, IntArray, arm_balls
from motm_twin.control.parameters import ArmParameters
from motm_twin.methods.stationary.arm_solutions import POSTURES, solve_arm
from motm_twin.model.geometry import Array, frozen
from motm_twin.model.joint_limits import Q_MAX, Q_MIN
from motm_twin.model.kinematics import fk_arm, manipulability

RADII = frozen(np.arange(0.30, 0.921, 0.02))  # [m] from the mount's axis
AZIMUTHS = 36  # of the point about the mount, evenly from -180 deg
YAWS = 18  # of the hand to the azimuth, over a quarter turn: a cube's faces repeat
_QUARTER = 0.5 * math.pi
_JOINT7_STEPS = 25  # over its range: 14 deg apart
_OVER_BASE = 0.20  # [m] from the mount's axis within which the arm is over its own base: the front is so far away
_OVER_SURFACE = 0.02  # [m] that elbow, forearm and wrist keep over what carries the object
_COLUMN_RADIUS, _COLUMN_TOP = 0.10, 0.42  # [m] of the arm's own column
_EDGE = 1e-6  # [m] of rounding


class ArmBalls(NamedTuple):
    """Balls that cover elbow, forearm, wrist and hand."""

    frame: IntArray  # shape (n,)
    centre: Array  # [m], shape (n, 3)
    radius: Array  # [m], shape (n,)
    body: IntArray  # shape (n,)


class Task(NamedTuple):
    """What the hand does at a height over the mount."""

    kind: str  # "pick" | "place"
    height: float  # [m] of the tool centre point over the mount
    surface: float  # [m] top of what carries the object or bin, over the mount


class ReachabilityMap(NamedTuple):
    """Best manipulability by radius, yaw and azimuth, and the posture that has it (nan: none)."""

    value: Array  # shape (radii, yaws, azimuths); 0: out of reach
    posture: Array  # [rad], shape (radii, yaws, azimuths, 7)
    best: float  # largest value

    def at(self, radius: Array, azimuth: Array, yaw: Array) -> Array:
        """Manipulability at points (m,): radius [m] and azimuth [rad] in the base frame, yaw [rad] of a face.

        ``yaw`` is that of the hand less the azimuth; linear in radius and yaw, 0 where either neighbour is.
        """
        step = RADII[1] - RADII[0]
        u = (radius - RADII[0]) / step
        inside = (u >= 0.0) & (u <= len(RADII) - 1)
        i = np.clip(np.floor(u).astype(int), 0, len(RADII) - 2)
        s = np.clip(u - i, 0.0, 1.0)
        yaws = self.value.shape[1]
        w = np.mod(yaw, _QUARTER) / _QUARTER * yaws
        j = np.floor(w).astype(int) % yaws
        t = w - np.floor(w)
        k = np.round(np.mod(azimuth + math.pi, 2.0 * math.pi) / (2.0 * math.pi) * AZIMUTHS).astype(int) % AZIMUTHS
        corners = [self.value[a, b % yaws, k] for a in (i, i + 1) for b in (j, j + 1)]
        mixed = (1 - s) * ((1 - t) * corners[0] + t * corners[1]) + s * ((1 - t) * corners[2] + t * corners[3])
        return np.where(inside & (np.min(corners, axis=0) > 0.0), mixed, 0.0)


def hand_rotation(radius: float, yaw: float, task: Task) -> Array | None:
    """The hand at azimuth 0, tilted outwards as little as the reach allows; None when that does not do."""
    arm = ArmParameters()
    largest = arm.pick_tilt if task.kind == "pick" else arm.place_tilt
    tilt = tilt_for(radius, task.height, arm.grasp_stretch, largest)
    if stretch(radius, task.height, tilt) > arm.grasp_stretch + _EDGE:
        return None
    return tool_rotation(yaw, tilt, 0.0)


@functools.lru_cache(maxsize=32)
def reachability_map(task: Task) -> ReachabilityMap:
    """The map for one task, about a second of computing; the same task gives the same object."""
    yaws = YAWS if task.kind == "pick" else 1  # what is let go has no faces to be taken by
    value = np.zeros((len(RADII), yaws, AZIMUTHS))
    posture = np.full((*value.shape, 7), np.nan)
    low, high = _joint_range()
    seventh = np.linspace(low[6], high[6], _JOINT7_STEPS)
    balls = _balls()
    for i, radius in enumerate(RADII):
        for turn in range(4 * YAWS):
            yaw = turn * _QUARTER / YAWS
            R = hand_rotation(float(radius), yaw, task)
            if R is not None:
                p = np.array([radius, 0.0, task.height])
                cell = turn % yaws
                _fill(R, p, seventh, low, high, task.surface, balls, value[i, cell], posture[i, cell])
    value.setflags(write=False)
    posture.setflags(write=False)
    return ReachabilityMap(value, posture, float(value.max()))


def _joint_range() -> tuple[Array, Array]:
    """Limits that the arm's control keeps: a little inside the joints', elbow never straight, wrist never folded."""
    qp = ArmParameters().qp
    low, high = Q_MIN + qp.damper_stop, Q_MAX - qp.damper_stop
    low[5] = max(low[5], qp.wrist_limit)
    high[3] = min(high[3], qp.elbow_limit)
    return low, high


def _balls() -> ArmBalls:
    every = arm_balls()
    of_arm = every.body < FINGERS
    return ArmBalls(every.frame[of_arm], every.centre[of_arm], every.radius[of_arm], every.body[of_arm])


@njit(cache=True)
def _fill(
    R: Array, p: Array, seventh: Array, low: Array, high: Array, surface: float, balls: ArmBalls, value: Array,
    posture: Array,
) -> None:  # fmt: skip
    """Enter every posture for one pose of the hand in front of the arm into the row of its azimuths."""
    found = np.empty((POSTURES, 7))
    count = value.shape[0]
    for q7 in seventh:
        for n in range(solve_arm(R, p, q7, found)):
            q = found[n]
            fits = True
            for k in range(1, 7):
                fits = fits and low[k] <= q[k] <= high[k]
            if not fits:
                continue
            m = manipulability(q)
            if m <= value.min() or not _is_clear(q, surface, balls):
                continue
            for k in range(count):
                q1 = q[0] - math.pi + 2.0 * math.pi * k / count
                q1 -= 2.0 * math.pi * math.floor((q1 + math.pi) / (2.0 * math.pi))
                if m > value[k] and low[0] <= q1 <= high[0]:
                    value[k] = m
                    posture[k] = q
                    posture[k, 0] = q1


@njit(cache=True)
def _is_clear(q: Array, surface: float, balls: ArmBalls) -> bool:
    """Is the arm over what carries the object, wherever it is not over its own base, and off its own column?"""
    T = fk_arm(q)
    for i in range(balls.frame.shape[0]):
        f = balls.frame[i]
        c = balls.centre[i]
        x = T[f, 0, 3] + T[f, 0, 0] * c[0] + T[f, 0, 1] * c[1] + T[f, 0, 2] * c[2]
        y = T[f, 1, 3] + T[f, 1, 0] * c[0] + T[f, 1, 1] * c[1] + T[f, 1, 2] * c[2]
        bottom = T[f, 2, 3] + T[f, 2, 0] * c[0] + T[f, 2, 1] * c[1] + T[f, 2, 2] * c[2] - balls.radius[i]
        away = math.hypot(x, y)
        if balls.body[i] < HAND_BODY and away > _OVER_BASE and bottom < surface + _OVER_SURFACE:
            return False
        if balls.body[i] > 0 and away - balls.radius[i] < _COLUMN_RADIUS and bottom < _COLUMN_TOP:
            return False
    return True
