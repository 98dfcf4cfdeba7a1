"""State of the simulated plant, and the ground truth derived from it for readers of Ticks."""

import copy
import dataclasses
from dataclasses import dataclass, field
from typing import Any

from motm_twin.model.edits import AddObstacle
from motm_twin.model.geometry import Array, wrap_angle
from motm_twin.model.plant import Actuation, BodyTruth, Truth
from motm_twin.model.scene import Point
from motm_twin.model.state import LATER
from motm_twin.sim.agents import AgentState
from motm_twin.sim.faults import FaultState, phrases
from motm_twin.sim.gripper import GripperState
from motm_twin.sim.objects import ObjectState
from motm_twin.sim.referee import Referee
from motm_twin.sim.sensors import CameraState, LidarState, LocalisationState
from motm_twin.sim.solids import Furnishings, Layout, obstacle_disc
from motm_twin.sim.verdict import RefereeState


@dataclass
class BaseState:
    """True pose of the base, and its speeds by wheel motion: true unless the wheels slip."""

    pose: Array  # world, shape (3,)
    v: float = 0.0  # [m/s]
    w: float = 0.0  # [rad/s]


@dataclass
class ArmState:
    """True motion of the arm's joints."""

    q: Array  # [rad], shape (7,)
    dq: Array  # [rad/s], shape (7,)


@dataclass
class PlantState:
    """Everything in the plant that changes during a run."""

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
    commands: tuple[tuple[int, Actuation], ...] = field(default=(), metadata=LATER)  # delayed ones: substep, command
    physics: Any = field(default=None, metadata=LATER)  # state of the room `physics`; None: kinematic

    def agent(self, name: str) -> AgentState | None:
        """The agent of this name, if there is one."""
        return next((item for item in self.agents if item.agent.name == name), None)

    def rehearsal(self) -> "PlantState":
        """A copy for trying edits, not for passing time: sensors and referee are shared with the original."""
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


def truth_of(state: PlantState, furnishings: Furnishings, referee: Referee, substep: float) -> Truth:
    """Ground truth of a state; ``substep`` [s]. Agents added by a person are among the obstacles."""
    judged, layout = state.referee, state.layout
    return Truth(
        pose=state.base.pose.copy(),
        objects=tuple(_object(item) for item in state.objects),
        agents=tuple(_agent(item) for item in state.agents if not item.added),
        obstacles=(
            *(_obstacle(item, sliding=item.name in state.slides) for item in layout.obstacles),
            *(_agent(item) for item in state.agents if item.added),
        ),
        contacts=referee.contacts(judged),
        picks=judged.counts.picks,
        places=len(judged.counts.placed),
        drops=judged.counts.drops,
        min_base_clearance=judged.min_base_clearance,
        min_arm_clearance=judged.min_arm_clearance,
        min_ee_obstacle=judged.min_ee_obstacle,
        ee_obstacle=judged.ee_obstacle,
        plant_faults=tuple(judged.check.faults.values()),
        furniture=furnishings.truth(layout),
        removed=layout.removed,
        faults=phrases(state.faults, state.substep, substep),
        path_length=state.path_length,
        cut_ins=tuple(judged.cut_ins),
        dropped=judged.counts.dropped,
    )


def _object(item: ObjectState) -> BodyTruth:
    return BodyTruth(
        name=item.name,
        kind="cube",
        position=tuple(item.position.tolist()),
        yaw=item.yaw,
        state=item.state,
        size=(item.side, item.side, item.side),
    )


def _agent(item: AgentState) -> BodyTruth:
    agent = item.agent
    return BodyTruth(
        name=agent.name,
        kind=agent.kind,
        position=(*item.pose[:2].tolist(), 0.0),
        yaw=float(item.pose[2]),
        state=item.mode,
        size=(2.0 * agent.radius, 2.0 * agent.radius, agent.height),
        behaviour=agent.behaviour,
    )


def _obstacle(item: AddObstacle, *, sliding: bool) -> BodyTruth:
    disc = obstacle_disc(item)
    return BodyTruth(
        name=item.name,
        kind=item.shape,
        position=(item.x, item.y, 0.0),
        yaw=wrap_angle(item.heading),
        state="sliding" if sliding else "",
        size=item.size if disc is None else (2.0 * disc[0], 2.0 * disc[0], disc[1]),
    )
