"""Puts the loop's results on Zenoh, and answers queries for the last of each."""

import threading
import time
from collections.abc import Callable

import msgspec
import numpy as np
import zenoh

from motm_twin.bus.encode import grid_bytes, grid_info
from motm_twin.bus.keys import Keys
from motm_twin.bus.messages import StatusMessage, TickMessage
from motm_twin.control.tick import Tick
from motm_twin.model.scene import Scene
from motm_twin.perception.world_map import WorldMap

GRID_INTERVAL = 0.25  # [s] the grid is sent on change, at most four times a second
GRID_REFRESH = 2.0  # [s] unchanged, it is sent again this often, for subscribers that came late


class Publisher:
    """A Sink that publishes. Slow readers never hold it up: what they can not take for seconds is dropped for them."""

    def __init__(self, session: zenoh.Session, keys: Keys, status: Callable[[], StatusMessage]) -> None:
        self._status, self._encode = status, msgspec.json.Encoder().encode
        self._lock = threading.Lock()
        self._last: dict[str, tuple[bytes, bytes | None]] = {}  # key: payload, attachment
        self._declared: list[zenoh.Publisher | zenoh.Queryable] = []
        self._publishers = {}
        for key in (keys.tick, keys.grid, keys.scene, keys.status):
            drop = zenoh.CongestionControl.BLOCK if key == keys.scene else zenoh.CongestionControl.DROP
            encoding = zenoh.Encoding.ZENOH_BYTES if key == keys.grid else zenoh.Encoding.APPLICATION_JSON
            # Not express: ticks that have to wait for a slow reader then share the batches of the send queue.
            publisher = session.declare_publisher(key, encoding=encoding, congestion_control=drop)
            self._publishers[key] = publisher
            queryable = session.declare_queryable(key, self._answer)
            self._declared += [publisher, queryable]
        self._keys = keys
        self._sent_map: WorldMap | None = None
        self._sent_run = -1
        self._sent_at = 0.0

    def tick(self, message: TickMessage, tick: Tick, last: bool) -> None:
        """Send a period, and the grid when it changed (and the last one is old enough) or was not sent for long."""
        self._put(self._keys.tick, self._encode(message))
        new_run, age = message.run != self._sent_run, time.monotonic() - self._sent_at
        due = age >= GRID_REFRESH or ((last or new_run or age >= GRID_INTERVAL) and self._changed(tick.map, new_run))
        if due:
            self._sent_map, self._sent_run, self._sent_at = tick.map, message.run, time.monotonic()
            self._put(self._keys.grid, grid_bytes(tick.map), self._encode(grid_info(tick.map, message.run)))

    def scene(self, scene: Scene) -> None:
        """Send the resolved scene."""
        self._put(self._keys.scene, self._encode(scene))

    def status(self) -> None:
        """Send the state of the server."""
        self._put(self._keys.status, self._encode(self._status()))

    def close(self) -> None:
        """Withdraw everything."""
        for declared in self._declared:
            declared.undeclare()

    def _changed(self, world: WorldMap, new_run: bool) -> bool:
        sent = self._sent_map
        if sent is None or new_run:
            return True
        return not (np.array_equal(sent.occupied, world.occupied) and np.array_equal(sent.proximity, world.proximity))

    def _put(self, key: str, payload: bytes, attachment: bytes | None = None) -> None:
        with self._lock:
            self._last[key] = (payload, attachment)
        self._publishers[key].put(payload, attachment=attachment)

    def _answer(self, query: zenoh.Query) -> None:
        with query:
            if self._keys.status == str(query.key_expr):
                query.reply(query.key_expr, self._encode(self._status()))
                return
            with self._lock:
                found = self._last.get(str(query.key_expr))
            if found is not None:
                query.reply(query.key_expr, found[0], attachment=found[1])
