"""Grasps that fail, or take longer, although the cube stands well between the fingers (`model.scene.Faults`).

What the robot sees of it is what a real one would: fingers that still move, fingers that end up closed, and a cube that
lies where it was pushed or dropped.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import msgspec
import numpy as np

from motm_twin.model.geometry import Array
from motm_twin.model.profile import Gripper as GripperSpec
from motm_twin.model.scene import Faults
from motm_twin.sim.gripper import EPSILON, Gripper, GripperState
from motm_twin.sim.objects import ObjectState, ObjectWorld

_RNG_FAULTS = 0xFA0175


def gripper_with(faults: Faults, spec: GripperSpec, objects: ObjectWorld, dt: float, seed: int) -> Gripper:
    """The gripper of a scene: the plain one unless grasps may go wrong."""
    plain = msgspec.structs.replace(faults, inject=None) == Faults()
    return Gripper(spec, objects, dt) if plain else FaultyGripper(faults, spec, objects, dt, seed)


@dataclass(kw_only=True)
class FaultyGripperState(GripperState):
    """Pads, what is between them, and what has gone wrong."""

    rng: np.random.Generator
    delay: float = 0.0  # [s] by which the newest closing takes longer
    tries: dict[str, int] = field(default_factory=dict)  # grasps of each cube so far, in the order of the first


class FaultyGripper(Gripper):
    """Lets grasps fail and dawdle as the scene says.

    Late fingers reach the cube as quickly as ever and then take longer to hold it firmly. Until they do, the rule of
    `grasp` has to hold.
    """

    def __init__(self, faults: Faults, spec: GripperSpec, objects: ObjectWorld, dt: float, seed: int) -> None:
        """``seed`` of the scene."""
        super().__init__(spec, objects, dt)
        self.faults = faults
        self._seed = seed

    def start(self) -> FaultyGripperState:
        """Open and empty."""
        return FaultyGripperState(width=self.spec.max_width, rng=np.random.default_rng([self._seed, _RNG_FAULTS]))

    def command(
        self, state: GripperState, command: str, now: float, tcp: Array, rotation: Array, cubes: Sequence[ObjectState]
    ) -> None:
        """React to a changed command at its time; a cube that is grasped now may be in for a fault."""
        assert isinstance(state, FaultyGripperState)
        before = state.phase
        super().command(state, command, now, tcp, rotation, cubes)
        if state.phase == "closing" and before != "closing":
            state.delay = 0.0
            if state.candidate:
                self._strike(state)

    def _strike(self, state: FaultyGripperState) -> None:
        """Decide what becomes of the grasp that begins; every grasp draws the same numbers, so none shifts another."""
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

    def _closed(self, state: GripperState, now: float) -> tuple[bool, float]:
        """As fingers close that take longer from the cube to a firm hold."""
        assert isinstance(state, FaultyGripperState)
        passed = now - state.began
        return passed >= self.spec.closing_time + state.delay - EPSILON, min(1.0, passed / self.spec.closing_time)
