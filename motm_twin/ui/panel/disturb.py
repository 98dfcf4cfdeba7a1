"""The Disturb tab: new bodies, actions on the selected thing, pushes, and parts of the robot that fail.

Its commands are made by pure functions of what is shown.
A new body is put on free floor on the robot's path and in sight.
"""

import asyncio
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from typing import NamedTuple

import numpy as np
import shapely
import viser

from motm_twin.bus.client import Grid
from motm_twin.bus.commands import Announce, Command, InjectFault, RemoveBody, SetBehaviour
from motm_twin.bus.messages import TickMessage, Vector
from motm_twin.model.edits import AddObstacle, FreezeBody, MoveBody, MoveObject, PushRobot
from motm_twin.model.faults import KINDS
from motm_twin.model.scene import Scene
from motm_twin.model.scene_shapes import pieces
from motm_twin.ui.hub import Hub, Shown, Visitor
from motm_twin.ui.panel.widgets import AMBER, BLUE, Block, card, follow, heading, note, text, wash
from motm_twin.ui.scene.cameras import Visibility
from motm_twin.ui.scene.picking import Surroundings

ON_WAY = (1.5, 1.3, 1.8, 2.2)  # [m] along the robot's path
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
        """True when it can be turned by hand."""
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
    """Command that adds a body with an unused name at a place from `free_place`, and a description of the place."""
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
    """Command that turns a thing by an angle [rad] where it stands; None when it is gone."""
    body = next((body for body in (*tick.furniture, *tick.agents, *tick.obstacles) if body.name == thing.name), None)
    if body is not None:
        (x, y), heading = body.position[:2], math.remainder(body.yaw + angle, 2 * math.pi)
    elif thing.kind == "piece":  # at home
        (x, y), heading = pieces(scene)[thing.name].centre, angle
    else:
        return None
    return MoveBody(name=thing.name, x=x, y=y, heading=heading, held=False)


def put_in_front(name: str, tick: TickMessage) -> MoveObject:
    """Command that puts a cube in front of the robot, on the floor or on whatever stands there."""
    x, y, heading = tick.robot.true_pose
    return MoveObject(name=name, x=x + AHEAD * math.cos(heading), y=y + AHEAD * math.sin(heading))


def put_back(name: str, scene: Scene) -> MoveObject | None:
    """Command that puts a cube back where the scene has it; None when the name is not a cube's."""
    start = next((item.position for item in scene.objects if item.name == name), None)
    return None if start is None else MoveObject(name=name, x=start[0], y=start[1])


def held_cube(tick: TickMessage) -> str:
    """Name of the cube that is truly between the fingers; "" when there is none."""
    return next((item.name for item in tick.objects if item.state == "held"), "")


def pushed(tick: TickMessage, way: str) -> PushRobot:
    """Command that shoves the robot by one of `PUSHES`, in the robot's frame."""
    forward, left, turn = PUSHES[way]
    c, s = math.cos(tick.robot.true_pose[2]), math.sin(tick.robot.true_pose[2])
    return PushRobot(dx=forward * c - left * s, dy=forward * s + left * c, turn=turn)


def cleared(scene: Scene, tick: TickMessage) -> list[Command]:
    """Commands that remove added bodies, release frozen agents, and put moved furniture back."""
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
    """The first visible free place: on the robot's path, around the robot, or in the middle of the view.

    ``way``: the robot's path [m], from where it is; ``look_at``: floor point [m] in the middle of the view; ``sees``:
    true for a point where a body can be seen. When no free place can be seen, the first free one is taken, and
    when there is none, the one in front of the robot.
    """
    hidden: FreePlace | None = None
    for place in _places(pose, way, look_at):
        here = (place.x, place.y)
        if any(math.dist(here, other) <= APART for other in taken) or not is_free(grid, here):
            continue
        if sees(here):
            return place
        hidden = hidden or place
    return hidden or _beside(pose, DISTANCES[0], 0.0)


def _places(pose: Vector, way: Sequence[Sequence[float]], look_at: Point | None) -> Iterator[FreePlace]:
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


NOTHING = "(nothing)"
LEFT, RIGHT, DELETE = "Turn it left", "Turn it right", "Delete"
FREEZE, GO_ON, SEND, STAY = "Freeze", "Go on", "Send to…", "Do not send"
BEHAVIOURS = {"Stops for others": "yield", "Stops for nobody": "blind"}
if find_spec("pyrvo") is not None:
    BEHAVIOURS["Steers clear (ORCA)"] = "orca"
