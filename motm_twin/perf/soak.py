"""Soak benchmark: thousands of clients, malformed messages, starts and stops, and killed recorders."""

import functools
import re
import secrets
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec
from rich.console import Console

from motm_twin.bus import private_folder
from motm_twin.bus.client import TwinClient
from motm_twin.bus.commands import Speed
from motm_twin.bus.connection import LOOPBACK, PortTaken, free_port, require_free_port
from motm_twin.bus.private_folder import FILE, own_credentials
from motm_twin.bus.publisher import memory_mb
from motm_twin.perf import bus, fuzz
from motm_twin.perf.bus import Measured
from motm_twin.perf.processes import Worker, act, one_thread, restart, running, ticks, wait_for
from motm_twin.perf.report import Limit, Report, Steps, Values, conclude, measure, percentiles
from motm_twin.sessions.session import Session

WORKER = "attackers"
PARALLEL = 8  # clients at a time
RUNS, LEVEL = 12, 1.0  # largest number of warm-up runs; they end when the last two add no more than this [MB]
WARM = 100  # clients before the first measurement of memory
KILLED_EACH = 20  # clients of a process that is killed
KILLED_SHARE = 0.1  # of all clients
SETTLE = 15.0  # [s] until Zenoh has closed the links of killed clients and ended idle threads
RATE = 1000.0  # malformed messages per second
BLOCK = 10.0  # [s] of one measurement of the period
BLOCKS = ("without", "elsewhere", "attacked", "attacked", "elsewhere", "without")  # target of the messages, in turn
UP = 120.0  # [s] until a server has started on a busy machine
DOWN = 10.0  # [s] until it has ended
MARK = "MOTM_SOAK"  # environment variable that marks our processes

Say = Callable[[str], None]


