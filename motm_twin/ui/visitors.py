"""Who is here: a desk for every browser page, made when it connects and forgotten when it is gone."""

import threading
import traceback

import viser

from motm_twin.ui.desk import Desk
from motm_twin.ui.hub import Hub, Shown
from motm_twin.ui.stage import Stage


class Visitors:
    """Keeps one `Desk` per connected browser page up to date."""

    def __init__(self, server: viser.ViserServer, hub: Hub, stage: Stage) -> None:
        self._hub, self._stage = hub, stage
        self._lock = threading.Lock()
        self._desks: dict[int, Desk] = {}
        server.on_client_connect(self._enter)
        server.on_client_disconnect(self._leave)

    def update(self, shown: Shown) -> None:
        """Bring every desk up to date; one that fails does not stop the others."""
        with self._lock:
            desks = list(self._desks.values())
        for desk in desks:
            try:
                desk.update(shown)
            except Exception as error:
                traceback.print_exc()
                self._hub.tell(desk.visitor, f"{type(error).__name__}: {error}", "The panel has an error", "red")

    async def _enter(self, client: viser.ClientHandle) -> None:
        visitor = self._hub.enter(client)
        desk = Desk(self._hub, visitor, self._stage)
        with self._lock:
            self._desks[client.client_id] = desk

    async def _leave(self, client: viser.ClientHandle) -> None:
        with self._lock:
            self._desks.pop(client.client_id, None)
        visitor = self._hub.leave(client)
        if visitor is not None:
            self._stage.leave(visitor)
