"""Tuning: every parameter that matters, with the paper's value marked, and what would have been with others."""

import html

import viser

from motm_twin.bus.messages import StatusMessage
from motm_twin.control.tuning import GROUPS, PARAMETERS, PRESETS, Parameter, parameter
from motm_twin.ui.hub import Hub, Shown, Visitor
from motm_twin.ui.tuning_values import TuningValues, hint, marks, shipped_with, title
from motm_twin.ui.what_if_panel import WhatIfPanel
from motm_twin.ui.widgets import Changing, Html, buttons, follow, set_marks
from motm_twin.ui.words import method_title

_BACK = "back to how the method that drives was shipped"
_TEXT = "font-size:13px;line-height:1.4;padding:2px 12px 6px 12px"
OWN = "(own)"


def summary(values: TuningValues, method: str = "", *, live: bool = True) -> str:
    """How many parameters are changed, and on what they act, as HTML; ``live``: no earlier moment is shown.

    ``method``: title of the one that drives.
    """
    count = len(values.changed())
    of = f" with {html.escape(method)}" if method else ""
    text = f"<b>{count}</b> of {len(PARAMETERS)} changed" if count else f"All as shipped{of}"
    where = "acts at once" if live else "looking back: acts on the running twin, not on what is shown"
    where = "for the comparison only" if values.apart else where
    return f'<div style="{_TEXT}">{text} <span style="color:#6b7280">&middot; {where}</span></div>'


class TuneTab:
    """Sliders, switches and choices of one visitor."""

    def __init__(self, gui: viser.GuiApi, hub: Hub, visitor: Visitor) -> None:
        self._gui, self._hub, self._visitor = gui, hub, visitor
        self._changing = Changing()
        self._values = TuningValues()
        self._widgets: dict[str, viser.GuiInputHandle] = {}
        self._summary = Html(gui)
        self._preset: viser.GuiDropdownHandle[str] = self._changing(
            gui.add_dropdown("Preset", (*PRESETS, OWN), hint="sets everything at once")
        )
        everything = [entry.name for entry in PARAMETERS]
        reset = hub.driving(lambda *_: self._reset(everything))
        self._changing(buttons(gui, ("Reset everything",), reset, hint=_BACK))
        self._preset.on_update(hub.driving(lambda event, _: self._use(event.target.value)))
        self._what_if = WhatIfPanel(gui, hub, visitor, self._values, self._show)
        for number, group in enumerate(GROUPS):
            entries = [entry for entry in PARAMETERS if entry.group == group]
            if entries:
                self._group(group, entries, opened=number == 0)

    def enable(self, driving: bool) -> None:
        """Grey while somebody else drives."""
        self._changing.enable(driving)
        self._what_if.enable(driving)

    def update(self, shown: Shown) -> None:
        """Send what was moved, and follow what the twin has."""
        method = ""
        if shown.status is not None:
            method = method_title(shown.status, shown.status.method)
            self._ship(shown.status)
            for command in self._values.due():
                self._hub.send(self._visitor, command)
            self._show(self._values.follow(shown.status.parameters))
        self._summary.set(summary(self._values, method, live=shown.live))
        follow(self._preset, next((name for name in PRESETS if self._values.preset(name) == self._values.wanted), OWN))
        self._what_if.update(shown)

    def _group(self, group: str, entries: list[Parameter], *, opened: bool) -> None:
        names = [entry.name for entry in entries]
        with self._gui.add_folder(group, expand_by_default=opened):
            self._gui.add_html('<div class="motm-stacked"></div>')
            for entry in entries:
                widget = self._changing(self._widget(entry))
                widget.on_update(self._hub.driving(lambda event, _, entry=entry: self._move(entry, event.target.value)))
                self._widgets[entry.name] = widget
            reset = self._hub.driving(lambda *_: self._reset(names))
            self._changing(buttons(self._gui, ("Reset these",), reset, hint=_BACK))

    def _widget(self, entry: Parameter) -> viser.GuiInputHandle:
        label, words = title(entry, False), hint(entry, entry.default)
        if entry.kind == "switch":
            return self._gui.add_checkbox(label, bool(entry.default), hint=words)
        if entry.kind == "choice":
            return self._gui.add_dropdown(label, entry.choices, initial_value=str(entry.default), hint=words)
        return self._gui.add_slider(
            label,
            entry.low,
            entry.high,
            entry.step,
            float(entry.default),
            hint=words,
            marks=marks(entry, entry.default),
        )

    def _move(self, entry: Parameter, value: object) -> None:
        if isinstance(value, bool | str | int | float):
            self._values.move(entry.name, float(value) if entry.kind == "number" else value)
            self._relabel(entry.name)

    def _ship(self, status: StatusMessage) -> None:
        """As shipped means the method that drives."""
        names = self._values.ship(shipped_with(status))
        for name in names:
            entry, shipped = parameter(name), self._values.shipped[name]
            self._widgets[name].hint = hint(entry, shipped)
            if entry.kind == "number":
                set_marks(self._widgets[name], marks(entry, shipped))
        self._show(names)

    def _reset(self, names: list[str]) -> None:
        self._values.reset(names)
        self._show(names)

    def _use(self, preset: str) -> None:
        if preset in PRESETS:
            names = [entry.name for entry in PARAMETERS]
            self._values.reset(names, self._values.preset(preset))
            self._show(names)

    def _show(self, names: list[str]) -> None:
        for name in names:
            self._widgets[name].value = self._values.wanted[name]
            self._relabel(name)

    def _relabel(self, name: str) -> None:
        values = self._values
        self._widgets[name].label = title(parameter(name), values.wanted[name] != values.shipped[name])
