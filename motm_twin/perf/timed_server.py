"""A twin server to measure: as `server_process`, with a clock round the cost of publishing to the loop."""

import functools
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from motm_twin.bus.commands import Load
from motm_twin.bus.interfaces import TwinSetup
from motm_twin.bus.library import FileLibrary
from motm_twin.bus.server import TwinServer
from motm_twin.memory import share_arenas
from motm_twin.perf.worker import Works
from motm_twin.planning.types import SearchBudget
from motm_twin.server_process import SEARCH_SECONDS, make_twin


class TimedSink:
    """Times of the loop's calls of the publisher, in the loop's own thread."""

    def __init__(self, server: TwinServer) -> None:
        self._took: list[tuple[float, float]] = []  # [s] per call of `tick`: by the clock, and of the processor
        self._lock = threading.Lock()
        server.tick = self._timed(server.tick)

    def taken(self) -> list[tuple[float, float]]:
        """Times [s] since the last question: what passed, and what the thread computed, not waiting for its turn."""
        with self._lock:
            taken, self._took = self._took, []
        return taken

    def _timed(self, call: Callable[..., None]) -> Callable[..., None]:
        def timed(*arguments: Any, **named: Any) -> None:
            began, computed = time.perf_counter(), time.thread_time()
            call(*arguments, **named)
            took = time.perf_counter() - began, time.thread_time() - computed
            with self._lock:
                self._took.append(took)

        return timed


def clock_offset(server: TwinServer) -> float:
    """Server time minus monotonic time [s], which all processes of a machine share; the best of some readings."""
    readings = []
    for _ in range(20):
        before = time.monotonic()
        status = server.loop.status()
        after = time.monotonic()
        readings.append((after - before, status.server_time - (before + after) / 2))
    return min(readings)[1]


def timed_twin(scene: str, data: str) -> tuple[dict[str, Any], Works]:
    """Role of a paused twin server; ``data``: folder of recordings."""
    share_arenas()
    library = FileLibrary(scene)
    server = TwinServer(
        TwinSetup(
            library=library,
            make_twin=functools.partial(make_twin, budget=SearchBudget(seconds=SEARCH_SECONDS)),
            first=Load(scene=library.own_name),
            playing=False,
        ),
        data=Path(data),
    )
    sink = TimedSink(server)
    server.start()
    while server.loop.status().state == "loading":
        time.sleep(0.05)
    hello = {"endpoint": server.endpoint, "clock": clock_offset(server), "state": server.loop.status().text}
    return hello, {"sink": sink.taken, "close": server.close}
