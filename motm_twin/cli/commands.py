"""Commands of the command line, each with its options and help. What they do is imported when they are called."""

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Literal

import tyro
from tyro.conf import Positional

from motm_twin import __version__
from motm_twin.cli.client import send, twins, watch
from motm_twin.cli.doctor import doctor
from motm_twin.cli.paper import paper
from motm_twin.cli.record import info, record, recover, replay, rerun, what_if
from motm_twin.cli.robot import robot
from motm_twin.cli.security import security
from motm_twin.cli.settings import RunSettings, Seed, ServeSettings
from motm_twin.interrupts import interruptible
from motm_twin.model.names import SceneError
from motm_twin.studies.settings import BenchSettings


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
