"""What the page costs: the control period, the viewer's processor time and memory, how soon a drag arrives."""

import itertools
import logging
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from typing import NamedTuple

import numpy as np

from motm_twin.bench.page_client import PageReader
from motm_twin.bench.page_serve import Served, cpu_seconds, memory_mb, wait_for
from motm_twin.bus.client import TwinClient
from motm_twin.bus.commands import AddObstacle, Command, HandOver, Pause, Play, RemoveBody, Reset, Speed
from motm_twin.bus.messages import TickMessage
from motm_twin.model.geometry import Array
from motm_twin.ui.hub import LAYERS

READERS = 5
DRAG_LENGTH, DRAG_POINTS, DRAG_INTERVAL = 0.3, 5, 0.05  # [m], points, [s] between two of them
ARRIVED = 0.05  # [m] short of the end of a drag still counts as there
BODY = "measured"
DRIVEN = "is driving"  # what a refusal says while somebody else has the wheel
PIECES = 8  # of half a series of memory
SURE = 2.2  # standard errors: 95 % with 12 degrees of freedom, those of two lines through 8 pieces
PANEL, JOIN = 20, 10.0  # widgets that a panel has at least, and time [s] for them to come
SETTLE = 2.5  # [s] until the memory of pages that have left is given back
WHEEL = 15.0  # [s] to wait for the wheel


def act(client: TwinClient, command: Command) -> None:
    """Send a command and let go of the wheel, so that a page may take it. Raises RuntimeError when it is refused."""
    deadline = time.monotonic() + WHEEL
    while not (answer := client.command(command)).ok:
        if DRIVEN not in answer.reason or time.monotonic() > deadline:
            raise RuntimeError(f"{command!r} was refused: {answer.reason}")
        time.sleep(0.1)  # a page has the wheel until it has been silent for a while
    client.command(HandOver())


def restart(client: TwinClient, *, playing: bool) -> None:
    """The run from its start at 1x."""
    act(client, Pause())
    act(client, Reset())
    wait_for(lambda: _now(client).index <= 1, 60.0, "start of the run")
    act(client, Speed(factor=1.0))
    if playing:
        act(client, Play())
        wait_for(lambda: _now(client).index > 1, 60.0, "period after the start")


def periods(served: Served, seconds: float, readers: int) -> tuple[list[float], float]:
    """Control periods [ms] of the first ``seconds`` of a run with this many readers, and bytes/s that each reads."""
    with ExitStack() as stack:
        watchers = [
            stack.enter_context(PageReader(served.port, token=served.token, decode=False)) for _ in range(readers)
        ]
        restart(served.client, playing=True)
        before, began = [watcher.bytes for watcher in watchers], time.monotonic()
        found = [tick.stage_ms["period"] for tick in ticks(served.client, seconds)]
        spent = time.monotonic() - began
        rates = [(watcher.bytes - start) / spent for watcher, start in zip(watchers, before, strict=True)]
    return found, float(np.mean(rates)) if rates else 0.0


def ticks(client: TwinClient, seconds: float) -> Iterator[TickMessage]:
    """Every new tick for so long [s of wall time]; ends early with the run."""
    deadline, seen, last = time.monotonic() + seconds, 0, -1
    while time.monotonic() < deadline:
        seen = client.wait_tick(seen, 0.2)
        tick = _now(client)
        if tick.index != last and not tick.preview:
            last = tick.index
            yield tick
        if tick.done:
            return


@contextmanager
def all_layers(reader: PageReader) -> Iterator[None]:
    """Every layer of the page switched on, by its checkbox, for as long as the block runs."""
    if not reader.wait(lambda reader: all(reader.find(name, "Checkbox") for name in LAYERS), 20.0):
        missing = [name for name in LAYERS if not reader.find(name, "Checkbox")]
        raise TimeoutError(f"no checkbox for {missing} within 20 s")
    before = {name: bool(reader.widgets[reader.find(name, "Checkbox") or ""]["value"]) for name in LAYERS}
    for name in LAYERS:
        reader.set(name, True, "Checkbox")
    try:
        yield
    finally:
        for name, value in before.items():
            reader.set(name, value, "Checkbox")


def drawing(served: Served, seconds: float) -> dict[str, float]:
    """Share of a core the viewer takes at 1x with all layers on, and how many scene nodes it moves meanwhile."""
    with PageReader(served.port, token=served.token) as reader:
        restart(served.client, playing=True)
        with all_layers(reader):
            time.sleep(2.0)
            reader.moved()
            used, read, began = cpu_seconds(served.viewer), reader.bytes, time.monotonic()
            time.sleep(seconds)
            spent = time.monotonic() - began
            share = (cpu_seconds(served.viewer) - used) / spent
            return {"share": share, "nodes": float(reader.moved()), "rate": (reader.bytes - read) / spent}


def joining(served: Served, count: int) -> list[float]:
    """How long [s] each of so many late joiners waits for the whole scene and its own panel."""
    restart(served.client, playing=True)
    waits = []
    for _ in range(count):
        with PageReader(served.port, token=served.token) as reader:
            whole = reader.wait(lambda reader: reader.replayed is not None and reader.find("Pause"), 30.0)
            waits.append(time.monotonic() - reader.started if whole else float("nan"))
    return waits


def scene_bytes(served: Served) -> float:
    """Bytes that the websocket sends a new visitor until he has everything; the twin should be paused."""
    with PageReader(served.port, token=served.token) as reader:
        if not reader.wait(lambda reader: reader.replayed is not None and reader.find("Play"), 30.0):
            raise TimeoutError("no whole scene within 30 s")
        time.sleep(1.0)  # the last of the panel
        return float(reader.bytes)


