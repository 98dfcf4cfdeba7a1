"""Whose doing a contact is, by what each of the two did: the robot's, when its own motion brought it about.

Asked of the motion of the touching point in all directions, with the other where it is now; never of the normal of the
shallowest overlap, which points sideways where a body scrapes and backwards where it is deep inside.
"""

from dataclasses import dataclass

import coal
import numpy as np

from motm_twin.model.exact import dot, norm, product, times
from motm_twin.model.geometry import Array
from motm_twin.model.joint_limits import DDQ_MAX
from motm_twin.model.profile import BaseLimits
from motm_twin.sim.without import Placed

TOUCH = 1e-5  # [m] of penetration that counts as contact
MOVES = 1e-3  # [m/s] of the touching point from which a part of the robot moves
PARTS = 0.2  # share of its own way that must go into parting for a motion to be one that leads apart
FURTHEST = 3.0  # [m] a way out of an overlap is searched
STRIDE = 0.005  # [m] at least, between two looks along such a way
TRAIL_PERIOD = 0.05  # [s] between two places that are remembered
NO_TRAIL = np.zeros((0, 13))


@dataclass(frozen=True, kw_only=True)
class Touch:
    """A part of the robot and another thing that overlap, at the end of a substep."""

    robot: Placed
    other: Placed
    unmoved: coal.Transform3s  # where the part would be, had the robot not moved in this substep
    distance: float  # [m] of the two, negative
    velocity: Array  # [m/s] of the touching point by the robot's own motion, shape (3,)
    other_velocity: Array  # [m/s] of the other there, shape (3,)


class Responsibility:
    """Judges touches; knows nothing of persons."""

    def __init__(self, dt: float) -> None:
        """Substeps of dt [s]."""
        self.dt = dt
        self._request, self._result = coal.DistanceRequest(), coal.DistanceResult()
        self._shifted = coal.Transform3s()

    def by_own_motion(self, touch: Touch, *, begins: bool) -> bool:
        """The robot's motion in this substep brings a contact about, or leads along it or further into it.

        Motion that parts the two is none of that, nor is the shortest way out of an overlap that is there already. Nor
        is motion by which the robot does not gain on the other, which follows it or drives away.
        """
        speed = norm(touch.velocity)
        apart = self._gap((touch.robot[0], touch.unmoved), touch.other)
        if speed < MOVES:
            return begins and apart > -TOUCH and norm(touch.other_velocity) <= MOVES
        parts = touch.distance - apart >= PARTS * speed * self.dt
        if parts or dot(touch.velocity, touch.velocity - touch.other_velocity) <= 0.0:
            return False
        return begins or not self._leads_out(touch, touch.velocity / speed)

    def touches(self, robot: Placed, other: Placed) -> bool:
        """The two overlap."""
        return self._gap(robot, other) < -TOUCH

    def _leads_out(self, touch: Touch, direction: Array) -> bool:
        """Going on in this direction the part gets clear of the other sooner than by going back."""
        ahead = behind = 0.0
        while max(ahead, behind) < FURTHEST:
            forward = ahead <= behind
            gap = self._gap_at(touch, direction * (ahead if forward else -behind))
            if gap > -TOUCH:
                return forward
            if forward:
                ahead += max(-gap, STRIDE)
            else:
                behind += max(-gap, STRIDE)
        return False

    def _gap_at(self, touch: Touch, shift: Array) -> float:
        self._shifted.setTransform(touch.robot[1].getRotation(), touch.robot[1].getTranslation() + shift)
        return self._gap((touch.robot[0], self._shifted), touch.other)

    def _gap(self, robot: Placed, other: Placed) -> float:
        self._result.clear()
        return coal.distance(*robot, *other, self._request, self._result)


def stopping_time(limits: BaseLimits, twist: Array, dq: Array) -> float:
    """Time [s] that the robot needs to stop from base speeds (2,) and joint rates (7,); 0 at rest."""
    v, w = (abs(value) for value in twist.tolist())
    joints = float(np.max(np.abs(dq) / DDQ_MAX))
    base = max(v / limits.linear_acceleration, w / limits.yaw_acceleration)
    if v < MOVES and w < MOVES:
        base = 0.0
    else:
        base += limits.velocity_lag
    return max(base, joints)


def followed(trail: Array, now: Array) -> Array:
    """The trail with one more place, without those from which the robot could have stopped before now.

    A place: time [s], pose (3,), joints (7,), width between the pads [m], stopping time [s]; shape (k, 13).
    """
    trail = np.concatenate([trail, now[None]])
    useful = now[0] - trail[:, 0] <= trail[:, -1] + 1e-9
    useful[-1] = True
    first = int(np.argmax(useful))
    return trail[first:]


def carried_along(shape: Array, frame: Array, earlier: Array) -> Array:
    """Transform of a shape fixed to a frame that was elsewhere earlier; all (4, 4)."""
    local = product(frame[:3, :3].T, shape[:3, :3])
    offset = times(frame[:3, :3].T, shape[:3, 3] - frame[:3, 3])
    T = np.eye(4)
    T[:3, :3] = product(earlier[:3, :3], local)
    T[:3, 3] = times(earlier[:3, :3], offset) + earlier[:3, 3]
    return T
