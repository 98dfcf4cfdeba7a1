"""Page benchmark: cost of the page to the control loop and the machine, and delays seen by its users."""

import itertools
import json
import logging
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import NamedTuple

import numpy as np
from rich.console import Console

from motm_twin.bus.client import TwinClient
from motm_twin.bus.commands import AddObstacle, Pause, RemoveBody, Speed
from motm_twin.bus.messages import TickMessage
from motm_twin.bus.publisher import memory_mb
from motm_twin.model.geometry import Array
from motm_twin.perf import page_reader
from motm_twin.perf.page_reader import PageReader
from motm_twin.perf.processes import Served, act, cpu_seconds, now, open_place, restart, served, ticks, wait_for
from motm_twin.perf.report import Limit, Report, Steps, conclude, measure, percentiles
from motm_twin.ui.export import export_html
from motm_twin.ui.history import History
from motm_twin.ui.hub import OFF_AT_FIRST
from motm_twin.ui.panel.panel import ASK
from motm_twin.ui.viewer import HistoryWriter

READERS = 5
DRAG_LENGTH, DRAG_POINTS, DRAG_INTERVAL = 0.3, 5, 0.05  # [m], number of points, [s] between two of them
ARRIVED = 0.05  # [m] from the end of a drag at which the body counts as arrived
BODY = "measured"
PANEL, JOIN = 20, 10.0  # least number of widgets of a whole panel, and time [s] until they have arrived
SETTLE = 2.5  # [s] until the memory of closed pages is given back
PIECES = 8  # of each half of a memory series
SURE = 2.2  # standard errors for 95 % with 12 degrees of freedom (two lines through 8 pieces each)


def periods(served: Served, seconds: float, readers: int) -> tuple[list[float], float]:
    """Control periods [ms] of the first ``seconds`` of a run with this many readers, and bytes/s that each reads."""
    with ExitStack() as stack:
        connect = lambda: PageReader(served.port, token=served.token, decode=False)  # noqa: E731
        watchers = [stack.enter_context(connect()) for _ in range(readers)]
        restart(served.client, playing=True)
        before, began = [watcher.bytes for watcher in watchers], time.monotonic()
        found = [tick.stage_ms["period"] for tick in ticks(served.client, seconds)]
        spent = time.monotonic() - began
        rates = [(watcher.bytes - start) / spent for watcher, start in zip(watchers, before, strict=True)]
    return found, float(np.mean(rates)) if rates else 0.0


@contextmanager
def all_layers(reader: PageReader) -> Iterator[None]:
    """Context in which every layer of the page is on, switched as its legend does."""
    if not reader.wait(lambda reader: reader.find(ASK), 20.0):
        raise TimeoutError("no legend within 20 s")
    reader.set(ASK, json.dumps([1, "hide", []]))
    try:
        yield
    finally:
        reader.set(ASK, json.dumps([2, "hide", sorted(OFF_AT_FIRST)]))


def drawing(served: Served, report: Report, seconds: float) -> None:
    """Measure the viewer's share of a core at 1x with all layers on, and the number of scene nodes that it moves."""
    with PageReader(served.port, token=served.token) as reader:
        restart(served.client, playing=True)
        with all_layers(reader):
            time.sleep(2.0)
            reader.moved()
            used, read, began = cpu_seconds(served.viewer), reader.bytes, time.monotonic()
            time.sleep(seconds)
            spent = time.monotonic() - began
            share = (cpu_seconds(served.viewer) - used) / spent
            report.values.update(share=100.0 * share, nodes=float(reader.moved()))
            report.details["bytes_per_s_all_layers"] = (reader.bytes - read) / spent


def _whole(reader: PageReader) -> bool:
    """True when a new visitor has the whole scene and its own panel."""
    return reader.replayed is not None and len(reader.options("Scene")) > 1


