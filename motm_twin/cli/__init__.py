"""The command line: `motm-twin serve | run | record | replay | rerun | what-if | scene | bench | ...`.

Each command has its options and help here, in `settings`, or in its own file. Its implementation is imported when it
is called.
"""

import io
import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Literal

import tyro
from tyro.conf import Positional, arg

from motm_twin import __version__
from motm_twin.bus.connection import ConfigError
from motm_twin.cli import client, doctor, record, security
from motm_twin.cli.settings import BenchSettings, PaperSettings, RunSettings, Seed, ServeSettings
from motm_twin.model.names import MethodError, SceneError, hint
from motm_twin.processes import interruptible
from motm_twin.program import BAD_INPUT, FAILED, INTERRUPTED, OK, kernel_problem, plain_console
from motm_twin.sessions.session import SessionError


def _run(settings: Annotated[RunSettings, arg(name="")]) -> int:
    """Run a scene headless, as fast as the processor allows.

    Exit code 0: the task was completed with no contact caused by the robot; 1: not; 2: bad input; 130: Ctrl-C.
    """
    from motm_twin.cli.run import run as run_scene

    return run_scene(settings)


def _serve(settings: Annotated[ServeSettings, arg(name="")]) -> int:
    """Serve the twin in the browser, and its state on Zenoh."""
    from motm_twin.cli.serve import serve as serve_twin

    return serve_twin(settings)


def _scene(
    action: Positional[Literal["list", "check", "schema", "generate"]],
    paths: Annotated[Positional[tuple[str, ...]], arg(metavar="[SCENE ...]")] = (),
    /,
    seed: Seed = None,
    difficulty: Annotated[float | None, arg(metavar="FLOAT")] = None,
    output: Annotated[Path | None, arg(aliases=["-o"], metavar="FILE")] = None,
) -> int:
    """List the shipped scenes, check scene files, print the JSON Schema of scene files, or make a new scene.

    Args:
        action: What to do.
        paths: For check: names or files of scenes; - reads standard input.
        seed: For generate: the same seed and difficulty give the same file. (check looks at what any seed draws.)
        difficulty: For generate: from 0 (easy) to 1 (hard); 0.5 without it.
        output: For generate: the new file; without it, the scene is printed.
    """
    from motm_twin.cli.scene import check_scenes, generate_scene, list_scenes, print_schema

    if action == "generate":
        return generate_scene(seed, difficulty, output, paths[0] if paths else None)
    if (seed, difficulty, output) != (None, None, None):
        raise SceneError(f"scene {action}: --seed, --difficulty and --output belong to scene generate")
    if action == "list":
        return list_scenes()
    if action == "schema":
        return print_schema()
    if not paths:
        raise SceneError("scene check: name a shipped scene or a file to check")
    return check_scenes(paths)


def _bench(settings: Annotated[BenchSettings, arg(name="")]) -> int:
    """Measure trials, the page, Zenoh or a router, as tables and JSON; or compare methods.

    A group, such as exp1, measures the numbers of the README. With --methods, --trials, --changes, --backend, --address
    or --retry-failed it runs an experiment and compares the methods in a table: exp1, exp1a, exp2, blind, one_temi,
    ablations, grasp_delay, robustness, mismatch, quick_robot, further_scenes, generated, sweep_next_weight,
    sweep_bezier_offset, sweep_radius_min or sweep_radius_max. Trials are kept on disk: after Ctrl-C or a crash the same
    command resumes.
    """
    from motm_twin.cli.bench import run_bench

    return run_bench(settings)


def _paper(settings: Annotated[PaperSettings, arg(name="")]) -> int:
    """Run the paper's experiments and write a report to cite: figures, tables, results, one HTML file.

    The default runs all methods on ten trials of Experiments 1 and 1a and on five of 2, each modification switched off
    on ten, other values of four parameters on five, ten seeds of every error and five of late, missed and slipped
    grasps: less than an hour on two cores. After Ctrl-C the same command resumes. Exit code 0: the report was written;
    2: bad input; 130: stopped with Ctrl-C.
    """
    from motm_twin.cli.bench import write_paper

    return write_paper(settings)


def _demo() -> int:
    """Serve Experiment 2, four Temis in the robot's way, again and again. The same as `motm-twin serve exp2 --loop`."""
    return _serve(ServeSettings(scene="exp2", loop=True))


def _version() -> int:
    """Print the version."""
    print(f"motm-twin {__version__}")
    return 0


def _warm_up() -> int:
    """Compile the numeric kernels, once per installation: later starts take seconds."""
    from motm_twin.warm_up import main

    main()
    return 0


OWN: dict[str, Callable[..., int]] = {  # commands with their own signal handlers, or that report when they are loaded
    "serve": _serve, "run": _run, "record": record.record, "replay": record.replay, "robot": client.robot,
    "demo": _demo,
}  # fmt: skip
OTHERS: dict[str, Callable[..., int]] = {
    "rerun": record.rerun, "info": record.info, "recover": record.recover, "what-if": record.what_if,
    "watch": client.watch, "send": client.send, "twins": client.twins, "scene": _scene, "bench": _bench,
    "paper": _paper, "security": security.security, "doctor": doctor.doctor, "warm-up": _warm_up, "version": _version,
}  # fmt: skip
COMMANDS = OWN | {name: interruptible(command) for name, command in OTHERS.items()}


def main() -> None:
    """Run the command line and exit with the command's code; 1 when the output is closed, 130 after Ctrl-C."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")  # for terminals with ASCII only, as over a serial line
    try:
        try:
            code = _called()
        finally:
            sys.stdout.flush()  # raises for a closed output at the latest
    except BrokenPipeError:  # "Note on SIGPIPE" of Python's signal: the rest must not be written at exit
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
    """True when standard output cannot be written, as on a full disk."""
    try:
        sys.stdout.flush()
        return os.write(sys.stdout.fileno(), b"") < 0
    except OSError:
        return True


def _give_up_output() -> None:
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _called() -> int:
    """Call the command; its exit code."""
    if sys.argv[1:] == ["--version"]:
        print(f"motm-twin {__version__}")
        return OK
    wrong = sys.argv[1] if len(sys.argv) > 1 else ""
    if wrong and not wrong.startswith("-") and wrong not in COMMANDS:
        print(f"motm-twin: there is no command {wrong!r}; {hint(wrong, COMMANDS)}", file=sys.stderr)
        return BAD_INPUT
    try:
        return tyro.extras.subcommand_cli_from_dict(
            COMMANDS,
            prog="motm-twin",
            description="Reactive manipulation on the move, as a digital twin. --version prints the version.",
        )
    except (SceneError, SessionError, ConfigError, MethodError) as error:
        return _refused(str(error))
    except RuntimeError:  # raised by Numba when a module with kernels is imported
        if problem := kernel_problem():
            return _refused(problem)
        raise


def _refused(problem: str) -> int:
    plain_console(stderr=True).print(f"motm-twin: {problem}", markup=False)
    return BAD_INPUT
