"""What if, on one visitor's panel: from when on, start, how far it is, and how both runs ended."""

import html
from collections.abc import Callable

import viser

from motm_twin.bus.messages import TickMessage
from motm_twin.control.tuning import PARAMETERS
from motm_twin.ui import colours
from motm_twin.ui.hub import Hub, Shown, Visitor
from motm_twin.ui.tuning_values import TuningValues
from motm_twin.ui.what_if import RUNS, Outcome, State
from motm_twin.ui.widgets import Changing, Html, buttons

WATCH = "Watch both runs"
APART = "Try in what-if only"
NOW, SHOWN, START = "from now", "from the shown moment", "from the start"
_TEXT = "font-size:12px;line-height:1.45;padding:2px 12px 6px 12px"
_MUTED = "color:#6b7280"
_FORECAST = "color:#b45309;font-size:11px;line-height:1"
_COLOURS: dict[str, str] = dict(zip(RUNS, map(colours.css, colours.OTHERS), strict=True))  # as in the scene


def result(state: State, earlier: str = "") -> str:
    """How a comparison stands, as HTML; ``earlier``: what has begun another run since, branch or reset."""
    if state.phase == "idle":
        text = "Both runs are computed beside the twin, with the same disturbances, and shown in the scene."
        return f'<div style="{_TEXT};{_MUTED}">{text}</div>'
    if state.phase == "failed":
        return f'<div style="{_TEXT};color:#b91c1c">{html.escape(state.text)}</div>'
    rows = [_row("", "as it was", "changed", head=True)]
    before, after = (state.outcomes.get(run) for run in RUNS)
    rows.append(_row("time", *(_time(state, run) for run in RUNS)))
    if before is not None and after is not None:
        rows.append(_row("picked", f"{before.picks}", f"{after.picks}"))
        rows.append(_row("placed", f"{before.places}", f"{after.places}"))
        rows.append(_row("contacts caused", *(f"{one.contacts} of {one.all_contacts}" for one in (before, after))))
        rows.append(_row("driven", f"{before.path_length:.1f} m", f"{after.path_length:.1f} m"))
        rows.append(_row("forecast", *(_forecast(outcome) for outcome in (before, after))))
    table = f'<table style="width:100%;border-collapse:collapse">{"".join(rows)}</table>'
    of_before = f'<div style="color:#b45309">of the run before the {earlier}</div>' if earlier else ""
    return f'<div style="{_TEXT}">{of_before}{table}{_verdict(state, before, after)}</div>'


def _time(state: State, run: str) -> str:
    outcome = state.outcomes.get(run)
    if outcome is not None:
        forecast = "" if outcome.forecast_from_s is None else f'<div style="{_FORECAST}">forecast</div>'
        return f'<b style="font-size:16px">{outcome.time_s:.1f} s</b>{forecast}'
    return f"at {state.reached[run]:.0f} s …" if run in state.reached else "…"


def _forecast(outcome: Outcome) -> str:
    """From when on a run is computed ahead, with searches that no clock cuts."""
    return "no" if outcome.forecast_from_s is None else f"from {outcome.forecast_from_s:.1f} s"


def _row(name: str, *cells: str, head: bool = False) -> str:
    tag = "th" if head else "td"
    dots = [f'<span style="color:{_COLOURS[cell]}">●</span> {cell}' if head else cell for cell in cells]
    found = "".join(f'<{tag} style="text-align:right;font-weight:{500 if head else 400}">{dot}</{tag}>' for dot in dots)
    return f'<tr><{tag} style="text-align:left;{_MUTED};font-weight:400">{name}</{tag}>{found}</tr>'


