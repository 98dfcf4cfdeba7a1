"""One visitor's panel: the state and what the robot does on top, tabs to drive, disturb, explain, tune, look back."""

from typing import Protocol

import viser

from motm_twin.ui import cards, colours, markup
from motm_twin.ui.disturb_tab import DisturbTab
from motm_twin.ui.drive_tab import DriveTab
from motm_twin.ui.help_card import HelpCard
from motm_twin.ui.hub import Hub, Shown, Visitor
from motm_twin.ui.palette import add_commands
from motm_twin.ui.replay_tab import ReplayTab
from motm_twin.ui.stage import Stage
from motm_twin.ui.tune_tab import TuneTab
from motm_twin.ui.wheel import Wheel
from motm_twin.ui.why_cards import headline
from motm_twin.ui.why_tab import WhyTab
from motm_twin.ui.widgets import STYLE, Html, buttons

WIDTH = 330  # [px]
TOP = '<i class="motm-top"></i>'  # what it stands in stays in sight when the panel is scrolled
CROSSHAIR = "<style>canvas, div:has(> canvas) {cursor: crosshair !important}</style>"  # the floor is clicked next


class Tab(Protocol):
    """One tab of a desk."""

    def update(self, shown: Shown) -> None:
        """Show this; called about ten times a second, from one thread."""
        ...

    def enable(self, driving: bool) -> None:
        """Make the widgets that change something usable, or grey."""
        ...


class Desk:
    """The widgets of one visitor; a ``new`` one is told how to drive."""

    def __init__(self, hub: Hub, visitor: Visitor, stage: Stage, *, new: bool = True) -> None:
        self.visitor, self._hub = visitor, hub
        gui = visitor.client.gui
        gui.configure_theme(show_logo=False, show_share_button=False, brand_color=colours.BRAND)
        gui.set_panel_label("motm-twin")
        gui.main_panel.dock_right()
        gui.main_panel.set_width(WIDTH)
        gui.add_html(STYLE + markup.STYLE)
        self._status = Html(gui, cards.status_card("waiting", None, "connecting"))
        self._wheel = Wheel(gui, hub, visitor)
        self._headline = Html(gui)
        tabs, icon = gui.add_tab_group(), viser.Icon
        self._help = HelpCard(hub, visitor)
        with tabs.add_tab("Drive", icon.STEERING_WHEEL):
            drive = DriveTab(gui, hub, visitor, stage)
            buttons(gui, ("?  How to drive",), hub.watching(lambda *_: self._help.show_keys()), hint="H: all keys")
        with tabs.add_tab("Disturb", icon.HAND_FINGER):
            disturb = DisturbTab(gui, hub, visitor)
        with tabs.add_tab("Why", icon.BULB):
            why = WhyTab(gui, hub, visitor)
        with tabs.add_tab("Tune", icon.ADJUSTMENTS):
            tune = TuneTab(gui, hub, visitor)
        with tabs.add_tab("Replay", icon.HISTORY):
            replay = ReplayTab(gui, hub, visitor)
        self._tabs: list[Tab] = [drive, disturb, why, tune, replay]
        add_commands(hub, visitor, stage, drive, disturb, replay, self._help)
        if new:
            self._help.open()
        self._driving: bool | None = None

    @property
    def knows_how(self) -> bool:
        """Whether this visitor has read how to drive."""
        return self._help.read

    def update(self, shown: Shown) -> None:
        """Show this."""
        note = shown.status.text if shown.status is not None else f"no twin server at {self._hub.client.endpoint} yet"
        if not note and shown.status is not None and shown.status.plant in ("zenoh", "mirror"):
            note = shown.status.plant_text  # what the robot in another program does, and what it refuses
        if shown.state == "done" and shown.newest is not None and shown.newest.success:
            note = ""  # the headline of the tab says so
        if shown.state == "lost":
            note = "the twin server is silent; this page reconnects by itself"
        looked_at = None if shown.live or shown.tick is None else shown.tick.time
        driving = self._hub.drives(self.visitor)
        aiming = driving and bool(shown.view.placing or shown.view.sending)
        card = cards.status_card(shown.state, shown.status, note, looked_at=looked_at)
        self._status.set(TOP + card + (CROSSHAIR if aiming else ""))
        self._wheel.update(shown)
        self._headline.set("" if shown.tick is None else headline(shown.tick, shown.scene))
        if driving != self._driving:
            self._driving = driving
            self._wheel.enable(driving)
            for tab in self._tabs:
                tab.enable(driving)
        for tab in self._tabs:
            tab.update(shown)
