"""Who drives, on one visitor's panel: a line that says so, asking for the wheel, handing it over; and looking back."""

import html

import viser

from motm_twin.bus.commands import NAME_MAX, HandOver, TakeWheel
from motm_twin.bus.messages import StatusMessage
from motm_twin.ui.cards import LOOKING_BACK
from motm_twin.ui.hub import Hub, Shown, Visitor, clean_name
from motm_twin.ui.widgets import Html

_ROW = "font-size:13px;line-height:1.4;padding:0 12px 10px 12px;"


def driver_line(status: StatusMessage | None, sender: str) -> str:
    """One line that says who drives, as HTML."""
    if status is None:
        return ""
    if not status.driver:
        return _line("#9ca3af", "Nobody is driving: do anything to take the wheel")
    if status.driver == sender:
        return _line("#15803d", "<b>You</b> are driving")
    name = html.escape(clean_name(status.driver_name) or "Somebody")
    return _line("#b45309", f"<b>{name}</b> is driving, you are looking")


def asked_line(name: str) -> str:
    """The note for a driver that somebody wants to drive, as HTML."""
    return _line("#2563a6", f"<b>{html.escape(name)}</b> asks for the wheel")


def back_line(shown: Shown) -> str:
    """The note that an earlier period is shown, as HTML; "" while the newest is."""
    if shown.live or shown.tick is None:
        return ""
    live = "" if shown.newest is None else f"live: {shown.newest.time:.2f} s"
    runs_on = ", runs on" if shown.state == "playing" else ""
    return (
        f'<div style="{_ROW}padding-top:4px"><div style="border-left:3px solid {LOOKING_BACK};'
        f'background:{LOOKING_BACK}14;padding:4px 8px;font-variant-numeric:tabular-nums">'
        f"looking back &middot; <b>{shown.tick.time:.2f} s</b> ({live}{runs_on})</div></div>"
    )


def _line(colour: str, text: str) -> str:
    dot = (
        f'<span style="display:inline-block;width:9px;height:9px;border-radius:5px;background:{colour};'
        f'margin-right:7px;flex:none"></span>'
    )
    return f'<div style="{_ROW}display:flex;align-items:center"><div>{dot}{text}</div></div>'


class Wheel:
    """The widgets about driving on top of one visitor's panel."""

    def __init__(self, gui: viser.GuiApi, hub: Hub, visitor: Visitor) -> None:
        self._hub, self._visitor = hub, visitor
        self._line = Html(gui)
        self._asked = Html(gui)
        self._yield = gui.add_button("Hand over", visible=False, icon=viser.Icon.STEERING_WHEEL)
        self._yield.on_click(hub.driving(lambda *_: self._hand_over()))
        self._ask = gui.add_button("Ask for the wheel", visible=False, icon=viser.Icon.HAND_STOP)
        self._ask.on_click(hub.watching(lambda *_: self._ask_for_it()))
        self._name = gui.add_text("Your name", visitor.name, visible=False, hint=f"up to {NAME_MAX} characters")
        self._name.on_update(hub.watching(lambda event, _: self._rename(event.target.value)))
        self._back_line = Html(gui)
        self._back = gui.add_button("Back to live", visible=False, icon=viser.Icon.PLAYER_SKIP_FORWARD)
        self._back.on_click(hub.driving(lambda *_: hub.playback.live()))

    def enable(self, driving: bool) -> None:
        """Others cannot move the picture."""
        self._back.disabled = not driving

    def update(self, shown: Shown) -> None:
        """Show this."""
        hub, visitor, status = self._hub, self._visitor, shown.status
        driver = "" if status is None else status.driver
        mine, asker = driver == visitor.sender, hub.asker()
        others = len(hub.visitors) > 1 or (driver != "" and not mine)
        self._line.set(driver_line(status, visitor.sender))
        self._asked.set(asked_line(asker.name) if mine and asker is not None else "")
        self._yield.visible = mine and others
        self._yield.label = "Hand over" if asker is None else f"Hand over to {asker.name}"
        self._ask.visible = driver != "" and not mine
        self._ask.label = "You have asked for the wheel" if hub.asks(visitor) else "Ask for the wheel"
        self._name.visible = others
        self._back_line.set(back_line(shown))
        self._back.visible = not shown.live

    def _hand_over(self) -> None:
        asker = self._hub.asker()
        to = HandOver() if asker is None else HandOver(to=asker.sender, name=asker.name)
        self._hub.send(self._visitor, to)

    def _ask_for_it(self) -> None:
        self._hub.ask(self._visitor)

    def _rename(self, text: str) -> None:
        self._visitor.rename(text)
        if len(text) > NAME_MAX:
            self._name.value = self._visitor.name
        if self._hub.is_driver(self._visitor):
            self._hub.send(self._visitor, TakeWheel())  # carries the new name
