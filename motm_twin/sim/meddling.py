"""Somebody who moves the cube that the robot is coming for, as soon as the robot is near (`model.scene.Faults`)."""

import math
from collections.abc import Iterator, Sequence

import numpy as np

from motm_twin.model.edits import MoveObject
from motm_twin.model.geometry import Array
from motm_twin.model.scene import Pick, Scene
from motm_twin.sim.objects import ObjectState
from motm_twin.sim.put_down import put_down
from motm_twin.sim.solids import Solids

_RNG_MEDDLING = 0x3EDD1E
_DIRECTIONS = 16  # that are tried, beginning with one that is drawn
_LEVEL = 1e-6  # [m] of height by which what carries the cube may differ


class Meddler:
    """Moves each cube once, and only one that nobody has touched: it still stands exactly where the scene has it."""

    def __init__(self, scene: Scene) -> None:
        """Of a scene whose cubes are not moved it does nothing."""
        self._by, self._within = scene.faults.cube_moved_by, scene.faults.cube_moved_within
        self._starts = {item.name: item.position for item in scene.objects}
        self._order = [task.object for task in scene.tasks if isinstance(task, Pick)]
        drawn = np.random.default_rng([scene.seed, _RNG_MEDDLING]).uniform(0.0, 2.0 * math.pi, len(self._order))
        self._angles = dict(zip(self._order, (float(angle) for angle in drawn), strict=True))

    def attempts(self, objects: Sequence[ObjectState], pose: Array, solids: Solids) -> Iterator[MoveObject]:
        """Places for the cube that is picked next, the first that is free is meant; none when it is left alone."""
        if self._by <= 0.0:
            return
        states = {item.name: item for item in objects}
        item = next((states[name] for name in self._order if states[name].state == "resting"), None)
        if item is None or any(other.state in ("held", "falling") for other in objects):
            return
        x, y, z = self._starts[item.name]
        if math.hypot(x - pose[0], y - pose[1]) > self._within or not np.array_equal(item.position, (x, y, z)):
            return
        for k in range(_DIRECTIONS):
            angle = self._angles[item.name] + 2.0 * math.pi * k / _DIRECTIONS
            edit = MoveObject(name=item.name, x=x + self._by * math.cos(angle), y=y + self._by * math.sin(angle))
            if _carried_whole(objects, solids, edit, item):
                yield edit


def _carried_whole(objects: Sequence[ObjectState], solids: Solids, edit: MoveObject, item: ObjectState) -> bool:
    """Whether all four corners would be carried at the height that the cube has."""
    half = 0.5 * item.side * math.sqrt(2.0)
    for dx, dy in ((half, half), (half, -half), (-half, half), (-half, -half)):
        corner = MoveObject(name=edit.name, x=edit.x + dx, y=edit.y + dy)
        below, bin_name = put_down(objects, solids, corner)
        if bin_name or abs(float(below.position[2]) - float(item.position[2])) > _LEVEL:
            return False
    return True
