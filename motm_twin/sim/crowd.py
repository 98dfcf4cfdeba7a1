"""Agents that walk: they move in any direction, and choose a velocity from positions and motions of all others.

Two behaviours: `orca` (`model.rvo`), and social forces (Helbing and Molnar, Social force model for pedestrian dynamics,
Phys. Rev. E 51, 1995).
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from motm_twin.model.compiler import njit
from motm_twin.model.geometry import Array
from motm_twin.model.plant import SUBSTEP
from motm_twin.model.rvo import Neighbours
from motm_twin.sim.kernels import Index
from motm_twin.sim.solids import Solids

ARRIVAL_GAIN = 1.0  # [1/s] speed per metre of remaining distance, for a walker that stops at its goal
KEEP_RIGHT = math.radians(3.0)  # [rad] to the right of the goal: else two meeting head-on would block each other
FACES = 0.02  # [m/s] from which a walker faces its direction of motion


@dataclass(frozen=True, kw_only=True)
class RobotShadow:
    """The robot in the plane as agents see it: its base now and predicted, and its arm."""

    corners: Array  # rectangles [m], the present base first, shape (4 k, 2)
    first: NDArray[np.int64]  # shape (k + 1,)
    discs: Array  # of the arm, shape (d, 3)
    velocity: tuple[float, float] = (0.0, 0.0)  # [m/s] of the base frame

    @property
    def seen(self) -> bool:
        """True when there is a robot."""
        return len(self.corners) > 0

    @property
    def plan(self) -> tuple[Array, NDArray[np.int64], Array]:
        """Corners, the first of each rectangle, and discs, for kernels."""
        return self.corners, self.first, self.discs

    def base(self, grown: float) -> Array:
        """Corners of the present base, moved outwards by ``grown`` [m] along both axes, shape (4, 2)."""
        corners = self.corners[:4]
        along, across = corners[1] - corners[0], corners[3] - corners[0]
        out = grown * along / math.hypot(*along), grown * across / math.hypot(*across)
        return corners + np.array([-out[0] - out[1], out[0] - out[1], out[0] + out[1], out[1] - out[0]])

    def round(self) -> Array:
        """Discs that cover base and arm, shape (k, 3); those of the arm only beyond the disc of the base."""
        middle = self.corners[:4].mean(axis=0)
        radius = math.dist(middle.tolist(), self.corners[0].tolist())
        reach = np.hypot(*(self.discs[:, :2] - middle).T) + self.discs[:, 2]
        return np.vstack([[*middle, radius], self.discs[reach > radius]])


NO_ROBOT = RobotShadow(corners=np.zeros((0, 2)), first=np.zeros(1, dtype=np.int64), discs=np.zeros((0, 3)))


@dataclass(frozen=True, kw_only=True)
class Crowd:
    """All agents at one instant, and their surroundings."""

    positions: Array  # [m], shape (n, 2)
    velocities: Array  # [m/s], shape (n, 2)
    radii: Array  # [m], shape (n,)
    preferred: Array  # preferred velocity of each without others [m/s], shape (n, 2)
    speeds: Array  # largest [m/s], shape (n,)
    sees_robot: NDArray[np.bool_]  # shape (n,)
    robot: RobotShadow
    obstacles: Solids


def preferred_velocity(position: Array, goal: tuple[float, float], speed: float, *, stays: bool) -> Array:
    """Velocity [m/s] towards a goal [m], a little to the right, shape (2,); slower near a goal to stay at."""
    way = np.array(goal) - position
    distance = math.hypot(*way)
    if distance == 0.0:
        return np.zeros(2)
    way *= (min(speed, ARRIVAL_GAIN * distance) if stays else speed) / distance
    c, s = math.cos(KEEP_RIGHT), math.sin(KEEP_RIGHT)
    return np.array([c * way[0] + s * way[1], c * way[1] - s * way[0]])


@njit(cache=True)
def walk(pose: Array, v: float, desired: Array, acceleration: float, dt: float) -> tuple[Array, float]:
    """One substep of an agent that moves in any direction, with at most this acceleration: pose and speed.

    Its heading is its direction of motion; ``desired``: velocity [m/s], shape (2,).
    """
    vx, vy = v * math.cos(pose[2]), v * math.sin(pose[2])
    dx, dy = desired[0] - vx, desired[1] - vy
    change = math.hypot(dx, dy)
    share = 1.0 if change <= acceleration * dt else acceleration * dt / change
    new_x, new_y = vx + share * dx, vy + share * dy
    speed = math.hypot(new_x, new_y)
    if speed < FACES:
        wants = math.hypot(desired[0], desired[1])
        heading = math.atan2(desired[1], desired[0]) if wants >= FACES else pose[2]
        new_x, new_y = speed * math.cos(heading), speed * math.sin(heading)
    else:
        heading = math.atan2(new_y, new_x)
    there = np.array([pose[0] + 0.5 * (vx + new_x) * dt, pose[1] + 0.5 * (vy + new_y) * dt, heading])
    return there, speed


DECISION_STEPS = 5  # substeps between two observations of the world
STEP = DECISION_STEPS * SUBSTEP  # [s] in which overlapping bodies separate, and over which forces act


def orca(crowd: Crowd) -> Array:
    """Velocity [m/s] that each agent chooses, shape (n, 2)."""
    chosen = np.zeros_like(crowd.preferred)
    for sees in (True, False):
        if (of := crowd.sees_robot == sees).any():
            chosen[of] = _choices(crowd, with_robot=sees and crowd.robot.seen)[of]
    return chosen


def _choices(crowd: Crowd, *, with_robot: bool) -> Array:
    """Velocities if all agents see the robot, or if none does."""
    around = Neighbours(STEP)
    bodies = (crowd.positions, crowd.velocities, crowd.radii, crowd.speeds, crowd.preferred)
    for position, velocity, radius, speed, preferred in zip(*(part.tolist() for part in bodies), strict=True):
        around.prefer(around.add(position, velocity, radius, speed), preferred)
    if with_robot:
        speed = math.hypot(*crowd.robot.velocity)
        for x, y, radius in crowd.robot.round().tolist():
            around.add((x, y), crowd.robot.velocity, radius, speed)
    walls = crowd.obstacles
    around.stand((walls.polygon(i) for i in range(len(walls.first) - 1)), walls.discs.tolist())
    return around.chosen(len(crowd.positions))


RELAXATION = 0.5  # [s] tau: time to reach the desired velocity
STRENGTH, RANGE = 2.1, 0.3  # [m^2/s^2] V0 and [m] sigma: repulsion by others
WALL_STRENGTH, WALL_RANGE = 10.0, 0.2  # [m^2/s^2] U0 and [m] R: repulsion by walls
STRIDES = 2.0  # [s] Delta t: duration of the other's next step, which stretches its repulsion ellipse
SIGHT = math.cos(math.radians(100.0))  # cosine of phi: half of the field of view of 200 deg
BEHIND = 0.5  # c: weight of unseen bodies
FASTEST = 1.3  # largest speed, as a multiple of the desired one
CLOSEST = 0.01  # [m] least distance between bodies: the force stays finite when they overlap


def social_force(crowd: Crowd) -> Array:
    """Velocity [m/s] that each agent chooses, shape (n, 2).

    The forces of the paper, but between bodies with radii instead of points. The robot is represented by the nearest
    point of its base and arm, which moves as its base does.
    """
    robot, walls = crowd.robot, crowd.obstacles
    base = robot.corners[:4] if robot.seen else np.zeros((0, 2))
    first = np.array([0, 4] if robot.seen else [0], dtype=np.int64)
    return _step(
        np.hstack([crowd.positions, crowd.velocities, crowd.radii[:, None], crowd.speeds[:, None]]),
        crowd.preferred,
        crowd.sees_robot,
        (base, first, robot.discs),
        np.array(robot.velocity),
        walls.plan,
    )


@njit(cache=True)
def nearest(x: float, y: float, corners: Array, begin: int, end: int) -> tuple[float, float, float]:
    """Nearest point of the outline of a polygon, and its distance [m]: negative inside."""
    best, near_x, near_y, inside = np.inf, x, y, True
    for i in range(begin, end):
        j = i + 1 if i + 1 < end else begin
        ex, ey = corners[j, 0] - corners[i, 0], corners[j, 1] - corners[i, 1]
        px, py = x - corners[i, 0], y - corners[i, 1]
        if ex * py - ey * px < 0.0:
            inside = False
        length = ex * ex + ey * ey
        t = 0.0 if length == 0.0 else min(1.0, max(0.0, (px * ex + py * ey) / length))
        at_x, at_y = corners[i, 0] + t * ex, corners[i, 1] + t * ey
        distance = math.hypot(x - at_x, y - at_y)
        if distance < best:
            best, near_x, near_y = distance, at_x, at_y
    return near_x, near_y, -best if inside else best


@njit(cache=True)
def _repulsion(dx: float, dy: float, gap: float, velocity: Array) -> tuple[float, float]:
    """Repulsive acceleration [m/s^2] by another agent, which falls with the semi-minor axis b of an ellipse.

    b = sqrt((|r| + |r - v Dt|)^2 - |v Dt|^2) / 2, V = V0 exp(-b / sigma); the force is -grad V. ``dx``, ``dy``: unit
    vector from the other; ``gap`` [m].
    """
    gap = max(gap, CLOSEST)
    rx, ry = gap * dx, gap * dy
    sx, sy = velocity[0] * STRIDES, velocity[1] * STRIDES
    ahead = math.hypot(rx - sx, ry - sy)
    way2 = sx * sx + sy * sy
    b = 0.5 * math.sqrt(max((gap + ahead) * (gap + ahead) - way2, CLOSEST * CLOSEST))
    push = STRENGTH / RANGE * math.exp(-b / RANGE) * (gap + ahead) / (4.0 * b)
    from_x, from_y = (rx - sx) / max(ahead, CLOSEST), (ry - sy) / max(ahead, CLOSEST)
    return push * (dx + from_x), push * (dy + from_y)


@njit(cache=True)
def _seen(fx: float, fy: float, want: Array) -> float:
    """Weight of a force by its direction: w(e, f) = 1 when e f >= |f| cos phi, else c."""
    size, wants = math.hypot(fx, fy), math.hypot(want[0], want[1])
    if size == 0.0 or wants == 0.0:
        return 1.0
    return 1.0 if -(want[0] * fx + want[1] * fy) >= wants * size * SIGHT else BEHIND


@njit(cache=True)
def _step(
    agents: Array,
    preferred: Array,
    sees: NDArray[np.bool_],
    robot: tuple[Array, Index, Array],
    robot_velocity: Array,
    walls: tuple[Array, Index, Array],
) -> Array:
    """Velocities after `STEP`; ``agents``: x, y, their velocity, radius and speed, shape (n, 6)."""
    n = agents.shape[0]
    chosen = np.empty((n, 2))
    for i in range(n):
        x, y, vx, vy, radius, speed = agents[i]
        fx, fy = (preferred[i, 0] - vx) / RELAXATION, (preferred[i, 1] - vy) / RELAXATION
        for j in range(n):
            if j != i:
                dx, dy = x - agents[j, 0], y - agents[j, 1]
                distance = max(math.hypot(dx, dy), CLOSEST)
                gap = distance - radius - agents[j, 4]
                px, py = _repulsion(dx / distance, dy / distance, gap, agents[j, 2:4])
                weight = _seen(px, py, preferred[i])
                fx, fy = fx + weight * px, fy + weight * py
        if sees[i]:
            near_x, near_y, gap = _nearest_of(x, y, robot)
            if gap < np.inf:
                dx, dy = x - near_x, y - near_y
                distance = max(math.hypot(dx, dy), CLOSEST) * (1.0 if gap >= 0.0 else -1.0)
                px, py = _repulsion(dx / distance, dy / distance, gap - radius, robot_velocity)
                weight = _seen(px, py, preferred[i])
                fx, fy = fx + weight * px, fy + weight * py
        near_x, near_y, gap = _nearest_of(x, y, walls)
        if gap < np.inf:
            dx, dy = x - near_x, y - near_y
            distance = max(math.hypot(dx, dy), CLOSEST) * (1.0 if gap >= 0.0 else -1.0)
            push = WALL_STRENGTH / WALL_RANGE * math.exp(-max(gap, CLOSEST) / WALL_RANGE)
            fx, fy = fx + push * dx / distance, fy + push * dy / distance
        vx, vy = vx + fx * STEP, vy + fy * STEP
        size = math.hypot(vx, vy)
        share = 1.0 if size <= FASTEST * speed else FASTEST * speed / size
        chosen[i, 0], chosen[i, 1] = share * vx, share * vy
    return chosen


@njit(cache=True)
def _nearest_of(x: float, y: float, bodies: tuple[Array, Index, Array]) -> tuple[float, float, float]:
    """Nearest point of polygons and discs, and its distance [m]: negative inside, inf when there is none."""
    corners, first, discs = bodies
    near_x, near_y, best = x, y, np.inf
    for i in range(first.shape[0] - 1):
        at_x, at_y, distance = nearest(x, y, corners, first[i], first[i + 1])
        if distance < best:
            near_x, near_y, best = at_x, at_y, distance
    for i in range(discs.shape[0]):
        dx, dy = x - discs[i, 0], y - discs[i, 1]
        away = max(math.hypot(dx, dy), CLOSEST)
        if away - discs[i, 2] < best:
            best = away - discs[i, 2]
            near_x, near_y = discs[i, 0] + discs[i, 2] * dx / away, discs[i, 1] + discs[i, 2] * dy / away
    return near_x, near_y, best
