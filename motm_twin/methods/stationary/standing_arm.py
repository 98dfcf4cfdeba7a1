"""The arm of a robot that manipulates standing: the same arm, whose fingers wait until the base has come to rest."""

import dataclasses

import msgspec

from motm_twin.control.arm.controller import Manipulator
from motm_twin.control.arm.types import ArmInputs, ArmStep
from motm_twin.methods.method import ArmParts
from motm_twin.methods.stationary.parameters import StationaryParameters

_NEVER = -1.0  # [m/s] no hand is as slow as this


class StandingManipulator(Manipulator):
    """Fingers close on an object, and let go of it, only while the base stands."""

    def __init__(self, parts: ArmParts, parameters: StationaryParameters | None = None) -> None:
        super().__init__(parts.known, parts.parameters)
        self.stationary = parameters or StationaryParameters()
        waiting = msgspec.structs.replace(self.parameters, close_speed=_NEVER, release_speed=_NEVER)
        self._standing_rules = self._rules
        self._waiting_rules = dataclasses.replace(self._rules, parameters=waiting)

    def step(self, inputs: ArmInputs) -> ArmStep:
        """Decide base twist, joint rates and gripper for the next ``inputs.dt``."""
        v, w = inputs.observation.twist
        stands = abs(v) < self.stationary.stands_v and abs(w) < self.stationary.stands_w
        self._rules = self._standing_rules if stands else self._waiting_rules
        return super().step(inputs)
