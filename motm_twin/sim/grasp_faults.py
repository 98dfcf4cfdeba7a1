"""Grasps that fail or take longer, and cubes that somebody moves as the robot comes near (`model.scene.Faults`).

The robot sees what a real one would: fingers that still move, fingers that end up closed, a cube that lies where it was
pushed or dropped, a cube that is elsewhere.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import msgspec
import numpy as np

from motm_twin.model.edits import MoveObject
from motm_twin.model.geometry import Array
from motm_twin.model.scene import Faults, Pick, Scene
from motm_twin.sim.bodies import put_down
from motm_twin.sim.gripper import Gripper, GripperState
from motm_twin.sim.objects import ObjectState, ObjectWorld
from motm_twin.sim.solids import Solids

_RNG_FAULTS = 0xFA0175


def gripper_with(scene: Scene, objects: ObjectWorld, dt: float) -> Gripper:
    """The gripper of a scene: the regular one unless the scene has grasp faults."""
    usual = scene.robot.gripper, objects, dt, scene.grasp_rule, scene.grasp_speed
    plain = msgspec.structs.replace(scene.faults, inject=None) == Faults()
    return Gripper(*usual) if plain else FaultyGripper(scene.faults, scene.seed, *usual)


@dataclass(kw_only=True)
class FaultyGripperState(GripperState):
    """Gripper state, and the faults of its grasps."""

    rng: np.random.Generator
    delay: float = 0.0  # [s] by which the newest closing takes longer
    tries: dict[str, int] = field(default_factory=dict)  # grasps of each cube so far, in the order of the first


class FaultyGripper(Gripper):
    """Makes grasps fail or take longer as the scene says.

    Slow fingers reach the cube in the usual time and then take longer to hold it firmly. Until they do, the rule of
    `grasp` has to hold.
    """

    def __init__(self, faults: Faults, seed: int, *usual: Any) -> None:
        """``seed`` of the scene; ``usual``: as of `Gripper`."""
        super().__init__(*usual)
        self.faults, self._seed = faults, seed

    def start(self) -> FaultyGripperState:
        """Open and empty."""
        return FaultyGripperState(width=self.spec.max_width, rng=np.random.default_rng([self._seed, _RNG_FAULTS]))

    def command(
        self, state: GripperState, command: str, now: float, tcp: Array, rotation: Array, cubes: Sequence[ObjectState]
    ) -> None:
        """React to a changed command at its time; a grasp that begins now may draw a fault."""
        assert isinstance(state, FaultyGripperState)
        before = state.phase
        super().command(state, command, now, tcp, rotation, cubes)
        if state.phase == "closing" and before != "closing":
            state.delay = 0.0
            if state.candidate:
                self._strike(state)

    def _strike(self, state: FaultyGripperState) -> None:
        """Draw the fault of the grasp that begins; every grasp draws as many numbers, so none shifts another."""
        faults, name = self.faults, state.candidate
        state.tries[name] = tried = state.tries.get(name, 0) + 1
        chance, more = state.rng.random(2)
        if faults.only_object and list(state.tries).index(name) + 1 != faults.only_object:
            return
        state.delay = faults.grasp_delay + faults.grasp_delay_spread * more
        due = faults.grasp_misses + faults.grasp_slips
        if tried <= faults.grasp_misses or (tried > due and chance < faults.grasp_failure_probability):
            state.candidate = ""
        elif tried <= due:
            state.slid = True

    def _lasts(self, state: GripperState) -> float:
        """As of `Gripper`, with the additional time to a firm hold."""
        assert isinstance(state, FaultyGripperState)
        return self.spec.closing_time + state.delay


_RNG_MEDDLING = 0x3EDD1E
_DIRECTIONS = 16  # tried, beginning with a random one
_LEVEL = 1e-6  # [m] by which the support heights may differ


class CubeMover:
    """Moves each cube once, and only while it stands exactly where the scene has it."""

    def __init__(self, scene: Scene) -> None:
        """Does nothing for a scene without moved cubes."""
        self._by, self._within = scene.faults.cube_moved_by, scene.faults.cube_moved_within
        self._starts = {item.name: item.position for item in scene.objects}
        self._order = [task.object for task in scene.tasks if isinstance(task, Pick)]
        drawn = np.random.default_rng([scene.seed, _RNG_MEDDLING]).uniform(0.0, 2.0 * math.pi, len(self._order))
        self._angles = dict(zip(self._order, drawn.tolist(), strict=True))

    def attempts(self, objects: Sequence[ObjectState], pose: Array, solids: Solids) -> Iterator[MoveObject]:
        """Candidate places for the cube that is picked next, in order of preference; none when it is left alone."""
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
    """All four corners would be supported at the cube's present height."""
    half = 0.5 * item.side * math.sqrt(2.0)
    for dx, dy in ((half, half), (half, -half), (-half, half), (-half, -half)):
        corner = MoveObject(name=edit.name, x=edit.x + dx, y=edit.y + dy)
        below, bin_name = put_down(objects, solids, corner)
        if bin_name or abs(float(below.position[2]) - float(item.position[2])) > _LEVEL:
            return False
    return True
