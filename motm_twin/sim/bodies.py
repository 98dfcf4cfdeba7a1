"""Bodies that a person can add, hold, throw and put down, as convex outlines on the floor."""

import copy
import math
from collections.abc import Sequence
from dataclasses import dataclass

import msgspec
import numpy as np

from motm_twin.model.edits import AddObstacle, MoveObject
from motm_twin.model.geometry import Array, rectangle, wrap_angle
from motm_twin.model.profile import Footprint
from motm_twin.model.scene import PERSON_ACCELERATION, TEMI_ACCELERATION, Agent
from motm_twin.sim.objects import ObjectState, ObjectWorld, keep_inside
from motm_twin.sim.solids import Solids, obstacle_disc

_ADDED = {  # agents that a person adds [m/s], [m], [m/s^2]
    "temi": {"speed": 0.4, "radius": 0.25, "height": 1.0, "acceleration": TEMI_ACCELERATION},
    "person": {"speed": 1.0, "radius": 0.25, "height": 1.7, "acceleration": PERSON_ACCELERATION},
}


@dataclass(frozen=True, kw_only=True)
class Outline:
    """A convex polygon (k, 2), counter-clockwise, or with one corner a disc of ``radius`` [m], from the floor up."""

    corners: Array
    radius: float = 0.0
    height: float  # [m]

    def shifted(self, way: Array) -> "Outline":
        """Moved by a way [m], shape (2,)."""
        return Outline(corners=self.corners + way, radius=self.radius, height=self.height)


def obstacle_outline(item: AddObstacle) -> Outline:
    """Outline of an obstacle."""
    disc = obstacle_disc(item)
    if disc is None:
        return Outline(corners=rectangle((item.x, item.y, item.heading), item.size), height=item.size[2])
    return disc_outline(item.x, item.y, *disc)


def disc_outline(x: float, y: float, radius: float, height: float) -> Outline:
    """Outline of a round body."""
    return Outline(corners=np.array([[x, y]], dtype=float), radius=radius, height=height)


def added_agent(edit: AddObstacle) -> Agent | None:
    """The agent that a person adds with this edit; None when it adds a box or cylinder."""
    if edit.shape not in _ADDED:
        return None
    start = (edit.x, edit.y, wrap_angle(edit.heading))
    return Agent(name=edit.name, start=start, kind=edit.shape, **_ADDED[edit.shape])


def placed(item: AddObstacle, x: float, y: float, heading: float) -> AddObstacle:
    """An obstacle at another place."""
    return msgspec.structs.replace(item, x=x, y=y, heading=heading)


def capped(velocity: tuple[float, float], largest: float) -> tuple[float, float]:
    """The velocity [m/s], capped at a speed of ``largest``."""
    speed = math.hypot(*velocity)
    share = 1.0 if speed <= largest else largest / speed
    return share * velocity[0], share * velocity[1]


def put_down(objects: Sequence[ObjectState], solids: Solids, edit: MoveObject) -> tuple[ObjectState, str]:
    """Resting pose of an object placed by the user: upright on the topmost support, same yaw; and its bin."""
    item = copy.copy(next(item for item in objects if item.name == edit.name))
    others = [other for other in objects if other.name != edit.name]
    tops = [*solids.z[:, 1], *solids.disc_z[:, 1], *(other.bottom + other.side for other in others)]
    item.state, item.velocity = "resting", np.zeros(3)
    item.position = np.array([edit.x, edit.y, max(tops, default=0.0) + item.side])
    item.turn_to(item.yaw)
    below = ObjectWorld.support(item, others, solids, firm=True)
    for box in solids.bins:
        if box.name == below.bin:
            keep_inside(box, item)
    below = ObjectWorld.support(item, others, solids, firm=True)
    item.position[2] = below.height + 0.5 * item.side
    item.state = f"binned:{below.bin}" if below.bin else "resting"
    return item, below.bin


def square_outline(item: ObjectState) -> Outline:
    """The outline of an object that stands upright."""
    x, y, top = float(item.position[0]), float(item.position[1]), float(item.position[2]) + 0.5 * item.side
    return Outline(corners=rectangle((x, y, item.yaw), (item.side, item.side)), height=top)


def robot_outline(foot: Footprint, pose: Array) -> Outline:
    """The outline of the robot's base at a pose, shape (3,)."""
    x = float(pose[0]) + foot.offset_x * float(np.cos(pose[2]))
    y = float(pose[1]) + foot.offset_x * float(np.sin(pose[2]))
    return Outline(corners=rectangle((x, y, pose[2]), (foot.length, foot.width)), height=foot.height)
