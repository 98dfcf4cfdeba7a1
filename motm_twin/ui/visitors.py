"""Who is here: a desk for every browser page, made when it connects and forgotten when it is gone."""

import threading
import time
import traceback
import warnings

import viser

from motm_twin.ui.desk import Desk
from motm_twin.ui.hub import Hub, Shown
from motm_twin.ui.stage import Stage

# A page may close while its panel is being updated; that is nothing to report.
warnings.filterwarnings("ignore", message="Queued a .* on a closed connection")

RETURN = 20.0  # [s] a page that connects this soon after another one left is taken for the same person


class Visitors:
    """Keeps one `Desk` per connected browser page up to date."""

    def __init__(self, server: viser.ViserServer, hub: Hub, stage: Stage) -> None:
        self._hub, self._stage = hub, stage
        self._lock = threading.Lock()
        self._desks: dict[int, Desk] = {}
        self._scene: tuple[str, str, int] | None = None
        self._left = -1e9  # [s] monotonic, when a page left whose visitor knows how to drive
        server.on_client_connect(self._enter)
        server.on_client_disconnect(self._leave)

    def update(self, shown: Shown) -> None:
        """Bring every desk up to date; one that fails does not stop the others."""
        self._hub.playback.advance(self._hub.span)
        self._forget_other_scenes(shown)
        with self._lock:
            desks = list(self._desks.values())
        for desk in desks:
            if desk.visitor.gone:
                continue
            try:
                desk.update(shown)
            except Exception as error:
                if desk.visitor.gone:  # it left meanwhile, and its widgets with it
                    continue
                traceback.print_exc()
                self._hub.tell(desk.visitor, f"{type(error).__name__}: {error}", "The panel has an error", "red")

    def _forget_other_scenes(self, shown: Shown) -> None:
        """A comparison is about one scene."""
        status = shown.status
        scene = None if status is None else (status.scene, status.variant, status.seed)
        if scene != self._scene and None not in (scene, self._scene):
            self._hub.what_if.stop()
        self._scene = scene or self._scene

    async def _enter(self, client: viser.ClientHandle) -> None:
        visitor = self._hub.enter(client)
        try:
            desk = Desk(self._hub, visitor, self._stage, new=time.monotonic() - self._left > RETURN)
        except Exception as error:
            traceback.print_exc()
            self._hub.tell(visitor, f"{type(error).__name__}: {error}", "There is no panel", "red")
            return
        with self._lock:
            self._desks[client.client_id] = desk

    async def _leave(self, client: viser.ClientHandle) -> None:
        with self._lock:
            desk = self._desks.pop(client.client_id, None)
        if desk is not None and desk.knows_how:
            self._left = time.monotonic()
        visitor = self._hub.leave(client)
        if visitor is not None:
            self._stage.leave(visitor)
