"""Contents of a recording, as numbers and as text."""

from pathlib import Path

import msgspec
from rich.markup import escape
from rich.table import Table

from motm_twin.methods import UNNAMED_METHOD
from motm_twin.model.names import scene_name
from motm_twin.model.period import PERIOD
from motm_twin.program import table_console
from motm_twin.record.reader import Health, read
from motm_twin.record.recording import load_recording


class ChannelInfo(msgspec.Struct, frozen=True, kw_only=True):
    """One topic."""

    topic: str
    schema: str
    messages: int
    rate: float  # [1/s]
    megabytes: float  # before compression


class RunInfo(msgspec.Struct, frozen=True, kw_only=True):
    """One run."""

    run: int
    scene: str
    from_s: float  # simulated
    to_s: float
    periods: int
    missing: int
    edits: int
    cuts: int
    hashes: int  # states whose hash a rerun compares
    plant: str
    method: str = UNNAMED_METHOD


class Info(msgspec.Struct, frozen=True, kw_only=True):
    """A file."""

    file: str
    megabytes: float
    complete: bool
    text: str  # why it is not complete
    seconds: float  # by the clock of the server
    megabytes_per_minute: float
    runs: list[RunInfo]
    channels: list[ChannelInfo]


def info(path: str | Path) -> Info:
    """Read a whole recording. Raises SessionError for a file that is none."""
    counts: dict[str, list[float]] = {}
    schemas: dict[str, str] = {}
    health, first, last = Health(), 0, 0
    for entry in read(path, health):
        count = counts.setdefault(entry.topic, [0, 0])
        count[0] += 1
        count[1] += len(entry.data)
        schemas[entry.topic] = entry.schema
        first = entry.log_time if not first else min(first, entry.log_time)
        last = max(last, entry.log_time)
    seconds, megabytes = (last - first) / 1e9, health.size / 1e6
    return Info(
        file=str(path),
        megabytes=round(megabytes, 3),
        complete=health.complete,
        text=health.text,
        seconds=round(seconds, 3),
        megabytes_per_minute=round(60.0 * megabytes / seconds, 2) if seconds else 0.0,
        runs=_runs(path),
        channels=[
            ChannelInfo(
                topic=topic,
                schema=schemas[topic],
                messages=int(messages),
                rate=round(messages / seconds, 2) if seconds else 0.0,
                megabytes=round(size / 1e6, 3),
            )
            for topic, (messages, size) in sorted(counts.items())
        ],
    )


def _runs(path: str | Path) -> list[RunInfo]:
    found = []
    for run in load_recording(path).runs:
        scene = run.session.scene if run.session is not None else run.scene
        found.append(
            RunInfo(
                run=run.key[1],
                scene="" if scene is None else f"{scene_name(scene.name, scene.variant)}, seed {scene.seed}",
                from_s=round(run.indices[0] * PERIOD, 3),
                to_s=round((run.indices[-1] + 1) * PERIOD, 3),
                periods=len(run.indices),
                missing=run.missing,
                edits=len(run.edits),
                cuts=len(run.cuts),
                hashes=len(run.hashes),
                plant=run.plant,
                method=run.method,
            )
        )
    return found


def show(found: Info) -> None:
    """Print it."""
    console = table_console()
    console.print(found.file, style="bold", markup=False)
    console.print(
        f"{found.seconds:.1f} s, {found.megabytes:.2f} MB ({found.megabytes_per_minute:.1f} MB a minute), "
        + ("complete" if found.complete else f"not complete: {found.text}; `motm-twin recover` writes a whole one"),
        markup=False,
    )
    runs = Table("run", "scene", "simulated", "periods", "missing", "edits", "hashes", "plant", "method")
    for run in found.runs:
        span = f"{run.from_s:.2f} to {run.to_s:.2f} s"
        row = (run.run, run.scene, span, run.periods, run.missing, run.edits, run.hashes, run.plant, run.method)
        runs.add_row(*(escape(str(value)) for value in row))
    console.print(runs)
    channels = Table("topic", "schema", "messages", "1/s", "MB")
    for channel in found.channels:
        numbers = (str(channel.messages), f"{channel.rate:.1f}", f"{channel.megabytes:.2f}")
        channels.add_row(escape(channel.topic), escape(channel.schema), *numbers)
    console.print(channels)
