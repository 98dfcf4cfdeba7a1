"""What can be done to the things in a scene, as commands. Pure: from what is shown to what is sent."""

import math
from collections.abc import Iterable
from dataclasses import dataclass

from motm_twin.bus.client import Grid
from motm_twin.bus.commands import AddObstacle, Command, FreezeBody, MoveBody, MoveObject, PushRobot, RemoveBody
from motm_twin.bus.messages import BodyMessage, TickMessage
from motm_twin.model.furniture import pieces
from motm_twin.model.scene import Scene
from motm_twin.ui.free_place import free_place
from motm_twin.ui.sight import Sight

SIZES = {
    "temi": (0.5, 0.5, 1.0),
    "person": (0.5, 0.5, 1.7),
    "box": (0.4, 0.4, 0.6),
    "cylinder": (0.4, 0.4, 0.8),
}
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

    @property
    def turns(self) -> bool:
        """Whether it can be turned by hand."""
        return self.kind in ("agent", "obstacle", "piece")


def things(scene: Scene, tick: TickMessage) -> dict[str, Thing]:
    """Everything that can be selected, by name: what moves first, then what was added, furniture, and cubes."""
    found = [Thing(body.name, "agent", body.state == "frozen") for body in tick.agents]
    for body in tick.obstacles:
        found.append(Thing(body.name, kind_of(body.kind), body.state == "frozen"))
    found += [Thing(name, "piece") for name in pieces(scene) if name not in tick.removed]
    found += [Thing(item.name, "object") for item in tick.objects]
    return {thing.name: thing for thing in found}


def kind_of(shape: str) -> str:
    """What a body of one of `SIZES` is: agent | obstacle."""
    return "agent" if shape in ("temi", "person") else "obstacle"


def new_body(
    kind: str, scene: Scene, tick: TickMessage, grid: Grid | None, sight: Sight | None = None
) -> tuple[AddObstacle, str]:
    """A new body on free floor before the robot, where ``sight`` sees it, with a name of its own; and where that is."""
    bodies = (*tick.agents, *tick.obstacles)
    size = SIZES[kind]
    place = free_place(
        tick.robot.true_pose,
        grid,
        [body.position[:2] for body in bodies],
        way=[tick.robot.true_pose[:2], *tick.plan.global_path[1:]],
        look_at=None if sight is None else sight.middle(),
        sees=lambda point: sight is None or sight.sees(point, size[2]),
    )
    taken = {body.name for body in bodies} | {solid.name for solid in scene.solids} | set(pieces(scene))
    taken |= {item.name for item in scene.objects} | {box.name for box in scene.bins}
    taken |= {agent.name for agent in scene.agents} | set(tick.removed)
    name = next(n for i in range(1, 10_000) if (n := f"{kind} {i}") not in taken)
    body = AddObstacle(name=name, shape=kind, x=place.x, y=place.y, heading=place.heading, size=size)
    return body, place.where


def turned(thing: Thing, scene: Scene, tick: TickMessage, angle: float) -> MoveBody | None:
    """The thing turned by an angle [rad] where it stands; None when it is gone."""
    if thing.kind == "piece":
        body = _named(tick.furniture, thing.name)
        if body is None:
            x, y = pieces(scene)[thing.name].centre
            return MoveBody(name=thing.name, x=x, y=y, heading=angle, held=False)
    else:
        body = _named((*tick.agents, *tick.obstacles), thing.name)
    if body is None:
        return None
    heading = math.remainder(body.yaw + angle, 2 * math.pi)
    return MoveBody(name=thing.name, x=body.position[0], y=body.position[1], heading=heading, held=False)


def freeze(thing: Thing) -> FreezeBody:
    """Make an agent stand still, or let it go on."""
    return FreezeBody(name=thing.name, frozen=not thing.frozen)


def put_in_front(name: str, tick: TickMessage) -> MoveObject:
    """A cube on the floor, or what stands there, before the robot."""
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
    """Everything that was added goes, frozen agents go on, moved furniture stands where it was."""
    own = {agent.name for agent in scene.agents}
    added = [*tick.obstacles, *(body for body in tick.agents if body.name not in own)]
    commands: list[Command] = [RemoveBody(name=body.name) for body in added]
    commands += [
        FreezeBody(name=body.name, frozen=False) for body in tick.agents if body.name in own and body.state == "frozen"
    ]
    known = pieces(scene)
    for body in tick.furniture:
        if body.name in known:
            x, y = known[body.name].centre
            commands.append(MoveBody(name=body.name, x=x, y=y, heading=0.0, held=False))
    return commands


def _named(bodies: Iterable[BodyMessage], name: str) -> BodyMessage | None:
    return next((body for body in bodies if body.name == name), None)
