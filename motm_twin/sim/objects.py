"""Cubes: at rest, held by the gripper, or falling. Kinematic: a cube stays where it lands."""

import copy
import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from motm_twin.model.edits import MoveObject
from motm_twin.model.geometry import Array, about_z, from_frame, to_frame
from motm_twin.model.scene import Bin, Pick, Place, SceneObject, Task
from motm_twin.sim.kernels import polygon_distance
from motm_twin.sim.solids import Solids

GRAVITY = 9.81  # [m/s^2]
FLOOR_LEVEL = 0.05  # [m] a lower support is the floor: objects there are "dropped"
BESIDE = 1e-4  # [m] by which cubes that lie side by side may overlap
SUPPORT_SLACK = 0.005  # [m] by which a support may penetrate an object from below and still carry it


@dataclass
class ObjectState:
    """One cube."""

    name: str
    position: Array  # centre, world [m], shape (3,)
    yaw: float
    side: float
    state: str = "resting"  # resting | held | falling | binned:<bin> | dropped
    velocity: Array = field(default_factory=lambda: np.zeros(3))  # [m/s] while falling
    rotation: Array = field(default_factory=lambda: np.eye(3))  # world, shape (3, 3)

    @property
    def bottom(self) -> float:
        """Height of the lower face [m]."""
        return float(self.position[2]) - 0.5 * self.side

    def turn_to(self, yaw: float) -> None:
        """Stand upright with this yaw [rad]."""
        self.yaw, self.rotation = yaw, about_z(yaw)


def start_objects(objects: Sequence[SceneObject]) -> list[ObjectState]:
    """All objects of a scene, resting."""
    states = []
    for item in objects:
        state = ObjectState(name=item.name, position=np.array(item.position), yaw=item.yaw, side=item.side)
        state.turn_to(item.yaw)
        states.append(state)
    return states


class Support(NamedTuple):
    """Support of an object from below."""

    height: float  # [m] of its top
    bin: str  # bin to which the support belongs, '' for none
    carrier: str  # solid, bin or object, 'floor' for none


class ObjectWorld:
    """Support and fall of objects among furniture, bins and each other."""

    def __init__(self, dt: float) -> None:
        """Substeps of dt [s]."""
        self.dt = dt

    @staticmethod
    def support(item: ObjectState, objects: Sequence[ObjectState], solids: Solids, *, firm: bool = False) -> Support:
        """Support of the object from below; ``firm``: a mere corner of another object does not count."""
        x, y = float(item.position[0]), float(item.position[1])
        limit = item.bottom + SUPPORT_SLACK
        best, where, carrier = 0.0, "", "floor"
        for i, name in enumerate(solids.names):
            top = solids.z[i, 1]
            if best <= top <= limit and name not in solids.bin_names:
                if polygon_distance(x, y, solids.corners, solids.first[i], solids.first[i + 1]) == 0.0:
                    best, where, carrier = float(top), "", name
        for i, name in enumerate(solids.disc_names):
            top = solids.disc_z[i, 1]
            inside = math.hypot(x - solids.discs[i, 0], y - solids.discs[i, 1]) <= solids.discs[i, 2]
            if best <= top <= limit and inside:
                best, where, carrier = float(top), "", name
        for box in solids.bins:
            if best <= box.floor_z <= limit and over(box, item):
                best, where, carrier = box.floor_z, box.name, box.name
        for other in objects:
            top = other.bottom + other.side
            if other is item or other.state in ("held", "falling") or not best <= top <= limit:
                continue
            if over_each_other(item, other, firm=firm):
                best, carrier = top, other.name
                where = other.state.removeprefix("binned:") if other.state.startswith("binned:") else ""
        return Support(best, where, carrier)

    def check_support(self, item: ObjectState, objects: Sequence[ObjectState], solids: Solids) -> None:
        """Let a resting object fall when nothing carries it (any more)."""
        if item.bottom - self.support(item, objects, solids)[0] > SUPPORT_SLACK:
            item.state = "falling"
            item.velocity = np.zeros(3)

    def fall(self, item: ObjectState, objects: Sequence[ObjectState], solids: Solids) -> None:
        """One substep of free flight; comes to rest on the first support met."""
        height, where, _ = self.support(item, objects, solids)
        item.velocity[2] -= GRAVITY * self.dt
        item.position = item.position + item.velocity * self.dt
        for box in solids.bins:
            if item.bottom < box.rim_z and item.bottom > box.floor_z - 0.5 * item.side and over(box, item):
                keep_inside(box, item)
        if item.bottom > height:
            return
        item.position[2] = height + 0.5 * item.side
        item.velocity = np.zeros(3)
        if where:
            item.state = f"binned:{where}"
        else:
            item.state = "dropped" if height < FLOOR_LEVEL else "resting"


