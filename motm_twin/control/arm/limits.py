"""Limits of the arm's speed towards obstacles: rows ``G (v, w, qdot) <= h`` of the quadratic program.

They bound the speed of approach at a distance d by a damper line (the height limit bounds it by 0):

    xi (d - d_s) / (d_i - d_s),    negative below d_s: retreat        (Paper, Sec. V)

A limit is a class with `names`, `soft` and `rows`. To add one, write it and list it in `arm_limits`, or pass it to
`Manipulator(limits=...)`; nothing else changes. Limits from the lidar are soft, except that of the height: they must
not make the rows of mapped furniture and of the robot's own base give way.

As printed in the paper the line bounds d-dot; it must bound the approach, -d-dot. The line continues beyond d_i, where
it allows more than xi: when it began only at d_i, a hand that swings at 1 m/s exceeded it by 0.4 m/s.

The paper limits one point, the gripper's centre. A static obstacle (occupied for 3 s, at rest for 12 s if it was seen
to move) close to the target would forbid the grasp, so its d_s shrinks to the target's distance to it less a margin,
from the approach until the gripper is d_s away again. A dynamic obstacle keeps d_s. Beyond the paper, elbow, forearm
and wrist keep away from obstacles that the lidar sees, and every body from furniture and the robot's own base.
"""

import math
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from motm_twin.control.arm.bodies import (
    BODIES,
    COLUMN,
    FINGERS,
    HAND_BODY,
    HELD,
    Balls,
    IntArray,
    Solids,
    body_distances,
    mapped_solids,
    own_body,
)
from motm_twin.control.arm.parameters import AvoidanceParameters, Numbers, numbers
from motm_twin.control.arm.view import Arm
from motm_twin.model.compiler import njit
from motm_twin.model.exact import product
from motm_twin.model.geometry import Array
from motm_twin.model.known import KnownWorld

_LINK = 0.16  # [m] cells nearer than this belong to one obstacle
_REACH = 1.2  # [m] from mount, gripper or target, beyond which nothing matters
_HALF_CELL = 0.025  # [m] a seen point is the centre of a map cell
YIELDS = 0.75  # share of furniture_d_s given up at a grasp; without it a full table would block every grasp
_PLACE_SDS = 2.0  # standard deviations of the robot's position on the map that are added to d_s; 1 at a grasp
_SEEN_D_S = 0.02  # [m] d_s of links from seen static obstacles, which are known less well than furniture of the map
_FASTEST_RETREAT = -0.10  # [m/s] no row of furniture asks for a faster retreat than this
_MOST, _MOST_OWN = 32, 12  # rows of furniture, and of the own base, the nearest first
_SHORT = 32  # finite distances that are sorted one by one
_FEW = 384  # distances that NumPy sorts as they are


class Rows(NamedTuple):
    """Rows of one limit."""

    G: Array  # over base twist and arm rates, shape (k, 9)
    h: Array  # [m/s], shape (k,)
    name: IntArray  # index into the names of the limit, shape (k,)


class LidarLimits(NamedTuple):
    """Directions in which the gripper is limited now, by moving and by static obstacles; all arrays of length k."""

    normal: Array  # horizontal unit vectors towards the obstacle, shape (k, 2)
    distance: Array  # [m]
    d_s: Array  # [m]
    allowed: Array  # [m/s] damper line
    static: NDArray[np.bool_]


class Around(NamedTuple):
    """Surroundings of the arm in one step, as limits read them."""

    points: Array  # seen outside the map, odometry frame [m], shape (m, 2)
    static: NDArray[np.bool_]  # shape (m,)
    gripper: LidarLimits
    balls: Balls  # with fingers and held object in place
    d_s: Array  # [m] of each body from furniture, shape (8,)
    d_i: Array