def clients(twin: Measured, report: Report, count: int) -> None:
    """Measure the memory [MB] and threads that the server gains while ``count`` clients come and go.

    One in ten does not leave by itself: its process is killed.
    """
    with Worker(WORKER) as worker:
        runs = _fill(twin)
        _visit(twin, worker, min(WARM, count))
        before = _at_rest(twin)
        restart(twin.client, playing=True)
        killed = int(KILLED_SHARE * count) // KILLED_EACH * KILLED_EACH
        unknowing = _visit(twin, worker, count - killed)
        for _ in range(killed // KILLED_EACH):
            unknowing += _kill_some(twin)
        after = _at_rest(twin)
    if unknowing:
        raise RuntimeError(f"{unknowing} clients did not get the state within 30 s")
    gained = {"memory_mb": after[0] - before[0], "threads": float(after[1] - before[1])}
    report.values |= gained
    report.details["clients"] = gained | {
        "before_mb": before[0],
        "before_threads": float(before[1]),
        "killed": float(killed),
        "without_state": 0.0,
        "runs_before": float(runs),
    }


def _fill(twin: Measured) -> int:
    """Fill everything of limited size by runs at 8x: snapshots for branches, caches, the allocator's free lists.

    Without any client, memory grows by 15 MB over the first eight runs and then stays; returns the number of runs.
    """
    pid, level = twin.server.pid, []
    while len(level) < RUNS and (len(level) < 3 or level[-1] - level[-3] > LEVEL):
        restart(twin.client, playing=True)
        act(twin.client, Speed(factor=8.0))
        wait_for(lambda: twin.client.tick().done, 600.0, "end of the run")  # type: ignore[union-attr]
        restart(twin.client, playing=False)
        level.append(memory_mb(pid))
    return len(level)


def _at_rest(twin: Measured) -> tuple[float, int]:
    """Memory [MB] and threads of the server, paused at the start of a run."""
    restart(twin.client, playing=False)
    time.sleep(SETTLE)
    pid = twin.server.pid
    return memory_mb(pid), len(list(Path(f"/proc/{pid}/task").iterdir()))


def _visit(twin: Measured, worker: Worker, count: int) -> int:
    """Let clients connect and leave by themselves; returns the number that never knew the state."""
    return worker.ask("visit", timeout=60.0 + 3.0 * count, **twin.where, count=count, parallel=PARALLEL)["knew nothing"]


def _kill_some(twin: Measured) -> int:
    with Worker(WORKER) as victim:
        knew = victim.ask("stay", **twin.where, count=KILLED_EACH)
        victim.process.kill()
        victim.process.wait()
    return KILLED_EACH - knew


class Attacked:
    """Outcomes of malformed messages."""

    def __init__(self) -> None:
        self.sent, self.counts = Counter[str](), Counter[str]()  # by kind; numbers of accepted and unanswered ones
        self.accepted, self.unanswered = list[str](), list[str]()  # examples

    def add(self, answer: dict[str, Any]) -> None:
        """Add the answer of one attack."""
        self.sent.update(answer["sent"])
        self.counts.update(answer["counts"])
        self.accepted += answer["accepted"]
        self.unanswered += answer["unanswered"]


def state(client: TwinClient) -> dict[str, Any]:
    """State that no refused message may change: hash of the whole state, log of edits, and status."""
    session = msgspec.json.decode(client.session(), type=Session)
    status = client.status()
    assert status is not None
    names = ("run", "state", "text", "scene", "variant", "seed", "time", "speed", "driver", "parameters", "recording")
    found = {name: getattr(status, name) for name in names}
    return found | {"hash": session.state_hash, "periods": session.periods, "edits": session.edits}


def attack_paused(twin: Measured, count: int) -> Attacked:
    """Send malformed messages to a paused twin. Raises RuntimeError when its state has changed."""
    restart(twin.client, playing=False)
    before, attacked = state(twin.client), Attacked()
    with Worker(WORKER) as worker:
        how = {"timeout": 60.0 + count / 50.0, "clock": twin.clock, "rate": RATE, "seed": 1}
        attacked.add(worker.ask("attack", **twin.where, **how, count=count))
    after = state(twin.client)
    if changed := [f"{name}: {before[name]} -> {after[name]}" for name in before if before[name] != after[name]]:
        raise RuntimeError(f"malformed messages have changed {'; '.join(changed)}")
    return attacked


def attack_playing(twin: Measured, count: int, other: Measured, attacked: Attacked) -> dict[str, Values]:
    """Periods [ms] of a running twin that gets malformed messages, block by block as in `BLOCKS`.

    Sending and refusing so many messages slows any program on the machine: the same messages to the paused ``other``
    show by how much. ``attacked`` collects the outcomes. Raises RuntimeError when a message has become an edit.
    """
    found: dict[str, list[float]] = {name: [] for name in BLOCKS}
    each = max(1, min(count, round(RATE * BLOCK)))
    restart(other.client, playing=False)
    with Worker(WORKER) as worker:
        sent = block = 0
        while sent < count or block % len(BLOCKS):
            name = BLOCKS[block % len(BLOCKS)]
            target = {"attacked": twin, "elsewhere": other}.get(name)
            restart(twin.client, playing=True)
            if target is not None:
                worker.send("attack", **target.where, clock=target.clock, count=each, rate=RATE, seed=2 + block)
            found[name] += [tick.stage_ms["period"] for tick in ticks(twin.client, each / RATE)]
            if target is not None:
                answer = worker.answer(timeout=60.0 + each / 50.0)
                if target is twin:
                    sent += each
                    attacked.add(answer)
            block += 1
            if edits := state(twin.client)["edits"]:
                raise RuntimeError(f"malformed messages became edits: {edits[:3]}")
    return {name: percentiles(periods) for name, periods in found.items()}


def starts(count: int, folder: Path, say: Say) -> dict[str, float]:
    """Start and stop `serve --headless` ``count`` times; every fourth is stopped before its twin has run.

    Raises RuntimeError that names what was left behind: processes, files in its folder, its port.
    """
    zenoh_port, took = free_port(), []
    _share_password(folder)
    for number in range(count):
        took.append(_start_and_stop(folder, zenoh_port, early=number % 4 == 3))
        if (number + 1) % 10 == 0:
            say(f"    {number + 1} of {count} starts")
    longest, down = max(up for up, _ in took), percentiles([down for _, down in took])
    return {"starts": float(count), "start_s": longest, "stop_p50_s": down["p50"], "stop_max_s": down["max"]}


def _share_password(folder: Path) -> None:
    """Give this process's password to servers that use this folder for temporary files."""
    own_credentials()
    private = folder / private_folder.folder().name
    private.mkdir(mode=0o700, exist_ok=True)
    shutil.copy(private_folder.folder() / FILE, private / FILE)


def _start_and_stop(folder: Path, zenoh_port: int, *, early: bool) -> tuple[float, float]:
    """Times [s] until the server has started, and until it has ended."""
    mark = secrets.token_hex(8)
    environment = one_thread(**{MARK: mark, "TMPDIR": str(folder)})
    command = [sys.executable, "-m", "motm_twin", "serve", "exp1", "--headless", "--zenoh-port", str(zenoh_port)]
    began = time.monotonic()
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, cwd=folder, env=environment)  # noqa: S603 - ours
    try:
        with TwinClient(f"tcp/{LOOPBACK}:{zenoh_port}") as client:
            known = client.status if early else client.tick
            wait_for(lambda: running(process) and known() is not None, UP, "state of the twin")
        up = time.monotonic() - began
        process.send_signal(signal.SIGINT if early else signal.SIGTERM)
        code = process.wait(DOWN)
        down = time.monotonic() - began - up
    finally:
        if process.poll() is None:
            process.kill()
            process.wait()
    left = left_behind(mark, folder, zenoh_port)
    if code != 0 or left:
        raise RuntimeError(f"exit code {code}; left behind: {', '.join(left) or 'nothing'}")
    return up, down


