"""Building blocks of panels: blocks of widgets that can be disabled, pieces of HTML, and the style of both.

Texts from outside go through `text`, which escapes them.
"""

import html
import time
from collections.abc import Callable, Sequence
from typing import Any

import viser

from motm_twin.bus.commands import Command
from motm_twin.ui.hub import Hub, Shown, Visitor
from motm_twin.ui.page_server import link

HOLD = 1.2  # [s] for which a widget that a person has moved is not set from outside
# Colours are those of web_assets/page/overlay.css, which has them for light and dark pages.
MUTED = "var(--motm-mute)"
GREEN, AMBER, RED, BLUE = "var(--motm-green)", "var(--motm-amber)", "var(--motm-red)", "var(--motm-blue)"


class Block:
    """Widgets of one visitor; those that change something are enabled for the driver only."""

    def __init__(self, gui: viser.GuiApi, hub: Hub, visitor: Visitor) -> None:
        self.gui, self.hub, self.visitor = gui, hub, visitor
        self.shown: Shown | None = None
        self.usable = True
        self.parts: list[Block] = []
        self._driven: list[Any] = []

    def update(self, shown: Shown) -> None:
        """Show an update of the page; called about ten times a second, from one thread."""
        self.shown = shown
        self._refresh(shown)
        for part in self.parts:
            part.update(shown)

    def _refresh(self, shown: Shown) -> None:
        """Bring the widgets up to date."""

    def enable(self, driving: bool) -> None:
        """Make the widgets that change something usable, or grey."""
        self.usable = driving
        for widget in self._driven:
            set_disabled(widget, not driving)
        for part in self.parts:
            part.enable(driving)

    def send(self, command: Command) -> None:
        """Send a command for this visitor."""
        self.hub.send(self.visitor, command)

    def tell(self, text: str, title: str = "", colour: str = "orange") -> None:
        """A note for this visitor."""
        self.hub.tell(self.visitor, text, title, colour)

    def driven(self, widget: Any, act: Callable[[Any], object] | None = None) -> Any:
        """Register a widget that only the driver may use; ``act`` is called with each value that a person chooses."""
        if act is not None:
            widget.on_update(self.hub.driving(lambda event, _: act(event.target.value)))
        self._driven.append(widget)
        set_disabled(widget, not self.usable)
        return widget

    def choice(
        self, label: str, options: Sequence[str], act: Callable[[str], object] | None = None, **more: Any
    ) -> viser.GuiDropdownHandle[str]:
        """A dropdown list for the driver; ``act`` gets the chosen option."""
        return self.driven(self.gui.add_dropdown(label, tuple(options), **more), act)

    def button(self, label: str, act: Callable[[], object], *, anybody: bool = False, **options: Any) -> Any:
        """A button over the whole width, for the driver or for anybody."""
        button = self.gui.add_button(label, **options)
        button.on_click((self.hub.watching if anybody else self.hub.driving)(lambda *_: act()))
        return button if anybody else self.driven(button)

    def row(
        self, options: Sequence[str], act: Callable[[str], object], *, label: str = "", hint: str | None = None,
        anybody: bool = False,
    ) -> Any:  # fmt: skip
        """A row of small buttons, at full width without a label; ``act`` gets the name of the pressed button."""
        row = self.gui.add_button_group(label, tuple(options), hint=hint)
        row.on_click((self.hub.watching if anybody else self.hub.driving)(lambda event, _: act(event.target.value)))
        return row if anybody else self.driven(row)


def follow(widget: Any, value: Any) -> None:
    """Set a widget from outside, unless a person has just changed it: that choice may still be on its way.

    Viser sets the new value first and then calls back. A value set in between by another thread would undo the choice.
    """
    if widget.value != value and time.time() - widget.update_timestamp > HOLD:
        widget.value = value
        widget._impl.update_timestamp = 0.0  # this was no change by hand


