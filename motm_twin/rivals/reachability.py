"""Maps of the best manipulability, from the inverse kinematics of the Panda in closed form; joint 7 is free.

Shoulder and wrist are spherical, but joint 7 is offset 88 mm from the wrist's centre. So joint 7 gives the wrist's
centre, its distance from the shoulder gives joint 4, the direction of the shoulder gives joints 5 and 6 (two
solutions), and the remaining rotation gives joints 1 to 3 (two solutions).
"""

import functools
import math
from typing import NamedTuple

import numpy as np

from motm_twin.control.arm.bodies import FINGERS, HAND_BODY, IntArray, arm_balls
from motm_twin.control.arm.geometry import ELBOW, stretch, tilt_for, tool_rotation
from motm_twin.control.arm.parameters import ArmParameters
from motm_twin.model.arm_kernels import ELBOW_OFFSET, LOWER, SHOULDER, TOOL, UPPER, WRIST, fk_arm, manipulability
from motm_twin.model.compiler import njit
from motm_twin.model.exact import angle_of, turn_between
from motm_twin.model.geometry import Array, frozen
from motm_twin.model.known import KnownWorld
from motm_twin.model.profile import Q_MAX, Q_MIN, WRIST_MIN
from motm_twin.planning.parameters import PlanningParameters
from motm_twin.planning.reach import ReachModel
from motm_twin.planning.types import Target

POSTURES = 4  # per value of joint 7
_TURNED = -math.pi / 4.0  # [rad] of the hand about the flange
_FLAT = 1e-9  # sine of joint 2 below which joints 1 and 3 turn about the same line


@njit(cache=True)
def _angle(value: float) -> float:
    """Wrap an angle [rad] to -pi .. pi."""
    return value - 2.0 * math.pi * math.floor((value + math.pi) / (2.0 * math.pi))


@njit(cache=True)
def _wrist_centre(R: Array, p: Array, q7: float) -> tuple[Array, Array]:
    """Rotation of link 6 (3, 3) and the wrist's centre (3,) [m], for a pose of the hand and joint 7 [rad]."""
    turn = q7 + _TURNED
    c, s = math.cos(turn), math.sin(turn)
    frame = np.empty((3, 3))
    for r in range(3):
        x, y, z = R[r, 0], R[r, 1], R[r, 2]
        frame[r, 0] = c * x - s * y  # link 6: x beside the flange's axis,
        frame[r, 1] = -z  # y against it,
        frame[r, 2] = s * x + c * y  # z is joint 6
    centre = p - TOOL * R[:, 2] - WRIST * frame[:, 0]
    return frame, centre


@njit(cache=True)
def _shoulder(R3: Array, side: int) -> tuple[float, float, float]:
    """Joints 1 to 3 of R3 = Rz(q1) Ry(q2) Rz(q3), joint 2 to the given side."""
    sine = math.hypot(R3[0, 2], R3[1, 2])
    q2 = side * math.atan2(sine, R3[2, 2])
    if sine < _FLAT:
        return math.atan2(R3[1, 0], R3[0, 0]), q2, 0.0
    return math.atan2(side * R3[1, 2], side * R3[0, 2]), q2, math.atan2(side * R3[2, 1], -side * R3[2, 0])


@njit(cache=True)
def solve_arm(R: Array, p: Array, q7: float, found: Array) -> int:
    """Write the postures that reach a pose with joint 7 at ``q7`` [rad]; returns how many, 0 to 4.

    R (3, 3), p (3,) [m]: tool centre point relative to the mount. found: filled in, shape (4, 7) [rad]. The elbow bends
    to the side on which it has 2.6 rad of room. The caller checks joint limits.
    """
    R6, wrist = _wrist_centre(R, p, q7)
    to_x, to_y, to_z = -wrist[0], -wrist[1], SHOULDER - wrist[2]
    upper, lower = math.hypot(UPPER, ELBOW_OFFSET), math.hypot(LOWER, ELBOW_OFFSET)
    square = to_x * to_x + to_y * to_y + to_z * to_z
    cosine = (upper * upper + lower * lower - square) / (2.0 * upper * lower)
    if abs(cosine) > 1.0:
        return 0
    q4 = ELBOW - (math.pi - math.acos(cosine))
    c4, s4 = math.cos(q4), math.sin(q4)
    across = -ELBOW_OFFSET * c4 - UPPER * s4 + ELBOW_OFFSET  # shoulder from the wrist's centre, in link 4
    along = ELBOW_OFFSET * s4 - UPPER * c4 - LOWER
    v = np.empty(3)
    for k in range(3):
        v[k] = R6[0, k] * to_x + R6[1, k] * to_y + R6[2, k] * to_z
    if abs(across) < 1e-9 or abs(v[2]) > abs(across):
        return 0
    first = math.asin(v[2] / across)
    count = 0
    for way in range(2):
        q5 = first if way == 0 else _angle(math.pi - first)
        c5, s5 = math.cos(q5), math.sin(q5)
        q6 = _angle(math.atan2(along, across * c5) - math.atan2(v[1], v[0]))
        if q6 < -0.5 * math.pi:
            q6 += 2.0 * math.pi  # its range is 0 .. 3.75
        R3 = _upper_arm(R6, c4, s4, c5, s5, math.cos(q6), math.sin(q6))
        for side in (1, -1):
            q1, q2, q3 = _shoulder(R3, side)
            found[count, 0], found[count, 1], found[count, 2] = q1, q2, q3
            found[count, 3], found[count, 4], found[count, 5], found[count, 6] = q4, q5, q6, q7
            count += 1
    return count


