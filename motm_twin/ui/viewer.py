"""The viewer: a Zenoh client that draws ticks with Viser and posts commands.

A separate process, which can be started, stopped and restarted at any time without affecting the twin. Alone:
``python -m motm_twin.ui.viewer --endpoint tcp/127.0.0.1:7447 --port 8080``.
"""

import argparse
import logging
import os
import queue
import sys
import threading
import time
import traceback
from collections.abc import Callable
from functools import partial

import msgspec
import viser

from motm_twin.bus.client import Grid, TwinClient
from motm_twin.bus.commands import Audience
from motm_twin.bus.connection import DEFAULT_PORT, DEFAULT_TWIN, LOOPBACK
from motm_twin.bus.messages import NumberedEvent, TickMessage
from motm_twin.processes import Reporter, await_stop, leave, stop_event
from motm_twin.program import BAD_INPUT, freeze_setup, share_arenas
from motm_twin.ui.history import History
from motm_twin.ui.hub import Hub, Shown
from motm_twin.ui.page_server import VARIABLE, VISITORS, chosen_token, open_page, page_url
from motm_twin.ui.panel.panel import Panels
from motm_twin.ui.scene.scene_view import SceneView
from motm_twin.ui.what_if import OwnMethod

FRAME = 1.0 / 30.0  # [s] at most thirty frames a second
TELL = 1.0  # [s] between two reports of the number of pages
SLOW = 0.1  # [s] between updates of ghosts, candidates and panels
ROOM = 4000  # payloads that may wait for the history; beyond, the oldest are lost, as for any slow reader
FIRST_TICK = 600.0  # [s] longest wait for a first tick before earlier events are queried
TITLES = {"refused": "Not done", "recording": "Recording"}  # kinds of events that are shown on every page
NICENESS = 5  # drawing yields to control


class Viewer:
    """Draws one twin on one Viser server. `run` returns after `stop`."""

    def __init__(self, server: viser.ViserServer, client: TwinClient, own_method: OwnMethod | None = None) -> None:
        """``own_method``: a method that is not shipped, for comparisons."""
        self._client = client
        self._stop = threading.Event()
        self._hub = Hub(client, own_method)
        self._hub.history = self._history = History()
        self._writer = HistoryWriter(client, self._history)
        self._forget_events = follow_events(client, self._hub)
        self._scene = SceneView(server, self._hub)
        self._panels = Panels(server, self._hub, self._scene)
        self._told = 0.0  # [s] time of the last report of the number of pages

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
                self._scene.draw(shown, now - last, slow=slow)
                if slow:
                    self._panels.update(shown)
                    self._tell_audience(shown, now)
            except Exception as error:
                self._hub.tell_error(None, error, "Drawing failed")
                self._stop.wait(1.0)
            last = now
            self._stop.wait(max(0.0, FRAME - (time.monotonic() - now)))
        self._forget_events()
        for part in (self._writer, self._scene, self._hub):
            part.stop()

    def _tell_audience(self, shown: Shown, now: float) -> None:
        """Report the number of pages that show the scene, if the twin counts them."""
        pages, status = sum(visitor.looks for visitor in self._hub.visitors), shown.status
        if status is None or shown.tick is None or shown.state not in ("playing", "paused", "done"):
            return
        if status.pages not in (-1, pages) and now >= self._told + TELL:
            self._told = now
            self._hub.send(None, Audience(pages=pages))

    def _shown(self) -> Shown:
        status, tick, scene = self._client.status(), self._client.tick(), self._client.scene()
        if tick is not None and not self._client.of_scene(tick):
            tick = self._hub.view.at = None
        if tick is not None:
            self._hub.events.follow(tick)
        state = "waiting" if status is None else status.state if self._client.alive else "lost"
        looking_back = self._looking_back()
        return Shown(
            state=state,
            status=status,
            scene=scene,
            tick=tick if looking_back is None else looking_back[0],
            newest=tick,
            live=looking_back is None,
            view=self._hub.view,
            grid=self._client.grid() if looking_back is None else looking_back[1],
        )

    def _looking_back(self) -> tuple[TickMessage, Grid | None] | None:
        """The shown period of the history, with its grid; None when the newest period is shown."""
        view, span = self._hub.view, self._hub.span
        at = view.at
        if at is None:
            return None
        if span is None or at > span.last:  # cut off by a branch, a reset or another scene
            view.at = None
            return None
        if at < span.first:  # dropped from the history while it was shown
            at = view.at = span.first
        tick = self._history.at(at)
        return None if tick is None else (tick, self._history.grid_at(at))


