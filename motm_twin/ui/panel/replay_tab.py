"""The Replay tab: effect of a branch, position in a played recording, downloads. The timeline does the rest."""

import asyncio
import io
import re
import time

import viser
from PIL import Image

from motm_twin.bus.commands import Branch, UndoBranch
from motm_twin.bus.messages import StatusMessage, TickMessage
from motm_twin.model.plant import PERIOD
from motm_twin.ui.export import export_html
from motm_twin.ui.history import Span
from motm_twin.ui.hub import Hub, Shown, Visitor
from motm_twin.ui.panel.widgets import HOLD, Block, note

SPAN_LEAST = 1.0  # [s] least length of the slider
SPEEDS = {"1/4": 0.25, "1/2": 0.5, "1x": 1.0, "2x": 2.0, "4x": 4.0}
EXPORTS = {"10 s": 10.0, "30 s": 30.0, "60 s": 60.0}
PICTURE = (1200, 1920)  # [px] height, width
RENDER_TIME = 60.0  # [s] for a browser to draw one picture


class ReplayTab(Block):
    """Widgets that look back and save."""

    def __init__(self, gui: viser.GuiApi, hub: Hub, visitor: Visitor) -> None:
        super().__init__(gui, hub, visitor)
        icon = viser.Icon
        self._sought = -1e9  # [s] monotonic, when the slider was moved
        self._run: int | None = None
        self._exporting = False
        gui.add_html('<div class="motm-stacked"></div>')
        self._position = self.driven(
            gui.add_slider("Recording [s]", 0.0, SPAN_LEAST, PERIOD, 0.0, visible=False, hint="current position"),
            self._seek,
        )
        self._line = gui.add_html("")
        hint = "when looking back; the play button is below the scene"
        self._speed: viser.GuiDropdownHandle[str] = gui.add_dropdown(
            "Playback speed", tuple(SPEEDS), initial_value="1x", hint=hint
        )
        self._consequence = gui.add_html(branch_text(None))
        gui.add_divider()
        self.button("Save the session", self.save, anybody=True, icon=icon.DOWNLOAD, hint="V")
        self._saved = gui.add_html(rerun_text("scene-variant-seed-time.json").replace("Saved as", "Saves"))
        gui.add_divider()
        hint = "the last seconds as one HTML file that plays without a server"
        self.row(tuple(EXPORTS), lambda name: self.export(EXPORTS[name]), label="As a page", hint=hint, anybody=True)
        self._bar = gui.add_progress_bar(0.0, animated=True, visible=False)

    def _refresh(self, shown: Shown) -> None:
        self._show_position(shown)
        span = self.hub.span
        self._line.content = span_line(shown, span)
        self._consequence.content = branch_text(shown)
        self._announce(shown)

    def step(self, periods: int) -> None:
        """Show an earlier or later period."""
        self.hub.playback.step(periods, self.hub.span)

    def toggle(self) -> bool:
        """Play or pause the history while looking back; False while the newest period is shown."""
        playback = self.hub.playback
        if self.shown is None or self.shown.live:
            return False
        if playback.playing:
            playback.pause()
        else:
            playback.play(SPEEDS[self._speed.value], self.hub.span)
        return True

    def branch(self) -> None:
        """Let the twin continue from the shown moment."""
        at, status = self.hub.view.at, self._status()
        if at is None or status is None:
            self.tell("first look back to the moment from which the twin should go on")
        elif at < status.oldest:
            self.tell(f"the twin can go back to {status.oldest * PERIOD:.1f} s at the earliest")
        else:
            self.hub.playback.live()
            self.send(Branch(index=at))

    def undo(self) -> None:
        """Let the twin resume the run that the last branch set aside."""
        status = self._status()
        if status is None or status.aside is None:
            self.tell("there is no branch to undo")
        else:
            self.hub.playback.live()
            self.send(UndoBranch())

    async def save(self) -> None:
        """Download the run so far."""
        data = await asyncio.to_thread(self.hub.client.session)
        name = file_name(self._status(), "json")
        self._download(name, data)
        self._saved.content = rerun_text(name)

    async def screenshot(self) -> None:
        """Download a picture of the scene from this visitor's camera."""
        height, width = PICTURE
        client, buffer, shown = self.visitor.client, io.BytesIO(), self.shown
        picture = await asyncio.to_thread(client.get_render, height=height, width=width, timeout=RENDER_TIME)
        looked_at = None if shown is None or shown.live or shown.tick is None else shown.tick.time
        await asyncio.to_thread(Image.fromarray(picture[..., :3]).save, buffer, "PNG")
        self._download(file_name(self._status(), "png", looked_at=looked_at), buffer.getvalue())

    async def export(self, seconds: float) -> None:
        """Download the last seconds [s] as a page that plays without a server."""
        shown, history = self.shown, self.hub.history
        if shown is None or shown.scene is None or history is None:
            return
        if self._exporting:
            self.tell("a page is being made already")
            return
        self._exporting, self._bar.visible = True, True
        try:
            page = await asyncio.to_thread(export_html, history, shown.scene, seconds, self._progress)
        finally:
            self._exporting, self._bar.visible = False, False
        self._download(file_name(self._status(), "html"), page)

    def _progress(self, part: float) -> None:
        self._bar.value = round(100.0 * min(1.0, max(0.0, part)))

    def _download(self, name: str, content: bytes) -> None:
        self.visitor.client.send_file_download(name, content, save_immediately=True)

    def _show_position(self, shown: Shown) -> None:
        """Show the position in the recording that the twin plays, if any."""
        span = [] if shown.status is None else shown.status.span
        self._position.visible = bool(span)
        if not span or shown.status is None or time.monotonic() - self._sought <= HOLD:
            return
        first, last = span[0], max(span[1], span[0] + SPAN_LEAST)
        self._position.min, self._position.max = first, last
        self._position.value = min(max(shown.status.time, first), last)

    def _seek(self, value: float) -> None:
        """Play the recording from another moment on."""
        self._sought = time.monotonic()
        self.hub.playback.live()
        self.send(Branch(index=round(float(value) / PERIOD)))

    def _announce(self, shown: Shown) -> None:
        """Tell this visitor once about a branch that has happened, whoever made it."""
        newest = shown.newest
        if newest is None or newest.run == self._run:
            return
        played = shown.status is not None and shown.status.span
        if self._run is not None and newest.past >= 0 and not played:
            self.tell(*branched(newest), "blue")
        self._run = newest.run

    def _status(self) -> StatusMessage | None:
        return None if self.shown is None else self.shown.status


