"""Benchmarks of Zenoh: latency of ticks and commands, cost of readers and recordings, many twins at one router."""

import random
import signal
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from rich.console import Console
from rich.table import Table

from motm_twin.bus.client import TwinClient
from motm_twin.bus.commands import AddObstacle, Command, HandOver, MoveBody, Record, RemoveBody, Speed
from motm_twin.bus.messages import TickMessage
from motm_twin.bus.publisher import memory_mb
from motm_twin.model.plant import PERIOD
from motm_twin.perf import participants
from motm_twin.perf.participants import Sizes
from motm_twin.perf.processes import Worker, act, children, cpu_seconds, open_place, restart, ticks, wait_for
from motm_twin.perf.report import (
    Limit,
    Report,
    Sheet,
    Steps,
    Values,
    conclude,
    grid,
    load_average,
    machine,
    measure,
    percentiles,
    write_report,
)

READER = "readers"
LONGEST = 75.0  # [s] of one measurement: within one run of Experiment 1
PAUSES = [0.0, 0.02, 0.1, 0.5, 2.0]  # [s] between two reads of the readers for which ages are measured
READING, STOPPED, FULL = 40, 5, 5  # subscribers that read, that are stopped, and that run but never read
READERS_EACH = 10  # sessions in one process
JAM_SPEED, JAM_SECONDS = 8.0, 6.0  # speed factor and time [s] to fill the queues of subscribers that never read
BODY = "measured"
RECORDED = (False, True, True, False, True, False, False, True)  # in an order that cancels a drift of the machine
COMMAND_EVERY = 0.17  # [s]; no multiple of the period, so that commands arrive at every phase of it


@dataclass(frozen=True)
class Measured:
    """A running twin server, its client, and the offset of its clock from the monotonic one [s]."""

    server: Worker
    client: TwinClient

    @property
    def endpoint(self) -> str:
        """Zenoh endpoint of its clients."""
        return self.server.hello["endpoint"]

    @property
    def where(self) -> dict[str, Any]:
        """Endpoint and name of the twin as arguments for workers."""
        return {"endpoint": self.endpoint, "twin": self.client.keys.twin}

    @property
    def clock(self) -> float:
        """Server time less monotonic time [s]."""
        return self.server.hello["clock"]

    @property
    def port(self) -> int:
        """TCP port of Zenoh."""
        return int(self.endpoint.rsplit(":", 1)[1])


@contextmanager
def measured(scene: str, data: Path) -> Iterator[Measured]:
    """A twin to measure, paused at its start. Raises RuntimeError when it does not start."""
    with Worker("twin", scene, data) as server:
        endpoint = server.hello["endpoint"]
        with TwinClient(endpoint) as client:
            wait_for(client.tick, 30.0, "first period")
            yield Measured(server, client)


def latency(twin: Measured, report: Report, seconds: float) -> None:
    """Measure the time [ms] from the stamp of a tick to the callback in another process, and that of bare Zenoh."""
    restart(twin.client, playing=True)
    with Worker(READER) as reader, Worker("bare") as bare:
        reader.ask("listen", name="first", endpoint=twin.endpoint, key=twin.client.keys.tick)
        bare_endpoint = bare.hello["endpoint"]
        time.sleep(3.0)
        payloads = reader.ask("payloads", name="first")
        bare.ask("send", payloads=payloads, period=PERIOD)
        reader.ask("listen", name="bare", endpoint=bare_endpoint, key=participants.KEY)
        reader.ask("listen", name="tick", endpoint=twin.endpoint, key=twin.client.keys.tick)
        time.sleep(seconds)
        delays = {name: reader.ask("delays", name=name, clock=twin.clock) for name in ("tick", "bare")}
    found = {name: percentiles([1000.0 * delay for delay in delays[name]]) for name in delays}
    report.values["above_bare_ms"] = found["tick"]["p99"] - found["bare"]["p99"]
    mean = float(np.mean([len(text) for text in payloads]))
    report.details["tick_to_subscriber_ms"] = found | {"bytes": {"mean": mean}}


