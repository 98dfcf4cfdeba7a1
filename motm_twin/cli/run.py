"""`motm-twin run | rerun | what-if`: a headless run, which can save a session and a figure.

A session or a recording is run again and compared bit for bit; or a session is run with other parameters.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self

import msgspec
from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, Progress, TextColumn
from rich.table import Table

from motm_twin import processes
from motm_twin.cli.scene import load_with_doubts
from motm_twin.cli.settings import RunSettings
from motm_twin.control.method import Method
from motm_twin.control.tick import Tick
from motm_twin.control.tuning import parameter
from motm_twin.methods.registry import FAST, find_method
from motm_twin.model.edits import ParameterValue
from motm_twin.model.names import scene_name
from motm_twin.model.plant import PERIOD, PERIODS_PER_SECOND
from motm_twin.model.scene import Scene
from motm_twin.plants import with_plant
from motm_twin.program import FAILED, OK, plain_console, refuse_existing, refuse_unwritable, table_console, write_json
from motm_twin.record.recording import load_recording
from motm_twin.record.replay import Rerun, RunReport, Tracker, rerun, rerun_run, updated
from motm_twin.record.what_if import (
    AS_IT_WAS,
    CHANGED,
    Line,
    Outcome,
    RunBroke,
    Sample,
    compare,
    parse_changes,
    start_period,
    stream,
)
from motm_twin.sessions.session import Session, SessionError, load_session, made_with, save_session
from motm_twin.trial import run_scene

if TYPE_CHECKING:
    from motm_twin.studies.speed_plot import SpeedFigure

SHOWN_CONTACTS = 5  # contacts of a run that are printed; its JSON has all
_PARTS = {"at_limit": "at the speed limit", "below_limit": "below it"}  # parts that the report names by one word


def run(given: RunSettings) -> int:
    """Run a scene by these settings and print the report; the exit code."""
    refuse_unwritable(given.json)
    parameters = parse_changes(given.changes) if given.changes else {}
    scene = with_plant(load_with_doubts(given.scene, given.variant, given.seed), given.plant)
    result = run_headless(scene, find_method(given.method), parameters, save=given.save, plot=given.plot)
    if given.json is not None:
        write_json(result, given.json)
    if given.json != "-":
        print_report(result)
    return 0 if result["success"] else 1


def run_headless(
    loaded: Scene, method: Method = FAST, parameters: dict[str, ParameterValue] | None = None, *,
    save: str | None = None, plot: Path | None = None,
) -> dict[str, Any]:  # fmt: skip
    """Run a scene to its end; the report of the run. Raises SceneError and SessionError, before it runs.

    After Ctrl-C the session so far is saved, and the KeyboardInterrupt says so.

    ``parameters``: by name, on top of the method's; ``save``: new file of the session; ``plot``: file of the figure
    of `studies.speed_plot`.
    """
    refuse_unwritable(save, plot)
    refuse_existing(save)
    figure = None if plot is None else _figure(loaded, plot)
    tracker, periods = Tracker(), 0

    def on_tick(tick: Tick) -> None:
        nonlocal periods
        if not periods:
            processes.loaded()  # all is compiled: from now on there is a run to save
        periods = tick.index + 1
        if save is not None:
            tracker.add(tick)
        if figure is not None:
            figure.add(tick)

    def keep(file: str, state_hash: str) -> None:
        whole = {**method.parameters, **(parameters or {})}
        changed = {name: value for name, value in whole.items() if value != parameter(name).default}
        saved = Session(
            title=f"{loaded.title}, headless",
            made_with=made_with(physics=loaded.physics is not None),
            scene=loaded,
            method=method.name,
            parameters=changed,
            periods=periods,
            state_hash=state_hash,
            track=tracker.track,
        )
        save_session(saved, file)

    try:
        report = run_scene(loaded, on_tick=on_tick, method=method, parameters=parameters)
    except KeyboardInterrupt:
        if save is None or periods == 0:
            raise
        keep(save, "")  # no hash: the period was interrupted
        raise KeyboardInterrupt(f"the {periods / PERIODS_PER_SECOND:.2f} s before are in {save}") from None
    if figure is not None:
        figure.draw(report, plot)
    if save is not None:
        keep(save, report["state_hash"])
    return report


def _figure(scene: Scene, file: Path) -> SpeedFigure:
    """Collector of the figure's data; raises SessionError for an unsupported kind of file."""
    from motm_twin.studies.speed_plot import FORMATS, SpeedFigure

    if file.suffix.lower() not in FORMATS:
        raise SessionError(f"no figure: give a file that ends in {', '.join(FORMATS)}", file=str(file))
    return SpeedFigure(scene)


