"""The viewer process: a Zenoh client that draws ticks with Viser and posts commands.

It can be started, stopped and restarted at any time; the twin does not notice. Alone:
``python -m motm_twin.ui.viewer_process --endpoint tcp/127.0.0.1:7447 --port 8080``.
"""

import threading
import time
import traceback

import viser

from motm_twin.bus.client import Grid, TwinClient
from motm_twin.bus.messages import TickMessage
from motm_twin.ui.feed import Feed
from motm_twin.ui.history import History
from motm_twin.ui.hub import Hub, Shown
from motm_twin.ui.news import News
from motm_twin.ui.stage import Stage
from motm_twin.ui.visitors import Visitors
from motm_twin.ui.what_if import OwnMethod

FRAME = 1.0 / 30.0  # [s] at most thirty pictures a second
SLOW = 0.1  # [s] between updates of ghosts, candidates and panels


class Viewer:
    """Draws one twin on one Viser server. `run` returns after `stop`."""

    def __init__(self, server: viser.ViserServer, client: TwinClient, own_method: OwnMethod | None = None) -> None:
        """``own_method``: one that is not shipped, for comparisons."""
        self._client = client
        self._stop = threading.Event()
        self._hub = Hub(server, client, own_method)
        self._hub.history = self._history = History()
        self._feed = Feed(client, self._history)
        self._news = News(client, lambda text, title: self._hub.tell(None, text, title))
        self._stage = Stage(server, self._hub)
        self._visitors = Visitors(server, self._hub, self._stage)

    def stop(self) -> None:
        """Make `run` return."""
        self._stop.set()

    def run(self) -> None:
        """Draw until `stop`; an error in drawing is shown on the page and drawing goes on."""
        seen, last, slow_at = 0, time.monotonic(), 0.0
        while not self._stop.is_set():
            seen = self._client.wait_tick(seen, FRAME)
            now = time.monotonic()
            slow = now >= slow_at
            if slow:
                slow_at = now + SLOW
            try:
                shown = self._shown()
                self._stage.draw(shown, now - last, slow=slow)
                if slow:
                    self._visitors.update(shown)
            except Exception as error:
                traceback.print_exc()
                self._hub.tell(None, f"{type(error).__name__}: {error}", "Drawing failed", "red")
                self._stop.wait(1.0)
            last = now
            self._stop.wait(max(0.0, FRAME - (time.monotonic() - now)))
        self._news.stop()
        self._feed.stop()
        self._stage.stop()
        self._hub.stop()

    def _shown(self) -> Shown:
        status, tick = self._client.status(), self._client.tick()
        if status is None:
            state = "waiting"
        else:
            state = status.state if self._client.alive else "lost"
        looking_back = self._looking_back()
        return Shown(
            state=state,
            status=status,
            scene=self._client.scene(),
            tick=tick if looking_back is None else looking_back[0],
            newest=tick,
            live=looking_back is None,
            view=self._hub.view,
            grid=self._client.grid() if looking_back is None else looking_back[1],
        )

    def _looking_back(self) -> tuple[TickMessage, Grid | None] | None:
        """The period of the history that is looked at, with its grid; None when that is the newest."""
        view, span = self._hub.view, self._hub.span
        at = view.at
        if at is None:
            return None
        if span is None or at > span.last:  # cut off by a branch, a reset or another scene
            view.at = None
            return None
        if at < span.first:  # forgotten while it was looked at
            at = view.at = span.first
        tick = self._history.at(at)
        return None if tick is None else (tick, self._history.grid_at(at))
