"""Looking back: the last two minutes, branching, and what can be taken home."""

import asyncio
import io
import math
import re
import time
from typing import TYPE_CHECKING

import viser
from PIL import Image

from motm_twin.bus.commands import Branch, UndoBranch
from motm_twin.bus.messages import StatusMessage, TickMessage
from motm_twin.model.period import PERIOD
from motm_twin.ui.export import export_html
from motm_twin.ui.hub import Hub, Shown, Visitor
from motm_twin.ui.widgets import HOLD, Changing, Html, buttons

if TYPE_CHECKING:
    from motm_twin.ui.history import Span

SPAN_LEAST = 1.0  # [s] of the slider
NOW = ((0.0, "now"),)  # its right end
SPEEDS = {"1/4": 0.25, "1/2": 0.5, "1x": 1.0, "2x": 2.0, "4x": 4.0}
EXPORTS = {"10 s": 10.0, "30 s": 30.0, "60 s": 60.0}
PICTURE = (1200, 1920)  # [px] height, width
RENDER_TIME = 60.0  # [s] for a browser to draw one picture
_TEXT = "font-size:12px;line-height:1.45;color:#6b7280;padding:0 12px 6px 12px"
_CODE = "background:#f3f4f6;border-radius:3px;padding:0 4px"


def file_name(status: StatusMessage | None, ending: str, *, looked_at: float | None = None) -> str:
    """A name for a file to be downloaded: scene, variant, seed and time, in letters that any system takes.

    ``looked_at``: time [s] of the earlier period that is shown, and not the newest.
    """
    if status is None:
        return f"twin.{ending}"
    time = f"{status.time:.1f}s" if looked_at is None else f"{looked_at:.2f}s"
    parts = (status.scene, status.variant, str(status.seed), time)
    return "-".join(filter(None, (_plain(part) for part in parts))) + f".{ending}"


def _plain(text: str) -> str:
    return re.sub(r"[^A-Za-z0-9_.]+", "_", text).strip("_.")[:40]


def span_line(shown: Shown, span: "Span | None") -> str:
    """Which period is shown, of which, as HTML."""
    if span is None or shown.tick is None:
        return f'<div style="{_TEXT}">nothing recorded yet</div>'
    at = "live" if shown.live else f"period {shown.tick.index}"
    return (
        f'<div style="{_TEXT};font-variant-numeric:tabular-nums">at <b>{shown.tick.time:.2f} s</b> ({at}) &middot; '
        f"kept: {span.first_time:.0f} to {span.last_time:.1f} s</div>"
    )


def slider_start(span: "Span | None") -> float:
    """Where the slider of seconds before now begins [s]: at what is kept, in whole seconds so that it seldom moves."""
    kept = 0.0 if span is None else span.last_time - span.first_time
    return -max(SPAN_LEAST, float(math.ceil(kept - 1e-6)))


def branch_text(shown: Shown | None) -> str:
    """What a branch from the shown moment would do, as HTML."""
    if shown is None or shown.live or shown.tick is None or shown.newest is None:
        return f'<div style="{_TEXT}">To branch, look back first: the twin can go on from any moment.</div>'
    return (
        f'<div style="{_TEXT};font-variant-numeric:tabular-nums">The run time goes back to <b>{shown.tick.time:.2f} s'
        f"</b>, and the twin goes on from there. The {shown.behind:.2f} s after it are set aside; Undo brings them "
        "back.</div>"
    )


def branched(newest: TickMessage) -> tuple[str, str]:
    """What there is to tell of a branch, or of one that was undone, whose first periods have come: text and title."""
    start = newest.first * PERIOD
    if newest.past == newest.run - 1:
        return f"the twin goes on from {start:.2f} s; Undo in the Replay tab brings back what came after", "Branched"
    return f"the twin goes on from {start:.2f} s, as before the branch; Undo brings the branch back", "Branch undone"


def rerun_text(name: str) -> str:
    """How a saved session is used, as HTML; ``name`` is one of `file_name`."""
    return (
        f'<div style="{_TEXT}">Saved as <b style="overflow-wrap:anywhere">{name}</b>. '
        f'Rerun it bit for bit:<br><code style="{_CODE}">motm-twin rerun FILE</code><br>'
        f'Keep it as a test: put the file into <code style="{_CODE}">tests/recorded</code>; the test there reruns '
        "every session and compares the state.</div>"
    )