def print_report(result: dict) -> None:
    """Print the report of a run."""
    console = table_console()
    console.print(f"[bold]{scene_name(result['scene'], result['variant'])}[/bold], seed {result['seed']}: ", end="")
    console.print("[green]completed[/green]" if result["success"] else f"[red]failed[/red]: {result['reason']}")
    console.print(
        f"time {result['time_s']:.2f} s (reference tour {result['reference_tour_s']:.1f} s), "
        f"picked {result['picks_done']}/{result['picks_total']}, "
        f"placed {result['places_done']}/{result['places_total']}, "
        f"contacts {result['contacts_caused_by_robot']} caused of {len(result['contacts'])}"
        + (f", cut in on agents {len(result['cut_ins'])} times" if result["cut_ins"] else "")
    )
    for contact in result["contacts"][:SHOWN_CONTACTS]:
        deep = f"{1e3 * contact['depth']:.1f} mm deep" + ", not the robot's doing" * (not contact["caused_by_robot"])
        console.print(f"  {contact['time']:.2f} s: {contact['body']} in {contact['other']}, {deep}")
    if len(result["contacts"]) > SHOWN_CONTACTS:
        console.print(f"  and {len(result['contacts']) - SHOWN_CONTACTS} more; all are in --json")
    measures = result["measures"]
    parts = ", ".join(
        f"{_PARTS.get(name, name.replace('_', ' '))} {seconds:.1f}" for name, seconds in measures["parts_s"].items()
    )
    console.print(f"seconds by part: {parts}")
    reference = sum(leg["reference_m"] or 0.0 for leg in measures["legs"])
    felt = measures["arm_base_acceleration_mps2"]["p99"]
    console.print(
        f"path {result['path_length_m']:.1f} m (reference tour {reference:.1f} m; leg by leg in --json and --plot)"
        + ("" if felt is None else f"; acceleration at the arm's mount {felt:.2f} m/s^2 at p99, ")
        + ("" if felt is None else f"{measures['yaw_sign_changes_per_m']:.2f} changes of turning direction per metre")
    )
    tick = result["tick_ms"]
    console.print(
        f"period p50 {tick['p50']:.1f} ms, p99 {tick['p99']:.1f} ms, max {tick['max']:.1f} ms; "
        f"{result['realtime_factor']:.1f} x real time; state {result['state_hash'][:12]}"
    )


def rerun_file(file: str, *, update: bool = False, report: str | None = None, method: str | None = None) -> int:
    """Rerun a session or a recording; the exit code: 0 equal (or updated), 1 different, or a session without a hash.

    ``update`` writes the new hash into the file; ``report``: file of the JSON report, '-' for standard output;
    ``method``: FILE.py:NAME of a user's method, for files made with it. Raises SessionError for an unusable file,
    such as a recording of which no run can be computed, MethodError for an unusable method.
    """
    refuse_unwritable(report)
    own = None if method is None else find_method(method)
    if file.endswith(".mcap"):
        if update:
            raise SessionError("--update is for saved sessions: a recording stays as it was", file=file)
        return _rerun_recording(file, report, own)
    session = load_session(file)
    try:
        again = rerun(session, own)
    except SessionError as error:
        raise SessionError(error.problem, file=file) from error
    if report != "-":
        _print(session, again)
    if update:
        save_session(updated(session, again), file)
        if report != "-":
            plain_console().print(f"{file} was written with this run's state.", markup=False)
    if report is not None:
        write_json({"file": file, "updated": update, **msgspec.to_builtins(again)}, report)
    return OK if again.ok or update else FAILED


class NotComputed(msgspec.Struct, frozen=True, kw_only=True):
    """A run that cannot be compared: neither equal nor different."""

    run: int
    text: str  # the reason


