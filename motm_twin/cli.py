"""The command line: `motm-twin serve | run | record | replay | rerun | what-if | scene | bench | ...`."""

import os
import sys
from pathlib import Path
from typing import Annotated, Literal

import tyro
from tyro.conf import Positional

from motm_twin import __version__
from motm_twin.bus.zenoh_config import ConfigError
from motm_twin.client.cli_client import send, twins, watch
from motm_twin.console import plain_console, table_console
from motm_twin.exit_codes import BAD_INPUT, FAILED, INTERRUPTED, OK
from motm_twin.external.cli_robot import robot
from motm_twin.interrupts import interruptible
from motm_twin.methods import DEFAULT_METHOD
from motm_twin.model.names import MethodError
from motm_twin.model.scene_error import SceneError
from motm_twin.record.cli_record import info, record, recover, replay, rerun
from motm_twin.security.cli_security import security
from motm_twin.sessions.session import SessionError
from motm_twin.settings import ServeSettings
from motm_twin.studies.paper.cli_paper import paper
from motm_twin.studies.settings import BenchSettings


def run(
    scene: Positional[str] = "exp1",
    /,
    variant: str | None = None,
    seed: int | None = None,
    json: Annotated[str | None, tyro.conf.arg(name="json", metavar="FILE|-")] = None,
    save: Annotated[str | None, tyro.conf.arg(metavar="FILE")] = None,
    plot: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None,
    method: str = DEFAULT_METHOD,
) -> int:
    """Run a scene headless, as fast as the processor allows.

    Exit code 0: the task was completed with no contact caused by the robot; 1: not; 2: bad input; 130: Ctrl-C.

    Args:
        scene: Shipped scene, path to a scene file, or generated:SEED@DIFFICULTY.
        variant: Named variant of the scene.
        seed: Seed of noise and random arrangements.
        json: Write the report to a file, or to standard output with '-'.
        save: Write the session to a new file, for `rerun` and `what-if`; after Ctrl-C too, up to there.
        plot: Write a figure (.png, .svg or .pdf): speed along the path, and each leg beside the reference tour.
        method: Who decides: fast (ours), motm (the paper's), or another of docs/method.md, or FILE.py:NAME of your own.
    """
    from motm_twin.cli_run import run_headless
    from motm_twin.methods.registry import find_method
    from motm_twin.record.outputs import refuse_unwritable, write_json

    refuse_unwritable(json)
    result = run_headless(scene, variant, seed, find_method(method), save=save, plot=plot)
    if json is not None:
        write_json(result, json)
    if json != "-":
        _print(result)
    return 0 if result["success"] else 1


def serve(settings: Annotated[ServeSettings, tyro.conf.arg(name="")]) -> int:
    """Serve the twin in the browser, and its state on Zenoh."""
    from motm_twin.cli_serve import serve as serve_twin

    return serve_twin(settings)


def what_if(
    file: Annotated[Positional[str], tyro.conf.arg(metavar="FILE")],
    /,
    changes: Annotated[
        tyro.conf.UseAppendAction[tuple[str, ...]], tyro.conf.arg(name="set", metavar="NAME=VALUE")
    ] = (),
    seconds: Annotated[float, tyro.conf.arg(name="from", metavar="SECONDS")] = 0.0,
    json: Annotated[str | None, tyro.conf.arg(name="json", metavar="FILE|-")] = None,
    stream: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False,
    method: Annotated[str | None, tyro.conf.arg(metavar="FILE.py:NAME")] = None,
) -> int:
    """Run a saved session as it was and with other parameters, both to the end of the task.

    Exit code 0: both were run; 1: one broke; 2: bad input.

    Args:
        file: A saved session.
        changes: A parameter and its value; may be given several times. docs/zenoh.md lists them (Parameters).
        seconds: Simulated time from which the parameters are others; 0 for the whole run.
        json: Write the report to a file, or to standard output with '-'.
        stream: Write the poses of both robots at 10 Hz and their ends as JSON lines instead.
        method: For a session that was made with a method of your own: its file.
    """
    from motm_twin.record.cli_what_if import what_if as compare

    return compare(file, list(changes), seconds=seconds, report=json, lines=stream, method=method)


def scene(
    action: Positional[Literal["list", "check", "schema", "generate"]],
    path: Positional[str | None] = None,
    /,
    seed: int | None = None,
    difficulty: float | None = None,
    output: Annotated[Path | None, tyro.conf.arg(aliases=["-o"], metavar="FILE")] = None,
) -> int:
    """List the shipped scenes, check a scene file, print the JSON Schema of scene files, or make a new scene.

    Args:
        action: What to do.
        path: Scene name or file, for check.
        seed: Of the generated scene; the same seed and difficulty give the same file.
        difficulty: Of the generated scene, from 0 (easy) to 1 (hard); 0.5 without it.
        output: New file for the generated scene; without it, it is printed.
    """
    from motm_twin import cli_scene

    if action == "generate":
        return cli_scene.generate_scene(seed, difficulty, output, path)
    if (seed, difficulty, output) != (None, None, None):
        raise SceneError(f"scene {action}: --seed, --difficulty and --output belong to scene generate")
    if action == "list":
        return cli_scene.list_scenes()
    if action == "schema":
        return cli_scene.print_schema()
    if path is None:
        raise SceneError("scene check: name a shipped scene or a file to check")
    return cli_scene.check_scene(path)


