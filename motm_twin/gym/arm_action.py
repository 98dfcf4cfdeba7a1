"""The whole robot as an agent commands it: a `Manipulator` whose joint rates and gripper are set from outside.

What remains of the arm side are its limits (speed, acceleration, joint limits) and what the robot can tell from its own
sensors: that it holds something, has lifted it, has let it go over the bin, or has lost it. Nothing keeps the arm off
furniture or people, and nothing chooses where it goes.
"""

from dataclasses import dataclass, field

import numpy as np

from motm_twin.control.arm.controller import Decision, Manipulator
from motm_twin.control.arm.parameters import ArmParameters, numbers
from motm_twin.control.arm.phases import enter
from motm_twin.control.arm.program import anchor, base_bounds, joint_bounds
from motm_twin.control.arm.types import ArmInputs, ArmStep
from motm_twin.control.arm.view import ManipulatorState, View
from motm_twin.model.exact import norm
from motm_twin.model.geometry import Array, frozen, to_frame
from motm_twin.model.known import KnownWorld

STATUS = "commanded from outside"
AT_OBJECT = 0.03  # [m] of the tool centre point from where the object is believed, for a grasp of it


@dataclass
class ArmActionState(ManipulatorState):
    """What the agent asks for, beside what an arm side remembers."""

    phase: str = "transit"
    asked_rates: Array = field(default_factory=lambda: np.zeros(7))  # [rad/s]
    asked_gripper: str = "open"
    over_bin: bool = False  # when it was let go


class ArmAction(Manipulator):
    """Does what it was told last, within the limits of the robot."""

    def __init__(self, known: KnownWorld, parameters: ArmParameters | None = None) -> None:
        super().__init__(known, parameters)
        self._base, self._lag = numbers(known.robot.base), known.robot.arm.velocity_lag
        self._state: ArmActionState = ArmActionState()

    def take(self, rates: Array, gripper: str) -> None:
        """Joint rates (7,) [rad/s] and gripper ("open" | "close") from the next arm step on."""
        self._state.asked_rates, self._state.asked_gripper = np.array(rates, dtype=float), gripper

    def step(self, inputs: ArmInputs) -> ArmStep:
        """Base twist, joint rates and gripper for the next ``inputs.dt``: those asked for, within their limits."""
        state, p = self._state, self.parameters
        view = self.look(inputs)
        outcome = self._fingers(view)
        anchor(state.twist, state.rates, (view.arm.wanted, view.arm.dq), self._base, inputs.dt, self._lag)
        state.twist = np.clip(inputs.base_twist, *base_bounds(state.twist, inputs.dt, self.profile))
        low, high = joint_bounds(view.q, state.rates, inputs.dt, p.qp)
        state.rates = np.clip(state.asked_rates, low, high)
        at_limit = np.flatnonzero((state.asked_rates < low) | (state.asked_rates > high))
        decided = Decision(
            twist=frozen(state.twist),
            rates=frozen(state.rates),
            active=tuple(f"joint {k + 1}" for k in at_limit),
            status=STATUS,
            outcome=outcome,
            reason=f"the arm is {STATUS}",
        )
        return self.report(view, inputs, decided)

    def _fingers(self, view: View) -> str:
        """The phase of this step, from what the gripper was told and what its width says; returns the outcome."""
        state = self._state
        if state.phase == "release":
            return self._let_go(view)
        if state.holding:
            return self._hold(view)
        state.gripper = state.asked_gripper
        if state.gripper == "open":
            state.phase = "transit"
        elif state.phase == "transit":
            enter(state, "closing", view.time)
        elif state.phase == "closing" and self._over(self.profile.gripper.closing_time, view):
            self._closed(view)
        return ""

    def _over(self, duration: float, view: View) -> bool:
        """The fingers have had their time [s] since the phase began, and stand."""
        return view.time - self._state.since >= duration - 0.5 * view.dt and not view.gripper_moving

    def _closed(self, view: View) -> None:
        """The fingers stand: on the object, when they are as far apart as it is wide, and where it is."""
        state, goal = self._state, view.goal
        fits = abs(view.width - goal.side) <= self.parameters.held_tolerance
        if goal.kind == "pick" and fits and norm(view.p - view.target) <= AT_OBJECT:
            state.holding, state.reported, state.side, state.anchor = True, False, goal.side, view.p.copy()
            enter(state, "lift", view.time)
        else:
            enter(state, "retry", view.time)

    def _hold(self, view: View) -> str:
        state, p = self._state, self.parameters
        if view.width < state.side - p.held_tolerance:
            return self._drop(view, "lost")
        if state.asked_gripper == "open":
            state.gripper, state.released, state.over_bin = "open", view.time, _over_bin(view)
            enter(state, "release", view.time)
        elif state.phase == "lift" and view.p[2] - state.anchor[2] >= p.picked_height:
            state.reported = True
            enter(state, "carry", view.time)
            return "picked"
        return ""

    def _let_go(self, view: View) -> str:
        if not self._over(self.profile.gripper.opening_time, view):
            return ""
        return self._drop(view, "placed" if self._state.over_bin else "lost")

    def _drop(self, view: View, outcome: str) -> str:
        """Nothing is held any more; of what was never lifted there is nothing to tell."""
        state = self._state
        told = state.reported
        state.holding, state.reported, state.released = False, False, None
        state.gripper = state.asked_gripper
        enter(state, "transit", view.time)
        return outcome if told else ""


def _over_bin(view: View) -> bool:
    """Whether the hand is over the release square of the bin that is to be served."""
    goal = view.goal
    if goal.kind != "place" or view.p[2] < goal.position[2]:
        return False
    frame = np.array([goal.position[0], goal.position[1], goal.yaw])
    return bool(np.abs(to_frame(frame, view.p[:2])).max() <= goal.release_half_width)