class ReplayTab:
    """Widgets that look back and save."""

    def __init__(self, gui: viser.GuiApi, hub: Hub, visitor: Visitor) -> None:
        self._hub, self._visitor = hub, visitor
        self._changing = Changing()
        self._shown: Shown | None = None
        gui.add_html('<div class="motm-stacked"></div>')
        self._position = self._changing(
            gui.add_slider("Recording [s]", 0.0, SPAN_LEAST, PERIOD, 0.0, visible=False, hint="where it is played")
        )
        self._position.on_update(hub.driving(lambda event, _: self._seek(float(event.target.value))))
        self._sought = -1e9
        self._line = Html(gui)
        self._slider = self._changing(gui.add_slider("Seconds before now", -SPAN_LEAST, 0.0, PERIOD, 0.0, marks=NOW))
        self._slider.on_update(hub.driving(lambda event, _: self._look(float(event.target.value))))
        self._touched = -1e9
        self._play = self._row(gui, ("◀ 1", "Play", "1 ▶", "Live"), self._move, hint="keys J, K, L")
        self._speed: viser.GuiDropdownHandle[str] = gui.add_dropdown("Speed", tuple(SPEEDS), initial_value="1x")
        hint = "the twin goes back to the shown moment and on from there; Undo brings back what came after"
        self._branch = self._changing(gui.add_button("Branch from here", icon=viser.Icon.GIT_BRANCH, hint=hint))
        self._branch.on_click(hub.driving(lambda *_: self.branch()))
        self._consequence = Html(gui, branch_text(None))
        self._undo = self._changing(gui.add_button("Undo", icon=viser.Icon.ARROW_BACK_UP, visible=False))
        self._undo.on_click(hub.driving(lambda *_: self.undo()))
        self._run: int | None = None
        gui.add_divider()
        self._save = gui.add_button("Save the session", icon=viser.Icon.DOWNLOAD, hint="V")
        self._save.on_click(hub.watching(lambda *_: self.save()))
        self._saved = Html(gui, rerun_text("scene-variant-seed-time.json").replace("Saved as", "Saves"))
        gui.add_divider()
        act = hub.watching(lambda event, _: self._export(EXPORTS[event.target.value]))
        buttons(gui, tuple(EXPORTS), act, label="As a page", hint="the last seconds as one HTML file, to be sent on")
        self._bar = gui.add_progress_bar(0.0, animated=True, visible=False)
        self._exporting = False
        picture = gui.add_button("Screenshot", icon=viser.Icon.CAMERA)
        picture.on_click(hub.watching(lambda *_: self.screenshot()))

    def enable(self, driving: bool) -> None:
        """Grey while somebody else drives; anybody may save."""
        self._changing.enable(driving)

    def update(self, shown: Shown) -> None:
        """Show this."""
        self._shown = shown
        self._show_position(shown)
        self._line.set(span_line(shown, self._span()))
        if time.monotonic() - self._touched > HOLD:
            start = slider_start(self._span())
            if self._slider.min != start:
                self._slider.min = start
            self._slider.value = round(max(start, -shown.behind) / PERIOD) * PERIOD
        self._play.options = ("◀ 1", "Pause" if self._hub.playback.playing else "Play", "1 ▶", "Live")
        self._branch.disabled = shown.live or not self._changing.on
        self._consequence.set(branch_text(shown))
        aside = None if shown.status is None else shown.status.aside
        self._undo.visible = aside is not None
        self._undo.label = "Undo" if aside is None else f"Undo: on from {aside:.2f} s"
        self._announce(shown.newest)

    def _show_position(self, shown: Shown) -> None:
        """Of a recording that is played: where it is."""
        span = [] if shown.status is None else shown.status.span
        self._position.visible = bool(span)
        if not span or shown.status is None or time.monotonic() - self._sought <= HOLD:
            return
        first, last = span[0], max(span[1], span[0] + SPAN_LEAST)
        if (self._position.min, self._position.max) != (first, last):
            self._position.min, self._position.max = first, last
        self._position.value = min(max(shown.status.time, first), last)

    def _seek(self, value: float) -> None:
        """Play the recording from another moment on."""
        self._sought = time.monotonic()
        self._hub.playback.live()
        self._hub.send(self._visitor, Branch(index=round(value / PERIOD)))

    def step(self, periods: int) -> None:
        """Look one period earlier or later."""
        self._hub.playback.step(periods, self._span())

    def branch(self) -> None:
        """Have the twin go on from the shown moment."""
        at, shown = self._hub.view.at, self._shown
        if at is None or shown is None or shown.status is None:
            self._hub.tell(self._visitor, "first look back to the moment from which the twin should go on")
            return
        if at < shown.status.oldest:
            seconds = shown.status.oldest * PERIOD
            self._hub.tell(self._visitor, f"the twin can go back to {seconds:.1f} s at the earliest")
            return
        self._hub.playback.live()
        self._hub.send(self._visitor, Branch(index=at))

    def undo(self) -> None:
        """Have the twin go on where the run ended that the last branch has set aside."""
        status = self._status()
        if status is None or status.aside is None:
            self._hub.tell(self._visitor, "there is no branch to undo")
            return
        self._hub.playback.live()
        self._hub.send(self._visitor, UndoBranch())

    def _announce(self, newest: TickMessage | None) -> None:
        """Tell this visitor once about a branch that has happened, whoever made it."""
        if newest is None or newest.run == self._run:
            return
        played = self._shown is not None and self._shown.status is not None and self._shown.status.span
        if self._run is not None and newest.past >= 0 and not played:
            self._hub.tell(self._visitor, *branched(newest), "blue")
        self._run = newest.run

    async def save(self) -> None:
        """Download the run so far."""
        data = await asyncio.to_thread(self._hub.client.session)
        name = file_name(self._status(), "json")
        self._visitor.client.send_file_download(name, data, save_immediately=True)
        self._saved.set(rerun_text(name))

    async def screenshot(self) -> None:
        """Download a picture of the scene from this visitor's camera."""
        height, width = PICTURE
        picture = await asyncio.to_thread(
            self._visitor.client.get_render, height=height, width=width, timeout=RENDER_TIME
        )
        shown, buffer = self._shown, io.BytesIO()
        looked_at = None if shown is None or shown.live or shown.tick is None else shown.tick.time
        await asyncio.to_thread(Image.fromarray(picture[..., :3]).save, buffer, "PNG")
        self._visitor.client.send_file_download(
            file_name(self._status(), "png", looked_at=looked_at), buffer.getvalue(), save_immediately=True
        )

    async def _export(self, seconds: float) -> None:
        shown, history = self._shown, self._hub.history
        if shown is None or shown.scene is None or history is None:
            return
        if self._exporting:
            self._hub.tell(self._visitor, "a page is being made already")
            return
        self._exporting, self._bar.visible = True, True
        try:
            page = await asyncio.to_thread(export_html, history, shown.scene, seconds, self._progress)
        finally:
            self._exporting, self._bar.visible = False, False
        self._visitor.client.send_file_download(file_name(self._status(), "html"), page, save_immediately=True)

    def _progress(self, part: float) -> None:
        self._bar.value = round(100.0 * min(1.0, max(0.0, part)))

    def _row(self, gui: viser.GuiApi, options: tuple[str, ...], act, hint: str):
        callback = self._hub.driving(lambda event, _: act(event.target.value))
        return self._changing(buttons(gui, options, callback, hint=hint))

    def _move(self, what: str) -> None:
        playback = self._hub.playback
        if what == "Live":
            playback.live()
        elif what == "Pause":
            playback.pause()
        elif what == "Play":
            playback.play(SPEEDS[self._speed.value], self._span())
        else:
            playback.step(1 if what == "1 ▶" else -1, self._span())

    def _look(self, value: float) -> None:
        self._touched = time.monotonic()
        self._hub.playback.look(-value, self._span())

    def _span(self) -> "Span | None":
        return self._hub.span

    def _status(self) -> StatusMessage | None:
        return None if self._shown is None else self._shown.status
