"""The panel of one visitor: state of the twin, who drives, tabs to drive, disturb, explain, tune and look back; keys.

Each browser page gets a panel when it connects, which is dropped when the page closes. Viser's command palette (the
icon on top) lists the commands. The script web_assets/page/overlay.js draws a timeline, the legend, names and a cover
over the scene. It reads its data from hidden widgets, as JSON behind a mark. It sends its requests through another
hidden widget, as a JSON list: a sequence number, a name in the table of `Overlay`, and the arguments.
"""

import json
import warnings
from collections.abc import Callable
from functools import partial
from typing import Any

import msgspec
import viser

from motm_twin.bus.commands import NAME_MAX, HandOver, RemoveTask, Reset, Speed, Step, TakeWheel
from motm_twin.bus.messages import StatusMessage, TickMessage
from motm_twin.model.names import scene_name
from motm_twin.ui import colours
from motm_twin.ui.hub import LAYERS, Hub, Shown, Visitor, clean_name, names_of
from motm_twin.ui.page_server import link
from motm_twin.ui.panel.disturb import DisturbTab, is_free
from motm_twin.ui.panel.drive_tab import SPEEDS, DriveTab
from motm_twin.ui.panel.numbers import PLOTS, PLOTS_KEY
from motm_twin.ui.panel.replay_tab import ReplayTab
from motm_twin.ui.panel.tune_tab import TuneTab
from motm_twin.ui.panel.why_tab import NEXT_WEIGHT, WhyTab, headline, held_up, says
from motm_twin.ui.panel.widgets import AMBER, BLUE, GREEN, MUTED, RED, Block, card, chip, ends, note, text
from motm_twin.ui.scene.cameras import PRESETS
from motm_twin.ui.scene.scene_view import SceneView

# No arrow keys: they belong to the slider or list that has the focus. Not W A S D Q E: they fly Viser's camera.
_FLY, _WRIST = ("Fly the camera", "W A S D Q E"), ("View of the wrist camera", "I")
_SHOWN = {"delete": "Del", "escape": "Esc"}
SHORT = """<div class="short"><b>Look</b><span>drag to turn, right-drag to move, wheel to zoom</span>
<b>Disturb</b><span>grab a Temi, a cube or a table and drag it</span>
<b>Ask</b><span>click a coloured dot, then open <i>Why</i></span></div>"""


def add_commands(
    scene: SceneView, drive: DriveTab, disturb: DisturbTab, replay: ReplayTab, help_card: "HelpCard"
) -> None:
    """Register keys and palette commands for a visitor."""
    hub, visitor = drive.hub, drive.visitor
    table: list[tuple[str, str | None, Callable, bool]] = [  # label, key, action, only for the driver
        ("Play / pause", "space", lambda: replay.toggle() or drive.toggle(), True),
        ("One step of 50 ms", "N", lambda: drive.send(Step()), True),
        ("Reset", "R", lambda: drive.send(Reset()), True),
        ("Faster", "X", lambda: drive.faster(1), True),
        ("Slower", "Z", lambda: drive.faster(-1), True),
        ("Add a Temi", "T", lambda: disturb.add("temi"), True),
        ("Add a person", "P", lambda: disturb.add("person"), True),
        ("Add a box", "B", lambda: disturb.add("box"), True),
        ("Add a cylinder", "C", lambda: disturb.add("cylinder"), True),
        ("Freeze / go on", "F", disturb.freeze, True),
        ("Delete the selected", "delete", disturb.delete, True),
        ("Cancel the next click", "escape", disturb.cancel, True),
        ("Clear all disturbances", None, disturb.clear, True),
        ("Back by one period", "J", lambda: replay.step(-1), True),
        ("On by one period", "K", lambda: replay.step(1), True),
        ("Back to live", "L", hub.playback.live, True),
        ("Branch from here", None, replay.branch, True),
        ("Undo the branch", None, replay.undo, True),
        ("Save the session", "V", replay.save, False),
        ("Screenshot", None, replay.screenshot, False),
        ("Ask for the wheel", None, lambda: hub.ask(visitor), False),
    ]
    for number, preset in enumerate(PRESETS, 1):
        table.append((f"Camera: {preset}", str(number), partial(scene.cameras.choose, visitor.client, preset), False))
    table.append(("How to drive", "H", help_card.show_keys, False))
    help_card.keys = [(label, _SHOWN.get(key, key)) for label, key, *_ in table if key is not None]
    help_card.keys[-1:-1] = [_FLY, _WRIST, (PLOTS, PLOTS_KEY)]  # keys of the page, and of a panel with its own command
    for label, key, act, drives in table:
        guard = hub.driving if drives else hub.watching
        command = visitor.client.gui.add_command(label, hotkey=key)  # type: ignore[arg-type]
        command.on_trigger(guard(lambda *_, act=act: act()))


