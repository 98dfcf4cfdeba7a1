"""Disturbing: new bodies, what can be done with the selected thing, pushes, and sensors that fail."""

import asyncio
import html

import viser

from motm_twin.bus.commands import Announce, Command, InjectFault, RemoveBody
from motm_twin.model.faults import KINDS
from motm_twin.ui import disturb, markup
from motm_twin.ui.aim import Surroundings
from motm_twin.ui.disturb import Thing
from motm_twin.ui.hub import Hub, Shown, Visitor
from motm_twin.ui.sight import Sight
from motm_twin.ui.widgets import Changing, Html, buttons, follow

NEW = {"Temi": "temi", "Person": "person", "Box": "box", "Cylinder": "cylinder"}
NOTHING = "(nothing)"
LEFT, RIGHT, DELETE = "Turn it left", "Turn it right", "Delete"
FREEZE, GO_ON, SEND, STAY = "Freeze", "Go on", "Send to…", "Do not send"
SECONDS = {"lidar_off": 1.0, "camera_off": 2.0}  # of the faults of a click; the others last 5 s
FAULTS = {
    f"{kind.button} {SECONDS.get(kind.name, 5.0):g} s": InjectFault(
        fault=kind.name, seconds=SECONDS.get(kind.name, 5.0)
    )
    for kind in KINDS.values()
}
IN_A_ROW = 3  # buttons of faults
_HOW = {
    "": "Grab anything and drag it, also furniture; let go while moving to throw it. A drag elsewhere turns the view.",
    "agent": "Drag it into the way, or send it somewhere.",
    "obstacle": "Drag it into the way; the robot sees it with its lidar only.",
    "piece": "Drag it. The map does not follow until you tell the robot.",
    "object": "Drag the cube somewhere else while the robot reaches for it.",
}
_TEXT = "font-size:12px;line-height:1.4;color:#6b7280;padding:0 12px 6px 12px"


def about(thing: Thing | None, sending: str, placing: str = "") -> str:
    """What can be done with the selected thing, as HTML."""
    if sending or placing:
        what = "go" if sending else "stand, or drag it"
        text = f"Click the floor where <b>{html.escape(sending or placing)}</b> should {what} (Esc cancels)."
        return f'<div style="{_TEXT};color:#1d4ed8">{text}</div>'
    return f'<div style="{_TEXT}">{_HOW["" if thing is None else thing.kind]}</div>'


def faults(texts: list[str]) -> str:
    """Faults that last, as HTML; "" when there are none."""
    if not texts:
        return ""
    lines = "<br>".join(html.escape(text) for text in texts)
    return (
        f'<div style="{_TEXT}"><div style="border-left:3px solid #b45309;background:#b4530914;color:#92400e;'
        f'padding:3px 8px">{lines}</div></div>'
    )