def left_behind(mark: str, folder: Path, port: int) -> list[str]:
    """Processes with the mark in their environment, files in the folder, and the port if it is not free."""
    left = [f"process {pid}" for pid in _marked(mark)]
    files = (path for path in folder.rglob("*") if not path.is_dir() and path.name != FILE)
    left += [f"file {path.relative_to(folder)}" for path in files]
    try:
        require_free_port(LOOPBACK, port, "")
    except PortTaken as error:
        left.append(error.args[-1])
    with socket.socket() as probe:
        if probe.connect_ex((LOOPBACK, port)) == 0:
            left.append(f"somebody listens on port {port}")
    return left


def _marked(mark: str) -> list[int]:
    marked, found = f"{MARK}={mark}".encode(), []
    for path in Path("/proc").glob("[0-9]*"):
        try:
            if marked in (path / "environ").read_bytes().split(b"\0"):
                found.append(int(path.name))
        except OSError:
            continue
    return found


NAME = "soak"
TITLE = "Long and hostile use of a twin server, Experiment 1; all in one run"
CLIENTS, MESSAGES, STARTS, KILLS = 1000, 100_000, 200, 100
ROBOT = 100_000  # malformed messages on the keys of a robot in another program
COUNTS = {
    "clients": CLIENTS, "malformed messages": MESSAGES, "on a robot's keys": ROBOT, "starts": STARTS, "kills": KILLS,
}  # fmt: skip
PLAYING = 120_000  # messages to a running twin: 2 minutes have 24 periods above p99; 12 would be too few
KILLER = Path(__file__).parents[2] / "tools" / "kill_recorder.py"  # only in a checkout
KILL_SECONDS = 30.0  # [s] longest time of one kill

