"""Thrown bodies: they slide over the floor with friction, until they stop or meet something.

A body stops short of furniture and of other bodies. It stops where it has touched the robot, so that the referee sees
the contact. Nothing is pushed.
"""

import math
from collections.abc import Callable, Sequence

import coal
import numpy as np

from motm_twin.model.geometry import Array
from motm_twin.model.scene import Point
from motm_twin.sim.agents import AgentState
from motm_twin.sim.bodies import Outline, disc_outline, obstacle_outline, placed
from motm_twin.sim.kernels import entered, gaps
from motm_twin.sim.objects import carry, riders
from motm_twin.sim.plant_state import PlantState
from motm_twin.sim.referee_geometry import RobotShapes, prism
from motm_twin.sim.responsibility import Gauge
from motm_twin.sim.solids import Solids

FRICTION = 2.0  # [m/s^2] by which a sliding body gets slower
FASTEST = 3.0  # [m/s] cap on the speed of a throw
STRIDE = 0.002  # [m] between two collision checks of a sliding body


class Obstruction:
    """Obstacles for a sliding body of some height: polygons first, then discs, by name."""

    def __init__(self, solids: Solids, agents: Sequence[AgentState], *, height: float, without: str = "") -> None:
        """Solids and agents below ``height`` [m], except the one named ``without``."""
        low = solids.below(height)
        discs = [[s.pose[0], s.pose[1], s.agent.radius] for s in agents]
        self.names = (*low.names, *low.disc_names, *(s.agent.name for s in agents))
        self._own = np.array([name == without for name in self.names], dtype=bool)
        self._world = (low.corners, low.first, np.vstack([low.discs, np.array(discs, dtype=float).reshape(-1, 3)]))

    def gaps(self, body: Outline) -> Array:
        """Gap [m] to each of `names`; infinite to the body itself."""
        found = gaps(body.corners, body.radius, *self._world)
        found[self._own] = math.inf
        return found

    def inside(self, body: Outline) -> str:
        """The obstacle that a body overlaps most; "" for none."""
        found = self.gaps(body)
        return self.names[int(found.argmin())] if len(found) and found.min() < 0.0 else ""


class RobotObstruction:
    """The robot as a sliding body meets it, with the referee's own shapes."""

    def __init__(self, robot: RobotShapes, placed: Array) -> None:
        """Shapes and their transforms, shape (n, 4, 4); the slot of a held cube, last, is left out."""
        transforms = (coal.Transform3s(T[:3, :3], T[:3, 3]) for T in placed[:-1])
        self._placed, self._gauge = list(zip(robot.shapes[:-1], transforms, strict=True)), Gauge()

    def gaps(self, body: Outline, way: Array) -> Array:
        """Distance [m] of each shape to a body that has gone a way (2,); negative where they overlap."""
        shape, place = _solid(body)
        other = shape, coal.Transform3s(np.eye(3), place + np.append(way, 0.0))
        return np.array([self._gauge(own, other) for own in self._placed])


def _free(gaps_at: Callable[[Array], Array], ways: Sequence[Array]) -> int:
    """Number of displacements [m] in a row (each from the start) by which a body enters nothing."""
    before = gaps_at(np.zeros(2))
    if not ways or before.min(initial=math.inf) > math.hypot(*ways[-1]):
        return len(ways)
    for count, way in enumerate(ways):
        after = gaps_at(way)
        if len(entered(before, after)) > 0:
            return count
        before = after
    return len(ways)


def _solid(body: Outline) -> tuple[coal.CollisionGeometry, Array]:
    """A body as a shape, and the position [m] of its frame, shape (3,)."""
    if len(body.corners) == 1:
        return coal.Cylinder(body.radius, body.height), np.array([*body.corners[0], 0.5 * body.height])
    return prism(body.corners, 0.0, body.height), np.zeros(3)


def slide(
    body: Outline, velocity: Point, world: Obstruction, robot: RobotObstruction, dt: float
) -> tuple[Array, Point]:
    """Displacement [m] of a sliding body in a substep, shape (2,), and its velocity [m/s] at the end."""
    speed = math.hypot(*velocity)
    later = max(0.0, speed - FRICTION * dt)
    way = 0.5 * (speed + later) * dt * np.array(velocity) / speed
    strides = max(1, math.ceil(math.hypot(*way) / STRIDE))
    ways = [way * (k + 1) / strides for k in range(strides)]
    free = _free(lambda way: world.gaps(body.shifted(way)), ways)
    untouched = _free(lambda way: robot.gaps(body, way), ways[:free])
    touched = untouched < free
    gone = untouched + touched  # it stops where it touches the robot
    if gone < strides or touched or later == 0.0:
        return (ways[gone - 1] if gone else np.zeros(2)), (0.0, 0.0)
    return way, (velocity[0] * later / speed, velocity[1] * later / speed)


def slide_body(state: PlantState, solids: Solids, name: str, robot: RobotObstruction, dt: float) -> list[str]:
    """Move a sliding body for dt [s], with what stands on it: its names. ``solids`` are those of the state's layout."""
    agent, item = state.agent(name), state.layout.obstacle(name)
    if agent is not None:
        body = disc_outline(*agent.pose[:2].tolist(), agent.agent.radius, agent.agent.height)
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