def _verdict(state: State, before: Outcome | None, after: Outcome | None) -> str:
    if before is None or after is None:
        words = f"the same until {state.start:.1f} s" if state.start > 0.0 else "computed from the start"
        return f'<div style="{_MUTED}">{words}</div>'
    words = []
    if before.success and after.success:
        gain = round(after.time_s, 1) - round(before.time_s, 1)  # of what is shown above
        guess = "" if before.forecast_from_s is after.forecast_from_s is None else " (forecast)"
        word = "as fast" if abs(gain) < 0.05 else f"{abs(gain):.1f} s {'slower' if gain > 0 else 'faster'}"
        words.append(f"changed: {word}{guess}")
    for run, outcome in zip(RUNS, (before, after), strict=True):
        if not outcome.success:
            words.append(f"{run}: {html.escape(outcome.reason)}")
    if after.skipped:
        words.append(f"{len(after.skipped)} disturbances did not fit the changed run")
    return f'<div style="margin-top:3px"><b>{"; ".join(words)}</b></div>'


def begun_since(state: State, newest: TickMessage | None) -> str:
    """What has begun another run since a comparison: "branch", "reset", or "" for nothing."""
    if newest is None or state.run < 0 or newest.run == state.run:
        return ""
    return "branch" if newest.past >= 0 else "reset"


class WhatIfPanel:
    """The widgets of a comparison. ``show`` puts the values of parameters on their widgets."""

    def __init__(
        self, gui: viser.GuiApi, hub: Hub, visitor: Visitor, values: TuningValues, show: Callable[[list[str]], None]
    ) -> None:
        self._hub, self._visitor, self._values, self._show = hub, visitor, values, show
        self._changing = Changing()
        self._shown: Shown | None = None
        with gui.add_folder("What if…"):
            words = "sliders then leave the running twin as it is"
            self._apart = self._changing(gui.add_checkbox(APART, False, hint=words))
            self._apart.on_update(hub.driving(lambda event, _: self._part(bool(event.target.value))))
            self._from: viser.GuiDropdownHandle[str] = self._changing(
                gui.add_dropdown("Changed", (START, NOW, SHOWN), initial_value=START)
            )
            self._go = self._changing(gui.add_button("Compare", icon=viser.Icon.ARROWS_SPLIT))
            self._result = Html(gui)
            watch = hub.driving(lambda *_: hub.what_if.watch())
            self._watch = self._changing(buttons(gui, (WATCH,), watch, hint="in the scene, from where they part"))
            self._watch.visible = False
        self._go.on_click(hub.driving(lambda *_: self._press()))

    def enable(self, driving: bool) -> None:
        """Grey while somebody else drives."""
        self._changing.enable(driving)

    def update(self, shown: Shown) -> None:
        """Show this."""
        self._shown = shown
        state = self._hub.what_if.state
        self._go.label = "Stop" if state.busy else "Compare" if state.phase == "idle" else "Clear the comparison"
        self._result.set(result(state, begun_since(state, shown.newest)))
        watched = self._hub.what_if.watched
        self._watch.visible = state.phase in ("running", "done")
        self._watch.options = (WATCH if watched is None else f"Both runs at {watched:.0f} s",)

    def _part(self, apart: bool) -> None:
        self._values.part(apart)
        if not apart and self._shown is not None and self._shown.status is not None:
            self._show(self._values.follow(self._shown.status.parameters))

    def _press(self) -> None:
        what_if, shown, values = self._hub.what_if, self._shown, self._values
        if what_if.state.phase != "idle":
            what_if.stop()
            return
        if shown is None or shown.newest is None or shown.tick is None:
            return
        start = {START: 0, NOW: shown.newest.index + 1, SHOWN: shown.tick.index}[self._from.value]
        compared = values.compared()
        if not compared:
            words = (
                f"nothing is changed, both runs would be the same: move one of the {len(PARAMETERS)} parameters first"
            )
            self._hub.tell(self._visitor, words, "Nothing to compare")
            return
        if self._from.value == NOW and not values.differs():
            words = (
                "the running twin has these values already, so from now on both runs would be the same: "
                f"compare {START}, or tick {APART}, and then move one"
            )
            self._hub.tell(self._visitor, words, "Nothing to compare")
            return
        what_if.start(self._visitor.name, compared, start, shown.newest.run)