class Limit(Protocol):
    """A limit of the arm's speed."""

    names: tuple[str, ...]  # of its rows, as shown in the Tick; `Rows.name` is an index into them
    # True: its rows share the slack of the lidar's rows. False: they share that of furniture, whose rows then give way
    # with them. Both slacks have the same price.
    soft: bool

    def rows(self, arm: Arm, around: Around) -> Rows:
        """Rows of this step; `NO_ROWS` when it does not apply."""
        ...


def arm_limits(known: KnownWorld, parameters: AvoidanceParameters) -> tuple[Limit, ...]:
    """All limits of the arm."""
    p = numbers(parameters)
    return GripperLimit(), HeightLimit(), FurnitureLimit(known, p), OwnBaseLimit(known, p), LinkLimit(p)


class GripperLimit:
    """Keeps the gripper's centre from obstacles that the lidar sees (Paper, Sec. V)."""

    names = ("lidar moving", "lidar static")
    soft = True

    def rows(self, arm: Arm, around: Around) -> Rows:
        """One row for each direction that `lidar_limits` found."""
        found = around.gripper
        if not len(found.allowed):
            return NO_ROWS
        normal = np.zeros((len(found.allowed), 3))
        normal[:, :2] = found.normal
        return Rows(product(normal, arm.J[:3]), found.allowed, found.static.astype(np.int64))


class HeightLimit:
    """Keeps the gripper from sinking while it must retreat: it may be above an obstacle, whose height is unknown."""

    names = ("lidar height",)
    soft = False

    def rows(self, arm: Arm, around: Around) -> Rows:
        """No row, or one."""
        allowed = around.gripper.allowed
        if not len(allowed) or allowed.min() >= 0.0:
            return NO_ROWS
        return Rows(-arm.J[2:3], np.zeros(1), np.zeros(1, np.int64))


class FurnitureLimit:
    """Keeps every body of the arm from mapped furniture at its true height."""

    soft = False

    def __init__(self, known: KnownWorld, parameters: Numbers) -> None:
        """Furniture and bins of the pre-made map; ``parameters``: `numbers` of the avoidance."""
        mapped = mapped_solids(known)
        self._solids, self._parameters = mapped.solids, parameters
        self.names = tuple(f"{body} - {solid}" for body in BODIES for solid in mapped.names)

    def rows(self, arm: Arm, around: Around) -> Rows:
        """One row for each body and solid that are near each other."""
        if not len(self._solids.z):
            return NO_ROWS
        return _furniture_rows(arm, around.balls, around.d_s, around.d_i, self._solids, self._parameters)


class OwnBaseLimit:
    """Keeps every body of the arm from the robot's own base and column."""

    soft = False

    def __init__(self, known: KnownWorld, parameters: Numbers) -> None:
        """The robot's own body; ``parameters``: `numbers` of the avoidance."""
        own = own_body(known)
        self._solids, self._parameters = own.solids, parameters
        self.names = tuple(f"{body} - {solid}" for body in BODIES for solid in own.names)

    def rows(self, arm: Arm, around: Around) -> Rows:
        """One row for each body near the base; the base carries its own body along."""
        return _own_rows(arm, around.balls, around.d_s, around.d_i, self._solids, self._parameters)


class LinkLimit:
    """Keeps elbow, forearm and wrist from obstacles that the lidar sees, which count as tall.

    While the hand is over the table, the elbow swings out behind it, beside a person or a Temi.
    """

    names = tuple(f"{body} - lidar" for body in BODIES)
    soft = True

    def __init__(self, parameters: Numbers) -> None:
        """``parameters``: `numbers` of the avoidance."""
        self._parameters, self._enabled = parameters, bool(parameters["enabled"][0])

    def rows(self, arm: Arm, around: Around) -> Rows:
        """Rows to retreat from moving points, and not to approach static ones further."""
        if not self._enabled or not len(around.points):
            return NO_ROWS
        return _link_rows(arm, around.balls, around.points, around.static, self._parameters)


NO_ROWS = Rows(np.zeros((0, 9)), np.zeros(0), np.zeros(0, np.int64))