def bench(settings: Annotated[BenchSettings, tyro.conf.arg(name="")]) -> int:
    """Measure, as tables and JSON: the trials behind the numbers of the README, the page, Zenoh, a router.

    With methods, trials, changes, backend, address or retry-failed: an experiment (exp1, exp1a, exp2, blind, one_temi,
    ablations, grasp_delay, robustness, mismatch, quick_robot, further_scenes, generated, sweep_next_weight,
    sweep_bezier_offset, sweep_radius_min, sweep_radius_max), compared in a table. It is kept on disk: after Ctrl-C or a
    crash the same command goes on where it ended.
    """
    from motm_twin.studies.bench import run_bench

    return run_bench(settings)


def main() -> None:
    """Run the command that was given; its exit code, 1 when nobody reads what it prints, 130 after Ctrl-C."""
    try:
        try:
            code = _called()
        finally:
            sys.stdout.flush()  # that nobody reads any more shows here at the latest
    except BrokenPipeError:  # "Note on SIGPIPE" of Python's signal: what is left must not be written at the end again
        _give_up_output()
        code = FAILED
    except OSError as error:
        if not _output_fails():
            raise
        _give_up_output()
        print(f"motm-twin: standard output cannot be written: {error.strerror or error}", file=sys.stderr)
        code = BAD_INPUT
    except KeyboardInterrupt as stopped:
        print("; ".join(["motm-twin: stopped", *stopped.args]), file=sys.stderr)
        code = INTERRUPTED
    sys.exit(code)


def _output_fails() -> bool:
    """It is standard output that cannot be written, as on a full disk."""
    try:
        sys.stdout.flush()
        return os.write(sys.stdout.fileno(), b"") < 0
    except OSError:
        return True


def _give_up_output() -> None:
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _called() -> int:
    """The exit code of the command."""
    if sys.argv[1:] == ["--version"]:
        print(f"motm-twin {__version__}")
        return OK
    try:
        return tyro.extras.subcommand_cli_from_dict(
            {
                # These have handlers of their own, or say when they are loaded.
                **{command.__name__: command for command in (serve, run, record, replay, robot)},
                **{
                    name: interruptible(command)
                    for name, command in {
                        "rerun": rerun,
                        "info": info,
                        "recover": recover,
                        "what-if": what_if,
                        "watch": watch,
                        "send": send,
                        "twins": twins,
                        "scene": scene,
                        "bench": bench,
                        "paper": paper,
                        "security": security,
                    }.items()
                },
            },
            prog="motm-twin",
            description="Reactive manipulation on the move, as a digital twin. --version says which.",
        )
    except (SceneError, SessionError, ConfigError, MethodError) as error:
        plain_console(stderr=True).print(f"motm-twin: {error}", markup=False)
        return BAD_INPUT


def _print(result: dict) -> None:
    console = table_console()
    console.print(f"[bold]{result['scene']} / {result['variant']}[/bold], seed {result['seed']}: ", end="")
    console.print("[green]completed[/green]" if result["success"] else f"[red]failed[/red]: {result['reason']}")
    console.print(
        f"time {result['time_s']:.2f} s (reference tour {result['reference_tour_s']:.1f} s), "
        f"picked {result['picks_done']}/{result['picks_total']}, "
        f"placed {result['places_done']}/{result['places_total']}, "
        f"contacts {result['contacts_caused_by_robot']} caused of {len(result['contacts'])}"
        + (f", cut in on agents {len(result['cut_ins'])} times" if result["cut_ins"] else "")
    )
    measures = result["measures"]
    parts = ", ".join(f"{name.replace('_', ' ')} {seconds:.1f}" for name, seconds in measures["parts_s"].items())
    console.print(f"seconds by part: {parts}")
    reference = sum(leg["reference_m"] or 0.0 for leg in measures["legs"])
    felt = measures["arm_base_acceleration_mps2"]["p99"]
    console.print(
        f"path {result['path_length_m']:.1f} m (reference tour {reference:.1f} m; leg by leg in --json and --plot)"
        + ("" if felt is None else f"; the arm's foot feels {felt:.2f} m/s^2 at p99, ")
        + ("" if felt is None else f"{measures['yaw_sign_changes_per_m']:.2f} changes of turning per metre")
    )
    tick = result["tick_ms"]
    console.print(
        f"period p50 {tick['p50']:.1f} ms, p99 {tick['p99']:.1f} ms, max {tick['max']:.1f} ms; "
        f"{result['realtime_factor']:.1f} x real time; state {result['state_hash'][:12]}"
    )


if __name__ == "__main__":
    main()