class HelpCard:
    """The window with all keys of one visitor."""

    def __init__(self, hub: Hub, visitor: Visitor) -> None:
        self._hub, self._visitor = hub, visitor
        self._window: viser.GuiModalHandle | None = None
        self.keys: list[tuple[str, str]] = []  # action and its key

    def show_keys(self) -> None:
        """Show or hide a window with all commands and their keys."""
        if self._hide_keys():
            return
        gui = self._visitor.client.gui
        with gui.add_modal("How to drive") as self._window:
            gui.add_html(SHORT)
            keys = "".join(f"<div><kbd>{key}</kbd>{label}</div>" for label, key in self.keys)
            gui.add_html(f'<div class="keys">{keys}</div>')
            if address := link("page"):
                words = "Documentation: the page, the method, your own scene or robot"
                gui.add_html(note(f'<a class="docs" href="{address}" target="_blank" rel="noopener">{words}</a>'))
            gui.add_button("Close", hint="H or Esc").on_click(self._hub.watching(lambda *_: self._hide_keys()))

    def _hide_keys(self) -> bool:
        """Close the window; False when none was open."""
        window, self._window = self._window, None
        if window is not None:
            window.close()
        return window is not None


# A page may close while its panel is being updated; that is nothing to report.
warnings.filterwarnings("ignore", message="Queued a .* on a closed connection")

WIDTH = 330  # [px]
AS_WANTED = 0.03  # share of the requested speed: the actual one is shown only when it differs by at least this
TOP = '<i class="motm-top"></i>'  # marks the block that stays in sight when the panel is scrolled
CROSSHAIR = "<style>canvas, div:has(> canvas) {cursor: crosshair !important}</style>"  # next click: the floor
INK, PAST = "var(--motm-ink)", "var(--motm-past)"  # colours of the time: live, and looking back
_STATES = {
    "playing": ("Running", GREEN),
    "paused": ("Paused", MUTED),
    "loading": ("Loading", AMBER),
    "done": ("Finished", BLUE),
    "error": ("Stopped by an error", RED),
    "waiting": ("Waiting for the twin", AMBER),
    "lost": ("Connection lost", RED),
}


class Panels:
    """Keeps one `Panel` per connected browser page up to date."""

    def __init__(self, server: viser.ViserServer, hub: Hub, scene: SceneView) -> None:
        self._hub, self._scene_view = hub, scene
        self._panels: dict[int, Panel] = {}
        self._scene: tuple[str, str, int] | None = None
        server.on_client_connect(self._enter)
        server.on_client_disconnect(self._leave)

    def update(self, shown: Shown) -> None:
        """Bring every panel up to date; one that fails does not stop the others."""
        self._hub.playback.advance(self._hub.span)
        status = shown.status
        scene = None if status is None else (status.scene, status.variant, status.seed)
        if scene != self._scene and None not in (scene, self._scene):
            self._hub.what_if.stop()  # a comparison belongs to one scene
        self._scene = scene or self._scene
        for panel in list(self._panels.values()):
            try:
                if not panel.visitor.gone:
                    panel.update(shown)
            except Exception as error:
                if not panel.visitor.gone:  # else the visitor has left, and its widgets are gone
                    self._hub.tell_error(panel.visitor, error, "The panel has an error")

    async def _enter(self, client: viser.ClientHandle) -> None:
        visitor = self._hub.enter(client)
        try:
            self._panels[client.client_id] = Panel(self._hub, visitor, self._scene_view)
        except Exception as error:
            self._hub.tell_error(visitor, error, "There is no panel")

    async def _leave(self, client: viser.ClientHandle) -> None:
        self._panels.pop(client.client_id, None)
        visitor = self._hub.leave(client)
        if visitor is not None:
            self._scene_view.leave(visitor)


