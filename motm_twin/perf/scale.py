"""Scale benchmark: twins and viewers that one Zenoh router carries on this machine, each with a real twin's load."""

import tempfile
import time
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from motm_twin.bus.publisher import memory_mb
from motm_twin.perf import bus
from motm_twin.perf.participants import Sizes
from motm_twin.perf.processes import Worker, cpu_seconds, restart
from motm_twin.perf.report import Report, Sheet, grid, load_average, machine, percentiles, write_report

NAME = "scale"
TITLE = "Scale: simulated twins at 1x through a Zenoh router, and who reads them"
COUNTS = (10, 50, 100, 200)
LINKED = 50  # twins at one router, their viewers at another
EACH = 50  # sessions in one process
OBSERVED = 20.0  # [s] of the real twin whose load is repeated
SETTLE = 3.0  # [s]
EACH_ALL, FLEET, NOBODY = "each all", "one status", "nobody"  # a viewer for each twin; one dashboard of all; none


@dataclass(frozen=True, kw_only=True)
class Load:
    """One measurement: number of twins, their readers, and the routers between."""

    twins: int
    readers: str = EACH_ALL
    routers: int = 1


def bench_scale(out: Path, seconds: float, console: Console) -> bool:
    """Measure, print, write ``out/scale.json``; True when everything could be measured.

    Takes about 8 x ``seconds`` + 2 min. There is no number to reach: what the figures mean is in docs/scale.md.
    """
    console.print(f"\n[bold]{NAME}[/bold]: {TITLE}")
    report, rows = Report(), []
    sizes = observed(min(seconds, OBSERVED))
    console.print(rate_table(sizes))
    most = max(COUNTS)
    loads = [Load(twins=most, readers=NOBODY), Load(twins=most, readers=FLEET), *(Load(twins=n) for n in COUNTS)]
    for load in (*loads, Load(twins=min(LINKED, most), routers=2)):
        try:
            rows.append(measured_load(load, sizes, seconds))
        except (RuntimeError, TimeoutError) as error:  # the others are still worth a table
            report.failures.append(f"{load}: {error}")
        console.print(f"  {load.twins} twins, {load.readers}, {load.routers} routers", markup=False)
    console.print(SHEET.table(rows))
    for failure in report.failures:
        console.print(f"  not measured: {failure}", style="red", markup=False)
    one_twin = {
        key: {"rate": about["rate"], "mean_bytes": float(np.mean(about["sizes"]))} for key, about in sizes.items()
    }
    target = write_report(
        out, NAME, TITLE, load_average=load_average(console), one_twin=one_twin,
        rows=rows, failures=report.failures,
    )  # fmt: skip
    console.print(f"{machine()}; written to {target}")
    return not report.failures


def observed(seconds: float) -> Sizes:
    """Messages of a real twin in Experiment 1 at 1x."""
    with tempfile.TemporaryDirectory() as folder, bus.measured("exp1", Path(folder)) as twin:
        restart(twin.client, playing=True)
        with Worker("fleet") as worker:
            return worker.ask("observe", **twin.where, seconds=seconds)


def measured_load(load: Load, sizes: Sizes, seconds: float) -> dict[str, Any]:
    """One measurement: twins at the first router, viewers at the last."""
    names = [f"sim-{number}" for number in range(load.twins)]
    parts = [names[start : start + EACH] for start in range(0, load.twins, EACH)]
    watched = {EACH_ALL: parts, FLEET: [["*"]], NOBODY: []}[load.readers]
    key, timed = ("*", "tick") if load.readers == EACH_ALL else ("status", "status")
    with ExitStack() as stack:
        chain: list[Worker] = []
        endpoints: list[str] = []
        for _ in range(load.routers):
            chain.append(stack.enter_context(Worker("fleet")))
            endpoints.append(chain[-1].ask("router", connect=endpoints[-1:]))
        viewers = [stack.enter_context(Worker("fleet")) for _ in watched]
        twins = [stack.enter_context(Worker("fleet")) for _ in parts]
        for viewer, part in zip(viewers, watched, strict=True):
            viewer.ask("viewers", endpoint=endpoints[-1], names=part, key=key, timed=timed)
        for twin, part in zip(twins, parts, strict=True):
            twin.ask("twins", endpoint=endpoints[0], names=part, sizes=sizes)
        time.sleep(SETTLE)
        for worker in (*twins, *viewers):
            worker.ask("sent" if worker in twins else "received")
        pids = [worker.pid for worker in (*twins, *viewers)]
        routed, used = [cpu_seconds(worker.pid) for worker in chain], sum(map(cpu_seconds, pids))
        began = time.monotonic()
        time.sleep(seconds)
        spent = time.monotonic() - began
        shares = [
            100.0 * (cpu_seconds(worker.pid) - before) / spent for worker, before in zip(chain, routed, strict=True)
        ]
        load_cpu = 100.0 * (sum(map(cpu_seconds, pids)) - used) / spent
        sent, received = [twin.ask("sent") for twin in twins], [viewer.ask("received") for viewer in viewers]
        memory = max(memory_mb(worker.pid) for worker in chain)
    delays = percentiles([1000.0 * delay for part in received for delay in part["delays"]])
    return {
        "twins": load.twins,
        "readers": load.readers,
        "routers": load.routers,
        # per second, put by all twins together; what nobody reads goes no further
        "messages_in": sum(part["messages"] for part in sent) / spent,
        "mb_in": sum(part["bytes"] for part in sent) / spent / 1e6,
        "messages_out": sum(part["messages"] for part in received) / spent,
        "mb_out": sum(part["bytes"] for part in received) / spent / 1e6,
        "router_cpu": max(shares),  # % of a core, the busiest router
        "router_mb": memory,  # resident
        # from a twin's put to a viewer's callback: ticks, or else status; lost of those that are timed
        **{f"{part}_ms": delays[part] for part in ("p50", "p99", "max")},
        "lost": sum(part["lost"] for part in received),
        # p99 of how late the twins themselves sent: above some ms, this machine is what limits
        "late_ms": max(part["late_ms"]["p99"] for part in sent),
        "load_cpu": load_cpu,  # % of a core, twins and viewers together
    }


def rate_table(sizes: Sizes) -> Table:
    """Table of the messages of one twin, by key."""
    table = grid("one twin, key", "messages/s", "bytes each", "kB/s")
    total = 0.0
    for key, about in sorted(sizes.items(), key=lambda item: -item[1]["rate"]):
        mean = float(np.mean(about["sizes"]))
        total += about["rate"] * mean
        table.add_row(key, f"{about['rate']:.1f}", f"{mean:,.0f}", f"{about['rate'] * mean / 1000:.1f}")
    table.add_row("together", "", "", f"{total / 1000:.1f}")
    return table


SHEET = Sheet(  # of all measurements
    head=(
        "twins", "readers", "routers", "put 1/s", "put MB/s", "read 1/s", "read MB/s", "router %", "router MB",
        "p50 ms", "p99 ms", "max ms", "lost", "late ms", "load %",
    ),
    cells=lambda row: [f"{each:,.1f}" if isinstance(each, float) else str(each) for each in row.values()],
)  # fmt: skip