def publishing(twin: Measured, report: Report, seconds: float) -> None:
    """Measure the time [ms] for publishing in the loop, without subscribers and with 50, of which 10 never read."""
    keys = twin.client.keys
    followed = [keys.tick, keys.robot, keys.scan, keys.grid, keys.scene, keys.status, keys.metrics, keys.event]
    without, alone = _sink(twin, seconds)
    with ExitStack() as stack:
        readers = [stack.enter_context(Worker(READER)) for _ in range(READING // READERS_EACH)]
        stopped, full = stack.enter_context(Worker(READER)), stack.enter_context(Worker(READER))
        for reader in readers:
            reader.ask("follow", endpoint=twin.endpoint, keys=followed, sessions=READERS_EACH)
        stopped.ask("follow", endpoint=twin.endpoint, keys=followed, sessions=STOPPED)
        full.ask("jam", endpoint=twin.endpoint, keys=followed, sessions=FULL)
        stopped.process.send_signal(signal.SIGSTOP)
        try:
            jammed = _jam(twin)
            with_readers, computed = _sink(twin, seconds)
            received = [count for reader in readers for count in reader.ask("received")]
        finally:
            stopped.process.send_signal(signal.SIGCONT)
    report.values["sink_ms"] = with_readers["p99"]
    report.details["publishing_in_the_loop_ms"] = {
        "0 subscribers": without,
        "50 subscribers": with_readers,
        "processor time, 0": alone,
        "processor time, 50": computed,
        "jammed links": {"when full": float(jammed), "at the end": float(jams(twin.port))},
        "messages per reader": {"least": float(min(received)), "most": float(max(received))},
    }


def _sink(twin: Measured, seconds: float) -> tuple[Values, Values]:
    """Publishing times [ms] by wall clock and in processor time: on a busy machine the wall clock includes waiting."""
    restart(twin.client, playing=True)
    twin.server.ask("sink")
    time.sleep(seconds)
    took = [[1000.0 * value for value in pair] for pair in twin.server.ask("sink")]
    return percentiles([clock for clock, _ in took]), percentiles([computed for _, computed in took])


def _jam(twin: Measured) -> int:
    """Run at 8x until unread messages fill the buffers; returns the number of jammed links."""
    restart(twin.client, playing=True)
    act(twin.client, Speed(factor=JAM_SPEED))
    time.sleep(JAM_SECONDS)
    return jams(twin.port)


def jams(port: int) -> int:
    """Connections to a TCP port of this machine on which more than 64 kB wait to be sent."""
    count = 0
    for line in Path("/proc/net/tcp").read_text(encoding="ascii").splitlines()[1:]:
        local, waiting = line.split()[1], line.split()[4].split(":")[0]
        count += int(local.rsplit(":", 1)[1], 16) == port and int(waiting, 16) > 65536
    return count


def effect(twin: Measured, report: Report, seconds: float) -> None:
    """Measure the time [ms] from a command, sent at any phase of the period, to its effect, in three ways."""
    client = twin.client
    restart(client, playing=True)
    x, y = open_place(client)
    _do(client, AddObstacle(name=BODY, x=x, y=y, size=(0.2, 0.2, 0.2)))
    heard: list[tuple[float, bytes]] = []
    leave = client.on_tick(lambda payload: heard.append((time.monotonic(), payload)))
    sent: dict[float, tuple[float, float]] = {}  # x: times when sent and when answered
    draw, until, before = random.Random(1), time.monotonic() + seconds, -1
    while time.monotonic() < until:
        place = round(x + 0.001 * (len(sent) + 1), 6)
        began = time.monotonic()
        before = _do(client, MoveBody(name=BODY, x=place, y=y))
        sent[place] = began, time.monotonic()
        time.sleep(COMMAND_EVERY * (0.5 + draw.random()))
    wait_for(lambda: client.tick().index > before + 1, 10.0, "period after the last command")  # type: ignore[union-attr]
    leave()
    _do(client, RemoveBody(name=BODY))
    _do(client, HandOver())
    found = _effects(sent, heard, twin.clock)
    if found["never seen"]["count"]:
        raise RuntimeError(f"{found['never seen']['count']:.0f} commands were accepted and never seen in a tick")
    report.values["effect_ms"] = found["sent to start of its period"]["p99"]
    report.values["shown_ms"] = found["answer to its tick"]["p99"]
    report.details["command_to_effect_ms"] = found


def _do(client: TwinClient, command: Command) -> int:
    """Send a command; returns the index of the last period before it. Raises RuntimeError when it is refused."""
    answer = client.command(command)
    if not answer.ok:
        raise RuntimeError(f"{command!r} was refused: {answer.reason}")
    return answer.index


def _effects(
    sent: dict[float, tuple[float, float]], heard: list[tuple[float, bytes]], clock: float
) -> dict[str, Values]:
    """Delays [ms] of the first tick with each edit and of its period's start: the tick's stamp less its duration."""
    begins, answered, seen = [], [], []
    for at, payload in heard:
        tick = msgspec.json.decode(payload, type=TickMessage)
        for edit in tick.edits:
            if isinstance(edit, MoveBody) and (times := sent.pop(edit.x, None)) is not None:
                begins.append(tick.server_time - clock - tick.stage_ms["period"] / 1000.0 - times[0])
                answered.append(at - times[1])
                seen.append(at - times[0])
    names = {"sent to start of its period": begins, "answer to its tick": answered, "sent to its tick": seen}
    found = {name: percentiles([1000.0 * value for value in values]) for name, values in names.items()}
    return found | {"never seen": {"count": float(len(sent))}}


def ages(twin: Measured, report: Report, seconds: float) -> None:
    """Measure the age [ms] of the newest tick for readers of different speeds."""
    restart(twin.client, playing=True)
    with Worker(READER) as reader:
        how = {"pauses": PAUSES, "seconds": seconds, "clock": twin.clock}
        found = reader.ask("ages", timeout=seconds + 60.0, **twin.where, **how)
    spread = {name: percentiles([1000.0 * age for age in values]) for name, values in found.items()}
    report.values["age_ms"] = max(values["p99"] for values in spread.values())
    report.details["age_ms"] = spread


def recording(twin: Measured, report: Report, seconds: float) -> None:
    """Measure the loop with and without a recorder over the same ``seconds`` of the same run, repeatedly."""
    periods: dict[bool, list[list[float]]] = {False: [], True: []}
    sizes, shares = [], []
    for on in RECORDED:
        path = _start_recording(twin) if on else None
        restart(twin.client, playing=True)
        began, used = time.monotonic(), _recorder_seconds(twin)
        periods[on].append([tick.stage_ms["period"] for tick in ticks(twin.client, seconds)])
        if path is not None:
            spent = time.monotonic() - began
            shares.append((_recorder_seconds(twin) - used) / spent)
            act(twin.client, Record(action="stop"))
            sizes.append(path.stat().st_size / 1e6 * 60.0 / spent)
    without, with_recorder = (np.concatenate([np.array(part) for part in periods[on]]) for on in (False, True))
    report.values["recording"] = 100.0 * (_paired(periods) - 1.0)
    report.values["file_mb"] = float(max(sizes))
    report.details["recording"] = {
        "period ms, without": percentiles(without.tolist()) | {"mean": float(without.mean())},
        "period ms, recorded": percentiles(with_recorder.tolist()) | {"mean": float(with_recorder.mean())},
        "extra %": {"of the loop's time": report.values["recording"]},
        "file": {"MB/min": report.values["file_mb"], "recorder's share of a core": float(np.mean(shares))},
    }


def _paired(periods: dict[bool, list[list[float]]]) -> float:
    """Ratio of loop times with and without: least time of each period over all repeats, without the longest 1 %."""
    count = min(len(part) for parts in periods.values() for part in parts)
    cut = [np.sort(np.min([part[:count] for part in periods[on]], axis=0)) for on in (True, False)]
    kept = max(1, int(0.99 * count))
    return float(cut[0][:kept].sum() / cut[1][:kept].sum())


def _start_recording(twin: Measured) -> Path:
    answer = twin.client.command(Record(action="start", name=f"bench-{time.monotonic_ns()}"), timeout=40.0)
    if not answer.ok:
        raise RuntimeError(f"no recording: {answer.reason}")
    act(twin.client, HandOver())
    return Path(answer.path)


def _recorder_seconds(twin: Measured) -> float:
    """Processor time [s] of the recorder; 0 when none runs."""
    return sum(cpu_seconds(pid) for pid, _ in children(twin.server.pid))


NAME = "bus"
TITLE = "The bus: Experiment 1 at 1x on Zenoh, measured in other processes; all in one run"
PERIOD_MS = 1000.0 * PERIOD

LIMITS = {
    "above_bare_ms": Limit(name="tick to subscriber, p99 above bare Zenoh's p99", unit="ms", limit=2.0, decimals=2),
    "sink_ms": Limit(
        name="publishing in the loop, p99, 50 subscribers, 10 never read", unit="ms", limit=1.0, decimals=3
    ),
    "effect_ms": Limit(
        name="command sent until the period that has it begins, p99", unit="ms", limit=PERIOD_MS + 5.0, decimals=1
    ),
    "shown_ms": Limit(
        name="command answered until the tick that shows it arrives, p99", unit="ms", limit=PERIOD_MS + 5.0, decimals=1
    ),
    "age_ms": Limit(
        name="age of the newest tick, p99, readers that look every 0 to 2 s", unit="ms", limit=2 * PERIOD_MS, decimals=1
    ),
    "recording": Limit(name="recording, of the loop's time", unit="%", limit=5.0, decimals=2),
    "file_mb": Limit(name="recording, file", unit="MB/min", limit=15.0, decimals=2),
}


def bench_bus(out: Path, seconds: float, console: Console) -> bool:
    """Measure, print, write ``out/bus.json``; True when no number exceeds its limit.

    Takes about 7 x ``seconds`` + 1 min; above 75 s, each measurement takes 75 s.
    """
    console.print(f"\n[bold]{NAME}[/bold]: {TITLE}")
    report, each = Report(), min(seconds, LONGEST)
    with tempfile.TemporaryDirectory() as folder, measured("exp1", Path(folder)) as twin:
        steps: Steps = [
            ("tick to subscriber", lambda: latency(twin, report, each)),
            ("publishing", lambda: publishing(twin, report, each)),
            ("command to effect", lambda: effect(twin, report, each)),
            ("age of what readers get", lambda: ages(twin, report, each)),
            ("recording", lambda: recording(twin, report, each / 4)),
        ]
        measure(steps, report, console)
    return conclude(NAME, TITLE, LIMITS, report, out, console)


SCALE = "scale"
SCALE_TITLE = "Scale: simulated twins at 1x through a Zenoh router, and who reads them"
COUNTS = (10, 50, 100, 200)
LINKED = 50  # twins at one router, their viewers at another
EACH = 50  # sessions in one process
OBSERVED = 20.0  # [s] for which a real twin is observed, whose load is repeated
SETTLE = 3.0  # [s]
EACH_ALL, FLEET, NOBODY = "each all", "one status", "nobody"  # a viewer for each twin; one dashboard of all; none


@dataclass(frozen=True, kw_only=True)
class Load:
    """One measurement: numbers of twins and routers, and the readers."""

    twins: int
    readers: str = EACH_ALL
    routers: int = 1


def bench_scale(out: Path, seconds: float, console: Console) -> bool:
    """Measure, print, write ``out/scale.json``; True when everything could be measured.

    Takes about 8 x ``seconds`` + 2 min. There is no number to reach; docs/scale.md explains the figures.
    """
    console.print(f"\n[bold]{SCALE}[/bold]: {SCALE_TITLE}")
    report, rows = Report(), []
    sizes = observed(min(seconds, OBSERVED))
    console.print(rate_table(sizes))
    most = max(COUNTS)
    loads = [Load(twins=most, readers=NOBODY), Load(twins=most, readers=FLEET), *(Load(twins=n) for n in COUNTS)]
    for load in (*loads, Load(twins=min(LINKED, most), routers=2)):
        try:
            rows.append(measured_load(load, sizes, seconds))
        except (RuntimeError, TimeoutError) as error:  # the other rows are still worth a table
            report.failures.append(f"{load}: {error}")
        console.print(f"  {load.twins} twins, {load.readers}, {load.routers} routers", markup=False)
    console.print(SHEET.table(rows))
    for failure in report.failures:
        console.print(f"  not measured: {failure}", style="red", markup=False)
    one_twin = {
        key: {"rate": about["rate"], "mean_bytes": float(np.mean(about["sizes"]))} for key, about in sizes.items()
    }
    target = write_report(
        out, SCALE, SCALE_TITLE, load_average=load_average(console), one_twin=one_twin,
        rows=rows, failures=report.failures,
    )  # fmt: skip
    console.print(f"{machine()}; written to {target}")
    return not report.failures


def observed(seconds: float) -> Sizes:
    """Observe the messages of a real twin in Experiment 1 at 1x."""
    with tempfile.TemporaryDirectory() as folder, measured("exp1", Path(folder)) as twin:
        restart(twin.client, playing=True)
        with Worker("fleet") as worker:
            return worker.ask("observe", **twin.where, seconds=seconds)


def measured_load(load: Load, sizes: Sizes, seconds: float) -> dict[str, Any]:
    """Measure one load: twins at the first router, viewers at the last."""
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
        # per second, sent by all twins together; messages without readers go no further
        "messages_in": sum(part["messages"] for part in sent) / spent,
        "mb_in": sum(part["bytes"] for part in sent) / spent / 1e6,
        "messages_out": sum(part["messages"] for part in received) / spent,
        "mb_out": sum(part["bytes"] for part in received) / spent / 1e6,
        "router_cpu": max(shares),  # % of a core, the busiest router
        "router_mb": memory,  # resident
        # from a twin's put to a viewer's callback: ticks, or else status; "lost" counts the same messages
        **{f"{part}_ms": delays[part] for part in ("p50", "p99", "max")},
        "lost": sum(part["lost"] for part in received),
        # p99 of the twins' own lateness in sending: above some ms, this machine is the limit
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