def drags(served: Served, count: int) -> list[float]:
    """From sending the end of a drag to the tick [s] in which the body is there, so many times, while time runs."""
    client = served.client
    restart(client, playing=True)
    start = _open_place(client)
    act(client, AddObstacle(name=BODY, shape="box", x=start[0], y=start[1], heading=0.0, size=(0.3, 0.3, 0.4)))
    waits = []
    with PageReader(served.port, token=served.token) as reader:
        ours = lambda: next((node for node in reader.draggable if node.endswith(f"/{BODY}")), None)  # noqa: E731
        node = wait_for(ours, 20.0, "handle to drag the box by")
        for sign in itertools.islice(itertools.cycle((1.0, -1.0)), count):
            waits.append(_one_drag(client, reader, node, sign))
    act(client, RemoveBody(name=BODY))
    return waits


def _one_drag(client: TwinClient, reader: PageReader, node: str, sign: float) -> float:
    begin = _place(_now(client))
    way = np.linspace(0.0, DRAG_LENGTH, DRAG_POINTS + 1)[1:, None] * [[sign, 0.0, 0.0]]
    grip = np.array([*begin, 0.0])
    sent = reader.drag(node, grip, grip + way, DRAG_INTERVAL)
    end = begin[0] + sign * DRAG_LENGTH
    seen, deadline = 0, sent + 5.0
    while sign * (_place(_now(client))[0] - end) < -ARRIVED:
        seen = client.wait_tick(seen, 0.2)
        if time.monotonic() > deadline:
            return float("nan")
    return time.monotonic() - sent


def memory(
    served: Served, minutes: float, page: Callable[[], float] | None = None, every: float = 2.0
) -> dict[str, Array]:
    """Memory [MB] of the viewer, and of the page that ``page`` asks, against time [min], while runs follow each other.

    Before, one run at 8x fills what has a limit: the kept history, the snapshots, the caches.
    """
    client = served.client
    restart(client, playing=True)
    act(client, Speed(factor=8.0))
    wait_for(lambda: _now(client).done, 600.0, "end of the run")
    restart(client, playing=True)
    began, rows = time.monotonic(), []
    while (spent := (time.monotonic() - began) / 60.0) < minutes:
        if _now(client).done:
            restart(client, playing=True)
        rows.append((spent, memory_mb(served.viewer), page() if page is not None else float("nan")))
        time.sleep(every)
    time_min, viewer, heap = np.array(rows).T
    return {"time": time_min, "viewer": viewer, "page": heap}


def visits(served: Served, most: int) -> dict[int, float]:
    """Memory [MB] of the viewer after so many pages in all, one after the other, that break off with a whole panel.

    Time stands. The first page has a row of its own: once it has left, what the start of the viewer needed is given
    back.
    """
    logging.getLogger("websockets.client").setLevel(logging.CRITICAL)  # it is surprised by what breaks off
    act(served.client, Pause())
    rows: dict[int, float] = {}
    done = 0
    for count in sorted({1, most // 4, most // 2, most} - {0}):
        for _ in range(done, count):
            reader = PageReader(served.port, token=served.token)
            reader.wait(lambda page: page.replayed is not None and len(page.widgets) > PANEL, JOIN)
            reader.abort()
        time.sleep(SETTLE)
        done, rows[count] = count, memory_mb(served.viewer)
    return rows


class Slope(NamedTuple):
    """Slope of a line through values [unit/min], and its standard error."""

    value: float
    error: float


def slopes(time_min: Array, value: Array) -> tuple[Slope, Slope]:
    """Of the first and of the second half of a series, each from the medians of `PIECES` pieces of it.

    Neighbouring values are alike, so that the error of a line through all of them would be far too small.
    """
    halves = [time_min < 0.5 * time_min[-1], time_min >= 0.5 * time_min[-1]]
    early, late = (_slope(time_min[half], value[half]) for half in halves)
    return early, late


def _slope(time_min: Array, value: Array) -> Slope:
    if len(value) < PIECES or not np.isfinite(value).all():
        return Slope(np.nan, np.nan)
    x = [piece.mean() for piece in np.array_split(time_min, PIECES)]
    y = [np.median(piece) for piece in np.array_split(value, PIECES)]
    line, spread = np.polyfit(x, y, 1, cov=True)
    return Slope(float(line[0]), float(np.sqrt(spread[0, 0])))


def rise(early: Slope, late: Slope) -> float:
    """By how much the slope has risen at least [unit/min], with 95 %; at most 0 where it falls or may be chance."""
    return late.value - early.value - SURE * float(np.hypot(early.error, late.error))


def _now(client: TwinClient) -> TickMessage:
    tick = client.tick()
    if tick is None:
        raise RuntimeError("the twin has not run yet")
    return tick


def _place(tick: TickMessage) -> tuple[float, float]:
    body = next((body for body in tick.obstacles if body.name == BODY), None)
    if body is None:
        raise RuntimeError("the measured box is gone")
    return body.position[0], body.position[1]


def _open_place(client: TwinClient) -> tuple[float, float]:
    """A corner of the map, where the box is in nobody's way."""
    scene = client.scene()
    if scene is None:
        raise RuntimeError("the twin has no scene yet")
    x_min, y_min, _, _ = scene.bounds
    return x_min + 1.0, y_min + 1.0
