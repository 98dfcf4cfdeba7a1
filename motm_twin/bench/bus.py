"""The numbers of the bus: how soon ticks and commands arrive, and what readers and recordings cost the loop."""

import importlib.util
import tempfile
from pathlib import Path

from rich.console import Console

from motm_twin.bench import bus_measures
from motm_twin.bench.bus_measures import Measured
from motm_twin.bench.report import Limit, Report, Steps, conclude, measure
from motm_twin.bus.pacing import PERIOD

NAME = "bus"
TITLE = "The bus: Experiment 1 at 1x on Zenoh, measured in other processes; all in one run"
RECORDER = "motm_twin.record.recorder_process"
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

    Takes about 7 x ``seconds`` + 1 min; more than 75 s of each are not used.
    """
    console.print(f"\n[bold]{NAME}[/bold]: {TITLE}")
    report, each = Report(), min(seconds, bus_measures.LONGEST)
    with tempfile.TemporaryDirectory() as folder, bus_measures.measured("exp1", Path(folder)) as twin:
        steps: Steps = [
            ("tick to subscriber", lambda: _latency(twin, report, each)),
            ("publishing", lambda: _publishing(twin, report, each)),
            ("command to effect", lambda: _effect(twin, report, each)),
            ("age of what readers get", lambda: _ages(twin, report, each)),
            ("recording", lambda: _recording(twin, report, each / 4)),
        ]
        measure(steps, report, console)
    return conclude(NAME, TITLE, LIMITS, report, out, console)


def _latency(twin: Measured, report: Report, seconds: float) -> None:
    found = bus_measures.latency(twin, seconds)
    report.values["above_bare_ms"] = found["tick"]["p99"] - found["bare"]["p99"]
    report.details["tick_to_subscriber_ms"] = found


def _publishing(twin: Measured, report: Report, seconds: float) -> None:
    found = bus_measures.publishing(twin, seconds)
    report.values["sink_ms"] = found["50 subscribers"]["p99"]
    report.details["publishing_in_the_loop_ms"] = found


def _effect(twin: Measured, report: Report, seconds: float) -> None:
    found = bus_measures.effect(twin, seconds)
    if found["never seen"]["count"]:
        raise RuntimeError(f"{found['never seen']['count']:.0f} commands were accepted and never seen in a tick")
    report.values["effect_ms"] = found["sent to start of its period"]["p99"]
    report.values["shown_ms"] = found["answer to its tick"]["p99"]
    report.details["command_to_effect_ms"] = found


def _ages(twin: Measured, report: Report, seconds: float) -> None:
    found = bus_measures.ages(twin, seconds)
    report.values["age_ms"] = max(values["p99"] for values in found.values())
    report.details["age_ms"] = found


def _recording(twin: Measured, report: Report, seconds: float) -> None:
    if importlib.util.find_spec(RECORDER) is None:
        reason = f"there is no {RECORDER}"
        report.skipped |= {"recording": reason, "file_mb": reason}
        return
    found = bus_measures.recording(twin, seconds)
    report.values["recording"] = found["extra %"]["of the loop's time"]
    report.values["file_mb"] = found["file"]["MB/min"]
    report.details["recording"] = found
