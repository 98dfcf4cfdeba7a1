"""The runs in a recording, with all that is needed to repeat them; its contents as numbers and as text."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import msgspec
from rich.markup import escape
from rich.table import Table

from motm_twin.bus.messages import ObservationsMessage, StatusMessage
from motm_twin.methods import UNNAMED_METHOD
from motm_twin.model.edits import Edit
from motm_twin.model.names import scene_name
from motm_twin.model.plant import PERIOD
from motm_twin.model.scene import Scene
from motm_twin.program import table_console
from motm_twin.record import channels as ch
from motm_twin.record.channels import RecordedScene, RecordedSession
from motm_twin.record.mcap_file import Entry, Health, read
from motm_twin.sessions.session import MAX_PERIODS, Cut, LoggedEdit, Session, SessionError

MAX_EDITS = 500_000  # in one file: hours of dragging

RunKey = tuple[float, int]  # server time of the load or reset, number


_Number = Annotated[int, msgspec.Meta(ge=-(2**53), le=2**53)]
_Period = Annotated[int, msgspec.Meta(ge=-1, le=MAX_PERIODS)]


class _PlanPart(msgspec.Struct, frozen=True):
    expansions: _Number
    cut_by_clock: bool


class TickPart(msgspec.Struct, frozen=True):
    """The fields of a tick that are needed to repeat its period."""

    run: _Number
    index: _Period
    time: float
    plan: _PlanPart
    edits: list[Edit] = []
    began: float = 0.0
    first: _Period = 0
    past: _Number = -1
    preview: bool = False

    @property
    def key(self) -> RunKey:
        """Key of its run."""
        return self.began, self.run


@dataclass
class Run:
    """One run in a recording."""

    key: RunKey
    first: int  # first period of the run: where it branched from another, else 0
    past: int
    scene: Scene | None  # loaded when the run began
    plant: str = "simulated"
    method: str = UNNAMED_METHOD
    indices: list[int] = field(default_factory=list)  # recorded periods, rising
    edits: list[LoggedEdit] = field(default_factory=list)
    cuts: list[Cut] = field(default_factory=list)
    session: Session | None = None  # the last one that was recorded
    hashes: dict[int, str] = field(default_factory=dict)  # number of periods: state hash after them

    @property
    def missing(self) -> int:
        """Number of missing periods between the first and the last recorded one."""
        return self.indices[-1] - self.indices[0] + 1 - len(self.indices) if self.indices else 0


@dataclass
class Recording:
    """All runs of a file, in the order in which they began, and the condition of the file."""

    path: Path
    health: Health
    runs: list[Run]

    def session_of(self, run: Run) -> Session:
        """The session that repeats a run up to the last known period. Raises SessionError."""
        root, *later = self._line(run)
        whole = root.session
        if whole is None:
            assert root.scene is not None
            whole = Session(scene=root.scene, method=root.method)
        whole = _with_recorded(whole, root)
        for branch in later:
            if whole.periods < branch.first:
                raise SessionError(
                    f"it goes on from period {branch.first} of run {branch.past}, of which what was done is known only "
                    f"up to period {whole.periods}"
                )
            whole = _with_recorded(_until(branch.first, whole, ""), branch)
        return whole

    def _line(self, run: Run) -> list[Run]:
        """The run and its ancestors, oldest first, from one whose start is known. Raises SessionError."""
        known, line = {other.key: other for other in self.runs}, [run]
        while line[0].session is None and (line[0].first != 0 or line[0].scene is None):
            past = known.pop((run.key[0], line[0].past), None)  # each run once: a file may name runs in a circle
            if past is None or past is run:
                raise SessionError("the file does not tell how it began")
            line.insert(0, past)
        return line


def _with_recorded(base: Session, run: Run) -> Session:
    """A session continued with the recorded edits and cuts of a run, up to the last known period."""
    edits = [*base.edits, *(entry for entry in run.edits if entry.index >= base.periods)]
    cuts = [*base.cuts, *(cut for cut in run.cuts if cut.index >= base.periods)]
    end = base.periods
    for index in run.indices:
        if index > end:
            break  # the edits of the periods in between are unknown
        end = max(end, index + 1)
    whole = msgspec.structs.replace(base, edits=tuple(edits), cuts=tuple(cuts), parts={}, track=())
    return _until(end, whole, run.hashes.get(end, ""))


def _until(period: int, session: Session, state_hash: str) -> Session:
    edits = tuple(entry for entry in session.edits if entry.index < period)
    cuts = tuple(cut for cut in session.cuts if cut.index < period)
    return msgspec.structs.replace(session, edits=edits, cuts=cuts, periods=period, state_hash=state_hash)


def load_recording(path: str | Path) -> Recording:
    """Read a recording, without its ticks. Raises SessionError for a file that is no recording of a twin."""
    health, builder = Health(), _Builder()
    try:
        for entry in read(path, health):
            builder.take(entry)
    except SessionError as error:
        raise SessionError(error.problem, file=str(path)) from error
    except (msgspec.MsgspecError, UnicodeDecodeError) as error:
        raise SessionError(f"a message in it is not one of this version: {error}", file=str(path)) from error
    except RecursionError as error:
        raise SessionError("a message in it is nested too deeply", file=str(path)) from error
    return Recording(Path(path), health, list(builder.runs.values()))


def ticks_of(path: str | Path, key: RunKey) -> Iterator[tuple[int, bytes]]:
    """Index and payload of each recorded period of one run, once each, in rising order."""
    decode, last = msgspec.json.Decoder(TickPart).decode, -1
    for entry in read(path):
        if entry.topic == ch.TICK.topic:
            part = decode(entry.data)
            if part.key == key and not part.preview and part.index > last:
                last = part.index
                yield part.index, entry.data


def observations_of(path: str | Path, run: Run) -> Iterator[ObservationsMessage]:
    """Reports of the robot of a run, each period once, in rising order.

    A report names its run by the number only, and a restarted server uses the same numbers again. So each report
    belongs to the run of the tick before it. The first report may precede every tick: a recorder that starts between
    tick and report receives the report, and queries the tick that it missed.
    """
    decode, tick = msgspec.json.Decoder(ObservationsMessage).decode, msgspec.json.Decoder(TickPart).decode
    last, now = -1, None
    early: list[bytes] = []  # before any tick
    for entry in read(path):
        found: list[bytes] = []
        if entry.topic == ch.TICK.topic:
            now = tick(entry.data).key
            found, early = early, []
        elif entry.topic == ch.OBSERVATIONS.topic:
            (early if now is None else found).append(entry.data)
        for message in map(decode, found if now == run.key else ()):
            if message.run == run.key[1] and message.index > last:
                last = message.index
                yield message


class _Builder:
    def __init__(self) -> None:
        self.runs: dict[RunKey, Run] = {}
        self._scene: Scene | None = None
        self._plant, self._method = "simulated", UNNAMED_METHOD
        self._tick = msgspec.json.Decoder(TickPart).decode
        self._edits = 0

    def take(self, entry: Entry) -> None:
        match entry.topic:
            case ch.TICK.topic:
                self._on_tick(self._tick(entry.data))
            case ch.SCENE.topic:
                self._scene = msgspec.json.decode(entry.data, type=RecordedScene).scene
            case ch.STATUS.topic:
                status = msgspec.json.decode(entry.data, type=StatusMessage)
                self._plant, self._method = status.plant, status.method
            case ch.SESSION.topic:
                self._on_session(msgspec.json.decode(entry.data, type=RecordedSession))

    def _on_tick(self, tick: TickPart) -> None:
        if tick.preview:
            return
        run = self.runs.get(tick.key)
        if run is None:
            run = Run(tick.key, tick.first, tick.past, self._scene, self._plant, self._method)
            self.runs[tick.key] = run
        if run.indices and tick.index <= run.indices[-1]:
            return  # sent again with other explanations
        self._edits += len(tick.edits)
        if self._edits > MAX_EDITS:
            raise SessionError(f"has more than {MAX_EDITS:,} edits: it is no recording of a twin")
        run.indices.append(tick.index)
        run.edits += [LoggedEdit(index=tick.index, edit=edit) for edit in tick.edits]
        if tick.plan.cut_by_clock:
            run.cuts.append(Cut(index=tick.index, expansions=tick.plan.expansions))

    def _on_session(self, recorded: RecordedSession) -> None:
        run = self.runs.get((recorded.began, recorded.run))
        if run is not None:
            run.session, run.method = recorded.session, recorded.session.method
            if recorded.session.state_hash:
                run.hashes[recorded.session.periods] = recorded.session.state_hash


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
    """Print the contents of a recording."""
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
