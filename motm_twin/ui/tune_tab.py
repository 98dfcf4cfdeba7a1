"""Tuning: every parameter that matters, with the paper's value marked, and what would have been with others."""

import viser

from motm_twin.control.tuning import GROUPS, PARAMETERS, PRESETS, Parameter, parameter
from motm_twin.ui.hub import Hub, Shown, Visitor
from motm_twin.ui.tuning_values import TuningValues, hint, marks, title
from motm_twin.ui.what_if_panel import WhatIfPanel
from motm_twin.ui.widgets import Changing, Html, buttons, follow

_TEXT = "font-size:13px;line-height:1.4;padding:2px 12px 6px 12px"
OWN = "(own)"


def summary(values: TuningValues, *, live: bool = True) -> str:
    """How many parameters are changed, and on what they act, as HTML; ``live``: no earlier moment is shown."""
    count = len(values.changed())
    text = f"<b>{count}</b> of {len(PARAMETERS)} changed" if count else "All as shipped"
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
        self._changing(buttons(gui, ("Reset everything",), reset, hint="back to how it was shipped"))
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
        if shown.status is not None:
            for command in self._values.due():
                self._hub.send(self._visitor, command)
            self._show(self._values.follow(shown.status.parameters))
        self._summary.set(summary(self._values, live=shown.live))
        changed = self._values.changed()
        follow(self._preset, next((name for name, values in PRESETS.items() if _same(values, changed)), OWN))
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
            self._changing(buttons(self._gui, ("Reset these",), reset, hint="back to how they were shipped"))

    def _widget(self, entry: Parameter) -> viser.GuiInputHandle:
        label, words = title(entry, False), hint(entry)
        if entry.kind == "switch":
            return self._gui.add_checkbox(label, bool(entry.default), hint=words)
        if entry.kind == "choice":
            return self._gui.add_dropdown(label, entry.choices, initial_value=str(entry.default), hint=words)
        return self._gui.add_slider(
            label, entry.low, entry.high, entry.step, float(entry.default), marks=marks(entry), hint=words
        )

    def _move(self, entry: Parameter, value: object) -> None:
        if isinstance(value, bool | str | int | float):
            self._values.move(entry.name, float(value) if entry.kind == "number" else value)
            self._relabel(entry.name)

    def _reset(self, names: list[str]) -> None:
        self._values.reset(names)
        self._show(names)

    def _use(self, preset: str) -> None:
        if preset in PRESETS:
            names = [entry.name for entry in PARAMETERS]
            self._values.reset(names, PRESETS[preset])
            self._show(names)

    def _show(self, names: list[str]) -> None:
        for name in names:
            self._widgets[name].value = self._values.wanted[name]
            self._relabel(name)

    def _relabel(self, name: str) -> None:
        entry = parameter(name)
        self._widgets[name].label = title(entry, self._values.wanted[name] != entry.default)


def _same(preset: dict, changed: dict) -> bool:
    return {name: value for name, value in preset.items() if value != parameter(name).default} == changed