def joining(served: Served, report: Report) -> None:
    """Measure the longest time [s] that a late joiner waits for the whole scene and its own panel."""
    restart(served.client, playing=True)
    waits = []
    for _ in range(JOINERS):
        with PageReader(served.port, token=served.token) as reader:
            whole = reader.wait(_whole, 30.0)
            waits.append(time.monotonic() - reader.started if whole else float("nan"))
    report.values["join_s"] = float(np.max(waits))


def loading(served: Served, report: Report) -> None:
    """Measure a first load: bytes by websocket until a visitor has everything and by HTTP, time to final picture."""
    restart(served.client, playing=False)
    with PageReader(served.port, token=served.token) as reader:
        if not reader.wait(_whole, 30.0):
            raise TimeoutError("no whole scene within 30 s")
        time.sleep(1.0)  # until the rest of the panel has arrived
        by_websocket = float(reader.bytes)
    load = page_reader.first_load(served.url)
    report.values.update(load_mb=(load.http_bytes + by_websocket) / 1e6, picture_s=load.complete_at)
    report.details["first_load_mb"] = {"http": load.http_bytes / 1e6, "websocket": by_websocket / 1e6}


def drags(served: Served, report: Report) -> None:
    """Measure the time [ms] from sending the end of a drag to the tick with the body there, while time runs."""
    client = served.client
    restart(client, playing=True)
    x, y = open_place(client)
    act(client, AddObstacle(name=BODY, shape="box", x=x, y=y, heading=0.0, size=(0.3, 0.3, 0.4)))
    waits = []
    with PageReader(served.port, token=served.token) as reader:
        ours = lambda: next((node for node in reader.draggable if node.endswith(f"/{BODY}")), None)  # noqa: E731
        node = wait_for(ours, 20.0, "handle to drag the box by")
        for sign in itertools.islice(itertools.cycle((1.0, -1.0)), DRAGS):
            waits.append(1000.0 * _one_drag(client, reader, node, sign))
    act(client, RemoveBody(name=BODY))
    report.values["drag_p95_ms"] = float(np.percentile(waits, 95))  # nan when one never arrived
    report.details["drag_ms"] = {"p50": float(np.median(waits)), "max": float(np.max(waits)), "drags": len(waits)}


def _one_drag(client: TwinClient, reader: PageReader, node: str, sign: float) -> float:
    begin = _place(now(client))
    way = np.linspace(0.0, DRAG_LENGTH, DRAG_POINTS + 1)[1:, None] * [[sign, 0.0, 0.0]]
    grip = np.array([*begin, 0.0])
    sent = reader.drag(node, grip, grip + way, DRAG_INTERVAL)
    end = begin[0] + sign * DRAG_LENGTH
    seen, deadline = 0, sent + 5.0
    while sign * (_place(now(client))[0] - end) < -ARRIVED:
        seen = client.wait_tick(seen, 0.2)
        if time.monotonic() > deadline:
            return float("nan")
    return time.monotonic() - sent


def memory(served: Served, minutes: float, page: Callable[[], float] | None = None) -> dict[str, Array]:
    """Memory [MB] of the viewer and of the page (measured by ``page``) against time [min] during successive runs.

    One run at 8x before that fills everything of limited size: the kept history, the snapshots, the caches.
    """
    client = served.client
    restart(client, playing=True)
    act(client, Speed(factor=8.0))
    wait_for(lambda: now(client).done, 600.0, "end of the run")
    restart(client, playing=True)
    began, rows = time.monotonic(), []
    while (spent := (time.monotonic() - began) / 60.0) < minutes:
        if now(client).done:
            restart(client, playing=True)
        rows.append((spent, memory_mb(served.viewer), page() if page is not None else float("nan")))
        time.sleep(EVERY)
    time_min, viewer, heap = np.array(rows).T
    return {"time": time_min, "viewer": viewer, "page": heap}