@njit(cache=True)
def damper_line(d: float, d_s: float, d_i: float, xi: float) -> float:
    """Allowed approach speed [m/s, rad/s] at a distance d [m, rad], negative below d_s; the line goes on beyond d_i."""
    return xi * (d - d_s) / (d_i - d_s)


@njit(cache=True)
def approach_row(
    T: Array, frame: int, local: Array, pose: Array, mount: Array, nx: float, ny: float, nz: float, row: Array
) -> None:
    """Fill in coefficients (9,) of v, w and the arm for the speed of a point of the arm against a direction.

    ``local`` (3,) [m]: the point in its frame, an index into `ARM_FRAMES`; T from `fk_arm`. The direction is along the
    axes of the planar frame of ``pose``.
    """
    px, py, pz = T[frame, 0, 3], T[frame, 1, 3], T[frame, 2, 3]
    for a in range(3):
        px += T[frame, 0, a] * local[a]
        py += T[frame, 1, a] * local[a]
        pz += T[frame, 2, a] * local[a]
    c, s = math.cos(pose[2]), math.sin(pose[2])
    x, y = mount[0] + px, mount[1] + py
    row[0] = -(nx * c + ny * s + nz * 0.0)
    row[1] = -(nx * -(s * x + c * y) + ny * (c * x - s * y) + nz * 0.0)
    for k in range(7):
        vx, vy, vz = 0.0, 0.0, 0.0
        if k < frame:
            ax, ay, az = T[k + 1, 0, 2], T[k + 1, 1, 2], T[k + 1, 2, 2]
            rx, ry, rz = px - T[k + 1, 0, 3], py - T[k + 1, 1, 3], pz - T[k + 1, 2, 3]
            vx, vy, vz = ay * rz - az * ry, az * rx - ax * rz, ax * ry - ay * rx
        row[2 + k] = -(nx * (c * vx - s * vy) + ny * (s * vx + c * vy) + nz * vz)


@njit(cache=True)
def _furniture_rows(arm: Arm, balls: Balls, d_s: Array, d_i: Array, solids: Solids, avoidance: Numbers) -> Rows:
    a, turn = avoidance[0], arm.T_odom_world[2]
    c, sine = math.cos(turn), math.sin(turn)
    dx, dy = arm.mount[0] - arm.T_odom_world[0], arm.mount[1] - arm.T_odom_world[1]
    there = np.array([c * dx + sine * dy, -sine * dx + c * dy, arm.base_mount[2], arm.pose[2] - turn])
    distance, away, ball = body_distances(arm.T, balls, d_i + a.furniture_lead, there, solids, np.int64(-1))
    rows = _damper_rows(arm, balls, (distance, away, ball), d_s, d_i, a.xi, turn)
    return _shallow(rows, np.int64(_MOST))


@njit(cache=True)
def _own_rows(arm: Arm, balls: Balls, d_s: Array, d_i: Array, solids: Solids, avoidance: Numbers) -> Rows:
    there = np.array([arm.base_mount[0], arm.base_mount[1], arm.base_mount[2], 0.0])
    distance, away, ball = body_distances(arm.T, balls, d_i, there, solids, np.int64(COLUMN))
    rows = _damper_rows(arm, balls, (distance, away, ball), d_s, d_i, avoidance[0].xi, arm.pose[2])
    rows.G[:, :2] = 0.0
    return _shallow(rows, np.int64(_MOST_OWN))


@njit(cache=True)
def _shallow(rows: Rows, most: int) -> Rows:
    """The first ``most`` rows, none of which asks for a faster retreat than `_FASTEST_RETREAT`."""
    return Rows(rows.G[:most], np.maximum(rows.h[:most], _FASTEST_RETREAT), rows.name[:most])