class HistoryWriter:
    """Fills the history of one twin until `stop`, in its own thread: Zenoh's must not wait for the compression."""

    def __init__(self, client: TwinClient, history: History) -> None:
        self._waiting: queue.Queue[Callable[[], None] | None] = queue.Queue()
        self._forget = [
            client.on_tick(lambda payload: self._take(partial(history.add, payload))),
            client.on_grid(lambda cells, info: self._take(partial(history.add_grid, cells, info))),
        ]
        self._worker = threading.Thread(target=self._work, name="history", daemon=True)
        self._worker.start()

    def stop(self) -> None:
        """End the subscriptions and the thread."""
        for forget in self._forget:
            forget()
        self._waiting.put(None)
        self._worker.join(1.0)

    def _take(self, add: Callable[[], None]) -> None:
        if self._waiting.qsize() > ROOM:
            self._waiting.get_nowait()
        self._waiting.put(add)

    def _work(self) -> None:
        while (add := self._waiting.get()) is not None:
            try:
                add()
            except Exception:  # another version, or broken: the page reports it when it draws the same message
                traceback.print_exc()


def follow_events(client: TwinClient, hub: Hub) -> Callable[[], None]:
    """Keep events for the timeline; show those that belong to no period, such as a refusal by the robot, as notes.

    Returns the function that ends the subscription.
    """
    decode = msgspec.json.Decoder(NumberedEvent).decode

    def take(payload: bytes) -> None:  # in Zenoh's thread: a note is only queued for the page
        try:
            event = decode(payload)
        except msgspec.MsgspecError:
            return  # another version: the ticks show it
        hub.events.add([event])
        if event.kind in TITLES:
            hub.tell(None, event.text, TITLES[event.kind])

    def earlier() -> None:
        if client.wait_tick(0, FIRST_TICK) and (found := client.events(0)) is not None:
            hub.events.add(found.events)

    forget = client.on_sample(client.keys.event, take)
    client.follow(client.keys.event)
    threading.Thread(target=earlier, name="earlier events", daemon=True).start()
    return forget


def main() -> None:
    """Run until a signal or the end of the parent."""
    options = _options()
    report, stop = Reporter(options.report), stop_event(options.report is not None)
    given = os.environ.pop(VARIABLE, None) or None  # child processes must not inherit it
    os.nice(NICENESS)
    share_arenas()
    logging.getLogger("websockets.server").setLevel(logging.CRITICAL)  # a browser that hangs up is no error
    try:
        token = chosen_token(None if options.no_token else given, none=options.no_token)
        server = open_page(options.host, options.port, token, options.name, visitors=options.visitors)
        client = TwinClient(options.endpoint, options.twin)
    except (OSError, ValueError) as error:
        report("refused", text=str(error))
        leave(BAD_INPUT)
        return
    viewer = Viewer(server, client, None if options.own_method is None else tuple(options.own_method))
    drawing = threading.Thread(target=viewer.run, name="viewer", daemon=True)
    drawing.start()
    freeze_setup()
    report("page", url=page_url(options.host, server.get_port(), token), port=server.get_port())
    await_stop(stop)
    viewer.stop()
    drawing.join(0.5)
    server.stop()
    client.close()
    leave(0)


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m motm_twin.ui.viewer", description=__doc__)
    parser.add_argument("--endpoint", default=f"tcp/{LOOPBACK}:{DEFAULT_PORT}", help="where the twin server listens")
    parser.add_argument("--twin", default=DEFAULT_TWIN, help="name in the keys")
    parser.add_argument("--host", default=LOOPBACK, help="address of the page")
    parser.add_argument("--no-token", action="store_true", help="anybody on this machine may look and drive")
    parser.add_argument("--name", action="append", default=[], help="further name under which browsers may ask")
    parser.add_argument("--port", type=int, default=8080, help="TCP port of the page, 0 takes any free one")
    parser.add_argument("--visitors", type=int, default=VISITORS, help="pages that may be open at once")
    parser.add_argument("--own-method", nargs=2, metavar=("NAME", "FILE.py:NAME"), help="method that is not shipped")
    parser.add_argument("--report", type=int, help=argparse.SUPPRESS)
    return parser.parse_args(sys.argv[1:])


if __name__ == "__main__":
    main()
