"""The plots in a panel of their own at the left, one per visitor, opened by a button or the key G."""

import threading

import viser

from motm_twin.bus.messages import TickMessage
from motm_twin.ui.hub import Hub, Shown, Visitor
from motm_twin.ui.plots import WINDOW, plots_html
from motm_twin.ui.widgets import Html

EVERY = 5  # updates (of 0.1 s) between pictures
PANEL_WIDTH = 300  # [px]
PLOTS, PLOTS_KEY = "Plots of the last minute", "G"


class PlotsPanel:
    """Closed at the start; costs nothing while closed."""

    def __init__(self, gui: viser.GuiApi, hub: Hub) -> None:
        self._gui, self._hub = gui, hub
        self._panel: viser.PanelHandle | None = None
        self._piece: Html | None = None
        self._lock = threading.Lock()  # the panel is opened and closed in another thread than it is drawn in
        self._count = 0
        self._drawn: TickMessage | None = None
        self._button = gui.add_button(
            "Plots", icon=viser.Icon.CHART_LINE, hint=f"curves of the last minute; key {PLOTS_KEY}"
        )
        self._button.on_click(hub.watching(self._toggle))
        gui.add_command(PLOTS, hotkey=PLOTS_KEY).on_trigger(hub.watching(self._toggle))

    @property
    def open(self) -> bool:
        """Whether the visitor sees the plots."""
        return self._panel is not None

    def update(self, shown: Shown) -> None:
        """Draw the last minute up to the shown period."""
        piece, history, tick = self._piece, self._hub.history, shown.tick
        self._count += 1
        if piece is None or history is None or tick is None or shown.scene is None:
            return
        if tick is self._drawn or self._count % EVERY:
            return
        self._drawn = tick
        samples = history.samples(None if shown.live else tick.index, WINDOW)
        parameters = {} if shown.status is None else shown.status.parameters
        page = plots_html(samples, shown.scene.robot.base, parameters)
        with self._lock:
            if self._piece is piece:  # not closed meanwhile
                piece.set(page)

    def _toggle(self, _event: object, _visitor: Visitor) -> None:
        panel = self._panel
        if panel is not None:
            with self._lock:
                self._panel = self._piece = None
                panel.remove()
        else:
            panel = self._gui.add_panel()
            with panel.add_tab("Plots", viser.Icon.CHART_LINE):
                self._piece = Html(self._gui, "&nbsp;")
            panel.dock_left()
            panel.set_width(PANEL_WIDTH)
            self._panel, self._drawn = panel, None
        self._button.label = "Close plots" if self.open else "Plots"
