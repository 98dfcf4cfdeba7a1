"""One visitor's panel: the state on top, and tabs to drive, disturb, understand, tune and look back."""

from typing import Protocol

import viser

from motm_twin.ui import cards, colours
from motm_twin.ui.drive_tab import DriveTab
from motm_twin.ui.hub import Hub, Shown, Visitor
from motm_twin.ui.stage import Stage
from motm_twin.ui.why_tab import WhyTab

WIDTH = 330  # [px]


class Tab(Protocol):
    """One tab of a desk."""

    def update(self, shown: Shown) -> None:
        """Show this; called about ten times a second, from one thread."""
        ...

    def enable(self, driving: bool) -> None:
        """Make the widgets that change something usable, or grey."""
        ...


class Html:
    """A piece of HTML that is sent only when it changes."""

    def __init__(self, gui: viser.GuiApi, content: str = "") -> None:
        self._handle, self._shown = gui.add_html(content), content

    def set(self, content: str) -> None:
        """Show this; texts from outside must be escaped already."""
        if content != self._shown:
            self._shown = content
            self._handle.content = content


class Desk:
    """The widgets of one visitor."""

    def __init__(self, hub: Hub, visitor: Visitor, stage: Stage) -> None:
        self.visitor, self._hub = visitor, hub
        gui = visitor.client.gui
        gui.configure_theme(show_logo=False, show_share_button=False, brand_color=colours.BRAND)
        gui.set_panel_label("motm-twin")
        gui.main_panel.dock_right()
        gui.main_panel.set_width(WIDTH)
        self._status = Html(gui, cards.status_card("waiting", None, "connecting"))
        tabs = gui.add_tab_group()
        self._tabs: list[Tab] = []
        with tabs.add_tab("Drive"):
            self._tabs.append(DriveTab(gui, hub, visitor, stage))
        with tabs.add_tab("Why"):
            self._tabs.append(WhyTab(gui, hub, visitor))
        self._driving: bool | None = None

    def update(self, shown: Shown) -> None:
        """Show this."""
        note = shown.status.text if shown.status is not None else f"no twin server at {self._hub.client.endpoint} yet"
        if shown.state == "lost":
            note = "the twin server is silent; this page reconnects by itself"
        self._status.set(cards.status_card(shown.state, shown.status, note))
        driving = self._hub.drives(self.visitor)
        if driving != self._driving:
            self._driving = driving
            for tab in self._tabs:
                tab.enable(driving)
        for tab in self._tabs:
            tab.update(shown)
