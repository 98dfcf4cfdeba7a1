"""The numbers of the page: what drawing costs the control loop and the machine, and how soon things are seen."""

import argparse
from pathlib import Path

import numpy as np
from rich.console import Console

from motm_twin.bench import page_browser, page_measures
from motm_twin.bench.page_serve import Served, served
from motm_twin.bench.report import Limit, Report, Steps, Values, conclude, measure
from motm_twin.bus.commands import Pause

NAME = "page"
TITLE = "The page: a served Experiment 2 at 1x, measured from outside"
DRAGS, JOINERS = 60, 5
THINNED = 15  # one value of the memory in so many is kept: one in 30 s

LIMITS = {
    "ratio": Limit(name="control period p99 with 5 readers / without", unit="x", limit=1.1, decimals=3),
    "share": Limit(name="viewer at 1x, all layers on", unit="% of a core", limit=60.0, decimals=1),
    "nodes": Limit(name="moving scene nodes", unit="", limit=100.0, decimals=0),
    "load_mb": Limit(name="bytes of a first load", unit="MB", limit=4.0, decimals=2),
    "picture_s": Limit(name="first complete picture, software rendering", unit="s", limit=8.0, decimals=1),
    "join_s": Limit(name="late joiner has the whole scene", unit="s", limit=2.0, decimals=2),
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


def bench_page(out: Path, seconds: float, minutes: float, visits: int, console: Console) -> bool:
    """Measure, print, write ``out/page.json``; True when no number exceeds its limit.

    ``visits``: pages that come and break off. Takes about 2.5 x ``seconds`` + ``minutes`` + 2 min, and 2 min for 1,000
    visits.
    """
    console.print(f"\n[bold]{NAME}[/bold]: {TITLE}")
    report = Report()
    with served("exp2") as twin:
        steps: Steps = [
            ("control period", lambda: _periods(twin, report, seconds)),
            ("drawing", lambda: _drawing(twin, report, min(seconds, 20.0))),
            ("drags", lambda: _drags(twin, report)),
            ("late joiners", lambda: _joining(twin, report)),
            ("first load", lambda: _loading(twin, report)),
            ("visits", lambda: _visits(twin, report, visits)),
            ("memory", lambda: _memory(twin, report, minutes)),
            ("stop", lambda: report.values.update(stop_s=twin.interrupt())),
        ]
        measure(steps, report, console)
    return conclude(NAME, TITLE, LIMITS, report, out, console)


def _periods(twin: Served, report: Report, seconds: float) -> None:
    """The start of a run four times: without, with, with, without readers, so that a drift of the machine cancels."""
    found: dict[int, list[float]] = {0: [], page_measures.READERS: []}
    rates = []
    page_measures.periods(twin, 3.0, 0)  # warm
    for readers in (0, page_measures.READERS, page_measures.READERS, 0):
        periods, rate = page_measures.periods(twin, seconds / 2, readers)
        found[readers] += periods
        rates += [rate] if readers else []
    without, with_readers = (_percentiles(values) for values in found.values())
    report.values["ratio"] = with_readers["p99"] / without["p99"]
    report.details["period_ms"] = {"0 readers": without, f"{page_measures.READERS} readers": with_readers}
    report.details["bytes_per_s_and_reader"] = float(np.mean(rates))


def _percentiles(values: list[float]) -> Values:
    p50, p99 = np.percentile(values, (50, 99))
    return {"p50": float(p50), "p99": float(p99), "max": float(max(values)), "periods": float(len(values))}


def _drawing(twin: Served, report: Report, seconds: float) -> None:
    cost = page_measures.drawing(twin, seconds)
    report.values.update(share=100.0 * cost["share"], nodes=cost["nodes"])
    report.details["bytes_per_s_all_layers"] = cost["rate"]


def _drags(twin: Served, report: Report) -> None:
    waits = 1000.0 * np.array(page_measures.drags(twin, DRAGS))
    report.values["drag_p95_ms"] = float(np.percentile(waits, 95))  # nan when one never arrived
    report.details["drag_ms"] = {"p50": float(np.median(waits)), "max": float(np.max(waits)), "drags": len(waits)}


def _joining(twin: Served, report: Report) -> None:
    report.values["join_s"] = float(np.max(page_measures.joining(twin, JOINERS)))


def _loading(twin: Served, report: Report) -> None:
    page_measures.restart(twin.client, playing=False)
    by_websocket = page_measures.scene_bytes(twin)
    load = page_browser.first_load(twin.url)
    report.values.update(load_mb=(load.http_bytes + by_websocket) / 1e6, picture_s=load.complete_at)
    report.details["first_load_mb"] = {"http": load.http_bytes / 1e6, "websocket": by_websocket / 1e6}


def _visits(twin: Served, report: Report, count: int) -> None:
    rows = page_measures.visits(twin, count)
    report.values["visits_mb"] = rows[count] - rows[1]
    report.details["viewer_mb_after_visits"] = {str(number): value for number, value in rows.items()}


def _memory(twin: Served, report: Report, minutes: float) -> None:
    """With a browser that shows the page all the time, where there is one."""
    try:
        with page_browser.browser() as browser:
            browser.page.goto(twin.url)
            series = page_measures.memory(twin, minutes, browser.heap_mb)
    except RuntimeError as error:
        report.failures.append(f"memory of the page: {error}")
        series = page_measures.memory(twin, minutes)
    for name in ("viewer", "page"):
        values = series[name]
        early, late = page_measures.slopes(series["time"], values)
        report.values |= {f"{name}_slope": late.value, f"{name}_rise": page_measures.rise(early, late)}
        report.details[f"memory_of_{name}_mb"] = {
            "start": float(values[0]),
            "end": float(values[-1]),
            "max": float(values.max()),
            "slope of the first half": early.value,
            "error of the first half": early.error,
            "slope of the second half": late.value,
            "error of the second half": late.error,
        }
    report.series = {name: values[::THINNED].tolist() for name, values in series.items()}
    report.details["memory_minutes"] = minutes
    page_measures.act(twin.client, Pause())


def add_options(parser: argparse.ArgumentParser) -> None:
    """Options of this group."""
    parser.add_argument(
        "--seconds", type=float, default=60.0, help="page, bus, scale: of each measurement (default 60)"
    )
    parser.add_argument("--visits", type=int, default=1000, help="page: that come and break off (default 1,000)")
    parser.add_argument("--minutes", type=float, default=3.0, help="page: of the look at memory (default 3)")