class Panel:
    """The widgets of one visitor."""

    def __init__(self, hub: Hub, visitor: Visitor, scene: SceneView) -> None:
        self.visitor, self._hub = visitor, hub
        gui = visitor.client.gui
        gui.configure_theme(show_logo=False, show_share_button=False, brand_color=colours.BRAND)
        gui.set_panel_label("motm-twin")
        gui.main_panel.dock_right()
        gui.main_panel.set_width(WIDTH)
        self._status = gui.add_html(status_card("waiting", None, "connecting"))
        wheel = Wheel(gui, hub, visitor)
        tabs, icon = gui.add_tab_group(), viser.Icon
        self._help = HelpCard(hub, visitor)
        with tabs.add_tab("Drive", icon.STEERING_WHEEL):
            drive = DriveTab(gui, hub, visitor, scene, self._help.show_keys)
        with tabs.add_tab("Disturb", icon.HAND_FINGER):
            disturb = DisturbTab(gui, hub, visitor)
        with tabs.add_tab("Why", icon.BULB):
            why = WhyTab(gui, hub, visitor)
        with tabs.add_tab("Tune", icon.ADJUSTMENTS):
            tune = TuneTab(gui, hub, visitor)
        with tabs.add_tab("Replay", icon.HISTORY):
            replay = ReplayTab(gui, hub, visitor)
        overlay = Overlay(visitor, hub, scene, drive, disturb, replay)
        self._blocks: list[Block] = [wheel, drive, disturb, why, tune, replay, overlay]
        add_commands(scene, drive, disturb, replay, self._help)
        self._driving: bool | None = None

    def update(self, shown: Shown) -> None:
        """Bring the widgets of the panel up to date."""
        driving = self._hub.drives(self.visitor)
        aiming = driving and bool(shown.view.placing or shown.view.sending)
        says = "" if shown.tick is None else headline(shown.tick, shown.scene)
        time = None if shown.tick is None else shown.tick.time
        status_html = status_card(shown.state, shown.status, self._note(shown), time=time, live=shown.live, says=says)
        self._status.content = TOP + status_html + (CROSSHAIR if aiming else "")
        if driving != self._driving:
            self._driving = driving
            for block in self._blocks:
                block.enable(driving)
        for block in self._blocks:
            block.update(shown)

    def _note(self, shown: Shown) -> str:
        status = shown.status
        if shown.state == "lost":
            return "the twin server is silent; this page reconnects by itself"
        if status is None:
            return f"no twin server at {self._hub.client.endpoint} yet"
        if shown.state == "done" and shown.newest is not None and shown.newest.success:
            return ""  # the headline says so
        if not status.text and status.plant in ("zenoh", "mirror"):
            return status.plant_text  # state of the robot in another program, and its refusals
        return status.text or ("" if shown.tick is None else held_up(shown.tick, shown.scene))


def status_card(
    state: str, status: StatusMessage | None, note: str, *, time: float | None = None, live: bool = True, says: str = ""
) -> str:
    """State, time [s], speed, what the robot does (HTML), and a note when something is wrong; of constant height.

    ``time``: of the shown period, which is an earlier one when not ``live``.
    """
    name, colour = _STATES.get(state, (state, MUTED)) if live else ("Looking back", PAST)
    clock, rows = "", []
    if time is not None:
        clock = f'<span style="font-size:17px;font-weight:600;color:{INK if live else PAST}">{time:.2f} s</span>'
    if status is not None:
        where = text(f"{scene_name(status.scene, status.variant)}, seed {status.seed}")
        rows = [f'<div class="mu one">{where} &middot; {_speed(state, status)}</div>']
    alarm = _STATES[state][1] if state in {"error", "lost", "done"} else AMBER
    if says:
        rows += [says, f'<div class="alert" title="{text(note)}" style="color:{alarm}">{text(note)}</div>']
    else:  # no activity yet: room for a long note
        rows.append(f'<div class="long" style="color:{alarm}">{text(note)}</div>')
    return card(ends(chip(name, colour), clock), *rows, style="padding:8px 12px 2px")


def _speed(state: str, status: StatusMessage) -> str:
    commanded = f"{status.speed:g}&times;"
    known = state == "playing" and status.actual_speed > 0.0
    if not known or abs(status.actual_speed - status.speed) < AS_WANTED * status.speed:
        return commanded
    capped = f' <b style="color:{AMBER}">(all it can)</b>' if status.capped else ""
    return f"{commanded}, in fact {status.actual_speed:.2f}&times;{capped}"


