"""Bodies that a person can add, hold, throw and put down, as convex outlines on the floor.

A thrown body slides over the floor with friction, and stops before furniture and other bodies. At the robot it stops
only after touching it, so that the referee sees the contact. Nothing is pushed.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import coal
import msgspec
import numpy as np

from motm_twin.model.edits import AddObstacle
from motm_twin.model.geometry import Array, rectangle, wrap_angle
from motm_twin.model.profile import Footprint
from motm_twin.model.scene import PERSON_ACCELERATION, TEMI_ACCELERATION, Agent, Point
from motm_twin.sim.agents import AgentState
from motm_twin.sim.kernels import entered, gaps
from motm_twin.sim.objects import ObjectState, carry, riders
from motm_twin.sim.plant_state import PlantState
from motm_twin.sim.referee_geometry import RobotShapes, prism
from motm_twin.sim.responsibility import Gauge
from motm_twin.sim.solids import Solids, obstacle_disc

_ADDED = {  # agents that a person adds [m/s], [m], [m/s^2]
    "temi": {"speed": 0.4, "radius": 0.25, "height": 1.0, "acceleration": TEMI_ACCELERATION},
    "person": {"speed": 1.0, "radius": 0.25, "height": 1.7, "acceleration": PERSON_ACCELERATION},
}


@dataclass(frozen=True, kw_only=True)
class Outline:
    """A convex polygon (k, 2), counter-clockwise, or with one corner a disc of ``radius`` [m], from the floor up."""

    corners: Array
    radius: float = 0.0
    height: float  # [m]

    def shifted(self, way: Array) -> "Outline":
        """The outline moved by a displacement [m], shape (2,)."""
        return Outline(corners=self.corners + way, radius=self.radius, height=self.height)


def obstacle_outline(item: AddObstacle) -> Outline:
    """Outline of an obstacle."""
    disc = obstacle_disc(item)
    if disc is None:
        return Outline(corners=rectangle((item.x, item.y, item.heading), item.size), height=item.size[2])
    return disc_outline(item.x, item.y, *disc)


def disc_outline(x: float, y: float, radius: float, height: float) -> Outline:
    """Outline of a round body."""
    return Outline(corners=np.array([[x, y]], dtype=float), radius=radius, height=height)


def added_agent(edit: AddObstacle) -> Agent | None:
    """The agent that a person adds with this edit; None when it adds a box or cylinder."""
    if edit.shape not in _ADDED:
        return None
    start = (edit.x, edit.y, wrap_angle(edit.heading))
    return Agent(name=edit.name, start=start, kind=edit.shape, **_ADDED[edit.shape])


def placed(item: AddObstacle, x: float, y: float, heading: float) -> AddObstacle:
    """An obstacle at another place."""
    return msgspec.structs.replace(item, x=x, y=y, heading=heading)


def capped(velocity: tuple[float, float], largest: float) -> tuple[float, float]:
    """The velocity [m/s], capped at a speed of ``largest``."""
    speed = math.hypot(*velocity)
    share = 1.0 if speed <= largest else largest / speed
    return share * velocity[0], share * velocity[1]


def square_outline(item: ObjectState) -> Outline:
    """The outline of an object that stands upright."""
    x, y, top = float(item.position[0]), float(item.position[1]), float(item.position[2]) + 0.5 * item.side
    return Outline(corners=rectangle((x, y, item.yaw), (item.side, item.side)), height=top)


def robot_outline(foot: Footprint, pose: Array) -> Outline:
    """The outline of the robot's base at a pose, shape (3,)."""
    x = float(pose[0]) + foot.offset_x * float(np.cos(pose[2]))
    y = float(pose[1]) + foot.offset_x * float(np.sin(pose[2]))
    return Outline(corners=rectangle((x, y, pose[2]), (foot.length, foot.width)), height=foot.height)


FRICTION = 2.0  # [m/s^2] deceleration of a sliding body
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
    """The robot as an obstacle for a sliding body, with the referee's own shapes."""

    def __init__(self, robot: RobotShapes, placed: Array) -> None:
        """Shapes and their transforms, shape (n, 4, 4); the slot of a held cube, last, is left out."""
        transforms = (coal.Transform3s(T[:3, :3], T[:3, 3]) for T in placed[:-1])
        self._placed, self._gauge = list(zip(robot.shapes[:-1], transforms, strict=True)), Gauge()

    def gaps(self, body: Outline, way: Array) -> Array:
        """Distance [m] of each shape to a body after a displacement (2,); negative where they overlap."""
        shape, place = _solid(body)
        other = shape, coal.Transform3s(np.eye(3), place + np.append(way, 0.0))
        return np.array([self._gauge(own, other) for own in self._placed])


def _free(gaps_at: Callable[[Array], Array], ways: Sequence[Array]) -> int:
    """Number of successive displacements [m] (each from the start) up to which a body enters no obstacle."""
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
    """Move a sliding body for dt [s], with the objects on it, whose names are returned. ``solids`` of the layout."""
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