@njit(cache=True)
def _damper_rows(
    arm: Arm, balls: Balls, near: tuple[Array, Array, IntArray], d_s: Array, d_i: Array, xi: float, turn: float
) -> Rows:
    """One row per body and solid, nearest first, for the speed of its nearest ball; ``name``: body * n + solid.

    ``near``: distances, directions and balls as of `body_distances`; ``turn``: heading of their frame in the odometry
    frame.
    """
    distance, normal, ball = near
    solids = distance.shape[1]
    flat = distance.ravel()
    order = nearest_first(flat)
    rows, limit, which = np.empty((len(order), 9)), np.empty(len(order)), np.empty(len(order), dtype=np.int64)
    c, s = math.cos(turn), math.sin(turn)
    for count in range(len(order)):
        index = order[count]
        b, k = index // solids, index % solids
        i = ball[b, k]
        nx = c * normal[b, k, 0] - s * normal[b, k, 1]
        ny = s * normal[b, k, 0] + c * normal[b, k, 1]
        approach_row(
            arm.T, balls.frame[i], balls.centre[i], arm.pose, arm.base_mount, nx, ny, normal[b, k, 2], rows[count]
        )
        limit[count] = damper_line(flat[index], d_s[b], d_i[b], xi)
        which[count] = index
    return Rows(rows, limit, which)


@njit(cache=True)
def _link_rows(arm: Arm, balls: Balls, points: Array, static: NDArray[np.bool_], avoidance: Numbers) -> Rows:
    moving = _rows_of_seen(arm, balls, points, static, np.bool_(False), avoidance)
    at_rest = _rows_of_seen(arm, balls, points, static, np.bool_(True), avoidance)
    return Rows(
        np.concatenate((moving.G, at_rest.G)),
        np.concatenate((moving.h, np.maximum(at_rest.h, 0.0))),
        np.concatenate((moving.name, at_rest.name)),
    )


@njit(cache=True)
def _rows_of_seen(
    arm: Arm, balls: Balls, points: Array, static: NDArray[np.bool_], at_rest: bool, avoidance: Numbers
) -> Rows:
    """Rows of the static points, if ``at_rest``, or of the moving ones."""
    a = avoidance[0]
    d_s, d_i = (_SEEN_D_S, a.furniture_d_i) if at_rest else (a.link_d_s, a.link_d_i)
    near = np.empty(points.shape)
    count = 0
    for k in range(points.shape[0]):
        dx, dy = points[k, 0] - arm.mount[0], points[k, 1] - arm.mount[1]
        if static[k] == at_rest and dx * dx + dy * dy < _REACH * _REACH:
            near[count, 0], near[count, 1] = points[k, 0], points[k, 1]
            count += 1
    if count == 0:
        return Rows(np.empty((0, 9)), np.empty(0), np.empty(0, dtype=np.int64))
    found = seen_distances(arm.T, balls, np.int64(HAND_BODY), d_i, near[:count], arm.mount, arm.pose[2])
    return _damper_rows(arm, balls, found, np.full(HAND_BODY, d_s), np.full(HAND_BODY, d_i), a.xi, 0.0)


@njit(cache=True)
def seen_distances(
    T: Array, balls: Balls, bodies: int, d_i: float, points: Array, mount: Array, heading: float
) -> tuple[Array, Array, IntArray]:
    """Horizontal distance of the nearest ball of each of the first `bodies` to the nearest point, when below d_i.

    Shapes (bodies, 1), (bodies, 1, 3) away from the point, and (bodies, 1) index of the ball; odometry frame.
    """
    distance = np.full((bodies, 1), np.inf)
    normal = np.zeros((bodies, 1, 3))
    ball = np.zeros((bodies, 1), dtype=np.int64)
    c, s = math.cos(heading), math.sin(heading)
    centre = balls.centre
    for i in range(balls.frame.shape[0]):
        b = balls.body[i]
        if b >= bodies or balls.radius[i] <= 0.0:
            continue
        f = balls.frame[i]
        px = T[f, 0, 3] + T[f, 0, 0] * centre[i, 0] + T[f, 0, 1] * centre[i, 1] + T[f, 0, 2] * centre[i, 2]
        py = T[f, 1, 3] + T[f, 1, 0] * centre[i, 0] + T[f, 1, 1] * centre[i, 1] + T[f, 1, 2] * centre[i, 2]
        x, y = mount[0] + c * px - s * py, mount[1] + s * px + c * py
        own = balls.radius[i] + _HALF_CELL
        least = max(0.0, min(d_i, distance[b, 0]) + own) ** 2
        for k in range(points.shape[0]):
            dx, dy = x - points[k, 0], y - points[k, 1]
            square = dx * dx + dy * dy
            if square < least and square > 1e-12:
                least, length = square, math.sqrt(square)
                distance[b, 0] = length - own
                normal[b, 0, 0], normal[b, 0, 1] = dx / length, dy / length
                ball[b, 0] = i
    return distance, normal, ball