def _rerun_recording(file: str, report: str | None, own: Method | None) -> int:
    """Rerun every run of a recording that can be computed. Raises SessionError when none can."""
    recording = load_recording(file)
    console = plain_console()
    if not recording.runs:
        raise SessionError("holds no period of a twin: `motm-twin info` tells what is in it", file=file)
    found: list[RunReport] = []
    left: list[NotComputed] = []
    for run in recording.runs:
        try:
            found.append(rerun_run(recording, run, own))
        except SessionError as error:
            left.append(NotComputed(run=run.key[1], text=error.problem))
            continue
        if report != "-":
            _print_run(console, found[-1])
    if not found:
        reasons = "; ".join(f"run {run.run}: {run.text}" for run in left)
        raise SessionError(f"no run in it can be computed again: {reasons}", file=file)
    ok = all(run.ok for run in found)
    if report != "-":
        for run in left:
            console.print(f"run {run.run}", style="bold", markup=False)
            console.print("[yellow]not computed[/yellow], which is no difference: ", end="")
            console.print(run.text, markup=False)
        if not recording.health.complete:
            text = f"the file is not complete ({recording.health.text}): only what is whole in it could be compared"
            console.print(text, markup=False)
    if report is not None:
        parts = {"complete": recording.health.complete, "text": recording.health.text}
        runs = {"runs": msgspec.to_builtins(found), "not_computed": msgspec.to_builtins(left)}
        write_json({"file": file, "ok": ok, **parts, **runs}, report)
    return OK if ok else FAILED


def _print_run(console: Console, run: RunReport) -> None:
    console.print(f"run {run.run}: {run.scene}", style="bold", markup=False)
    if run.text:
        console.print("[yellow]note[/yellow]: ", end="")
        console.print(run.text, markup=False)
    if run.ok:
        compared = f"{run.compared} of {run.periods} periods and {run.hashes} states compared"
        console.print(f"[green]equal[/green] bit for bit: {compared}; ends in state {run.state_hash[:12]}")
        return
    console.print(f"[red]different[/red] first in period {run.period} ({run.period * PERIOD:.2f} s):")
    for line in run.fields:
        console.print(f"  {line}", markup=False)
    for line in run.differences:
        console.print(f"  also different: {line}", markup=False)


def explain(again: Rerun) -> str:
    """Likely reasons why the states differ; "" when they are equal."""
    if again.ok:
        return ""
    made = "; also different: " + ", ".join(again.differences) if again.differences else ""
    return f"recorded {again.recorded_hash or 'nothing'}, now {again.state_hash}; {again.first_sign}{made}"


def _print(session: Session, again: Rerun) -> None:
    console = plain_console()
    scene = session.scene
    name = f"{scene_name(scene.name, scene.variant)}, seed {scene.seed}" + (
        f": {session.title}" if session.title else ""
    )
    console.print(name, style="bold", markup=False)
    console.print(
        f"method {session.method}, time {again.time_s:.2f} s, {again.periods} periods ({again.periods * PERIOD:.2f} s "
        f"of recording), {len(session.edits)} edits, {len(session.cuts)} searches cut by the clock",
        markup=False,
    )
    if again.ok:
        console.print(f"[green]equal[/green] bit for bit: state {again.state_hash[:12]}")
        return
    if not again.recorded_hash:
        console.print("[yellow]not compared[/yellow]: ", end="")
        console.print(f"{again.first_sign}; this run ends in state {again.state_hash[:12]}", markup=False)
        return
    console.print("[red]different[/red]: ", end="")
    console.print(explain(again), markup=False)


STEP = 5.0  # [s] least simulated time between two lines


def what_if(
    file: str, changes: list[str], *, seconds: float, report: str | None, lines: bool, method: str | None
) -> int:
    """Run and print both runs; the exit code. ``lines``: print JSON lines of both instead, see `record.what_if`.

    ``method``: FILE.py:NAME of a user's method, for a session made with it.

    Raises SessionError for a file, a parameter or a time that cannot be used.
    """
    if lines:
        return stream(file, changes, seconds, method)
    refuse_unwritable(report)
    session = load_session(file)
    values, start = parse_changes(changes), start_period(session, seconds)
    try:
        console = plain_console(stderr=True) if report == "-" else table_console()
        ends = _run_both(compare(session, values, start, method), session.periods / PERIODS_PER_SECOND, console)
    except SessionError as error:
        raise SessionError(error.problem, file=file) from error
    except RunBroke as error:
        plain_console(stderr=True).print(f"motm-twin what-if: {error}", markup=False)
        return FAILED
    was, changed = ends[AS_IT_WAS], ends[CHANGED]
    if report is not None:
        parts = {"as_it_was": msgspec.to_builtins(was), "changed": msgspec.to_builtins(changed)}
        gain = round(changed.time_s - was.time_s, 3)
        write_json({"file": file, "from_s": seconds, "parameters": values, "difference_s": gain, **parts}, report)
    if report != "-":
        _print_both(was, changed, f"{', '.join(changes)} from {seconds:g} s")
    return OK