def set_disabled(widget: Any, disabled: bool) -> None:
    """Make a widget grey, or usable again.

    A row of buttons can be created disabled, but Viser's handle refuses to change that later: the
    change is sent the way Viser sends it for other widgets.
    """
    if not isinstance(widget, viser.GuiButtonGroupHandle):
        widget.disabled = disabled
        return
    props: Any = widget._impl.props
    if props.disabled != disabled and not widget._impl.removed:
        props.disabled = disabled
        widget._queue_update("disabled", disabled)


def set_marks(slider: Any, marks: Sequence[tuple[float, str]]) -> None:
    """Replace the marks of a slider. Its handle does not offer this: they are sent as Viser sends its properties."""
    slider._marks = tuple({"value": value, "label": label} for value, label in marks)


def text(value: object) -> str:
    """The value as text, escaped for HTML."""
    return html.escape(str(value))


def card(*parts: str, style: str = "padding:6px 12px") -> str:
    """A card of the panel; parts are HTML."""
    return f'<div class="mm" style="{style}">{"".join(parts)}</div>'


def heading(title: str) -> str:
    """A small title, HTML."""
    return f"<h4>{title}</h4>"


def ends(left: str, right: str) -> str:
    """A row with one item at each end, HTML."""
    return f'<div class="ends">{left}{right}</div>'


def sentence(value: str, colour: str) -> str:
    """A sentence, escaped, beside a coloured line."""
    look = f"margin-top:5px;border-left:3px solid {colour};padding:2px 8px;background:{wash(colour)}"
    return f'<div style="{look}">{text(value)}</div>'


def wash(colour: str) -> str:
    """A light tint of a colour, as background for text."""
    return f"color-mix(in srgb, {colour} 9%, transparent)"


def note(content: str, colour: str = MUTED) -> str:
    """A short text between widgets; the content is HTML."""
    return f'<div class="mn" style="color:{colour}">{content}</div>'


def explained(name: str, words: str, term: str = "") -> str:
    """A name, HTML, with an explanation on hover, and a link to what the documentation says about a term."""
    address = link(term) if term else ""
    if not address:
        return f'<span class="ex" title="{text(words)}">{name}</span>'
    return f'<a class="ex" target="_blank" rel="noopener" href="{address}" title="{text(words)}">{name}</a>'


def chip(value: str, colour: str) -> str:
    """A word in a coloured capsule."""
    return f'<span class="chip" style="background:{colour}">{text(value)}</span>'


def pairs(rows: list[tuple[str, str]]) -> str:
    """Names and values in two columns, both HTML."""
    return f'<div class="kv">{"".join(f"<span>{name}</span><span>{value}</span>" for name, value in rows)}</div>'


def table(rows: list[tuple[str, ...]]) -> str:
    """Rows of HTML cells; the first column is to the left, the others to the right."""
    return f"<table>{''.join('<tr>' + ''.join(f'<td>{cell}</td>' for cell in row) + '</tr>' for row in rows)}</table>"


def bar(*pieces: str, height: int = 10) -> str:
    """A horizontal bar; later pieces lie over earlier ones."""
    return f'<div class="bar" style="height:{height}px">{"".join(pieces)}</div>'


def piece(start: float, end: float, colour: str) -> str:
    """A part of a bar: from, to (shares of its length) and colour."""
    start, end = min(max(start, 0.0), 1.0), min(max(end, 0.0), 1.0)
    width = max(0.0, end - start)
    return f'<i style="left:{100 * start:.1f}%;width:{100 * width:.1f}%;background:{colour}"></i>'


def mark(at: float, colour: str = "var(--motm-ink)", width: float = 0.012) -> str:
    """A thin line across a bar."""
    at = min(max(at, width / 2), 1.0 - width / 2)
    return piece(at - width / 2, at + width / 2, colour)


def seconds(value: float | None) -> str:
    """A duration; "none" when there is none."""
    return "none" if value is None else f"{value:.1f} s"


def metres(value: float | None) -> str:
    """A length; "none near" when there is none."""
    return "none near" if value is None else f"{value:.2f} m"
