"""Everything in the simulated plant that changes."""

import copy
import dataclasses
from dataclasses import dataclass, field

from motm_twin.model.geometry import Array
from motm_twin.model.plant import Actuation
from motm_twin.model.scene import Point
from motm_twin.model.state import LATER
from motm_twin.sim.agents import AgentState
from motm_twin.sim.arm import ArmState
from motm_twin.sim.base import BaseState
from motm_twin.sim.camera import CameraState
from motm_twin.sim.faults import FaultState
from motm_twin.sim.gripper import GripperState
from motm_twin.sim.layout import Layout
from motm_twin.sim.lidar import LidarState
from motm_twin.sim.localisation import LocalisationState
from motm_twin.sim.objects import ObjectState
from motm_twin.sim.referee_state import RefereeState


@dataclass
class PlantState:
    """Everything that changes."""

    substep: int
    command: Actuation
    base: BaseState
    arm: ArmState
    tcp: Array  # tool centre point, world [m], shape (3,)
    gripper: GripperState
    gripper_command: str
    objects: list[ObjectState]
    agents: list[AgentState]  # of the scene first, then those that a person added
    lidar: LidarState
    camera: CameraState
    localisation: LocalisationState
    referee: RefereeState
    layout: Layout = field(default_factory=Layout)
    slides: dict[str, Point] = field(default_factory=dict)  # velocity [m/s] of obstacles and agents that were thrown
    faults: FaultState = field(default_factory=FaultState)
    path_length: float = 0.0  # [m] driven by the base
    commands: tuple[tuple[int, Actuation], ...] = field(default=(), metadata=LATER)  # late ones, and when they act

    def rehearsal(self) -> "PlantState":
        """A copy that edits can be tried on, but no time: sensors and referee are shared with the original."""
        return dataclasses.replace(
            self,
            base=copy.copy(self.base),
            gripper=copy.copy(self.gripper),
            objects=copy.deepcopy(self.objects),
            agents=copy.deepcopy(self.agents),
            localisation=copy.copy(self.localisation),
            slides=dict(self.slides),
            faults=copy.deepcopy(self.faults),
        )
