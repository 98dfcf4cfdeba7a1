"""Why the robot does what it does: now, the task in hand, a place that was clicked, the arm, events, timing, score."""

import viser

from motm_twin.bus.messages import TickMessage
from motm_twin.ui.candidate_card import NEXT_WEIGHT, candidate_card
from motm_twin.ui.hub import Hub, Shown, Visitor
from motm_twin.ui.plots_panel import PlotsPanel
from motm_twin.ui.score_card import score_card
from motm_twin.ui.timing_card import WINDOW, timing_card
from motm_twin.ui.why_cards import EVENTS, arm_card, events_card, now_card, task_card
from motm_twin.ui.widgets import Html

FAST, SLOW = 2, 10  # updates (of 0.1 s) between refreshes: of what is read as it happens, and of statistics


class WhyTab:
    """Explains the shown period."""

    def __init__(self, gui: viser.GuiApi, hub: Hub, visitor: Visitor) -> None:
        self._hub = hub
        self._count = 0
        self._now = Html(gui)
        self._plots = PlotsPanel(gui, hub)
        self._task, self._candidate, self._arm = (Html(gui) for _ in range(3))
        self._events = Html(gui)
        with gui.add_folder("Timing"):
            self._timing = Html(gui)
        with gui.add_folder("Score"):
            self._score = Html(gui)
        self._tick: TickMessage | None = None
        self._picked: int | None = None

    def update(self, shown: Shown) -> None:
        """Show this period."""
        tick = shown.tick
        if tick is None:
            return
        self._count += 1
        view, parameters = shown.view, {} if shown.status is None else shown.status.parameters
        if self._count % FAST == 0 and (tick is not self._tick or view.picked != self._picked):
            self._tick, self._picked = tick, view.picked
            self._now.set(now_card(tick, shown.scene, shown.status))
            self._task.set(task_card(tick))
            weight = float(parameters.get(NEXT_WEIGHT, 1.05))
            self._candidate.set(candidate_card(tick.placement, view.picked, weight))
            self._arm.set(arm_card(tick, parameters, shown.scene))
        history = self._hub.history
        if history is None:
            return
        index = None if shown.live else tick.index
        if self._count % SLOW == 0:
            self._timing.set(timing_card(history.samples(index, WINDOW)))
            self._score.set(score_card(tick, shown.status, shown.scene))
        elif self._count % SLOW == SLOW // 2:
            self._events.set(events_card(tick, history.events(index, EVENTS)))
        self._plots.update(shown)

    def enable(self, driving: bool) -> None:
        """Nothing here changes the twin."""
