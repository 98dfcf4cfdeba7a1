"""Scale benchmark: twins and viewers that one Zenoh router carries on this machine, each with a real twin's load."""

import collections
import heapq
import random
import tempfile
import threading
import time
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import zenoh
from rich.console import Console
from rich.table import Table

from motm_twin.bus.connection import LOOPBACK, free_port, open_client, open_member, session_config
from motm_twin.bus.keys import Keys
from motm_twin.bus.publisher import memory_mb
from motm_twin.perf import bus
from motm_twin.perf.processes import Worker, Works, cpu_seconds, restart
from motm_twin.perf.report import Report, grid, load_average, machine, percentiles, write_report

Sizes = dict[str, dict[str, Any]]  # by the last part of a key: rate [1/s], and sizes [bytes] of payloads

_keep: list[Any] = []  # what lives as long as this process


def router(connect: list[str]) -> str:
    """Become a Zenoh router, linked with others; where it listens."""
    endpoint = f"tcp/{LOOPBACK}:{free_port()}"
    _keep.append(zenoh.open(session_config(listen=[endpoint], connect=connect, mode="router")))
    return endpoint


def observe(endpoint: str, twin: str, seconds: float) -> Sizes:
    """Rates and sizes of everything that a twin sends within some seconds."""
    noted: collections.defaultdict[str, list[int]] = collections.defaultdict(list)

    def note(sample: zenoh.Sample) -> None:
        attachment = sample.attachment
        size = len(sample.payload.to_bytes()) + (0 if attachment is None else len(attachment.to_bytes()))
        noted[str(sample.key_expr).rsplit("/", 1)[-1]].append(size)

    with open_client(endpoint) as session:
        handler = zenoh.handlers.Callback(note, indirect=False)
        subscriber = session.declare_subscriber(f"{Keys(twin).tick.rsplit('/', 1)[0]}/*", handler)
        time.sleep(1.0)  # until all links know of it
        noted.clear()
        time.sleep(seconds)
        found = {key: {"rate": len(sizes) / seconds, "sizes": sizes[:500]} for key, sizes in list(noted.items())}
        subscriber.undeclare()
    return found


class Twins:
    """Simulated twins: each a session that sends what a real one sends, at its times and of its sizes."""

    def __init__(self) -> None:
        self._due: list[tuple[float, int]] = []
        self._streams: list[tuple[Any, list[bytes], float, list[int]]] = []
        self._late: list[float] = []
        self._sent = [0, 0]  # messages, bytes

    def begin(self, endpoint: str, names: list[str], sizes: Sizes) -> None:
        """Connect these and let them send."""
        draw, now = random.Random(0), time.monotonic() + 0.5
        for name in names:
            session = open_member(endpoint, wait=30.0)
            _keep.extend((session, session.liveliness().declare_token(Keys(name).alive)))
            for key, about in sizes.items():
                publisher = session.declare_publisher(
                    f"motm/{name}/{key}", congestion_control=zenoh.CongestionControl.DROP
                )
                period = 1.0 / max(about["rate"], 0.1)
                payloads = [bytes(size) for size in about["sizes"]]
                heapq.heappush(self._due, (now + draw.random() * period, len(self._streams)))
                self._streams.append((publisher, payloads, period, [0]))
        threading.Thread(target=self._run, daemon=True).start()

    def take(self) -> dict[str, Any]:
        """Number of messages and bytes sent since the last call, and their lateness [ms]."""
        sent, self._sent = self._sent, [0, 0]
        late, self._late = self._late, []
        return {"messages": sent[0], "bytes": sent[1], "late_ms": percentiles([1000.0 * value for value in late])}

    def _run(self) -> None:
        while True:
            due, index = self._due[0]
            wait = due - time.monotonic()
            if wait > 0.0:
                time.sleep(wait)
            publisher, payloads, period, count = self._streams[index]
            payload, now = payloads[count[0] % len(payloads)], time.monotonic()
            publisher.put(payload, attachment=f"{now!r} {count[0]}".encode())
            count[0] += 1
            self._late.append(now - due)
            self._sent[0] += 1
            self._sent[1] += len(payload)
            heapq.heapreplace(self._due, (due + period, index))