@njit(cache=True)
def furniture_distances(avoidance: Numbers, touching: bool, blind: float, sd: float) -> tuple[Array, Array]:
    """d_s and d_i of each body to furniture [m], shape (8,); smaller while ``touching`` the support in a grasp.

    d_i - d_s is at least xi * ``blind``, so that an arm that gets no new command for ``blind`` [s] stops short of d_s.
    ``sd`` [m]: 1 sd of the robot's position on the map.
    """
    a = avoidance[0]
    d_s, d_i = np.full(len(BODIES), a.furniture_d_s + _PLACE_SDS * sd), np.full(len(BODIES), a.furniture_d_i)
    if touching:
        d_s[:] = (1.0 - YIELDS) * a.furniture_d_s + sd  # 2 sd would lift a closing hand between two solids
        d_s[FINGERS:HELD], d_i[FINGERS:HELD] = a.fingers_d_s, a.fingers_d_i
        d_s[HELD], d_i[HELD] = -a.fingers_d_i, a.fingers_d_s
    return d_s, np.maximum(d_i, d_s + a.xi * blind)


@njit(cache=True)
def lidar_limits(
    gripper: Array, points: Array, static: NDArray[np.bool_], targets: Array, avoidance: Numbers
) -> LidarLimits:
    """The nearest moving and the nearest static point of each sector round the gripper, with d_s and damper line.

    ``points`` (m, 2) [m] and ``static`` (m,) as in `ArmObstacles`. ``targets`` (t, 2) [m]: grasps that are under way,
    for which static obstacles give way.
    """
    a = avoidance[0]
    count = 0
    near = np.empty(points.shape)
    at_rest = np.empty(points.shape[0], dtype=np.bool_)
    if a.enabled:
        for i in range(points.shape[0]):
            if _near(points[i], gripper, targets):
                near[count, 0], near[count, 1], at_rest[count] = points[i, 0], points[i, 1], static[i]
                count += 1
    if count == 0:
        none = np.empty(0)
        return LidarLimits(near[:0], none, none, none, at_rest[:0])
    d_s = np.full(count, a.d_s)
    if targets.shape[0]:
        distances = np.full(count, np.inf)
        label_target_distance(near[:count], at_rest[:count], targets, _LINK, distances)
        for i in range(count):
            d_s[i] = max(0.0, min(d_s[i], distances[i] - a.static_margin))
    seen, still = near[:count], at_rest[:count]
    reach, x, y = a.d_i + a.lead, gripper[0], gripper[1]
    picked = np.concatenate((
        _nearest_per_sector(seen, ~still, reach, x, y, a.moving_sectors),
        _nearest_per_sector(seen, still, reach, x, y, a.sectors),
    ))  # fmt: skip
    normal, distance = np.empty((len(picked), 2)), np.empty(len(picked))
    chosen, allowed = np.empty(len(picked)), np.empty(len(picked))
    for k in range(len(picked)):
        i = picked[k]
        dx, dy = near[i, 0] - gripper[0], near[i, 1] - gripper[1]
        distance[k], chosen[k] = math.hypot(dx, dy), d_s[i]
        normal[k, 0], normal[k, 1] = dx / max(distance[k], 1e-6), dy / max(distance[k], 1e-6)
        room = distance[k] - (0.0 if at_rest[i] else a.moving_margin)
        allowed[k] = damper_line(room, chosen[k], a.d_i, a.xi)
    return LidarLimits(normal, distance, chosen, allowed, at_rest[picked])


