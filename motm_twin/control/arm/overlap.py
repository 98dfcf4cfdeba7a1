"""Something stands where the arm is: a person put it there, or pushed the robot into it.

It is remembered until beams have passed through its place. The base brakes with all it has, and the arm takes the
motion of the base up as well as it can. From then on only what makes the overlap smaller is allowed, of base and arm
together; if there is nothing, both stand. After `overlap_stands` the arm goes back to its stow pose by its joints, or
else the hand goes straight out, no faster than a touch does harm. It has no goal meanwhile.

The lidar sees the near side below the arm. What it sees is taken to be the front of a disc.
"""

import math
from typing import NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from motm_twin.control.arm.bodies import BODIES, Balls, arm_balls, placed
from motm_twin.control.arm.limits import approach_row, seen_distances
from motm_twin.control.arm.parameters import ArmParameters
from motm_twin.control.arm.types import ArmInputs
from motm_twin.control.arm.view import Arm
from motm_twin.model.compiler import njit
from motm_twin.model.exact import dot, hypot, norm, times
from motm_twin.model.geometry import Array, from_frame
from motm_twin.model.joint_limits import DDQ_MAX, DQ_MAX, Q_MAX, Q_MIN
from motm_twin.model.profile import RobotProfile
from motm_twin.perception.discs import behind
from motm_twin.perception.remembered import Discs, Remembered, bodies, joined, looked_at_again, remember

_STOWED = 0.02  # [rad] joints this near to the stow pose are there
_JOINED = 0.16  # [m] seen points nearer than this to each other belong to one body
_KEPT = 1.5  # [m] from the arm's mount, beyond which nothing is remembered: the arm does not reach it
_SURE = 0.03  # [m] the middle of a body is known no better
_DEEP = 0.02  # [m] the surface of a body is known no better
_SINKS = 0.005  # [m/s] deeper, of a withdrawal, that is left alone
_TURNS_AT = 0.5  # [m] from the middle of the base, at which a turn counts as a speed
_ROLLS = 0.03  # [m/s], [rad/s] below which a base stands


class Overlap(NamedTuple):
    """The body of the arm that is deepest in something seen, and how deep [m]."""

    body: str
    depth: float


class WayOut(NamedTuple):
    """Motion of one step in an overlap."""

    twist: Array  # of the base, shape (2,)
    rates: Array  # of the joints [rad/s], shape (7,)
    withdraws: bool  # the arm moves out
    stuck: bool  # nothing that is known makes the overlap smaller