def _run_both(lines: Iterator[Line], recorded: float, console: Console) -> dict[str, Outcome]:
    """Outcomes of both runs, with their progress on the console. ``recorded``: [s]."""
    ends: dict[str, Outcome] = {}
    with BothRuns(recorded, console) as progress:
        for line in lines:
            progress.add(line)
            if isinstance(line, Outcome):
                ends[line.run] = line
    return ends


def _print_both(was: Outcome, changed: Outcome, title: str) -> None:
    console = table_console()
    table = Table("", "as it was", "changed", "difference")
    for column in table.columns[1:]:
        column.justify = "right"
    table.add_row(escape("time [s]"), *_numbers(was.time_s, changed.time_s, 2))
    begins = ["as recorded" if end.forecast_from_s is None else f"{end.forecast_from_s:.2f}" for end in (was, changed)]
    table.add_row(escape("forecast from [s]"), *begins, "")
    table.add_row("picks", *_numbers(was.picks, changed.picks, 0))
    table.add_row("places", *_numbers(was.places, changed.places, 0))
    table.add_row("contacts", *_numbers(was.all_contacts, changed.all_contacts, 0))
    table.add_row("contacts caused", *_numbers(was.contacts, changed.contacts, 0))
    table.add_row(escape("distance driven [m]"), *_numbers(was.path_length, changed.path_length, 2))
    table.add_row("success", *("yes" if end.success else "no" for end in (was, changed)), "")
    console.print(title, style="bold", markup=False)
    console.print(table)
    lines = [f"{end.run}: {end.reason}" for end in (was, changed) if end.reason]
    for end, why in ((was, "the recording ends there"), (changed, "the change begins there")):
        if end.forecast_from_s is not None:
            lines.append(
                f"{end.run}: forecast from {end.forecast_from_s:g} s on ({why}): no clock cuts its searches, "
                "so a live run may end at another time"
            )
    lines += [f"left out of the changed run: {note}" for note in changed.skipped]
    for line in lines:
        console.print(line, markup=False)


def _numbers(was: float, changed: float, digits: int) -> tuple[str, str, str]:
    return f"{was:.{digits}f}", f"{changed:.{digits}f}", f"{changed - was:+.{digits}f}"


class BothRuns:
    """A bar for each run while the console is a terminal; without one, a line for every further tenth of both.

    ``recorded`` [s] is the length of the recording; the length of a run is unknown.
    """

    def __init__(self, recorded: float, console: Console) -> None:
        self._recorded, self._console = recorded, console
        self._step = max(STEP, recorded / 10.0)
        self._next = self._step
        self._times = {AS_IT_WAS: 0.0, CHANGED: 0.0}  # [s] simulated
        self._running = set(self._times)
        columns = (TextColumn("  {task.description:9}"), BarColumn(), TextColumn("{task.fields[note]}"))
        self._progress = Progress(*columns, console=console, disable=not console.is_terminal)
        self._tasks = {run: self._progress.add_task(run, total=max(recorded, 0.05), note="") for run in self._times}

    def __enter__(self) -> Self:
        self._progress.start()
        self._say(f"running both: {self._recorded:.2f} s are recorded")
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self._progress.stop()

    def add(self, line: Sample | Outcome) -> None:
        """Take a line of one of the runs into account."""
        if isinstance(line, Outcome):
            self._running.discard(line.run)
            self._progress.update(self._tasks[line.run], total=1.0, completed=1.0, note=f"ended at {line.time_s:.2f} s")
            self._say(f"{line.run}: ended at {line.time_s:.2f} s")
            return
        self._times[line.run] = line.time
        note = f"{line.time:.0f} s, {self._recorded:.0f} s recorded"
        self._progress.update(self._tasks[line.run], completed=line.time, note=note)
        if min(self._times[run] for run in self._running) >= self._next:
            self._next += self._step
            self._say(", ".join(f"{run}: {self._times[run]:.0f} s" for run in self._times if run in self._running))

    def _say(self, text: str) -> None:
        if not self._console.is_terminal:
            self._console.print(f"  {text}", markup=False)
