"""One substep of a body that slides as a person threw it, in the state of the plant."""

import numpy as np

from motm_twin.sim.bodies import disc_outline, obstacle_outline, placed
from motm_twin.sim.objects import carry, riders
from motm_twin.sim.plant_state import PlantState
from motm_twin.sim.slides import Obstruction, RobotObstruction, slide
from motm_twin.sim.solids import Solids


def slide_body(state: PlantState, solids: Solids, name: str, robot: RobotObstruction, dt: float) -> list[str]:
    """Move a sliding body for dt [s], with what stands on it: its names. ``solids`` are those of the state's layout."""
    agent = next((item for item in state.agents if item.agent.name == name), None)
    item = state.layout.obstacle(name)
    if agent is not None:
        x, y = float(agent.pose[0]), float(agent.pose[1])
        body = disc_outline(x, y, agent.agent.radius, agent.agent.height)
    else:
        assert item is not None
        body = obstacle_outline(item)
    world = Obstruction(solids, state.agents, height=body.height, without=name)
    way, state.slides[name] = slide(body, state.slides[name], world, robot, dt)
    if state.slides[name] == (0.0, 0.0):
        del state.slides[name]
    if agent is not None:
        agent.pose = agent.pose + np.append(way, 0.0)
    elif item is not None and way.any():
        after = placed(item, item.x + float(way[0]), item.y + float(way[1]), item.heading)
        here, there = np.array([item.x, item.y, item.heading]), np.array([after.x, after.y, after.heading])
        riding = riders(state.objects, solids, (name,))
        carry(riding, here, there)
        state.layout = state.layout.with_obstacle(after)
        return [one.name for one in riding]
    return []