def over_each_other(one: ObjectState, other: ObjectState, *, firm: bool) -> bool:
    """True when two upright cubes overlap in plan by more than cubes side by side may.

    ``firm``: their inscribed circles must overlap.
    """
    dx, dy = float(one.position[0] - other.position[0]), float(one.position[1] - other.position[1])
    away, reach = math.hypot(dx, dy), 0.5 * (one.side + other.side)
    if firm or away < reach - BESIDE or away > math.sqrt(2.0) * reach:
        return away < reach
    turn = one.yaw - other.yaw
    spread = abs(math.cos(turn)) + abs(math.sin(turn))
    for own, far in ((one, other), (other, one)):
        c, s = math.cos(own.yaw), math.sin(own.yaw)
        if max(abs(c * dx + s * dy), abs(c * dy - s * dx)) >= 0.5 * (own.side + far.side * spread) - BESIDE:
            return False
    return True


def over(box: Bin, item: ObjectState) -> bool:
    """True when the centre of an object is over a bin."""
    local = to_frame(np.array([*box.centre, box.yaw]), item.position)
    return max(abs(local[0]), abs(local[1])) <= 0.5 * box.side


def keep_inside(box: Bin, item: ObjectState) -> None:
    """Keep an object within the walls of a bin: one over the rim slides inside and stops moving sideways."""
    frame = np.array([*box.centre, box.yaw])
    local = to_frame(frame, item.position)
    turn = item.yaw - box.yaw
    room = 0.5 * box.side - box.wall - 0.5 * item.side * (abs(math.cos(turn)) + abs(math.sin(turn)))
    for axis in range(2):
        if abs(local[axis]) > room:
            local[axis] = math.copysign(max(room, 0.0), local[axis])
            item.velocity[:2] = 0.0
    item.position = from_frame(frame, local)


def riders(objects: Sequence[ObjectState], solids: Solids, names: Collection[str]) -> list[ObjectState]:
    """Objects that stand on one of these solids or lie in one of these bins, also those on top of others."""
    resting = [item for item in objects if item.state not in ("held", "falling")]
    carriers = {item.name: ObjectWorld.support(item, objects, solids).carrier for item in resting}
    riding: set[str] = set()
    while True:
        more = {name for name, carrier in carriers.items() if carrier in names or carrier in riding} - riding
        if not more:
            return [item for item in resting if item.name in riding]
        riding |= more


def carry(riding: Sequence[ObjectState], before: Array, after: Array) -> None:
    """Carry objects along with a body that moves from one planar pose to another, shapes (3,)."""
    for item in riding:
        item.position = from_frame(after, to_frame(before, item.position))
        item.turn_to(item.yaw + float(after[2] - before[2]))


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


def right_bins(tasks: Sequence[Task]) -> dict[str, tuple[str, ...]]:
    """Right bins of each object: for each of its picks, the bin of the next place task."""
    right: dict[str, tuple[str, ...]] = {}
    picked = ""
    for task in tasks:
        if isinstance(task, Pick):
            picked = task.object
        elif isinstance(task, Place) and picked:
            right[picked] = (*right.get(picked, ()), task.bin)
            picked = ""
    return right
