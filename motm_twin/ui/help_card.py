"""How to drive: a small card for somebody who is here for the first time, and the long one with all keys."""

import viser

from motm_twin.ui.hub import Hub, Visitor

WIDTH, HEIGHT = 330, 190  # [px] of the small card
SHORT = """<div style="font-size:13.5px;line-height:1.5;padding:4px 12px 8px 12px;display:grid;
grid-template-columns:58px 1fr;gap:3px 8px">
<b style="color:#256396">Look</b><span>drag to turn, right-drag to move, wheel to zoom</span>
<b style="color:#256396">Disturb</b><span>grab a Temi, a cube or a table and drag it</span>
<b style="color:#256396">Ask</b><span>click a coloured dot, then open <b>Why</b></span>
</div>"""


class HelpCard:
    """The cards of one visitor."""

    def __init__(self, hub: Hub, visitor: Visitor) -> None:
        self._hub, self._visitor = hub, visitor
        self._panel: viser.PanelHandle | None = None
        self._window: viser.GuiModalHandle | None = None
        self.read = False
        self.keys: list[tuple[str, str]] = []  # what can be done, and its key

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
        if self._window is not None:
            self._hide_keys()
            return
        gui = self._visitor.client.gui
        with gui.add_modal("How to drive") as self._window:
            gui.add_html(SHORT)
            gui.add_html(_table(self.keys))
            gui.add_button("Close", hint="H or Esc").on_click(self._hub.watching(lambda *_: self._hide_keys()))

    def _hide_keys(self) -> None:
        window, self._window = self._window, None
        if window is not None:
            window.close()


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
