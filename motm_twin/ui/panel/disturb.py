"""Changes to the things in a scene, as commands. Pure: from what is shown to what is sent.

A new body is put on free floor on the robot's way and in sight.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import shapely

from motm_twin.bus.client import Grid
from motm_twin.bus.commands import AddObstacle, Command, FreezeBody, MoveBody, MoveObject, PushRobot, RemoveBody
from motm_twin.bus.messages import TickMessage, Vector
from motm_twin.model.furniture import pieces
from motm_twin.model.scene import Scene
from motm_twin.ui.scene.cameras import Visibility

ON_WAY = (1.5, 1.3, 1.8, 2.2)  # [m] along the way of the robot
DISTANCES = (1.5, 1.8, 1.3, 2.2)  # [m] from the robot
ANGLES = (0.0, 0.35, -0.35, 0.7, -0.7, 1.1, -1.1, 1.5, -1.5, 2.2, -2.2)  # [rad] from its heading
AROUND = (0.0, 0.6, 1.2, 1.8)  # [m] from the middle of the view
SIDES = 8
NEAREST = 1.1  # [m] from the robot
ROOM = 0.4  # [m] radius that must be free
APART = 0.7  # [m] from other bodies
Point = tuple[float, float]
SIZES = {"temi": (0.5, 0.5, 1.0), "person": (0.5, 0.5, 1.7), "box": (0.4, 0.4, 0.6), "cylinder": (0.4, 0.4, 0.8)}
TURN = math.radians(15.0)
PUSH = 0.1  # [m]
AHEAD = 0.75  # [m] from the base to where a cube is put
PUSHES: dict[str, tuple[float, float, float]] = {  # forward, to the left [m], turn [rad]
    "◀ Left": (0.0, PUSH, 0.0),
    "▼ Back": (-PUSH, 0.0, 0.0),
    "Right ▶": (0.0, -PUSH, 0.0),
    "Turn left": (0.0, 0.0, TURN),
    "Turn right": (0.0, 0.0, -TURN),
}


@dataclass(frozen=True)
class Thing:
    """Something that can be selected."""

    name: str
    kind: str  # agent | obstacle | piece | object
    frozen: bool = False
    behaviour: str = ""  # of an agent

    @property
    def turns(self) -> bool:
        """It can be turned by hand."""
        return self.kind in ("agent", "obstacle", "piece")


def things(scene: Scene, tick: TickMessage) -> dict[str, Thing]:
    """Everything that can be selected, by name: agents first, then added bodies, furniture and cubes."""
    bodies = [*((body, "agent") for body in tick.agents), *((body, kind_of(body.kind)) for body in tick.obstacles)]
    found = [Thing(body.name, kind, body.state == "frozen", body.behaviour) for body, kind in bodies]
    found += [Thing(name, "piece") for name in pieces(scene) if name not in tick.removed]
    found += [Thing(item.name, "object") for item in tick.objects]
    return {thing.name: thing for thing in found}


def kind_of(shape: str) -> str:
    """Kind of a body of one of `SIZES`: agent | obstacle."""
    return "agent" if shape in ("temi", "person") else "obstacle"


def new_body(
    kind: str, scene: Scene, tick: TickMessage, grid: Grid | None, view: Visibility | None = None
) -> tuple[AddObstacle, str]:
    """A new body on free floor in front of the robot and in ``view``, with its own name; and a word on its place."""
    bodies = (*tick.agents, *tick.obstacles)
    size = SIZES[kind]
    place = free_place(
        tick.robot.true_pose,
        grid,
        [body.position[:2] for body in bodies],
        way=[tick.robot.true_pose[:2], *tick.plan.global_path[1:]],
        look_at=None if view is None else view.middle(),
        sees=lambda point: view is None or view.sees(point, size[2]),
    )
    taken = {body.name for body in bodies} | {solid.name for solid in scene.solids} | set(pieces(scene))
    taken |= {item.name for item in scene.objects} | {box.name for box in scene.bins}
    taken |= {agent.name for agent in scene.agents} | set(tick.removed)
    name = next(n for i in range(1, 10_000) if (n := f"{kind} {i}") not in taken)
    body = AddObstacle(name=name, shape=kind, x=place.x, y=place.y, heading=place.heading, size=size)
    return body, place.where


def turned(thing: Thing, scene: Scene, tick: TickMessage, angle: float) -> MoveBody | None:
    """The thing turned by an angle [rad] where it stands; None when it is gone."""
    body = next((body for body in (*tick.furniture, *tick.agents, *tick.obstacles) if body.name == thing.name), None)
    if body is not None:
        (x, y), heading = body.position[:2], math.remainder(body.yaw + angle, 2 * math.pi)
    elif thing.kind == "piece":  # at home
        (x, y), heading = pieces(scene)[thing.name].centre, angle
    else:
        return None
    return MoveBody(name=thing.name, x=x, y=y, heading=heading, held=False)


def put_in_front(name: str, tick: TickMessage) -> MoveObject:
    """A cube on the floor, or what stands there, in front of the robot."""
    x, y, heading = tick.robot.true_pose
    return MoveObject(name=name, x=x + AHEAD * math.cos(heading), y=y + AHEAD * math.sin(heading))


def put_back(name: str, scene: Scene) -> MoveObject | None:
    """A cube back to where the scene has it; None for a name that is no cube."""
    start = next((item.position for item in scene.objects if item.name == name), None)
    return None if start is None else MoveObject(name=name, x=start[0], y=start[1])


def held_cube(tick: TickMessage) -> str:
    """The cube between the fingers, as it truly is; "" when there is none."""
    return next((item.name for item in tick.objects if item.state == "held"), "")


def pushed(tick: TickMessage, way: str) -> PushRobot:
    """The robot shoved one of `PUSHES`, as seen from itself."""
    forward, left, turn = PUSHES[way]
    heading = tick.robot.true_pose[2]
    return PushRobot(
        dx=forward * math.cos(heading) - left * math.sin(heading),
        dy=forward * math.sin(heading) + left * math.cos(heading),
        turn=turn,
    )


def cleared(scene: Scene, tick: TickMessage) -> list[Command]:
    """Remove added bodies, release frozen agents, and put moved furniture back."""
    own = {agent.name for agent in scene.agents}
    added = [*tick.obstacles, *(body for body in tick.agents if body.name not in own)]
    frozen = [body for body in tick.agents if body.name in own and body.state == "frozen"]
    known, moved = pieces(scene), [body.name for body in tick.furniture]
    back = [(name, *known[name].centre) for name in moved if name in known]
    return [
        *(RemoveBody(name=body.name) for body in added),
        *(FreezeBody(name=body.name, frozen=False) for body in frozen),
        *(MoveBody(name=name, x=x, y=y, heading=0.0, held=False) for name, x, y in back),
    ]


class FreePlace(NamedTuple):
    """Place [m, m], heading [rad], and a description of the place."""

    x: float
    y: float
    heading: float
    where: str


def free_place(
    pose: Vector,
    grid: Grid | None,
    taken: Sequence[Sequence[float]],
    *,
    way: Sequence[Sequence[float]] = (),
    look_at: Point | None = None,
    sees: Callable[[Point], bool] = lambda _: True,
) -> FreePlace:
    """The first visible free place: on the robot's path, round it, or in the middle of the view.

    ``way``: the robot's path [m], from where it is; ``look_at``: floor point [m] in the middle of the view; ``sees``:
    true for a point where a body can be seen. When no free place can be seen, the first free one is taken, and
    when there is none, the one in front of the robot.
    """
    hidden: FreePlace | None = None
    for place in _wanted(pose, way, look_at):
        here = (place.x, place.y)
        if any(math.dist(here, other) <= APART for other in taken) or not is_free(grid, here):
            continue
        if sees(here):
            return place
        hidden = hidden or place
    return hidden or _beside(pose, DISTANCES[0], 0.0)


def _wanted(pose: Vector, way: Sequence[Sequence[float]], look_at: Point | None) -> Iterator[FreePlace]:
    x, y, heading = pose
    if len(way) > 1:
        line = shapely.LineString(way)
        for along in ON_WAY:
            point = line.interpolate(along)
            if along < line.length and math.dist((x, y), (point.x, point.y)) >= NEAREST:
                yield FreePlace(point.x, point.y, heading, f"{along:.1f} m in front of the robot, on its way")
    for distance in DISTANCES:
        for angle in ANGLES:
            yield _beside(pose, distance, angle)
    if look_at is not None:
        for distance in AROUND:
            for k in range(SIDES if distance else 1):
                turn = heading + 2.0 * math.pi * k / SIDES
                place = (look_at[0] + distance * math.cos(turn), look_at[1] + distance * math.sin(turn))
                if math.dist(place, (x, y)) >= NEAREST:
                    yield FreePlace(*place, heading, "in the middle of the view")


def _beside(pose: Vector, distance: float, angle: float) -> FreePlace:
    x, y, heading = pose
    side = "in front of" if abs(angle) < 0.5 else "behind" if abs(angle) > 2.0 else "beside"
    where = f"{distance:.1f} m {side} the robot"
    return FreePlace(x + distance * math.cos(heading + angle), y + distance * math.sin(heading + angle), heading, where)


def is_free(grid: Grid | None, place: Sequence[float]) -> bool:
    """True when the known map is free within `ROOM` of a place."""
    if grid is None:
        return True
    info = grid.info
    column, row = ((place[i] - info.origin[i]) / info.resolution for i in (0, 1))
    reach = ROOM / info.resolution
    if not (reach <= column <= info.width - reach and reach <= row <= info.height - reach):
        return False
    low_row, low_column = int(row - reach), int(column - reach)
    cells = grid.cells[low_row : int(row + reach) + 1, low_column : int(column + reach) + 1]
    return not bool(np.any(cells == 255))