class Wheel(Block):
    """Shows who drives once there are two people; buttons to ask for a hand-over and to hand over."""

    def __init__(self, gui: viser.GuiApi, hub: Hub, visitor: Visitor) -> None:
        super().__init__(gui, hub, visitor)
        icon = viser.Icon
        self._line, self._asked = gui.add_html(""), gui.add_html("")
        self._yield = self.button("Hand over", self._hand_over, visible=False, icon=icon.STEERING_WHEEL)
        self._ask = self.button(
            "Ask for the wheel", lambda: hub.ask(visitor), anybody=True, visible=False, icon=icon.HAND_STOP
        )
        self._name = gui.add_text("Your name", visitor.name, visible=False, hint=f"up to {NAME_MAX} characters")
        self._name.on_update(hub.watching(lambda event, _: self._rename(event.target.value)))

    def _refresh(self, shown: Shown) -> None:
        hub, visitor, status = self.hub, self.visitor, shown.status
        driver = "" if status is None else status.driver
        mine, asker = driver == visitor.sender, hub.asker()
        others = len(hub.visitors) > 1 or (driver != "" and not mine)
        self._line.content = driver_line(status, visitor.sender) if others else ""
        self._asked.content = asked_line(asker.name) if mine and asker is not None else ""
        self._yield.visible = mine and others
        self._yield.label = "Hand over" if asker is None else f"Hand over to {asker.name}"
        self._ask.visible = driver != "" and not mine
        self._ask.label = "You have asked for the wheel" if hub.asks(visitor) else "Ask for the wheel"
        self._name.visible = others

    def _hand_over(self) -> None:
        asker = self.hub.asker()
        self.send(HandOver() if asker is None else HandOver(to=asker.sender, name=asker.name))

    def _rename(self, name: str) -> None:
        self.visitor.rename(name)
        if len(name) > NAME_MAX:
            self._name.value = self.visitor.name
        if self.hub.is_driver(self.visitor):
            self.send(TakeWheel())  # carries the new name


def driver_line(status: StatusMessage | None, sender: str) -> str:
    """One line that says who drives, as HTML."""
    if status is None:
        return ""
    if not status.driver:
        return _line("var(--motm-edge)", "Nobody is driving: do anything to take the wheel")
    if status.driver == sender:
        return _line(GREEN, "<b>You</b> are driving")
    name = text(clean_name(status.driver_name) or "Somebody")
    return _line(AMBER, f"<b>{name}</b> is driving, you are looking")


def asked_line(name: str) -> str:
    """The note for a driver that somebody wants to drive, as HTML."""
    return _line("var(--motm-brand)", f"<b>{text(name)}</b> asks for the wheel")


def _line(colour: str, content: str) -> str:
    return card(f'<div class="driver"><i style="background:{colour}"></i>{content}</div>', style="padding:0 12px 10px")


ASK = "motm-ask"  # label of the widget that the script writes to
MARK = "<!--motm:{}-->"
EVENTS = 200  # on the timeline