@njit(cache=True)
def _near(point: Array, gripper: Array, targets: Array) -> bool:
    """True for a point near enough to matter to the gripper or to a grasp."""
    dx, dy = point[0] - gripper[0], point[1] - gripper[1]
    if dx * dx + dy * dy < _REACH * _REACH:
        return True
    for t in range(targets.shape[0]):
        dx, dy = point[0] - targets[t, 0], point[1] - targets[t, 1]
        if dx * dx + dy * dy < _REACH * _REACH:
            return True
    return False


@njit(cache=True)
def label_target_distance(points: Array, static: NDArray[np.bool_], targets: Array, link: float, out: Array) -> None:
    """For each static cell, the distance of its whole obstacle to the nearest target; other entries stay.

    Static cells less than ``link`` apart are one obstacle.
    """
    count = points.shape[0]
    label = np.full(count, -1, dtype=np.int64)
    stack = np.empty(count, dtype=np.int64)
    members = np.empty(count, dtype=np.int64)
    for seed in range(count):
        if label[seed] >= 0 or not static[seed]:
            continue
        label[seed] = seed
        stack[0] = seed
        size, found = 1, 0
        nearest = np.inf
        while size:
            size -= 1
            i = stack[size]
            members[found] = i
            found += 1
            for t in range(targets.shape[0]):
                nearest = min(nearest, math.hypot(points[i, 0] - targets[t, 0], points[i, 1] - targets[t, 1]))
            for j in range(count):
                if label[j] < 0 and static[j]:
                    dx, dy = points[i, 0] - points[j, 0], points[i, 1] - points[j, 1]
                    if dx * dx + dy * dy < link * link:
                        label[j] = seed
                        stack[size] = j
                        size += 1
        for k in range(found):
            out[members[k]] = nearest


@njit(cache=True)
def _nearest_per_sector(
    points: Array, of_kind: NDArray[np.bool_], reach: float, x: float, y: float, sectors: int
) -> NDArray[np.int64]:
    """Index of the nearest point of that kind in each sector, within reach, nearest first."""
    best = np.full(sectors, np.inf)
    index = np.full(sectors, -1, dtype=np.int64)
    for i in range(points.shape[0]):
        dx, dy = points[i, 0] - x, points[i, 1] - y
        if not of_kind[i] or dx * dx + dy * dy >= reach * reach:
            continue
        d = math.sqrt(dx * dx + dy * dy)
        sector = int((math.atan2(dy, dx) + math.pi) / (2.0 * math.pi) * sectors) % sectors
        if d < best[sector]:
            best[sector], index[sector] = d, i
    return index[nearest_first(best)]


@njit(cache=True)
def nearest_first(distance: Array) -> NDArray[np.int64]:
    """Indices of the finite distances, nearest first; equal ones in the order of `np.argsort`."""
    order, count, unsorted = np.empty(distance.shape[0], dtype=np.int64), 0, False
    for i in range(distance.shape[0]):
        if not distance[i] < np.inf:
            continue
        if count == _SHORT:
            unsorted = True
            break
        k = count
        while k > 0 and distance[i] < distance[order[k - 1]]:
            order[k] = order[k - 1]
            k -= 1
        unsorted = unsorted or (k > 0 and distance[i] == distance[order[k - 1]])
        order[k] = i
        count += 1
    if not unsorted:
        return order[:count]
    close = np.flatnonzero(distance < np.inf)
    if distance.shape[0] <= _FEW:
        return np.argsort(distance)[: len(close)]
    return close[np.argsort(distance[close])]
