"""Ground truth of the simulated plant, for readers of Ticks."""

from motm_twin.model.edits import AddObstacle
from motm_twin.model.geometry import Array, wrap_angle
from motm_twin.model.plant import BodyTruth, Truth
from motm_twin.sim.agents import AgentState
from motm_twin.sim.faults import phrases
from motm_twin.sim.layout import Furnishings
from motm_twin.sim.objects import ObjectState
from motm_twin.sim.plant_state import PlantState
from motm_twin.sim.referee import Referee
from motm_twin.sim.solids import obstacle_disc


def truth_of(state: PlantState, furnishings: Furnishings, referee: Referee, substep: float) -> Truth:
    """Everything true of a state; substep [s]. Agents that a person added are among the obstacles."""
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
        position=_triple(item.position),
        yaw=item.yaw,
        state=item.state,
        size=(item.side, item.side, item.side),
    )


def _agent(item: AgentState) -> BodyTruth:
    agent = item.agent
    return BodyTruth(
        name=agent.name,
        kind=agent.kind,
        position=(float(item.pose[0]), float(item.pose[1]), 0.0),
        yaw=float(item.pose[2]),
        state=item.mode,
        size=(2.0 * agent.radius, 2.0 * agent.radius, agent.height),
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


def _triple(point: Array) -> tuple[float, float, float]:
    return float(point[0]), float(point[1]), float(point[2])