class Viewers:
    """Viewers: each a session that reads everything of one twin, or one key of all twins."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._messages = self._bytes = self._lost = 0
        self._delays: list[float] = []
        self._last: dict[tuple[int, str], int] = {}

    def begin(self, endpoint: str, names: list[str], key: str, timed: str) -> None:
        """Connect one viewer for each of these twins ("*": all), for ``key``; delays are those of the key ``timed``."""
        for number, name in enumerate(names):
            session = open_member(endpoint, wait=30.0)
            handler = zenoh.handlers.Callback(self._noted(number, f"/{timed}"), indirect=False)
            _keep.extend((session, session.declare_subscriber(f"motm/{name}/{key}", handler)))

    def take(self) -> dict[str, Any]:
        """Messages and bytes received since the last call; of timed ones those missed, and their delays [s]."""
        with self._lock:
            taken = {"messages": self._messages, "bytes": self._bytes, "lost": self._lost, "delays": self._delays}
            self._messages = self._bytes = self._lost = 0
            self._delays = []
        return taken

    def _noted(self, number: int, timed: str) -> Any:
        def note(sample: zenoh.Sample) -> None:
            now, key, size = time.monotonic(), str(sample.key_expr), len(sample.payload)
            assert sample.attachment is not None
            stamp, count = sample.attachment.to_string().split()
            with self._lock:
                self._messages += 1
                self._bytes += size
                if key.endswith(timed):
                    self._delays.append(now - float(stamp))
                    self._lost += max(0, int(count) - self._last.get((number, key), int(count) - 1) - 1)
                    self._last[number, key] = int(count)

        return note


def fleet() -> tuple[dict[str, str], Works]:
    """Role of a router, simulated twins, viewers, or the observer of a real twin."""
    twins, viewers = Twins(), Viewers()
    works: Works = {"router": router, "observe": observe, "twins": twins.begin, "sent": twins.take}
    return {}, works | {"viewers": viewers.begin, "received": viewers.take}


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


@dataclass(frozen=True, kw_only=True)
class Row:
    """Values measured with so many twins."""

    twins: int
    readers: str
    routers: int
    messages_in: float  # per second, put by all twins together; what nobody reads goes no further
    mb_in: float  # per second
    messages_out: float
    mb_out: float
    router_cpu: float  # % of a core, the busiest router
    router_mb: float  # resident memory
    p50_ms: float  # from a twin's put to a viewer's callback: ticks, or else status
    p99_ms: float
    max_ms: float
    lost: int  # of those that are timed
    late_ms: float  # p99 of how late the twins themselves sent: above some ms, this machine is what limits
    load_cpu: float  # % of a core, twins and viewers together


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
    console.print(row_table(rows))
    for failure in report.failures:
        console.print(f"  not measured: {failure}", style="red", markup=False)
    one_twin = {
        key: {"rate": about["rate"], "mean_bytes": float(np.mean(about["sizes"]))} for key, about in sizes.items()
    }
    target = write_report(
        out, NAME, TITLE, load_average=load_average(console), one_twin=one_twin,
        rows=[asdict(row) for row in rows], failures=report.failures,
    )  # fmt: skip
    console.print(f"{machine()}; written to {target}")
    return not report.failures


def observed(seconds: float) -> Sizes:
    """Messages of a real twin in Experiment 1 at 1x."""
    with tempfile.TemporaryDirectory() as folder, bus.measured("exp1", Path(folder)) as twin:
        restart(twin.client, playing=True)
        with Worker("fleet") as worker:
            return worker.ask("observe", **twin.where, seconds=seconds)


def measured_load(load: Load, sizes: Sizes, seconds: float) -> Row:
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
        routed, used, began = _used(chain), sum(map(cpu_seconds, pids)), time.monotonic()
        time.sleep(seconds)
        spent = time.monotonic() - began
        shares = [100.0 * (after - before) / spent for before, after in zip(routed, _used(chain), strict=True)]
        load_cpu = 100.0 * (sum(map(cpu_seconds, pids)) - used) / spent
        sent, received = [twin.ask("sent") for twin in twins], [viewer.ask("received") for viewer in viewers]
        memory = max(memory_mb(worker.pid) for worker in chain)
    delays = percentiles([1000.0 * delay for part in received for delay in part["delays"]])
    return Row(
        twins=load.twins,
        readers=load.readers,
        routers=load.routers,
        messages_in=sum(part["messages"] for part in sent) / spent,
        mb_in=sum(part["bytes"] for part in sent) / spent / 1e6,
        messages_out=sum(part["messages"] for part in received) / spent,
        mb_out=sum(part["bytes"] for part in received) / spent / 1e6,
        router_cpu=max(shares),
        router_mb=memory,
        p50_ms=delays["p50"],
        p99_ms=delays["p99"],
        max_ms=delays["max"],
        lost=sum(part["lost"] for part in received),
        late_ms=max(part["late_ms"]["p99"] for part in sent),
        load_cpu=load_cpu,
    )


def _used(workers: list[Worker]) -> list[float]:
    return [cpu_seconds(worker.pid) for worker in workers]


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


def row_table(rows: Sequence[Row]) -> Table:
    """All measurements."""
    columns = ("twins", "readers", "routers", "put 1/s", "put MB/s", "read 1/s", "read MB/s", "router %", "router MB")
    table = grid(*columns, "p50 ms", "p99 ms", "max ms", "lost", "late ms", "load %")
    for row in rows:
        table.add_row(*(f"{each:,.1f}" if isinstance(each, float) else str(each) for each in asdict(row).values()))
    return table