def visits(served: Served, report: Report, most: int) -> None:
    """Measure the viewer's memory [MB] after up to ``most`` pages in succession that break off with a whole panel.

    The twin is paused. The first page has a row of its own: after it has gone, memory from the viewer's start is given
    back.
    """
    logging.getLogger("websockets.client").setLevel(logging.CRITICAL)  # it would log every broken connection
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
    report.values["visits_mb"] = rows[most] - rows[1]
    report.details["viewer_mb_after_visits"] = {str(number): value for number, value in rows.items()}


class Slope(NamedTuple):
    """Slope of a line through values [unit/min], and its standard error."""

    value: float
    error: float


def slopes(time_min: Array, value: Array) -> tuple[Slope, Slope]:
    """Slopes of the first and second half of a series, each from the medians of `PIECES` pieces.

    Neighbouring values are correlated, so the error of a line through all of them would be far too small.
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
    """Lower 95 % bound of the rise of the slope [unit/min]; at most 0 where the rise may be chance."""
    return late.value - early.value - SURE * float(np.hypot(early.error, late.error))


def _place(tick: TickMessage) -> tuple[float, float]:
    body = next((body for body in tick.obstacles if body.name == BODY), None)
    if body is None:
        raise RuntimeError("the measured box is gone")
    return body.position[0], body.position[1]


NAME = "page"
TITLE = "The page: a served Experiment 2 at 1x, measured from outside"
DRAGS, JOINERS = 60, 5
MOTION, EXPORTED = 5.0, 40.0  # [s]
EVERY = 2.0  # [s] between two measurements of memory
THINNED = 15  # every 15th value of memory is kept: one in 30 s

LIMITS = {
    "ratio": Limit(name="control period p99 with 5 readers / without", unit="x", limit=1.1, decimals=3),
    "share": Limit(name="viewer at 1x, all layers on", unit="% of a core", limit=60.0, decimals=1),
    "nodes": Limit(name="moving scene nodes", unit="", limit=100.0, decimals=0),
    "load_mb": Limit(name="bytes of a first load", unit="MB", limit=4.0, decimals=2),
    "picture_s": Limit(name="first complete picture, software rendering", unit="s", limit=8.0, decimals=1),
    "join_s": Limit(name="late joiner has the whole scene", unit="s", limit=2.0, decimals=2),
    "pose_rate": Limit(
        name="frames with a changed robot pose per second", unit="1/s", limit=50.0, relation=">=", decimals=1
    ),
    "export_mb": Limit(name="ten minutes of exp2 as one exported page", unit="MB", limit=20.0, decimals=1),
    "drag_p95_ms": Limit(name="end of a drag until the tick that shows it, p95", unit="ms", limit=100.0, decimals=0),
    "viewer_slope": Limit(name="memory of the viewer, slope", unit="MB/min", limit=1.0, decimals=2),
    "page_slope": Limit(name="memory of the page's scripts, slope", unit="MB/min", limit=1.0, decimals=2),
    "viewer_rise": Limit(
        name="memory of the viewer, rise of the slope, for sure", unit="MB/min", limit=0.0, decimals=2
    ),
    "page_rise": Limit(name="memory of the page's scripts, rise of the slope", unit="MB/min", limit=0.0, decimals=2),
    "visits_mb": Limit(name="memory of the viewer, after pages that broke off", unit="MB", limit=5.0, decimals=1),
    "stop_s": Limit(name="Ctrl-C until all has ended", unit="s", limit=2.0, decimals=2),
}


def bench_page(out: Path, seconds: float, minutes: float, pages: int, console: Console) -> bool:
    """Measure, print, write ``out/page.json``; True when no number exceeds its limit.

    ``pages``: number of pages that connect and break off. Takes about 2.5 x ``seconds`` + ``minutes`` + 4 min, and
    2 min for 1,000 pages.
    """
    console.print(f"\n[bold]{NAME}[/bold]: {TITLE}")
    report = Report()
    with served("exp2") as twin:
        steps: Steps = [
            ("control period", lambda: _periods(twin, report, seconds)),
            ("drawing", lambda: drawing(twin, report, min(seconds, 20.0))),
            ("drags", lambda: drags(twin, report)),
            ("late joiners", lambda: joining(twin, report)),
            ("first load", lambda: loading(twin, report)),
            ("motion", lambda: _motion(twin, report)),
            ("export", lambda: _exporting(twin, report)),
            ("visits", lambda: visits(twin, report, pages)),
            ("memory", lambda: _memory(twin, report, minutes)),
            ("stop", lambda: report.values.update(stop_s=twin.interrupt())),
        ]
        measure(steps, report, console)
    return conclude(NAME, TITLE, LIMITS, report, out, console)


def _periods(twin: Served, report: Report, seconds: float) -> None:
    """Measure the start of a run four times: without, with, with, without readers, so that a drift cancels."""
    found: dict[int, list[float]] = {0: [], READERS: []}
    rates = []
    periods(twin, 3.0, 0)  # warm
    for readers in (0, READERS, READERS, 0):
        took, rate = periods(twin, seconds / 2, readers)
        found[readers] += took
        rates += [rate] if readers else []
    without, with_readers = (percentiles(values) for values in found.values())
    report.values["ratio"] = with_readers["p99"] / without["p99"]
    report.details["period_ms"] = {"0 readers": without, f"{READERS} readers": with_readers}
    report.details["bytes_per_s_and_reader"] = float(np.mean(rates))


def _motion(twin: Served, report: Report) -> None:
    """Measure the smoothness of motion in a small window with little to draw, so that drawing is fast enough."""
    with page_reader.browser() as browser:
        display, drawn, changed = browser.motion(twin.url, MOTION, lambda: restart(twin.client, playing=True))
    report.values["pose_rate"] = changed
    report.details["frames_per_s"] = {"display": display, "pictures drawn": drawn, "with a changed pose": changed}
    if drawn < LIMITS["pose_rate"].limit:
        report.skipped["pose_rate"] = f"this machine draws {drawn:.0f} pictures a second"


def _exporting(twin: Served, report: Report) -> None:
    """Measure the sizes [MB] of exported pages of a short and a longer run; a line through them gives ten minutes."""
    history = History()
    writer = HistoryWriter(twin.client, history)
    restart(twin.client, playing=True)
    time.sleep(EXPORTED)
    writer.stop()
    scene = twin.client.scene()
    if scene is None:
        raise RuntimeError("the twin has no scene")
    short, whole = (len(export_html(history, scene, seconds)) / 1e6 for seconds in (1.0, EXPORTED))
    report.values["export_mb"] = short + (whole - short) * 600.0 / (EXPORTED - 1.0)
    report.details["exported_mb"] = {"1 s": short, f"{EXPORTED:.0f} s": whole}


def _memory(twin: Served, report: Report, minutes: float) -> None:
    """Measure memory, with a browser that shows the page all the time if there is one."""
    try:
        with page_reader.browser() as browser:
            browser.page.goto(twin.url)
            series = memory(twin, minutes, browser.heap_mb)
    except RuntimeError as error:
        report.failures.append(f"memory of the page: {error}")
        series = memory(twin, minutes)
    for name in ("viewer", "page"):
        values = series[name]
        early, late = slopes(series["time"], values)
        report.values |= {f"{name}_slope": late.value, f"{name}_rise": rise(early, late)}
        report.details[f"memory_of_{name}_mb"] = {
            **{"start": float(values[0]), "end": float(values[-1]), "max": float(values.max())},
            **{"slope of the first half": early.value, "error of the first half": early.error},
            **{"slope of the second half": late.value, "error of the second half": late.error},
        }
    report.series = {name: values[::THINNED].tolist() for name, values in series.items()}
    report.details["memory_minutes"] = minutes
    act(twin.client, Pause())