class ArmOverlap:
    """Finds what is seen where the arm is, and tells the robot how to get out of it."""

    def __init__(self, profile: RobotProfile, stow_joints: Array, parameters: ArmParameters) -> None:
        """The arm's way out leads to its stow joints (7,) [rad]."""
        self._profile, self._stow, self._parameters = profile, stow_joints, parameters
        self._balls = arm_balls()

    def kept(self, inside: Remembered, inputs: ArmInputs) -> Remembered | None:
        """Memory that is left: beams have not passed through it, and the arm reaches it; None: nothing."""
        left = looked_at_again(inside, inputs.observation.scan, inputs.T_odom_world)
        arm, pose = self._profile.arm, inputs.observation.odometry
        near = np.hypot(*(left.points - from_frame(pose, np.array([arm.mount_x, arm.mount_y]))).T) < _KEPT
        return Remembered(left.points[near], left.passed[near], left.stamp) if near.any() else None

    def recalled(self, inside: Remembered, inputs: ArmInputs) -> ArmInputs:
        """The inputs with what is remembered among the obstacles, and its far side."""
        now, discs = inputs.obstacles, self._bodies(inside, inputs)
        far = behind([(*m, r) for m, r in zip(discs.middle, discs.radius, strict=True)], self._viewpoint(inputs))
        points = np.concatenate((inside.points, now.points, far))
        static = np.zeros(len(points), dtype=bool)
        static[len(inside.points) : len(inside.points) + len(now.points)] = now.static
        obstacles = msgspec.structs.replace(now, points=points, static=static, hidden=now.hidden + len(far))
        return msgspec.structs.replace(inputs, obstacles=obstacles)

    def find(self, arm: Arm, inputs: ArmInputs, held_side: float, *, lasts: bool) -> Overlap | None:
        """The body deepest in something seen; ``held_side`` [m] of a held cube, 0: none; ``lasts``: there was one."""
        points = inputs.obstacles.points
        if not len(points):
            return None
        balls = placed(self._balls, inputs.observation.gripper_width, held_side)
        distance, _, _ = seen_distances(arm.T, balls, len(BODIES), 0.0, points, arm.mount, arm.pose[2])
        deepest = int(distance.argmin())
        depth = -float(distance[deepest, 0])
        return Overlap(BODIES[deepest], depth) if depth > (0.0 if lasts else self._parameters.overlap_depth) else None

    def met(self, arm: Arm, inputs: ArmInputs, held_side: float, inside: Remembered | None) -> Remembered:
        """Memory with all that is seen of the bodies in which the arm is now."""
        now = inputs.obstacles
        balls = placed(self._balls, inputs.observation.gripper_width, held_side)
        touched = _touched(arm.T, balls, now.points, arm.mount, arm.pose[2])
        of_them = joined(now.points, touched, _JOINED)
        of_them[len(now.points) - now.hidden :] = False
        scan = inputs.observation.scan
        return remember(inside, now.points[of_them], -math.inf if scan is None else scan.stamp)

    def way_out(
        self, arm: Arm, inputs: ArmInputs, twist: Array, held_side: float, inside: Remembered, *, withdraws: bool
    ) -> WayOut:
        """Motion after the twist (2,) commanded last; ``withdraws``: the arm has stood for long enough.

        The base stands, unless something is inside its own footprint: then it leaves that first, if it does not take
        the arm deeper into something.
        """
        base, dt = self._profile.base, inputs.dt
        balls = placed(self._balls, inputs.observation.gripper_width, held_side)
        discs = self._bodies(inside, inputs)
        limits = np.array([base.linear_acceleration, base.yaw_acceleration]) * dt
        brake, stop = twist - np.clip(twist, -limits, limits), _within(np.zeros(7), arm, dt)
        seen = inputs.obstacles.points[: len(inputs.obstacles.points) - inputs.obstacles.hidden]
        leaving = self._inside_base(arm.pose, seen)
        if leaving:
            after = np.clip(inputs.base_twist, twist - limits, twist + limits)
            if _sinks(arm, balls, discs, self._slow(after), np.zeros(7)) <= _SINKS:
                return WayOut(after, stop, withdraws=False, stuck=False)
        if np.abs(twist).max() > 0.0 or np.abs(arm.measured).max() > _ROLLS:
            return WayOut(brake, _within(self._held(arm), arm, dt), withdraws=False, stuck=False)
        if withdraws:
            for wanted in (self._to_stow(arm), self._straight_out(arm, discs)):
                if np.abs(wanted).max() > 0.0 and _sinks(arm, balls, discs, np.zeros(2), wanted) <= _SINKS:
                    return WayOut(brake, _within(wanted, arm, dt), withdraws=True, stuck=False)
        return WayOut(brake, stop, withdraws=False, stuck=withdraws or leaving)

    def _slow(self, twist: Array) -> Array:
        """The same motion of the base (2,) at the speed of a withdrawal: a slow start leads no less deep."""
        fast = hypot(float(twist[0]), _TURNS_AT * float(twist[1]))
        return twist * (self._parameters.overlap_speed / max(fast, 1e-9))

    def _to_stow(self, arm: Arm) -> Array:
        """Joint rates (7,) to the stow pose; 0 when it is there."""
        way = self._stow - arm.q
        if float(np.abs(way).max()) <= _STOWED:
            return np.zeros(7)
        hand, slow = norm(times(arm.jacobian[:3], way)), self._parameters.overlap_speed
        return way * min(1.0, slow / max(hand, 1e-9), slow / max(float(np.abs(way).max()) * 0.5, 1e-9))

    def _held(self, arm: Arm) -> Array:
        """Joint rates (7,) on the way to the stow pose that take up the motion of the base, as far as they can."""
        way = self._stow - arm.q
        back, carried = times(arm.J[:2, 2:], way), times(arm.J[:2, :2], arm.measured)
        share = -dot(back, carried) / max(dot(back, back), _STOWED**2)
        return way * min(max(share, 0.0), float((DQ_MAX / np.maximum(np.abs(way), 1e-9)).min()))

    def _straight_out(self, arm: Arm, discs: Discs) -> Array:
        """Joint rates (7,) that lead the hand away from the middle of the nearest body."""
        if not len(discs.radius):
            return np.zeros(7)
        away = arm.p[:2] - discs.middle[np.hypot(*(arm.p[:2] - discs.middle).T).argmin()]
        rates = times(arm.J[:2, 2:].T, away)
        return rates * (self._parameters.overlap_speed / max(norm(times(arm.J[:3, 2:], rates)), 1e-9))

    def _bodies(self, inside: Remembered, inputs: ArmInputs) -> Discs:
        return bodies(inside.points, self._viewpoint(inputs))

    def _viewpoint(self, inputs: ArmInputs) -> Array:
        lidar = self._profile.lidar
        return from_frame(inputs.observation.odometry, np.array([lidar.x, lidar.y]))

    def _inside_base(self, pose: Array, points: Array) -> bool:
        body = self._profile.footprint
        return _inside(pose, points, 0.5 * body.length, 0.5 * body.width, body.offset_x)


