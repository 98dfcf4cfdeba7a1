"""The arm side of a robot without an arm: the base drives as it is planned, and nothing else moves."""

import numpy as np

from motm_twin.control.manipulation import Manipulator
from motm_twin.control.types import ArmInputs, ArmStep
from motm_twin.model.geometry import frozen

STATUS = "no arm"  # of the program in every step
_REST, _NO_SLACK = frozen(np.zeros(7)), frozen(np.zeros(6))


class NoArm(Manipulator):
    """Passes the wanted twist of the base on; joints rest and the gripper stays open."""

    def step(self, inputs: ArmInputs) -> ArmStep:
        """The wanted twist as it is: the monitor keeps it within the limits."""
        if not np.isfinite(inputs.base_twist).all():
            return self._damped_stop(inputs, None, "wanted base twist is not finite")
        self._state.twist = inputs.base_twist.copy()
        return self._report(
            None, inputs, twist=frozen(inputs.base_twist), rates=_REST, slack=_NO_SLACK, active=(), status=STATUS,
            outcome="", reason="",
        )  # fmt: skip