class Overlay(Block):
    """Data for overlay.js on the page of one visitor, and the requests that come from it."""

    def __init__(
        self, visitor: Visitor, hub: Hub, scene: SceneView, drive: DriveTab, disturb: DisturbTab, replay: ReplayTab
    ) -> None:
        gui = visitor.client.gui
        super().__init__(gui, hub, visitor)
        self._replay, self._cameras = replay, scene.cameras
        self._legend, self._now, self._events, self._names = (gui.add_html("", visible=False) for _ in range(4))
        self._legend.content = _packed("legend", LAYERS)
        self._scene: object = None
        self._count = -1
        playback = hub.playback
        self._acts: dict[str, tuple[bool, Callable[..., object]]] = {  # for the driver only, action
            "toggle": (True, lambda: replay.toggle() or drive.press()),
            "reset": (True, lambda: self.send(Reset())),
            "step": (True, self._step),
            "speed": (True, lambda name: self.send(Speed(factor=SPEEDS[name]))),
            "look": (True, lambda seconds: playback.look(float(seconds), hub.span)),
            "live": (True, playback.live),
            "branch": (True, replay.branch),
            "undo": (True, replay.undo),
            "save": (False, replay.save),
            "page": (False, replay.export),
            "picture": (False, replay.screenshot),
            "go": (True, lambda: scene.clicks.drive(visitor)),
            "stay": (True, self._cancel_drive),
            "temi": (True, lambda: disturb.add("temi")),
            "ahead": (True, self._compare_without_next),
            "hide": (False, self._hide),
            "camera": (False, lambda name: scene.cameras.choose(visitor.client, name)),
            "turned": (False, lambda: scene.cameras.turned(visitor.client)),
            "aspect": (False, lambda aspect: scene.cameras.tell_aspect(visitor.client, aspect)),
            "drawn": (False, self._drawn),
        }
        asked = gui.add_text(ASK, "", visible=False)
        asked.on_update(self._asked)

    def _refresh(self, shown: Shown) -> None:
        hub, status, span = self.hub, shown.status, self.hub.span
        if shown.scene is not None and shown.scene is not self._scene:
            self._scene = shown.scene
            self._names.content = _packed("names", names_of(shown.scene))
        if self._count != hub.events.count:
            self._count, found = hub.events.count, hub.events.last(EVENTS)
            self._events.content = _packed("events", [(round(e.time, 2), e.kind, e.text) for e in found])
        now = {
            "state": shown.state,
            "text": "" if status is None else status.text,
            "t": None if shown.tick is None else round(shown.tick.time, 2),
            "span": None if span is None else [round(span.first_time, 2), round(span.last_time, 2)],
            "live": shown.live,
            "playing": shown.state == "playing" if shown.live else hub.playback.playing,
            "speed": next((name for name, factor in SPEEDS.items() if status and factor == status.speed), "1x"),
            "says": "" if shown.tick is None else says(shown.tick, shown.scene),
            "mine": hub.drives(self.visitor),
            "picked": shown.view.picked,
            "camera": self._cameras.mode(self.visitor.client),
            "going": shown.view.going if shown.live else None,
            "free": shown.view.going is None or is_free(shown.grid, shown.view.going),
            "sent_to": sent_to(shown.newest, shown.view.sent_to),
            "aside": None if status is None else status.aside,
        }
        self._now.content = _packed("now", now)

    async def _asked(self, event: Any) -> None:
        try:
            _, name, *more = json.loads(event.target.value)
            drives, act = self._acts[name]
        except (ValueError, KeyError, TypeError):
            return  # not from our script
        guard = self.hub.driving if drives else self.hub.watching
        await guard(lambda *_: act(*more))(event)

    def _step(self, periods: int) -> None:
        """Step the twin when going on from the newest period; otherwise show the one ``periods`` later or earlier."""
        if periods > 0 and self.hub.view.at is None:
            self.send(Step())
        else:
            self._replay.step(int(periods))

    def _cancel_drive(self) -> None:
        """Drop the proposed drive; without one, remove the drive that was confirmed last."""
        view, newest = self.hub.view, None if self.shown is None else self.shown.newest
        index = drive_index(newest, view.sent_to)
        if view.going is not None:
            view.going = None
        elif index is not None and self.hub.live(self.visitor):
            self.send(RemoveTask(index=index))

    def _compare_without_next(self) -> None:
        """Compare the run with one whose placement ignores the way on to the next target (weight 0)."""
        if self.shown is not None and self.shown.newest is not None:
            self.hub.what_if.start({NEXT_WEIGHT: 0.0}, 0, self.shown.newest.run)

    def _drawn(self) -> None:
        self.visitor.drawn = True
        self._cameras.drawn(self.visitor.client)

    def _hide(self, keys: list[str]) -> None:
        self.visitor.hidden = frozenset(map(str, keys))


def sent_to(tick: TickMessage | None, target: str) -> str:
    """A sentence about the drive to this target that can be undone; "" when it has ended."""
    index = drive_index(tick, target)
    if tick is None or index is None:
        return ""
    return f"Drive to {target} {'has begun' if index == tick.task_index else 'comes next'}"


def drive_index(tick: TickMessage | None, target: str) -> int | None:
    """Index of the task that drives to this target and has not ended; None when there is none."""
    for index, task in enumerate([] if tick is None else tick.tasks):
        if task.kind == "drive_to" and task.target == target and task.status in ("waiting", "active"):
            return index
    return None


def _packed(mark: str, content: object) -> str:
    return MARK.format(mark) + msgspec.json.encode(content).decode()
