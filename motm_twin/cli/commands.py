"""Commands of the command line, each with its options and help. What they do is imported when they are called."""

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Literal

import tyro
from tyro.conf import Positional

from motm_twin import __version__
from motm_twin.cli.doctor import doctor
from motm_twin.cli.paper import paper
from motm_twin.cli.record import info, record, recover, replay, rerun
from motm_twin.cli.robot import robot
from motm_twin.cli.security import security
from motm_twin.cli.settings import RunSettings, Seed, ServeSettings
from motm_twin.interrupts import interruptible
from motm_twin.model.scene_error import SceneError
from motm_twin.studies.settings import BenchSettings

Flag = Annotated[bool, tyro.conf.FlagCreatePairsOff]
Endpoint = Annotated[str | None, tyro.conf.arg(metavar="ENDPOINT")]
Twin = Annotated[str | None, tyro.conf.arg(metavar="NAME")]
Changes = Annotated[tyro.conf.UseAppendAction[tuple[str, ...]], tyro.conf.arg(name="set", metavar="NAME=VALUE")]


def run(settings: Annotated[RunSettings, tyro.conf.arg(name="")]) -> int:
    """Run a scene headless, as fast as the processor allows.

    Exit code 0: the task was completed with no contact caused by the robot; 1: not; 2: bad input; 130: Ctrl-C.
    """
    from motm_twin.cli.run import run as run_scene

    return run_scene(settings)


def serve(settings: Annotated[ServeSettings, tyro.conf.arg(name="")]) -> int:
    """Serve the twin in the browser, and its state on Zenoh."""
    from motm_twin.cli.serve import serve as serve_twin

    return serve_twin(settings)


def what_if(
    file: Annotated[Positional[str], tyro.conf.arg(metavar="FILE")],
    /,
    changes: Changes = (),
    seconds: Annotated[float, tyro.conf.arg(name="from", metavar="SECONDS")] = 0.0,
    json: Annotated[str | None, tyro.conf.arg(name="json", metavar="FILE|-")] = None,
    stream: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False,
    method: Annotated[str | None, tyro.conf.arg(metavar="FILE.py:NAME")] = None,
) -> int:
    """Run a saved session as it was and with other parameters, both to the end of the task.

    Exit code 0: both were run; 1: one broke; 2: bad input.

    Args:
        file: A saved session.
        changes: Set a parameter (docs/zenoh.md lists them) to a value; may be repeated.
        seconds: Simulated time from which the changes hold; 0 for the whole run.
        json: Write the report to a file, or to standard output with '-'.
        stream: Instead, write the poses of both robots at 10 Hz and their outcomes as JSON lines.
        method: File of your own method, if the session was made with one.
    """
    from motm_twin.cli.rerun import what_if as compare

    return compare(file, list(changes), seconds=seconds, report=json, lines=stream, method=method)


def scene(
    action: Positional[Literal["list", "check", "schema", "generate"]],
    path: Annotated[Positional[str | None], tyro.conf.arg(metavar="[SCENE]")] = None,
    /,
    seed: Seed = None,
    difficulty: Annotated[float | None, tyro.conf.arg(metavar="FLOAT")] = None,
    output: Annotated[Path | None, tyro.conf.arg(aliases=["-o"], metavar="FILE")] = None,
) -> int:
    """List the shipped scenes, check a scene file, print the JSON Schema of scene files, or make a new scene.

    Args:
        action: What to do.
        path: For check: name or file of a scene; - reads standard input.
        seed: For generate: the same seed and difficulty give the same file.
        difficulty: For generate: from 0 (easy) to 1 (hard); 0.5 without it.
        output: For generate: the new file; without it, the scene is printed.
    """
    from motm_twin.cli.scene import check_scene, generate_scene, list_scenes, print_schema

    if action == "generate":
        return generate_scene(seed, difficulty, output, path)
    if (seed, difficulty, output) != (None, None, None):
        raise SceneError(f"scene {action}: --seed, --difficulty and --output belong to scene generate")
    if action == "list":
        return list_scenes()
    if action == "schema":
        return print_schema()
    if path is None:
        raise SceneError("scene check: name a shipped scene or a file to check")
    return check_scene(path)