def file_name(status: StatusMessage | None, ending: str, *, looked_at: float | None = None) -> str:
    """A name for a file to be downloaded: scene, variant, seed and time, in letters that any system takes.

    ``looked_at``: time [s] of the earlier period that is shown; None when it is the newest.
    """
    if status is None:
        return f"twin.{ending}"
    time = f"{status.time:.1f}s" if looked_at is None else f"{looked_at:.2f}s"
    parts = (status.scene, status.variant, str(status.seed), time)
    plain = (re.sub(r"[^A-Za-z0-9_.]+", "_", part).strip("_.")[:40] for part in parts)
    return "-".join(filter(None, plain)) + f".{ending}"


def span_line(shown: Shown, span: Span | None) -> str:
    """The shown period and the span that is kept, as HTML."""
    if span is None or shown.tick is None:
        return note("nothing recorded yet")
    at = "live" if shown.live else f"period {shown.tick.index}"
    kept = f"kept: {span.first_time:.0f} to {span.last_time:.1f} s"
    return note(f"at <b>{shown.tick.time:.2f} s</b> ({at}) &middot; {kept}")


def branch_text(shown: Shown | None) -> str:
    """Consequence of a branch from the shown moment, as HTML."""
    if shown is None or shown.live or shown.tick is None or shown.newest is None:
        return note("To branch, look back first: the twin can go on from any moment.")
    return note(
        f"The run time goes back to <b>{shown.tick.time:.2f} s</b>, and the twin goes on from there. "
        f"The {shown.behind:.2f} s after it are set aside; Undo brings them back."
    )


def branched(newest: TickMessage) -> tuple[str, str]:
    """Text and title of the note about a branch, or its undoing, once its first periods have arrived."""
    start = newest.first * PERIOD
    if newest.past == newest.run - 1:
        return f"the twin goes on from {start:.2f} s; Undo, below the scene, brings back what came after", "Branched"
    return f"the twin goes on from {start:.2f} s, as before the branch; Undo brings the branch back", "Branch undone"


def rerun_text(name: str) -> str:
    """Hint on how to use a saved session, as HTML; ``name`` comes from `file_name`."""
    return note(
        f'Saved as <b style="overflow-wrap:anywhere">{name}</b>. '
        "Rerun it bit for bit:<br><code>motm-twin rerun FILE</code><br>"
        "To keep it as a test, put the file into <code>tests/recorded</code>."
    )
