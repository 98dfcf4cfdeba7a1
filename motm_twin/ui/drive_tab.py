"""Driving: play, step, speed, tasks, scene, camera; what the robot is doing."""

import html

import viser

from motm_twin.bus.commands import Command, Load, Pause, Play, Reset, Speed, Step
from motm_twin.bus.messages import MethodChoice, SceneChoice, StatusMessage, TickMessage
from motm_twin.methods import DEFAULT_METHOD
from motm_twin.ui.camera import PRESETS
from motm_twin.ui.hub import LAYERS, Hub, Shown, Visitor
from motm_twin.ui.score_card import result_card
from motm_twin.ui.stage import Stage
from motm_twin.ui.task_list import TaskBlock
from motm_twin.ui.why_cards import now_card
from motm_twin.ui.widgets import Changing, Html, buttons, follow
from motm_twin.ui.words import method_title

_SMALL = "font-size:12px;line-height:1.4;color:#6b7280"
SPEEDS = {"1/8": 0.125, "1/4": 0.25, "1/2": 0.5, "1x": 1.0, "2x": 2.0, "4x": 4.0, "8x": 8.0}

_PLAY = "Play", viser.Icon.PLAYER_PLAY
_PRESSED = {"playing": ("Pause", viser.Icon.PLAYER_PAUSE), "done": ("Restart", viser.Icon.REFRESH)}  # by state