OTHERWISE = "As the scene says"  # label for a behaviour that is not offered here
IN_FRONT, BACK = "In front of the robot", "Back to its place"
SECONDS = {"lidar_off": 1.0, "camera_off": 2.0}  # duration [s] of a fault's button; the others last 5 s
FAULTS = {
    f"{kind.button} {seconds:g} s": InjectFault(fault=name, seconds=seconds)
    for name, kind in KINDS.items()
    for seconds in [SECONDS.get(name, 5.0)]
}
IN_A_ROW = 3  # buttons of faults in one row
_HOW = {
    "": "Drag anything, also furniture; let go while moving to throw it. Dragging elsewhere turns the view.",
    "agent": "Drag it into the way, or send it somewhere.",
    "obstacle": "Drag it into the way; the robot sees it with its lidar only.",
    "piece": "Drag it. The map does not follow until you tell the robot.",
    "object": "Drag the cube somewhere else while the robot reaches for it.",
}


class DisturbTab(Block):
    """Widgets that disturb the robot."""

    def __init__(self, gui: viser.GuiApi, hub: Hub, visitor: Visitor) -> None:
        super().__init__(gui, hub, visitor)
        self._names: tuple[str, ...] = ()
        self._just: Thing | None = None  # just added, and not in a tick yet
        gui.add_html(card(heading("Add in front of the robot")))
        self.row([kind.title() for kind in SIZES], lambda name: self.add(name.lower()), hint="keys T, P, B, C")
        gui.add_html(card(heading("With the selected thing")))
        self._choice = self.choice("Selected", (NOTHING,), self._select, hint="or click it in the scene")
        self._about = gui.add_html(about(None, ""))
        self._agent = self.row((FREEZE, SEND), self._with_agent)
        self._manner = self.choice(
            "On its way", (*BEHAVIOURS, OTHERWISE), self._behave, hint="how it moves among others, the robot included"
        )
        self._piece = self.row(("Tell the robot",), lambda _: self._announce(), hint="its map follows")
        self._cube = self.row((IN_FRONT, BACK), self._with_cube)
        self._turn = self.row((LEFT, RIGHT, DELETE), self._turn_or_delete)
        gui.add_html(card(heading("Push the robot by 10 cm, or turn it by 15°")))
        for turns in (False, True):
            ways = tuple(way for way, (_, _, turn) in PUSHES.items() if bool(turn) == turns)
            self.row(ways, self._push, hint="its pose jumps; its odometry does not register it")
        self._grip = self.row(("Take the cube from the gripper",), lambda _: self._take_cube())
        gui.add_html(card(heading("Let something fail for a while")))
        labels = tuple(FAULTS)
        for first in range(0, len(labels), IN_A_ROW):
            self.row(labels[first : first + IN_A_ROW], lambda name: self.send(FAULTS[name]))
        self._faults = gui.add_html("")
        gui.add_divider()
        hint = "added bodies go, furniture back to its place"
        self.row(("Clear all disturbances",), lambda _: self.clear(), hint=hint)

    def _refresh(self, shown: Shown) -> None:
        if shown.scene is None or shown.newest is None:
            return
        listed, view = things(shown.scene, shown.newest), shown.view
        if self._just is not None and self._just.name in listed:
            self._just = None
        selected = view.selected if view.selected in listed else ""
        if tuple(listed) != self._names:
            self._names = tuple(listed)
            self._choice.options = (NOTHING, *self._names)
        follow(self._choice, selected or NOTHING)
        thing = listed.get(selected)
        self._about.content = about(thing, view.sending, view.placing if view.placing == selected else "")
        kind = "" if thing is None else thing.kind
        self._agent.visible = self._manner.visible = kind == "agent"
        self._piece.visible, self._cube.visible = kind == "piece", kind == "object"
        self._turn.visible = thing is not None and thing.turns
        if thing is not None and kind == "agent":
            self._agent.options = (GO_ON if thing.frozen else FREEZE, STAY if view.sending == thing.name else SEND)
            follow(self._manner, next((k for k, v in BEHAVIOURS.items() if v == thing.behaviour), OTHERWISE))
        self._grip.visible = held_cube(shown.newest) != ""
        self._faults.content = faults(shown.newest.faults)

    async def add(self, kind: str) -> None:
        """Put a new body on the floor in front of the robot; once accepted, select it and say where it is.

        A click moves it elsewhere.
        """
        now = self._now()
        if now is None:
            return
        scene, tick = now
        surroundings = Surroundings(scene)
        surroundings.update(tick)
        seen = Visibility(self.visitor.client.camera, surroundings, tick)
        body, where = new_body(kind, scene, tick, self.hub.client.grid(), seen)
        if not (await asyncio.to_thread(self.hub.command, self.visitor, body)).ok:
            return  # the hub has told the visitor the reason
        view = self.hub.view
        view.aim_at_nothing()
        view.selected = view.placing = body.name
        self._just = Thing(body.name, kind_of(kind))
        self.tell(f"{body.name} stands {where}. Drag it, or click the floor where it should stand.", "Added", "green")

    def clear(self) -> None:
        """Undo what was added and moved."""
        if (now := self._now()) is not None:
            for command in cleared(*now):
                self.send(command)

    def delete(self) -> None:
        """Take the selected thing away."""
        thing = self._thing()
        if thing is not None and thing.turns:
            self._just = None
            self.send(RemoveBody(name=thing.name))

    def cancel(self) -> None:
        """Cancel what the next click on the floor would do, or else the selection."""
        view = self.hub.view
        if view.sending or view.placing or view.going is not None:
            view.aim_at_nothing()
        else:
            view.selected = ""

    def freeze(self) -> None:
        """Stop the selected agent, or let it go on."""
        thing = self._thing()
        if thing is not None and thing.kind == "agent":
            self.send(FreezeBody(name=thing.name, frozen=not thing.frozen))

    def _now(self) -> tuple[Scene, TickMessage] | None:
        """The scene and the newest tick; None, with a note on the page, when an earlier period is shown."""
        shown = self.shown
        if shown is None or shown.newest is None or shown.scene is None or not self.hub.live(self.visitor):
            return None
        return shown.scene, shown.newest

    def _thing(self) -> Thing | None:
        """The selected thing, when it can be changed."""
        if (now := self._now()) is None:
            return None
        selected, just = self.hub.view.selected, self._just
        found = things(*now).get(selected)
        return just if found is None and just is not None and just.name == selected else found

    def _select(self, name: str) -> None:
        self.hub.view.selected = "" if name == NOTHING else name
        self.hub.view.aim_at_nothing()

    def _with_agent(self, what: str) -> None:
        if what in (FREEZE, GO_ON):
            self.freeze()
        elif (thing := self._thing()) is not None:
            view = self.hub.view
            sending = "" if view.sending == thing.name else thing.name
            view.aim_at_nothing()
            view.sending = sending

    def _behave(self, words: str) -> None:
        thing = self._thing()
        if thing is not None and thing.kind == "agent" and words in BEHAVIOURS:
            self.send(SetBehaviour(name=thing.name, behaviour=BEHAVIOURS[words]))

    async def _announce(self) -> None:
        """Announce the place of the selected piece to the robot, and say so."""
        thing = self._thing()
        if thing is None:
            return
        if (await asyncio.to_thread(self.hub.command, self.visitor, Announce(name=thing.name))).ok:
            self.tell(f"the robot's map has {thing.name} where it stands now", "Told", "green")

    def _with_cube(self, what: str) -> None:
        thing, now = self._thing(), self._now()
        if thing is not None and now is not None:
            scene, tick = now
            self._put(put_back(thing.name, scene) if what == BACK else put_in_front(thing.name, tick))

    def _put(self, command: Command | None) -> None:
        if command is None:
            self.tell("the scene has no place for this cube")
        else:
            self.send(command)

    def _turn_or_delete(self, what: str) -> None:
        if what == DELETE:
            self.delete()
        elif (thing := self._thing()) is not None and (now := self._now()) is not None:
            if command := turned(thing, *now, TURN * (1 if what == LEFT else -1)):
                self.send(command)

    def _push(self, way: str) -> None:
        if (now := self._now()) is not None:
            self.send(pushed(now[1], way))

    def _take_cube(self) -> None:
        if (now := self._now()) is not None and (name := held_cube(now[1])):
            self._put(put_back(name, now[0]))


def about(thing: Thing | None, sending: str, placing: str = "") -> str:
    """A hint for the selected thing, or for the next click on the floor, as HTML."""
    if sending or placing:
        what = "go" if sending else "stand, or drag it"
        return note(f"Click the floor where <b>{text(sending or placing)}</b> should {what} (Esc cancels).", BLUE)
    return note(_HOW["" if thing is None else thing.kind])


def faults(texts: list[str]) -> str:
    """Faults that last, as HTML; "" when there are none."""
    lines = "<br>".join(map(text, texts))
    look = f"border-left:3px solid {AMBER};background:{wash(AMBER)};padding:3px 8px"
    return note(f'<div style="{look}">{lines}</div>', AMBER) if texts else ""
