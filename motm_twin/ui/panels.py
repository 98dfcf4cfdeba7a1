"""The panel beside the scene: state, driving, progress, disturbances, scene choice, layers."""

from collections.abc import Callable
from dataclasses import dataclass

import viser

from motm_twin.bus.commands import Command, Load, Pause, Play, Reset, Speed, Step
from motm_twin.bus.messages import SceneChoice, StatusMessage, TickMessage
from motm_twin.ui import cards, colours
from motm_twin.ui.camera import PRESETS, Cameras

SPEEDS = {"1/8": 0.125, "1/4": 0.25, "1/2": 0.5, "1x": 1.0, "2x": 2.0, "4x": 4.0, "8x": 8.0}
_NOTHING: tuple[str, ...] = ("",)
WIDTH = 320  # [px]
LAYERS = ("Occupancy grid", "Candidates", "Paths", "Ghosts", "Trails")


@dataclass(frozen=True)
class Actions:
    """What the panel can make happen."""

    send: Callable[[Command], None]
    add: Callable[[str], None]
    clear: Callable[[], None]
    layer: Callable[[str, bool], None]
    forget_candidate: Callable[[], None]


class Panels:
    """Widgets, and what they show. All texts go through `cards`, which escapes them."""

    def __init__(self, server: viser.ViserServer, cameras: Cameras, actions: Actions) -> None:
        self._server, self._gui, self._actions, self._cameras = server, server.gui, actions, cameras
        self._gui.configure_theme(show_logo=False, show_share_button=False, brand_color=colours.BRAND)
        self._gui.set_panel_label("motm-twin")
        self._gui.main_panel.dock_right()
        self._gui.main_panel.set_width(WIDTH)
        self._playing = False
        self._choices: list[SceneChoice] = []
        self._status_card = self._gui.add_html(cards.status_card("waiting", None, "connecting"))
        self._drive_widgets()
        self._progress_card = self._gui.add_html("")
        self._disturb_widgets()
        self._candidate_card = self._gui.add_html(cards.legend())
        self._scene_widgets()
        self._view_widgets()
        self._commands()
        self._shown: dict[str, str] = {}

    def show_status(self, state: str, status: StatusMessage | None, note: str) -> None:
        """State of the server; ``state`` is its own word, or waiting or lost."""
        self._set("status", self._status_card, cards.status_card(state, status, note))
        playing = state == "playing"
        if playing != self._playing:
            self._playing = playing
            self._play.label = "Pause" if playing else "Play"
            self._play.icon = viser.Icon.PLAYER_PAUSE if playing else viser.Icon.PLAYER_PLAY
        if status is not None and status.scenes != self._choices:
            self._choices = status.scenes
            self._scene.options = tuple(choice.name for choice in status.scenes)
            self._adopt(status)

    def adopt_scene(self, status: StatusMessage) -> None:
        """Set the choice to what is running now."""
        self._adopt(status)

    def show_tick(self, tick: TickMessage, picked: int | None) -> None:
        """Progress and the picked candidate."""
        self._set("progress", self._progress_card, cards.progress_card(tick))
        self._set("candidate", self._candidate_card, cards.candidate_card(tick.placement, picked))

    def greet(self, client: viser.ClientHandle) -> None:
        """The card on how to drive, for a new visitor."""
        client.add_notification(
            "How to drive",
            "Drag a Temi or a box over the floor, also into the robot's way. Click a coloured candidate to read its "
            "costs. Space: play / pause, N: one step, H: all keys.",
            auto_close_seconds=20.0,
            color=colours.BRAND,
        )

    def _set(self, name: str, handle: viser.GuiHtmlHandle, content: str) -> None:
        if self._shown.get(name) != content:
            self._shown[name] = content
            handle.content = content

    def _drive_widgets(self) -> None:
        self._play = self._gui.add_button("Play", icon=viser.Icon.PLAYER_PLAY, hint="space")
        self._play.on_click(self._async(lambda _: self._toggle()))
        steps = self._gui.add_button_group("Time", ("Step", "Reset"), hint="N: one period of 50 ms; R: from the start")
        steps.on_click(
            self._async(lambda event: self._actions.send(Step() if event.target.value == "Step" else Reset()))
        )
        speed = self._gui.add_dropdown("Speed", tuple(SPEEDS), initial_value="1x", hint="wanted real-time factor")
        speed.on_update(self._async(lambda event: self._from_visitor(event, Speed(factor=SPEEDS[event.target.value]))))
        self._speed = speed

    def _disturb_widgets(self) -> None:
        bodies = self._gui.add_button_group(
            "Disturb", ("Add Temi", "Add box", "Clear"), hint="then drag it by mouse; the map does not know it"
        )

        def act(event: viser.GuiEvent) -> None:
            kind = event.target.value
            if kind == "Clear":
                self._actions.clear()
            else:
                self._actions.add("temi" if kind == "Add Temi" else "box")

        bodies.on_click(self._async(act))

    def _scene_widgets(self) -> None:
        with self._gui.add_folder("Scene"):
            self._scene: viser.GuiDropdownHandle[str] = self._gui.add_dropdown("Scene", _NOTHING)
            self._variant: viser.GuiDropdownHandle[str] = self._gui.add_dropdown("Variant", _NOTHING)
            self._seed = self._gui.add_number("Seed", 0, min=0, max=2**31 - 1, step=1)
            load = self._gui.add_button("Load", icon=viser.Icon.REFRESH)
        self._scene.on_update(self._async(lambda _: self._offer_variants()))
        load.on_click(self._async(lambda _: self._load()))

    def _view_widgets(self) -> None:
        views = self._gui.add_button_group("Camera", PRESETS, hint="keys 1, 2, 3")
        views.on_click(
            self._async(lambda event: event.client and self._cameras.choose(event.client, event.target.value))
        )
        with self._gui.add_folder("Layers", expand_by_default=False):
            for name in LAYERS:
                box = self._gui.add_checkbox(name, True)
                box.on_update(self._async(lambda event, name=name: self._actions.layer(name, bool(event.target.value))))

    def _commands(self) -> None:
        table: list[tuple[str, str, Callable[[viser.CommandEvent], object]]] = [
            ("Play / pause", "space", lambda _: self._toggle()),
            ("One step", "N", lambda _: self._actions.send(Step())),
            ("Reset", "R", lambda _: self._actions.send(Reset())),
            ("Add Temi", "T", lambda _: self._actions.add("temi")),
            ("Add box", "B", lambda _: self._actions.add("box")),
            ("Forget the picked candidate", "C", lambda _: self._actions.forget_candidate()),
            ("How to drive", "H", lambda event: self._help(event.client)),
        ]
        for number, preset in enumerate(PRESETS, 1):
            table.append(
                (f"Camera: {preset}", str(number), lambda event, preset=preset: self._camera(event.client, preset))
            )
        for label, key, act in table:
            self._gui.add_command(label, hotkey=key).on_trigger(self._async(act))  # type: ignore[arg-type]

    def _camera(self, client: viser.ClientHandle | None, preset: str) -> None:
        if client is not None:
            self._cameras.choose(client, preset)

    def _help(self, client: viser.ClientHandle | None) -> None:
        if client is not None:
            with client.gui.add_modal("How to drive") as modal:
                client.gui.add_markdown(cards.HELP)
                client.gui.add_button("Close").on_click(self._async(lambda _: modal.close()))

    def _toggle(self) -> None:
        self._actions.send(Pause() if self._playing else Play())

    def _from_visitor(self, event: viser.GuiEvent, command: Command) -> None:
        """Send only what a person changed, not what this program set."""
        if event.client is not None:
            self._actions.send(command)

    def _adopt(self, status: StatusMessage) -> None:
        if status.scene in self._scene.options:
            self._scene.value = status.scene
            self._offer_variants()
            if status.variant in self._variant.options:
                self._variant.value = status.variant
            self._seed.value = status.seed

    def _offer_variants(self) -> None:
        chosen = next((choice for choice in self._choices if choice.name == self._scene.value), None)
        self._variant.options = tuple(chosen.variants) if chosen and chosen.variants else ("",)

    def _load(self) -> None:
        variant = self._variant.value or None
        self._actions.send(Load(scene=self._scene.value, variant=variant, seed=int(self._seed.value)))

    @staticmethod
    def _async(act: Callable) -> Callable:
        """Callbacks as coroutines: they keep their order, which thread-pool callbacks do not."""

        async def callback(event: object) -> None:
            act(event)

        return callback