def _within(rates: Array, arm: Arm, dt: float) -> Array:
    """The rates (7,) that the joints can have after dt [s], and from which they stop before their limits."""
    room = np.maximum(np.where(rates > 0.0, Q_MAX - arm.q, arm.q - Q_MIN), 0.0)
    most = np.minimum(DQ_MAX, np.sqrt(DDQ_MAX * room))
    step = DDQ_MAX * dt
    return np.clip(np.clip(rates, -most, most), arm.dq - step, arm.dq + step)


@njit(cache=True)
def _place(T: Array, balls: Balls, i: int, mount: Array, heading: float) -> tuple[float, float]:
    """Place [m] of ball i above the floor, odometry frame."""
    f, centre = balls.frame[i], balls.centre
    px = T[f, 0, 3] + T[f, 0, 0] * centre[i, 0] + T[f, 0, 1] * centre[i, 1] + T[f, 0, 2] * centre[i, 2]
    py = T[f, 1, 3] + T[f, 1, 0] * centre[i, 0] + T[f, 1, 1] * centre[i, 1] + T[f, 1, 2] * centre[i, 2]
    c, s = math.cos(heading), math.sin(heading)
    return mount[0] + c * px - s * py, mount[1] + s * px + c * py


@njit(cache=True)
def _touched(T: Array, balls: Balls, points: Array, mount: Array, heading: float) -> NDArray[np.bool_]:
    """Which points (n, 2) are inside a ball of the arm, shape (n,)."""
    inside = np.zeros(points.shape[0], np.bool_)
    for i in range(balls.frame.shape[0]):
        if balls.radius[i] <= 0.0:
            continue
        x, y = _place(T, balls, i, mount, heading)
        for k in range(points.shape[0]):
            inside[k] = inside[k] or math.hypot(points[k, 0] - x, points[k, 1] - y) < balls.radius[i]
    return inside


@njit(cache=True)
def _sinks(arm: Arm, balls: Balls, discs: Discs, twist: Array, rates: Array) -> float:
    """Speed [m/s] at which the ball that sinks fastest into a disc does so; negative when all of them come out.

    ``twist`` (2,) of the base and ``rates`` (7,) of the joints. A ball comes out when it would with any middle of the
    disc within `_SURE`.
    """
    along, across = np.empty(9), np.empty(9)
    worst = -np.inf
    for i in range(balls.frame.shape[0]):
        if balls.radius[i] <= 0.0:
            continue
        x, y = _place(arm.T, balls, i, arm.mount, arm.pose[2])
        for k in range(discs.radius.shape[0]):
            dx, dy = x - discs.middle[k, 0], y - discs.middle[k, 1]
            away = math.hypot(dx, dy)
            if away - discs.radius[k] - balls.radius[i] > -_DEEP:
                continue
            frame, local = balls.frame[i], balls.centre[i]
            approach_row(arm.T, frame, local, arm.pose, arm.base_mount, -1.0, 0.0, 0.0, along)
            approach_row(arm.T, frame, local, arm.pose, arm.base_mount, 0.0, -1.0, 0.0, across)
            vx, vy = along[0] * twist[0] + along[1] * twist[1], across[0] * twist[0] + across[1] * twist[1]
            for joint in range(7):
                vx += along[2 + joint] * rates[joint]
                vy += across[2 + joint] * rates[joint]
            speed = math.hypot(vx, vy)
            worst = max(worst, min(speed, (_SURE * speed - vx * dx - vy * dy) / max(away, 1e-9)))
    return worst


@njit(cache=True)
def _inside(pose: Array, points: Array, half_length: float, half_width: float, offset: float) -> bool:
    """Some of the points (m, 2) is in the rectangle of a base at a pose (3,)."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    for i in range(points.shape[0]):
        dx, dy = points[i, 0] - pose[0], points[i, 1] - pose[1]
        if abs(c * dx + s * dy - offset) < half_length and abs(c * dy - s * dx) < half_width:
            return True
    return False
