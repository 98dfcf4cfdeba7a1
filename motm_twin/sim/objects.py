"""Cubes: at rest, held by the gripper, or falling. Kinematic: what lands stays where it lands."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from motm_twin.model.geometry import Array, from_frame, to_frame
from motm_twin.model.scene import Bin, SceneObject
from motm_twin.sim.kernels import polygon_distance
from motm_twin.sim.solids import Solids

GRAVITY = 9.81  # [m/s^2]
FLOOR_LEVEL = 0.05  # [m] a support below this is the floor: what lies there is "dropped"
SUPPORT_SLACK = 0.005  # [m] by which a support may stick into an object from below and still carry it


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
        self.yaw = yaw
        c, s = math.cos(yaw), math.sin(yaw)
        self.rotation = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def start_objects(objects: Sequence[SceneObject]) -> list[ObjectState]:
    """All objects of a scene, resting."""
    states = []
    for item in objects:
        state = ObjectState(name=item.name, position=np.array(item.position), yaw=item.yaw, side=item.side)
        state.turn_to(item.yaw)
        states.append(state)
    return states


class ObjectWorld:
    """Support and fall of objects among furniture, bins and each other."""

    def __init__(self, bins: Sequence[Bin], dt: float) -> None:
        """Bins of the scene; substeps of dt [s]."""
        self.bins = tuple(bins)
        self.dt = dt
        self._bin_names = {box.name for box in bins}

    def support(self, item: ObjectState, objects: Sequence[ObjectState], solids: Solids) -> tuple[float, str]:
        """Height [m] of what would carry the object from below, and the bin it belongs to ('' for none)."""
        x, y = float(item.position[0]), float(item.position[1])
        limit = item.bottom + SUPPORT_SLACK
        best, where = 0.0, ""
        for i, name in enumerate(solids.names):
            top = solids.z[i, 1]
            if best <= top <= limit and name not in self._bin_names:
                if polygon_distance(x, y, solids.corners, solids.first[i], solids.first[i + 1]) == 0.0:
                    best, where = float(top), ""
        for i in range(len(solids.disc_names)):
            top = solids.disc_z[i, 1]
            inside = math.hypot(x - solids.discs[i, 0], y - solids.discs[i, 1]) <= solids.discs[i, 2]
            if best <= top <= limit and inside:
                best, where = float(top), ""
        for box in self.bins:
            if best <= box.floor_z <= limit and self._over(box, item):
                best, where = box.floor_z, box.name
        for other in objects:
            top = other.bottom + other.side
            if other is item or other.state in ("held", "falling") or not best <= top <= limit:
                continue
            if math.hypot(x - other.position[0], y - other.position[1]) < 0.5 * (item.side + other.side):
                best = top
                where = other.state.removeprefix("binned:") if other.state.startswith("binned:") else ""
        return best, where

    def check_support(self, item: ObjectState, objects: Sequence[ObjectState], solids: Solids) -> None:
        """Let a resting object fall when nothing carries it (any more)."""
        if item.bottom - self.support(item, objects, solids)[0] > SUPPORT_SLACK:
            item.state = "falling"
            item.velocity = np.zeros(3)

    def fall(self, item: ObjectState, objects: Sequence[ObjectState], solids: Solids) -> None:
        """One substep of free flight; comes to rest on the first support met."""
        height, where = self.support(item, objects, solids)
        item.velocity[2] -= GRAVITY * self.dt
        item.position = item.position + item.velocity * self.dt
        for box in self.bins:
            if item.bottom < box.rim_z and item.bottom > box.floor_z - 0.5 * item.side and self._over(box, item):
                self._keep_inside(box, item)
        if item.bottom > height:
            return
        item.position[2] = height + 0.5 * item.side
        item.velocity = np.zeros(3)
        if where:
            item.state = f"binned:{where}"
        else:
            item.state = "dropped" if height < FLOOR_LEVEL else "resting"

    def _over(self, box: Bin, item: ObjectState) -> bool:
        local = to_frame(np.array([*box.centre, box.yaw]), item.position)
        return max(abs(local[0]), abs(local[1])) <= 0.5 * box.side

    def _keep_inside(self, box: Bin, item: ObjectState) -> None:
        """Slide down along the walls: what is over the rim ends up inside, and no longer moves sideways there."""
        frame = np.array([*box.centre, box.yaw])
        local = to_frame(frame, item.position)
        turn = item.yaw - box.yaw
        room = 0.5 * box.side - box.wall - 0.5 * item.side * (abs(math.cos(turn)) + abs(math.sin(turn)))
        for axis in range(2):
            if abs(local[axis]) > room:
                local[axis] = math.copysign(max(room, 0.0), local[axis])
                item.velocity[:2] = 0.0
        item.position = from_frame(frame, local)
