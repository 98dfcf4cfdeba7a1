"""State of the contact dynamics: MuJoCo's own, references of the drives, and what was felt."""

from dataclasses import dataclass, field

import numpy as np

from motm_twin.model.geometry import Array
from motm_twin.model.plant import ContactForce, GraspTruth
from motm_twin.sim.plant_state import ArmState, BaseState


@dataclass
class Press:
    """A contact with force that goes on."""

    began: float  # [s]
    last: float
    bodies: tuple[str, ...]  # of the robot, in order
    force: float  # [N] largest
    impulse: float  # [Ns]


@dataclass
class Grasp:
    """Fingers and what is between them."""

    width: float  # [m] that the drive is told
    waits: int = 0  # substeps until the fingers begin to move
    still: int = 0  # substeps for which they have not moved
    pressed: str = ""  # object that both pads press
    loose: int = 0  # substeps for which a held object was not pressed by both
    forces: tuple[float, float] = (0.0, 0.0)  # [N] of left and right pad on it
    began: float = 0.0  # [s] of the command to close
    speed: float = 0.0  # [m/s] largest of the tool centre point since then
    places: dict[str, Array] = field(default_factory=dict)  # [m] of the objects then
    taken: tuple[Array, Array] | None = None  # position and rotation in the hand of what is held, when it was taken
    done: list[GraspTruth] = field(default_factory=list)  # all grasps, the newest last


@dataclass
class PhysicsState:
    """Everything that changes, beside what the kinematic plant has too."""

    integration: Array  # of MuJoCo: mjSTATE_INTEGRATION
    base: BaseState  # reference of the base's drives: its speeds
    arm: ArmState  # reference of the arm's drives
    grasp: Grasp
    quiet: dict[str, int] = field(default_factory=dict)  # substeps for which a falling object has been at rest
    presses: dict[str, Press] = field(default_factory=dict)  # contacts of the robot that go on, by the other
    torque: Array = field(default_factory=lambda: np.zeros(7))  # [Nm] external, as the arm estimates it
    torque_peaks: Array = field(default_factory=lambda: np.zeros(7))  # [Nm] largest magnitude so far
    reflexes: dict[str, str] = field(default_factory=dict)  # threshold: when it was first passed, and by which joint
    trips: dict[str, int] = field(default_factory=dict)  # threshold: times that it was passed without a contact
    over: dict[str, int] = field(default_factory=dict)  # threshold: last substep in which it was passed
    wrist: tuple[float, float] = (0.0, 0.0)  # [N], [Nm] at the hand's mount, weight included
    wrist_peaks: tuple[float, float] = (0.0, 0.0)  # largest so far
    edited: int = -1000  # substep of a person's newest edit
    felt: list[ContactForce] = field(default_factory=list)  # those that have ended
