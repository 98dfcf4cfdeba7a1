"""Agents that walk: they go in any direction, and choose a velocity from where all others are and how they move."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from motm_twin.model.compiler import njit
from motm_twin.model.geometry import Array
from motm_twin.model.rvo import Neighbours
from motm_twin.sim.solids import Solids

AT_EASE = 1.0  # [1/s] of the distance that is left: the speed of one who walks up to where he stays
ASIDE = math.radians(3.0)  # to the right of its way that one prefers: two who meet exactly would stop for ever
FACES = 0.02  # [m/s] from which an agent that walks looks where it goes


@dataclass(frozen=True, kw_only=True)
class RobotShadow:
    """The robot in the plane as agents see it: its base now and predicted, and its arm."""

    corners: Array  # rectangles [m], the base as it stands first, shape (4 k, 2)
    first: NDArray[np.int64]  # shape (k + 1,)
    discs: Array  # of the arm, shape (d, 3)
    velocity: tuple[float, float] = (0.0, 0.0)  # [m/s] of the base frame

    @property
    def seen(self) -> bool:
        """There is a robot."""
        return len(self.corners) > 0

    @property
    def plan(self) -> tuple[Array, NDArray[np.int64], Array]:
        """Corners, the first of each rectangle, and discs, for kernels."""
        return self.corners, self.first, self.discs

    def base(self, grown: float) -> Array:
        """Corners of the base as it stands, moved out by ``grown`` [m] along both axes, shape (4, 2)."""
        corners = self.corners[:4]
        along, across = corners[1] - corners[0], corners[3] - corners[0]
        out = grown * along / math.hypot(*along), grown * across / math.hypot(*across)
        return corners + np.array([-out[0] - out[1], out[0] - out[1], out[0] + out[1], out[1] - out[0]])

    def round(self) -> Array:
        """Discs over base and arm, shape (k, 3); the arm's only where it reaches beyond the base's."""
        middle = self.corners[:4].mean(axis=0)
        radius = math.dist(middle.tolist(), self.corners[0].tolist())
        reach = np.hypot(*(self.discs[:, :2] - middle).T) + self.discs[:, 2]
        return np.vstack([[*middle, radius], self.discs[reach > radius]])


NO_ROBOT = RobotShadow(corners=np.zeros((0, 2)), first=np.zeros(1, dtype=np.int64), discs=np.zeros((0, 3)))


@dataclass(frozen=True, kw_only=True)
class Crowd:
    """All agents at one instant, and what is about them."""

    positions: Array  # [m], shape (n, 2)
    velocities: Array  # [m/s], shape (n, 2)
    radii: Array  # [m], shape (n,)
    preferred: Array  # velocity that each would have alone [m/s], shape (n, 2)
    speeds: Array  # largest [m/s], shape (n,)
    sees_robot: NDArray[np.bool_]  # shape (n,)
    robot: RobotShadow
    obstacles: Solids


def preferred_velocity(position: Array, goal: tuple[float, float], speed: float, *, stays: bool) -> Array:
    """Velocity [m/s] towards a goal [m], a little to the right, shape (2,); slower where one stays."""
    way = np.array(goal) - position
    distance = math.hypot(*way)
    if distance == 0.0:
        return np.zeros(2)
    way *= (min(speed, AT_EASE * distance) if stays else speed) / distance
    c, s = math.cos(ASIDE), math.sin(ASIDE)
    return np.array([c * way[0] + s * way[1], c * way[1] - s * way[0]])


@njit(cache=True)
def walk(pose: Array, v: float, wanted: Array, acceleration: float, dt: float) -> tuple[Array, float]:
    """One substep of an agent that goes in any direction, at an acceleration up to that given: pose and speed.

    Its heading is the direction in which it goes; ``wanted``: velocity [m/s], shape (2,).
    """
    vx, vy = v * math.cos(pose[2]), v * math.sin(pose[2])
    dx, dy = wanted[0] - vx, wanted[1] - vy
    change = math.hypot(dx, dy)
    share = 1.0 if change <= acceleration * dt else acceleration * dt / change
    new_x, new_y = vx + share * dx, vy + share * dy
    speed = math.hypot(new_x, new_y)
    if speed < FACES:
        wants = math.hypot(wanted[0], wanted[1])
        heading = math.atan2(wanted[1], wanted[0]) if wants >= FACES else pose[2]
        new_x, new_y = speed * math.cos(heading), speed * math.sin(heading)
    else:
        heading = math.atan2(new_y, new_x)
    there = np.array([pose[0] + 0.5 * (vx + new_x) * dt, pose[1] + 0.5 * (vy + new_y) * dt, heading])
    return there, speed


STEP = 0.05  # [s] after which overlapping bodies are to be apart: a look


def orca(crowd: Crowd) -> Array:
    """Velocity [m/s] that each agent chooses, shape (n, 2)."""
    chosen = np.zeros_like(crowd.preferred)
    for sees in (True, False):
        if (of := crowd.sees_robot == sees).any():
            chosen[of] = _choices(crowd, with_robot=sees and crowd.robot.seen)[of]
    return chosen


def _choices(crowd: Crowd, *, with_robot: bool) -> Array:
    """Velocities when all see the robot, or none."""
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
