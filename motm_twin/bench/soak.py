"""What takes long: thousands of clients, malformed messages, starts and stops, and recorders that are killed."""

import re
import subprocess
import sys
import tempfile
from pathlib import Path

from rich.console import Console

from motm_twin.bench import bus_measures, soak_measures, soak_robot
from motm_twin.bench.bus_measures import Measured
from motm_twin.bench.report import Limit, Report, Steps, conclude, measure

NAME = "soak"
TITLE = "Long and hostile use of a twin server, Experiment 1; all in one run"
CLIENTS, MESSAGES, STARTS, KILLS = 1000, 100_000, 200, 100
ROBOT = 100_000  # malformed messages on the keys of a robot in another program
PLAYING = 120_000  # messages to a running twin: in 2 minutes 24 periods are above p99, which 12 hardly settle
KILLER = Path(__file__).parents[2] / "tools" / "kill_recorder.py"  # of a checkout
KILL_SECONDS = 30.0  # [s] for one kill at most

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
    report = Report()
    report.details["counts"] = {name: _part(count, share) for name, count in _COUNTS.items()}

    def say(text: str) -> None:
        console.print(text, markup=False)

    with tempfile.TemporaryDirectory() as folder:
        with bus_measures.measured("exp1", Path(folder)) as twin:
            steps: Steps = [
                ("clients", lambda: _clients(twin, report, _part(CLIENTS, share))),
                ("malformed messages", lambda: _malformed(twin, report, _part(MESSAGES, share), Path(folder))),
            ]
            measure(steps, report, console)
        steps = [
            ("malformed messages on a robot's keys", lambda: _robot(report, _part(ROBOT, share))),
            ("starts and stops", lambda: _starts(report, _part(STARTS, share), say)),
            ("killed recorders", lambda: _kills(report, _part(KILLS, share))),
        ]
        measure(steps, report, console)
    return conclude(NAME, TITLE, LIMITS, report, out, console)


_COUNTS = {
    "clients": CLIENTS,
    "malformed messages": MESSAGES,
    "on a robot's keys": ROBOT,
    "starts": STARTS,
    "kills": KILLS,
}


def _part(count: int, share: float) -> int:
    return max(1, round(share * count))


def _clients(twin: Measured, report: Report, count: int) -> None:
    found = soak_measures.clients(twin, count)
    if found["without_state"]:
        raise RuntimeError(f"{found['without_state']:.0f} clients did not get the state within 30 s")
    report.values.update(memory_mb=found["memory_mb"], threads=found["threads"])
    report.details["clients"] = found


def _malformed(twin: Measured, report: Report, count: int, data: Path) -> None:
    """Half of them to a paused twin, for the hash of its state; at least as many while it runs, for its periods."""
    parts = [soak_measures.attack_paused(twin, count // 2)]
    playing = max(count - count // 2, round(PLAYING * count / MESSAGES))
    with bus_measures.measured("exp1", data) as other:
        parts.append(soak_measures.attack_playing(twin, playing, other))
    report.values["accepted"] = float(sum(part.counts["accepted"] for part in parts))
    report.values["unanswered"] = float(sum(part.counts["unanswered"] for part in parts))
    period = parts[1].period
    for name, reference in (("period", "without"), ("period_own", "elsewhere")):
        report.values[name] = period["attacked"]["p99"] / period[reference]["p99"]
    report.details["malformed"] = {how: sum(part.sent.get(how, 0) for part in parts) for how in parts[0].sent}
    report.details["period_ms"] = period
    for name in ("accepted", "unanswered"):
        if examples := [text for part in parts for text in getattr(part, name)]:
            report.details[name] = dict(enumerate(examples))


def _robot(report: Report, count: int) -> None:
    found = soak_robot.attack_robot(count)
    report.values["robot"] = found["differing"]
    report.details["robot"] = found


def _starts(report: Report, count: int, say: soak_measures.Say) -> None:
    with tempfile.TemporaryDirectory() as folder:
        report.details["starts"] = soak_measures.starts(count, Path(folder), say)
    report.values["left"] = 0.0


def _kills(report: Report, count: int) -> None:
    if not KILLER.is_file():
        report.skipped["lost_s"] = f"{KILLER.name} comes with a checkout only"
        return
    command = [sys.executable, str(KILLER), "--times", str(count)]
    ended = subprocess.run(  # noqa: S603 - our own tool
        command, capture_output=True, text=True, timeout=300.0 + KILL_SECONDS * count, check=False
    )
    said = (ended.stdout + ended.stderr).strip().splitlines() or ["nothing"]
    found = re.search(r"^\d+ kills, all files read and recovered: .*most ([0-9.]+) s$", ended.stdout, re.M)
    if found is None:
        raise RuntimeError(f"{KILLER.name} ended with exit code {ended.returncode} and said: {said[-1]}")
    report.values["lost_s"] = float(found[1])
    report.details["kills"] = found[0]