class DriveTab:
    """Widgets that drive the twin."""

    def __init__(self, gui: viser.GuiApi, hub: Hub, visitor: Visitor, stage: Stage) -> None:
        self._hub, self._visitor = hub, visitor
        self._changing = Changing()
        self._state = ""
        self._choices: list[SceneChoice] = []
        self._loaded: tuple = ()
        self._methods: list[MethodChoice] = []
        self._filled: tuple = (
            "",
            "",
            0,
            "",
        )  # scene, variant, seed and method as this program or a press of Load left them
        self._shown_speed = "1x"
        self._play = self._changing(gui.add_button("Play", icon=viser.Icon.PLAYER_PLAY, hint="space"))
        self._play.on_click(hub.driving(lambda *_: self._press()))
        act = hub.driving(lambda event, _: self._send(Step() if event.target.value == "Step" else Reset()))
        self._changing(buttons(gui, ("Step", "Reset"), act, hint="N: one period of 50 ms; R: from the start"))
        self._speed: viser.GuiDropdownHandle[str] = self._changing(
            gui.add_dropdown("Speed", tuple(SPEEDS), initial_value="1x", hint="wanted real-time factor")
        )
        self._speed.on_update(hub.driving(lambda event, _: self._send(Speed(factor=SPEEDS[event.target.value]))))
        choose = hub.watching(lambda event, visitor: stage.cameras.choose(visitor.client, event.target.value))
        buttons(gui, PRESETS, choose, hint="the camera; keys 1 to 5")
        self._progress = Html(gui)
        self._tasks = TaskBlock(gui, hub, visitor)
        with gui.add_folder("Scene", expand_by_default=False):
            self._scene: viser.GuiDropdownHandle[str] = self._changing(gui.add_dropdown("Scene", ("",)))
            self._variant: viser.GuiDropdownHandle[str] = self._changing(gui.add_dropdown("Variant", ("",)))
            self._seed = self._changing(gui.add_number("Seed", 0, min=0, max=2**31 - 1, step=1))
            self._method: viser.GuiDropdownHandle[str] = self._changing(
                gui.add_dropdown("Method", ("",), hint="who decides how the base drives and the arm reaches")
            )
            self._about = Html(gui)
            self._load = self._changing(gui.add_button("Load", icon=viser.Icon.REFRESH))
        self._scene.on_update(hub.driving(lambda *_: self._offer_variants()))
        self._load.on_click(hub.driving(lambda *_: self._load_scene()))
        with gui.add_folder("Layers", expand_by_default=False):
            self._layers = {name: self._layer(gui, name) for name in LAYERS}

    def enable(self, driving: bool) -> None:
        """Grey while somebody else drives; what was chosen but not loaded is forgotten then."""
        if not driving:
            self._filled, self._loaded = self._chosen(), ()
        self._changing.enable(driving)
        self._tasks.enable(driving)

    def update(self, shown: Shown) -> None:
        """Show this."""
        if shown.state != self._state:
            self._state = shown.state
            self._play.label, self._play.icon = _PRESSED.get(shown.state, _PLAY)
        if shown.status is not None:
            self._show_status(shown.status)
        if shown.tick is not None:
            now = now_card(shown.tick, shown.scene, shown.status)
            self._progress.set(now + count_line(shown.tick) + result_card(shown.tick, shown.status, shown.scene))
        for name, box in self._layers.items():
            follow(box, shown.view.layers.get(name, True))
        self._tasks.update(shown)

    def toggle(self) -> None:
        """Play or pause; a run that has ended is not thrown away by a key that was meant to pause it."""
        if self._now() == "done":
            self._hub.tell(self._visitor, "the run has ended: press Restart, or give the robot another task")
        else:
            self._press()

    def _press(self) -> None:
        self._send(Pause() if self._now() == "playing" else Play())

    def _now(self) -> str:
        """State of the twin: the panel may be a moment behind."""
        status = self._hub.client.status()
        return self._state if status is None else status.state

    def faster(self, steps: int) -> None:
        """Wish for a higher or lower speed."""
        names = list(SPEEDS)
        number = names.index(self._speed.value) + steps
        if 0 <= number < len(names):
            self._speed.value = names[number]  # at once: the next press counts from here
            self._send(Speed(factor=SPEEDS[names[number]]))

    def _layer(self, gui: viser.GuiApi, name: str) -> viser.GuiCheckboxHandle:
        box = self._changing(gui.add_checkbox(name, self._hub.view.layers.get(name, True)))
        box.on_update(self._hub.driving(lambda event, _: self._hub.view.layers.update({name: event.target.value})))
        return box

    def _show_status(self, status: StatusMessage) -> None:
        choosing = self._chosen() != self._filled  # a person is, and news of an earlier load must not undo that
        if status.scenes != self._choices:
            self._choices = status.scenes
            self._scene.options = tuple(choice.name for choice in status.scenes) or ("",)
        if status.methods != self._methods:
            self._methods = status.methods
            self._method.options = tuple(method_title(status, choice.name) for choice in status.methods) or ("",)
        loaded = (status.scene, status.variant, status.seed, status.method)
        if loaded != self._loaded and status.scene in self._scene.options:
            self._loaded = loaded
            if not choosing:
                self._fill(status)
        self._about.set(method_line(self._chosen_method()))
        speed = next((name for name, factor in SPEEDS.items() if factor == status.speed), None)
        if speed is not None and speed != self._shown_speed:
            self._shown_speed = speed
            self._speed.value = speed

    def _fill(self, status: StatusMessage) -> None:
        self._scene.value = status.scene
        self._offer_variants()
        if status.variant in self._variant.options:
            self._variant.value = status.variant
        self._seed.value = status.seed
        title = method_title(status, status.method)
        if title in self._method.options:
            self._method.value = title
        self._filled = self._chosen()

    def _chosen(self) -> tuple:
        return self._scene.value, self._variant.value, self._seed.value, self._method.value

    def _send(self, command: Command) -> None:
        self._hub.send(self._visitor, command)

    def _offer_variants(self) -> None:
        chosen = next((choice for choice in self._choices if choice.name == self._scene.value), None)
        self._variant.options = tuple(chosen.variants) if chosen and chosen.variants else ("",)

    def _chosen_method(self) -> MethodChoice | None:
        place = self._method.options.index(self._method.value)
        return self._methods[place] if place < len(self._methods) else None

    def _load_scene(self) -> None:
        self._seed.value = int(self._seed.value)  # of a fraction what counts
        self._filled = self._chosen()
        variant, chosen = self._variant.value or None, self._chosen_method()
        method = DEFAULT_METHOD if chosen is None else chosen.name
        self._send(Load(scene=self._scene.value, variant=variant, seed=int(self._seed.value), method=method))


def method_line(method: MethodChoice | None) -> str:
    """What a method does otherwise than the paper's, as HTML."""
    return (
        "" if method is None else f'<div style="{_SMALL};padding:0 12px 4px 12px">{html.escape(method.summary)}</div>'
    )


def count_line(tick: TickMessage) -> str:
    """Picks, places and contacts so far, as the referee counts them, as HTML."""
    score = tick.score
    if score is None:
        return ""
    picks, places = (sum(task.kind == kind for task in tick.tasks) for kind in ("pick", "place"))
    caused = sum(contact.caused_by_robot for contact in score.contacts)
    others = len(score.contacts) - caused
    contacts = f'<span style="color:{"#b91c1c" if caused else "#15803d"}">contacts {caused}</span>'
    contacts += f" (+{others} by others)" if others else ""
    return (
        '<div style="font-size:13px;color:#6b7280;padding:0 12px 6px 12px">'
        f"picked {score.picks}/{picks} &middot; placed {score.places}/{places} &middot; {contacts}</div>"
    )
