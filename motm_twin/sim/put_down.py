"""Where an object comes to lie that a person puts down."""

import copy
from collections.abc import Sequence

import numpy as np

from motm_twin.model.edits import MoveObject
from motm_twin.model.geometry import Array
from motm_twin.model.profile import Footprint
from motm_twin.sim.bodies import Outline
from motm_twin.sim.objects import ObjectState, ObjectWorld, keep_inside
from motm_twin.sim.solids import Solids, rectangle


def put_down(objects: Sequence[ObjectState], solids: Solids, edit: MoveObject) -> tuple[ObjectState, str]:
    """The object on whatever is topmost below the point, upright with the same yaw; and the bin that it lies in."""
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
    return Outline(corners=rectangle(x, y, item.yaw, (item.side, item.side)), radius=0.0, height=top)


def robot_outline(foot: Footprint, pose: Array) -> Outline:
    """The outline of the robot's base at a pose, shape (3,)."""
    x = float(pose[0]) + foot.offset_x * float(np.cos(pose[2]))
    y = float(pose[1]) + foot.offset_x * float(np.sin(pose[2]))
    return Outline(corners=rectangle(x, y, float(pose[2]), (foot.length, foot.width)), radius=0.0, height=foot.height)
