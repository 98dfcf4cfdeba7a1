"""Bodies that a person can add, hold and throw, as convex outlines on the floor."""

import math
from dataclasses import dataclass

import msgspec
import numpy as np

from motm_twin.model.edits import AddObstacle
from motm_twin.model.geometry import Array, wrap_angle
from motm_twin.model.scene import Agent
from motm_twin.sim.solids import obstacle_disc, rectangle

TEMI_SPEED, TEMI_RADIUS, TEMI_HEIGHT = 0.4, 0.25, 1.0  # [m/s], [m], [m]
PERSON_SPEED, PERSON_RADIUS, PERSON_HEIGHT = 1.0, 0.25, 1.7


@dataclass(frozen=True, kw_only=True)
class Outline:
    """A convex polygon (k, 2), counter-clockwise, or with one corner a disc of ``radius`` [m], from the floor up."""

    corners: Array
    radius: float
    height: float  # [m]

    def shifted(self, way: Array) -> "Outline":
        """Moved by a way [m], shape (2,)."""
        return Outline(corners=self.corners + way, radius=self.radius, height=self.height)


def obstacle_outline(item: AddObstacle) -> Outline:
    """Outline of an obstacle."""
    disc = obstacle_disc(item)
    if disc is None:
        return Outline(corners=rectangle(item.x, item.y, item.heading, item.size), radius=0.0, height=item.size[2])
    return disc_outline(item.x, item.y, *disc)


def disc_outline(x: float, y: float, radius: float, height: float) -> Outline:
    """Outline of something round."""
    return Outline(corners=np.array([[x, y]], dtype=float), radius=radius, height=height)


def added_agent(edit: AddObstacle) -> Agent | None:
    """The agent that a person adds with this edit; None when it adds a box or cylinder."""
    if edit.shape == "temi":
        speed, radius, height = TEMI_SPEED, TEMI_RADIUS, TEMI_HEIGHT
    elif edit.shape == "person":
        speed, radius, height = PERSON_SPEED, PERSON_RADIUS, PERSON_HEIGHT
    else:
        return None
    return Agent(
        name=edit.name,
        start=(edit.x, edit.y, wrap_angle(edit.heading)),
        speed=speed,
        radius=radius,
        height=height,
        kind=edit.shape,
    )


def placed(item: AddObstacle, x: float, y: float, heading: float) -> AddObstacle:
    """An obstacle at another place."""
    return msgspec.structs.replace(item, x=x, y=y, heading=heading)


def capped(velocity: tuple[float, float], largest: float) -> tuple[float, float]:
    """A velocity [m/s] of the same direction, no faster than ``largest``."""
    speed = math.hypot(*velocity)
    share = 1.0 if speed <= largest else largest / speed
    return share * velocity[0], share * velocity[1]