@njit(cache=True)
def _upper_arm(R6: Array, c4: float, s4: float, c5: float, s5: float, c6: float, s6: float) -> Array:
    """Rotation of link 3 (3, 3): that of link 6 with joints 6, 5 and 4 undone."""
    R3 = np.empty((3, 3))
    for r in range(3):
        x, y, z = R6[r, 0], R6[r, 1], R6[r, 2]
        x, y = c6 * x - s6 * y, s6 * x + c6 * y
        y, z = -z, y  # link 5
        x, y = c5 * x - s5 * y, s5 * x + c5 * y
        y, z = z, -y  # link 4
        x, y = c4 * x - s4 * y, s4 * x + c4 * y
        R3[r, 0], R3[r, 1], R3[r, 2] = x, -z, y  # link 3
    return R3


RADII = frozen(np.arange(0.30, 0.921, 0.02))  # [m] from the mount's axis
AZIMUTHS = 36  # of the point about the mount, evenly from -180 deg
YAWS = 18  # of the hand to the azimuth, over a quarter turn: a cube's faces repeat
_QUARTER = 0.5 * math.pi
_JOINT7_STEPS = 25  # over its range: 14 deg apart
_OVER_BASE = 0.20  # [m] from the mount's axis to the base's front: nearer, the arm is over its own base
_OVER_SURFACE = 0.02  # [m] clearance of elbow, forearm and wrist over the object's support
_COLUMN_RADIUS, _COLUMN_TOP = 0.10, 0.42  # [m] of the arm's own column
_EDGE = 1e-6  # [m] of rounding


class ArmBalls(NamedTuple):
    """Balls that cover elbow, forearm, wrist and hand."""

    frame: IntArray  # index into the frames of `fk_arm`, shape (n,)
    centre: Array  # in that frame [m], shape (n, 3)
    radius: Array  # [m], shape (n,)
    body: IntArray  # index into `bodies.BODIES`, shape (n,)


class Task(NamedTuple):
    """Pick or place at a height over the mount."""

    kind: str  # "pick" | "place"
    height: float  # [m] of the tool centre point over the mount
    surface: float  # [m] top of the object's support, or rim of the bin, over the mount


class ReachabilityMap(NamedTuple):
    """Best manipulability by radius, yaw and azimuth, and its posture (nan: none)."""

    value: Array  # shape (radii, yaws, azimuths); 0: out of reach
    posture: Array  # [rad], shape (radii, yaws, azimuths, 7)
    best: float  # largest value

    def at(self, radius: Array, azimuth: Array, yaw: Array) -> Array:
        """Manipulability at points (m,): radius [m] and azimuth [rad] in the base frame, yaw [rad] of a face.

        ``yaw`` is relative to the azimuth. Linear in radius and yaw; 0 where one of the four neighbours is.
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
    """Rotation of the hand (3, 3) at azimuth 0, with the least outward tilt that reaches; None: out of reach."""
    arm = ArmParameters()
    largest = arm.pick_tilt if task.kind == "pick" else arm.place_tilt
    tilt = tilt_for(radius, task.height, arm.stretch, largest)
    if stretch(radius, task.height, tilt) > arm.stretch + _EDGE:
        return None
    return tool_rotation(yaw, tilt, 0.0)


@functools.lru_cache(maxsize=32)
def reachability_map(task: Task) -> ReachabilityMap:
    """The map for one task: takes about a second, and is cached."""
    yaws = YAWS if task.kind == "pick" else 1  # a release has no faces to grasp
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
    """Limits kept by the arm's control: slightly inside the joints', elbow never straight, wrist never folded."""
    qp = ArmParameters().qp
    low, high = Q_MIN + qp.damper_stop, Q_MAX - qp.damper_stop
    low[5] = max(low[5], WRIST_MIN)
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
    """Fill in best value (k,) and posture (k, 7) of a pose of the hand, turned about the mount to k azimuths."""
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
                q1 = _angle(q[0] - math.pi + 2.0 * math.pi * k / count)
                if m > value[k] and low[0] <= q1 <= high[0]:
                    value[k] = m
                    posture[k] = q
                    posture[k, 0] = q1


@njit(cache=True)
def _is_clear(q: Array, surface: float, balls: ArmBalls) -> bool:
    """True when the arm clears the task's surface (except over its own base) and its own column."""
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