def bench(settings: Annotated[BenchSettings, tyro.conf.arg(name="")]) -> int:
    """Measure trials, the page, Zenoh or a router, as tables and JSON; or compare methods.

    A group, such as exp1, measures the numbers of the README. With --methods, --trials, --changes, --backend, --address
    or --retry-failed it runs an experiment and compares the methods in a table: exp1, exp1a, exp2, blind, one_temi,
    ablations, grasp_delay, robustness, mismatch, quick_robot, further_scenes, generated, sweep_next_weight,
    sweep_bezier_offset, sweep_radius_min or sweep_radius_max. Trials are kept on disk: after Ctrl-C or a crash the same
    command resumes.
    """
    from motm_twin.cli.bench import run_bench

    return run_bench(settings)


def watch(
    key: Annotated[Positional[str], tyro.conf.arg(metavar="[KEY]")] = "tick",
    /,
    once: Flag = False,
    json: Annotated[Flag, tyro.conf.arg(name="json")] = False,
    field: Annotated[str | None, tyro.conf.arg(metavar="PATH")] = None,
    endpoint: Endpoint = None,
    twin: Twin = None,
) -> int:
    """Print what a running twin publishes, one line each, until Ctrl-C: the newest state, and every event.

    Exit code 0: ended; 1: no twin answers; 2: bad input.

    Args:
        key: One of tick, robot, scan, grid, event, metrics, status, scene.
        once: Print only the newest value.
        json: Print the messages themselves, as JSON.
        field: Print one field, as JSON; its path with dots: robot.pose.0.
        endpoint: Address of the twin server; without it, that of MOTM_ZENOH_CONFIG, or the twin on this machine.
        twin: Name of the twin.
    """
    from motm_twin.cli.client import watch as watch_key

    return watch_key(key, once=once, as_json=json, field=field, endpoint=endpoint, twin=twin)


def send(
    command: Annotated[Positional[str], tyro.conf.arg(metavar="COMMAND")],
    fields: Annotated[Positional[tuple[str, ...]], tyro.conf.arg(metavar="NAME=VALUE")] = (),
    /,
    json: Annotated[str | None, tyro.conf.arg(name="json", metavar="{...}")] = None,
    timeout: float = 2.0,
    endpoint: Endpoint = None,
    twin: Twin = None,
) -> int:
    """Send a command to a running twin, print its answer as JSON, and let others drive again.

    Exit code 0: done; 1: refused, or no twin answers; 2: bad input.

    Args:
        command: Name of the command, such as play or add_obstacle; docs/zenoh.md lists them.
        fields: Fields of the command: name=crate x=1.0 y=-0.5 size=0.3,0.3,0.4
        json: Fields as JSON instead.
        timeout: Time to wait for the answer [s].
        endpoint: Address of the twin server; without it, that of MOTM_ZENOH_CONFIG, or the twin on this machine.
        twin: Name of the twin.
    """
    from motm_twin.cli.client import send as send_command

    return send_command(command, list(fields), json=json, timeout=timeout, endpoint=endpoint, twin=twin)


def twins(endpoint: Endpoint = None, json: Annotated[Flag, tyro.conf.arg(name="json")] = False) -> int:
    """List the twins that run on this machine, or behind an endpoint (or that of MOTM_ZENOH_CONFIG).

    Exit code 0: there is one that answers; 1: there is none.

    Args:
        endpoint: Address of a twin server or router.
        json: Print JSON, one line each.
    """
    from motm_twin.cli.client import twins as list_twins

    return list_twins(endpoint, as_json=json)


def demo() -> int:
    """Serve Experiment 2, four Temis in the robot's way, again and again. The same as `motm-twin serve exp2 --loop`."""
    return serve(ServeSettings(scene="exp2", loop=True))


def version() -> int:
    """Print the version."""
    print(f"motm-twin {__version__}")
    return 0


def warm_up() -> int:
    """Compile the numeric kernels, once per installation: later starts take seconds."""
    from motm_twin.warm_up import main

    main()
    return 0


_OWN = (serve, run, record, replay, robot, demo)  # have signal handlers of their own, or say when they are loaded
_OTHERS = (
    *(rerun, info, recover, what_if, watch, send, twins),
    *(scene, bench, paper, security, doctor, warm_up, version),
)
COMMANDS: dict[str, Callable[..., int]] = {
    **{command.__name__: command for command in _OWN},
    **{command.__name__.replace("_", "-"): interruptible(command) for command in _OTHERS},
}
