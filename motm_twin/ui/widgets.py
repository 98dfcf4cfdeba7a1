"""Small helpers for panels: HTML that is sent on change only, widgets that turn grey, rows of buttons, their style."""

import time
from collections.abc import Callable, Sequence
from typing import Any

import viser

HOLD = 1.2  # [s] a widget that a person has just moved is not set from outside


class Html:
    """A piece of HTML that is sent only when it changes."""

    def __init__(self, gui: viser.GuiApi, content: str = "") -> None:
        self._handle, self._shown = gui.add_html(content), content

    def set(self, content: str) -> None:
        """Show this; texts from outside must be escaped already."""
        if content != self._shown:
            self._shown = content
            self._handle.content = content

    def show(self, visible: bool) -> None:
        """Show or hide it."""
        self._handle.visible = visible


class Changing:
    """Widgets that change something: usable for the driver, grey for everybody else."""

    def __init__(self) -> None:
        self._widgets: list[Any] = []
        self.on = True

    def __call__(self, widget: Any) -> Any:
        """Take a widget in; gives it back."""
        self._widgets.append(widget)
        set_disabled(widget, not self.on)
        return widget

    def enable(self, on: bool) -> None:
        """Make all usable, or grey."""
        self.on = on
        for widget in self._widgets:
            set_disabled(widget, not on)


def follow(widget: Any, value: Any) -> None:
    """Set a widget from outside, unless a person has just changed it: what they chose may still be on its way here.

    Viser sets the new value first and calls back then. Set from another thread in between, the choice would be lost.
    """
    if widget.value != value and time.time() - widget.update_timestamp > HOLD:
        widget.value = value
        widget._impl.update_timestamp = 0.0  # nobody has changed it by hand


def set_disabled(widget: Any, disabled: bool) -> None:
    """Make a widget grey, or usable again.

    A row of buttons can be made grey, and its page shows it so, but Viser's handle refuses to change that later: the
    change is sent as Viser sends those of other widgets.
    """
    if not isinstance(widget, viser.GuiButtonGroupHandle):
        widget.disabled = disabled
        return
    props: Any = widget._impl.props
    if props.disabled != disabled and not widget._impl.removed:
        props.disabled = disabled
        widget._queue_update("disabled", disabled)


def set_marks(slider: Any, marks: Sequence[tuple[float, str]]) -> None:
    """Give a slider other marks, sent as Viser sends what it lets change: its handle does not offer them."""
    slider._marks = tuple({"value": value, "label": label} for value, label in marks)


def buttons(gui: viser.GuiApi, options: Sequence[str], act: Callable, *, label: str = "", hint: str | None = None):
    """A row of small buttons over the whole width (without a label); ``act`` is the callback."""
    row = gui.add_button_group(label, tuple(options), hint=hint)
    row.on_click(act)
    return row


# Viser puts a column for labels before every row: rows of buttons without a label take its place, tasks have a wide
# one, sliders stand below their label (which no hint covers) with their marks within the panel, folders have a whole
# row that says what a click does, and five tabs have room side by side, left of the bar that scrolls the panel.
# What the twin is doing stays in sight however far the panel is scrolled. All widgets work without these rules too.
STYLE = """<style>
div:has(> .motm-top) {position: sticky; top: 0; z-index: 5; background: var(--mantine-color-body, white)}
div:has(> div > div > div > .motm-top) {overflow: visible !important}
.mantine-Flex-root:has(> div > p > label:empty) > div:first-child {display: none}
div:has(> div > .motm-wide) > div > .mantine-Flex-root:has(> div > p > label) > div:first-child,
div:has(> div > .motm-wide) > .mantine-Flex-root:has(> div > p > label) > div:first-child {width: 58% !important}
div:has(> div > .motm-wide) label {color: #1f2937; letter-spacing: -0.3px}
div:has(> div > .motm-stacked) .mantine-Flex-root:has(> div > p > label):not(:has(input[type=checkbox])) {
 flex-direction: column; align-items: stretch !important}
div:has(> div > .motm-stacked) .mantine-Flex-root:has(> div > p > label) > div:first-child {width: 100% !important}
div:has(> div > .motm-stacked) .mantine-Flex-root:has(input[type=checkbox]) > div:first-child {width: 86% !important}
div:has(> div > .motm-stacked) label {color: #374151; letter-spacing: -0.3px}
.mantine-Slider-root {margin-left: 12px !important; margin-right: 4px !important}
div:has(> div > .motm-stacked) .mantine-Flex-root:has(> div > p > label) > div:last-child >
 div:has(.mantine-Slider-root) {padding-top: 22px; margin-top: -22px}
.mantine-Paper-root:has(> .mantine-Paper-root > svg.tabler-icon-chevron-down) {padding-bottom: 0 !important}
.mantine-Paper-root:has(> .mantine-Paper-root > svg[class*=tabler-icon-chevron]) {margin: 5px 10px !important}
.mantine-Paper-root:has(> svg[class*=tabler-icon-chevron]) {
 position: static; transform: none; display: flex; align-items: center; padding: 3px 10px; font-weight: 600;
 background: #eef2f7; cursor: pointer; border-radius: 3px}
.mantine-Paper-root:has(> svg[class*=tabler-icon-chevron]):hover {background: #dbe6f3}
.mantine-Paper-root > svg[class*=tabler-icon-chevron] {
 order: 2; margin-left: 5px; width: 1.1em; height: 1.1em; top: 0; opacity: 0.9; color: #256396}
.mantine-Paper-root:has(> svg.tabler-icon-chevron-down)::after {content: "open"; margin-left: auto; font-weight: 400;
 color: #256396}
.mantine-Paper-root:has(> svg.tabler-icon-chevron-up)::after {content: "close"; margin-left: auto; font-weight: 400;
 color: #256396}
.mantine-Paper-root:has(> .mantine-Paper-root > svg.tabler-icon-chevron-down) > :nth-child(3) {display: none}
[data-dock-strip]:has(> [data-dock-tab]:nth-child(5)) {flex-wrap: nowrap !important; justify-content: space-between;
 padding: 0 10px 0 2px !important}
[data-dock-strip]:has(> [data-dock-tab]:nth-child(5)) > [data-dock-tab] {padding: 0 0.3em !important; flex: 1 1 auto;
 justify-content: center; letter-spacing: -0.3px}
[data-dock-strip]:has(> [data-dock-tab]:nth-child(5)) > [data-dock-tab] > * {margin-right: 0.2em !important}
</style>"""