class DisturbTab:
    """Widgets that disturb the robot."""

    def __init__(self, gui: viser.GuiApi, hub: Hub, visitor: Visitor) -> None:
        self._hub, self._visitor = hub, visitor
        self._shown: Shown | None = None
        self._changing = Changing()
        self._names: tuple[str, ...] = ()
        self._just: Thing | None = None  # added, and not in a tick yet
        gui.add_html(markup.card(markup.heading("Add before the robot")))
        self._row(gui, tuple(NEW), lambda what: self.add(NEW[what]), hint="keys T, P, B, C")
        gui.add_html(markup.card(markup.heading("With the selected thing")))
        self._choice: viser.GuiDropdownHandle[str] = self._changing(
            gui.add_dropdown("Selected", (NOTHING,), hint="or click it in the scene")
        )
        self._choice.on_update(hub.driving(lambda event, _: self._select(event.target.value)))
        self._about = Html(gui, about(None, ""))
        self._agent = self._row(gui, (FREEZE, SEND), self._with_agent)
        self._piece = self._row(gui, ("Tell the robot",), lambda _: self._announce(), hint="its map follows")
        self._cube = self._row(gui, ("In front of the robot", "Back to its place"), self._with_cube)
        self._turn = self._row(gui, (LEFT, RIGHT, DELETE), self._turn_or_delete)
        gui.add_html(markup.card(markup.heading("Push the robot by 10 cm, or turn it by 15°")))
        for turns in (False, True):
            ways = tuple(way for way, (_, _, turn) in disturb.PUSHES.items() if bool(turn) == turns)
            self._row(gui, ways, self._push, hint="its pose jumps; its wheels notice nothing")
        self._grip = self._row(gui, ("Take the cube from the gripper",), lambda _: self._take_cube())
        gui.add_html(markup.card(markup.heading("Sensors, wheels and joints fail for a while")))
        labels = tuple(FAULTS)
        for first in range(0, len(labels), IN_A_ROW):
            self._row(gui, labels[first : first + IN_A_ROW], lambda what: self._send(FAULTS[what]))
        self._faults = Html(gui)
        gui.add_divider()
        clear_hint = "added bodies go, furniture back to its place"
        self._row(gui, ("Clear all disturbances",), lambda _: self.clear(), hint=clear_hint)

    def enable(self, driving: bool) -> None:
        """Grey while somebody else drives."""
        self._changing.enable(driving)

    def update(self, shown: Shown) -> None:
        """Show this."""
        self._shown = shown
        if shown.scene is None or shown.newest is None:
            return
        listed = disturb.things(shown.scene, shown.newest)
        if self._just is not None and self._just.name in listed:
            self._just = None
        selected = shown.view.selected if shown.view.selected in listed else ""
        if tuple(listed) != self._names:
            self._names = tuple(listed)
            self._choice.options = (NOTHING, *self._names)
        follow(self._choice, selected or NOTHING)
        thing = listed.get(selected)
        placing = shown.view.placing if shown.view.placing == selected else ""
        self._about.set(about(thing, shown.view.sending, placing))
        kind = "" if thing is None else thing.kind
        self._agent.visible = kind == "agent"
        self._piece.visible, self._cube.visible = kind == "piece", kind == "object"
        self._turn.visible = thing is not None and thing.turns
        if thing is not None and kind == "agent":
            send = STAY if shown.view.sending == thing.name else SEND
            self._agent.options = (GO_ON if thing.frozen else FREEZE, send)
        self._grip.visible = disturb.held_cube(shown.newest) != ""
        self._faults.set(faults(shown.newest.faults))

    async def add(self, kind: str) -> None:
        """Put a new body on the floor before the robot; once it is taken, select it, and say where it is.

        A click moves it elsewhere.
        """
        shown = self._live()
        if shown is None:
            return
        assert shown.scene is not None and shown.newest is not None
        surroundings = Surroundings(shown.scene)
        surroundings.update(shown.newest)
        sight = Sight(self._visitor.client.camera, surroundings, shown.newest)
        body, where = disturb.new_body(kind, shown.scene, shown.newest, self._hub.client.grid(), sight)
        if not (await asyncio.to_thread(self._hub.command, self._visitor, body)).ok:
            return  # the hub has said why
        view = self._hub.view
        view.selected, view.placing, view.sending = body.name, body.name, ""
        self._just = Thing(body.name, disturb.kind_of(kind))
        note = f"{body.name} stands {where}. Drag it, or click the floor where it should stand."
        self._hub.tell(self._visitor, note, "Added", "green")

    def clear(self) -> None:
        """Undo what was added and moved."""
        shown = self._live()
        if shown is not None:
            for command in disturb.cleared(shown.scene, shown.newest):  # type: ignore[arg-type]
                self._send(command)

    def delete(self) -> None:
        """Take the selected thing away."""
        thing = self._thing()
        if thing is not None and thing.turns:
            self._just = None
            self._send(RemoveBody(name=thing.name))

    def cancel(self) -> None:
        """The next click on the floor sends and puts nothing; without such a wish, nothing is selected any more."""
        view = self._hub.view
        if view.sending or view.placing:
            view.sending = view.placing = ""
        else:
            view.selected = ""

    def freeze(self) -> None:
        """Stop the selected agent, or let it go on."""
        thing = self._thing()
        if thing is not None and thing.kind == "agent":
            self._send(disturb.freeze(thing))

    def _row(self, gui: viser.GuiApi, options: tuple[str, ...], act, hint: str | None = None):
        callback = self._hub.driving(lambda event, _: act(event.target.value))
        return self._changing(buttons(gui, options, callback, hint=hint))

    def _send(self, command: Command) -> None:
        self._hub.send(self._visitor, command)

    def _live(self) -> Shown | None:
        """What is shown, when it can be changed; a note when an earlier period is."""
        shown = self._shown
        if shown is None or shown.newest is None or shown.scene is None:
            return None
        return shown if self._hub.live(self._visitor) else None

    def _thing(self) -> Thing | None:
        shown = self._live()
        if shown is None:
            return None
        selected, just = self._hub.view.selected, self._just
        found = disturb.things(shown.scene, shown.newest).get(selected)  # type: ignore[arg-type]
        return just if found is None and just is not None and just.name == selected else found

    def _select(self, name: str) -> None:
        self._hub.view.selected = "" if name == NOTHING else name
        self._hub.view.sending = self._hub.view.placing = ""

    def _with_agent(self, what: str) -> None:
        thing = self._thing()
        if thing is None:
            return
        if what in (FREEZE, GO_ON):
            self._send(disturb.freeze(thing))
        else:
            self._hub.view.sending = "" if self._hub.view.sending == thing.name else thing.name
            self._hub.view.placing = ""

    async def _announce(self) -> None:
        """Tell the robot where the selected piece stands, and that it knows."""
        thing = self._thing()
        if thing is None:
            return
        if (await asyncio.to_thread(self._hub.command, self._visitor, Announce(name=thing.name))).ok:
            self._hub.tell(self._visitor, f"the robot's map has {thing.name} where it stands now", "Told", "green")

    def _with_cube(self, what: str) -> None:
        shown, thing = self._live(), self._thing()
        if shown is None or thing is None:
            return
        assert shown.scene is not None and shown.newest is not None
        if what == "Back to its place":
            self._put(disturb.put_back(thing.name, shown.scene))
        else:
            self._put(disturb.put_in_front(thing.name, shown.newest))

    def _put(self, command: Command | None) -> None:
        if command is None:
            self._hub.tell(self._visitor, "the scene has no place for this cube")
        else:
            self._send(command)

    def _turn_or_delete(self, what: str) -> None:
        shown, thing = self._live(), self._thing()
        if shown is None or thing is None:
            return
        assert shown.scene is not None and shown.newest is not None
        if what == DELETE:
            self._send(RemoveBody(name=thing.name))
            return
        command = disturb.turned(thing, shown.scene, shown.newest, disturb.TURN * (1 if what == LEFT else -1))
        if command is not None:
            self._send(command)

    def _push(self, way: str) -> None:
        shown = self._live()
        if shown is not None:
            self._send(disturb.pushed(shown.newest, way))  # type: ignore[arg-type]

    def _take_cube(self) -> None:
        shown = self._live()
        if shown is not None:
            assert shown.scene is not None and shown.newest is not None
            name = disturb.held_cube(shown.newest)
            if name:
                self._put(disturb.put_back(name, shown.scene))