_NEAR = 1.0  # [m] from the target within which obstacles count as beside the arm
_ROUNDED = 2  # decimals [m] of heights: tables of nearly the same height share a map


class TargetReach:
    """Manipulability at base poses for the objects and bins that are known beforehand.

    Heights and yaws are known beforehand, too: the base gets only planar positions of targets.
    """

    def __init__(self, known: KnownWorld, parameters: PlanningParameters) -> None:
        arm = ArmParameters()
        self._reach, self._slack = ReachModel(known.robot, parameters.reach), 2.0 * parameters.reach.plan_slack
        self._arm = known.robot.arm
        self._mount = np.array([self._arm.mount_x, self._arm.mount_y])
        self._objects = {item.name: item for item in known.objects}
        self._bins = {item.name: item for item in known.bins}
        self._release_height, self._release_margin = arm.release_height, arm.release_margin
        self._preferred_radius = arm.preferred_radius
        for name in self._objects:
            self.of("pick", name)  # computed now, not during a period
        for name in self._bins:
            self.of("place", name)

    def of(self, kind: str, name: str) -> ReachabilityMap:
        """The map at the height of a target; KeyError for one that is neither an object nor a bin."""
        z_0 = self._arm.mount_z
        if kind == "pick":
            item = self._objects[name]
            z, surface = item.position[2], item.position[2] - 0.5 * item.side
        else:
            place = self._bins[name]
            z, surface = place.rim_z + self._release_height, place.rim_z
        return reachability_map(Task(kind, round(z - z_0, _ROUNDED), round(surface - z_0, _ROUNDED)))

    def share(self, poses: Array, target: Target) -> Array:
        """Manipulability at base poses (m, 3), as a share of the target's best; 0: out of reach."""
        if not len(poses):
            return np.zeros(0)
        reach = self.of(target.kind, target.name)
        radius, azimuth, outward = self._polar(poses, target)
        yaw = (self._objects[target.name].yaw if target.kind == "pick" else 0.0) - outward
        return reach.at(radius, azimuth, yaw) / reach.best

    def good_share(self, poses: Array, target: Target) -> Array:
        """`share` where the target is well within the assumed reach of the arm, else 0."""
        return np.where(self._reach.reached_from(poses, target, slack=self._slack), self.share(poses, target), 0.0)

    def azimuth(self, poses: Array, target: Target) -> Array:
        """Angle [rad] of the target to either side of straight ahead of the mount, shape (m,)."""
        return turn_between(self._polar(poses, target)[1], 0.0)

    def clear_of(self, poses: Array, target: Target, points: Array) -> Array:
        """Distance [m] of the nearest of points (k, 2) from the line between mount and target, shape (m,)."""
        mount = self._mounts(poses)
        along = self._point(mount, target) - mount
        square = np.maximum((along**2).sum(axis=1), 1e-9)
        nearest = np.full(len(poses), np.inf)
        for point in points[np.hypot(*(points - target.position[:2]).T) < _NEAR]:
            away = point - mount
            part = np.clip((away * along).sum(axis=1) / square, 0.0, 1.0)[:, None]
            nearest = np.minimum(nearest, np.hypot(*(away - part * along).T))
        return nearest

    def _mounts(self, poses: Array) -> Array:
        """Positions [m] of the arm mount, shape (m, 2)."""
        c, s = np.cos(poses[:, 2]), np.sin(poses[:, 2])
        x, y = self._mount
        return poses[:, :2] + np.column_stack((c * x - s * y, s * x + c * y))

    def _polar(self, poses: Array, target: Target) -> tuple[Array, Array, Array]:
        """Radius [m] and azimuth [rad] of the target about the mount, base frame, and its direction in the world."""
        mount = self._mounts(poses)
        away = self._point(mount, target) - mount
        outward = angle_of(away[:, 1], away[:, 0])
        return np.hypot(away[:, 0], away[:, 1]), outward - poses[:, 2], outward

    def _point(self, mount: Array, target: Target) -> Array:
        """Target point of the hand: the object, or the point of the release square that suits the arm best; (m, 2)."""
        centre = np.asarray(target.position[:2])
        if target.kind == "pick":
            return np.broadcast_to(centre, mount.shape)
        place = self._bins[target.name]
        half = max(0.0, place.side / 2.0 - place.wall - 0.02 - self._release_margin)  # 0.02: half a cube
        away = centre - mount
        distance = np.maximum(np.hypot(away[:, 0], away[:, 1]), 1e-6)
        desired = -away * np.maximum(0.0, 1.0 - self._preferred_radius / distance)[:, None]
        c, s = math.cos(place.yaw), math.sin(place.yaw)
        x = np.clip(c * desired[:, 0] + s * desired[:, 1], -half, half)
        y = np.clip(-s * desired[:, 0] + c * desired[:, 1], -half, half)
        return centre + np.column_stack((c * x - s * y, s * x + c * y))
