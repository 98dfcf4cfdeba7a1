"""Why the robot does what it does: the picked candidate, and what the period decided."""

import viser

from motm_twin.ui import cards
from motm_twin.ui.hub import Hub, Shown, Visitor


class WhyTab:
    """Explains the shown period."""

    def __init__(self, gui: viser.GuiApi, hub: Hub, visitor: Visitor) -> None:
        self._candidate = gui.add_html(cards.legend())
        self._text = ""

    def update(self, shown: Shown) -> None:
        """Show this period."""
        if shown.tick is None:
            return
        text = cards.candidate_card(shown.tick.placement, shown.view.picked)
        if text != self._text:
            self._text = text
            self._candidate.content = text

    def enable(self, driving: bool) -> None:
        """Nothing here changes the twin."""
