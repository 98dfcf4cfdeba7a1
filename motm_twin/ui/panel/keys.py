"""Keys for everything important, also without the mouse, and the cards that explain them.

Viser's palette lists the commands (the icon on top). A small card is for somebody who is here for the first time.
"""

from collections.abc import Callable
from functools import partial

import viser

from motm_twin.bus.commands import Reset, Step
from motm_twin.ui.hub import Hub, Visitor
from motm_twin.ui.panel.disturb_tab import DisturbTab
from motm_twin.ui.panel.drive_tab import DriveTab
from motm_twin.ui.panel.plots import PLOTS, PLOTS_KEY
from motm_twin.ui.panel.replay_tab import ReplayTab
from motm_twin.ui.scene.cameras import PRESETS
from motm_twin.ui.scene.scene_view import SceneView

# No arrow keys: they belong to the slider or list that has the focus. None of W A S D Q E: they fly Viser's camera.
_FLY = ("Fly the camera", "W A S D Q E")
_SHOWN = {"delete": "Del", "escape": "Esc"}
WIDTH = 330  # [px] of the small card
SHORT = """<div style="font-size:13.5px;line-height:1.5;padding:4px 12px 8px 12px;display:grid;
grid-template-columns:58px 1fr;gap:3px 8px">
<b style="color:#256396">Look</b><span>drag to turn, right-drag to move, wheel to zoom</span>
<b style="color:#256396">Disturb</b><span>grab a Temi, a cube or a table and drag it</span>
<b style="color:#256396">Ask</b><span>click a coloured dot, then open <b>Why</b></span>
</div>"""


def add_commands(
    scene: SceneView, drive: DriveTab, disturb: DisturbTab, replay: ReplayTab, help_card: "HelpCard"
) -> None:
    """Give the visitor of these tabs the keys and the palette."""
    hub, visitor = drive.hub, drive.visitor
    table: list[tuple[str, str | None, Callable, bool]] = [  # label, key, action, only for the driver
        ("Play / pause", "space", drive.toggle, True),
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
        table.append((f"Camera: {preset}", str(number), partial(scene.cameras.choose, visitor.client, preset), False))
    table.append(("How to drive", "H", help_card.show_keys, False))
    help_card.keys = [(label, _SHOWN.get(key, key)) for label, key, *_ in table if key is not None]
    help_card.keys[-1:-1] = [_FLY, (PLOTS, PLOTS_KEY)]  # the page's own, and a panel that has its command
    for label, key, act, drives in table:
        guard = hub.driving if drives else hub.watching
        command = visitor.client.gui.add_command(label, hotkey=key)  # type: ignore[arg-type]
        command.on_trigger(guard(lambda *_, act=act: act()))


class HelpCard:
    """The small card of one visitor, and the window with all keys."""

    def __init__(self, hub: Hub, visitor: Visitor) -> None:
        self._hub, self._visitor = hub, visitor
        self._panel: viser.PanelHandle | None = None
        self._window: viser.GuiModalHandle | None = None
        self.read = False
        self.keys: list[tuple[str, str]] = []  # action and its key

    def open(self) -> None:
        """Show the small card, in the corner of the scene where the robot is not."""
        if self._panel is not None:
            return
        gui = self._visitor.client.gui
        self._panel = panel = gui.add_panel()
        with panel.add_tab("How to drive", viser.Icon.INFO_CIRCLE):
            gui.add_html(SHORT)
            gui.add_button("Got it", icon=viser.Icon.CHECK).on_click(self._hub.watching(lambda *_: self.close()))
        panel.float(x=16, y=-16, width=WIDTH)

    def close(self) -> None:
        """Put it away."""
        self.read = True
        panel, self._panel = self._panel, None
        if panel is not None:
            panel.remove()

    def show_keys(self) -> None:
        """Everything that can be done, with its keys, as a window over the page; once more puts it away."""
        self.close()
        if self._hide_keys():
            return
        gui = self._visitor.client.gui
        with gui.add_modal("How to drive") as self._window:
            gui.add_html(SHORT)
            gui.add_html(_table(self.keys))
            gui.add_button("Close", hint="H or Esc").on_click(self._hub.watching(lambda *_: self._hide_keys()))

    def _hide_keys(self) -> bool:
        """Close the window; False when there is none."""
        window, self._window = self._window, None
        if window is not None:
            window.close()
        return window is not None


def _table(keys: list[tuple[str, str]]) -> str:
    cells = "".join(
        f'<div style="white-space:nowrap"><kbd style="display:inline-block;min-width:22px;text-align:center;'
        f'border:1px solid #d1d5db;border-radius:4px;padding:0 5px;font-size:12px;background:#f9fafb">{key}</kbd>'
        f'<span style="margin-left:8px">{label}</span></div>'
        for label, key in keys
    )
    return (
        '<div style="font-size:13px;line-height:1.7;padding:6px 12px 10px 12px;border-top:1px solid #e5e7eb;'
        'display:grid;grid-template-columns:1fr 1fr;gap:2px 16px">' + cells + "</div>"
    )
