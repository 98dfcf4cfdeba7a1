"""The Disturb tab: new bodies, actions on the selected thing, pushes, and parts of the robot that fail."""

import asyncio
from importlib.util import find_spec

import viser

from motm_twin.bus.commands import Announce, Command, FreezeBody, InjectFault, RemoveBody, SetBehaviour
from motm_twin.bus.messages import TickMessage
from motm_twin.model.faults import KINDS
from motm_twin.model.scene import Scene
from motm_twin.ui.hub import Hub, Shown, Visitor
from motm_twin.ui.panel import disturb
from motm_twin.ui.panel.disturb import Thing
from motm_twin.ui.panel.widgets import AMBER, BLUE, Block, card, follow, heading, note, text, wash
from motm_twin.ui.scene.cameras import Visibility
from motm_twin.ui.scene.picking import Surroundings

NEW = {"Temi": "temi", "Person": "person", "Box": "box", "Cylinder": "cylinder"}
NOTHING = "(nothing)"
LEFT, RIGHT, DELETE = "Turn it left", "Turn it right", "Delete"
FREEZE, GO_ON, SEND, STAY = "Freeze", "Go on", "Send to…", "Do not send"
BEHAVIOURS = {"Stops for others": "yield", "Stops for nobody": "blind"}
if find_spec("pyrvo") is not None:
    BEHAVIOURS["Steers clear (ORCA)"] = "orca"
OTHERWISE = "As the scene says"  # a behaviour that is not offered here
IN_FRONT, BACK = "In front of the robot", "Back to its place"
SECONDS = {"lidar_off": 1.0, "camera_off": 2.0}  # of the faults of a click; the others last 5 s
_LASTING = {name: SECONDS.get(name, 5.0) for name in KINDS}
FAULTS = {
    f"{KINDS[name].button} {seconds:g} s": InjectFault(fault=name, seconds=seconds)
    for name, seconds in _LASTING.items()
}
IN_A_ROW = 3  # buttons of faults
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
        self._just: Thing | None = None  # added, and not in a tick yet
        gui.add_html(card(heading("Add in front of the robot")))
        self.row(tuple(NEW), lambda name: self.add(NEW[name]), hint="keys T, P, B, C")
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
            ways = tuple(way for way, (_, _, turn) in disturb.PUSHES.items() if bool(turn) == turns)
            self.row(ways, self._push, hint="its pose jumps; its wheels notice nothing")
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
        listed, view = disturb.things(shown.scene, shown.newest), shown.view
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
        self._grip.visible = disturb.held_cube(shown.newest) != ""
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
        body, where = disturb.new_body(kind, scene, tick, self.hub.client.grid(), seen)
        if not (await asyncio.to_thread(self.hub.command, self.visitor, body)).ok:
            return  # the hub has said why
        view = self.hub.view
        view.aim_at_nothing()
        view.selected = view.placing = body.name
        self._just = Thing(body.name, disturb.kind_of(kind))
        self.tell(f"{body.name} stands {where}. Drag it, or click the floor where it should stand.", "Added", "green")

    def clear(self) -> None:
        """Undo what was added and moved."""
        if (now := self._now()) is not None:
            for command in disturb.cleared(*now):
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
        """The scene and the newest tick, when they can be changed; a note when an earlier period is shown."""
        shown = self.shown
        if shown is None or shown.newest is None or shown.scene is None or not self.hub.live(self.visitor):
            return None
        return shown.scene, shown.newest

    def _thing(self) -> Thing | None:
        """The selected thing, when it can be changed."""
        if (now := self._now()) is None:
            return None
        selected, just = self.hub.view.selected, self._just
        found = disturb.things(*now).get(selected)
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
            self._put(disturb.put_back(thing.name, scene) if what == BACK else disturb.put_in_front(thing.name, tick))

    def _put(self, command: Command | None) -> None:
        if command is None:
            self.tell("the scene has no place for this cube")
        else:
            self.send(command)

    def _turn_or_delete(self, what: str) -> None:
        if what == DELETE:
            self.delete()
        elif (thing := self._thing()) is not None and (now := self._now()) is not None:
            if command := disturb.turned(thing, *now, disturb.TURN * (1 if what == LEFT else -1)):
                self.send(command)

    def _push(self, way: str) -> None:
        if (now := self._now()) is not None:
            self.send(disturb.pushed(now[1], way))

    def _take_cube(self) -> None:
        if (now := self._now()) is not None and (name := disturb.held_cube(now[1])):
            self._put(disturb.put_back(name, now[0]))


def about(thing: Thing | None, sending: str, placing: str = "") -> str:
    """A hint for the selected thing, or for the next click on the floor, as HTML."""
    if sending or placing:
        what = "go" if sending else "stand, or drag it"
        return note(f"Click the floor where <b>{text(sending or placing)}</b> should {what} (Esc cancels).", BLUE)
    return note(_HOW["" if thing is None else thing.kind])


def faults(texts: list[str]) -> str:
    """Faults that last, as HTML; "" when there are none."""
    if not texts:
        return ""
    lines = "<br>".join(map(text, texts))
    return note(
        f'<div style="border-left:3px solid var(--motm-amber);background:{wash(AMBER)};padding:3px 8px">{lines}</div>',
        "var(--motm-amber)",
    )
