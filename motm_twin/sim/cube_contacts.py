"""Contacts of cubes with fingers that grasp or release them, and with each other."""

import math
from collections.abc import Collection, Iterator, Sequence
from typing import NamedTuple

import coal
import numpy as np

from motm_twin.model.exact import transposed_times
from motm_twin.model.geometry import Array
from motm_twin.model.scene import Bin
from motm_twin.sim.objects import ObjectState, over
from motm_twin.sim.referee_geometry import cube, set_upright
from motm_twin.sim.responsibility import Gauge

FINGERS = ("panda_leftfinger", "panda_rightfinger")
SIDE_BY_SIDE = 2e-4  # [m] largest overlap of cubes side by side: the simulation separates them to half of it
EDGE = 0.003  # [m] of a cube below a fingertip, from which the tip does not slide off
_STEEP_NORMAL = math.sqrt(0.5)  # component of the normal along the tool axis, from which a fingertip touches, not a pad

Pose = tuple[float, float, float, float]  # x, y, z [m], yaw [rad]


def poses_of(objects: Sequence[ObjectState]) -> tuple[Pose, ...]:
    """Poses of all objects."""
    return tuple((*item.position.tolist(), item.yaw) for item in objects)


def between_pads(hand: Array, width: float, cube: Array) -> bool:
    """True when a touching finger grasps or releases this cube: the cube's centre is between the pads.

    ``hand``: its transform; ``width`` [m] between the pads; ``cube``: x, y, z, yaw, shape (4,).
    """
    return abs(_offset_along_closing(hand, cube)) <= 0.5 * width


def stands_on(hand: Array, width: float, cube: Array, side: float, normal: Array) -> bool:
    """True when a fingertip presses on a cube between the pads from above, too far inside its edge to slide off.

    ``normal``: of the contact, shape (3,).
    """
    steep = abs(float(transposed_times(hand[:3, :3], normal)[2]))
    misfit = math.atan2(float(hand[1, 1]), float(hand[0, 1])) - float(cube[3])
    half = 0.5 * side * (abs(math.cos(misfit)) + abs(math.sin(misfit)))
    return steep > _STEEP_NORMAL and half + abs(_offset_along_closing(hand, cube)) - 0.5 * width > EDGE


def _offset_along_closing(hand: Array, cube: Array) -> float:
    """Position of a cube's centre along the closing axis [m]."""
    return float(transposed_times(hand[:3, :3], cube[:3] - hand[:3, 3])[1])


class Shove(NamedTuple):
    """Objects displaced in a substep, and the poses at which overlaps of all objects are tested."""

    places: tuple[Pose, ...]  # poses for the overlap test: present ones, but those before the push for pushed objects
    pushed: tuple[str, ...]
    moved: tuple[str, ...]  # objects at another place than before, including the pushed ones


def shoved(
    objects: Sequence[ObjectState], now: tuple[Pose, ...], before: tuple[Pose, ...], loose: Collection[str]
) -> Shove:
    """Displacement of objects since the last substep; ``loose``: objects that were held or falling then."""
    if now == before:
        return Shove(now, (), ())
    if len(now) != len(before):
        return Shove(now, (), tuple(item.name for item in objects))
    places, pushed, moved = list(now), [], []
    for k, item in enumerate(objects):
        if now[k] == before[k] or item.state == "held":
            continue
        moved.append(item.name)
        if item.name not in loose:
            pushed.append(item.name)
            places[k] = before[k]
    return Shove(tuple(places), tuple(pushed), tuple(moved))


class Meeting(NamedTuple):
    """Two overlapping cubes: the one that moved, the one that lay there, and the depth [m]."""

    comes: str
    lies: str
    depth: float


class CubePairs:
    """Finds cubes that overlap."""

    def __init__(self) -> None:
        self._gauge = Gauge()
        self._one, self._two = coal.Transform3s(), coal.Transform3s()

    def meetings(
        self, objects: Sequence[ObjectState], now: tuple[Pose, ...], shove: Shove, piled: Sequence[Bin] = ()
    ) -> Iterator[Meeting]:
        """Overlaps of each moved cube, at its present pose, with every other at its pose of ``shove.places``.

        ``piled``: bins in which cubes press on each other: a released cube may lie against another there.
        """
        for i, comes in enumerate(objects):
            if comes.name not in shove.moved or comes.state == "held":
                continue
            let_go = comes.state == "falling" or comes.state.startswith("binned:")
            if let_go and any(over(box, comes) for box in piled):
                continue
            for j, lies in enumerate(objects):
                twice = lies.name in shove.moved and lies.name not in shove.pushed and j < i
                if i == j or lies.state == "held" or twice:
                    continue
                depth = self._depth(comes, now[i], lies, shove.places[j])
                if depth > SIDE_BY_SIDE:
                    yield Meeting(comes.name, lies.name, depth)

    def _depth(self, comes: ObjectState, here: Pose, lies: ObjectState, there: Pose) -> float:
        reach = 0.5 * (comes.side + lies.side)
        if abs(here[2] - there[2]) >= reach or math.hypot(here[0] - there[0], here[1] - there[1]) >= 1.5 * reach:
            return 0.0
        set_upright(self._one, here)
        set_upright(self._two, there)
        return -self._gauge((cube(comes.side), self._one), (cube(lies.side), self._two))


def array_of(places: tuple[Pose, ...]) -> Array:
    """Places as an array, shape (n, 4)."""
    return np.array(places, dtype=float).reshape(-1, 4)