LIMITS = {
    "memory_mb": Limit(name="server after clients came and went, memory", unit="MB", limit=5.0, decimals=2),
    "threads": Limit(name="server after clients came and went, threads", unit="", limit=0.0, decimals=0),
    "accepted": Limit(name="malformed messages that were accepted", unit="", limit=0.0, decimals=0),
    "unanswered": Limit(name="malformed commands that got no answer", unit="", limit=0.0, decimals=0),
    "robot": Limit(name="periods of an external robot changed by such on its keys", unit="", limit=0.0, decimals=0),
    "period": Limit(name="period p99 under 1,000 malformed messages/s / without", unit="x", limit=1.1, decimals=3),
    "period_own": Limit(name="the same / while another server gets them", unit="x", limit=1.1, decimals=3),
    "left": Limit(name="starts and stops that left something behind", unit="", limit=0.0, decimals=0),
    "lost_s": Limit(name="kill -9 of the recorder: all read, most that was lost", unit="s", limit=1.0, decimals=2),
}


def bench_soak(out: Path, share: float, console: Console) -> bool:
    """Measure, print, write ``out/soak.json``; True when no number exceeds its limit.

    ``share`` of the full counts: 1 takes about half an hour.
    """
    console.print(f"\n[bold]{NAME}[/bold]: {TITLE}")
    counts = {name: max(1, round(share * count)) for name, count in COUNTS.items()}
    report, say = Report(details={"counts": counts}), functools.partial(console.print, markup=False)
    with tempfile.TemporaryDirectory() as folder:
        with bus.measured("exp1", Path(folder)) as twin:
            steps: Steps = [
                ("clients", lambda: clients(twin, report, counts["clients"])),
                ("malformed messages", lambda: _malformed(twin, report, counts["malformed messages"], Path(folder))),
            ]
            measure(steps, report, console)
        steps = [
            ("malformed messages on a robot's keys", lambda: _robot(report, counts["on a robot's keys"])),
            ("starts and stops", lambda: _starts(report, counts["starts"], say)),
            ("killed recorders", lambda: _kills(report, counts["kills"])),
        ]
        measure(steps, report, console)
    return conclude(NAME, TITLE, LIMITS, report, out, console)


def _malformed(twin: Measured, report: Report, count: int, data: Path) -> None:
    """Send half of them to a paused twin, for its state hash; at least as many while it runs, for its periods."""
    attacked = attack_paused(twin, count // 2)
    playing = max(count - count // 2, round(PLAYING * count / MESSAGES))
    with bus.measured("exp1", data) as other:
        period = attack_playing(twin, playing, other, attacked)
    for name, reference in (("period", "without"), ("period_own", "elsewhere")):
        report.values[name] = period["attacked"]["p99"] / period[reference]["p99"]
    report.details |= {"malformed": attacked.sent, "period_ms": period}
    for name, examples in (("accepted", attacked.accepted), ("unanswered", attacked.unanswered)):
        report.values[name] = float(attacked.counts[name])
        if examples:
            report.details[name] = dict(enumerate(examples))


def _robot(report: Report, count: int) -> None:
    report.details["robot"] = found = fuzz.attack_robot(count)
    report.values["robot"] = found["differing"]


def _starts(report: Report, count: int, say: Say) -> None:
    with tempfile.TemporaryDirectory() as folder:
        report.details["starts"] = starts(count, Path(folder), say)
    report.values["left"] = 0.0


def _kills(report: Report, count: int) -> None:
    if not KILLER.is_file():
        report.skipped["lost_s"] = f"{KILLER.name} comes with a checkout only"
        return
    command = [sys.executable, str(KILLER), "--times", str(count)]
    ended = subprocess.run(  # noqa: S603 - our own tool
        command, capture_output=True, text=True, timeout=300.0 + KILL_SECONDS * count, check=False
    )
    output = (ended.stdout + ended.stderr).strip().splitlines() or ["nothing"]
    found = re.search(r"^\d+ kills, all files read and recovered: .*most ([0-9.]+) s$", ended.stdout, re.M)
    if found is None:
        raise RuntimeError(f"{KILLER.name} ended with exit code {ended.returncode} and said: {output[-1]}")
    report.values["lost_s"] = float(found[1])
    report.details["kills"] = found[0]
