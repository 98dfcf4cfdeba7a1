"""`motm-twin run`: a headless run, which may leave a session and a figure behind."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from motm_twin import interrupts
from motm_twin.cli.outputs import refuse_existing, refuse_unwritable, write_json
from motm_twin.cli.settings import RunSettings
from motm_twin.control.method import Method
from motm_twin.control.tick import Tick
from motm_twin.control.tuning import parameter
from motm_twin.methods.registry import FAST, find_method
from motm_twin.model.edits import ParameterValue
from motm_twin.model.names import scene_name
from motm_twin.model.plant import PERIODS_PER_SECOND
from motm_twin.model.scene import Scene
from motm_twin.model.scene_file import load_scene
from motm_twin.plants import with_plant
from motm_twin.program import table_console
from motm_twin.record.replay import Tracker
from motm_twin.record.what_if import parse_changes
from motm_twin.sessions.session import Session, SessionError, made_with, save_session
from motm_twin.trial import run_scene

if TYPE_CHECKING:
    from motm_twin.studies.speed_plot import SpeedFigure

_PARTS = {"at_limit": "at the speed limit", "below_limit": "below it"}  # parts that the report names by one word


def run(given: RunSettings) -> int:
    """Run a scene as the settings say, and tell how it went; the exit code."""
    refuse_unwritable(given.json)
    parameters = parse_changes(given.changes) if given.changes else {}
    scene = with_plant(load_scene(given.scene, given.variant, given.seed), given.plant)
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

    After Ctrl-C the session of the periods so far is kept, and KeyboardInterrupt says so.

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
            interrupts.loaded()  # everything is compiled: from now on there is a run to save
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
        keep(save, "")  # of a period that broke off
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
