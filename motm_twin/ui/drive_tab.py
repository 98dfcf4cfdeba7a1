"""Driving: play, step, speed, scene; what the robot is doing and how far it is."""

from collections.abc import Callable

import viser

from motm_twin.bus.commands import AddObstacle, Load, Pause, Play, RemoveBody, Reset, Speed, Step
from motm_twin.bus.messages import SceneChoice
from motm_twin.ui import cards
from motm_twin.ui.camera import PRESETS
from motm_twin.ui.free_place import free_place
from motm_twin.ui.hub import LAYERS, Hub, Shown, Visitor
from motm_twin.ui.stage import Stage

SPEEDS = {"1/8": 0.125, "1/4": 0.25, "1/2": 0.5, "1x": 1.0, "2x": 2.0, "4x": 4.0, "8x": 8.0}
SIZES = {"temi": (0.5, 0.5, 1.0), "box": (0.4, 0.4, 0.6)}


class DriveTab:
    """Widgets that drive the twin."""

    def __init__(self, gui: viser.GuiApi, hub: Hub, visitor: Visitor, stage: Stage) -> None:
        self._gui, self._hub, self._visitor, self._stage = gui, hub, visitor, stage
        self._shown: Shown | None = None
        self._playing = False
        self._choices: list[SceneChoice] = []
        self._loaded: tuple = ()
        self._text = ""
        self._play = gui.add_button("Play", icon=viser.Icon.PLAYER_PLAY, hint="space")
        self._play.on_click(hub.driving(lambda *_: self._toggle()))
        self._steps = gui.add_button_group("Time", ("Step", "Reset"), hint="N: one period of 50 ms; R: from the start")
        self._steps.on_click(
            hub.driving(lambda event, _: self._send(Step() if event.target.value == "Step" else Reset()))
        )
        self._speed = gui.add_dropdown("Speed", tuple(SPEEDS), initial_value="1x", hint="wanted real-time factor")
        self._speed.on_update(hub.driving(lambda event, _: self._send(Speed(factor=SPEEDS[event.target.value]))))
        self._progress = gui.add_html("")
        self._bodies = gui.add_button_group("Disturb", ("Add Temi", "Add box", "Clear"), hint="then drag it by mouse")
        self._bodies.on_click(hub.driving(lambda event, _: self._disturb(event.target.value)))
        with gui.add_folder("Scene"):
            self._scene: viser.GuiDropdownHandle[str] = gui.add_dropdown("Scene", ("",))
            self._variant: viser.GuiDropdownHandle[str] = gui.add_dropdown("Variant", ("",))
            self._seed = gui.add_number("Seed", 0, min=0, max=2**31 - 1, step=1)
            self._load = gui.add_button("Load", icon=viser.Icon.REFRESH)
        self._scene.on_update(hub.watching(lambda *_: self._offer_variants()))
        self._load.on_click(hub.driving(lambda *_: self._load_scene()))
        views = gui.add_button_group("Camera", PRESETS, hint="keys 1, 2, 3")
        views.on_click(hub.watching(lambda event, visitor: stage.cameras.choose(visitor.client, event.target.value)))
        self._layers: list[viser.GuiCheckboxHandle] = []
        with gui.add_folder("Layers", expand_by_default=False):
            for name in LAYERS:
                box = gui.add_checkbox(name, hub.view.layers[name])
                box.on_update(
                    hub.driving(lambda event, _, name=name: hub.view.layers.update({name: bool(event.target.value)}))
                )
                self._layers.append(box)
        self._commands()

    def enable(self, driving: bool) -> None:
        """Grey while somebody else drives."""
        widgets = [self._play, self._steps, self._speed, self._bodies, self._load, *self._layers]
        for widget in widgets:
            widget.disabled = not driving

    def update(self, shown: Shown) -> None:
        """Show this."""
        self._shown = shown
        playing = shown.state == "playing"
        if playing != self._playing:
            self._playing = playing
            self._play.label = "Pause" if playing else "Play"
            self._play.icon = viser.Icon.PLAYER_PAUSE if playing else viser.Icon.PLAYER_PLAY
        status = shown.status
        if status is not None:
            if status.scenes != self._choices:
                self._choices = status.scenes
                self._scene.options = tuple(choice.name for choice in status.scenes)
            loaded = (status.scene, status.variant, status.seed)
            if loaded != self._loaded and status.scene in self._scene.options:
                self._loaded = loaded
                self._scene.value = status.scene
                self._offer_variants()
                if status.variant in self._variant.options:
                    self._variant.value = status.variant
                self._seed.value = status.seed
        if shown.tick is not None:
            text = cards.progress_card(shown.tick)
            if text != self._text:
                self._text = text
                self._progress.content = text

    def _send(self, command) -> None:
        self._hub.send(self._visitor, command)

    def _toggle(self) -> None:
        self._send(Pause() if self._playing else Play())

    def _disturb(self, what: str) -> None:
        shown = self._shown
        if shown is None or shown.newest is None or shown.scene is None:
            return
        tick = shown.newest
        if what == "Clear":
            for body in tick.obstacles:
                self._send(RemoveBody(name=body.name))
            return
        kind = "temi" if what == "Add Temi" else "box"
        bodies = (*tick.agents, *tick.obstacles)
        x, y, heading = free_place(tick.robot.true_pose, self._hub.client.grid(), [b.position[:2] for b in bodies])
        names = {body.name for body in bodies} | {solid.name for solid in shown.scene.solids}
        name = next(n for i in range(1, 1000) if (n := f"{kind} {i}") not in names)
        self._send(AddObstacle(name=name, shape=kind, x=x, y=y, heading=heading, size=SIZES[kind]))

    def _offer_variants(self) -> None:
        chosen = next((choice for choice in self._choices if choice.name == self._scene.value), None)
        self._variant.options = tuple(chosen.variants) if chosen and chosen.variants else ("",)

    def _load_scene(self) -> None:
        variant = self._variant.value or None
        self._send(Load(scene=self._scene.value, variant=variant, seed=int(self._seed.value)))

    def _commands(self) -> None:
        hub, cameras = self._hub, self._stage.cameras
        table: list[tuple[str, str, Callable]] = [
            ("Play / pause", "space", hub.driving(lambda *_: self._toggle())),
            ("One step", "N", hub.driving(lambda *_: self._send(Step()))),
            ("Reset", "R", hub.driving(lambda *_: self._send(Reset()))),
            ("Add Temi", "T", hub.driving(lambda *_: self._disturb("Add Temi"))),
            ("Add box", "B", hub.driving(lambda *_: self._disturb("Add box"))),
            ("How to drive", "H", hub.watching(lambda _, visitor: help_card(visitor))),
        ]
        for number, preset in enumerate(PRESETS, 1):
            act = hub.watching(lambda _, visitor, preset=preset: cameras.choose(visitor.client, preset))
            table.append((f"Camera: {preset}", str(number), act))
        for label, key, act in table:
            self._gui.add_command(label, hotkey=key).on_trigger(act)  # type: ignore[arg-type]


def help_card(visitor: Visitor) -> None:
    """How to drive, as a window over the page."""
    gui = visitor.client.gui
    with gui.add_modal("How to drive") as modal:
        gui.add_markdown(cards.HELP)
        gui.add_button("Close").on_click(lambda _: modal.close())
