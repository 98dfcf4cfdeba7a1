"""Commands with keys: everything important, also without the mouse. Viser's palette lists them (the icon on top)."""

from collections.abc import Callable
from typing import TYPE_CHECKING

from motm_twin.bus.commands import Reset, Step
from motm_twin.ui.camera import PRESETS
from motm_twin.ui.hub import Hub, Visitor
from motm_twin.ui.plots_panel import PLOTS, PLOTS_KEY
from motm_twin.ui.stage import Stage

if TYPE_CHECKING:
    from motm_twin.ui.disturb_tab import DisturbTab
    from motm_twin.ui.drive_tab import DriveTab
    from motm_twin.ui.help_card import HelpCard
    from motm_twin.ui.replay_tab import ReplayTab

# No arrow keys: they belong to the slider or list that has the focus. None of W A S D Q E: they fly Viser's camera.
_FLY = ("Fly the camera", "W A S D Q E")
_SHOWN = {"delete": "Del", "escape": "Esc"}


def add_commands(
    hub: Hub,
    visitor: Visitor,
    stage: Stage,
    drive: "DriveTab",
    disturb: "DisturbTab",
    replay: "ReplayTab",
    card: "HelpCard",
) -> None:
    """Give one visitor the keys and the palette."""
    table: list[tuple[str, str | None, Callable, bool]] = [  # label, key, action, only for the driver
        ("Play / pause", "space", drive.toggle, True),
        ("One step of 50 ms", "N", lambda: hub.send(visitor, Step()), True),
        ("Reset", "R", lambda: hub.send(visitor, Reset()), True),
        ("Faster", "X", lambda: drive.faster(1), True),
        ("Slower", "Z", lambda: drive.faster(-1), True),
        ("Add a Temi", "T", lambda: disturb.add("temi"), True),
        ("Add a person", "P", lambda: disturb.add("person"), True),
        ("Add a box", "B", lambda: disturb.add("box"), True),
        ("Add a cylinder", "C", lambda: disturb.add("cylinder"), True),
        ("Freeze / go on", "F", disturb.freeze, True),
        ("Delete the selected", "delete", disturb.delete, True),
        ("Place or send nothing", "escape", disturb.cancel, True),
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
        act = lambda preset=preset: stage.cameras.choose(visitor.client, preset)  # noqa: E731
        table.append((f"Camera: {preset}", str(number), act, False))
    table.append(("How to drive", "H", card.show_keys, False))
    card.keys = [(label, _SHOWN.get(key, key)) for label, key, *_ in table if key is not None]
    card.keys[-1:-1] = [_FLY, (PLOTS, PLOTS_KEY)]  # the page's own, and a panel that has its command
    for label, key, act, drives in table:
        guard = hub.driving if drives else hub.watching
        command = visitor.client.gui.add_command(label, hotkey=key)  # type: ignore[arg-type]
        command.on_trigger(guard(lambda *_, act=act: act()))
